# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
The simulated time of a run: inputs at their moment, outputs on their grid, commands in between.

Between two calls of the simulation it is always a whole number of nanoseconds, and the simulation
stands there exactly: so every input acts at a time that a bag can hold.
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

from icofabric_sim.messages.schedule import NANOSECONDS, nanoseconds_not_before, seconds
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.running.broadcast import Broadcast, Sink
from icofabric_sim.running.pace import Pace
from icofabric_sim.running.received_inputs import ReceivedInputs
from icofabric_sim.running.run_events import Shown, shown_after
from icofabric_sim.running.run_records import Errors, errors_of, figures, Status
from icofabric_sim.running.step_requests import StepRequest, StepRequests
from icofabric_sim.simulation.errors import Interrupted, SimulationError
from icofabric_sim.simulation.simulation import Simulation

_LOGGER = logging.getLogger('icofabric_sim')
# Wall time of one call into the simulation [s]: how late an immediate input, a pause or a stop
# is heard.
RESPONSE = 0.01
# Of a call that takes longer than that, because the motion has become faster meanwhile [s].
_PATIENCE = 0.1


class TimeLine:
    """One simulation in time, with what waits for its turn; the thread of the run moves it."""

    def __init__(
        self,
        simulation: Simulation,
        sinks: list[Sink],
        parameters: Parameters | None,
        report: Callable[[Status], bytes] | None,
        full_name: Callable[[str], str],
    ) -> None:
        """Start where the simulation stands; see `Runner`."""
        self.simulation = simulation
        self.parameters = parameters or simulation.scene.parameters
        self.now = nanoseconds_not_before(simulation.time)
        self.paused = bool(self.parameters['start_paused'])
        self.failure = ''
        self._broadcast = Broadcast(
            sinks, simulation, None if report is None else lambda: report(self._fresh_status())
        )
        self._broadcast.set_rates(self.parameters)
        self._commands: SimpleQueue[tuple[Callable[[], Any], Future[Any], float]] = SimpleQueue()
        self._lag = 0.0
        self._wake = threading.Event()
        self._stopping = False
        self._patient_until = math.inf
        self.inputs = ReceivedInputs(self, self.post, self._broadcast.input, full_name)
        self._steps = StepRequests()
        self._pace = Pace(self.parameters['real_time_factor'])
        self._errors: Errors | None = None

    def post(self, command: Callable[[], Any]) -> 'Future[Any]':
        """Have `command` run between two steps; its result comes with the future."""
        future: Future[Any] = Future()
        self._commands.put((command, future, wall.monotonic()))
        self._wake.set()
        return future

    def status(self) -> Status:
        """Present figures; each is read on its own, those of the accuracy at the last report."""
        return Status(
            time=self.now,
            paused=self.paused,
            finished=self.finished,
            failure=self.failure,
            factor=self._pace.factor(self.now),
            wanted_factor=self.parameters['real_time_factor'],
            dropped=self.dropped,
            errors=self._errors,
            loads_waiting=len(self.inputs),
            cause=self._pace.cause(),
            lag=self._lag,
            **figures(self.simulation),
        )

    @property
    def dropped(self) -> int:
        """Wrenches that were received and never acted."""
        return self.inputs.dropped

    @property
    def finished(self) -> bool:
        """Whether the `duration` of the scene has passed."""
        return 0 < self._end() <= self.now

    def _advance(self, target: int) -> None:
        started = wall.perf_counter()
        before = self.now
        try:
            if not self._reaches(target):
                self._catch_up()
                target = self.now
                self.simulation.advance_to(seconds(target))
            self.now = target
            self._pace.learn(target - before, wall.perf_counter() - started)
            # Broken off before its first step, it has shown this time already.
            if self.now > before:
                self._broadcast.due(self.now)
        except SimulationError as error:
            self._fail(str(error), target)
        except Interrupted:
            self._catch_up()

    def _reaches(self, target: int) -> bool:
        """
        Advance to `target` [ns]; False where that is broken off on the way, at the end of a step.

        A wrench may make the motion a thousand times faster than it was when the target was
        chosen: what waits for its turn must not wait for all of that.
        """
        self._patient_until = wall.monotonic() + _PATIENCE
        try:
            self.simulation.advance_to(seconds(target))
        except Interrupted:
            return False
        finally:
            self._patient_until = math.inf
        return True

    def _next_target(self) -> int:
        times = [self.now + self._pace.chunk(RESPONSE, self.simulation.step)]
        times += self._broadcast.next_times(self.now)
        if self._end() > self.now:
            times.append(self._end())
        return max(min(times), self.now)

    def _run_commands(self) -> None:
        # Those only that are there now: who sends without end must not stop time.
        for _ in range(self._commands.qsize()):
            command, future, posted = self._commands.get_nowait()
            self._lag = max(self._lag, wall.monotonic() - posted)
            try:
                future.set_result(command())
            except SimulationError as error:
                self._fail(str(error), self.now)
                future.set_exception(error)
            except Interrupted:
                self._catch_up()
                future.set_exception(RuntimeError('the run has ended'))
            except Exception as error:  # noqa: BLE001 - the one who asked gets it, the run goes on
                _LOGGER.error('%s', error)
                future.set_exception(error)

    def _begin_steps(self, request: StepRequest) -> None:
        if self.failure:
            request.future.set_exception(RuntimeError(self.failure))
        elif not self.paused:
            request.future.set_exception(RuntimeError(
                'steps are taken only while paused: call ~/pause with data: true first'))
        else:
            self._steps.add(request)

    def _take_steps(self, request: StepRequest) -> None:
        """Take steps for a moment; the rest follows once commands had their turn."""
        simulation, end = self.simulation, wall.perf_counter() + RESPONSE
        target = self.now
        try:
            while not request.done:
                before = simulation.step_count
                # Rounding must not put it before the end of the step.
                target = nanoseconds_not_before(simulation.next_step_time) + 1
                simulation.advance_steps(1)
                request.taken += simulation.step_count - before
                if wall.perf_counter() > end:
                    break
            self._catch_up()
            # What comes in between two portions acts at a whole number of nanoseconds too.
            simulation.advance_to(seconds(self.now))
            if request.done:
                self._pace.restart(self.now)
                self._broadcast.event(self.now, 'step', count=request.taken)
                self._show_after('step')
                self._steps.finish(self.now)
        except SimulationError as error:
            self._fail(str(error), target)
        except Interrupted:
            self._catch_up()

    def _fail(self, reason: str, target: int) -> None:
        """Stop simulated time: the simulation failed on its way to `target` [ns]."""
        self._catch_up()
        self.failure = reason
        _LOGGER.error('the simulation has stopped: %s', reason)
        self._steps.end(reason)
        self.inputs.drop_waiting('the simulation has stopped')
        self._broadcast.event(self.now, 'failed', reason=reason, target=target)
        with suppress(SimulationError, Interrupted):
            if math.isfinite(self.simulation.snapshot().position.sum()):
                self._show_after('failed')

    def _show_after(self, event: str) -> None:
        """Send what a run shows after an event, see run_events.py."""
        shown = shown_after(event, running=not self.paused)
        if shown is Shown.ANEW:
            self._broadcast.start(self.now, cleared=True)
        elif shown is Shown.PRESENT:
            self._broadcast.emit(self.now)

    def _require_sound(self, what: str) -> None:
        if self.failure:
            raise RuntimeError(
                f'{what}: the simulation has stopped ({self.failure}); reset it first')

    def _fresh_status(self) -> Status:
        self._errors = errors_of(self.simulation)
        status, self._lag = self.status(), 0.0
        return status

    def _end(self) -> int:
        duration = self.parameters['duration']
        return max(1, round(duration * NANOSECONDS)) if duration > 0.0 else 0

    def _follow_simulation(self) -> None:
        self.simulation.should_stop = (
            lambda: self._stopping or wall.monotonic() > self._patient_until)
        self.inputs.follow(self.simulation)

    def _stand_on_nanoseconds(self) -> None:
        """Have the simulation stand where the run does: Python may have left it in between."""
        try:
            self.simulation.advance_to(seconds(self.now))
        except SimulationError as error:
            self._fail(str(error), self.now)
        except Interrupted:
            pass

    def _catch_up(self) -> None:
        """
        Take the time that the simulation has reached by steps, or before something broke it off.
        """
        self.now = max(self.now, nanoseconds_not_before(self.simulation.time))
