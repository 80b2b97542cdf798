# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Work against precision on S1 and its variants: time for a required error."""

from collections.abc import Callable, Iterable
from functools import partial
from typing import NamedTuple

from icofabric_validation.benchmarks import own_methods
from icofabric_validation.benchmarks.contestants import Contestants, gather
from icofabric_validation.benchmarks.curves import Curve, run_once, trace
from icofabric_validation.benchmarks.kinked_reference import kinked_reference
from icofabric_validation.benchmarks.reference import Reference, reference_motion
from icofabric_validation.benchmarks.scenes import (
    DAMPED,
    DURATION,
    KINKED,
    plain_scene,
    PlainScene,
    SIZES,
)
from icofabric_validation.benchmarks.timing import in_rounds, Spread

TARGETS = (1e-3, 1e-6, 1e-9)
# Largest time [s] of points that are measured in rounds although no target needs them.
_MAX_EXTRA_TIME_S = 0.15
# Changes to S1.
VARIANTS = {'': None, 'kinked': KINKED, 'damped': DAMPED}


class WorkPrecision(NamedTuple):
    """All curves, with times of each point in all rounds."""

    scene: PlainScene
    reference: Reference
    contestants: Contestants
    curves: list[Curve]
    rounds: int

    def own_best(self, target: float) -> Curve | None:
        """Return the fastest curve of the package at an error."""
        ours = [curve for curve in self.curves
                if curve.solver.tool == own_methods.TOOL and not curve.time_at(target)[1]]
        return min(ours, key=lambda curve: curve.time_at(target)[0], default=None)

    def times(self, curve: Curve, target: float) -> tuple[Spread, bool]:
        """Return the times [s] of `curve` at an error over the rounds; True: extrapolated."""
        turns = [curve.time_at(target, turn) for turn in range(self.rounds)]
        return Spread.of([value for value, _ in turns]), turns[0][1]

    def ratios(self, curve: Curve, target: float) -> Spread | None:
        """Return the time of `curve` over the fastest of the package, round by round."""
        best = self.own_best(target)
        if best is None:
            return None
        return Spread.of([
            curve.time_at(target, turn)[0] / best.time_at(target, turn)[0]
            for turn in range(self.rounds)])


def measure(
    peers: Iterable[str], *, rounds: int = 5, longest_run: float = 2.0,
    size: tuple[int, int, int] = SIZES['S1'], duration: float = DURATION,
    variant: str = '', say: Callable[[str], None] = lambda text: None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> WorkPrecision:
    """
    Trace the curve of every contestant, then measure its points in interleaved rounds.

    `variant` is a key of VARIANTS: 'kinked' connectors are softer in compression, 'damped' ones
    have damping. SciPy is the only peer for these.
    """
    changes, kinked = VARIANTS[variant], variant == 'kinked'
    scene = plain_scene(f'S1 {variant}'.rstrip(), size, changes)
    say(f'{scene.name}: the reference motion')
    if variant:
        peers = [name for name in peers if name == 'scipy']
    reference = (kinked_reference if kinked else reference_motion)(scene, duration)
    contestants = gather(scene, size, peers, changes)
    curves = []
    for solver in contestants.solvers:
        say(f'{solver.label}: errors')
        # Errors with two stiffnesses are irregular, so the order does not help the search.
        curves.append(trace(
            solver, scene, reference, longest_run=longest_run, growth=2.0 if kinked else None))
        solver.close()
    tasks, points = [], []
    for curve in curves:
        needed = curve.needed(TARGETS)
        for point in curve.points:
            if point in needed or point.time < _MAX_EXTRA_TIME_S:
                points.append(point)
                tasks.append(partial(_measure, curve, point.setting, duration))
    say(f'{rounds} rounds of {len(tasks)} runs')
    for point, times in zip(points, in_rounds(tasks, rounds, progress)):
        point.times = times
    return WorkPrecision(scene, reference, contestants, curves, rounds)


def _measure(curve: Curve, setting: float, duration: float) -> float:
    spent = run_once(curve.solver, setting, duration)
    curve.solver.close()
    return spent
