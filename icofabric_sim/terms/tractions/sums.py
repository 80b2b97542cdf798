# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Surface forces on bodies, summed over their faces: one row for each block, for any faces.

Pressure and shear that turn with a body are one wrench in its axes. Those of fixed direction are
one force F, and the torque of the first moments S_k = sum of p F_k (p in body axes, k along the
world): sum over k of (R S_k) x e_k. Without friction the component n (n . F) of each force acts,
along the normal n, and both sums are linear in the axes of the body: n n F and (p x n) n F,
contracted with them. The first is symmetric in both normals: xx, xy, xz, yy, yz, zz.

Loops over rows are in the callers (kernels/flows.py, kernels/rhs.py).
"""

from icofabric_sim.kernels.rotations import (
    axes_of_lanes,
    Nine,
    on_axes,
    Three,
)
from icofabric_sim.kernels.runtime.compiled import compiled, inlined
from icofabric_sim.kernels.runtime.lanes import fma, LANES, load, load_at, splat, Vector, where
from icofabric_sim.terms.profiles import (
    FAR_WEIGHT,
    Five,
    is_steady,
    MIDDLE_WEIGHT,
    NEAR_WEIGHT,
    NODES,
    Varying,
)
from icofabric_sim.terms.shared import State
from icofabric_sim.terms.tractions.record import Tractions
from icofabric_sim.terms.turning import mean_factors, mean_turn_factors, turn_factors
import numpy as np

# Numbers of a body in the arrays of `Tractions`.
TURNING, FIXED, SLIDING = 6, 12, 45
_PAIRS = 18  # numbers of the six pairs of body axes, before those of the torque

# Weights of the Gauss rule over a drift.
_WEIGHTS = (FAR_WEIGHT, NEAR_WEIGHT, MIDDLE_WEIGHT, NEAR_WEIGHT, FAR_WEIGHT)

# A square of a spin [1/s^2] below this number counts as zero.
_STILL = 1e-100

# Terms of the power of a body in free flight: see `power_of_turning` and `sliding_parts`.
Four = tuple[Vector, Vector, Vector, Vector]
Six = tuple[Vector, Vector, Vector, Vector, Vector, Vector]
Sliding = tuple[Three, Six]


@compiled
def traction_wrench(
    turning: np.ndarray | None, fixed: np.ndarray | None, sliding: np.ndarray | None, row: int,
    axes: Nine
) -> tuple[Three, Three]:
    """
    Return force [N] and torque about the centre [N m] of a row on a block, world frame.

    The factor of its profile is not included.
    """
    force, torque = turning_part(turning, TURNING * LANES * row, axes)
    force, torque = add_fixed(fixed, FIXED * LANES * row, axes, force, torque)
    return add_sliding(sliding, SLIDING * LANES * row, axes, force, torque)


@inlined
def three_at(values: np.ndarray, at: int) -> Three:
    """Return three numbers of all lanes."""
    return load_at(values, at), load_at(values, at + LANES), load_at(values, at + 2 * LANES)


@compiled
def turning_part(turning: np.ndarray | None, at: int, axes: Nine) -> tuple[Three, Three]:
    """Return the wrench of surface forces that turn with the bodies."""
    if turning is None:
        zero = splat(0.0)
        return (zero, zero, zero), (zero, zero, zero)
    else:
        fx, fy, fz = three_at(turning, at)
        tx, ty, tz = three_at(turning, at + 3 * LANES)
        return on_axes(axes, fx, fy, fz), on_axes(axes, tx, ty, tz)


@compiled
def moments_at(fixed: np.ndarray, at: int, axes: Nine) -> Nine:
    """Return first moments R S_x, R S_y, R S_z [N m] of forces of fixed direction, world frame."""
    ax, ay, az = three_at(fixed, at + 3 * LANES)
    bx, by, bz = three_at(fixed, at + 6 * LANES)
    cx, cy, cz = three_at(fixed, at + 9 * LANES)
    ax, ay, az = on_axes(axes, ax, ay, az)
    bx, by, bz = on_axes(axes, bx, by, bz)
    cx, cy, cz = on_axes(axes, cx, cy, cz)
    return ax, ay, az, bx, by, bz, cx, cy, cz


@compiled
def add_fixed(
    fixed: np.ndarray | None, at: int, axes: Nine, force: Three, torque: Three
) -> tuple[Three, Three]:
    """Add surface forces of fixed direction."""
    if fixed is None:
        return force, torque
    else:
        fx, fy, fz = three_at(fixed, at)
        ax, ay, az, bx, by, bz, cx, cy, cz = moments_at(fixed, at, axes)
        return (force[0] + fx, force[1] + fy, force[2] + fz), (
            torque[0] + (cy - bz), torque[1] + (az - cx), torque[2] + (bx - ay))


@inlined
def add_sliding(
    sliding: np.ndarray | None, at: int, axes: Nine, force: Three, torque: Three
) -> tuple[Three, Three]:
    """Add surface forces along the normals of faces without friction."""
    if sliding is None:
        return force, torque
    else:
        fx, fy, fz = force_on_body(sliding, at, axes)
        tx, ty, tz = torque_on_body(sliding, at, axes)
        fx, fy, fz = on_axes(axes, fx, fy, fz)
        tx, ty, tz = on_axes(axes, tx, ty, tz)
        return (force[0] + fx, force[1] + fy, force[2] + fz), (
            torque[0] + tx, torque[1] + ty, torque[2] + tz)


@compiled
def mean_traction_power(
    sliding: np.ndarray | None, tractions: Tractions, varying: Varying | None, w: int,
    state: State, row: int, s: int, h: float, factors: Five
) -> Vector:
    """
    Return the mean power [W] of a row on a block over a drift of `h` [s], before the block moves.

    Exact for a steady row; else by a Gauss rule of order 10, beyond that of any method.
    `factors`: see `factors_over`.
    """
    axes = axes_of_lanes(state.orientation, s)
    velocity, spin = state.linear_velocity, state.angular_velocity
    v = load(velocity, 0, s), load(velocity, 1, s), load(velocity, 2, s)
    omega = load(spin, 0, s), load(spin, 1, s), load(spin, 2, s)
    parts = power_of_turning(tractions.turning, row, axes, v, omega)
    parts = add_power_of_fixed(tractions.fixed, row, axes, v, omega, parts)
    slid = sliding_parts(sliding, row, axes, v, omega)
    if is_steady(varying, w):
        means = mean_turn_factors(h, omega[0], omega[1], omega[2])
        mean = add_mean_sliding(slid, means, omega, h, power_of(parts, means))
        return splat(factors[0]) * mean
    mean = splat(0.0)
    for node in range(5):
        factor = splat(_WEIGHTS[node] * factors[node])
        mean = fma(factor, power_then(parts, slid, omega, NODES[node] * h), mean)
    return mean


@compiled
def power_of_turning(
    turning: np.ndarray | None, row: int, axes: Nine, v: Three, omega: Three
) -> Four:
    """
    Return terms of `power_of` [W] on a block in free flight, of forces that turn with the bodies.

    With v and omega constant, the power of a force f that turns with the body is v . f, and its
    torque keeps its component along omega. A force of fixed direction gives F . v and the sum over
    k of e_k . (omega x R S_k), where omega x R S_k turns too. Both turn by Rodrigues' formula.
    """
    if turning is None:
        zero = splat(0.0)
        return zero, zero, zero, zero
    else:
        force, torque = turning_part(turning, TURNING * LANES * row, axes)
        fx, fy, fz = force
        vx, vy, vz = v
        ox, oy, oz = omega
        cx, cy, cz = oy * fz - oz * fy, oz * fx - ox * fz, ox * fy - oy * fx
        along = fma(ox, fx, fma(oy, fy, oz * fz))
        return (
            fma(torque[0], ox, fma(torque[1], oy, torque[2] * oz)),
            fma(fx, vx, fma(fy, vy, fz * vz)), fma(cx, vx, fma(cy, vy, cz * vz)),
            along * fma(ox, vx, fma(oy, vy, oz * vz)))


@compiled
def add_power_of_fixed(
    fixed: np.ndarray | None, row: int, axes: Nine, v: Three, omega: Three, parts: Four
) -> Four:
    """Add the terms of forces of fixed direction."""
    if fixed is None:
        return parts
    else:
        at = FIXED * LANES * row
        fx, fy, fz = three_at(fixed, at)
        ax, ay, az, bx, by, bz, cx, cy, cz = moments_at(fixed, at, axes)
        ox, oy, oz = omega
        turns = fma(ox, cy - bz, fma(oy, az - cx, oz * (bx - ay)))
        square = fma(ox, ox, fma(oy, oy, oz * oz))
        # The sum over k of omega_k (omega . R S_k) - |omega|^2 (e_k . R S_k).
        across = fma(ox, fma(ox, ax, fma(oy, ay, oz * az)), fma(
            oy, fma(ox, bx, fma(oy, by, oz * bz)), oz * fma(ox, cx, fma(oy, cy, oz * cz))))
        return (
            parts[0] + fma(fx, v[0], fma(fy, v[1], fz * v[2])), parts[1] + turns,
            parts[2] + (across - square * (ax + by + cz)), parts[3])


@inlined
def power_of(parts: Four, factors: Three) -> Vector:
    """
    Return the power [W] with cos x, sin x / |omega| and (1 - cos x) / |omega|^2, or their means.
    """
    return fma(parts[1], factors[0], fma(
        parts[2], factors[1], fma(parts[3], factors[2], parts[0])))


@inlined
def power_then(parts: Four, slid: Sliding | None, omega: Three, later: float) -> Vector:
    """Return the power [W] of a steady row on a block after `later` [s] of free flight."""
    factors = turn_factors(later, omega[0], omega[1], omega[2])
    return add_sliding_power(slid, factors, power_of(parts, factors))


@inlined
def sliding_parts(
    sliding: np.ndarray | None, row: int, axes: Nine, v: Three, omega: Three
) -> Sliding | None:
    """
    Return terms of the power [W] of forces along the normals of faces without friction.

    The axes e_j turn by Rodrigues' formula. Force and torque on body axes are linear in them and
    so have three terms. The components e_i . v have three terms too, while e_i . omega stays
    constant. The power of torques is linear in the turning factors, that of forces in their
    products.
    """
    if sliding is None:
        return None
    else:
        ox, oy, oz = omega
        ax, ay, az, bx, by, bz, cx, cy, cz = axes
        across = (
            oy * az - oz * ay, oz * ax - ox * az, ox * ay - oy * ax,
            oy * bz - oz * by, oz * bx - ox * bz, ox * by - oy * bx,
            oy * cz - oz * cy, oz * cx - ox * cz, ox * cy - oy * cx)
        p = fma(ox, ax, fma(oy, ay, oz * az))
        q = fma(ox, bx, fma(oy, by, oz * bz))
        r = fma(ox, cx, fma(oy, cy, oz * cz))
        at = SLIDING * LANES * row
        first, second, third = (
            force_on_body(sliding, at, axes), force_on_body(sliding, at, across),
            force_along_spin(sliding, at, omega, p, q, r))
        # The torque along the spin, which is constant on body axes, is linear in the axes.
        turning = along_spin(sliding, at, p, q, r)
        torques = (
            product_of(turning, axes), product_of(turning, across),
            fma(p, dot(turning[:3], omega), fma(
                q, dot(turning[3:6], omega), r * dot(turning[6:], omega))))
        speed = fma(ox, v[0], fma(oy, v[1], oz * v[2]))
        u, w, x = seen(axes, v), seen(across, v), (p * speed, q * speed, r * speed)
        return torques, (
            dot(first, u), dot(first, w) + dot(second, u), dot(first, x) + dot(third, u),
            dot(second, w), dot(second, x) + dot(third, w), dot(third, x))


@inlined
def force_on_body(sliding: np.ndarray, at: int, axes: Nine) -> Three:
    """
    Return the force [N] along the body axes.

    Numbers are read where they are used, since all of them do not fit into registers.
    """
    a, b, c = (
        (axes[0], axes[1], axes[2]), (axes[3], axes[4], axes[5]), (axes[6], axes[7], axes[8]))
    pair = pair_at(sliding, at, 0)
    x = dot(pair, a)
    pair = pair_at(sliding, at, 1)
    x, y = x + dot(pair, b), dot(pair, a)
    pair = pair_at(sliding, at, 2)
    x, z = x + dot(pair, c), dot(pair, a)
    pair = pair_at(sliding, at, 3)
    y = y + dot(pair, b)
    pair = pair_at(sliding, at, 4)
    y, z = y + dot(pair, c), z + dot(pair, b)
    return x, y, z + dot(pair_at(sliding, at, 5), c)


@inlined
def force_along_spin(
    sliding: np.ndarray, at: int, omega: Three, p: Vector, q: Vector, r: Vector
) -> Three:
    """
    Return the force [N] for the components of the axes along the spin, p omega, q omega, r omega.
    """
    xx, xy = dot(pair_at(sliding, at, 0), omega), dot(pair_at(sliding, at, 1), omega)
    xz, yy = dot(pair_at(sliding, at, 2), omega), dot(pair_at(sliding, at, 3), omega)
    yz, zz = dot(pair_at(sliding, at, 4), omega), dot(pair_at(sliding, at, 5), omega)
    return (
        fma(xx, p, fma(xy, q, xz * r)), fma(xy, p, fma(yy, q, yz * r)),
        fma(xz, p, fma(yz, q, zz * r)))


@inlined
def pair_at(sliding: np.ndarray, at: int, pair: int) -> Three:
    """Return the numbers of two body axes, for the three of the world."""
    return three_at(sliding, at + 3 * LANES * pair)


@inlined
def dot(a: Three, b: Three) -> Vector:
    """Return the scalar product."""
    return fma(a[0], b[0], fma(a[1], b[1], a[2] * b[2]))


@inlined
def torque_on_body(sliding: np.ndarray, at: int, axes: Nine) -> Three:
    """Return the torque [N m] along the body axes."""
    at = at + _PAIRS * LANES
    return (
        product_of(nine_at(sliding, at), axes), product_of(nine_at(sliding, at + 9 * LANES), axes),
        product_of(nine_at(sliding, at + 18 * LANES), axes))


@inlined
def along_spin(sliding: np.ndarray, at: int, p: Vector, q: Vector, r: Vector) -> Nine:
    """
    Return coefficients of the power of the torque [W]; the spin along the body axes is p, q, r.
    """
    at = at + _PAIRS * LANES
    a, b, c = (
        nine_at(sliding, at), nine_at(sliding, at + 9 * LANES),
        nine_at(sliding, at + 18 * LANES))
    return (
        fma(a[0], p, fma(b[0], q, c[0] * r)), fma(a[1], p, fma(b[1], q, c[1] * r)),
        fma(a[2], p, fma(b[2], q, c[2] * r)), fma(a[3], p, fma(b[3], q, c[3] * r)),
        fma(a[4], p, fma(b[4], q, c[4] * r)), fma(a[5], p, fma(b[5], q, c[5] * r)),
        fma(a[6], p, fma(b[6], q, c[6] * r)), fma(a[7], p, fma(b[7], q, c[7] * r)),
        fma(a[8], p, fma(b[8], q, c[8] * r)))


@inlined
def nine_at(values: np.ndarray, at: int) -> Nine:
    """Return nine numbers of all lanes."""
    return (
        *three_at(values, at), *three_at(values, at + 3 * LANES),
        *three_at(values, at + 6 * LANES))


@inlined
def product_of(values: Nine, axes: Nine) -> Vector:
    """Return the sum of nine numbers times the components of the axes."""
    first = fma(values[0], axes[0], fma(values[1], axes[1], values[2] * axes[2]))
    second = fma(values[3], axes[3], fma(values[4], axes[4], values[5] * axes[5]))
    third = fma(values[6], axes[6], fma(values[7], axes[7], values[8] * axes[8]))
    return first + (second + third)


@inlined
def seen(axes: Nine, v: Three) -> Three:
    """Return the components of a vector along axes."""
    return (
        fma(axes[0], v[0], fma(axes[1], v[1], axes[2] * v[2])),
        fma(axes[3], v[0], fma(axes[4], v[1], axes[5] * v[2])),
        fma(axes[6], v[0], fma(axes[7], v[1], axes[8] * v[2])))


@inlined
def mean_products(h: float, omega: Three, factors: Three) -> Six:
    """
    Return means over a time from 0 to `h` [s] of the products of the three `turn_factors`.

    With A = cos x, B = sin x / w and C = (1 - cos x) / w^2, w = |omega|, and the means of these: A
    = 1 - w^2 C, B is the derivative of C, and B^2 is 2 C of twice the angle. The mean of C^2 is a
    difference over w^2, with a coefficient of order w^4.
    """
    ox, oy, oz = omega
    square = fma(ox, ox, fma(oy, oy, oz * oz))
    one, two = splat(1.0), splat(2.0)
    mean, second = factors[2], mean_factors(h, two * ox, two * oy, two * oz)[1]
    bb, bc = splat(2.0 * h * h) * second, splat(0.5 * h) * factors[1] * factors[1]
    turns = square > splat(_STILL)
    cc = where(turns, two * mean - bb, splat(0.0)) / where(turns, square, one)
    return one - square * bb, factors[1] - square * bc, bb - mean, bb, bc, cc


@inlined
def add_mean_sliding(
    slid: Sliding | None, factors: Three, omega: Three, h: float, power: Vector
) -> Vector:
    """
    Add the mean power [W] of `slid` over a time from 0 to `h` [s].

    `factors`: the mean turning factors.
    """
    if slid is None:
        return power
    else:
        torques, products = slid
        power = fma(factors[0], torques[0], fma(
            factors[1], torques[1], fma(factors[2], torques[2], power)))
        return add_products(products, mean_products(h, omega, factors), power)


@inlined
def add_products(products: Six, factors: Six, power: Vector) -> Vector:
    """Add the terms with products of turning factors, aa, ab, ac, bb, bc and cc."""
    first = fma(products[0], factors[0], fma(products[1], factors[1], products[2] * factors[2]))
    second = fma(products[3], factors[3], fma(products[4], factors[4], products[5] * factors[5]))
    return power + (first + second)


@inlined
def add_sliding_power(slid: Sliding | None, factors: Three, power: Vector) -> Vector:
    """Add the power [W] of `slid` with cos x, sin x / |omega|, (1 - cos x) / |omega|^2."""
    if slid is None:
        return power
    else:
        torques, products = slid
        one, two, three = factors
        power = fma(one, torques[0], fma(two, torques[1], fma(three, torques[2], power)))
        return add_products(
            products, (one * one, one * two, one * three, two * two, two * three, three * three),
            power)
