# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Product of the Hessian of the connector energy with small motions of the bodies.
"""

import math

from icofabric_sim.kernels.compiled import compiled
from icofabric_sim.kernels.records import Connectors
import numpy as np


@compiled
def hessian_product(
    connectors: Connectors,
    position: np.ndarray,
    arms: np.ndarray,
    shift: np.ndarray,
    turn: np.ndarray,
    force: np.ndarray,
    torque: np.ndarray,
) -> None:
    """
    Second derivative of the energy along (shift, turn), into (force, torque).

    World frame, all four (n, 3). The configuration is x + dx, exp(dtheta) R; with u = r_2 - r_1,
    n = u / l, f = k (l - D), s_i the arms:
    d2E = du.G du + f n.[dtheta_2 x (dtheta_2 x s_2) - dtheta_1 x (dtheta_1 x s_1)], where
    du = du_2 - du_1, du_i = dx_i + dtheta_i x s_i and G = k n n^T + f/l (1 - n n^T).
    Symmetric also out of equilibrium.
    """
    force[:] = 0.0
    torque[:] = 0.0
    stiffness = connectors.stiffness
    natural_length = connectors.natural_length
    s = np.zeros((2, 3))
    u = np.zeros(3)
    n = np.zeros(3)
    du = np.zeros(3)
    g = np.zeros(3)
    for c in range(connectors.first.shape[0]):
        bodies = (connectors.first[c], connectors.second[c])
        edges = (connectors.first_edge[c], connectors.second_edge[c])
        for k in range(3):
            for end in range(2):
                s[end, k] = (1.0 - 2.0 * (edges[end] & 1)) * arms[bodies[end], edges[end] >> 1, k]
            u[k] = (position[bodies[1], k] - position[bodies[0], k]) + (s[1, k] - s[0, k])
        length = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
        if length == 0.0:
            continue
        pull = stiffness * (length - natural_length)
        along = 0.0
        for k in range(3):
            n[k] = u[k] / length
            k1, k2 = (k + 1) % 3, (k + 2) % 3
            du[k] = shift[bodies[1], k] - shift[bodies[0], k]
            du[k] += turn[bodies[1], k1] * s[1, k2] - turn[bodies[1], k2] * s[1, k1]
            du[k] -= turn[bodies[0], k1] * s[0, k2] - turn[bodies[0], k2] * s[0, k1]
            along += n[k] * du[k]
        for k in range(3):
            g[k] = stiffness * along * n[k] + pull / length * (du[k] - along * n[k])
        for end in range(2):
            b = bodies[end]
            sign = 2.0 * end - 1.0
            ns = n[0] * s[end, 0] + n[1] * s[end, 1] + n[2] * s[end, 2]
            nt = n[0] * turn[b, 0] + n[1] * turn[b, 1] + n[2] * turn[b, 2]
            st = s[end, 0] * turn[b, 0] + s[end, 1] * turn[b, 1] + s[end, 2] * turn[b, 2]
            for k in range(3):
                k1, k2 = (k + 1) % 3, (k + 2) % 3
                force[b, k] += sign * g[k]
                torque[b, k] += sign * (s[end, k1] * g[k2] - s[end, k2] * g[k1])
                torque[b, k] += (
                    sign * pull * (0.5 * (n[k] * st + s[end, k] * nt) - ns * turn[b, k])
                )
