# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Closed forms: what bodies and springs do exactly.

Equation numbers are those of "A Mathematical Model of Icosahedral Materials".
"""

import math
from typing import NamedTuple

import numpy as np


def projectile(position, velocity, gravity, time):
    """Return R0 + V0 t + g t^2 / 2, the solution of M R'' = M g (eq 45)."""
    return position + velocity * time + 0.5 * np.asarray(gravity) * time**2


def quaternion_product(left, right):
    """
    Return the product of quaternions (..., 4), scalar last: first `right`, then `left` (eq 21).
    """
    v, w = left[..., :3], left[..., 3:]
    p, s = right[..., :3], right[..., 3:]
    return np.concatenate(
        [w * p + s * v + np.cross(v, p), w * s - (v * p).sum(axis=-1, keepdims=True)], axis=-1
    )


def rotation_quaternion(vector):
    """Return exp(vector / 2) of rotation vectors (..., 3) [rad]."""
    vector = np.asarray(vector, dtype=float)
    angle = np.linalg.norm(vector, axis=-1, keepdims=True)
    # numpy.sinc(x) is sin(pi x) / (pi x), smooth at zero.
    return np.concatenate(
        [0.5 * np.sinc(angle / (2.0 * np.pi)) * vector, np.cos(0.5 * angle)], axis=-1
    )


def free_rotation(orientation, spin, time):
    """
    Return exp(omega t / 2) q0, the solution of dq/dt = omega q / 2 (eq 22) at constant spin.

    The spin of a free body is constant because its inertia is isotropic: omega x I omega = 0 in
    eq 45, and nothing else turns it.
    """
    return quaternion_product(rotation_quaternion(np.asarray(spin) * time), orientation)


def rotation_distance(left, right):
    """
    Angle [rad] between orientations (n, 4), whatever the signs of the quaternions.

    For nearly equal orientations the chord is accurate where the scalar product is not.
    """
    chord = np.minimum(
        np.linalg.norm(left - right, axis=-1), np.linalg.norm(left + right, axis=-1)
    )
    return 4.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))


def axial_frequency(stiffness, mass):
    """
    Frequency [rad/s] of two bodies along the line of their connector: omega^2 = 2 k / m.

    Eq 49 between attachments that lie on the line of the centres, d = w + l apart: there is no
    moment, and the reduced mass is m / 2.
    """
    return math.sqrt(2.0 * stiffness / mass)


def leapfrog_frequency(frequency, step):
    """
    Frequency [rad/s] at which the leapfrog moves a linear oscillator of a true `frequency`.

    Kick, drift, kick with u'' = -omega^2 u is u(t + h) - 2 u(t) + u(t - h) = -(omega h)^2 u(t),
    hence u = A cos(Omega t) with cos(Omega h) = 1 - (omega h)^2 / 2, stable for omega h < 2.
    """
    return math.acos(1.0 - 0.5 * (frequency * step) ** 2) / step


def amplification(method, product):
    """Largest eigenvalue of a step of `product` / omega of the oscillator u'' = -omega^2 u."""
    if not method.symplectic:
        # The stability function 1 + z b.(1 - z A)^-1 1 on the imaginary axis.
        count, z = method.stages, 1j * product
        matrix = np.zeros((count, count))
        pair = method.embedded.pair
        for row, weights in enumerate(pair.stage_weights[:-1], start=1):
            matrix[row, :len(weights)] = weights
        solved = np.linalg.solve(np.eye(count) - z * matrix, np.ones(count))
        return abs(1.0 + z * pair.step @ solved)
    kicks, drifts = list(method.kicks), list(method.drifts)
    flows = [None] * (len(kicks) + len(drifts))
    first = int(len(drifts) > len(kicks))
    flows[first::2] = [np.array([[1.0, 0.0], [-product * kick, 1.0]]) for kick in kicks]
    flows[1 - first::2] = [np.array([[1.0, product * drift], [0.0, 1.0]]) for drift in drifts]
    matrix = np.eye(2)
    for flow in flows:
        matrix = flow @ matrix
    return np.abs(np.linalg.eigvals(matrix)).max()


class PairMode(NamedTuple):
    """Small motion of two bodies and their connector, per unit of the connector's lengthening."""

    frequency: float  # [rad/s]
    shift: np.ndarray  # (2, 3) [m / m]
    turn: np.ndarray  # (2, 3) [rad / m]


def pair_mode(stiffness, mass, inertia, arms, direction):
    """
    Return the only mode of two bodies joined at rest by one connector at its natural length.

    To first order the connector lengthens by
    u = n . (dx2 + dtheta2 x s2 - dx1 - dtheta1 x s1) for arms s_i and unit direction n, and pulls
    with k u. With m dx_i'' = +-k u n and Lambda dtheta_i'' = +-k u (s_i x n) it follows that
    u'' = -omega^2 u, omega^2 = k [2 / m + (|s1 x n|^2 + |s2 x n|^2) / Lambda], and that the
    motion keeps its shape. Everything else is a mechanism.
    """
    moments = np.cross(arms, direction)
    square = stiffness * (2.0 / mass + (moments**2).sum() / inertia)
    sign = np.array([[-1.0], [1.0]])
    return PairMode(
        math.sqrt(square),
        sign * direction * stiffness / (mass * square),
        sign * moments * stiffness / (inertia * square),
    )


def rocking_frequencies(stiffness, natural_length, arm, distance, inertia):
    """
    Frequencies [rad/s] of two bodies with held centres that face each other: (equal, opposite).

    The attachments lie on the line of the centres at the distance `arm` = w/2 from each, the
    connector of length l = distance - 2 arm pulls with f = k (l - D). For small turns about axes
    across the line its length is l + arm (a1^2 + a2^2) / 2 + arm^2 (a1 + a2)^2 / (2 l), so the
    energy is f times that, and with Lambda a_i'' = -dU/da_i
    equal turns:    Lambda omega^2 = f arm (1 + 2 arm / l)
    opposite turns: Lambda omega^2 = f arm.
    """
    length = distance - 2.0 * arm
    pull = stiffness * (length - natural_length)
    return (
        math.sqrt(pull * arm * (1.0 + 2.0 * arm / length) / inertia),
        math.sqrt(pull * arm / inertia),
    )


def momentum(mass, linear_velocity):
    """Sum of M V [kg m/s]."""
    return mass * linear_velocity.sum(axis=0)


def angular_momentum(mass, inertia, position, linear_velocity, angular_velocity):
    """Sum of R x M V + Lambda omega about the origin [kg m^2/s]."""
    return (mass * np.cross(position, linear_velocity) + inertia * angular_velocity).sum(axis=0)
