# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Runs a simulation in time: inputs at their moment, outputs on their grid, at the wanted pace.

One runner serves the node (its own thread, live topics and bag) and `icofabric run` (no graph, bag
only). Simulated time between two calls of the simulation is always a whole number of nanoseconds,
so every input acts at a time that a bag can hold, and a run repeats to the last bit.
"""

from collections.abc import Callable
from concurrent.futures import Future
import heapq
import logging
import math
from queue import Empty, SimpleQueue
import threading
import time as wall
from typing import Any

from icofabric_sim.broadcast import Broadcast, Sink
from icofabric_sim.inputs import Key
from icofabric_sim.messages import WrenchStampedBytes
from icofabric_sim.pace import Pace
from icofabric_sim.parameters import Parameters
from icofabric_sim.reweave import concerns_runner_only, restarts_motion, Reweaver
from icofabric_sim.run_records import Status, WrenchInput
from icofabric_sim.schedule import NANOSECONDS, nanoseconds_not_before, seconds
from icofabric_sim.simulation import Simulation, SimulationError

_LOGGER = logging.getLogger('icofabric_sim')
# Wall time of one call into the simulation [s]: how late an immediate input, a pause or a stop
# is heard.
RESPONSE = 0.01
# Wall time between repeated live messages while the simulated time stands still [s].
_IDLE_REFRESH = 0.5
# Wall time between two warnings of dropped wrenches [s].
_DROP_INTERVAL = 1.0


class Runner:
    """
    Drives one simulation after another; all methods but `run` may be called from any thread.
    """

    def __init__(
        self,
        simulation: Simulation,
        sinks: list[Sink],
        *,
        on_rebuilt: Callable[[Parameters, str], None] = lambda parameters, reason: None,
        report: Callable[[Status], bytes] | None = None,
    ) -> None:
        """
        Start at time 0, paused where the scene says so.

        `on_rebuilt` hears of each change of the scene: the parameters that were wanted, and why
        they could not be had ('' where they could). `report` lays out /diagnostics.
        """
        self.simulation = simulation
        self.parameters = simulation.scene.parameters
        self.now = 0
        self.paused = bool(self.parameters['start_paused'])
        self.failure = ''
        self.on_rebuilt = on_rebuilt
        self._broadcast = Broadcast(
            sinks, simulation, None if report is None else lambda: report(self.status())
        )
        self._commands: SimpleQueue[tuple[Callable[[], Any], Future[Any]]] = SimpleQueue()
        self._wake = threading.Event()
        self._stopping = False
        self._pending: list[tuple[int, int, WrenchInput]] = []
        self._sequence = 0
        self._pace = Pace(self.parameters['real_time_factor'])
        self._reweaver = Reweaver(self.post, self._swap)
        self._horizon_warned = False
        self.dropped = 0  # wrenches
        self._last_drop = -math.inf
        self._last_refresh = 0.0

    # Called from any thread.

    def post(self, command: Callable[[], Any]) -> 'Future[Any]':
        """
        Have `command` run between two steps; its result comes with the future.
        """
        future: Future[Any] = Future()
        self._commands.put((command, future))
        self._wake.set()
        return future

    def receive(self, received: WrenchInput) -> None:
        """
        Queue a wrench; it acts at its stamp, or at once (CONTRACT 4).
        """
        self.post(lambda: self._queue_input(received))

    def set_paused(self, paused: bool) -> 'Future[Any]':
        """
        Stop or resume simulated time; the result is the time [ns] at which that was.
        """

        def act() -> int:
            self.paused = paused
            self._pace.restart(self.now)
            return self.now

        return self.post(act)

    def take_steps(self) -> 'Future[Any]':
        """
        Take `step_count` solver steps, and publish the state they lead to; the result is its time.
        """
        return self.post(self._step)

    def reset(self) -> 'Future[Any]':
        """
        Back to the initial state, and to time 0 where `reset_time` says so; results in that time.
        """
        return self.post(self._reset)

    def change(self, parameters: Parameters) -> 'Future[Any]':
        """
        Take other parameters; a changed fabric is built aside and swapped in between two steps.
        """
        return self.post(lambda: self._change(parameters))

    def stop(self) -> None:
        """
        End `run` soon.
        """
        self._stopping = True
        self._wake.set()

    def status(self) -> Status:
        """
        Present figures; each is read on its own.
        """
        simulation = self.simulation
        proximity = simulation.proximity
        return Status(
            time=self.now,
            paused=self.paused,
            finished=self.finished,
            failure=self.failure,
            factor=self._pace.factor(self.now),
            wanted_factor=self.parameters['real_time_factor'],
            step=simulation.step,
            limit=simulation.stability_limit,
            step_count=simulation.step_count,
            body_count=simulation.scene.body_count,
            connector_count=simulation.scene.connector_count,
            loads_active=len(simulation.active_loads),
            proximity='' if proximity is None else str(proximity),
        )

    @property
    def finished(self) -> bool:
        """
        Whether the `duration` of the scene has passed.
        """
        return 0 < self._end() <= self.now

    # Called from the thread of `run` only.

    def run(
        self, *, until_finished: bool = False, progress: Callable[[float], None] | None = None
    ) -> None:
        """
        Advance until stopped, or until the duration has passed where `until_finished` says so.

        `progress` hears the simulated time [s] now and then. A failure of the simulation stops
        simulated time, is kept in `failure`, and ends the run where `until_finished`.
        """
        self._broadcast.start(self.now)
        self._pace.restart(self.now)
        while not self._stopping:
            self._run_commands()
            self._broadcast.report(self.now)
            if self.paused or self.failure or self.finished:
                if until_finished and (self.failure or self.finished):
                    break
                self._idle()
                continue
            self._wake.clear()
            if not self._commands.empty():
                continue
            self._advance(self._next_target())
            if progress is not None:
                progress(seconds(self.now))
            delay = self._pace.delay(self.now)
            if delay > 0.0:
                self._wake.wait(delay)
        self._broadcast.report(self.now, at_once=True)

    def _advance(self, target: int) -> None:
        started = wall.perf_counter()
        before = self.now
        try:
            self.simulation.advance_to(seconds(target))
        except SimulationError as error:
            self.now = max(self.now, nanoseconds_not_before(self.simulation.time))
            self._fail(str(error))
            return
        self.now = target
        self._pace.learn(target - before, wall.perf_counter() - started)
        self._act_pending()
        self._broadcast.due(self.now)

    def _next_target(self) -> int:
        chunk = self._pace.chunk(RESPONSE, self.simulation.step)
        times = [self.now + chunk]
        times += self._broadcast.next_times(self.now)
        if self._pending:
            times.append(self._pending[0][0])
        if self._end() > self.now:
            times.append(self._end())
        return max(min(times), self.now)

    def _run_commands(self) -> None:
        while True:
            try:
                command, future = self._commands.get_nowait()
            except Empty:
                return
            try:
                future.set_result(command())
            except SimulationError as error:
                self._fail(str(error))
                future.set_exception(error)
            except Exception as error:  # noqa: BLE001 - the one who asked gets it, the run goes on
                _LOGGER.error('%s', error)
                future.set_exception(error)

    def _idle(self) -> None:
        if wall.monotonic() - self._last_refresh > _IDLE_REFRESH:
            # Late joiners of a paused fabric see it, and clocks that wait for a time get one; a
            # bag need not know.
            self._last_refresh = wall.monotonic()
            self._broadcast.emit(self.now, live_only=True)
        if self._wake.wait(_IDLE_REFRESH):
            self._wake.clear()

    def _queue_input(self, received: WrenchInput) -> None:
        horizon = self.parameters['input_horizon']
        at = received.stamp
        if self.failure:
            self._drop(received, 'the simulation has stopped')
            return
        if at > self.now + round(horizon * NANOSECONDS):
            if not self._horizon_warned:
                self._horizon_warned = True
                _LOGGER.warning(
                    'the stamp %.3f s on %s lies more than input_horizon = %g s ahead of '
                    "simulated time (%.3f s): the sender's clock is not simulated time. The "
                    'wrench acts at once; send stamp 0, or follow /clock (said once)',
                    seconds(at),
                    received.topic,
                    horizon,
                    seconds(self.now),
                )
            at = 0
        at = max(at, self.now)
        heapq.heappush(self._pending, (at, self._sequence, received))
        self._sequence += 1
        self._act_pending()

    def _act_pending(self) -> None:
        while self._pending and self._pending[0][0] <= self.now:
            _, _, received = heapq.heappop(self._pending)
            if not self._is_known(received.key):
                self._drop(received, 'the weave changed before it acted')
                continue
            self._broadcast.input(received.topic, WrenchStampedBytes.TYPE, self.now, received.data)
            if isinstance(received.key, int):
                self.simulation.apply_body_wrench(received.key, received.force, received.torque)
            else:
                self.simulation.apply_wrench(received.key, received.force, received.torque)

    def _drop(self, received: WrenchInput, reason: str) -> None:
        self.dropped += 1
        if wall.monotonic() - self._last_drop >= _DROP_INTERVAL:
            self._last_drop = wall.monotonic()
            _LOGGER.warning('a wrench on %s was dropped: %s', received.topic, reason)

    def _is_known(self, key: Key) -> bool:
        scene = self.simulation.scene
        return key < scene.body_count if isinstance(key, int) else key in scene.loads

    def _step(self) -> int:
        if self.failure:
            raise RuntimeError(self.failure)
        for _ in range(self.parameters['step_count']):
            end = self.simulation.next_step_time
            if self._pending and seconds(self._pending[0][0]) < end:
                self.now = self._pending[0][0]
                self.simulation.advance_to(seconds(self.now))
                self._act_pending()
            else:
                self.simulation.advance_steps(1)
            if self._stopping:
                break
        self.now = max(self.now, nanoseconds_not_before(self.simulation.time))
        self.simulation.advance_to(seconds(self.now))
        self._pace.restart(self.now)
        self._broadcast.emit(self.now)
        return self.now

    def _reset(self) -> int:
        self._pending.clear()
        self.failure = ''
        if self.parameters['reset_time']:
            self.now = 0
            self.simulation.reset_time()
            self._broadcast.time_jumped_back()
        else:
            self.simulation.reset()
        self._pace.restart(self.now)
        self._broadcast.start(self.now, cleared=True)
        return self.now

    def _change(self, parameters: Parameters) -> None:
        if concerns_runner_only(self.parameters, parameters):
            self._reweaver.amend(parameters)
            self._take_rates(parameters)
            self._broadcast.describe(self.now)
        else:
            self._reweaver.want(parameters)

    def _take_rates(self, parameters: Parameters) -> None:
        self.parameters = parameters
        self._broadcast.set_rates(parameters)
        self._pace.set_factor(parameters['real_time_factor'], self.now)

    def _swap(self, parameters: Parameters, simulation: Simulation | None, reason: str) -> None:
        if simulation is not None:
            try:
                simulation.take_over(
                    self.simulation,
                    keep_motion=not restarts_motion(self.parameters, parameters))
            except (SimulationError, ValueError) as error:
                simulation, reason = None, str(error)
        if simulation is None:
            _LOGGER.error('the change could not be built, the old fabric runs on: %s', reason)
            self.on_rebuilt(parameters, reason)
            return
        self.simulation, self.failure = simulation, ''
        self._broadcast.set_scene(simulation)
        self._take_rates(parameters)
        self._broadcast.start(self.now, cleared=True)
        self.on_rebuilt(parameters, '')

    def _end(self) -> int:
        return round(self.parameters['duration'] * NANOSECONDS)

    def _fail(self, reason: str) -> None:
        self.failure = reason
        _LOGGER.error('the simulation has stopped: %s', reason)
        if math.isfinite(self.simulation.snapshot().position.sum()):
            self._broadcast.emit(self.now)
