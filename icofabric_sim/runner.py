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
from contextlib import suppress
import logging
import math
from queue import SimpleQueue
import threading
import time as wall
from typing import Any

from icofabric_sim.broadcast import Broadcast, Sink
from icofabric_sim.pace import Pace
from icofabric_sim.parameters import Parameters
from icofabric_sim.pending import PendingInputs
from icofabric_sim.reweave import concerns_runner_only, restarts_motion, Reweaver, with_rates
from icofabric_sim.run_records import cheap_errors, Errors, figures, Status, WrenchInput
from icofabric_sim.schedule import NANOSECONDS, nanoseconds_not_before, seconds
from icofabric_sim.simulation import Interrupted, Simulation, SimulationError
from icofabric_sim.stepping import StepRequest, StepRequests

_LOGGER = logging.getLogger('icofabric_sim')
# Wall time of one call into the simulation [s]: how late an immediate input, a pause or a stop
# is heard.
RESPONSE = 0.01
# Wall time between repeated live messages while the simulated time stands still [s].
_IDLE_REFRESH = 0.5


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
            sinks, simulation, None if report is None else lambda: report(self._fresh_status())
        )
        self._commands: SimpleQueue[tuple[Callable[[], Any], Future[Any]]] = SimpleQueue()
        self._wake = threading.Event()
        self._stopping = False
        self._pending = PendingInputs()
        self._steps = StepRequests()
        self._pace = Pace(self.parameters['real_time_factor'])
        self._reweaver = Reweaver(self.post, self._swap)
        self._last_refresh = 0.0
        self._errors: Errors | None = None

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
            self._steps.end('ended by a pause' if paused else 'time runs on')
            self.paused = paused
            self._pace.restart(self.now)
            return self.now

        return self.post(act)

    def take_steps(self) -> 'Future[Any]':
        """
        Take `step_count` solver steps while paused, and publish the state they lead to.

        The result is its time [ns]; a pause, a reset or the end of `run` ends them early, with a
        RuntimeError that says how many were taken.
        """
        request = StepRequest(self.parameters['step_count'])
        self.post(lambda: self._begin_steps(request))
        return request.future

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
        Present figures; each is read on its own, those of the accuracy at the last report.
        """
        return Status(
            time=self.now,
            paused=self.paused,
            finished=self.finished,
            failure=self.failure,
            factor=self._pace.factor(self.now),
            wanted_factor=self.parameters['real_time_factor'],
            dropped=self.dropped,
            errors=self._errors,
            **figures(self.simulation),
        )

    @property
    def dropped(self) -> int:
        """
        Wrenches that were received and never acted.
        """
        return self._pending.dropped

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
        self._watch_for_stop()
        self._broadcast.start(self.now)
        self._pace.restart(self.now)
        try:
            while self._turn(until_finished):
                if progress is not None:
                    progress(seconds(self.now))
        finally:
            self.simulation.should_stop = None
            self._steps.end('the run has ended')
            self._pending.drop_all('the run ended before')
            self._fresh_status()
        self._broadcast.report(self.now, at_once=True)

    def _turn(self, until_finished: bool) -> bool:
        """
        Do what is to be done next; False when that is nothing ever more.
        """
        # Before looking at what it announces: nothing that comes later is slept over.
        self._wake.clear()
        if self._stopping:
            return False
        self._run_commands()
        self._broadcast.report(self.now)
        if self._steps.current is not None:
            self._take_steps(self._steps.current)
            self._refresh()
            return True
        if self.paused or self.failure or self.finished:
            if until_finished and (self.failure or self.finished):
                return False
            self._refresh()
            self._wake.wait(_IDLE_REFRESH)
            return True
        delay = self._pace.delay(self.now)
        if delay > 0.0:
            # Whatever arrives wakes it, and must not make simulated time run ahead.
            self._wake.wait(min(delay, _IDLE_REFRESH))
        else:
            self._advance(self._next_target())
        return True

    def _advance(self, target: int) -> None:
        started = wall.perf_counter()
        before = self.now
        try:
            self.simulation.advance_to(seconds(target))
            self.now = target
            self._pace.learn(target - before, wall.perf_counter() - started)
            self._act_pending()
            self._broadcast.due(self.now)
        except SimulationError as error:
            self._fail(str(error))
        except Interrupted:
            self._catch_up()

    def _next_target(self) -> int:
        times = [self.now + self._pace.chunk(RESPONSE, self.simulation.step)]
        times += self._broadcast.next_times(self.now)
        if self._pending.next_time is not None:
            times.append(self._pending.next_time)
        if self._end() > self.now:
            times.append(self._end())
        return max(min(times), self.now)

    def _run_commands(self) -> None:
        # Those only that are there now: who sends without end must not stop time.
        for _ in range(self._commands.qsize()):
            command, future = self._commands.get_nowait()
            try:
                future.set_result(command())
            except SimulationError as error:
                self._fail(str(error))
                future.set_exception(error)
            except Interrupted:
                self._catch_up()
                future.set_exception(RuntimeError('the run has ended'))
            except Exception as error:  # noqa: BLE001 - the one who asked gets it, the run goes on
                _LOGGER.error('%s', error)
                future.set_exception(error)

    def _refresh(self) -> None:
        """
        Repeat the present state now and then, for live listeners only.

        Late joiners of a paused fabric see it, and clocks that wait for a time get one; a bag need
        not know.
        """
        if wall.monotonic() - self._last_refresh > _IDLE_REFRESH:
            self._last_refresh = wall.monotonic()
            self._broadcast.emit(self.now, live_only=True)

    def _queue_input(self, received: WrenchInput) -> None:
        if self.failure:
            self._pending.drop(received, 'the simulation has stopped')
            return
        self._pending.add(received, self.now, self.parameters['input_horizon'])
        self._act_pending()

    def _act_pending(self) -> None:
        self._pending.act(self.now, self.simulation, self._broadcast.input)

    def _begin_steps(self, request: StepRequest) -> None:
        if self.failure:
            request.future.set_exception(RuntimeError(self.failure))
        elif not self.paused:
            request.future.set_exception(RuntimeError(
                'steps are taken only while paused: call ~/pause with data: true first'))
        else:
            self._steps.add(request)

    def _take_steps(self, request: StepRequest) -> None:
        """
        Take steps for a moment; the rest follows once commands had their turn.
        """
        simulation, end = self.simulation, wall.perf_counter() + RESPONSE
        try:
            while not request.done:
                before, due = simulation.step_count, self._pending.next_time
                if due is not None and seconds(due) < simulation.next_step_time:
                    self.now = max(self.now, due)
                    simulation.advance_to(seconds(self.now))
                    self._act_pending()
                else:
                    simulation.advance_steps(1)
                request.taken += simulation.step_count - before
                if wall.perf_counter() > end:
                    break
            self._catch_up()
            # What comes in between two portions acts at a whole number of nanoseconds too.
            simulation.advance_to(seconds(self.now))
            if request.done:
                self._pace.restart(self.now)
                self._broadcast.emit(self.now)
                self._steps.finish(self.now)
        except SimulationError as error:
            self._fail(str(error))
        except Interrupted:
            self._catch_up()

    def _reset(self) -> int:
        self._steps.end('ended by a reset')
        self._pending.drop_all('a reset came before')
        ended = self._fresh_status()
        if self.parameters['reset_time']:
            self.simulation.reset_time()
            self.now = 0
            self._broadcast.time_jumped_back(ended)
        else:
            self.simulation.reset()
            self._catch_up()
        self.failure = ''
        self._pace.restart(self.now)
        self._broadcast.start(self.now, cleared=True)
        return self.now

    def _change(self, parameters: Parameters) -> None:
        # Rates, pace and duration act at once, also while another fabric is being built.
        before = self._reweaver.wanted or self.parameters
        rates = with_rates(self.parameters, parameters)
        if rates is not self.parameters:
            self._take_rates(rates)
            self._broadcast.describe(self.now)
        if concerns_runner_only(before, parameters):
            self._reweaver.amend(parameters)
        else:
            _LOGGER.info('building the changed fabric beside the running one')
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
        self._watch_for_stop()
        self._pace.forget_speed()
        self._broadcast.set_scene(simulation)
        self._take_rates(parameters)
        self._broadcast.start(self.now, cleared=True)
        _LOGGER.info('the changed fabric is in place at t = %.9g s: %d bodies, step %.3g s',
                     seconds(self.now), simulation.scene.body_count, simulation.step)
        self.on_rebuilt(parameters, '')

    def _fresh_status(self) -> Status:
        self._errors = cheap_errors(self.simulation)
        return self.status()

    def _end(self) -> int:
        duration = self.parameters['duration']
        return max(1, round(duration * NANOSECONDS)) if duration > 0.0 else 0

    def _watch_for_stop(self) -> None:
        self.simulation.should_stop = lambda: self._stopping

    def _catch_up(self) -> None:
        """
        Take the time that the simulation has reached by steps, or before something broke it off.
        """
        self.now = max(self.now, nanoseconds_not_before(self.simulation.time))

    def _fail(self, reason: str) -> None:
        self._catch_up()
        self.failure = reason
        _LOGGER.error('the simulation has stopped: %s', reason)
        self._steps.end(reason)
        self._pending.drop_all('the simulation has stopped')
        with suppress(SimulationError, Interrupted):
            if math.isfinite(self.simulation.snapshot().position.sum()):
                self._broadcast.emit(self.now)
