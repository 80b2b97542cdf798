# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Steps of equal length, many in a kernel call.

Steps end at origin + k h, and only inputs shorten a step. A trial step gives a state between two
step ends, so outputs never change the sequence.

The outcome of a batch, the steps of one kernel call, is one of four:

    ACCEPTED  kernels save the state at health checks; errors are measured, and the step adapts
    PASSED    shells may have passed through each other: search with larger speeds
    SWUNG     contacts exchanged too much energy in a step: halve the step for contacts
    ROUGH     the motion became rougher, and the error exceeds the tolerance: measure the error

After all but the first, the run returns to the saved state, reacts, and takes the steps again.
"""

from enum import Enum
import math
from typing import NamedTuple

from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.records import State
from icofabric_sim.simulation.stepping.faults import too_fast
from icofabric_sim.simulation.stepping.pieces import Pieces, Stepping
from icofabric_sim.simulation.stepping.shown_energies import work_of
from icofabric_sim.terms.contacts.rebuild_check import MISSED
from icofabric_sim.terms.meters import flowed
import numpy as np

# Doubles cannot count more steps.
_MAX_STEP_COUNT = 2.0**53
# Ends of steps are rounded: 700 steps of 1e-3 s end one bit after 0.7 s.
_MAX_ROUNDING_ULP = 2.0


class Outcome(Enum):
    """Outcome of a batch; see the module."""

    ACCEPTED, PASSED, SWUNG, ROUGH = range(4)


class Batch(NamedTuple):
    """Steps of one kernel call."""

    step: float  # [s]
    step_before: float  # [s] of the trajectory; a batch with another step ends at an input
    is_far: bool  # bodies may leave the region of the neighbour list in a given step
    done: int
    status: int
    time: float  # [s] at the end
    saved_time: float | None  # [s] of the state that kernels saved, if any


def latest_end(time: float) -> float:
    """Return the latest end [s] of a step that counts as ended by `time` [s]."""
    return time + _MAX_ROUNDING_ULP * math.ulp(time)


class UniformStepping(Stepping):
    """Steps of the trajectory's length, until the controller proposes another."""

    def __init__(self, pieces: Pieces) -> None:
        """Advance the trajectory of these `pieces`."""
        self._pieces = pieces
        self._outcome = Outcome.ACCEPTED  # of the last batch
        # Latest time [s] from which the run returned to the saved state in `run_steps`.
        self._left_at = -math.inf

    @property
    def next_step_time(self) -> float:
        """Time [s] at which the step in progress ends."""
        return self._pieces.trajectory.time + self._pieces.trajectory.step

    def settle(self, total: float) -> None:
        """Set the `total` of errors at the present time."""
        self._pieces.errors.settle(total)

    def count_until(self, time: float) -> int:
        """Count the whole steps that end by `time` [s]."""
        trajectory = self._pieces.trajectory
        origin, step = trajectory.origin, trajectory.step
        count = (time - origin) / step
        if not count < _MAX_STEP_COUNT:
            reason = '' if self._pieces.trajectory.is_given else (
                f'; {too_fast(trajectory.time, self._pieces.rates.fastest_term())}')
            trajectory.fail(
                f'steps of {step:.6g} s never come to t = {time:.9g} s: that would take '
                f'{count:.3g} of them{reason}')
        last, end = int(count), latest_end(time)
        while origin + (last + 1) * step <= end:
            last += 1
        while last > 0 and origin + last * step > end:
            last -= 1
        return last - trajectory.index

    def run(self, time: float, count: int) -> None:
        """Take up to `count` steps in one call."""
        self._run(count)

    def _run(self, count: int) -> int:
        pieces = self._pieces
        # Up to the next health check, or to that at which the controller measures again.
        due = max(pieces.errors.probe.checks_left, 1) * pieces.monitor.interval - (
            pieces.monitor.since_check)
        return self.take(pieces.trajectory.step, min(count, due, pieces.calls.portions.count))

    def run_steps(self, count: int, until: float) -> int:
        """
        Take up to `count` steps that end by `until` [s], in one call; return their number.

        After a return to the saved state, steps are taken up to the time of that return. So a
        state never depends on later steps, nor on the calls that requested them.
        """
        if until < math.inf:
            count = min(count, self.count_until(until))
        if not count > 0:
            return 0
        self._left_at = -math.inf
        done = self._run(count)
        while self._pieces.trajectory.time < self._left_at and (
                until == math.inf or self.count_until(until) > 0) and (more := self._run(1)):
            done += more
        return done

    def cut(self, time: float) -> bool:
        """
        Take a shorter step to `time` [s]; the next one starts there.

        Return False if the run returned to the saved state instead.
        """
        trajectory = self._pieces.trajectory
        rest = time - trajectory.time
        self._outcome = Outcome.ACCEPTED
        try:
            if rest > 0.0:
                self.take(rest, 1)
        finally:
            if trajectory.failure is None and self._outcome is Outcome.ACCEPTED:
                trajectory.begin_at(time)
        if self._outcome is not Outcome.ACCEPTED:
            return False
        self._save_where_judged()
        return True

    def check_within(self, time: float) -> bool:
        """
        Return False if shells may have passed through each other by `time` [s], within a step.

        The check is that of step ends: a run with a given step stops, and chosen steps have to be
        taken again by `go_back`.
        """
        pieces, trajectory = self._pieces, self._pieces.trajectory
        if not self._is_judged:
            return True
        rest = time - trajectory.time
        state = pieces.trials.take(rest, 1) if rest > 0.0 else trajectory.state
        if trajectory.take_force_failure() is not None:
            # No state could be computed, and the run may never reach this time.
            return True
        if rest > 0.0 and self._is_far(rest):
            pieces.contact.refuse_passing(trajectory.state, state, trajectory.time, time)
        elif pieces.contact.phase.has_left(state, time):
            # All of a chosen step, as the run must not depend on requested states.
            return self._judge_steps(
                trajectory.step if rest > 0.0 and not trajectory.is_given else rest)
        return True

    def go_back(self) -> None:
        """
        Continue to the next check of displacements, and return to the saved state from there.

        A run without requested states returns at the same check, so the results are the same.
        """
        pieces = self._pieces
        since, stride = pieces.monitor.since_check, pieces.contact.phase.stride
        self.take(pieces.trajectory.step, min(
            pieces.monitor.interval - since, stride - since % stride))
        if self._outcome is Outcome.ACCEPTED:
            # Bodies were far away in between only.
            self._retreat(Outcome.PASSED)

    def _retreat(self, outcome: Outcome) -> None:
        """Return to the saved state after an `outcome`, and choose the next step."""
        pieces, trajectory, errors = self._pieces, self._pieces.trajectory, self._pieces.errors
        step, excess = trajectory.step, 1.0
        if outcome is Outcome.ROUGH:
            excess = pieces.controller.excess() or 1.0
            errors.probe.take_back(pieces.monitor.interval)
        # Errors up to here stay counted, as states up to here may have been output.
        errors.probe.close(trajectory.time)
        self._outcome, self._left_at = outcome, max(self._left_at, trajectory.time)
        trajectory.return_to_saved()
        trajectory.return_work()
        trajectory.ledger.regular = 0.0
        errors.begin(trajectory.saved_time)
        pieces.monitor.since_check = 0
        if outcome is Outcome.PASSED:
            pieces.contact.phase.be_wary(
                step, trajectory.saved_time + pieces.monitor.interval * step)
        elif outcome is Outcome.SWUNG:
            pieces.controller.follow_swing()
        else:
            errors.returned_to = trajectory.saved_time
        if outcome is not Outcome.ROUGH:
            self._search(trajectory.saved_time)
        pieces.choose_step(probe=outcome is not Outcome.SWUNG, shorter=excess)

    def _search(self, time: float) -> None:
        """Find the candidate pairs of the present state, at `time` [s]."""
        self._pieces.contact.search(time, *self._pieces.controller.outlook())
        # Kernels may have noted some relative to the search before.
        self._pieces.contact.phase.forget_displacements()

    @property
    def _is_judged(self) -> bool:
        """True if steps may pass through a contact, as no kernel rejects them."""
        pieces = self._pieces
        return pieces.contact.phase.is_possible and pieces.trajectory.control is None

    def _save_where_judged(self) -> None:
        """Save a state from which equal steps under the same loads can be repeated."""
        if self._is_judged:
            self._save_sound()

    def _save_sound(self) -> None:
        """
        Save the present state; a run whose state is unsound ends instead.

        A state after a health check, or one that was saved before, is sound.
        """
        pieces, trajectory = self._pieces, self._pieces.trajectory
        if pieces.monitor.since_check and trajectory.saved_time != trajectory.time:
            status = pieces.monitor.judge(trajectory.time)
            if status:
                pieces.respond(status, trajectory.time)
        trajectory.save()

    def _judge_steps(self, rest: float) -> bool:
        """
        Return False if shells may have passed through each other since the saved state.

        A run with a given step stops then. Kernels check displacements only after several steps,
        in which bodies may have become faster. So these steps, and `rest` [s] of the next one,
        are repeated one by one.
        """
        pieces, trajectory, found = self._pieces, self._pieces.trajectory, ''

        def visit(before: State, after: State, start: float, end: float) -> None:
            nonlocal found
            # Displacements before the last search were checked then.
            if not found and 0.5 * (start + end) > pieces.contact.phase.searched:
                found = pieces.contact.phase.passing_by(
                    before, after, start, end, long=trajectory.is_given)

        span = trajectory.time - trajectory.saved_time
        pieces.trials.retrace(round(span / trajectory.step), max(rest, 0.0), visit)
        if found and trajectory.is_given:
            pieces.contact.stop_passing(found)
        return not found

    def state_at(self, time: float) -> State:
        """Return the state at a `time` [s] up to the end of the next step, by a trial step."""
        pieces, trajectory, shown = self._pieces, self._pieces.trajectory, self._pieces.shown
        rest = time - trajectory.time
        work = trajectory.work
        spent, given = flowed(work.spent), flowed(work.given)
        shown.note(
            trajectory.state, trajectory.time, trajectory.stretches(),
            work=work_of(trajectory.loads), spent=spent, given=given)
        if trajectory.failure is not None or not rest > 0.0:
            return trajectory.state
        trials, loads = pieces.trials, pieces.trials.copy_loads()
        state = trials.take(rest, 1, loads)
        shown.note(
            state, time, trajectory.stretches(trials.model),
            work=work_of(trajectory.loads, loads), spent=spent + trials.spent,
            given=given + trials.given)
        trajectory.require_body_force()
        if not np.isfinite(state.position).all():
            trajectory.fail(
                f'no step of {rest:.6g} s leads from t = {trajectory.time:.9g} s to a state at '
                f't = {time:.9g} s; ' + (
                    'take a smaller solver.step, or 0 to have it chosen' if trajectory.is_given
                    else 'take a smaller solver.tolerance') + '; the last good state, of '
                f't = {trajectory.time:.9g} s, is kept')
        return state

    def follow_loads(self) -> None:
        """Adapt the step to other loads; no return to a state before them is possible."""
        self._pieces.trajectory.ledger.regular = 0.0
        self._pieces.errors.spoil()
        self._save_where_judged()
        if self._pieces.controller.follow_jump():
            self._pieces.choose_step()

    def error_rate(self) -> float:
        """Return the error that the method adds [1/s], measured last."""
        return self._pieces.errors.probe.present_rate

    def error_estimate(self, time: float) -> float:
        """Return the errors added up to `time` [s], without amplification or decay."""
        return self._pieces.errors.estimate(time)

    def is_ready(self, *, touching: bool) -> bool:
        """Return True if the kernels of all steps are compiled, with contacts if `touching`."""
        return self._pieces.calls.is_ready(touching=touching)

    def take(self, step: float, count: int) -> int:
        """Take up to `count` steps of `step` [s] and react to the outcome; return their number."""
        batch = self._advance(step, count)
        self._outcome = self._judge(batch)
        if self._outcome is Outcome.ACCEPTED:
            self._follow(batch)
        else:
            self._retreat(self._outcome)
        return batch.done

    def _advance(self, step: float, count: int) -> Batch:
        """Take up to `count` steps of `step` [s] in one kernel call."""
        pieces, trajectory = self._pieces, self._pieces.trajectory
        checks, errors, ledger = pieces.monitor, pieces.errors, trajectory.ledger
        step_before, is_far = trajectory.step, self._is_far(step)
        first, before, ledger.saved_at = trajectory.index, checks.since_check, -1.0
        if is_far:
            # One by one, each from a saved state.
            count = 1
            self._save_sound()
        if errors.touching is not None:
            count = errors.touching.prepare(step, before, checks.interval, count)
        is_whole = step == step_before
        origin, index = (trajectory.origin, first) if is_whole else (trajectory.time, 0)
        if not is_whole:
            # Differences of the motion need steps of equal length.
            ledger.regular = 0.0
        status, done, checks.since_check = pieces.calls.take(
            origin, index, step, count, before, checks.interval)
        trajectory.require_body_force()
        if errors.touching is not None:
            errors.touching.note()
        saved_at = int(ledger.saved_at)
        if is_whole:
            trajectory.index += done
            time, saved_time = trajectory.time, trajectory.time_of(first + saved_at)
        else:
            ledger.regular = 0.0
            time = saved_time = trajectory.time + step
        if saved_at == done:
            trajectory.note_saved(saved_time)
        elif saved_at >= 0:
            trajectory.saved_time = saved_time
        trajectory.step_count += done
        errors.probe.checks_left -= (before + done) // checks.interval
        return Batch(
            step, step_before, is_far, int(done), status, time,
            saved_time if saved_at >= 0 else None)

    def _judge(self, batch: Batch) -> Outcome:
        """Return the outcome of a batch, and save its end if it is sound but kernels did not."""
        pieces, trajectory, status = self._pieces, self._pieces.trajectory, batch.status
        is_sound = not status & monitor.UNSOUND
        if status & MISSED and self._checks_passing(batch):
            if batch.is_far:
                pieces.contact.refuse_passing(
                    trajectory.saved, trajectory.state, trajectory.saved_time, batch.time)
            elif not self._judge_steps(
                    0.0 if batch.step == batch.step_before else batch.step):
                return Outcome.PASSED
            if pieces.monitor.since_check == 0 and is_sound:
                trajectory.save(batch.time)
        if status & monitor.SWINGS:
            return Outcome.SWUNG
        # An unsound state must not be saved: the run ends when it responds to the status.
        if not (status & monitor.ROUGHER and is_sound):
            return Outcome.ACCEPTED
        excess = pieces.controller.excess()
        if excess is not None and excess > 1.0 and (
                trajectory.ledger.regular >= pieces.monitor.interval
                and trajectory.saved_time != pieces.errors.returned_to):
            return Outcome.ROUGH
        trajectory.save(batch.time)
        if excess is not None and batch.time == trajectory.time:
            pieces.choose_step(probe=True)
        return Outcome.ACCEPTED

    def _checks_passing(self, batch: Batch) -> bool:
        """Return True if the steps of a batch are checked for shells that passed each other."""
        return (batch.is_far or self._is_judged) and not batch.status & monitor.NOT_FINITE

    def _follow(self, batch: Batch) -> None:
        """Measure the errors of an accepted batch, respond to its status, and adapt the step."""
        pieces, trajectory, checks = self._pieces, self._pieces.trajectory, self._pieces.monitor
        status, time, touching = batch.status, batch.time, pieces.errors.touching
        if touching is not None and checks.since_check == 0:
            if batch.saved_time is None or status & monitor.UNSOUND:
                touching.begin(time)
            else:
                touching.end(batch.saved_time, pieces.errors.probe.steady_rate)
                if not trajectory.is_given:
                    pieces.errors.report_excess(batch.saved_time)
        elif touching is not None and batch.saved_time is not None:
            # If shells were near each other the batch would end at a health check.
            touching.begin(batch.saved_time)
        # Before another search, whose list no health check has counted.
        if checks.since_check == 0 and self._counts_touching():
            pieces.contact.phase.count_touching(trajectory.state)
        if self._checks_passing(batch):
            # No contact was missed.
            status &= ~MISSED
        if status:
            pieces.respond(status, time)
        if checks.since_check and trajectory.step != batch.step_before:
            # Steps of two lengths cannot be repeated from one state.
            self._save_where_judged()
        if checks.since_check:
            return
        if time == trajectory.time and pieces.contact.calm(time):
            self._search(time)
            pieces.choose_step()
        self._follow_touching(time)
        if pieces.errors.probe.checks_left <= 0 or status & monitor.KINETIC_HIGH:
            pieces.choose_step(probe=True)

    def _counts_touching(self) -> bool:
        """Return True if the step follows the number of pairs in contact."""
        pieces = self._pieces
        return pieces.contact.phase.contacts is not None and (
            pieces.trajectory.method.runs_through_contacts)

    def _follow_touching(self, time: float) -> None:
        """
        Adapt steps that run through contacts to the pairs in contact at a health check.

        Search for candidate pairs at `time` [s] if the errors of the next interval are measured.
        """
        pieces = self._pieces
        contact, touching = pieces.contact, pieces.errors.touching
        if not self._counts_touching() or time != pieces.trajectory.time:
            return
        if pieces.controller.follow_touching():
            pieces.choose_step()
        if touching is not None and touching.needs_search and contact.phase.searched < time:
            before = contact.phase.rate
            self._search(time)
            if contact.phase.rate != before and pieces.controller.follow_contacts():
                pieces.choose_step()
            contact.pace(pieces.trajectory.step, alone=not pieces.controller.held_back)

    def _is_far(self, step: float) -> bool:
        """Return True if bodies may leave the region with known contacts in a given `step` [s]."""
        return self._pieces.trajectory.is_given and step > self._pieces.contact.phase.longest_step
