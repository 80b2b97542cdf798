# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Runs a simulation in time: inputs at their moment, outputs on their grid, at the wanted pace.

One runner serves the node (its own thread, live topics and bag) and `icofabric run` (no graph, bag
only). Simulated time between two calls of the simulation is always a whole number of nanoseconds,
so every input acts at a time that a bag can hold, and a run repeats to the last bit. What else is
done to a run (pause, steps, reset, another weave, ...) is told as an event, and recorded like the
inputs: before any state that it changed.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from pathlib import Path
import time as wall
from typing import Any

from icofabric_sim.messages.schedule import seconds
from icofabric_sim.messages.topics import BROKEN
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.running.broadcast import Sink
from icofabric_sim.running.run_changes import ChangingRun
from icofabric_sim.running.run_records import begins_anew, Status
from icofabric_sim.running.step_requests import StepRequest
from icofabric_sim.simulation.simulation import Simulation

# Wall time between repeated live messages while the simulated time stands still [s].
_IDLE_REFRESH = 0.5


class Runner(ChangingRun):
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
        Start where the simulation stands, mostly at time 0, paused where the scene says so.

        `parameters` are in force where rates and the like differ from those of the scene.
        `on_rebuilt` hears of each change of the scene: the parameters that were wanted, and why
        they could not be had ('' where they could). `report` lays out /diagnostics. `full_name`
        of a topic is what warnings say.
        """
        super().__init__(simulation, sinks, parameters, report, full_name, on_rebuilt)
        self._last_refresh = 0.0

    # Called from any thread.

    def set_paused(self, paused: bool) -> 'Future[Any]':
        """Stop or resume simulated time; the result is the time [ns] at which that was."""

        def act() -> int:
            self._steps.end('ended by a pause' if paused else 'time runs on')
            self.paused = paused
            self._broadcast.event(self.now, 'pause' if paused else 'resume')
            self._pace.restart(self.now)
            return self.now

        return self.post(act)

    def take_steps(self, request: StepRequest | None = None) -> 'Future[Any]':
        """
        Take `step_count` solver steps while paused, and publish the state they lead to.

        The result is its time [ns]; a pause, a reset or the end of `run` ends them early, with a
        RuntimeError that says how many were taken.
        """
        request = request or StepRequest(self.parameters['step_count'])
        self.post(lambda: self._begin_steps(request))
        return request.future

    def reset(self, *, time_reset: bool | None = None) -> 'Future[Any]':
        """
        Back to the initial state, and to time 0 where `reset_time` says so; results in that time.

        Wrenches that were received are forgotten, those that wait are dropped.
        """
        return self.post(lambda: self._reset(time_reset))

    def save_checkpoint(self, path: str | Path) -> 'Future[Any]':
        """
        Save the run as it is between two steps, to go on from later; results in the path.

        The file is written beside the run. Wrenches that wait for their stamp are not in it.
        """
        saved: Future[Any] = Future()
        self.post(lambda: self._save(Path(path), saved))
        return saved

    def restore_checkpoint(self, path: str | Path) -> 'Future[Any]':
        """
        Go on from a checkpoint of the same scene; results in its time [ns].

        Time jumps there: a bag ends, and the next one begins with the checkpoint. Wrenches that
        wait are dropped. Where it is not a checkpoint of this scene and version a ValueError says
        so, and nothing changes.
        """
        return self.post(lambda: self._restore(Path(path)))

    def set_recording(self, on: bool) -> 'Future[Any]':
        """
        Begin a new bag from the present state on, or end the present one; results in its path.
        """
        return self.post(lambda: self._set_recording(on))

    def set_body_state(self, body: int, parts: Mapping[str, Any]) -> 'Future[Any]':
        """Put one body elsewhere, see entities.py; results in the time [ns] at which that was."""
        return self.post(lambda: self._set_body_state(body, parts))

    def change(self, parameters: Parameters) -> 'Future[Any]':
        """
        Take other parameters; a changed fabric is built aside and swapped in between two steps.

        Wrenches that act or wait go on where the new fabric has their channel or body, see
        reweave.py; the others are named in a warning and an event.
        """
        return self.post(lambda: self._change(parameters))

    def stop(self) -> None:
        """End `run` soon."""
        self._stopping = True
        self._wake.set()

    # Called from the thread of `run` only.

    def run(
        self, *, until_finished: bool = False, progress: Callable[[float], None] | None = None
    ) -> None:
        """
        Advance until stopped, or until the duration has passed where `until_finished` says so.

        `progress` hears the simulated time [s] now and then. A failure of the simulation stops
        simulated time, is kept in `failure`, and ends the run where `until_finished`.
        """
        self._follow_simulation()
        self._stand_on_nanoseconds()
        self._broadcast.start(self.now, whole=begins_anew(self.simulation))
        self._pace.restart(self.now)
        try:
            while self._turn(until_finished):
                if progress is not None:
                    progress(seconds(self.now))
        finally:
            self.simulation.should_stop = None
            self._steps.end('the run has ended')
            self.inputs.drop_waiting('the run ended before')
            self._fresh_status()
        # What broke since the last output; others come on their grid only.
        self._broadcast.emit(self.now, [BROKEN])
        self._broadcast.report(self.now, at_once=True)

    def _turn(self, until_finished: bool) -> bool:
        """Do what is to be done next; False when that is nothing ever more."""
        # Before looking at what it announces: nothing that comes later is slept over.
        self._wake.clear()
        if self._stopping:
            return False
        self._run_commands()
        self._broadcast.report(self.now)
        if self._steps.current is not None:
            # Shown where they end, with an event that says so; not where a portion of them does.
            self._take_steps(self._steps.current)
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

    def _refresh(self) -> None:
        """
        Repeat the present state now and then, for live listeners only.

        Late joiners of a paused fabric see it, and clocks that wait for a time get one; a bag need
        not know.
        """
        if wall.monotonic() - self._last_refresh > _IDLE_REFRESH:
            self._last_refresh = wall.monotonic()
            self._broadcast.emit(self.now, live_only=True)
