# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A shell that bounces on a vertex, with and without dissipation, compared with its formula."""

from collections.abc import Iterator

from icofabric_validation.named.loose_bodies import (
    Body,
    contact_time,
    FLOOR,
    GRAVITY,
    heights,
    rotate_down,
    simulate,
    VERTICES,
)
from icofabric_validation.named.problem import Curve, Point, PremiseError, Problem
from icofabric_validation.named.restitution import (
    damping_for,
    restitution_of,
    TIP,
    VERTEX_SHARE,
)
import numpy as np

_HEIGHT, _BOUNCES = 0.1, 4
_ROTATION = rotate_down(VERTICES[0])


def _error(stiffness: float, damping: float, restitution: float | None) -> tuple[float, int]:
    """
    Return the relative error of the speed after the last bounce, and the steps.

    The expected speed is the product of all restitutions: the given one, or that of the damping at
    the speed of each impact.
    """
    simulation = simulate(
        [Body((0.0, 0.0, TIP + _HEIGHT), rotation=_ROTATION)],
        {**FLOOR, 'gravity': [0.0, 0.0, -GRAVITY], 'contact.stiffness': stiffness,
         'contact.damping': damping, 'solver.tolerance': 1e-7})
    mass = simulation.scene.shell.mass
    speed = float(np.sqrt(2.0 * GRAVITY * _HEIGHT))
    time = speed / GRAVITY
    for _ in range(_BOUNCES):
        speed *= restitution_of(damping, VERTEX_SHARE * speed) if restitution is None else (
            restitution)
        time += 2.0 * speed / GRAVITY
    # At the top of the flight after the last bounce.
    simulation.advance_to(time - speed / GRAVITY)
    snapshot = simulation.snapshot()
    height = float(heights(simulation)[0]) - TIP
    # Contacts delay the shell, so the time is only near that of the top of the flight.
    late = _BOUNCES * contact_time(mass, stiffness) / VERTEX_SHARE
    top, fall = 0.5 * speed**2 / GRAVITY, float(snapshot.linear_velocity[0, 2])
    if not (0.0 < height < _HEIGHT and abs(height - top) < 0.1 * top
            and abs(fall) < 1.5 * GRAVITY * late):
        raise PremiseError(
            f'after {_BOUNCES} bounces the shell must be near the top of its flight, at '
            f'{top:.3g} m, but is at {height:.3g} m with {fall:.3g} m/s')
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
    # Weight acts during contacts, whose time falls with the square root of the stiffness.
    yield Curve('dop8, restitution by damping', 'contact time [s]', tuple(points), 1e-2, order=1.0)
    error, steps = _error(1e6, 0.0, 1.0)
    yield Curve('dop8, without dissipation', 'restitution', (Point(1.0, error, steps),), 1e-12,
                is_refined=False)


PROBLEM = Problem(
    'bouncing', f'a shell on a vertex bounces {_BOUNCES} times',
    'Hunt and Crossley, J. Appl. Mech. 42, 440 (1975): u - ln(1 + u) = -e u - ln(1 - e u); '
    'SimBenchmark, bouncing',
    'speed after the last bounce against the product of the restitutions, relative', _solve,
    has_long_form=True)
