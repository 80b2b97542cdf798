# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Impacts of Chung and Ooi (2011) at one point of a shell, compared with those of rigid bodies.

Impact 8, of spheres of two sizes, is left out. A rigid body is the limit of a short contact, so
errors fall with the contact time.
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
    rotate_down,
    simulate,
    UP,
    VERTICES,
)
from icofabric_validation.named.problem import Curve, Point, PremiseError, Problem
from icofabric_validation.named.restitution import damping_for, TIP, VERTEX_SHARE
import numpy as np
from scipy.spatial.transform import Rotation

# Initial gap [m], speed along the normal [m/s], friction coefficient and restitution.
_GAP, _SPEED, _FRICTION, _RESTITUTION = 1e-4, 1.0, 0.1, 0.8
_VERTEX_DOWN, _FACE_DOWN = rotate_down(VERTICES[0]), rotate_down(NORMALS[0])
_TOLERANCE, _SPIN = 1e-7, 60.0


def _simulate_impact(
    bodies: list[Body], stiffness: float, *, floor: bool, damping: float = 0.0,
    friction: float = 0.0
) -> tuple[np.ndarray, np.ndarray, float, float, int]:
    """Return velocities and spins after the impact, mass [kg], inertia [kg m^2] and steps."""
    simulation = simulate(bodies, {
        **(FLOOR if floor else {}), 'contact.stiffness': stiffness, 'contact.damping': damping,
        'contact.friction': friction, 'solver.tolerance': _TOLERANCE})
    shell = simulation.scene.shell
    simulation.advance_to(_GAP / _SPEED + 4.0 * contact_time(shell.mass, stiffness))
    if simulation.status.contact_count:
        raise PremiseError('the bodies are still in contact after the impact')
    snapshot = simulation.snapshot()
    return (snapshot.linear_velocity, snapshot.angular_velocity, float(shell.mass),
            float(shell.inertia), simulation.status.step_count)


def _normal(long: bool) -> Iterator[Curve]:
    """Yield impacts 1 to 3, along the line of centres, which do not depend on the stiffness."""
    # Opposite faces are parallel, because a shell is symmetric about its centre.
    reach = 2.0 * inscribed_radius(A) + _GAP
    points = []
    for speed in (_SPEED, -0.3):
        pair = [Body((0.0, 0.0, 0.1), (0.0, 0.0, speed), _FACE_DOWN),
                Body((0.0, 0.0, 0.1 + reach), (0.0, 0.0, speed - _SPEED), _FACE_DOWN)]
        velocity, spin, _, _, steps = _simulate_impact(pair, 1e6, floor=False)
        known = np.array([pair[1].velocity, pair[0].velocity])
        error = _velocity_error(velocity, known, spin, np.zeros((2, 3)))
        points.append(Point(speed, error, steps))
    yield Curve('1: two shells on faces', 'speed of one [m/s]', tuple(points), 3e-7,
                is_refined=False)
    points = []
    for number, (rotation, radius) in enumerate(
            ((_FACE_DOWN, inscribed_radius(A)), (_VERTEX_DOWN, TIP)), 1):
        velocity, spin, _, _, steps = _simulate_impact(
            [Body((radius + _GAP) * UP, -_SPEED * UP, rotation)], 1e6, floor=True)
        points.append(Point(
            float(number), _velocity_error(velocity, _SPEED * UP, spin, np.zeros(3)), steps))
    yield Curve('2: floor, on face (1), vertex (2)', 'case', tuple(points), 3e-7, is_refined=False)
    points = []
    for restitution in (0.9, 0.7, 0.5, 0.3):
        damping = damping_for(restitution, VERTEX_SHARE * _SPEED)
        velocity, spin, _, _, steps = _simulate_impact(
            [Body((TIP + _GAP) * UP, -_SPEED * UP, _VERTEX_DOWN)], 1e6, floor=True,
            damping=damping)
        error = _velocity_error(velocity, restitution * _SPEED * UP, spin, np.zeros(3))
        points.append(Point(restitution, error, steps))
    yield Curve('3: floor, damped', 'restitution', tuple(points), 3e-7, is_refined=False)


def _oblique(long: bool) -> Iterator[Curve]:
    """
    Yield impacts 4 to 7 with slip during the whole contact, and an impact off the centre.

    Impacts that stick before separation depend on the friction springs and have no such answer.
    """
    damping = damping_for(_RESTITUTION, VERTEX_SHARE * _SPEED)
    stiffnesses = (1e6, 1e7, 1e8) + ((1e9, 1e10) if long else ())
    # Below 0.604 m/s along the floor, mu (1 + e) (1 + m R^2 / I) times the normal speed, the shell
    # sticks before separation.
    for of, tangential, spin, allowed in (
            ('4, 5: floor, flat angle', 2.0, 0.0, 5e-3),
            ('4, 5: floor, close to sticking', 0.65, 0.0, 5e-3),
            ('6: floor, spinning', 0.0, 80.0, 2e-2)):
        points = []
        for stiffness in stiffnesses:
            velocity, turned, mass, inertia, steps = _simulate_impact(
                [Body((TIP + _GAP) * UP, (tangential, 0.0, -_SPEED),
                      _with_spin(_VERTEX_DOWN, spin), (0.0, spin, 0.0))],
                stiffness, floor=True, damping=damping, friction=_FRICTION)
            # The slip velocity is v_x - R w_y, and the friction impulse mu times the normal one.
            impulse_speed = (1.0 + _RESTITUTION) * _SPEED
            slowed = -math.copysign(_FRICTION * impulse_speed, tangential - TIP * spin)
            known = np.array([tangential + slowed, 0.0, _RESTITUTION * _SPEED])
            known_spin = np.array([0.0, spin - TIP * mass * slowed / inertia, 0.0])
            error = _velocity_error(velocity, known, turned, known_spin)
            points.append(Point(contact_time(mass, stiffness), error, steps))
        yield Curve(of, 'contact time [s]', tuple(points), allowed, order=1.0)
    points = []
    for stiffness in stiffnesses:
        # The upper face is parallel to the lower one.
        pair = [
            Body((0.0, 0.0, 0.1), rotation=_with_spin(_FACE_DOWN, _SPIN), spin=(0.0, _SPIN, 0.0)),
            Body((0.0, 0.0, 0.1 + inscribed_radius(A) + TIP + _GAP), -_SPEED * UP,
                 _with_spin(_VERTEX_DOWN, _SPIN), (0.0, _SPIN, 0.0))]
        velocity, turned, mass, inertia, steps = _simulate_impact(
            pair, stiffness, floor=False, damping=damping_for(_RESTITUTION, VERTEX_SHARE * _SPEED),
            friction=_FRICTION)
        # The slip velocity is -(R + rho) w; each shell gets half of the change of velocity.
        impulse_speed = 0.5 * (1.0 + _RESTITUTION) * _SPEED
        slowed = _FRICTION * impulse_speed
        known = np.array([[-slowed, 0.0, -impulse_speed], [slowed, 0.0, impulse_speed - _SPEED]])
        known_spin = np.array([
            [0.0, _SPIN - inscribed_radius(A) * mass * slowed / inertia, 0.0],
            [0.0, _SPIN - TIP * mass * slowed / inertia, 0.0]])
        error = _velocity_error(velocity, known, turned, known_spin)
        points.append(Point(contact_time(mass, stiffness), error, steps))
    yield Curve('7: vertex on face, both spinning', 'contact time [s]', tuple(points), 2e-2,
                order=1.0)
    points = []
    rotation = Rotation.from_rotvec([0.25, 0.1, 0.0]) * _VERTEX_DOWN
    arm = rotation.apply(VERTICES[0])
    for stiffness in stiffnesses:
        velocity, turned, mass, inertia, steps = _simulate_impact(
            [Body((-float(arm[2]) + _GAP) * UP, (0.4, 0.0, -_SPEED), rotation)],
            stiffness, floor=True)
        lever = np.cross(arm, UP)
        impulse = 2.0 * _SPEED / (1.0 / mass + lever @ lever / inertia)
        known = np.array([0.4, 0.0, -_SPEED]) + impulse / mass * UP
        points.append(Point(
            contact_time(mass, stiffness),
            _velocity_error(velocity, known, turned, impulse * lever / inertia), steps))
    yield Curve('floor, off the centre, no friction', 'contact time [s]', tuple(points), 2e-2,
                order=1.0)


def _with_spin(rotation: Rotation, spin: float) -> Rotation:
    """Return the initial rotation that becomes `rotation` at first contact by a spin about y."""
    return Rotation.from_rotvec([0.0, -spin * _GAP / _SPEED, 0.0]) * rotation


def _velocity_error(
    velocity: np.ndarray, known: np.ndarray, spin: np.ndarray, known_spin: np.ndarray
) -> float:
    """Return the largest error of velocities, and spins times the radius, over the speed."""
    return float(max(
        np.abs(velocity - known).max(), TIP * np.abs(spin - known_spin).max()) / _SPEED)


NORMAL = Problem(
    'normal_impacts', 'impacts along the normal, with and without damping',
    'Chung and Ooi, Granular Matter 13, 643 (2011), impacts 1 to 3',
    'largest error of a velocity, or of a spin times the radius, over the speed', _normal)
OBLIQUE = Problem(
    'oblique_impacts', 'impacts with slip and spin, and off the centre',
    'Chung and Ooi, Granular Matter 13, 643 (2011), impacts 4 to 7; Routh: one impulse',
    'largest error of a velocity, or of a spin times the radius, over the speed', _oblique,
    has_long_form=True)
