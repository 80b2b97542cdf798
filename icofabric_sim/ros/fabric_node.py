# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
The simulation node: `ros2 run icofabric_sim fabric_node --ros-args --params-file SCENE`.
"""

from collections.abc import Callable
from concurrent.futures import Future
import sys
import threading
from typing import Any

from icofabric_sim import __version__
from icofabric_sim.bag import BagError
from icofabric_sim.broadcast import Sink
from icofabric_sim.health import HealthReport
from icofabric_sim.parameter_file import check_ros_arguments
from icofabric_sim.parameters import find_specification, Parameters
from icofabric_sim.recording import BagSink, summarise_run
from icofabric_sim.ros.live_sink import LiveSink
from icofabric_sim.ros.parameter_service import GuardedParameterService
from icofabric_sim.ros.process import log_to_ros, plain_reason, spin, start_ros, StopSignals
from icofabric_sim.ros.ros_parameters import (
    describe,
    is_foreign,
    make_start_parameters,
    ParameterGate,
)
from icofabric_sim.ros.wrench_topics import WrenchTopics
from icofabric_sim.run_records import Status
from icofabric_sim.runner import Runner
from icofabric_sim.scene import Scene
from icofabric_sim.simulation import compile_scene
import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

# How long a service waits for the simulation to act before it says that it has not yet [s]: the
# node hears nothing else meanwhile.
_PATIENCE = 1.0


_USAGE = """usage: fabric_node [--ros-args --params-file SCENE -p name:=value ...]
ready scenes are in config/; docs/parameters.md lists all parameters"""


def arguments_of_its_own(arguments: list[str]) -> list[str]:
    """
    What stands outside of `--ros-args ... --`, and is no renaming in the old form.
    """
    own, for_ros = [], False
    for argument in arguments:
        if argument == '--ros-args':
            for_ros = True
        elif for_ros and argument == '--':
            for_ros = False
        elif not for_ros and ':=' not in argument:
            own.append(argument)
    return own


class FabricNode(Node):
    """
    Translates between the graph and a runner, which has a thread of its own; no physics here.
    """

    def __init__(
        self, parameters: Parameters, *, on_built: Callable[[], None] = lambda: None
    ) -> None:
        """
        Build the scene of the judged `parameters`; raises ValueError where that is not possible.

        `on_built` is called before anything begins that must be ended in order, e.g. a bag.
        """
        super().__init__(
            'icofabric', allow_undeclared_parameters=True, start_parameter_services=False
        )
        self._gate: ParameterGate | None = None
        simulation = compile_scene(Scene.from_parameters(parameters), body_wrenches=True)
        simulation.warm_up()
        on_built()
        name = self.get_fully_qualified_name()
        self._report = HealthReport(name)
        self._faults: dict[str, str] = {}
        self.live = LiveSink(self)
        self.bag: BagSink | None = None
        if parameters['record.path']:
            self.bag = BagSink(
                parameters['record.path'],
                simulation,
                live=True,
                name=name,
                storage=parameters['record.storage'],
                on_error=self._bag_failed,
                summarise=self._summarise,
            )
            if not self.bag.recorder.survives_kill:
                self.get_logger().warning(
                    f'a bag in {parameters["record.storage"]} is whole only once it is closed: if '
                    'this process is killed, what was recorded can be lost; with record.storage: '
                    'mcap that is the last second at most'
                )
        sinks: list[Sink] = [self.live] if self.bag is None else [self.bag, self.live]
        self.runner = Runner(simulation, sinks, on_rebuilt=self._rebuilt, report=self._diagnose)
        self._declare(parameters)
        self._gate = ParameterGate(
            parameters, self._changed, lambda: self.runner.simulation.stability_limit
        )
        self._parameter_service = GuardedParameterService(self)
        self._wrenches = WrenchTopics(self, self.runner, simulation.scene)
        self.create_service(SetBool, '~/pause', self._pause)
        self.create_service(Trigger, '~/reset', self._reset)
        self.create_service(Trigger, '~/step', self._step)
        # A guard to leave the executor's wait for work that other threads hand over.
        self._handed: list[Callable[[], None]] = []
        self._handed_guard = self.create_guard_condition(self._run_handed)
        self._thread = threading.Thread(target=self._simulate, name='simulation', daemon=True)

    def start(self) -> None:
        """
        Let simulated time run.
        """
        self._thread.start()

    def is_done(self) -> bool:
        """
        Whether the run of a scene with a duration has come to its end.
        """
        return not self._thread.is_alive()

    def close(self) -> None:
        """
        Stop the simulation and close the bag; may be called twice.
        """
        self.runner.stop()
        if self._thread.is_alive():
            self._thread.join()
        self.live.close()
        if self.bag is not None:
            self.bag.close(summary=self._summarise(self.runner.status()))

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> Any:
        """
        Judge a change before rclpy sees it; both parameter services come through here.
        """
        if self._gate is None:
            return super().set_parameters_atomically(parameter_list)
        return self._gate.set_atomically(parameter_list, super().set_parameters_atomically)

    def _declare(self, parameters: Parameters) -> None:
        """
        Have the node hold just these parameters of the scene: named ones come and go.
        """
        for name, value in parameters.items():
            if not self.has_parameter(name):
                self.declare_parameter(
                    name, value, describe(name, find_specification(name)), ignore_override=True
                )
        for name in self.list_parameters([], 0).names:
            if name not in parameters and not is_foreign(name):
                self.undeclare_parameter(name)

    def _changed(self, parameters: Parameters) -> None:
        self._declare(parameters)
        self._faults.pop('rejected change', None)
        self.runner.change(parameters)

    def _rebuilt(self, wanted: Parameters, reason: str) -> None:
        self._hand_over(lambda: self._follow(wanted, reason))

    def _follow(self, wanted: Parameters, reason: str) -> None:
        """
        Have the node say what is in force, after a change to `wanted` that worked or did not.
        """
        self._wrenches.set_scene(self.runner.simulation.scene)
        if not reason or self._gate is None:
            return
        self._faults['rejected change'] = f'the last change could not be built: {reason}'
        if self._gate.accepted is not wanted:
            return  # a later change is on its way, and decides
        self._gate.accepted = in_force = self.runner.parameters
        for name in wanted:
            if wanted[name] != in_force.get(name, wanted[name]):
                super().set_parameters_atomically([Parameter(name, value=in_force[name])])
        self._declare(in_force)

    def _summarise(self, status: Status) -> dict[str, str]:
        return summarise_run(status._replace(dropped=self._wrenches.dropped + status.dropped))

    def _simulate(self) -> None:
        until_finished = self.runner.parameters['duration'] > 0.0
        try:
            self.runner.run(until_finished=until_finished)
        except Exception as error:  # noqa: BLE001 - the node must say it, and close the bag
            reason = f'the simulation thread has ended: {error!r}'
            self.get_logger().fatal(reason)
            self.runner.failure = self.runner.failure or reason
        self._hand_over(lambda: None)

    def _pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        word = 'paused' if request.data else 'running'
        return self._answer(self.runner.set_paused(request.data), response, word)

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return self._answer(self.runner.reset(), response, 'back at the initial state')

    def _step(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        count = self.runner.parameters['step_count']
        return self._answer(self.runner.take_steps(), response, f'{count} solver steps taken')

    def _answer(self, future: 'Future[Any]', response: Any, word: str) -> Any:
        try:
            time = future.result(timeout=_PATIENCE)
        except TimeoutError:
            response.success, response.message = (
                False,
                f'not yet done after {_PATIENCE:g} s, still under way; /diagnostics tells how far',
            )
        except Exception as error:  # noqa: BLE001 - the client gets the reason
            response.success, response.message = False, str(error)
        else:
            response.success, response.message = True, f'{word}, t = {time / 1e9:.9f} s'
        return response

    def _bag_failed(self, error: BagError) -> None:
        self._faults['recording'] = str(error)
        self.get_logger().error(f'{error}; the simulation goes on without a bag')

    def _diagnose(self, status: Status) -> bytes:
        figures = {'wrenches dropped': str(self._wrenches.dropped + status.dropped)}
        if self.bag is not None:
            statistics = self.bag.recorder.statistics
            figures['recorder lag [s]'] = f'{statistics.lag:.3f}'
            figures['recorder dropped'] = str(statistics.dropped)
        return self._report.bytes(status, dict(self._faults), figures)

    def _hand_over(self, work: Callable[[], None]) -> None:
        """
        Have `work` done in the executor's thread.
        """
        self._handed.append(work)
        if rclpy.ok():
            self._handed_guard.trigger()

    def _run_handed(self) -> None:
        while self._handed:
            self._handed.pop(0)()


def main(argv: list[str] | None = None) -> int:
    """
    Entry point of `fabric_node`.

    Exit status: 0 done, also by SIGINT or SIGTERM; 1 the simulation failed, 2 bad input, 130
    interrupted before it ran.
    """
    signals = StopSignals()
    try:
        return _run(sys.argv if argv is None else argv, signals)
    except (ValueError, rclpy_implementation.RCLError) as error:
        print(f'fabric_node: {plain_reason(error)}', file=sys.stderr)
        return 2
    finally:
        signals.ignore()
        rclpy.try_shutdown()


def _run(arguments: list[str], signals: StopSignals) -> int:
    if set(arguments[1:]) & {'-h', '--help', '--version'}:
        print(f'fabric_node of icofabric_sim {__version__}: icosahedral fabric\n{_USAGE}')
        return 0
    # Before ROS starts, whose errors name no parameter.
    own = arguments_of_its_own(arguments[1:])
    if own:
        raise ValueError(f'{" ".join(own)!r} is not an argument of fabric_node\n{_USAGE}')
    parameters = make_start_parameters(check_ros_arguments(arguments[1:]))
    start_ros(arguments)
    log_to_ros()
    node = FabricNode(parameters, on_built=signals.only_note)
    simulation = node.runner.simulation
    node.get_logger().info(
        f'{simulation.scene.body_count} bodies, {simulation.scene.connector_count} connectors, '
        f'{simulation.method_name}, step {simulation.step:.3g} s'
    )
    node.start()
    try:
        spin(node, lambda: signals.received or node.is_done())
    finally:
        node.close()
    node.destroy_node()
    return 1 if node.runner.failure else 0


if __name__ == '__main__':
    sys.exit(main())
