# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Two readable references of the equations of motion, integrated to 1e-12 by SciPy's DOP853.

"A Mathematical Model of Icosahedral Materials", eqs 45-49, for every body k:

    M R'' = sum F                              (45; gravity: F = M g)
    d(I omega)/dt + omega x I omega = sum r' x F
    dq/dt = omega q / 2                        or    de_i/dt = omega x e_i

With I = Lambda 1 the product omega x I omega vanishes, and Lambda d(omega)/dt = sum r' x F in
every frame (eqs 11, 13, 45, corrected: both terms together only with the body-frame derivative).
As first-order systems the two forms have 13 and 18 unknowns for each body (the document counts
R'' once and says 10 N and 15 N). A connector between r1 and r2 (eq 49) pulls I1 with
k (|r1 - r2| - D) (r2 - r1) / |r1 - r2| and I2 with the opposite, or by connector.law exponential.

Nothing here is shared with the compiled simulation but the scene.
"""

from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

TOLERANCE = 1e-12


class Motion(NamedTuple):
    """State at one time, world frame."""

    position: np.ndarray  # R (n, 3) [m]
    axes: np.ndarray  # mu (n, 3, 3), row i is e_i in world components
    linear_velocity: np.ndarray  # R' (n, 3) [m/s]
    angular_velocity: np.ndarray  # omega (n, 3) [rad/s]


def axes_of(quaternion):
    """Return the direction cosines (n, 3, 3) of unit quaternions (n, 4): e_i = q e0_i q*."""
    v, w = quaternion[:, :3], quaternion[:, 3:]
    rows = []
    for unit in np.eye(3):
        twice = 2.0 * np.cross(v, unit)
        rows.append(unit + w * twice + np.cross(v, twice))
    return np.stack(rows, axis=1)


def resultants(scene, position, axes):
    """Sum of the forces and of their moments about each centre, (n, 3) and (n, 3)."""
    force = np.zeros_like(position)
    moment = np.zeros_like(position)

    def act(body, at, pull):
        force[body] += pull
        moment[body] += np.cross(at - position[body], pull)

    force += scene.shell.mass * np.array(scene.parameters['gravity'])
    connectors = scene.connectors
    laws = [np.broadcast_to(values, len(connectors)) for values in connectors.laws]
    for (first, second), (point1, point2), *law in zip(
            connectors.bodies, connectors.points_body, *laws):
        r1 = position[first] + point1 @ axes[first]
        r2 = position[second] + point2 @ axes[second]
        length = np.sqrt((r2 - r1) @ (r2 - r1))
        extension, compression, natural = law
        k = extension if length > natural else compression
        tension = k * (length - natural)
        if scene.parameters['connector.law'] == 'exponential':
            alpha = scene.parameters['connector.alpha']
            tension = k / alpha * (np.exp(alpha * (length - natural)) - 1.0)
        pull = tension * (r2 - r1) / length
        act(first, r1, pull)
        act(second, r2, -pull)
    for load in scene.loads.values():
        part = len(load.bodies) if load.is_divided else 1
        for body in load.bodies:
            to_world = axes[body] if load.in_body_axes else np.eye(3)
            act(body, position[body] + load.point @ axes[body], load.force @ to_world / part)
            moment[body] += load.torque @ to_world / part
    return force, moment


def accelerations(scene, position, axes):
    """R'' and d(omega)/dt; zero in held freedoms."""
    force, moment = resultants(scene, position, axes)
    linear, angular = force / scene.shell.mass, moment / scene.shell.inertia
    if scene.supports is not None:
        linear[scene.supports.translation] = 0.0
        angular[scene.supports.rotation] = 0.0
    return linear, angular


def _integrate(derivative, parts, scales, duration):
    shapes = [part.shape for part in parts]
    ends = np.cumsum([part.size for part in parts])[:-1]

    def split(vector):
        return [piece.reshape(shape) for piece, shape in zip(np.split(vector, ends), shapes)]

    def flat(time, vector):
        return np.concatenate([piece.ravel() for piece in derivative(*split(vector))])

    solution = solve_ivp(
        flat,
        (0.0, duration),
        np.concatenate([part.ravel() for part in parts]),
        method='DOP853',
        rtol=TOLERANCE,
        atol=TOLERANCE * np.repeat(scales, [part.size for part in parts]),
        t_eval=[duration],
    )
    assert solution.success, solution.message
    return split(solution.y[:, -1])


def _scales(scene, duration):
    # Position over a, everything else in radians and durations: the same run at any size.
    a = scene.geometry.half_edge
    return a, 1.0, a / duration, 1.0 / duration


def integrate_quaternions(scene, duration):
    """Motion of a `scene` from its initial state after `duration` [s], eqs 21-27 and 45-49."""

    def derivative(position, quaternion, velocity, omega):
        linear, angular = accelerations(scene, position, axes_of(quaternion))
        # dq/dt = omega q / 2 with the pure quaternion omega (eq 22), scalar last.
        v, w = quaternion[:, :3], quaternion[:, 3:]
        rate = 0.5 * np.hstack(
            [w * omega + np.cross(omega, v), -(omega * v).sum(axis=1, keepdims=True)]
        )
        return velocity, rate, linear, angular

    position, quaternion, velocity, omega = _integrate(
        derivative, scene.initial, _scales(scene, duration), duration
    )
    norm = np.linalg.norm(quaternion, axis=1, keepdims=True)
    return Motion(position, axes_of(quaternion / norm), velocity, omega)


def integrate_cosines(scene, duration):
    """Motion of a `scene` from its initial state after `duration` [s], eqs 16-20 and 45-49."""

    def derivative(position, axes, velocity, omega):
        linear, angular = accelerations(scene, position, axes)
        # de_i/dt = omega x e_i (eq 19), for the three axes of each body.
        return velocity, np.cross(omega[:, None, :], axes), linear, angular

    start = scene.initial
    parts = (
        start.position,
        axes_of(start.orientation),
        start.linear_velocity,
        start.angular_velocity,
    )
    return Motion(*_integrate(derivative, parts, _scales(scene, duration), duration))
