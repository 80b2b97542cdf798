# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Product of the Hessian of the connector energy with small motions.

Vectors are (6, s) arrays, slots last: displacements [m] and rotation vectors [rad] of all bodies,
or forces and torques.
"""

from icofabric_sim.kernels.composition import compose_terms
from icofabric_sim.kernels.connectors import arm_of, Six, slope_of
from icofabric_sim.kernels.laws import replace_largest_slope, replace_pull
from icofabric_sim.kernels.records import Links, Model, State, Supports
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fma,
    load,
    load_at,
    maximum,
    rsqrt,
    splat,
    sqrt,
    store,
    store_at,
    Vector,
    where,
)
from icofabric_sim.terms.shared import Variety
import numpy as np

_SMALLEST_SQUARE = 1e-300

add_products = compose_terms(
    'add_product', 'model, state, points, moved, turns, block, s, total', 'total')


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
        return (
            sqrt(load(supports.inverse_mass, 0, s)),
            sqrt(load(supports.inverse_mass, 1, s)),
            sqrt(load(supports.inverse_mass, 2, s)),
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


@compiled
def second_derivative(
    links: Links | None, points: np.ndarray, position: np.ndarray, moved: np.ndarray,
    motion: Six, block: int, s: int
) -> Six:
    """
    Return the second derivative of the energy along a motion, for the bodies of a block.

    The configuration is x + dx, exp(dtheta) R; with u = r_2 - r_1, n = u / l, f = k (l - D), s_i
    the arms: d2E = du.G du + f n.[dtheta_2 x (dtheta_2 x s_2) - dtheta_1 x (dtheta_1 x s_1)],
    where du = du_2 - du_1, du_i = dx_i + dtheta_i x s_i and G = k n n^T + f/l (1 - n n^T).
    The form is symmetric also out of equilibrium. Either end counts as the first for its own body.
    """
    zero = splat(0.0)
    fx, fy, fz, mx, my, mz = zero, zero, zero, zero, zero, zero
    if links is None:
        return fx, fy, fz, mx, my, mz
    _, _, _, tx, ty, tz = motion
    half, stride = splat(0.5), position.shape[1]
    stiffness, minus_rest = splat(links.stiffness), splat(-links.natural_length)
    for edge in range(6):
        sx, sy, sz = arm_of(links.attachment, points, position, edge, s)
        at = 3 * edge * stride + s
        for link in range(2 * edge, 2 * edge + 2):
            place = links.place[block, link]
            there = bits(links.present[block, link])
            ux = load_at(points, place) - load_at(points, at)
            uy = load_at(points, place + stride) - load_at(points, at + stride)
            uz = load_at(points, place + 2 * stride) - load_at(points, at + 2 * stride)
            vx = load_at(moved, place) - load_at(moved, at)
            vy = load_at(moved, place + stride) - load_at(moved, at + stride)
            vz = load_at(moved, place + 2 * stride) - load_at(moved, at + 2 * stride)
            # A connector of zero length has no direction and adds nothing.
            square = maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(_SMALLEST_SQUARE))
            inverse = where(
                there, where(square > splat(_SMALLEST_SQUARE), rsqrt(square), zero), zero)
            k, pull = slope_and_pull(
                links.variety, link, s, square, inverse, stiffness, minus_rest)
            length = square * inverse
            pull = replace_pull(links.laws, links.variety, link, s, length, pull)
            k = replace_largest_slope(links.laws, links.variety, link, s, length, k)
            pull = where(inverse > zero, pull, zero)
            nx, ny, nz = ux * inverse, uy * inverse, uz * inverse
            along = fma(nx, vx, fma(ny, vy, nz * vz))
            across = pull * inverse
            # k along n + f/l (du - along n); n is 0 where there is no connector.
            more = (k - across) * along
            gx, gy, gz = fma(more, nx, across * vx), fma(more, ny, across * vy), fma(
                more, nz, across * vz)
            fx, fy, fz = fx - gx, fy - gy, fz - gz
            ns = fma(nx, sx, fma(ny, sy, nz * sz))
            nt = half * fma(nx, tx, fma(ny, ty, nz * tz))
            st = half * fma(sx, tx, fma(sy, ty, sz * tz))
            mx = mx - (sy * gz - sz * gy) - pull * (nx * st + sx * nt - ns * tx)
            my = my - (sz * gx - sx * gz) - pull * (ny * st + sy * nt - ns * ty)
            mz = mz - (sx * gy - sy * gx) - pull * (nz * st + sz * nt - ns * tz)
    return fx, fy, fz, mx, my, mz


@compiled
def slope_and_pull(
    variety: Variety | None, link: int, s: int, square: Vector, inverse: Vector,
    stiffness: Vector, minus_rest: Vector
) -> tuple[Vector, Vector]:
    """
    Return slope of the tension [N/m] and tension [N] of a connector of squared length `square`.
    """
    if variety is None:
        return stiffness, stiffness * fma(square, inverse, minus_rest)
    else:
        k, rest = slope_of(variety, link, s, square)
        # The larger of k_e and k_c: a step has to be stable on either side of the natural length.
        most = maximum(load(variety.extension, link, s), load(variety.compression, link, s))
        return most, k * (square * inverse - rest)


@compiled
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
        total = second_derivative(
            model.links, points, state.position, moved, motion, block, s)
        a, b, c, d, e, f = add_products(model, state, points, moved, turns, block, s, total)
        mx, my, mz, inertia = inverse_roots(supports, root_m, root_i, s)
        store(product, 0, s, a * mx)
        store(product, 1, s, b * my)
        store(product, 2, s, c * mz)
        store(product, 3, s, d * inertia)
        store(product, 4, s, e * inertia)
        store(product, 5, s, f * inertia)
