# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
Runs a simulation in time: inputs at their moment, outputs on their grid, at the wanted pace.

One runner serves the node (its own thread, live topics and bag) and `icofabric run` (no graph, bag
only). It is a loop over three parts: commands from other threads (command_queue.py), what they do
to the run (run_changes.py), and the advance of simulated time (time_advance.py). Simulated time
between two calls of the simulation is always a whole number of nanoseconds, so every input acts at
a time that a bag can hold, and a run repeats to the last bit. What else is done to a run (pause,
steps, reset, another weave, ...) is published as an event, and recorded like the inputs: before
any state that it changed.
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
from icofabric_sim.running.pace import Pace
from icofabric_sim.running.received_inputs import ReceivedInputs
from icofabric_sim.running.run_changes import RunChanges
from icofabric_sim.running.run_records import begins_anew, Errors, errors_of, figures, Status
from icofabric_sim.running.run_state import RunState
from icofabric_sim.running.stall import StallWatch
from icofabric_sim.running.step_limit_reason import StepLimit
from icofabric_sim.running.time_advance import TimeAdvance
from icofabric_sim.running.time_requests import AdvanceRequest, StepRequest
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.errors import SimulationError
from icofabric_sim.simulation.precompile import counted_as_compiling
from icofabric_sim.simulation.simulation import Simulation

# Wall time between repeated live messages while the simulated time stands still [s].
_IDLE_REFRESH = 0.5
# Wall time between two looks whether what simulated time waits for is there [s].
_HELD_CHECK = 0.05
# A checkpoint, or how its path follows from the parameters in force.
Place = str | Path | Callable[[Parameters], Path]


class Runner:
    """Drives one simulation after another; all methods but `run` may be called from any thread."""

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
        Start where the simulation stands, mostly at time 0, paused where `start_paused` is set.

        `parameters` are in force where rates and the like differ from those of the scene.
        `on_rebuilt` is called after each change of the scene with the parameters that were wanted,
        and why they could not be had ('' where they could). `report` lays out /diagnostics.
        `full_name` of a topic is what warnings say.
        """
        in_force = parameters or simulation.scene.parameters
        self.state = RunState(
            simulation, in_force, nanoseconds_not_before(simulation.time),
            bool(in_force['start_paused']))
        self.commands = CommandQueue()
        self._broadcast = Broadcast(
            sinks, simulation, None if report is None else lambda: report(self._fresh_status()))
        self._broadcast.set_rates(in_force)
        self._pace = Pace(in_force['real_time_factor'])
        self.inputs = ReceivedInputs(
            self.state, self.commands.post, self._broadcast.input, full_name)
        self._time = TimeAdvance(self.state, self.inputs, self._broadcast, self._pace)
        if report is not None:
            # A live run has no progress bar that would show it.
            self._time.stall = StallWatch()
        self.changes = RunChanges(
            self.state, self._time, self.inputs, self._broadcast, self._pace,
            post=self.commands.post, fresh_status=self._fresh_status, on_rebuilt=on_rebuilt)
        self._errors: Errors | None = None
        self._step_limit, self._limited_by = StepLimit(), ''
        self._last_refresh = 0.0

    # Where it stands; each is read on its own.

    @property
    def simulation(self) -> Simulation:
        """The simulation that runs."""
        return self.state.simulation

    @property
    def parameters(self) -> Parameters:
        """The parameters in force."""
        return self.state.parameters

    @property
    def now(self) -> int:
        """Simulated time [ns]."""
        return self.state.now

    @property
    def paused(self) -> bool:
        """Whether simulated time stands still until it is resumed."""
        return self.state.paused

    @property
    def failure(self) -> str:
        """Why simulated time has stopped; '': it has not."""
        return self.state.failure

    @property
    def finished(self) -> bool:
        """Whether the `duration` of the scene has passed."""
        return self.state.finished

    @property
    def dropped(self) -> int:
        """Inputs that were received and never acted."""
        return self.inputs.dropped

    def status(self) -> Status:
        """Present figures; those of the accuracy are as at the last report."""
        state = self.state
        return Status(
            time=state.now,
            paused=state.paused,
            finished=state.finished,
            failure=state.failure,
            factor=self._pace.factor(state.now),
            wanted_factor=state.parameters['real_time_factor'],
            dropped=self.dropped,
            errors=self._errors,
            loads_waiting=len(self.inputs),
            cause=self._pace.cause(),
            limited_by=self._limited_by,
            lag=self.commands.lag,
            waits=self._time.waits(),
            **figures(state.simulation),
        )

    # Called from any thread.

    def post(self, act: Callable[[], Any]) -> 'Future[Any]':
        """Have `act` done between two steps; its result comes with the future."""
        return self.commands.post(act)

    def set_paused(self, paused: bool) -> 'Future[Any]':
        """Stop or resume simulated time; the result is the time [ns] at which that was."""
        return self.post(lambda: self.changes.pause(paused))

    def take_steps(self, request: StepRequest | None = None) -> 'Future[Any]':
        """
        Take `step_count` solver steps while paused, and publish the state they lead to.

        The result is its time [ns]; a pause, a reset or the end of `run` ends them early, with a
        RuntimeError that says how many were taken.
        """
        steps = request or StepRequest()
        self.post(lambda: self._time.begin_steps(steps))
        return steps.future

    def advance(self, request: AdvanceRequest | None = None) -> 'Future[Any]':
        """
        Advance by `advance_duration`, and publish the state it leads to; a pause goes on then.

        The result is the time [ns] that was reached. While time runs anyway, it only waits for
        it. A pause, a reset or the end of `run` ends it early, with a RuntimeError.
        """
        advance = request or AdvanceRequest()
        self.post(lambda: self._time.begin_advance(advance))
        return advance.future

    def clear_loads(self) -> 'Future[Any]':
        """
        Take off all wrenches, as zero wrenches on all of them would; results in the time [ns].

        Those that wait for their stamp are dropped.
        """
        return self.post(lambda: self.changes.clear_loads())

    def reset(self, *, time_reset: bool | None = None) -> 'Future[Any]':
        """
        Back to the initial state, and to time 0 where `reset_time` says so; results in that time.

        Wrenches that were received are forgotten, those that wait are dropped.
        """
        return self.post(lambda: self.changes.reset(time_reset))

    def save_checkpoint(self, place: Place) -> 'Future[Any]':
        """
        Save the run as it is between two steps, to go on from later; results in the path.

        The file is written beside the run. Wrenches that wait for their stamp are not in it.
        """
        saved: Future[Any] = Future()
        self.post(lambda: self.changes.save(_chooser(place), saved))
        return saved

    def restore_checkpoint(self, place: Place) -> 'Future[Any]':
        """
        Go on from a checkpoint of the same scene; results in its time [ns].

        Time jumps there: a bag ends, and the next one begins with the checkpoint. Wrenches that
        wait are dropped. Where it is not a checkpoint of this scene and version a ValueError says
        so, and nothing changes.
        """
        return self.post(lambda: self.changes.restore(_chooser(place)))

    def set_recording(self, on: bool) -> 'Future[Any]':
        """
        Begin a new bag from the present state on, or end the present one; results in its path.
        """
        return self.post(lambda: self.changes.set_recording(on))

    def set_body_state(self, body: int, parts: Mapping[str, Any]) -> 'Future[Any]':
        """Put one body elsewhere, see entities.py; results in the time [ns] at which that was."""
        return self.post(lambda: self.changes.set_body_state(body, parts))

    def solve_equilibrium(self) -> 'Future[Any]':
        """
        Bring the paused fabric to rest under what acts on it, see rest.py; results in a sentence.

        The search does not hold up the run. RuntimeError or ValueError where it moves, is changed
        meanwhile, or no equilibrium is found: then it stays as it is.
        """
        found: Future[Any] = Future()
        self.post(lambda: self.changes.rest.seek(found))
        return found

    def change(
        self, parameters: Parameters, scene: Scene | None = None,
        built: 'Future[str] | None' = None,
    ) -> 'Future[Any]':
        """
        Take other parameters; a changed fabric is built aside and swapped in between two steps.

        Where their `scene` was built already, e.g. to judge them, that one is used. Wrenches that
        act or wait go on where the new fabric has their channel or body, see reweave.py; the
        others are named in a warning and an event. `built` gets '' once they are in force, or the
        reason why they cannot be.
        """
        return self.post(lambda: self.changes.change(parameters, scene, built or Future()))

    def stop(self) -> None:
        """End `run` soon."""
        self._time.stop()
        self.commands.wake()

    # Called from the thread of `run` only.

    def run(
        self, *, until_finished: bool | None = False,
        progress: Callable[[float], None] | None = None
    ) -> None:
        """
        Advance until stopped, or until the duration has passed where `until_finished` says so.

        None: while a duration is in force, so that one which is set meanwhile ends the run too.
        `progress` hears the simulated time [s] now and then. A failure of the simulation stops
        simulated time, is kept in `failure`, and ends the run where `until_finished`.
        """
        state = self.state
        self._time.follow(state.simulation)
        self._time.prepare_contacts()
        self._time.stand_on_nanoseconds()
        self._broadcast.start(state.now, whole=begins_anew(state.simulation))
        self._pace.restart(state.now)
        try:
            while self._turn(until_finished):
                if progress is not None:
                    progress(seconds(state.now))
        finally:
            state.simulation.should_stop = None
            self._time.requests.end('the run has ended', state.now)
            self.inputs.drop_waiting('the run ended before')
            self._fresh_status()
        # What broke since the last output; others come on their grid only.
        self._broadcast.emit(state.now, [BROKEN])
        self._broadcast.report(state.now, at_once=True)

    def _turn(self, until_finished: bool | None) -> bool:
        """Do what is to be done next; False where nothing is left to do."""
        state = self.state
        # Before the commands are done: none that comes later is slept over.
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
                self.commands.wait(_HELD_CHECK)
            return True
        if isinstance(request, AdvanceRequest):
            self._time.take_advance(request)
            return True
        if request is not None:
            # Shown where they end, with an event that says so; not where a portion of them does.
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
        delay = self._pace.delay(state.now)
        if delay > 0.0:
            # Whatever arrives wakes it, and must not make simulated time run ahead.
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
        Repeat the present state now and then, for live listeners only.

        Late joiners of a paused fabric see it, and clocks that wait for a time get one; a bag need
        not know.
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
