# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""First and second derivatives of the energy of anchors, for each anchored body."""

from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.kernels.records import Loads, Model, State
from icofabric_sim.simulation.model.packing import acting_lanes
from icofabric_sim.simulation.model.ties import inverses_of
from icofabric_sim.terms.anchors.record import Anchors
import numpy as np


def anchors_eigenvalue(model: Model, loads: Loads, state: State, time: float) -> float:
    """
    Return the largest squared frequency [1/s^2] that anchors alone cause at `time` [s].

    Held degrees of freedom are left out. The result is infinite if a number overflows.
    """
    anchors = loads.anchors
    assert anchors is not None
    hessians: dict[int, np.ndarray] = {}
    with np.errstate(over='ignore', invalid='ignore', divide='ignore'):
        for slot, a in _anchored(model, loads, anchors):
            part = stiffness_of(anchors, a, *_pose(state, slot), time)
            hessians[slot] = hessians.get(slot, 0.0) + part
    largest = 0.0
    for slot, hessian in hessians.items():
        root = np.sqrt(inverses_of(model, slot))
        scaled = hessian * np.outer(root, root)
        if not np.isfinite(scaled).all():
            return np.inf
        largest = max(largest, float(np.linalg.eigvalsh(scaled)[-1]))
    return largest


def anchor_accelerations(
    model: Model, loads: Loads, state: State, time: float
) -> np.ndarray:
    """
    Return the accelerations due to anchors at `time` [s], (6, s) [m/s^2, rad/s^2].

    Accelerations along held degrees of freedom are 0.
    """
    found = np.zeros((6, state.position.shape[1]))
    if loads.anchors is None:
        return found
    with np.errstate(over='ignore', invalid='ignore', divide='ignore'):
        for slot, a in _anchored(model, loads, loads.anchors):
            s, n, _, tension = _pulled(loads.anchors, a, *_pose(state, slot), time)
            found[:, slot] += inverses_of(model, slot) * tension * np.append(n, np.cross(s, n))
    return found


def stiffness_of(
    anchors: Anchors, a: int, position: np.ndarray, axes: np.ndarray, time: float
) -> np.ndarray:
    """
    Return the second derivative (6, 6) of the energy of an anchor, world frame.

    The derivative is taken along small motions (dx, dtheta) of the body. With the arm s, the
    direction n, the length l and the tension f of the anchor, and du = dx + dtheta x s: k (n.du)^2
    + f/l |P du|^2 - f n.(dtheta x (dtheta x s)). k is the larger of k_e and k_c, because the
    anchor may change from one to the other before the next health check.
    """
    s, n, length, tension = _pulled(anchors, a, position, axes, time)
    along = np.outer(n, n)
    stiff = max(anchors.extension[a], anchors.compression[a]) * along
    stiff += tension / length * (np.eye(3) - along)
    cross = np.array([[0.0, s[2], -s[1]], [-s[2], 0.0, s[0]], [s[1], -s[0], 0.0]])
    moves = np.hstack([np.eye(3), cross])
    hessian = moves.T @ stiff @ moves
    mixed = np.outer(n, s)
    hessian[3:, 3:] += tension * (float(n @ s) * np.eye(3) - 0.5 * (mixed + mixed.T))
    return np.asarray(hessian)


def _pulled(
    anchors: Anchors, a: int, position: np.ndarray, axes: np.ndarray, time: float
) -> tuple[np.ndarray, np.ndarray, float, float]:
    """
    Return arm [m], direction towards the world point, length [m] and tension [N] of an anchor.
    """
    point, _ = motion_of_points(anchors, np.array([a]), time)
    s = anchors.arm[a] @ axes
    reach = point[0] - position - s
    length = max(float(np.linalg.norm(reach)), 1e-150)
    stretch = length - anchors.natural_length[a]
    stiffness = (anchors.extension if stretch > 0.0 else anchors.compression)[a]
    return s, reach / length, length, float(stiffness * stretch)


def motion_of_points(
    anchors: Anchors, chosen: np.ndarray, time: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return points [m] of the `chosen` anchors, and their velocities [m/s], (m, 3) both."""
    t = (time - anchors.start[chosen])[:, None]
    cubic = anchors.cubic[chosen].transpose(1, 0, 2)
    point = cubic[0] + t * (cubic[1] + t * (cubic[2] + t * cubic[3]))
    speed = cubic[1] + t * (2.0 * cubic[2] + t * 3.0 * cubic[3])
    if anchors.waves is not None:
        size, rate, phase = (values[chosen] for values in anchors.waves._asdict().values())
        angle = rate[:, None] * t + phase[:, None]
        point = point + size * np.sin(angle)
        speed = speed + size * rate[:, None] * np.cos(angle)
    return point, speed


def _anchored(model: Model, loads: Loads, anchors: Anchors) -> list[tuple[int, int]]:
    """Return the slot of the body and the number of every anchor."""
    row, lane = acting_lanes(loads)
    number = -1 - loads.wrench[row] - anchors.first
    chosen = number >= 0
    row, lane, number = row[chosen], lane[chosen], number[chosen]
    block = np.repeat(np.arange(len(loads.start) - 1), np.diff(loads.start))
    slots = model.blocks.slot[block[row]] + lane
    return list(zip(slots.tolist(), number.tolist()))


def _pose(state: State, slot: int) -> tuple[np.ndarray, np.ndarray]:
    orientation = state.orientation[..., slot]
    if orientation.ndim == 1:
        orientation = cosines_from_quaternions(orientation[None])[0]
    return state.position[:, slot], orientation
