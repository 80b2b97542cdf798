# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The simulation node: a runner in its own thread, and its translation to the ROS graph."""

from collections.abc import Callable
from concurrent.futures import Future
from contextlib import AbstractContextManager, nullcontext
import gc
import logging
from pathlib import Path
import threading
import time
from typing import Any, TYPE_CHECKING

from icofabric_sim.bag.folder import BagError, require_new
from icofabric_sim.libraries import require_library
from icofabric_sim.messages.schedule import seconds
from icofabric_sim.messages.topics import DIAGNOSTICS, TOPICS
from icofabric_sim.parameters.validation import find_specification, Parameters
from icofabric_sim.process.compile_notice import compile_notice
from icofabric_sim.ros.answers import Answers
from icofabric_sim.ros.input_topics import InputTopics
from icofabric_sim.ros.live_sink import LiveSink
from icofabric_sim.ros.parameter_service import GuardedParameterService
from icofabric_sim.ros.process import log_to_ros, Presence, Server
from icofabric_sim.ros.robustness.clock_watch import ClockWatch
from icofabric_sim.ros.robustness.late_answers import AnsweringNode
from icofabric_sim.ros.robustness.name_watch import NameWatch
from icofabric_sim.ros.ros_parameters import describe, is_foreign, ParameterGate
from icofabric_sim.ros.standard_services import offer_standard_services
from icofabric_sim.ros.start import FAILED, import_without_gc, INTERRUPTED, READY, StopSignals
from icofabric_sim.ros.start_report import reporting_start
from icofabric_sim.ros.verbs import StdServices
from icofabric_sim.running.diagnostics import (
    HealthReport,
    NOT_TAKEN,
    RECORDER_DROPPED,
    RECORDER_LAG,
    WRENCHES_DROPPED,
)
from icofabric_sim.running.parameter_change import ParameterChange
from icofabric_sim.running.recording import BagSink, summarise_run
from icofabric_sim.running.run_records import Status
from icofabric_sim.running.runner import Runner
from icofabric_sim.scene.scene import Scene
from icofabric_sim.scene.summary import size_text
from icofabric_sim.simulation.simulation import compile_scene, Simulation
from rclpy.clock import Clock, ClockType
from rclpy.parameter import Parameter

if TYPE_CHECKING:
    from icofabric_sim.simulation.devices.ranks import Ranks

_LOGGER = logging.getLogger('icofabric_sim')
# Time for pending answers after the run has ended, and for delivery of the last one to a busy
# client [s].
_LAST_ANSWERS_S, _LAST_DELIVERY_S = 2.0, 0.5
_BLOCKED_S, _POLL_INTERVAL_S = 5.0, 0.2
# A diagnostics report that is overdue by this time [s] is sent on behalf of the run; checked at
# this interval [s].
_OVERDUE_S, _REPORT_CHECK_S = 1.4, 0.5


class FabricNode(AnsweringNode):
    """Node that translates between the ROS graph and a runner; it contains no physics."""

    def __init__(
        self,
        parameters: Parameters,
        *,
        simulation: Simulation | None = None,
        on_built: Callable[[], None] = lambda: None,
        presence: Presence | None = None,
        ranks: 'Ranks | None' = None,
    ) -> None:
        """
        Build the scene of the validated `parameters`; raise ValueError if that is impossible.

        With `simulation`, continue from its state instead. `on_built` is called once the scene is
        built, before a bag is opened. `presence` is a node that joined the graph earlier. `ranks`
        are MPI processes that share the steps.
        """
        super().__init__(
            'icofabric', allow_undeclared_parameters=True, start_parameter_services=False
        )
        self._gate: ParameterGate | None = None
        self.build: Future[str] | None = None
        log_to_ros(self.get_logger())
        self._name_watch = NameWatch(self, None if presence is None else presence.begun)
        if simulation is None:
            if parameters['record.path']:
                # Before the constructor waits for the compiler.
                require_new(Path(parameters['record.path']))
            self._name_watch.require_first()
            with reporting_start(self):
                simulation = compile_scene(Scene.from_parameters(parameters), ranks=ranks)
                simulation.warm_up()
            self._name_watch.require_first()
        if presence is not None:
            presence.end()
        on_built()
        self.stop_wanted = False
        self._faults: dict[str, str] = {}
        self._report_lock, self._reported_at = threading.Lock(), time.monotonic()
        self._last_status: Status | None = None
        self._report = HealthReport(self.get_fully_qualified_name())
        self.live = LiveSink(self, [
            topic for topic in TOPICS if not topic.requires or parameters[topic.requires]])
        self.live.set_scene(simulation.scene)
        self.bag = self._open_bag(parameters, simulation)
        self.runner = Runner(
            simulation,
            [self.bag, self.live],
            parameters=parameters,
            on_rebuilt=self._rebuilt,
            report=self._diagnose,
            full_name=self.resolve_topic_name,
        )
        # Compile the functions of a report here, not later in the run's thread.
        self._last_status = self.runner.status()
        self._clock_watch = ClockWatch(self) if parameters['publish_clock'] else None
        self._name_watch.begin()
        self._declare(parameters)
        self._gate = ParameterGate(
            parameters, self._changed, lambda: self.runner.simulation.status.stability_limit,
            lambda name: self.get_parameter_or(name).value)
        self.answers = Answers(self, lambda: self._inputs.take_all())
        self._parameter_service = GuardedParameterService(self, self.answers)
        self._inputs = InputTopics(
            self, self.runner.inputs, simulation.scene,
            reliable=parameters['input_reliability'] == 'reliable')
        self._verbs = StdServices(self, self.runner, self.answers)
        self._standard = offer_standard_services(self, self.runner, self.answers, self._quit)
        self._thread = threading.Thread(target=self._simulate, name='simulation', daemon=True)
        self.create_timer(
            _REPORT_CHECK_S, self._report_overdue, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def start(self) -> None:
        """Start simulated time."""
        self._thread.start()

    def is_done(self) -> bool:
        """
        Return whether the `duration` of the scene has passed, or a client has requested the end.
        """
        return self.stop_wanted or not self._thread.is_alive()

    def close(
        self, closing: Callable[[], AbstractContextManager[None]] = nullcontext
    ) -> None:
        """
        Stop the simulation and close the bag; a second call has no effect.

        The bag is closed in the context that `closing` returns, even if a call of the middleware
        blocks the run's thread.
        """
        self.runner.stop()
        while self._thread.is_alive() and not self._is_blocked():
            self._thread.join(_POLL_INTERVAL_S)
        is_alive = self._thread.is_alive()
        if is_alive:
            self.get_logger().error(
                f'publishing has been blocked for {_BLOCKED_S:g} s: the run ends')
        self.answers.end('the node has ended')
        self.live.close()
        # The current values belong to the run's thread.
        status = self._last_status if is_alive else self.runner.status()
        with closing():
            self.bag.close(summary=None if status is None else summarise_run(status))

    def _is_blocked(self) -> bool:
        """Return whether a publish call has been blocked in the middleware for too long."""
        return time.monotonic() - self.live.busy_since > _BLOCKED_S

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> Any:
        """Validate a change before rclpy applies it; both set_parameters services call it."""
        if self._gate is None:
            return super().set_parameters_atomically(parameter_list)
        return self._gate.set_atomically(parameter_list, super().set_parameters_atomically)

    def _open_bag(self, parameters: Parameters, simulation: Simulation) -> BagSink:
        require_library('rosbags', 'recording')
        bag = BagSink(
            parameters['record.path'],
            simulation,
            live=True,
            name=self.get_fully_qualified_name(),
            storage=parameters['record.storage'],
            parameters=parameters,
            on_error=self._bag_failed,
            on_warning=self.get_logger().warning,
        )
        if bag.recorder is not None and not bag.recorder.survives_kill:
            self.get_logger().warning(
                f'a bag in {parameters["record.storage"]} is complete only after it is closed: if '
                'this process is killed, the recording can be lost; with record.storage: '
                'mcap at most the last second is lost'
            )
        return bag

    def _declare(self, parameters: Parameters) -> None:
        """Declare exactly the parameters of the scene; undeclare named ones that are gone."""
        for name, value in parameters.items():
            if not self.has_parameter(name):
                self.declare_parameter(
                    name, value, describe(name, find_specification(name)), ignore_override=True
                )
        for name in self.list_parameters([], 0).names:
            if name not in parameters and not is_foreign(name):
                self.undeclare_parameter(name)

    def _changed(self, change: ParameterChange) -> None:
        self._declare(change.after)
        self._faults.pop('rejected change', None)
        # The service that requested the change waits for this future, see parameter_service.py.
        self.build = change.outcome
        self.runner.apply_change(change)

    def _rebuilt(self, wanted: Parameters, reason: str) -> None:
        self.answers.hand_over(lambda: self._apply_outcome(wanted, reason))

    def _apply_outcome(self, wanted: Parameters, reason: str) -> None:
        """Update the node after the change to `wanted` was built, or failed with `reason`."""
        self._inputs.set_scene(self.runner.simulation.scene)
        self.live.set_scene(self.runner.simulation.scene)
        if not reason or self._gate is None:
            return
        self._faults['rejected change'] = f'the last change could not be built: {reason}'
        if self._gate.accepted is not wanted:
            return  # a later change is pending and decides
        self._gate.accepted = in_force = self.runner.parameters
        for name in wanted:
            if wanted[name] != in_force.get(name, wanted[name]):
                super().set_parameters_atomically([Parameter(name, value=in_force[name])])
        self._declare(in_force)

    def _simulate(self) -> None:
        try:
            self.runner.run(until_finished=None)
        except Exception as error:  # the node reports the error and closes the bag
            reason = f'the simulation thread has ended: {error!r}'
            self.get_logger().fatal(reason)
            self.runner.state.failure = self.runner.failure or reason
        self.answers.hand_over(lambda: None)

    def _quit(self) -> None:
        self.stop_wanted = True

    def _bag_failed(self, error: BagError) -> None:
        self._faults['recording'] = str(error)
        self.get_logger().error(f'{error}; the simulation continues without recording')

    def _report_overdue(self) -> None:
        """
        Publish diagnostics on behalf of a run that is busy, e.g. compiling kernels.

        The last reported values are used, because the current ones belong to the run's thread.
        """
        status, late = self._last_status, time.monotonic() - self._reported_at > _OVERDUE_S
        if late and status is not None and self._thread.is_alive():
            self.live.offer(DIAGNOSTICS, lambda: self._diagnose(status, held_up=True))

    def _diagnose(self, status: Status, *, held_up: bool = False) -> bytes:
        with self._report_lock:
            self._last_status, self._reported_at = status, time.monotonic()
            return self._health(status, held_up=held_up)

    def _health(self, status: Status, *, held_up: bool) -> bytes:
        figures = {
            WRENCHES_DROPPED: str(status.dropped),
            NOT_TAKEN: str(self.live.not_taken),
        }
        if self.bag.path is not None:
            figures[RECORDER_LAG] = f'{self.bag.statistics.lag:.3f}'
            figures[RECORDER_DROPPED] = str(self.bag.dropped)
        compiling = f'for {compile_notice.seconds:.0f} s so far'
        figures['compiling'] = status.waits or (
            compiling if compile_notice.is_compiling else 'no')
        figures['recording'] = str(self.bag.path) if self.bag.is_recording else 'no'
        if self.bag.is_recording and self.bag.error is None:
            self._faults.pop('recording', None)
        notes = {
            'clock': '' if self._clock_watch is None else self._clock_watch.note,
            'name': self._name_watch.note}
        if held_up:
            notes['held up'] = 'the run is waiting for its kernels: compiling ' + compiling if (
                compile_notice.is_compiling) else 'the run has not reported in time'
        return self._report.bytes(
            status, dict(self._faults), figures,
            {name: note for name, note in notes.items() if note})


def run_node(node: FabricNode, signals: StopSignals) -> int:
    """Run a node until its run is done or stopped; return the exit status."""
    simulation = node.runner.simulation
    count = simulation.status.rank_count
    _LOGGER.info(
        '%s%s, %s, step %.3g s%s', READY, size_text(simulation.scene),
        simulation.status.method_name, simulation.status.step,
        f', {count} ranks share the steps' if count > 1 else '')
    if node.runner.paused and not node.runner.now and node.runner.parameters['publish_clock']:
        _LOGGER.info(
            'started paused: /clock stays at 0 until ~/pause (data: false), ~/step or ~/advance, '
            'and nodes that wait for a clock wait until then')
    server = Server(node)
    # Freeze imported objects: a garbage collection over them would block the node.
    gc.freeze()
    node.start()
    with import_without_gc():
        # Needed by the first recording; imported after the first poses, so that they are not
        # delayed.
        import icofabric_sim.bag.recorder  # noqa: F401
    signals.save_before_force(node.bag.close)
    try:
        server.serve(lambda: signals.received or node.is_done())
    finally:
        is_waited_for = bool(node.answers)
        node.close(signals.without_limit)
    if is_waited_for:
        # Pending requests get an answer: no result will come.
        deadline = time.monotonic() + _LAST_ANSWERS_S
        server.serve(lambda: not node.answers or time.monotonic() > deadline)
        # Delivery of an answer cannot be observed, and the end of the process cancels it.
        deadline = time.monotonic() + _LAST_DELIVERY_S
        server.serve(lambda: time.monotonic() > deadline)
    status = _exit_status(node, interrupted=signals.received)
    signals.ignore(status)
    node.destroy_node()
    gc.freeze()  # a garbage collection at the end of the process takes half a second otherwise
    return status


def _exit_status(node: FabricNode, *, interrupted: bool) -> int:
    """Log the last line and return the exit status of a closed node."""
    run, duration = node.runner, node.runner.parameters['duration']
    record = '' if node.bag.path is None else f'; recorded to {node.bag.path}'
    if run.failure:
        return FAILED
    if run.finished:
        _LOGGER.info('done: the duration of %g s has passed%s', duration, record)
    if not interrupted or run.finished:
        return 0
    _LOGGER.info(
        'interrupted at t = %.9g s%s%s', seconds(run.now),
        f' of {duration:g} s' if duration > 0.0 else '', record)
    return INTERRUPTED if duration > 0.0 else 0
