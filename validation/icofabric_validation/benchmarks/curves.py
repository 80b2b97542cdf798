# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Work against precision of one solver: error and time from coarse to fine settings."""

from dataclasses import dataclass, field
import math
import statistics
import time

from icofabric_validation.benchmarks.reference import Reference
from icofabric_validation.benchmarks.scenes import motion_error, PlainScene
from icofabric_validation.benchmarks.solver import Solver, StepSolver, ToleranceSolver, Unusable
from icofabric_validation.benchmarks.timing import timed

# Largest and smallest errors of interest: larger ones are another motion, smaller ones may be
# errors of the reference.
_MAX_ERROR, _MIN_ERROR = 0.3, 3e-11
# An error below this that does not decrease further is round-off.
_ROUND_OFF_ERROR = 1e-6
# Largest number of refused steps at the coarse end.
_MAX_REFUSALS = 12


@dataclass
class Point:
    """One setting: a number of steps, or a tolerance."""

    setting: float
    error: float
    times: list[float] = field(default_factory=list)  # [s], one for each round

    @property
    def time(self) -> float:
        """Median time [s]."""
        return statistics.median(self.times)


@dataclass
class Curve:
    """A solver and its points, from coarse to fine."""

    solver: Solver
    points: list[Point]
    remark: str = ''

    def needed(self, targets: tuple[float, ...]) -> list[Point]:
        """Return the points that determine the times at the errors `targets`."""
        chosen: list[Point] = []
        for target in targets:
            for k in self._around(target):
                if self.points[k] not in chosen:
                    chosen.append(self.points[k])
        return chosen

    def time_at(self, target: float, turn: int | None = None) -> tuple[float, bool]:
        """
        Return the time [s] for the error `target`, from the medians or from round `turn`.

        The time is interpolated on logarithmic scales, unless a finer run takes less. If the
        finest point is too coarse, the curve is extrapolated with the order of the solver and the
        second value is True; without an order the time is infinite.
        """
        def spent(point: Point) -> float:
            return point.time if turn is None else point.times[turn % len(point.times)]

        around = self._around(target)
        if not around:
            return math.inf, True
        last = self.points[around[-1]]
        if last.error > target:
            if self.solver.order == 0:
                return math.inf, True
            return spent(last) * (last.error / target) ** (1.0 / self.solver.order), True
        if len(around) == 1:
            return spent(last), False
        before = self.points[around[0]]
        return _between(before, last, target, spent(before), spent(last)), False

    def observed_order(self) -> float:
        """
        Slope of the error over the step, between round-off and the loss of the motion.

        NaN with fewer than three such points, or without given steps.
        """
        if not isinstance(self.solver, StepSolver):
            return math.nan
        clean = [point for point in self.points if 10.0 * _MIN_ERROR < point.error < 2e-2]
        # The finest points show the order best.
        clean = clean[-4:]
        if len(clean) < 3:
            return math.nan
        x = [math.log(point.setting) for point in clean]
        y = [math.log(point.error) for point in clean]
        return -statistics.linear_regression(x, y).slope

    def _around(self, target: float) -> list[int]:
        good = [k for k, point in enumerate(self.points) if point.error <= target]
        if not good:
            return [len(self.points) - 1] if self.points else []
        # A finer run may take less: health checks cost more near the stability limit.
        # The medians select the point for all rounds.
        best = min(good, key=lambda k: self.points[k].time)
        if good[0] == 0:
            return [best]
        before, last = self.points[good[0] - 1], self.points[good[0]]
        between = _between(before, last, target, before.time, last.time)
        return [best] if self.points[best].time < between else [good[0] - 1, good[0]]


def _between(
    before: Point, last: Point, target: float, time_before: float, time_last: float
) -> float:
    """Interpolate the time at the error `target` on logarithmic scales."""
    part = math.log(before.error / target) / math.log(before.error / last.error)
    return float(time_before ** (1.0 - part) * time_last**part)


def run_once(solver: Solver, setting: float, duration: float) -> float:
    """Return the time [s] of a run over `duration` [s]."""
    if isinstance(solver, StepSolver):
        steps, count = solver, round(setting)
        return timed(lambda: steps.start(duration / count), lambda: steps.advance(count))
    assert isinstance(solver, ToleranceSolver)
    tolerant = solver
    return timed(lambda: tolerant.start(setting, duration), tolerant.finish)


def trace(
    solver: Solver, scene: PlainScene, reference: Reference, *, longest_run: float,
    growth: float | None = None
) -> Curve:
    """
    Run `solver` from coarse to fine until the error is small or a run takes too long [s].

    Times are those of single runs, for a plot; rounds replace the times of important points. Each
    run takes `growth` times as many steps as the one before; the default suits the order of the
    method.
    """
    curve = Curve(solver, [])
    refused = 0
    warm = False
    for setting in _settings(solver, reference.duration, growth):
        try:
            if not warm:
                # Compilation and allocation of the first use are not timed.
                run_once(solver, setting, reference.duration)
                warm = True
            started = time.perf_counter()
            spent = run_once(solver, setting, reference.duration)
            wall = time.perf_counter() - started
            error = motion_error(solver.motion(), reference.motion, scene.half_edge)
        except Unusable as problem:
            refused += 1
            curve.remark = str(problem)
            if refused > _MAX_REFUSALS or curve.points:
                break
            continue
        if error > _MAX_ERROR:
            continue
        curve.points.append(Point(setting, error, [spent]))
        if error < max(_MIN_ERROR, 5.0 * reference.uncertainty):
            break
        # If stability limits the step, several tolerances give the same error.
        stuck = len(curve.points) > 1 and 0.7 * curve.points[-2].error < error < _ROUND_OFF_ERROR
        if stuck and isinstance(solver, StepSolver) and growth is None:
            curve.remark = 'the error falls no further: round-off'
            curve.points.pop()
            break
        if max(spent, wall / 9.0) * (growth or _growth(solver)) > longest_run:
            curve.remark = f'a finer run would take more than {longest_run:g} s'
            break
    if curve.points:
        curve.remark = '' if curve.points[-1].error < 1e-9 else curve.remark
    return curve


def _growth(solver: Solver) -> float:
    if isinstance(solver, StepSolver):
        return 2.0 if solver.order <= 2 else 2.0**0.25
    return 1.4


def _settings(solver: Solver, duration: float, growth: float | None) -> list[float]:
    if not isinstance(solver, StepSolver):
        assert isinstance(solver, ToleranceSolver)
        return [solver.roughest * 10.0**-k for k in range(13)]
    first = math.ceil(duration / solver.longest)
    counts = (math.ceil(first * (growth or _growth(solver)) ** k) for k in range(60))
    return [float(count) for count in dict.fromkeys(counts)]
