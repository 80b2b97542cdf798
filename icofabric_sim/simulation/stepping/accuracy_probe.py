# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Error that the method adds per second, and the step that the tolerance allows.

In each step of length h, a splitting method of order p errs in the phase of a vibration of
frequency w by K (w h)^(p + 1); its energy oscillates without drift. The difference of order p + 1
of positions at step ends is (2 sin(w h / 2))^(p + 1) times the amplitude. If forces have neither
jumps nor kinks, health checks compute the error from differences of completed steps, without
further force evaluations. K is that of the largest frequency (`phase_error` in energy_swing.py).

At the start of a motion no steps are known yet, and across jumps of forces differences are not
meaningful. The error is then measured: from the present state, the method runs for a window of
time with the step, and again with half of the step (Richardson). The state is then restored. The
window is one shortest period, because errors within a fraction of a period mostly cancel; it is a
quarter of a period if differences will soon be known. If a period takes many steps, longer steps
are measured and their errors are scaled by the order of the method. The times of measurements
depend on the motion alone, never on wall time.
"""

import math
from typing import Any

from icofabric_sim.kernels.records import State
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.model.layout import has_jumps, has_tables
from icofabric_sim.simulation.stepping.energy_swing import phase_error
from icofabric_sim.simulation.stepping.motion_rates import MotionRates
from icofabric_sim.simulation.stepping.trajectory import Trajectory
from icofabric_sim.simulation.stepping.trial_steps import TrialSteps
import numpy as np

# Intended error rate over the tolerance, with a reserve for changes of the motion between two
# measurements.
TARGET_RATIO = 0.15
# Relative change of the sum of errors by a measurement: below the first the next measurement is
# later, above the second it is sooner.
_SMALL_CHANGE, _LARGE_CHANGE = 0.1, 0.25
# Most steps of a measurement, if a step is far below the fastest period.
_LARGEST_MEASUREMENT = 2048
# Largest angle [rad] of a step in smooth motion for which the order of all methods holds.
_SMOOTH_RAD = 0.5
# Steps that measurements may take: the first number initially, and this fraction of the steps of
# the run; the last fraction if forces have kinks or shells touch.
_FIRST_COST, _COST_PART, _KINKED_COST_PART = 15.0, 0.05, 0.15
# Mean of the differences between two checks over the counted one: the largest, and at least that
# of the last check.
_MEAN_PART = 0.8
# Ratio of the error at kinks to that of a vibration with steps of order 2: 1.2 to 1.8 in four
# random fabrics.
_AT_KINKS = 1.3
# Angle [rad] of a step above which the error of a method of order 8 exceeds that of a vibration
# by the ratio of angles, measured in random fabrics; angle below which phase errors are round-off.
_NONLINEAR_RAD, _RESOLVED_RAD = 0.6, 0.5
# Most steps of a period, for very short steps.
_MAX_PERIOD_STEPS = 2**40
# Iterations for a step with the intended error in theory.
_CORRECTIONS = 4
# Number of bodies above which a quarter of a period is measured: some of them always err.
_QUARTER_PERIOD_BODIES = 20_000
# A measurement is due early if the kinetic energy has grown by this ratio.
_ENERGY_GROWTH_RATIO = 4.0
# Round-off of positions over the size of the fabric in one period, the least error of a method.
_ROUNDING = 64.0 * float(np.finfo(float).eps)
# Measured errors over this floor if steps have only round-off: 0.2 to 0.45.
_FLOOR_RATIO = 0.4
# Fractions of a window and of its error, for an error that grows linearly.
_STEADY_COURSE = np.array([(0.0, 0.0), (1.0, 1.0)])


class AccuracyProbe:
    """Error that steps of equal length add: positions over a, and angles [rad]."""

    def __init__(
        self, trajectory: Trajectory, trials: TrialSteps, rates: MotionRates, tolerance: float,
        *, differences: int
    ) -> None:
        """
        Measure on the `trajectory` by `trials`; `tolerance` [1/s].

        `differences` is the order of the differences of health checks.
        """
        self._differences = differences
        self._trajectory, self._trials, self._rates = trajectory, trials, rates
        self._half_edge, self.tolerance = trajectory.half_edge, tolerance
        self.total = 0.0  # errors added until the last measurement
        self._since = self._begun = trajectory.time
        self._span = 0.0  # [s] that the last measurement ran over
        self._measured_course = _STEADY_COURSE  # how errors grew in it
        # Error of a step over the difference of its motion; 0: differences do not yield errors.
        self._weight = 0.0
        self._rounding_rate = 0.0  # [1/s] that is added to that
        self._cost = 0.0  # steps that measurements took
        self.restart()

    def restart(self) -> None:
        """Discard measurements after a jump of the state; the sum of errors continues."""
        self._window = 0.0  # [s] from that moment on for which the rate was measured
        self._course = _STEADY_COURSE  # how the errors of that time grow within it
        self.step = math.inf  # the longest step [s] that is accurate enough, as far as known
        self.measured_step = 0.0  # [s] whose error was measured last
        self.rate = 0.0  # error added for each second, measured last
        # The same where no shells touched, which is what is counted from the last measurement on:
        # what they add is measured behind them.
        self.free_rate = 0.0
        self.load_rate = 0.0
        self.is_new, self.is_measured = True, False
        self.gap = 1
        self.checks_left = 1
        self._weight = 0.0
        self._since = self._begun = self._trajectory.time

    def rebase(self, time: float) -> None:
        """Move an unstarted motion to another `time` [s]."""
        self._since = self._begun = time

    def forget(self) -> None:
        """Reset the sum of errors and the number of measurement steps."""
        self._cost = 0.0
        self.settle(0.0)

    def state_tree(self) -> dict[str, Any]:
        """Return measured values and the time of the next measurement."""
        return {
            'total': self.total,
            'step': self.step,
            'measured_step': self.measured_step,
            'rate': self.rate,
            'free_rate': self.free_rate,
            'load_rate': self.load_rate,
            'is_new': self.is_new,
            'is_measured': self.is_measured,
            'gap': self.gap,
            # No checks are left only if the run has ended.
            'looks_left': max(self.checks_left, 1),
            'since': self._since,
            'begun': self._begun,
            'window': self._window,
            'course': self._course.copy(),
            'weight': self._weight,
            'rounding_rate': self._rounding_rate,
            'cost': self._cost,
        }

    def load_state(self, tree: StateTree) -> None:
        """Restore the measurements from a checkpoint."""
        self.total = tree.number('total', 0.0, finite=False)
        self.step = tree.number('step', math.ulp(0.0), finite=False)
        # Earlier versions did not store this step.
        self.measured_step = (
            tree.number('measured_step', 0.0) if 'measured_step' in tree else math.inf)
        self.rate = tree.number('rate', 0.0, finite=False)
        self.free_rate = tree.number('free_rate', 0.0, finite=False)
        self.load_rate = tree.number('load_rate', 0.0, finite=False)
        self.is_new, self.is_measured = tree.flag('is_new'), tree.flag('is_measured')
        self.gap = tree.count('gap', 1)
        self.checks_left = tree.count('looks_left', 1)
        self._since, self._begun = tree.number('since'), tree.number('begun')
        self._window = tree.number('window', 0.0, finite=False)
        self._course = _STEADY_COURSE if 'course' not in tree else _checked_course(
            tree.array('course'))
        self._weight = tree.number('weight', 0.0)
        self._rounding_rate = tree.number('rounding_rate', 0.0)
        self._cost = tree.number('cost', 0.0)

    def estimate(self, time: float) -> float:
        """
        Return the errors added until `time` [s], without amplification or decay.

        After the measured window, half of the measured rate counts; the next measurement adds the
        rest.
        """
        past = time - self._since
        if self._weight > 0.0:
            trajectory, ledger = self._trajectory, self._trajectory.ledger
            steps = ledger.uncounted + max(time - trajectory.time, 0.0) / trajectory.step
            return (
                self.total + self._rounding_rate * max(past, 0.0)
                + self._weight * (ledger.rough_sum + ledger.steady_rough * steps))
        if not past > 0.0 or self.free_rate == 0.0:
            return self.total
        if past < self._window and len(self._course) > 2:
            part = float(np.interp(past / self._window, *self._course.T))
            return self.total + self.free_rate * self._window * part
        return self.total + self.free_rate * (past - 0.5 * max(past - self._window, 0.0))

    def close(self, time: float) -> None:
        """Count the errors until `time` [s], where the state jumps."""
        self.settle(self.estimate(time))
        self._since, self.rate, self.free_rate = time, 0.0, 0.0
        self._trajectory.ledger.steady_rough = 0.0

    def take_back(self, steps: int) -> None:
        """Reduce the sum for the last `steps`, which were too rough and are repeated."""
        ledger = self._trajectory.ledger
        if self._weight > 0.0:
            excess = max(ledger.rough - ledger.rough_limit, 0.0)
            ledger.rough_sum -= 0.5 * excess * steps
            ledger.steady_rough = min(ledger.rough, ledger.rough_limit)

    def largest_difference(self, error: float, step: float) -> float:
        """
        Return the difference of the motion for which steps of `step` [s] add an `error` [1/s].
        """
        return max(error - self._rounding_rate, 0.5 * error) * step / self._weight

    def settle(self, total: float) -> None:
        """Set the `total` of errors at the present time."""
        ledger = self._trajectory.ledger
        self.total, ledger.rough_sum, ledger.uncounted = total, 0.0, 0.0

    @property
    def present_rate(self) -> float:
        """Error per second of the present steps."""
        if not self._weight > 0.0:
            return self.rate
        # None is chosen yet where a motion begins.
        step = self._trajectory.step or math.inf
        return self._rounding_rate + self._weight * self._trajectory.ledger.steady_rough / step

    @property
    def reads_differences(self) -> bool:
        """True if health checks compute errors from differences of the present motion."""
        return self._differences > 0 and (self.is_smooth or self._shows_kinks)

    def checks_to_difference(self, interval: int) -> int:
        """
        Return the number of checks, one after each `interval` steps, until a difference is known.
        """
        return -(-self._differences // interval)

    @property
    def _shows_kinks(self) -> bool:
        """True if forces have only kinks, and differences have the order of their errors."""
        trajectory = self._trajectory
        model = trajectory.model
        return trajectory.method.order == 2 and has_jumps(model.links) and (
            model.contacts is None and model.wrapping is None
            and not trajectory.packed.goes_slack)

    @property
    def may_measure(self) -> bool:
        """True if measurements have taken less than their fraction of all steps."""
        return self._cost <= _FIRST_COST or self.steps_to_measure <= 0

    @property
    def steps_to_measure(self) -> int:
        """Number of steps until measurements have used less than their share."""
        part = _COST_PART if self.is_smooth else _KINKED_COST_PART
        return math.ceil(self._cost / part - self._trajectory.step_count)

    @property
    def steady_rate(self) -> float:
        """Error per second without contacts."""
        return self.present_rate if self._weight > 0.0 else self.free_rate

    def weight(self, step: float) -> float:
        """
        Return the ratio of the error of a step of `step` [s] to the difference of health checks.
        """
        trajectory = self._trajectory
        method, rate = trajectory.method, self._rates.fabric.rate
        angle = min(max(rate * step, _RESOLVED_RAD), 0.99 * method.stability)
        error = phase_error(method.kicks, method.drifts, angle)
        if method.order == 8:
            error *= max(rate * step / _NONLINEAR_RAD, 1.0)
        if self._shows_kinks:
            error *= _AT_KINKS
        return _MEAN_PART * error / (2.0 * math.sin(0.5 * angle)) ** (method.order + 1)

    def expected_step(self, longest: float, speed: float) -> float:
        """
        Return a step [s], at most `longest`, with the intended error in theory.

        A body of `speed` [1/s], over a or in rad, is assumed to move in the fastest vibration
        only. Its phase error is a shift in time.
        """
        method, rate = self._trajectory.method, self._rates.fabric.rate
        aim, ratio = TARGET_RATIO * self.tolerance, longest * rate
        if not (speed > 0.0 and rate > 0.0):
            return longest
        for _ in range(_CORRECTIONS):
            angle = max(ratio, _RESOLVED_RAD)
            error = phase_error(method.kicks, method.drifts, angle) * (
                ratio / angle)**(method.order + 1)
            ratio *= min((aim * ratio / (error * speed))**(1.0 / method.order), 1.0)
        return min(ratio / rate, longest)

    def follow_forces(self) -> None:
        """Request a measurement if differences no longer show errors, as forces may jump."""
        if self._weight > 0.0 and not self.reads_differences:
            rate, time = self.present_rate, self._trajectory.time
            self.settle(self.estimate(time))
            self._since, self._window, self._weight = time, 0.0, 0.0
            self.rate = self.free_rate = rate
            self.is_new = True

    def read_differences(self, step: float, fastest: float, rate: float | None = None) -> None:
        """
        Let health checks sum the errors of steps of `step` [s] from now on, if possible.

        `rate` [1/s] is the measured rate of these steps until the next check; None: unchanged.
        `fastest` [rad/s] is that of the motion.
        """
        trajectory, ledger = self._trajectory, self._trajectory.ledger
        if not self.reads_differences:
            return
        weight = self.weight(step)
        if rate is None:
            if weight == self._weight and step == trajectory.step:
                return
            rate = self.present_rate * (step / trajectory.step) ** trajectory.order
        self.settle(self.estimate(trajectory.time))
        self._since, self._window, self._weight = trajectory.time, 0.0, weight
        self._rounding_rate = _FLOOR_RATIO * self.floor(fastest)
        ledger.steady_rough = max(rate - self._rounding_rate, 0.0) * step / weight

    def begin(self) -> None:
        """Start a measurement with the present loads."""
        self.load_rate = 1.5 * self._rates.load_rate

    def add(self, error: float) -> float:
        """
        Count the errors since the last measurement, with the present `error` rate.

        Between measured windows, the rate is interpolated. Returns the uncertainty of the sum that
        results from the interpolation.
        """
        time = self._trajectory.time
        rest = max(time - self._since - self._window, 0.0)
        self.total = self.estimate(time)
        if not rest > 0.0:
            return 0.0
        error = self._without_jumps(error)
        self.total += 0.5 * error * rest
        return 0.5 * abs(error - self.free_rate) * rest if error < math.inf else math.inf

    def _without_jumps(self, error: float) -> float:
        """
        Return the part of an `error` rate that is counted here, without contacts.

        Errors in contacts are measured after the steps. If forces of wrapped connectors jump at
        times, the least rate counts; errors beyond it are measured after the steps, too.
        """
        if self._trials.touched:
            return self.free_rate
        if self._trajectory.model.wrapping is not None and not self.is_new:
            return min(error, self.free_rate)
        return error

    def pace(self, change: float, *, first: int, largest: int, unit: float, part: int) -> None:
        """
        Choose the `gap` until the next measurement, in units of `unit` [s].

        `change`: how much of the sum hangs on this one; inf: the motion is new. From the `first`
        gap to the `largest`, but no longer than one of `part` parts of the motion so far: what
        no measurement has followed must not decide about the sum.
        """
        time = self._trajectory.time
        if self.is_new or change == math.inf:
            self._begun, self.gap = time, first
            return
        if not change <= _LARGE_CHANGE * self.total:
            self.gap //= 4
        elif change <= _SMALL_CHANGE * self.total:
            self.gap = min(2 * self.gap, largest)
        past = (time - self._begun) / (part * unit) if unit > 0.0 else math.inf
        self.gap = max(int(min(self.gap, past)), first)

    def end(self, error: float) -> None:
        """Store the measured `error` rate."""
        self._since, self.rate = self._trajectory.time, error
        self._window = 0.0 if self._weight > 0.0 else self._span
        self._course = self._measured_course
        self.free_rate = self._without_jumps(error)
        self.is_measured = True
        self._trajectory.ledger.lively = _ENERGY_GROWTH_RATIO * self._trajectory.ledger.kinetic

    @property
    def span(self) -> float:
        """Simulated time [s] of the last measurement."""
        return self._span

    def measured(
        self, step: float, fastest: float, *, least: int = 1, given: bool = False,
        brief: bool = False
    ) -> float:
        """
        Error that the method adds for each second with this step; the state must be saved.

        Over one period, or about as many as `least` steps take, each of them by
        itself: errors of different periods must neither cancel nor fade. So are the first steps of
        a given one, where loads that last a few of them add the most. `given`: no step hangs on
        it. `brief`: over a quarter of a period, where differences will soon tell more. NaN where
        not even one can be run.
        """
        self._span, self._measured_course = 0.0, _STEADY_COURSE
        if not fastest > 0.0:
            return 0.0
        count, scale, power = self.steps_of_period(step, fastest), 1.0, 2.0**self._trajectory.order
        shortest, most = least * step, _LARGEST_MEASUREMENT
        at_first = given and least > 1
        if at_first and self._rates.load_rate > 0.0:
            # A load may last a few steps only: steps are not lengthened.
            count = min(count, least)
        elif given and (self.is_smooth or self.reads_differences):
            most = math.ceil(2.0 * math.pi / _SMOOTH_RAD)
        if count > most:
            longer = 2.0 * math.pi / fastest / most
            step, count, scale = longer, most, (step / longer) ** self._trajectory.order
        if brief or self._trajectory.packed.layout.body_count > _QUARTER_PERIOD_BODIES:
            count = -(-count // 4)
        counts = [count] * max(round(shortest / (count * step)), 1)
        if at_first and scale == 1.0:
            counts[:1] = _doubled(count)
        found = self._trials.errors_ahead(step, counts, self.distance, self._joined)
        done = len(found)
        del counts[done:]
        self._span = sum(counts) * step
        self._cost += 3.0 * sum(counts)
        if not counts:
            return math.nan
        total = sum(found)
        if 0.0 < total < math.inf and done > 1:
            self._measured_course = np.array([(0.0, 0.0), *zip(
                np.cumsum(counts) / sum(counts), np.cumsum(found) / total)])
            self._measured_course[-1] = 1.0
        error = scale * total * power / (power - 1.0) / self._span
        if scale < 1.0 and total > 0.0:
            # Round-off does not decrease with the step.
            error = max(error, _FLOOR_RATIO * self.floor(fastest))
        return error

    def take_over(self) -> None:
        """Use the errors that were measured after the steps, with contacts, as a measurement."""
        self._span, self._trials.touched = 0.0, True
        self._measured_course = _STEADY_COURSE

    @property
    def is_smooth(self) -> bool:
        """True if no force jumps or has a kink in the present motion."""
        model, links = self._trajectory.model, self._trajectory.model.links
        return (
            model.contacts is None and model.wrapping is None and not has_jumps(links)
            and not has_tables(links))

    def steps_of_period(self, step: float, fastest: float) -> int:
        """Return the number of steps of `step` [s] in a period of the `fastest` motion [rad/s]."""
        if not fastest > 0.0:
            return 1
        return max(1, math.ceil(min(2.0 * math.pi / fastest / step, _MAX_PERIOD_STEPS)))

    def distance(self, first: State, second: State, rate: float = 0.0) -> float:
        """
        Return the largest error of a body: its position over a, or its orientation [rad].

        A `rate` [rad/s] of vibrations adds the errors that velocity and spin will cause.
        """
        with np.errstate(over='ignore', invalid='ignore'):
            square = _apart(first.position, second.position) / self._half_edge**2
            # A small rotation by x changes the quaternion by x / 2, the cosines by sqrt(2) x.
            square = max(square, (4.0 if first.orientation.ndim == 2 else 0.5) * _apart(
                first.orientation, second.orientation))
            if rate > 0.0:
                slip = _apart(first.linear_velocity, second.linear_velocity)
                spin = _apart(first.angular_velocity, second.angular_velocity)
                square = max(square, max(slip / self._half_edge**2, spin) / rate**2)
        return math.sqrt(square) if math.isfinite(square) else math.inf

    def _joined(self, place: float, turn: float) -> float:
        """Return the `distance` of given squares: distances [m^2] and quaternion differences."""
        square = max(place / self._half_edge**2, 4.0 * turn)
        return math.sqrt(square) if math.isfinite(square) else math.inf

    def slip(self, first: State, second: State) -> float:
        """Return the largest difference [1/s] of velocities of a body over a, or of its spins."""
        with np.errstate(over='ignore', invalid='ignore'):
            square = max(
                _apart(first.linear_velocity, second.linear_velocity) / self._half_edge**2,
                _apart(first.angular_velocity, second.angular_velocity))
        return math.sqrt(square) if math.isfinite(square) else math.inf

    def floor(self, fastest: float) -> float:
        """Return the error [1/s] that rounding adds with any step."""
        extent = 1.0 + self._trajectory.extent / self._half_edge
        return _ROUNDING * extent * fastest / (2.0 * math.pi)

    def require_possible(self, fastest: float) -> None:
        """Raise ValueError for a tolerance below round-off."""
        floor = self.floor(fastest)
        if not self.tolerance >= floor:
            raise ValueError(
                f'solver.tolerance {self.tolerance!r} 1/s is below what doubles can give here: '
                f'rounding adds about {floor:.2g} 1/s (positions are up to '
                f'{self._trajectory.extent:.3g} m, vibrations up to '
                f'{fastest:.4g} rad/s); choose a larger one')


def _apart(first: np.ndarray, second: np.ndarray) -> float:
    """Return the largest squared distance of two vectors; components first, bodies last."""
    return float(((first - second) ** 2).reshape(-1, first.shape[-1]).sum(axis=0).max())


def _doubled(count: int) -> list[int]:
    """Return parts of `count`: 1, 1, 2, 4, ..., and the remainder."""
    parts, done = [], 0
    while done < count:
        parts.append(min(max(done, 1), count - done))
        done += parts[-1]
    return parts


def _checked_course(course: np.ndarray) -> np.ndarray:
    """Return the course from a checkpoint; raise ValueError if it does not rise from 0 to 1."""
    if not (course.ndim == 2 and course.shape[1] == 2 and len(course) > 1
            and not course[0].any() and (course[-1] == 1.0).all()
            and (np.diff(course, axis=0) >= 0.0).all()):
        raise ValueError('course must rise from 0 to 1')
    return course
