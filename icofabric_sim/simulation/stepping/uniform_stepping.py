# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Steps of one length, many in a call of kernels.

They end at origin + k h. Only inputs cut a step short; a state between two steps comes from a
trial step, so outputs never touch the sequence.
"""

import math
from typing import Any

from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.contact.rebuild_check import MISSED
from icofabric_sim.kernels.meters import flowed
from icofabric_sim.kernels.records import State
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.stepping.faults import too_fast
from icofabric_sim.simulation.stepping.pieces import Pieces, Stepping
from icofabric_sim.simulation.stepping.shown_energies import work_of
import numpy as np

# Above it steps cannot be counted in doubles.
_MOST_STEPS = 2.0**53
# Ends of steps are rounded: 700 steps of 1e-3 s end one bit after 0.7 s.
_ROUNDED_BITS = 2.0


def latest_end(time: float) -> float:
    """Return the latest end [s] of a step that counts as ended by `time` [s]."""
    return time + _ROUNDED_BITS * math.ulp(time)


class UniformStepping:
    """Takes steps of the trajectory's length until the controller proposes another."""

    def __init__(self, pieces: Pieces) -> None:
        """Advance the trajectory of these `pieces`."""
        self._pieces = pieces
        # Whether the last call of kernels led too far, so that the run went back.
        self._is_back = False
        # The farthest time [s] from which it went back in a call of `run_steps`.
        self._left_at = -math.inf

    @property
    def next_step_time(self) -> float:
        """Time [s] at which the step in progress ends."""
        return self._pieces.trajectory.time + self._pieces.trajectory.step

    def restart(self) -> None:
        """Do nothing: the trajectory counts steps, and `errors` sums what they add."""

    def settle(self, total: float) -> None:
        """Have a `total` of errors at the present time."""
        self._pieces.errors.settle(total)

    def adopt(self, other: Stepping) -> None:
        """Do nothing: `errors` measures anew."""

    def forget(self) -> None:
        """Do nothing, likewise."""

    def rebase(self, time: float) -> None:
        """Do nothing, likewise."""

    def count_until(self, time: float) -> int:
        """Count the whole steps that end by `time` [s]."""
        trajectory = self._pieces.trajectory
        origin, step = trajectory.origin, trajectory.step
        count = (time - origin) / step
        if not count < _MOST_STEPS:
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
        # Where the controller does not say when it measures again, up to the next health check.
        due = max(pieces.errors.probe.checks_left, 1) * pieces.monitor.interval
        due -= pieces.monitor.since_check
        return self.take(pieces.trajectory.step, min(count, due, pieces.calls.portions.count))

    def run_steps(self, count: int, until: float) -> int:
        """
        Take up to `count` steps that end by `until` [s], in one call; returns how many.

        Where one leads back, to be taken again in shorter steps, so many more that they come to
        its end: what is shown at a time must not depend on steps beyond it, nor on how they were
        asked for.
        """
        if until < math.inf:
            count = min(count, self.count_until(until))
        if not count > 0:
            return 0
        self._left_at = -math.inf
        done = self._run(count)
        while self._pieces.trajectory.time < self._left_at and (
                until == math.inf or self.count_until(until) > 0):
            more = self._run(1)
            if not more:
                break
            done += more
        return done

    def cut(self, time: float) -> bool:
        """
        Take a shorter step to `time` [s]; the next one starts there.

        False: the step led too far, and the run is back at the saved state.
        """
        trajectory = self._pieces.trajectory
        rest = time - trajectory.time
        self._is_back = False
        try:
            if rest > 0.0:
                self.take(rest, 1)
        finally:
            if trajectory.failure is None and not self._is_back:
                trajectory.begin_at(time)
        if self._is_back:
            return False
        self._save_where_judged()
        return True

    def check_within(self, time: float) -> bool:
        """
        Judge a state at `time` [s] within a step in which shells may pass through each other.

        So states within a step are judged as its end will be: a given step stops the run. False:
        chosen ones have to be taken anew, by `go_back`.
        """
        pieces, trajectory = self._pieces, self._pieces.trajectory
        if not self._is_judged:
            return True
        rest = time - trajectory.time
        state = pieces.trials.take(rest, 1) if rest > 0.0 else trajectory.state
        if trajectory.take_force_failure() is not None:
            # There is no state to judge; whether the run comes there is not known.
            return True
        if rest > 0.0 and self._is_far(rest):
            pieces.contact.refuse_passing(trajectory.state, state, trajectory.time, time)
        elif pieces.contact.has_left(state, time):
            # Of a chosen step the whole: the run must not depend on what is shown.
            return self._judge_steps(
                trajectory.step if rest > 0.0 and not trajectory.is_given else rest)
        return True

    def go_back(self) -> None:
        """
        Go on to where kernels ask how far bodies have moved, and back from there.

        A run of which no state is shown on the way does the same, so all that follows is the same.
        """
        pieces, trajectory, self._is_back = self._pieces, self._pieces.trajectory, False
        since, stride = pieces.monitor.since_check, pieces.contact.stride
        self.take(trajectory.step, min(pieces.monitor.interval - since, stride - since % stride))
        if not self._is_back:
            # Bodies were far away in between only.
            self._return()

    def _return(self) -> None:
        """
        Return to the saved state, and ask more often how far bodies have moved.

        They became so fast in chosen steps that a contact may have been passed.
        """
        pieces, trajectory, errors = self._pieces, self._pieces.trajectory, self._pieces.errors
        contact, step = pieces.contact, trajectory.step
        # The errors of what was shown up to there stay counted.
        errors.probe.close(trajectory.time)
        self._left_at = max(self._left_at, trajectory.time)
        trajectory.return_to_saved()
        trajectory.return_work()
        trajectory.ledger.regular = 0.0
        errors.begin(trajectory.saved_time)
        pieces.monitor.since_check = 0
        contact.follow_speeds(step, trajectory.saved_time + pieces.monitor.interval * step)
        contact.search(trajectory.saved_time, *pieces.controller.outlook())
        contact.forget_displacements()
        pieces.choose_step(probe=True)
        self._is_back = True

    def _take_again(self) -> None:
        """Return to the saved state: collisions asked for shorter steps from there on."""
        pieces, trajectory, errors = self._pieces, self._pieces.trajectory, self._pieces.errors
        # The errors of what was shown up to there stay counted.
        errors.probe.close(trajectory.time)
        self._left_at = max(self._left_at, trajectory.time)
        trajectory.return_to_saved()
        trajectory.return_work()
        trajectory.ledger.regular = 0.0
        errors.begin(trajectory.saved_time)
        pieces.monitor.since_check = 0
        pieces.controller.follow_swing()
        pieces.contact.search(trajectory.saved_time, *pieces.controller.outlook())
        pieces.contact.forget_displacements()
        pieces.choose_step()
        self._is_back = True

    @property
    def _is_judged(self) -> bool:
        """Whether steps may lead beyond a contact: those that no kernel refuses."""
        pieces = self._pieces
        return pieces.contact.is_possible and pieces.trajectory.control is None

    def _save_where_judged(self) -> None:
        """Save a state from which steps of one length under the same loads can be repeated."""
        if self._is_judged:
            self._save_sound()

    def _save_sound(self) -> None:
        """
        Save the present state, to come back to; a run whose state is unsound ends instead.

        What a health check has just seen, or was saved already, is sound.
        """
        pieces, trajectory = self._pieces, self._pieces.trajectory
        if pieces.monitor.since_check and trajectory.saved_time != trajectory.time:
            status = pieces.monitor.judge(trajectory.time)
            if status:
                pieces.respond(status, trajectory.time)
        trajectory.save()

    def _judge_steps(self, rest: float) -> bool:
        """
        Whether no shells can have passed through each other since the saved state.

        Where they may have, a run with a given step stops.

        Kernels ask only after several steps how far bodies have moved, which may have become
        faster. So these, and a part of the next one of `rest` [s], are repeated one by one.
        """
        pieces, trajectory, found = self._pieces, self._pieces.trajectory, ''

        def visit(before: State, after: State, start: float, end: float) -> None:
            nonlocal found
            # What was before the last search was judged by the one before that.
            if not found and 0.5 * (start + end) > pieces.contact.search_time:
                found = pieces.contact.passing(
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
        """The step follows other loads; none goes back to before them."""
        self._pieces.trajectory.ledger.regular = 0.0
        self._pieces.errors.spoil()
        self._save_where_judged()
        if self._pieces.controller.follow_jump():
            self._pieces.choose_step()

    def error_rate(self) -> float:
        """Error that the method adds for each second, measured last."""
        return self._pieces.errors.probe.present_rate

    def error_estimate(self, time: float) -> float:
        """Errors added from the start to a present `time` [s], as if none had grown or faded."""
        return self._pieces.errors.estimate(time)

    def is_ready(self, *, touching: bool) -> bool:
        """Whether the kernels of all steps are compiled, if `touching` of those with contacts."""
        return self._pieces.calls.is_ready(touching=touching)

    def state_tree(self, tree: dict[str, Any]) -> None:
        """Add nothing: all that steps to come depend on is in the other pieces."""

    def load_time(self, tree: StateTree) -> None:
        """Do nothing, likewise."""

    def load_state(self, tree: StateTree) -> None:
        """Do nothing, likewise."""

    def take(self, step: float, count: int) -> int:
        """Take up to `count` steps of `step` [s], and act on what they met; returns how many."""
        pieces, trajectory = self._pieces, self._pieces.trajectory
        checks, errors, ledger = pieces.monitor, pieces.errors, trajectory.ledger
        touching, whole = errors.touching, trajectory.step
        is_whole = step == whole
        first, before, ledger.saved_at = trajectory.index, checks.since_check, -1.0
        far = self._is_far(step)
        if far:
            # One by one, each from a state to go back to.
            count = 1
            self._save_sound()
        if touching is not None:
            count = touching.prepare(step, before, checks.interval, count)
        # A step of another length is cut to end at an input.
        origin, index = (trajectory.origin, first) if is_whole else (trajectory.time, 0)
        if not is_whole:
            # Nor does a difference of the motion end with one.
            ledger.regular = 0.0
        status, done, checks.since_check = pieces.calls.take(
            origin, index, step, count, before, checks.interval)
        trajectory.require_body_force()
        if touching is not None:
            touching.note()
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
        if far and status & MISSED and not status & monitor.NOT_FINITE:
            pieces.contact.refuse_passing(
                trajectory.saved, trajectory.state, trajectory.saved_time, time)
        elif self._is_judged and status & MISSED and not status & monitor.NOT_FINITE:
            if not self._judge_steps(0.0 if is_whole else step):
                self._return()
                return int(done)
        if (far or self._is_judged) and not status & monitor.NOT_FINITE:
            if status & MISSED and checks.since_check == 0 and not status & monitor.UNSOUND:
                trajectory.save(time)
            # Nothing was missed, so the state is as good as any.
            status &= ~MISSED
        if status & monitor.SWINGS:
            self._take_again()
            return int(done)
        # An unsound state must not be saved: the run ends below.
        rougher = status & monitor.ROUGHER and not status & monitor.UNSOUND
        if rougher and not self._accept(time):
            return int(done)
        if touching is not None and checks.since_check == 0:
            if saved_at >= 0 and not status & monitor.UNSOUND:
                touching.end(saved_time, errors.probe.steady_rate)
                if not trajectory.is_given:
                    errors.report_excess(saved_time)
            else:
                touching.begin(time)
        elif touching is not None and saved_at >= 0:
            # Where something is near a call ends at a health check: nothing was.
            touching.begin(saved_time)
        # Before another search: its list has not been looked at.
        if checks.since_check == 0 and self._counts_touching():
            pieces.contact.count_touching()
        if status:
            pieces.respond(status, time)
        if checks.since_check and trajectory.step != whole:
            # Steps of two lengths cannot be repeated from one state.
            self._save_where_judged()
        if checks.since_check == 0 and time == trajectory.time and pieces.contact.calm(time):
            pieces.contact.search(time, *pieces.controller.outlook())
            pieces.contact.forget_displacements()
            pieces.choose_step()
        if checks.since_check == 0:
            self._follow_touching(time)
        if checks.since_check == 0 and (
            errors.probe.checks_left <= 0 or status & monitor.KINETIC_HIGH
        ):
            pieces.choose_step(probe=True)
        return int(done)

    def _counts_touching(self) -> bool:
        """Whether the step follows how many pairs touch."""
        pieces = self._pieces
        return pieces.contact.contacts is not None and (
            pieces.trajectory.method.runs_through_contacts)

    def _follow_touching(self, time: float) -> None:
        """
        At a health check at `time` [s]: let the step follow what touches, where it runs through.

        And know the pairs of the stretch that begins, if that will be measured.
        """
        pieces = self._pieces
        contact, touching = pieces.contact, pieces.errors.touching
        if not self._counts_touching() or time != pieces.trajectory.time:
            return
        if pieces.controller.follow_touching():
            pieces.choose_step()
        if touching is not None and touching.needs_search and contact.searched < time:
            before = contact.rate
            contact.search(time, *pieces.controller.outlook())
            # Kernels may have noted some from where the search before was.
            contact.forget_displacements()
            if contact.rate != before and pieces.controller.follow_contacts():
                pieces.choose_step()
            contact.pace(pieces.trajectory.step, alone=not pieces.controller.held_back)

    def _is_far(self, step: float) -> bool:
        """Whether bodies may leave the region with known contacts in a given `step` [s]."""
        return self._pieces.trajectory.is_given and step > self._pieces.contact.longest_step

    def _accept(self, time: float) -> bool:
        """
        The motion became rougher: measure anew, and go back if the error was too large.

        Whether the run goes on from here; else it is back at the last health check.
        """
        pieces, trajectory, errors = self._pieces, self._pieces.trajectory, self._pieces.errors
        excess = pieces.controller.excess()
        if excess is None:
            trajectory.save(time)
            return True
        whole = trajectory.ledger.regular >= pieces.monitor.interval
        if excess > 1.0 and whole and trajectory.saved_time != errors.returned_to:
            # The errors of what was shown up to there stay counted.
            errors.probe.take_back(pieces.monitor.interval)
            errors.probe.close(time)
            self._left_at = max(self._left_at, time)
            trajectory.return_to_saved()
            errors.begin(trajectory.saved_time)
            errors.returned_to = trajectory.saved_time
            trajectory.return_work()
            trajectory.ledger.regular = 0.0
            pieces.choose_step(probe=True, shorter=excess)
            self._is_back = True
            return False
        trajectory.save(time)
        if time == trajectory.time:
            pieces.choose_step(probe=True)
        return True
