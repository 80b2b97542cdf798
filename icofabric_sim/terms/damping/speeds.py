# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Velocities of attachment points."""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fma, load, load_at, store_at
from icofabric_sim.terms.damping.record import Damping
from icofabric_sim.terms.shared import State
import numpy as np


@compiled
def place_speeds(
    damping: Damping | None, state: State, points: np.ndarray, speeds: np.ndarray, s: int
) -> None:
    """
    Write velocities v + omega x arm [m/s] of the attachment points of a block, laid out as points.
    """
    if damping is None:
        return
    stride = state.position.shape[1]
    px, py = load(state.position, 0, s), load(state.position, 1, s)
    pz = load(state.position, 2, s)
    vx, vy = load(state.linear_velocity, 0, s), load(state.linear_velocity, 1, s)
    vz, ox = load(state.linear_velocity, 2, s), load(state.angular_velocity, 0, s)
    oy, oz = load(state.angular_velocity, 1, s), load(state.angular_velocity, 2, s)
    for edge in range(6):
        at = 3 * edge * stride + s
        ax, ay = load_at(points, at) - px, load_at(points, at + stride) - py
        az = load_at(points, at + 2 * stride) - pz
        store_at(speeds, at, fma(oy, az, vx - oz * ay))
        store_at(speeds, at + stride, fma(oz, ax, vy - ox * az))
        store_at(speeds, at + 2 * stride, fma(ox, ay, vz - oy * ax))
