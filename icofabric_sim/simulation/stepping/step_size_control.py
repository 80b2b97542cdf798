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
How long a step may be: stable, and as accurate as asked.

Accuracy is measured, not estimated from formulas: from the present state the method runs for one
shortest period of the fabric with the step in question, and again with half of it; the difference
tells the error (Richardson), which divided by that time is what the method adds for each second.
The state then goes back to where it was. Whether and when to measure depends on the motion alone,
never on time that passes outside.
"""

from collections.abc import Callable
import math
from typing import Any, Protocol

from icofabric_sim.kernels.records import State
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.state_tree import StateTree
from icofabric_sim.simulation.stepping.ledger import Ledger
from icofabric_sim.simulation.stepping.methods import Method
import numpy as np

# Step times frequency, in parts of what the method chooses at most: too long (shorten it), too
# short (lengthen it).
LONGEST, SHORTEST = 1.25, 0.4
# A fixed step below this part of the limit would never come to an end.
_SHORTEST_FIXED = 1e-9
# The measured error rate that is aimed at, and the range in which a step is kept, in parts of the
# tolerance. Motion changes between two measurements, so the aim leaves room.
AIM, _LARGEST, _SMALLEST = 0.15, 0.4, 0.02
# Shortest periods until the next measurement, which costs three: twice as many each time, up to
# this.
_FIRST_GAP, _LARGEST_GAP = 4, 64
# The same where inputs come so often that the roughness of the motion cannot be judged.
_LARGEST_BLIND_GAP = 16
# Steps of a measurement at most, where a step is far below the fastest period.
_LARGEST_MEASUREMENT = 2048
# Bodies above which a quarter of a period is measured: some of so many err at any moment.
_MANY = 20_000
# The same, in periods, where the step is given and the measurement is for the report only.
_LARGEST_REPORT_GAP = 128
# What a measurement between two may change of the sum of errors, in parts of it: the next comes
# later below the first, and sooner above the second.
_SMALL_CHANGE, _LARGE_CHANGE = 0.1, 0.25
# A measurement comes early once the kinetic energy is this many times that of the last.
_LIVELIER = 4.0
# ... or the motion this many times as rough, and so rough that the tolerance is in question.
_ROUGHER = 1.5
_LARGEST_CHANGE = 0.1, 4.0
_TRIES = 8
# Rounding of positions, beside the size of the fabric, in one period: no method adds less.
_ROUNDING = 64.0 * float(np.finfo(float).eps)


class Line(Protocol):
    """What is needed of the trajectory."""

    method: Method
    packed: PackedScene
    state: State
    ledger: Ledger
    load_rate: float
    look_interval: int  # steps
    touched_ahead: bool

    @property
    def time(self) -> float: ...

    def compare_ahead(
        self, step: float, count: int, windows: int, compare: Callable[[State, State], None]
    ) -> int: ...


class StepSizeController:
    """The step that the tolerance allows, and what the method adds to the error."""

    def __init__(self, line: Line, tolerance: float, half_edge: float) -> None:
        """Measure on `line`; errors are positions over `half_edge` [m], and angles [rad]."""
        self._line, self.tolerance, self._half_edge = line, tolerance, half_edge
        self.total = 0.0  # errors added until the last measurement
        self._since = line.time
        self._span = 0.0  # [s] that the last measurement ran over
        self.restart()

    def restart(self) -> None:
        """Forget what was measured: the state has jumped. The sum of errors goes on."""
        self._window = 0.0  # [s] from that moment on for which the rate was measured
        self.step = math.inf  # the longest step [s] that is accurate enough, as far as known
        self.rate = 0.0  # error added for each second, measured last
        # The same where no shells touched: what they add is measured behind them.
        self._free_rate = 0.0
        self.load_rate = 0.0
        self.is_new, self.is_measured = True, False
        self._gap = _FIRST_GAP
        self.looks_left = 1
        self._since = self._line.time

    def rebase(self, time: float) -> None:
        """Begin at another `time` [s]: nothing has moved yet."""
        self._since = time

    def state_tree(self) -> dict[str, Any]:
        """What was measured, and when it will be again."""
        return {
            'total': self.total,
            'step': self.step,
            'rate': self.rate,
            'free_rate': self._free_rate,
            'load_rate': self.load_rate,
            'is_new': self.is_new,
            'is_measured': self.is_measured,
            'gap': self._gap,
            # None are left only where the run has ended.
            'looks_left': max(self.looks_left, 1),
            'since': self._since,
            'window': self._window,
        }

    def load_state(self, tree: StateTree) -> None:
        """Go on from there."""
        self.total = tree.number('total', 0.0, finite=False)
        self.step = tree.number('step', math.ulp(0.0), finite=False)
        self.rate = tree.number('rate', 0.0, finite=False)
        self._free_rate = tree.number('free_rate', 0.0, finite=False)
        self.load_rate = tree.number('load_rate', 0.0, finite=False)
        self.is_new, self.is_measured = tree.flag('is_new'), tree.flag('is_measured')
        self._gap = tree.count('gap', 1)
        self.looks_left = tree.count('looks_left', 1)
        self._since = tree.number('since')
        self._window = tree.number('window', 0.0, finite=False)

    def choose(
        self, step: float, cap: float, fastest: float, *, jumped: bool = False
    ) -> float:
        """
        A step up to `cap` [s] that is accurate enough, near `step` if that will do.

        `fastest` is the rate [rad/s] of the fastest motion; `jumped`: what acts is new.
        """
        tolerance, order = self.tolerance, self._line.method.order
        self._begin()
        before = step
        step = min(step, cap)
        floor = self.floor(fastest)
        error = self.measured(step, fastest)
        if math.isnan(error):
            # The next look measures again, if the run comes to it.
            self._add(self._free_rate)
            self._end(self.rate, step)
            self.looks_left = 1
            return step
        self._add(self._free_rate if jumped else error)
        low = _SMALLEST if not self.is_new else 0.25 * AIM
        for _ in range(_TRIES):
            if error <= _LARGEST * tolerance and (error >= low * tolerance or step >= cap):
                break
            if error <= floor:
                # Shorter steps only add roundings.
                break
            wish = (AIM * tolerance / error) ** (1.0 / order) if error < math.inf else 0.0
            change = min(max(wish, _LARGEST_CHANGE[0]), _LARGEST_CHANGE[1])
            longer = min(rounded_down(step * change), cap)
            if longer == step:
                break
            found = self.measured(longer, fastest)
            if math.isnan(found):
                break
            if longer < step and error <= found < math.inf:
                # So short that rounding rules: it adds the same to every step, however short.
                break
            step, error = longer, found
            low = 0.25 * AIM
        rough = self._line.ledger.rough
        largest = _LARGEST_GAP if rough >= 0.0 else _LARGEST_BLIND_GAP
        self._end(error, step)
        self._gap = _FIRST_GAP if self.is_new else min(2 * self._gap, largest)
        steps = self._gap * self._steps_of_period(step, fastest)
        self.looks_left = -(-steps // self._line.look_interval)
        self.is_new = False
        # Differences grow with the step as the error does.
        self._expect(rough * (step / before) ** self._line.method.order)
        self.step = math.inf if step >= cap else step
        return step

    def _expect(self, rough: float) -> None:
        """Note how rough the motion is with the error that was measured; more asks for another."""
        error = max(self.rate, 1e-3 * AIM * self.tolerance)
        room = max(_LARGEST * self.tolerance / error, _ROUGHER)
        # Not known: the next look will find out.
        self._line.ledger.rough_limit = room * rough if rough >= 0.0 else 0.0

    def excess(self) -> float | None:
        """
        How many times the tolerance the error probably was where a look found rougher motion.

        None where this is the first time that roughness is known.
        """
        ledger = self._line.ledger
        if ledger.rough_limit == 0.0:
            self._expect(ledger.rough)
            return None
        return _LARGEST * ledger.rough / ledger.rough_limit

    def measure_only(self, step: float, fastest: float, *, jumped: bool = False) -> None:
        """
        Measure what a given step adds: again soon where the sum of errors hangs on it.

        `jumped`: what acts is new.
        """
        self._begin()
        if self.is_new or jumped:
            self._gap = 1
        look = self._line.look_interval
        steps = self._steps_of_period(step, fastest)
        # At first as far as the next look, so that nothing is missed of how a motion begins.
        error = self.measured(step, fastest, least=look if self._gap == 1 else 1)
        if math.isnan(error):
            error = self.rate
        change = self._add(self._free_rate if jumped else error)
        if not (self.is_new or jumped):
            if not change <= _LARGE_CHANGE * self.total:
                self._gap = max(self._gap // 4, 1)
            elif change <= _SMALL_CHANGE * self.total:
                self._gap = min(2 * self._gap, max(_LARGEST_REPORT_GAP * steps // look, 1))
        self._end(error, step)
        self.looks_left = self._gap
        self.is_new = False

    @property
    def estimated_rate(self) -> float:
        """What is counted [1/s] from the last measurement on, as if no shells touched."""
        return self._free_rate

    def estimate(self, time: float) -> float:
        """
        Errors added until `time` [s], as if none of them had grown or faded.

        After what was measured half as much is counted: the next measurement adds to that.
        """
        past = time - self._since
        if not past > 0.0 or self._free_rate == 0.0:
            return self.total
        return self.total + self._free_rate * (past - 0.5 * max(past - self._window, 0.0))

    def close(self, time: float) -> None:
        """Count what was added until `time` [s], where the state jumps."""
        self.total = self.estimate(time)
        self._since, self.rate, self._free_rate = time, 0.0, 0.0

    def _begin(self) -> None:
        self.load_rate = 1.5 * self._line.load_rate

    def _add(self, error: float) -> float:
        """
        Count what was added since the last measurement, with the present `error` rate.

        Between what two measurements ran over it is taken to change steadily. Returns how much of
        the sum hangs on that.
        """
        time = self._line.time
        rest = max(time - self._since - self._window, 0.0)
        self.total = self.estimate(time)
        if not rest > 0.0:
            return 0.0
        if self._line.touched_ahead:
            error = self._free_rate
        self.total += 0.5 * error * rest
        return 0.5 * abs(error - self._free_rate) * rest if error < math.inf else math.inf

    def _end(self, error: float, step: float) -> None:
        self._since, self.rate, self._window = self._line.time, error, self._span
        if not self._line.touched_ahead:
            self._free_rate = error
        self.is_measured = True
        self._line.ledger.lively = _LIVELIER * self._line.ledger.kinetic

    def measured(self, step: float, fastest: float, *, least: int = 1) -> float:
        """
        Error that the method adds for each second with this step; the state must be saved.

        Over one period, or as many as so many steps at `least` take, each of them by itself:
        errors of different periods must neither cancel nor fade. NaN where not even one can be
        run.
        """
        self._span = 0.0
        if not fastest > 0.0:
            return 0.0
        method = self._line.method
        count = self._steps_of_period(step, fastest)
        if self._line.packed.layout.body_count > _MANY:
            count = -(-count // 4)
        windows = -(-least // count)
        found = 0.0

        def compare(one: State, other: State) -> None:
            nonlocal found
            found += self.distance(one, other)

        windows = self._line.compare_ahead(step, count, windows, compare)
        self._span = windows * count * step
        if not windows:
            return math.nan
        power = 2.0**method.order
        return found * power / (power - 1.0) / self._span

    def _steps_of_period(self, step: float, fastest: float) -> int:
        if not fastest > 0.0:
            return 1
        # Also where the period is beyond counting.
        return max(1, math.ceil(min(2.0 * math.pi / fastest / step, _LARGEST_MEASUREMENT)))

    def distance(self, first: State, second: State, rate: float = 0.0) -> float:
        """
        Largest error of a body: its position over a, or its orientation [rad].

        With a `rate` [rad/s] of vibrations also what its velocity and spin make of these.
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

    def floor(self, fastest: float) -> float:
        """What rounding adds to the error in each second: no step gives less."""
        extent = 1.0 + float(np.abs(self._line.state.position).max()) / self._half_edge
        return _ROUNDING * extent * fastest / (2.0 * math.pi)

    def require_possible(self, fastest: float) -> None:
        """Refuse a tolerance that doubles cannot give."""
        floor = self.floor(fastest)
        if not self.tolerance >= floor:
            raise ValueError(
                f'solver.tolerance {self.tolerance!r} 1/s is below what doubles can give here: '
                f'rounding adds about {floor:.2g} 1/s (positions are up to '
                f'{np.abs(self._line.state.position).max():.3g} m, vibrations up to '
                f'{fastest:.4g} rad/s); choose a larger one')


def _apart(first: np.ndarray, second: np.ndarray) -> float:
    """Largest squared distance of two vectors; components first, bodies last."""
    return float(((first - second) ** 2).reshape(-1, first.shape[-1]).sum(axis=0).max())


def checked_step(step: float, limit: float, frequency: float) -> None:
    """Refuse a fixed step that is too long or far too short."""
    if limit < math.inf and not step >= _SHORTEST_FIXED * limit:
        raise ValueError(
            f'solver.step {step!r} s is too short to come to an end with: the stability '
            f'limit is {limit:.6g} s; choose a longer one, or 0 to have it chosen'
        )
    if not step <= limit:
        raise ValueError(
            f'solver.step {step!r} s is beyond the stability limit '
            f'{limit:.6g} s of the method in this scene (largest frequency '
            f'{frequency:.6g} rad/s); choose a smaller one, or 0 to have it chosen'
        )


def rounded_down(step: float) -> float:
    """
    Nearest number below with a mantissa of 12 bits.

    So the last bits of the frequency hardly ever decide about the step.
    """
    mantissa, exponent = math.frexp(step)
    return math.ldexp(math.floor(mantissa * 4096.0) / 4096.0, exponent)
