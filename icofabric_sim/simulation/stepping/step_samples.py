# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Measured errors of some steps of the embedded pair, which calibrate those of the others.

The probable error of a step follows from its two error estimates, with the constants of an
oscillation (kernels/probable_error.py). Decay of velocities makes the estimate too large: slightly
in short steps, and up to 60 times in long steps of motion that has decayed. Small kinks of forces,
or jumps where wrapped connectors change to another geodesic, are hidden by the smooth part of the
estimates. In long damped steps and at kinks, a companion therefore follows windows of one shortest
period with steps of half the length, or of a quarter at kinks. Steps between windows count like
those of the last windows. Measured errors below the probable ones count as a ratio of these.
Errors beyond count as a rate in time, because they were hidden.

If shells may touch, only steps without possible contacts are measured. Contacts cause most of
their error in few steps, which windows would miss; their probable error is the only estimate.
"""

import math
from typing import Any, NamedTuple

from icofabric_sim.kernels.records import State, Trail
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.model.layout import copy_state, has_jumps, has_tables
from icofabric_sim.simulation.stepping.embedded_control import EmbeddedControl
from icofabric_sim.simulation.stepping.pieces import Pieces


class _Pace(NamedTuple):
    """Rate at which windows are measured, and their weights."""

    period: int  # one window of so many is measured at first
    windows: int  # measured ones until the period grows
    growth: int  # factor of the period
    longest: int  # period
    kept: float  # weight of a measurement in the mean relative to the next one
    parts: int  # steps of the companion in one step


# Accepted steps have kinks at places with small effect; in steps of the companion kinks lie
# anywhere, and with halves the measured errors were twice too large.
_KINKED = _Pace(1, 8, 2, 16, 0.9, 4)
# Some 15 % of the evaluations of 100 steps, and 7 % of 300.
_DAMPED = _Pace(8, 1, 4, 64, 0.5, 2)
# If velocities decay faster than this ratio of the largest frequency, the probable error is up to
# 60 times too large from the first steps on.
_STRONGLY_DAMPED = _Pace(1, 8, 2, 16, 0.9, 2)
_STRONG_DECAY_RATIO = 2.0
# Damped steps are measured if their length times the geometric mean of the decay rate and of the
# largest frequency is larger than this.
_LONG_STEP = 1.2
# Relative excess of the probable error for each unit of that product, in shorter steps.
_DECAY_BIAS = 0.45
# Least counted fraction of the largest error in a window: errors oscillate within a period.
_MIN_ERROR_RATIO = 0.5
# Steps until the next decision, at which a kernel call ends: after a step with possible contacts
# or one much shorter than a slow decay; and for a faster decay.
_SKIPPED, _SHORT_SKIPPED = 16, 2
_SLOW_DECAY_RATIO = 0.5
# Relative rounding of a difference of sums.
_ROUNDING = 2.0**-52
# No rate [1/s] was measured.
_NOT = -1.0


def needs_samples(pieces: Pieces) -> bool:
    """Return True if the probable error of steps may be too rough an estimate."""
    if pieces.trajectory.method.implicit:
        # It is the error of the embedded method, which is larger.
        return False
    return pieces.trajectory.packed.spends or _is_kinked(pieces)


def _is_kinked(pieces: Pieces) -> bool:
    """Return True if tensions have kinks, or jump at a change of geodesic."""
    model = pieces.trajectory.model
    links = model.links
    return has_jumps(links) or model.wrapping is not None or has_tables(links)


class StepSamples:
    """Sum of errors of all steps, including the one in progress, and the choice of windows."""

    def __init__(self, pieces: Pieces, *, active: bool) -> None:
        """Measure steps of the trajectory of these `pieces`, if `active`."""
        self._pieces, self._trajectory, self._active = pieces, pieces.trajectory, active
        decay, frequency = pieces.trajectory.packed.velocity_rate, pieces.rates.fabric.rate
        self._pace = _KINKED if _is_kinked(pieces) else (
            _STRONGLY_DAMPED if decay > _STRONG_DECAY_RATIO * frequency else _DAMPED)
        self._short_skipped = (
            _SKIPPED if decay <= _SLOW_DECAY_RATIO * frequency else _SHORT_SKIPPED)
        # Mean of decay rate and frequency [1/s]; inf: no step is too short for a measurement.
        self._decay = (
            math.inf if self._pace is _KINKED else math.sqrt(decay * frequency))
        self._touches = pieces.contact.phase.is_possible
        self._trail: Trail | None = None
        self._companion: State | None = None
        # Errors until a time [s], and what kernels had summed up by then.
        self._total = self._counted = self._since = 0.0
        # Error [1/s] of the step in progress, where it was measured.
        self._rate = _NOT
        self.restart()

    @property
    def _control(self) -> EmbeddedControl:
        control = self._trajectory.control
        assert control is not None
        return control

    def restart(self) -> None:
        """Forget what was measured, because the state has jumped; the sum continues."""
        self._every, self._windows, self._left = self._pace.period, self._pace.windows, 1
        self._forget_ratios(1.0)
        self._forget_window()

    def _forget_ratios(self, unmeasured: float) -> None:
        # Until the next window the `unmeasured` part of the probable error counts.
        self._seen = self._hidden = self._probable = self._span = 0.0
        self._unmeasured = unmeasured

    def adopt(self, other: 'StepSamples') -> None:
        """
        Use the measurements of `other`, whose motion continues in a similar fabric.

        The next window is measured, and then as few as there; what was seen there counts as one.
        """
        if not self._active or not other._active:
            return
        self._every = other._every
        one = 1.0 - self._pace.kept
        self._seen, self._hidden = one * other._seen, one * other._hidden
        self._probable, self._span = one * other._probable, one * other._span

    def _forget_window(self) -> None:
        # Begin and end [s] of the window in progress; inf: there is none.
        self._begun = self._end = math.inf
        self._worst = self._sum = 0.0  # what counts of it, and what its steps probably erred by
        self._steps = 0

    def settle(self, total: float, time: float) -> None:
        """Set the `total` of errors at a `time` [s], without a step in progress."""
        self._control.total = self._control.clear_total = total
        self._total = self._counted = total if self._active else 0.0
        self._since, self._rate = time, _NOT

    @property
    def _scale(self) -> float:
        """Ratio of the error of steps to their probable error."""
        if not self._probable > 0.0:
            return self._unmeasured
        return (self._seen + (self._hidden if self._touches else 0.0)) / self._probable

    @property
    def _beyond(self) -> float:
        """Error per second beyond the probable one; `_scale` includes it if shells may touch."""
        return self._hidden / self._span if self._span > 0.0 and not self._touches else 0.0

    @property
    def rate(self) -> float:
        """Error per second of the step in progress."""
        if self._rate != _NOT:
            return self._rate
        if not self._control.is_clear:
            return self._control.rate
        return self._scale * self._control.rate + self._beyond

    def estimate(self, left: float) -> float:
        """Return the errors of all steps, without the last `left` [s] of the one in progress."""
        control = self._control
        until = self._until(control.clear_total, control.start + control.length)
        return control.total - control.clear_total + until - self.rate * left

    def _until(self, summed: float, time: float) -> float:
        """
        Return the errors until a `time` [s] of steps without possible contacts.

        `summed` is the probable error of these steps, summed by kernels.
        """
        return self._total + self._scale * (summed - self._counted) + self._beyond * (
            time - self._since)

    def allowed(self, count: int) -> int:
        """Return the number of steps for a call, up to `count` and to the next measured step."""
        return min(count, self._left) if self._active else count

    def note(self, done: int, *, sound: bool) -> None:
        """Measure the step in progress after `done` steps, if due and `sound`."""
        if not self._active or done == 0:
            return
        self._rate = _NOT
        self._left -= done
        if self._left > 0:
            return
        control = self._control
        if not control.is_clear:
            self._left = _SKIPPED
            self._forget_window()
            return
        probable = control.rate * control.length
        summed = control.clear_total - probable
        # The estimate must not fall by the rounding of `summed`.
        self._total = self._until(summed + _ROUNDING * control.clear_total, control.start)
        self._counted, self._since = summed, control.start
        self._left = 1
        if self._end == math.inf:
            product = self._decay * control.length
            if not product > _LONG_STEP:
                self._forget_ratios(1.0 / (1.0 + _DECAY_BIAS * product))
                self._left = self._short_skipped
                return
            self._begin()
        apart = self._follow() if sound else math.inf
        if not apart < math.inf:
            self._close()
            return
        end = control.start + control.length
        is_last = end >= self._end
        # At its end a window counts by what the two are apart there, and before by the least that
        # can follow.
        worst = max(_MIN_ERROR_RATIO * apart, self._worst, apart if is_last else 0.0)
        self._total, self._counted, self._since = (
            self._total + (worst - self._worst), control.clear_total, end)
        self._rate = (worst - self._worst) / control.length
        self._worst, self._sum = worst, self._sum + probable
        self._steps += 1
        if is_last:
            kept = self._pace.kept
            self._seen = kept * self._seen + min(self._worst, self._sum)
            self._hidden = kept * self._hidden + max(self._worst - self._sum, 0.0)
            self._probable = kept * self._probable + self._sum
            self._span = kept * self._span + end - self._begun
            self._close()

    def give_up(self) -> None:
        """Discard the step in progress and its window."""
        if self._rate != _NOT:
            control = self._control
            self._total -= self._rate * control.length
            self._counted -= control.rate * control.length
            self._since, self._rate = control.start, _NOT
        if self._end < math.inf:
            self._close()

    def _begin(self) -> None:
        """Start a window with the step in progress."""
        layout, start, rate = self._trajectory.packed.layout, self._start, (
            self._pieces.rates.frequency.rate)
        if self._companion is None:
            self._companion = layout.like(start)
            # Separate slopes: those of the step in progress are needed for states within the step.
            self._trail = layout.room(None, start).trail
        copy_state(start, self._companion)
        self._begun = self._control.start
        self._end = self._begun + (2.0 * math.pi / rate if rate > 0.0 else 0.0)

    @property
    def _start(self) -> State:
        trail = self._trajectory.work.trail
        assert trail is not None
        return trail.start

    def _follow(self) -> float:
        """
        Advance the companion to the end of the step in progress; return the distance, or inf.
        """
        assert self._companion is not None and self._trail is not None
        control = self._control
        state = self._pieces.trials.take_embedded(
            control.length / self._pace.parts, self._pace.parts, control.start, self._companion,
            self._trail)
        if self._trajectory.take_force_failure() is not None or state is None:
            return math.inf
        copy_state(state, self._companion)
        return self._pieces.errors.probe.distance(self._trajectory.state, state)

    def _close(self) -> None:
        """End a window, and choose the start of the next one."""
        self._left = 1 + (self._every - 1) * max(self._steps, 1)
        self._windows -= 1
        if not self._windows:
            pace = self._pace
            self._every = min(pace.growth * self._every, pace.longest)
            self._windows = pace.windows
        self._forget_window()

    def state_tree(self, tree: dict[str, Any]) -> None:
        """Add the measurements and the time of the next one."""
        if not self._active:
            return
        tree['samples'] = {
            'total': self._total, 'counted': self._counted, 'since': self._since,
            'rate': self._rate, 'seen': self._seen, 'hidden': self._hidden,
            'probable': self._probable, 'span': self._span, 'unmeasured': self._unmeasured,
            'every': self._every, 'windows': self._windows, 'left': self._left,
            'begun': self._begun, 'end': self._end, 'worst': self._worst, 'sum': self._sum,
            'steps': self._steps}
        if self._end < math.inf and self._companion is not None:
            tree['samples']['companion'] = self._trajectory.by_body(self._companion)

    def load_state(self, tree: StateTree) -> None:
        """Restore the measurements, after the control."""
        if not self._active:
            return
        part = tree.part('samples')
        self._total, self._counted = part.number('total'), part.number('counted')
        self._since, self._rate = part.number('since'), part.number('rate', _NOT)
        self._seen, self._hidden = part.number('seen', 0.0), part.number('hidden', 0.0)
        self._probable, self._span = part.number('probable', 0.0), part.number('span', 0.0)
        # Earlier versions counted all of it.
        self._unmeasured = part.number('unmeasured', 0.0, 1.0) if 'unmeasured' in part else 1.0
        self._every, self._windows = part.count('every', 1), part.count('windows', 1)
        self._left, end = part.count('left', 1), part.number('end', finite=False)
        self._forget_window()
        if end < math.inf:
            self._begin()
            assert self._companion is not None
            self._trajectory.take_back(self._companion, part.part('companion'))
            self._begun, self._end = part.number('begun'), end
            self._worst, self._sum = part.number('worst', 0.0), part.number('sum', 0.0)
            self._steps = part.count('steps')
