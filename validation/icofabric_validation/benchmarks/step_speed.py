# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Time of a plain step on S3: steps of each tool, all of the same length."""

from collections.abc import Callable, Iterable
from functools import partial
from typing import NamedTuple

from icofabric_validation.benchmarks import own_methods
from icofabric_validation.benchmarks.contestants import Contestants, gather
from icofabric_validation.benchmarks.reference import Reference, reference_motion
from icofabric_validation.benchmarks.scenes import motion_error, plain_scene, PlainScene, SIZES
from icofabric_validation.benchmarks.solver import StepSolver, Unusable
from icofabric_validation.benchmarks.timing import in_rounds, Spread, STEPS_BLOCK_S, timed

# Step [s], and time [s] at which motions are compared with the reference.
STEP, CHECKED = 1e-4, 2e-3
# Evaluations of all forces in a timed run, with two health checks of the package, and steps
# before.
_EVALUATIONS, _WARM_UP = 128, 2
# Largest distance of a correct motion from the reference at CHECKED; that of leapfrog is 5e-5.
_MAX_ERROR = 1e-2


class StepTime(NamedTuple):
    """Times of one solver, one for each round."""

    solver: StepSolver
    times: list[float]  # [s] for each step
    error: float  # after CHECKED

    def per_connector(self, scene: PlainScene) -> Spread:
        """Return the time of a step per connector [ns]."""
        return Spread.of([value * 1e9 / scene.connector_count for value in self.times])


class StepSpeed(NamedTuple):
    """Results of all solvers, those of the package first."""

    scene: PlainScene
    reference: Reference
    contestants: Contestants
    rows: list[StepTime]
    remarks: list[str]
    rounds: int

    def own_best(self) -> StepTime | None:
        """Return the cheapest step of the package."""
        ours = [row for row in self.rows if row.solver.tool == own_methods.TOOL]
        return min(ours, key=lambda row: Spread.of(row.times).median, default=None)

    def ratios(self, row: StepTime) -> Spread | None:
        """Return the time of a step over the cheapest of the package, round by round."""
        best = self.own_best()
        if best is None:
            return None
        return Spread.of([one / other for one, other in zip(row.times, best.times)])


def measure(
    peers: Iterable[str], *, rounds: int = 5, size: tuple[int, int, int] = SIZES['S3'],
    say: Callable[[str], None] = lambda text: None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> StepSpeed:
    """Compare the motions of all tools, then time steps in rounds."""
    say('the reference motion')
    scene = plain_scene('S3', size)
    reference = reference_motion(scene, CHECKED, growth_samples=0)
    contestants = gather(scene, size, peers)
    rows, remarks, tasks = [], [], []
    for solver in contestants.solvers:
        if not isinstance(solver, StepSolver):
            continue
        say(f'{solver.label}: the same motion?')
        try:
            solver.start(STEP)
            solver.advance(round(CHECKED / STEP))
        except Unusable as problem:
            remarks.append(f'{solver.label}: {problem}')
            continue
        error = motion_error(solver.motion(), reference.motion, scene.half_edge)
        if not error < _MAX_ERROR:
            remarks.append(f'{solver.label} moves otherwise: {error:.1e} after {CHECKED} s')
            continue
        rows.append(StepTime(solver, [], error))
        tasks.append(partial(_block, solver))
    say(f'{rounds} rounds of {len(tasks)} solvers')
    results = in_rounds(tasks, rounds, progress)
    timed = [row._replace(times=times) for row, times in zip(rows, results)]
    return StepSpeed(scene, reference, contestants, timed, remarks, rounds)


def _block(solver: StepSolver) -> float:
    """Return the time of a step [s], from the same start each time."""
    count = -(-_EVALUATIONS // solver.evaluations)

    def prepare() -> None:
        solver.start(STEP)
        # The system provides memory of the start during the first steps.
        solver.advance(_WARM_UP)

    return timed(prepare, lambda: solver.advance(count), block=STEPS_BLOCK_S) / count
