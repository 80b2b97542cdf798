# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A shell that bounces on a vertex, with and without restitution, beside its formula."""

from collections.abc import Iterator

from icofabric_validation.named.loose_bodies import (
    Body,
    contact_time,
    FLOOR,
    GRAVITY,
    heights,
    simulate,
    standing,
    VERTICES,
)
from icofabric_validation.named.problem import Curve, Point, PremiseError, Problem
from icofabric_validation.named.restitution import (
    damping_for,
    TIP,
    VERTEX_SHARE,
)
from icofabric_validation.named.restitution import (
    restitution as speed_kept,
)
import numpy as np

_HEIGHT, _BOUNCES = 0.1, 4
_ROTATION = standing(VERTICES[0])


def _error(stiffness: float, damping: float, restitution: float | None) -> tuple[float, int]:
    """
    How far the speed of the last take-off is from the product of all restitutions, over it.

    A given restitution is one for all speeds; else that of the damping at each of them.
    """
    simulation = simulate(
        [Body((0.0, 0.0, TIP + _HEIGHT), rotation=_ROTATION)],
        {**FLOOR, 'gravity': [0.0, 0.0, -GRAVITY], 'contact.stiffness': stiffness,
         'contact.damping': damping, 'solver.tolerance': 1e-7})
    mass = simulation.scene.shell.mass
    speed = float(np.sqrt(2.0 * GRAVITY * _HEIGHT))
    time = speed / GRAVITY
    for _ in range(_BOUNCES):
        kept = restitution
        if kept is None:
            kept = speed_kept(damping, VERTEX_SHARE * speed)
        speed *= kept
        time += 2.0 * speed / GRAVITY
    # On the way up from the last bounce.
    simulation.advance_to(time - speed / GRAVITY)
    snapshot = simulation.snapshot()
    height = float(heights(simulation)[0]) - TIP
    # It is late by the contacts, so near the top of the flight after the last of them.
    late = _BOUNCES * contact_time(mass, stiffness) / VERTEX_SHARE
    top, fall = 0.5 * speed**2 / GRAVITY, float(snapshot.linear_velocity[0, 2])
    if not (0.0 < height < _HEIGHT and abs(height - top) < 0.1 * top
            and abs(fall) < 1.5 * GRAVITY * late):
        raise PremiseError(
            f'after {_BOUNCES} bounces it must be near the top of its flight, {top:.3g} m high, '
            f'and is at {height:.3g} m with {fall:.3g} m/s')
    found = np.sqrt(2.0 * (snapshot.energy['kinetic'] / mass + GRAVITY * height))
    return abs(float(found) - speed) / speed, simulation.status.step_count


def _solve(long: bool) -> Iterator[Curve]:
    stiffnesses = (1e4, 1e5, 1e6) + ((1e7, 1e8) if long else ())
    mass = simulate([Body((0.0, 0.0, 1.0))], {}).scene.shell.mass
    damping = damping_for(0.8, VERTEX_SHARE * float(np.sqrt(2.0 * GRAVITY * _HEIGHT)))
    points = []
    for stiffness in stiffnesses:
        error, steps = _error(stiffness, damping, None)
        points.append(Point(contact_time(mass, stiffness), error, steps))
    # Weight acts while they touch, for a time that falls with the root of the stiffness.
    yield Curve('dop8, restitution by damping', 'contact time [s]', tuple(points), 1e-2, order=1.0)
    error, steps = _error(1e6, 0.0, 1.0)
    yield Curve('dop8, no losses', 'restitution', (Point(1.0, error, steps),), 1e-12,
                is_refined=False)


PROBLEM = Problem(
    'bouncing', f'a shell on a vertex bounces {_BOUNCES} times',
    'Hunt and Crossley, J. Appl. Mech. 42, 440 (1975): u - ln(1 + u) = -e u - ln(1 - e u); '
    'SimBenchmark, bouncing',
    'speed after the last bounce against the product of the restitutions, relative', _solve,
    has_long_form=True)
