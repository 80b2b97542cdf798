# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Impacts after Chung and Ooi (2011), in one point of a shell, beside those of rigid bodies.

Their spheres of two sizes (impact 8) are left out: all shells are alike. A rigid body is the limit
of a short contact, so errors fall with the time of contact.
"""

from collections.abc import Iterator
import math

from icofabric_sim.geometry.icosahedron import inscribed_radius
from icofabric_validation.named.loose_bodies import (
    A,
    Body,
    contact_time,
    FLOOR,
    NORMALS,
    simulate,
    standing,
    UP,
    VERTICES,
)
from icofabric_validation.named.problem import Curve, Point, PremiseError, Problem
from icofabric_validation.named.restitution import damping_for, TIP, VERTEX_SHARE
import numpy as np
from scipy.spatial.transform import Rotation

# Way to first touch [m], speed along the normal [m/s], friction where they slide, restitution.
_GAP, _SPEED, _FRICTION, _KEPT = 1e-4, 1.0, 0.1, 0.8
_ON_VERTEX, _ON_FACE = standing(VERTICES[0]), standing(NORMALS[0])
_TOLERANCE, _SPIN = 1e-7, 60.0


def _after(
    bodies: list[Body], stiffness: float, *, floor: bool, damping: float = 0.0,
    friction: float = 0.0
) -> tuple[np.ndarray, np.ndarray, float, float, int]:
    """Velocities and spins after the impact, mass [kg], inertia [kg m^2], steps."""
    simulation = simulate(bodies, {
        **(FLOOR if floor else {}), 'contact.stiffness': stiffness, 'contact.damping': damping,
        'contact.friction': friction, 'solver.tolerance': _TOLERANCE})
    shell = simulation.scene.shell
    simulation.advance_to(_GAP / _SPEED + 4.0 * contact_time(shell.mass, stiffness))
    if simulation.status.contact_count:
        raise PremiseError('bodies must have parted, and touch still')
    snapshot = simulation.snapshot()
    return (snapshot.linear_velocity, snapshot.angular_velocity, float(shell.mass),
            float(shell.inertia), simulation.status.step_count)


def _normal(long: bool) -> Iterator[Curve]:
    """Impacts 1 to 3: along the line of centres, where nothing depends on the stiffness."""
    # Faces that look at each other are parallel, since a shell is symmetric about its centre.
    reach = 2.0 * inscribed_radius(A) + _GAP
    points = []
    for speed in (_SPEED, -0.3):
        pair = [Body((0.0, 0.0, 0.1), (0.0, 0.0, speed), _ON_FACE),
                Body((0.0, 0.0, 0.1 + reach), (0.0, 0.0, speed - _SPEED), _ON_FACE)]
        velocity, spin, _, _, steps = _after(pair, 1e6, floor=False)
        known = np.array([pair[1].velocity, pair[0].velocity])
        points.append(Point(speed, _apart(velocity, known, spin, np.zeros((2, 3))), steps))
    yield Curve('1: two shells on faces', 'speed of one [m/s]', tuple(points), 3e-7,
                is_refined=False)
    points = []
    for number, (rotation, radius) in enumerate(
            ((_ON_FACE, inscribed_radius(A)), (_ON_VERTEX, TIP)), 1):
        velocity, spin, _, _, steps = _after(
            [Body((radius + _GAP) * UP, -_SPEED * UP, rotation)], 1e6, floor=True)
        points.append(Point(
            float(number), _apart(velocity, _SPEED * UP, spin, np.zeros(3)), steps))
    yield Curve('2: floor, on face (1), vertex (2)', 'case', tuple(points), 3e-7, is_refined=False)
    points = []
    for wanted in (0.9, 0.7, 0.5, 0.3):
        damping = damping_for(wanted, VERTEX_SHARE * _SPEED)
        velocity, spin, _, _, steps = _after(
            [Body((TIP + _GAP) * UP, -_SPEED * UP, _ON_VERTEX)], 1e6, floor=True, damping=damping)
        points.append(Point(
            wanted, _apart(velocity, wanted * _SPEED * UP, spin, np.zeros(3)), steps))
    yield Curve('3: floor, damped', 'restitution', tuple(points), 3e-7, is_refined=False)


def _oblique(long: bool) -> Iterator[Curve]:
    """
    Impacts 4 to 7 where they slip all the time, along the floor or another shell; off the centre.

    What sticks before it parts depends on the springs of friction, and has no such answer.
    """
    damping = damping_for(_KEPT, VERTEX_SHARE * _SPEED)
    stiffnesses = (1e6, 1e7, 1e8) + ((1e9, 1e10) if long else ())
    # Below 0.604 m/s along the floor it sticks before it parts: mu (1 + e) (1 + m R^2 / I) of the
    # speed.
    for of, way, spin, allowed in (
            ('4, 5: floor, flat angle', 2.0, 0.0, 5e-3),
            ('4, 5: floor, close to sticking', 0.65, 0.0, 5e-3),
            ('6: floor, spinning', 0.0, 80.0, 2e-2)):
        points = []
        for stiffness in stiffnesses:
            velocity, turned, mass, inertia, steps = _after(
                [Body((TIP + _GAP) * UP, (way, 0.0, -_SPEED),
                      _with_spin(_ON_VERTEX, spin), (0.0, spin, 0.0))],
                stiffness, floor=True, damping=damping, friction=_FRICTION)
            # It slips by v_x - R w_y all the time, and friction is mu times the push.
            push = (1.0 + _KEPT) * _SPEED
            rubbed = -math.copysign(_FRICTION * push, way - TIP * spin)
            known = np.array([way + rubbed, 0.0, _KEPT * _SPEED])
            known_spin = np.array([0.0, spin - TIP * mass * rubbed / inertia, 0.0])
            points.append(Point(
                contact_time(mass, stiffness), _apart(velocity, known, turned, known_spin), steps))
        yield Curve(of, 'contact time [s]', tuple(points), allowed, order=1.0)
    points = []
    for stiffness in stiffnesses:
        # A face looks up as another one looks down.
        pair = [
            Body((0.0, 0.0, 0.1), rotation=_with_spin(_ON_FACE, _SPIN), spin=(0.0, _SPIN, 0.0)),
            Body((0.0, 0.0, 0.1 + inscribed_radius(A) + TIP + _GAP), -_SPEED * UP,
                 _with_spin(_ON_VERTEX, _SPIN), (0.0, _SPIN, 0.0))]
        velocity, turned, mass, inertia, steps = _after(
            pair, stiffness, floor=False, damping=damping_for(_KEPT, VERTEX_SHARE * _SPEED),
            friction=_FRICTION)
        # The upper one slips by -(R + rho) w over the lower one; each is pushed by half.
        push = 0.5 * (1.0 + _KEPT) * _SPEED
        rubbed = _FRICTION * push
        known = np.array([[-rubbed, 0.0, -push], [rubbed, 0.0, push - _SPEED]])
        known_spin = np.array([
            [0.0, _SPIN - inscribed_radius(A) * mass * rubbed / inertia, 0.0],
            [0.0, _SPIN - TIP * mass * rubbed / inertia, 0.0]])
        points.append(Point(
            contact_time(mass, stiffness), _apart(velocity, known, turned, known_spin), steps))
    yield Curve('7: vertex on face, both spinning', 'contact time [s]', tuple(points), 2e-2,
                order=1.0)
    points = []
    rotation = Rotation.from_rotvec([0.25, 0.1, 0.0]) * _ON_VERTEX
    arm = rotation.apply(VERTICES[0])
    for stiffness in stiffnesses:
        velocity, turned, mass, inertia, steps = _after(
            [Body((-float(arm[2]) + _GAP) * UP, (0.4, 0.0, -_SPEED), rotation)],
            stiffness, floor=True)
        lever = np.cross(arm, UP)
        impulse = 2.0 * _SPEED / (1.0 / mass + lever @ lever / inertia)
        known = np.array([0.4, 0.0, -_SPEED]) + impulse / mass * UP
        points.append(Point(
            contact_time(mass, stiffness),
            _apart(velocity, known, turned, impulse * lever / inertia), steps))
    yield Curve('floor, off the centre, no friction', 'contact time [s]', tuple(points), 2e-2,
                order=1.0)


def _with_spin(rotation: Rotation, spin: float) -> Rotation:
    """The rotation at the start that becomes this one at first touch, by a spin about y."""
    return Rotation.from_rotvec([0.0, -spin * _GAP / _SPEED, 0.0]) * rotation


def _apart(
    velocity: np.ndarray, known: np.ndarray, spin: np.ndarray, known_spin: np.ndarray
) -> float:
    """Largest difference of velocities, spins times the radius included, over the speed."""
    return float(max(
        np.abs(velocity - known).max(), TIP * np.abs(spin - known_spin).max()) / _SPEED)


NORMAL = Problem(
    'normal_impacts', 'impacts along the normal, with and without losses',
    'Chung and Ooi, Granular Matter 13, 643 (2011), impacts 1 to 3',
    'largest error of a velocity, or of a spin times the radius, over the speed', _normal)
OBLIQUE = Problem(
    'oblique_impacts', 'impacts with slip and spin, and off the centre',
    'Chung and Ooi, Granular Matter 13, 643 (2011), impacts 4 to 7; Routh: one impulse',
    'largest error of a velocity, or of a spin times the radius, over the speed', _oblique,
    has_long_form=True)
