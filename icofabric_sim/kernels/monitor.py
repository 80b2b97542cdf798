# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Looks at a running state every so many steps.

Is it finite, is the step still safe, has a body moved far?
"""

import math

from icofabric_sim.kernels.compiled import compiled
from icofabric_sim.kernels.records import Adjacency, Connectors, Model, State, Work
import numpy as np

# Bits of the status that `examine` returns; the rates concern the bound of the largest frequency.
RATE_HIGH, RATE_LOW, NOT_FINITE, MOVED_FAR = 1, 2, 4, 8


@compiled
def frequency_bound(
    connectors: Connectors | None,
    adjacency: Adjacency | None,
    inverse_mass: float,
    inverse_inertia: float,
    position: np.ndarray,
    arms: np.ndarray,
) -> tuple[float, int]:
    """
    Upper bound of the largest squared frequency [1/s^2] in this configuration, and its body.

    The second variation of a connector's energy for small motions (dx, dtheta) of its two bodies
    is k (n.du)^2 + f/l |P du|^2 + moments of f, with du = du_2 - du_1 and
    du_i = dx_i + dtheta_i x s_i. From (x - y)^2 <= 2 x^2 + 2 y^2 it is at most the sum over both
    ends of 2 k (n.du_i)^2 + 2 max(f/l, 0) |du_i|^2 + |f| |s| |dtheta_i|^2, a block-diagonal form:
    its largest eigenvalue, in mass-scaled coordinates, bounds that of the fabric. Each 6 x 6
    block is bounded by its largest absolute row sum. In the woven rest state the bound is close,
    because neighbours that move against each other make (x - y)^2 = 2 x^2 + 2 y^2.
    """
    largest = 0.0
    where = -1
    if connectors is None or adjacency is None:
        return largest, where
    root_m = math.sqrt(inverse_mass)
    root_i = math.sqrt(inverse_inertia)
    stiffness = connectors.stiffness
    natural_length = connectors.natural_length
    block = np.zeros((6, 6))
    row = np.zeros(6)
    for b in range(position.shape[0]):
        block[:] = 0.0
        for entry in range(adjacency.start[b], adjacency.start[b + 1]):
            c = adjacency.connector[entry]
            i, j = connectors.first[c], connectors.second[c]
            edge_i, edge_j = connectors.first_edge[c], connectors.second_edge[c]
            sign_i, sign_j = 1.0 - 2.0 * (edge_i & 1), 1.0 - 2.0 * (edge_j & 1)
            edge, sign = (edge_i, sign_i) if i == b else (edge_j, sign_j)
            ux = (position[j, 0] - position[i, 0]) + (
                sign_j * arms[j, edge_j >> 1, 0] - sign_i * arms[i, edge_i >> 1, 0]
            )
            uy = (position[j, 1] - position[i, 1]) + (
                sign_j * arms[j, edge_j >> 1, 1] - sign_i * arms[i, edge_i >> 1, 1]
            )
            uz = (position[j, 2] - position[i, 2]) + (
                sign_j * arms[j, edge_j >> 1, 2] - sign_i * arms[i, edge_i >> 1, 2]
            )
            length = math.sqrt(ux * ux + uy * uy + uz * uz)
            if length == 0.0:
                continue
            sx, sy, sz = (
                sign * arms[b, edge >> 1, 0],
                sign * arms[b, edge >> 1, 1],
                sign * arms[b, edge >> 1, 2],
            )
            nx, ny, nz = ux / length, uy / length, uz / length
            pull = stiffness * (length - natural_length)
            row[0], row[1], row[2] = root_m * nx, root_m * ny, root_m * nz
            row[3] = root_i * (sy * nz - sz * ny)
            row[4] = root_i * (sz * nx - sx * nz)
            row[5] = root_i * (sx * ny - sy * nx)
            for p in range(6):
                for q in range(6):
                    block[p, q] += 2.0 * stiffness * row[p] * row[q]
            square = sx * sx + sy * sy + sz * sz
            tension = max(pull / length, 0.0)
            # |du_i|^2 <= (|dx| + |s| |dtheta|)^2 <= (1/m + s^2/Lambda) |y|^2 by Cauchy and
            # Schwarz, y mass-scaled.
            spread = 2.0 * tension * (inverse_mass + square * inverse_inertia)
            moment = abs(pull) * math.sqrt(square) * inverse_inertia
            for p in range(3):
                block[p, p] += spread
                block[p + 3, p + 3] += spread + moment
        for p in range(6):
            total = 0.0
            for q in range(6):
                total += abs(block[p, q])
            if not total <= largest:
                largest = total
                where = b
    return largest, where


@compiled
def examine(
    model: Model,
    state: State,
    work: Work,
    reference: np.ndarray | None,
    readings: np.ndarray,
    high: float,
    low: float,
    spin_weight: float,
    reach: float,
) -> int:
    """
    Status bits of the state.

    `readings` (4,) gets the rate [rad/s], the body of the bound, the largest spin [rad/s], and a
    body that is not finite. The rate is sqrt(bound) + spin_weight x largest spin; RATE_HIGH above
    `high`, RATE_LOW below `low`. MOVED_FAR: a body is farther than `reach` [m] from its place in
    `reference` (n, 3); None skips that.
    """
    status = 0
    spin = 0.0
    for b in range(state.position.shape[0]):
        total = 0.0
        square = 0.0
        for k in range(3):
            total += state.position[b, k] + state.linear_velocity[b, k]
            square += state.angular_velocity[b, k] ** 2
        if not math.isfinite(total + square):
            readings[3] = b
            return NOT_FINITE
        spin = max(spin, square)
    bound, where = frequency_bound(
        model.connectors,
        model.adjacency,
        model.inverse_mass,
        model.inverse_inertia,
        state.position,
        work.arms,
    )
    spin = math.sqrt(spin)
    rate = math.sqrt(bound) + spin_weight * spin
    readings[0], readings[1], readings[2] = rate, where, spin
    if not rate <= high:
        status |= RATE_HIGH
    if rate < low:
        status |= RATE_LOW
    if moved_far(reference, state.position, reach):
        status |= MOVED_FAR
    return status


@compiled
def moved_far(reference: np.ndarray | None, position: np.ndarray, reach: float) -> bool:
    """
    Whether a body is farther than `reach` [m] from its place in `reference`.

    The way that all have moved on average does not count: it brings no two closer.
    """
    if reference is None or not reach < math.inf:
        return False
    limit = reach * reach
    count = position.shape[0]
    sx, sy, sz = 0.0, 0.0, 0.0
    for b in range(count):
        sx += position[b, 0] - reference[b, 0]
        sy += position[b, 1] - reference[b, 1]
        sz += position[b, 2] - reference[b, 2]
    for b in range(count):
        dx = position[b, 0] - reference[b, 0] - sx / count
        dy = position[b, 1] - reference[b, 1] - sy / count
        dz = position[b, 2] - reference[b, 2] - sz / count
        if dx * dx + dy * dy + dz * dz > limit:
            return True
    return False
