# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The equations of motion as a user would write them with SciPy and Numba.

One loop over bodies and one over connectors, with quaternions and division by the masses at the
end, compiled with the fast options of Numba. This package is not used.
"""

from collections.abc import Callable

from icofabric_validation.benchmarks.scenes import PlainScene
import numba
import numpy as np

Rates = Callable[[float, np.ndarray], np.ndarray]


@numba.njit(error_model='numpy', fastmath=True)
def _rates(flat, connectors, constants, arms, compression, damping):  # type: ignore[no-untyped-def]
    # flat (13 n): for each body position, quaternion x y z w, velocity, spin (world frame).
    inverse_mass, inverse_inertia, half_width, stiffness, natural_length = constants
    count = arms.shape[0]
    state = flat.reshape(count, 13)
    rate = np.zeros((count, 13))
    for b in range(count):
        x, y, z, w = state[b, 3], state[b, 4], state[b, 5], state[b, 6]
        ox, oy, oz = state[b, 10], state[b, 11], state[b, 12]
        for k in range(3):
            rate[b, k] = state[b, 7 + k]
        rate[b, 3] = 0.5 * (ox * w + oy * z - oz * y)
        rate[b, 4] = 0.5 * (oy * w + oz * x - ox * z)
        rate[b, 5] = 0.5 * (oz * w + ox * y - oy * x)
        rate[b, 6] = -0.5 * (ox * x + oy * y + oz * z)
        arms[b, 0, 0] = half_width * 2.0 * (x * z + y * w)
        arms[b, 0, 1] = half_width * 2.0 * (y * z - x * w)
        arms[b, 0, 2] = half_width * (1.0 - 2.0 * (x * x + y * y))
        arms[b, 2, 0] = half_width * (1.0 - 2.0 * (y * y + z * z))
        arms[b, 2, 1] = half_width * 2.0 * (x * y + z * w)
        arms[b, 2, 2] = half_width * 2.0 * (x * z - y * w)
        arms[b, 4, 0] = half_width * 2.0 * (x * y - z * w)
        arms[b, 4, 1] = half_width * (1.0 - 2.0 * (x * x + z * z))
        arms[b, 4, 2] = half_width * 2.0 * (y * z + x * w)
        for edge in range(0, 6, 2):
            for k in range(3):
                arms[b, edge + 1, k] = -arms[b, edge, k]
    for c in range(connectors.shape[0]):
        i, j = connectors[c, 0], connectors[c, 1]
        edge_i, edge_j = connectors[c, 2], connectors[c, 3]
        ix, iy, iz = arms[i, edge_i, 0], arms[i, edge_i, 1], arms[i, edge_i, 2]
        jx, jy, jz = arms[j, edge_j, 0], arms[j, edge_j, 1], arms[j, edge_j, 2]
        dx = state[j, 0] - state[i, 0] + jx - ix
        dy = state[j, 1] - state[i, 1] + jy - iy
        dz = state[j, 2] - state[i, 2] + jz - iz
        square = dx * dx + dy * dy + dz * dz
        strain = 1.0 - natural_length / np.sqrt(square)
        if compression is None:
            pull = stiffness * strain
        else:
            pull = (stiffness if strain > 0.0 else compression) * strain
        if damping is not None:
            oi, pi, qi = state[i, 10], state[i, 11], state[i, 12]
            oj, pj, qj = state[j, 10], state[j, 11], state[j, 12]
            ux = state[j, 7] - state[i, 7] + pj * jz - qj * jy - pi * iz + qi * iy
            uy = state[j, 8] - state[i, 8] + qj * jx - oj * jz - qi * ix + oi * iz
            uz = state[j, 9] - state[i, 9] + oj * jy - pj * jx - oi * iy + pi * ix
            pull += damping * (dx * ux + dy * uy + dz * uz) / square
        fx, fy, fz = pull * dx, pull * dy, pull * dz
        rate[i, 7] += inverse_mass * fx
        rate[i, 8] += inverse_mass * fy
        rate[i, 9] += inverse_mass * fz
        rate[j, 7] -= inverse_mass * fx
        rate[j, 8] -= inverse_mass * fy
        rate[j, 9] -= inverse_mass * fz
        rate[i, 10] += inverse_inertia * (iy * fz - iz * fy)
        rate[i, 11] += inverse_inertia * (iz * fx - ix * fz)
        rate[i, 12] += inverse_inertia * (ix * fy - iy * fx)
        rate[j, 10] -= inverse_inertia * (jy * fz - jz * fy)
        rate[j, 11] -= inverse_inertia * (jz * fx - jx * fz)
        rate[j, 12] -= inverse_inertia * (jx * fy - jy * fx)
    return rate.reshape(-1)


def plain_rates(scene: PlainScene) -> Rates:
    """Return the right-hand side f(t, y) for a flat state of 13 numbers per body."""
    connectors = np.ascontiguousarray(np.hstack([scene.bodies, scene.edges]))
    constants = (
        1.0 / scene.mass, 1.0 / scene.inertia, scene.half_width, scene.stiffness,
        scene.natural_length)
    arms = np.zeros((scene.body_count, 6, 3))
    # Tests for two stiffnesses, and damping, are compiled only if the scene has them.
    compression = None if scene.compression == scene.stiffness else scene.compression
    damping = None if scene.damping == 0.0 else scene.damping

    def rates(time: float, flat: np.ndarray) -> np.ndarray:
        return np.asarray(_rates(flat, connectors, constants, arms, compression, damping))

    return rates


def flat_state(scene: PlainScene) -> np.ndarray:
    """Return the initial state of 13 numbers per body: position, quaternion, velocities."""
    return np.hstack([scene.position, scene.orientation, scene.velocity, scene.spin]).ravel()
