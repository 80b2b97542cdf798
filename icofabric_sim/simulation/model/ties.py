# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Packing of custom connectors, and second derivatives of their energy."""

from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.kernels.records import Model, SecondDerivatives, State
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.scene.custom_connectors import CustomConnectors
from icofabric_sim.simulation.model.layout import Layout
from icofabric_sim.terms.ties.record import Ties
import numpy as np


def pack_ties(custom: CustomConnectors | None, layout: Layout) -> Ties | None:
    """Return custom connectors for kernels, with a row for each end; None without any."""
    if custom is None:
        return None
    count = len(custom.bodies)
    block = layout.block_of(custom.bodies.T.ravel())
    order = np.argsort(block, kind='stable')
    number, end = order % count, order // count
    start = np.zeros(len(layout.blocks.slot) + 1, np.int32)
    np.cumsum(np.bincount(block, minlength=len(start) - 1), out=start[1:])
    own, other = (layout.slot[custom.bodies[number, side]] for side in (end, 1 - end))
    extension, compression, rest = (values[number] for values in custom.laws)
    return Ties(
        start=start, number=number.astype(np.int32), present=np.ones(len(order), np.uint8),
        lane=(1 << own % LANES).astype(np.uint8), own=own, other=other,
        point=custom.points[number, end].copy(), far=custom.points[number, 1 - end].copy(),
        extension=extension, compression=compression, natural_length=rest,
        damping=custom.damping[number] if custom.damping.any() else None)


def mark_ties(ties: Ties, numbers: np.ndarray, *, present: bool) -> None:
    """Break custom connectors, by their numbers among these, or repair them."""
    ties.present[np.isin(ties.number, numbers)] = present


def tie_lengths(
    custom: CustomConnectors, chosen: np.ndarray, layout: Layout, state: State
) -> tuple[np.ndarray, np.ndarray]:
    """Return lengths [m] of the `chosen` custom connectors in a state, and their rates [m/s]."""
    now = layout.unpack(state)
    bodies = custom.bodies[chosen]
    arm = _arms(custom.points[chosen], bodies, cosines_from_quaternions(now.orientation))
    ends = now.position[bodies] + arm
    moving = now.linear_velocity[bodies] + np.cross(now.angular_velocity[bodies], arm)
    along, rate = ends[:, 1] - ends[:, 0], moving[:, 1] - moving[:, 0]
    length = np.sqrt((along * along).sum(axis=1))
    return length, (along * rate).sum(axis=1) / np.maximum(length, 1e-300)


def _arms(points: np.ndarray, bodies: np.ndarray, axes: np.ndarray) -> np.ndarray:
    arms: np.ndarray = np.einsum('mei,meij->mej', points, axes[bodies])
    return arms


def tie_blocks(
    custom: CustomConnectors, position: np.ndarray, axes: np.ndarray, slope: np.ndarray,
    tension: np.ndarray
) -> np.ndarray:
    """
    Return the second derivatives (m, 12, 12) of the energy of custom connectors, world frame.

    `axes` (n, 3, 3) are body axes as rows, `slope` [N/m] and `tension` [N] those of the
    connectors, (m,). With du = du_2 - du_1, du_i = dx_i + dtheta_i x s_i: k (n.du)^2 + f/l |P
    du|^2 + f n.[dtheta_2 x (dtheta_2 x s_2) - dtheta_1 x (dtheta_1 x s_1)].
    """
    arms = _arms(custom.points, custom.bodies, axes)
    ends = position[custom.bodies] + arms
    along = ends[:, 1] - ends[:, 0]
    length = np.maximum(np.linalg.norm(along, axis=1), 1e-150)
    n = along / length[:, None]
    outer = n[:, :, None] * n[:, None, :]
    # A hinge, of natural length 0, is as stiff in all directions.
    across = np.where(custom.laws[2] > 0.0, tension / length, slope)[:, None, None]
    stiff = slope[:, None, None] * outer + across * (np.eye(3) - outer)
    moves = np.zeros((len(n), 3, 12))
    turned = np.zeros((len(n), 12, 12))
    for end, sign in ((0, -1.0), (1, 1.0)):
        s = arms[:, end]
        moves[:, :, 6 * end:6 * end + 3] = sign * np.eye(3)
        for k, unit in enumerate(np.eye(3)):
            moves[:, :, 6 * end + 3 + k] = sign * np.cross(unit, s)
        mixed = n[:, :, None] * s[:, None, :]
        dot = (n * s).sum(axis=1)[:, None, None]
        part = slice(6 * end + 3, 6 * end + 6)
        turned[:, part, part] = sign * tension[:, None, None] * (
            0.5 * (mixed + np.swapaxes(mixed, 1, 2)) - dot * np.eye(3))
    return np.swapaxes(moves, 1, 2) @ stiff @ moves + turned


def stiffest_blocks(
    custom: CustomConnectors, model: Model, layout: Layout, state: State
) -> tuple[SecondDerivatives, float]:
    """
    Return the second derivatives of unbroken custom connectors, scaled by masses and inertias.

    The larger of k_e and k_c counts, because a step has to be stable on either side of the
    natural length. The second result is an upper bound of the largest eigenvalue [1/s^2].
    """
    assert model.ties is not None
    now = layout.unpack(state)
    extension, compression, rest = custom.laws
    intact = np.zeros(len(rest), bool)
    intact[model.ties.number[model.ties.present != 0]] = True
    stretch = tie_lengths(custom, np.arange(len(rest)), layout, state)[0] - rest
    tension = stretch * np.where(stretch > 0.0, extension, compression)
    blocks = tie_blocks(
        custom, now.position, cosines_from_quaternions(now.orientation),
        np.maximum(extension, compression) * intact, tension * intact)
    slots = layout.slot[custom.bodies]
    roots = np.sqrt(np.array([
        [inverses_of(model, slot) for slot in pair] for pair in slots])).reshape(-1, 12)
    blocks *= roots[:, :, None] * roots[:, None, :]
    most = np.zeros(layout.slot_count)
    if np.isfinite(blocks).all():
        np.add.at(most, slots, np.linalg.eigvalsh(blocks)[:, -1:])
    else:
        most[0] = np.inf
    return SecondDerivatives(slots, blocks), float(most.max())


def inverses_of(model: Model, slot: int) -> np.ndarray:
    """Return the inverse mass or inertia of each degree of freedom of a body, (6,)."""
    if model.supports is None:
        return np.repeat([model.inverse_mass, model.inverse_inertia], 3)
    held = model.supports
    return np.append(held.inverse_mass[:, slot], np.repeat(held.inverse_inertia[0, slot], 3))
