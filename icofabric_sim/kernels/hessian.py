# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Product of the Hessian of the connector energy with small motions.

Vectors are (6, s) arrays, slots last: displacements [m] and rotation vectors [rad] of all bodies,
or forces and torques.
"""

from icofabric_sim.kernels.composition import compose_terms
from icofabric_sim.kernels.records import Model
from icofabric_sim.kernels.runtime.compiled import compiled, compiled_for
from icofabric_sim.kernels.runtime.lanes import (
    load,
    maximum,
    splat,
    sqrt,
    store,
    store_at,
    Vector,
)
from icofabric_sim.terms.links.force import arm_of
from icofabric_sim.terms.shared import Links, Six, State, Supports
import numpy as np

add_products = compose_terms(
    'add_product', 'model, state, points, moved, turns, motion, block, s', 'total')


@compiled
def scaled_motion(
    supports: Supports | None, root_m: float, root_i: float, vector: np.ndarray, s: int
) -> Six:
    """Convert a mass-scaled vector of a block to displacements and rotation vectors, and back."""
    a, b, c = load(vector, 0, s), load(vector, 1, s), load(vector, 2, s)
    d, e, f = load(vector, 3, s), load(vector, 4, s), load(vector, 5, s)
    mx, my, mz, inertia = inverse_roots(supports, root_m, root_i, s)
    return a * mx, b * my, c * mz, d * inertia, e * inertia, f * inertia


@compiled
def inverse_roots(
    supports: Supports | None, root_m: float, root_i: float, s: int
) -> tuple[Vector, Vector, Vector, Vector]:
    """
    Return roots of the inverse masses along x, y, z and of the inverse inertia; 0 where held.
    """
    if supports is None:
        return splat(root_m), splat(root_m), splat(root_m), splat(root_i)
    else:
        # Inverse masses of carriers of planes are negative.
        zero = splat(0.0)
        return (
            sqrt(maximum(load(supports.inverse_mass, 0, s), zero)),
            sqrt(maximum(load(supports.inverse_mass, 1, s), zero)),
            sqrt(maximum(load(supports.inverse_mass, 2, s), zero)),
            sqrt(load(supports.inverse_inertia, 0, s)))


@compiled
def move_points(
    attachment: np.ndarray | None, points: np.ndarray, position: np.ndarray, motion: Six,
    moved: np.ndarray, s: int
) -> None:
    """Write displacements dx + dtheta x s [m] of the attachment points of a block, as `points`."""
    stride = position.shape[1]
    dx, dy, dz, tx, ty, tz = motion
    for edge in range(6):
        sx, sy, sz = arm_of(attachment, points, position, edge, s)
        at = 3 * edge * stride + s
        store_at(moved, at, dx + (ty * sz - tz * sy))
        store_at(moved, at + stride, dy + (tz * sx - tx * sz))
        store_at(moved, at + 2 * stride, dz + (tx * sy - ty * sx))


@compiled
def move_links(
    links: Links | None, points: np.ndarray, position: np.ndarray, motion: Six,
    moved: np.ndarray, s: int
) -> None:
    """Write displacements of the attachment points of a block, if there are connectors."""
    if links is None:
        return
    move_points(links.attachment, points, position, motion, moved, s)


@compiled_for(model='contacts')
def hessian_times(
    model: Model, state: State, points: np.ndarray, moved: np.ndarray, turns: np.ndarray,
    root_m: float, root_i: float, supports: Supports | None, vector: np.ndarray,
    product: np.ndarray
) -> None:
    """
    Write M^-1/2 H M^-1/2 times a vector, (6, s) both; roots 1 and no supports: H itself.

    `moved` holds as many numbers as `points`, `turns` (3, s) rotation vectors; both are
    overwritten.
    """
    count = model.blocks.slot.shape[0]
    for block in range(count):
        move_block(
            model, state, points, moved, turns, root_m, root_i, supports, vector,
            model.blocks.slot[block])
    multiply_blocks(
        model, state, points, moved, turns, root_m, root_i, supports, vector, product, 0, count)


@compiled
def move_block(
    model: Model, state: State, points: np.ndarray, moved: np.ndarray, turns: np.ndarray,
    root_m: float, root_i: float, supports: Supports | None, vector: np.ndarray, s: int
) -> None:
    """Write the displacements and rotations of the bodies of a block into `moved` and `turns`."""
    motion = scaled_motion(supports, root_m, root_i, vector, s)
    move_links(model.links, points, state.position, motion, moved, s)
    for k in range(3):
        store(turns, k, s, motion[k + 3])


@compiled
def multiply_blocks(
    model: Model, state: State, points: np.ndarray, moved: np.ndarray, turns: np.ndarray,
    root_m: float, root_i: float, supports: Supports | None, vector: np.ndarray,
    product: np.ndarray, first: int, last: int
) -> None:
    """Write the product at blocks first to last, after `move_block` for their neighbours."""
    for block in range(first, last):
        s = model.blocks.slot[block]
        motion = scaled_motion(supports, root_m, root_i, vector, s)
        a, b, c, d, e, f = add_products(
            model, state, points, moved, turns, motion, block, s)
        mx, my, mz, inertia = inverse_roots(supports, root_m, root_i, s)
        store(product, 0, s, a * mx)
        store(product, 1, s, b * my)
        store(product, 2, s, c * mz)
        store(product, 3, s, d * inertia)
        store(product, 4, s, e * inertia)
        store(product, 5, s, f * inertia)
