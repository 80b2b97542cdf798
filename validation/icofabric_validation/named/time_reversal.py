# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A free slab forward and backward in time: reversible methods return for any step."""

from collections.abc import Iterator

from icofabric_sim.scene.scene import load_scene
from icofabric_sim.simulation.simulation import compile_scene
from icofabric_validation.named.problem import Curve, Point, PremiseError, Problem
import numpy as np

# Small motion is not chaotic, so round-off hardly grows until this time [s].
_END = 0.2


def _error(method: str, step: float) -> tuple[float, int]:
    """Return the distance from the start over a after the motion and its reversal, and steps."""
    scene = load_scene('free_slab').with_changes({
        'solver.method': method, 'solver.step': step, 'solver.threads': 1,
        'contact.mode': 'never'})
    simulation = compile_scene(scene)
    first = simulation.snapshot()
    # Whole steps, so that the reversed motion has the same steps.
    count = round(_END / step)
    simulation.advance_to(count * step)
    there = simulation.snapshot()
    simulation.set_state(
        linear_velocity=-there.linear_velocity, angular_velocity=-there.angular_velocity)
    simulation.advance_to(2.0 * count * step)
    back, a = simulation.snapshot(), 0.5 * scene.shell.edge_length
    moved = np.abs(there.position - first.position).max()
    if not moved > 0.1 * a:
        raise PremiseError(f'nothing moved: {moved!r} m')
    return float(np.abs(back.position - first.position).max() / a), simulation.status.step_count


def _solve(long: bool) -> Iterator[Curve]:
    for method, steps in (
            ('leapfrog', (4e-4, 2e-4, 1e-4)), ('srkn4', (1e-3, 5e-4, 2.5e-4)),
            ('srkn6', (1e-3, 5e-4, 2.5e-4)), ('srkn8', (1e-3, 5e-4, 2.5e-4))):
        points = []
        for step in steps:
            error, taken = _error(method, step)
            points.append(Point(step, error, taken))
        yield Curve(
            f'{method}: reversible', 'step [s]', tuple(points), 1e-11, is_refined=False)
    points = []
    for step in (1.6e-3, 8e-4, 4e-4):
        error, taken = _error('dop8', step)
        points.append(Point(step, error, taken))
    yield Curve('dop8: not reversible', 'step [s]', tuple(points), 1e-6, order=8.0, floor=1e-12)


PROBLEM = Problem(
    'time_reversal', 'free_slab, forward and backward', 'the equations of motion are reversible',
    'distance from the start, over a', _solve)
