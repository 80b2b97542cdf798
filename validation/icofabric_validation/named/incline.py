# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A shell on a face on an incline, compared with static limits of sticking and tipping."""

from collections.abc import Iterator
import math

from icofabric_sim.geometry.icosahedron import FACES, inscribed_radius, TAU
from icofabric_sim.simulation.simulation import Simulation
from icofabric_validation.named.loose_bodies import (
    A,
    Body,
    FLOOR,
    GRAVITY,
    NORMALS,
    rotate_down,
    simulate,
    VERTICES,
)
from icofabric_validation.named.mujoco_incline import is_installed, slide
from icofabric_validation.named.problem import Curve, Point, PremiseError, Problem
import numpy as np

# A friction coefficient so small that the shell slides before it tips; mass [kg].
_FRICTION, _MASS = 0.3, 1e-2
# Simulated time of each tilt [s], and the accuracy of the bisection over the limit of the tangent.
_TIPPING_TIME_S, _TANGENT_TOLERANCE_RATIO = 0.5, 1e-4
# The centre is rho = tau^2 a / sqrt(3) above the face. Its foot is a / sqrt(3) from the edges and
# twice that from the vertices.
TIPS_OVER_EDGE = math.atan(1.0 / TAU**2)
TIPS_OVER_VERTEX = math.atan(2.0 / TAU**2)


def _azimuth(over_vertex: bool) -> float:
    """Return the rotation about the vertical [rad] that turns a vertex or an edge towards x."""
    vertex = rotate_down(NORMALS[0]).apply(VERTICES[FACES[0, 0]])
    # An edge is opposite to each vertex.
    return -math.atan2(vertex[1], vertex[0]) + (0.0 if over_vertex else math.pi)


def on_face(
    tilt: float, *, friction: float, stiffness: float = 1e4, damping: float = 100.0,
    over_vertex: bool = False
) -> Simulation:
    """Compile a shell on a face, with weight towards x: across an edge or over a vertex."""
    azimuth = _azimuth(over_vertex)
    sunk = _MASS * GRAVITY * math.cos(tilt) / stiffness
    return simulate(
        [Body((0.0, 0.0, inscribed_radius(A) - sunk), rotation=rotate_down(NORMALS[0], azimuth))],
        {**FLOOR, 'shell.mass': _MASS, 'contact.friction': friction,
         'contact.stiffness': stiffness, 'contact.damping': damping, 'solver.tolerance': 1e-6,
         'gravity': [GRAVITY * math.sin(tilt), 0.0, -GRAVITY * math.cos(tilt)]})


def _sticks(long: bool) -> Iterator[Curve]:
    """Yield displacements below the sticking limit, and errors of the acceleration above."""
    limit = math.atan(_FRICTION)
    stays, slides = [], []
    for part in (0.5, 0.9, 0.99, 1.01, 1.1, 2.0):
        tilt = math.atan(part * _FRICTION)
        simulation = on_face(tilt, friction=_FRICTION, over_vertex=True)
        # Until vibrations of the friction springs are damped.
        simulation.advance_to(2.1 if tilt < limit else 0.3)
        before = simulation.snapshot()
        simulation.advance_to(simulation.time + (10.0 if long else 0.5))
        after = simulation.snapshot()
        steps = simulation.status.step_count
        if tilt < limit:
            moved = float(np.linalg.norm(after.position - before.position)) / A
            stays.append(Point(part, moved, steps))
        else:
            rate = (after.linear_velocity[0, 0] - before.linear_velocity[0, 0]) / (
                after.time - before.time)
            known = GRAVITY * (math.sin(tilt) - _FRICTION * math.cos(tilt))
            slides.append(Point(part, abs(float(rate) - known) / GRAVITY, steps))
    yield Curve(
        'sticks: displacement over a', 'tan(tilt) over mu', tuple(stays), 1e-8, is_refined=False)
    yield Curve(
        'slides: acceleration over g', 'tan(tilt) over mu', tuple(slides), 2e-13, is_refined=False)
    if is_installed():
        yield from _run_mujoco(simulation.scene.shell.inertia, 10.0 if long else 0.5)


def _run_mujoco(inertia: float, last: float) -> Iterator[Curve]:
    """Yield the results of MuJoCo at 0.9 and 1.1 of the limit."""
    for part, of in ((0.9, 'sticks: displacement over a'), (1.1, 'slides: acceleration over g')):
        tilt, points = math.atan(part * _FRICTION), []
        known = GRAVITY * (math.sin(tilt) - _FRICTION * math.cos(tilt))
        for step in (2e-3, 1e-3, 5e-4, 2.5e-4):
            moved, rate, steps = slide(
                tilt, _FRICTION, _MASS, inertia, _azimuth(True), step, 0.5, last)
            points.append(Point(
                step, moved if part < 1.0 else abs(rate - known) / GRAVITY, steps))
        yield Curve(f'MuJoCo, {of}', f'step [s], at {part:g}', tuple(points), is_comparison=True)


def _tips_over(tilt: float, stiffness: float, over_vertex: bool) -> bool:
    """Return True if a shell that cannot slide tips over from rest."""
    # Rocking is damped equally for all stiffnesses.
    simulation = on_face(
        tilt, friction=2.0, stiffness=stiffness, damping=3.0 * math.sqrt(stiffness),
        over_vertex=over_vertex)
    upright = simulation.snapshot().orientation[0]
    for time in _TIPPING_TIME_S * np.arange(1, 26) / 25.0:
        simulation.advance_to(float(time))
        turned = abs(float(upright @ simulation.snapshot().orientation[0]))
        # A shell that has turned this far cannot return; it may later lie on the same face again.
        if 2.0 * math.acos(min(1.0, turned)) > 0.1:
            return True
    return False


def _tipping_ratio(limit: float, stiffness: float, over_vertex: bool) -> float:
    """
    Return the tangent at which the shell tips over that of the `limit` [rad], by bisection.

    Each tilt starts from rest, because a rocking shell would tip early.
    """
    parts = [0.5, 1.2]
    for part in parts:
        if _tips_over(math.atan(part * math.tan(limit)), stiffness, over_vertex) == (part < 1.0):
            raise PremiseError(
                f'at {part:g} of the limit the shell must {"not " * (part < 1.0)}tip')
    while parts[1] - parts[0] > _TANGENT_TOLERANCE_RATIO:
        middle = 0.5 * sum(parts)
        tilt = math.atan(middle * math.tan(limit))
        parts[_tips_over(tilt, stiffness, over_vertex)] = middle
    return 0.5 * sum(parts)


def _tips(long: bool) -> Iterator[Curve]:
    """Yield errors of the tipping limit, which grow as softer contacts reduce the support area."""
    for over_vertex, limit, direction in (
            (False, TIPS_OVER_EDGE, 'across an edge'), (True, TIPS_OVER_VERTEX, 'over a vertex')):
        points = []
        for stiffness in (1e4, 1e5, 1e6) + ((1e7,) if long else ()):
            part = _tipping_ratio(limit, stiffness, over_vertex)
            sunk = _MASS * GRAVITY * math.cos(limit) / stiffness
            points.append(Point(sunk / A, abs(part - 1.0)))
        yield Curve(f'{direction}, {math.degrees(limit):.1f} degrees', 'depth over a',
                    tuple(points), 0.015)


SLIDES = Problem(
    'incline', 'a shell on a face on an incline: sticking limit', 'Coulomb: sliding above '
    'tan(tilt) = mu, with g (sin(tilt) - mu cos(tilt))',
    'displacement in the last half second over a (long: ten), or acceleration over g', _sticks,
    has_long_form=True)


TIPS = Problem(
    'tipping', 'a shell on a face on an incline: tipping limit',
    'statics: line of gravity at the edge, tan = 1 / tau^2, or at the vertex, 2 / tau^2',
    'relative error of the tangent of the tipping angle', _tips,
    has_long_form=True)
