# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Steps that the kernel accepts or rejects by their error estimate, each of its own length.

Steps are one ahead of the requested time. A state in between comes from the dense output of the
step in progress, so outputs do not change the sequence. An input discards that step and takes one
to its own time instead. An event (`events/`) does the same: the event is located in the dense
output, a step ends there, and the event happens when the next step starts. Findings of a health
check at the end of the step in progress wait until the run reaches that end. So neither outputs
nor the intervals of requests change the sequence.
"""

import math
from typing import Any

from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.integrators import embedded
from icofabric_sim.kernels.integrators.splitting import NEVER
from icofabric_sim.kernels.records import Model, State, Team
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.inputs.inputs import CHANGE_GAP_RATIO, Inputs
from icofabric_sim.simulation.stepping.events import make_events
from icofabric_sim.simulation.stepping.faults import too_fast
from icofabric_sim.simulation.stepping.pieces import EventLocator, Pieces, Stepping
from icofabric_sim.simulation.stepping.step_in_progress import StepInProgress
from icofabric_sim.simulation.stepping.step_samples import needs_samples, StepSamples
from icofabric_sim.simulation.stepping.uniform_stepping import UniformStepping
import numpy as np

# Statuses that end a run, or warn: those of a step in progress wait until its end is reached.
_JUDGED = monitor.UNSOUND | monitor.OBSTRUCTING | monitor.TOO_DEEP | monitor.DEEP
# Numbers of the ledger that keep what a health check found, though its step is given up.
_LASTING = [
    monitor.SCALE, monitor.WORST, monitor.ERROR, monitor.NOISE, monitor.DEEPEST_EVER]
# Part of a displacement that a search reaches after a step led too far.
_FARTHER = 1.5


class EmbeddedStepping(Stepping):
    """Stepping one step ahead, with steps that end at events."""

    def __init__(self, pieces: Pieces, given: float) -> None:
        """Advance the trajectory of these `pieces`; `given` is `solver.step` [s], 0: none."""
        assert pieces.trajectory.method.embedded is not None
        self._kernels = pieces.trajectory.method.embedded
        self._pieces, self._given = pieces, given
        self._step = StepInProgress(pieces.trajectory, pieces.contact, pieces.trials)
        self._samples = StepSamples(
            pieces, active=pieces.errors.is_estimated and needs_samples(pieces))
        # Takes the step that ends at an input.
        self._uniform = UniformStepping(pieces)
        self._events: list[EventLocator] = make_events(pieces, self._step)
        # What waits: also whether a given step is too long.
        self._judged = ~0 if given > 0.0 else _JUDGED
        self._due = 0  # status that waits
        # The ledger before the last call of kernels; None: no drive can lead beyond its path.
        self._before: np.ndarray | None = None

    @property
    def next_step_time(self) -> float:
        """Time [s] at which the step in progress ends."""
        step, trajectory = self._step, self._pieces.trajectory
        return step.end if step.length > 0.0 else trajectory.time + trajectory.step

    def restart(self) -> None:
        """Restart after a jump of the state; the sum of errors continues."""
        control, origin = self._step.control, self._pieces.trajectory.origin
        total = self.error_estimate(origin)
        control.numbers[:] = 0.0
        control.start = origin
        self._samples.settle(total, origin)
        self._samples.restart()
        self._step.change()
        self._forget_events()

    def settle(self, total: float) -> None:
        """
        Set the `total` of errors at the start of the step in progress, which does not exist yet.
        """
        self._samples.settle(total, self._pieces.trajectory.origin)

    def adopt(self, other: Stepping) -> None:
        """Adopt the errors of the steps of `other` as a first estimate of this motion."""
        if isinstance(other, EmbeddedStepping):
            self._samples.adopt(other._samples)

    def forget(self) -> None:
        """Reset the sum of errors, also of the step in progress."""
        self._step.control.rate = 0.0
        self._samples.settle(0.0, self._step.end)
        # What was measured would be taken off for the part of that step which was not seen.
        self._samples.restart()

    def rebase(self, time: float) -> None:
        """Move an unstarted motion to another `time` [s]."""
        self._step.control.start = time
        self._samples.settle(self._step.control.total, time)

    def count_until(self, time: float) -> int:
        """
        Return 0 if a step ends after `time` [s], or if the state is set for that time.

        So a state shown at a time does not start a step that an input at this time would change.
        """
        end = self._step.end
        return NEVER if end < time or (end == time and self._step.length > 0.0) else 0

    def run(self, time: float, count: int) -> None:
        """Take up to `count` steps in one call, until one ends after `time` [s]."""
        # Not beyond a health check, which saves the state: its time is that of the call's end.
        pieces = self._pieces
        due = pieces.monitor.interval - pieces.monitor.since_check
        self._take(time, min(count, due, pieces.calls.portions.count))

    def run_steps(self, count: int, until: float) -> int:
        """Complete the step in progress if it ends by `until` [s]; return the number of steps."""
        if self._step.length == 0.0:
            self._take(self._step.end, 1)
        if self._step.end > until:
            return 0
        self._take(self._step.end, 1)
        return 1

    def cut(self, time: float) -> bool:
        """End a step at `time` [s], where the next one starts; always True."""
        control = self._step.control
        rest = time - control.start
        # The part of the step in progress up to there stays counted.
        estimate = self.error_estimate(time)
        self._give_up()
        self._samples.settle(estimate, time)
        if rest > 0.0:
            self._uniform.take(rest, 1)
        control.start = time
        return True

    def state_at(self, time: float) -> State:
        """Return the state at a `time` [s] within the step in progress, by dense output."""
        step, trajectory, length = self._step, self._pieces.trajectory, self._step.length
        rest = time - trajectory.time
        if trajectory.failure is None and rest > 0.0 and length > 0.0:
            step.prepare_dense()
        work = trajectory.work
        state = step.state_within(rest)
        self._pieces.shown.note(
            state, trajectory.time + min(max(rest, 0.0), length), step.stretches_within(rest),
            work=step.work_within(rest), spent=step.flow_within(work.spent, rest),
            given=step.flow_within(work.given, rest))
        return state

    def follow_loads(self) -> None:
        """Start the next step with other loads."""
        self._pieces.controller.follow_jump()

    def error_rate(self) -> float:
        """Error per second of the last step."""
        return self._samples.rate

    def error_estimate(self, time: float) -> float:
        """
        Return the errors of all steps up to a present `time` [s], without amplification or decay.
        """
        control = self._step.control
        left = min(max(self._step.end - time, 0.0), control.length)
        return self._samples.estimate(left)

    def is_ready(self, *, touching: bool) -> bool:
        """Return True if the kernels of all steps are compiled, with contacts if `touching`."""
        return self._uniform.is_ready(touching=touching) and self._pieces.calls.is_ready(
            (self._kernels.take, self._arguments), touching=touching)

    def _arguments(self, model: Model, team: Team) -> tuple[Any, ...]:
        pieces, trajectory = self._pieces, self._pieces.trajectory
        return (
            model, trajectory.loads, trajectory.state, trajectory.saved, trajectory.work, team,
            self._step.control.numbers, 1, 0, pieces.monitor.interval,
            pieces.contact.phase.watch, trajectory.ledger.numbers)

    def state_tree(self, tree: dict[str, Any]) -> None:
        """Add the step in progress and the events at its end."""
        self._step.state_tree(tree)
        self._samples.state_tree(tree)
        if self._due:
            tree['due_status'] = self._due
        if self._before is not None:
            tree['ledger_before'] = self._before
        for event in self._events:
            tree.update(event.state_tree())

    def load_time(self, tree: StateTree) -> None:
        """Restore the time from a checkpoint."""
        self._step.load_control(tree)

    def load_state(self, tree: StateTree) -> None:
        """Restore the step in progress from a checkpoint."""
        self._step.load_state(tree)
        self._samples.load_state(tree)
        self._due = tree.count('due_status', 0, 2**31) if 'due_status' in tree else 0
        self._before = None
        if 'ledger_before' in tree:
            self._before = tree.array('ledger_before', (len(_LASTING),)).copy()
        for event in self._events:
            event.load_state(tree)

    def _take(self, goal: float, count: int) -> None:
        """Take up to `count` steps until one ends after `goal` [s] or an event ends one."""
        due, self._due = self._due, 0
        if due:
            self._pieces.respond(due, self._step.end)
        if any(event.is_due for event in self._events):
            self._happen()
        # A step of which each has to be searched is taken alone.
        alone = any(not event.status for event in self._events)
        status = self._take_steps(goal, 1 if alone else max(count, 1))
        suspects = [
            event for event in self._events if not event.status or status & event.status]
        if suspects and self._step.length > 0.0:
            self._end_at_first(suspects)
            # A health check that was due at the end of a step that was given up is made at the
            # next.
            checks = self._pieces.monitor
            checks.since_check = min(checks.since_check, checks.interval - 1)
        if self._given > 0.0:
            self._pieces.trajectory.step = self._given

    def _take_steps(self, goal: float, count: int) -> int:
        """Take up to `count` steps until one ends after `goal` [s]; return the last status."""
        pieces, trajectory, control = self._pieces, self._pieces.trajectory, self._step.control
        again = embedded.TOO_FAR | embedded.LIST_FULL
        status, control.goal = again, goal
        self._step.change()
        while status & again and count > 0:
            before = int(control.length > 0.0)
            trajectory.ledger.saved_at = -1.0
            if trajectory.changing is None or self._given > 0.0:
                status, done = self._call(self._samples.allowed(count))
            else:
                status, done = self._take_up_to_change(trajectory.changing)
            count -= done
            trajectory.require_body_force()
            self._samples.note(done, sound=not status & (monitor.UNSOUND | embedded.TOO_SHORT))
            # The step in progress does not count yet.
            trajectory.step_count += done + before - int(control.length > 0.0)
            trajectory.step = control.length or trajectory.step
            end = self._step.end
            if trajectory.ledger.saved_at == done:
                trajectory.note_saved(end)
            if status & embedded.LIST_FULL:
                pieces.contact.phase.make_room(trajectory.state)
            if status & embedded.TOO_FAR and pieces.contact.phase.is_possible:
                # Before a state is asked for: that of dense output is gone.
                rate = pieces.contact.phase.rate
                found = pieces.contact.search_farther(
                    end, *pieces.controller.outlook(), factor=_FARTHER)
                pieces.contact.pace(trajectory.step, alone=True)
                if pieces.contact.phase.rate != rate:
                    pieces.controller.follow_contacts()
                if not found:
                    # So fast that there was no search: the same step would be asked for for ever.
                    trajectory.fail(too_fast(end, pieces.rates.fastest_term()))
        if status & embedded.TOO_SHORT:
            own = trajectory.packed.body_force
            jump = '' if own is None else f', or make jumps of {own.label} in time continuous'
            trajectory.fail(
                f'no step from t = {self._step.end:.9g} s on is short enough for solver.tolerance '
                f'{pieces.errors.probe.tolerance:g}: steps of {control.shortest:.3g} s still '
                f'err too much, and the fastest motion is that of {pieces.rates.fastest_term()}; '
                f'allow a larger tolerance, or slow that down{jump}')
        if self._step.end > goal:
            # Beyond what was asked for: an input may come before.
            self._due = status & self._judged & ~again
        if status & ~(again | self._due):
            pieces.respond(status & ~self._due, self._step.end)
        return status

    def _take_up_to_change(self, inputs: Inputs) -> tuple[int, int]:
        """
        Take a step that ends no later than just before an expression changes.

        Across a change, a step that is hardly longer than the shortest is accepted with any error.
        """
        control, end, change = self._step.control, self._step.end, inputs.next_expression_change
        following, tolerance, longest = control.next, control.tolerance, control.longest
        if change < math.inf:
            gap = CHANGE_GAP_RATIO * change
            rest = change - 2.0 * gap - end
            # No tolerance is met by the last steps before a corner of a square root.
            if rest > 10.0 * control.shortest:
                control.longest = min(longest, rest)
            else:
                control.longest, control.tolerance = max(change - end, 0.0) + gap, embedded.ANY
        control.longest = min(control.longest, inputs.expression_step)
        control.next = limited = min(following, control.longest)
        found = self._call(1)
        if control.length == limited < following:
            control.next = following
        control.tolerance, control.longest = tolerance, longest
        return found

    def _call(self, count: int) -> tuple[int, int]:
        """Let kernels take up to `count` steps; return the status and the number of steps."""
        pieces, trajectory, checks = self._pieces, self._pieces.trajectory, self._pieces.monitor
        watch, control = pieces.contact.phase.watch, self._step.control
        # Do not read trajectory.loads: that gathers the whole state from ranks or a GPU.
        loads, *_ = trajectory.for_steps()
        self._before = None if loads.drives is None else trajectory.ledger.numbers[_LASTING]
        with trajectory.or_lost():
            status, done, checks.since_check = pieces.calls.timed(
                lambda team: self._kernels.take(
                    trajectory.model, *trajectory.for_steps(), team, control.numbers, count,
                    checks.since_check, checks.interval, watch, trajectory.ledger.numbers))
        trajectory.evaluations.add(pieces.calls.count_embedded(control))
        if done and checks.since_check == 0:
            checks.interval = checks.interval_with(control.next)
        return int(status), int(done)

    def _end_at_first(self, suspects: list[EventLocator]) -> None:
        """Find the first events in the step in progress, if any, and end the step there."""
        found = [(part, event) for event in suspects if (part := event.find()) is not None]
        if not found:
            return
        part = min(part for part, _ in found)
        first = [event for each, event in found if each == part]
        control, following = self._step.control, self._step.control.next
        rest = control.length * part
        if not control.start + rest > control.start:
            # Already where the step begins.
            self._give_up()
        elif part < 1.0:
            self._give_up()
            control.next = rest
            self._take_steps(control.start, 1)
            control.next = following
            if control.length != rest:
                # Refused, and a shorter one taken: it happens in a later step.
                return
        for event in first:
            event.is_due = True
        if not control.length > 0.0:
            self._happen()

    def _happen(self) -> None:
        """Apply the due events to the present state, from which the next step starts."""
        for event in self._events:
            if event.is_due:
                event.happen()
        self._forget_events()
        self._pieces.controller.follow_jump()
        # There is no way back to before it.
        self._pieces.trajectory.save(self._step.end)

    def _give_up(self) -> None:
        """Return to the start of the step in progress."""
        self._samples.give_up()
        if self._before is not None and self._step.length > 0.0:
            self._pieces.trajectory.ledger.numbers[_LASTING] = self._before
        self._step.give_up()
        self._forget_events()

    def _forget_events(self) -> None:
        self._due = 0
        for event in self._events:
            event.is_due = False
