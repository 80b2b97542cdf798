# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Simulation run at a target real-time factor, with inputs at their times and scheduled outputs.

One runner serves the node (own thread, live topics and bag) and `icofabric run` (no graph, bag
only). It is a loop over three parts: commands from other threads (command_queue.py), their effects
on the run (run_changes.py), and the advance of simulated time (time_advance.py).

Between two calls of the simulation the time is always a whole number of nanoseconds. Every input
therefore acts at a time that a ROS time stamp holds exactly, and a run is reproducible bit by bit.
Other operations on a run (pause, steps, reset, re-weave, ...) are published as events and recorded
like inputs, before any state that they changed.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from pathlib import Path
import time as wall
from typing import Any

from icofabric_sim.messages.schedule import nanoseconds_not_before, seconds
from icofabric_sim.messages.topics import BROKEN
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.running.broadcast import Broadcast, Sink
from icofabric_sim.running.command_queue import CommandQueue
from icofabric_sim.running.parameter_change import ParameterChange
from icofabric_sim.running.real_time_factor import RealTimeFactor
from icofabric_sim.running.received_inputs import ReceivedInputs
from icofabric_sim.running.run_changes import RunChanges
from icofabric_sim.running.run_records import Errors, errors_of, figures, is_initial, Status
from icofabric_sim.running.run_state import RunState
from icofabric_sim.running.stall import StallWatch
from icofabric_sim.running.step_limit_reason import StepLimit
from icofabric_sim.running.time_advance import TimeAdvance
from icofabric_sim.running.time_requests import AdvanceRequest, StepRequest
from icofabric_sim.simulation.errors import SimulationError
from icofabric_sim.simulation.precompile import counted_as_compiling
from icofabric_sim.simulation.simulation import Simulation

# Wall time between repeated live messages while simulated time stands still [s].
_IDLE_REFRESH = 0.5
# Wall time between two checks whether the kernels that simulated time waits for are ready [s].
_HELD_CHECK_S = 0.05
# Path of a checkpoint, or a function that derives it from the parameters in force.
Place = str | Path | Callable[[Parameters], Path]


class Runner:
    """Driver of a simulation, also through rebuilds; all methods except `run` are thread-safe."""

    def __init__(
        self,
        simulation: Simulation,
        sinks: list[Sink],
        *,
        parameters: Parameters | None = None,
        on_rebuilt: Callable[[Parameters, str], None] = lambda parameters, reason: None,
        report: Callable[[Status], bytes] | None = None,
        full_name: Callable[[str], str] = str,
    ) -> None:
        """
        Start at the present time of the simulation, paused if `start_paused` is set.

        `parameters` are in force if output rates etc. differ from the scene's. `on_rebuilt` is
        called after each change of the scene with the requested parameters and the reason for a
        failure ('' for success). `report` formats /diagnostics. `full_name` returns topic names
        for warnings.
        """
        in_force = parameters or simulation.scene.parameters
        self.state = RunState(
            simulation, in_force, nanoseconds_not_before(simulation.time),
            bool(in_force['start_paused']))
        self.commands = CommandQueue()
        self._broadcast = Broadcast(
            sinks, simulation, None if report is None else lambda: report(self._fresh_status()))
        self._broadcast.set_rates(in_force)
        self._real_time = RealTimeFactor(in_force['real_time_factor'])
        self.inputs = ReceivedInputs(
            self.state, self.commands.post, self._broadcast.input, full_name)
        self._time = TimeAdvance(self.state, self.inputs, self._broadcast, self._real_time)
        if report is not None:
            # A live run has no progress bar to show it.
            self._time.stall = StallWatch()
        self.changes = RunChanges(
            self.state, self._time, self.inputs, self._broadcast, self._real_time,
            post=self.commands.post, fresh_status=self._fresh_status, on_rebuilt=on_rebuilt)
        self._errors: Errors | None = None
        self._step_limit, self._limited_by = StepLimit(), ''
        self._last_refresh = 0.0

    # Present state; each value is read separately.

    @property
    def simulation(self) -> Simulation:
        """Return the running simulation."""
        return self.state.simulation

    @property
    def parameters(self) -> Parameters:
        """Return the parameters in force."""
        return self.state.parameters

    @property
    def now(self) -> int:
        """Return the simulated time [ns]."""
        return self.state.now

    @property
    def paused(self) -> bool:
        """Return whether simulated time is paused."""
        return self.state.paused

    @property
    def failure(self) -> str:
        """Return why simulated time has stopped, or ''."""
        return self.state.failure

    @property
    def finished(self) -> bool:
        """Return whether the `duration` of the scene has passed."""
        return self.state.finished

    @property
    def dropped(self) -> int:
        """Return the number of received inputs that never acted."""
        return self.inputs.dropped

    def status(self) -> Status:
        """Return the present status; accuracy values are from the last report."""
        state = self.state
        return Status(
            time=state.now,
            paused=state.paused,
            finished=state.finished,
            failure=state.failure,
            factor=self._real_time.measure(state.now),
            target_factor=state.parameters['real_time_factor'],
            dropped=self.dropped,
            errors=self._errors,
            loads_waiting=len(self.inputs),
            cause=self._real_time.describe_time_use(),
            limited_by=self._limited_by,
            lag=self.commands.lag,
            waits=self._time.waits(),
            **figures(state.simulation),
        )

    # Thread-safe methods.

    def post(self, act: Callable[[], Any]) -> 'Future[Any]':
        """Execute `act` between two steps; return the future of its result."""
        return self.commands.post(act)

    def set_paused(self, paused: bool) -> 'Future[Any]':
        """Stop or resume simulated time; the result is the time [ns] of the change."""
        return self.post(lambda: self.changes.pause(paused))

    def take_steps(self, request: StepRequest | None = None) -> 'Future[Any]':
        """
        Take `step_count` solver steps while paused, and publish the resulting state.

        The result is its time [ns]. A pause, a reset or the end of `run` ends the steps early,
        with a RuntimeError that gives their number.
        """
        steps = request or StepRequest()
        self.post(lambda: self._time.begin_steps(steps))
        return steps.future

    def advance(self, request: AdvanceRequest | None = None) -> 'Future[Any]':
        """
        Advance by `advance_duration`, and publish the resulting state; a paused run pauses again.

        The result is the time [ns] reached. While time runs, the call only waits for that time. A
        pause, a reset or the end of `run` ends it early, with a RuntimeError.
        """
        advance = request or AdvanceRequest()
        self.post(lambda: self._time.begin_advance(advance))
        return advance.future

    def clear_loads(self) -> 'Future[Any]':
        """
        Clear all wrenches, like zero wrenches on all targets; the result is the time [ns].

        Wrenches that wait for their stamps are dropped.
        """
        return self.post(lambda: self.changes.clear_loads())

    def reset(self, *, time_reset: bool | None = None) -> 'Future[Any]':
        """
        Reset to the initial state, and to time 0 with `reset_time`; the result is the time [ns].

        Received wrenches are forgotten, waiting ones are dropped.
        """
        return self.post(lambda: self.changes.reset(time_reset))

    def save_checkpoint(self, place: Place) -> 'Future[Any]':
        """
        Save the state of the run between two steps for a later restore; the result is the path.

        The file is written in another thread. Wrenches that wait for their stamps are not
        included.
        """
        saved: Future[Any] = Future()
        self.post(lambda: self.changes.save(_chooser(place), saved))
        return saved

    def restore_checkpoint(self, place: Place) -> 'Future[Any]':
        """
        Continue from a checkpoint of the same scene; the result is its time [ns].

        Time jumps: the bag ends, and the next one starts with the checkpoint. Waiting wrenches are
        dropped. A checkpoint of another scene or version raises ValueError and changes nothing.
        """
        return self.post(lambda: self.changes.restore(_chooser(place)))

    def set_recording(self, on: bool) -> 'Future[Any]':
        """
        Start a bag from the present state on, or close the present one; the result is a sentence.
        """
        return self.post(lambda: self.changes.set_recording(on))

    def set_body_state(self, body: int, parts: Mapping[str, Any]) -> 'Future[Any]':
        """
        Set the state of one body, see entities.py; the result is the time [ns] of the change.
        """
        return self.post(lambda: self.changes.set_body_state(body, parts))

    def solve_equilibrium(self) -> 'Future[Any]':
        """
        Set the paused fabric to its equilibrium (equilibrium_solve.py); the result is a sentence.

        The solve does not block the run. Raises RuntimeError or ValueError if the fabric is
        moving, changes meanwhile, or has no equilibrium; then the state is unchanged.
        """
        found: Future[Any] = Future()
        self.post(lambda: self.changes.equilibrium.start(found))
        return found

    def change(self, parameters: Parameters) -> 'Future[Any]':
        """Set other parameters, see `apply_change`."""
        return self.apply_change(ParameterChange(self.parameters, parameters))

    def apply_change(self, change: ParameterChange) -> 'Future[Any]':
        """
        Apply a change; a changed fabric is built in another thread and swapped in.

        Active or waiting wrenches continue if the new fabric has their channel or body, see
        reweave.py; the others are listed in a warning and an event.
        """
        return self.post(lambda: self.changes.change(change))

    def stop(self) -> None:
        """End `run` soon."""
        self._time.stop()
        self.commands.wake()

    # Methods for the thread of `run`.

    def run(
        self, *, until_finished: bool | None = False,
        progress: Callable[[float], None] | None = None
    ) -> None:
        """
        Advance until stopped or, with `until_finished`, until the duration has passed.

        None: like True while a `duration` is set, also one set later. `progress`
        receives the simulated time [s] from time to time. A failure of the simulation stops
        simulated time, is stored in `failure`, and ends the run with `until_finished`.
        """
        state = self.state
        self._time.follow(state.simulation)
        self._time.prepare_contacts()
        self._time.stand_on_nanoseconds()
        self._broadcast.start(state.now, whole=is_initial(state.simulation))
        self._real_time.restart(state.now)
        try:
            while self._turn(until_finished):
                if progress is not None:
                    progress(seconds(state.now))
        finally:
            state.simulation.should_stop = None
            self._time.requests.end('the run has ended', state.now)
            self.inputs.drop_waiting('the run ended before their stamps')
            self._fresh_status()
        # Breakages since the last output; others are sent with the outputs.
        self._broadcast.emit(state.now, [BROKEN])
        self._broadcast.report(state.now, at_once=True)

    def _turn(self, until_finished: bool | None) -> bool:
        """Perform the next action; return False after the last one."""
        state = self.state
        # Before the commands are executed, so that later ones wake the run.
        self.commands.begin_turn()
        if self._time.stopping:
            return False
        self._do_commands()
        self.inputs.end_silent_pulls()
        self._broadcast.report(state.now)
        request = self._time.requests.current
        moves = request is not None or not (state.paused or state.failure or state.finished)
        if self._time.is_held() and (moves or self._broadcast.owes):
            self._refresh()
            with counted_as_compiling():
                self.commands.wait(_HELD_CHECK_S)
            return True
        if isinstance(request, AdvanceRequest):
            self._time.take_advance(request)
            return True
        if request is not None:
            # Shown at their end, with an event; not after each portion.
            self._time.take_steps(request)
            return True
        if state.paused or state.failure or state.finished:
            ends = state.end > 0 if until_finished is None else until_finished
            if ends and (state.failure or state.finished):
                return False
            self._time.end_with_the_run()
            self._refresh()
            self.commands.wait(_IDLE_REFRESH)
            return True
        delay = self._real_time.wait_time(state.now)
        if delay > 0.0:
            # Any command ends the wait; simulated time must not run ahead then.
            self.commands.wait(min(delay, _IDLE_REFRESH))
        else:
            self._time.advance()
        return True

    def _do_commands(self) -> None:
        def failed(error: SimulationError) -> None:
            self._time.fail(str(error), self.state.now)

        self.commands.do_all(failed, self.state.catch_up)

    def _refresh(self) -> None:
        """
        Repeat the present state from time to time for live subscribers.

        Late subscribers of a paused fabric receive it, and nodes that wait for a clock get one. A
        bag does not need it.
        """
        if wall.monotonic() - self._last_refresh > _IDLE_REFRESH:
            self._last_refresh = wall.monotonic()
            self._broadcast.repeat(self.state.now)

    def _fresh_status(self) -> Status:
        self._errors = errors_of(self.state.simulation)
        if not self.state.failure:
            self._limited_by = self._step_limit.describe(
                self.state.simulation, self.state.now, with_place=self._broadcast.reports_to_any)
        status, self.commands.lag = self.status(), 0.0
        return status


def _chooser(place: Place) -> Callable[[Parameters], Path]:
    return place if callable(place) else lambda parameters: Path(place)
