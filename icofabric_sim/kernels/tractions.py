# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
Surface forces on bodies, summed over their faces: one row for each block, whatever the faces.

Pressure and shear that turn with a body are one wrench in its axes. Those of fixed direction are
one force F, and the torque of the first moments S_k = sum of p F_k (p in body axes, k along the
world): sum over k of (R S_k) x e_k. Without friction the part n (n . F) of each force acts, along
the normal n, and both sums are linear in the axes of the body: n n F and (p x n) n F, contracted
with them.

Rows are functions without loops, see kernels/loads.py.
"""

from icofabric_sim.kernels.profiles import (
    factor_of,
    FAR,
    FAR_WEIGHT,
    is_steady,
    MIDDLE_WEIGHT,
    NEAR,
    NEAR_WEIGHT,
)
from icofabric_sim.kernels.records import State, Tractions, Varying
from icofabric_sim.kernels.rotations import (
    axes_of_lanes,
    Nine,
    on_axes,
    Three,
)
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fma, LANES, load, load_at, splat, Vector
from icofabric_sim.kernels.turning import mean_turn_factors, turn_factors
import numpy as np

# Numbers of a body in the arrays of `Tractions`.
TURNING, FIXED, SLIDING = 6, 12, 54

_NODES = (0.5 - FAR, 0.5 - NEAR, 0.5, 0.5 + NEAR, 0.5 + FAR)
_WEIGHTS = (FAR_WEIGHT, NEAR_WEIGHT, MIDDLE_WEIGHT, NEAR_WEIGHT, FAR_WEIGHT)

# What turns while a body is in free flight: see `power_of_turning` and `sliding_parts`.
Four = tuple[Vector, Vector, Vector, Vector]
Six = tuple[Vector, Vector, Vector, Vector, Vector, Vector]
Sliding = tuple[Nine, Nine, Three]


@compiled
def traction_wrench(
    turning: np.ndarray | None, fixed: np.ndarray | None, sliding: np.ndarray | None, row: int,
    axes: Nine
) -> tuple[Three, Three]:
    """
    Force [N] and torque about the centre [N m] of a row on a block with these axes, world frame.

    But for the factor of its profile.
    """
    force, torque = turning_part(turning, TURNING * LANES * row, axes)
    force, torque = add_fixed(fixed, FIXED * LANES * row, axes, force, torque)
    return add_sliding(sliding, SLIDING * LANES * row, axes, force, torque)


@compiled
def three_at(values: np.ndarray, at: int) -> Three:
    """Three numbers of all lanes."""
    return load_at(values, at), load_at(values, at + LANES), load_at(values, at + 2 * LANES)


@compiled
def turning_part(turning: np.ndarray | None, at: int, axes: Nine) -> tuple[Three, Three]:
    """What turns with the bodies."""
    if turning is None:
        zero = splat(0.0)
        return (zero, zero, zero), (zero, zero, zero)
    else:
        fx, fy, fz = three_at(turning, at)
        tx, ty, tz = three_at(turning, at + 3 * LANES)
        return on_axes(axes, fx, fy, fz), on_axes(axes, tx, ty, tz)


@compiled
def moments_at(fixed: np.ndarray, at: int, axes: Nine) -> Nine:
    """First moments R S_x, R S_y, R S_z [N m] of forces of fixed direction, world frame."""
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
    """Add what keeps its direction."""
    if fixed is None:
        return force, torque
    else:
        fx, fy, fz = three_at(fixed, at)
        ax, ay, az, bx, by, bz, cx, cy, cz = moments_at(fixed, at, axes)
        return (force[0] + fx, force[1] + fy, force[2] + fz), (
            torque[0] + (cy - bz), torque[1] + (az - cx), torque[2] + (bx - ay))


@compiled
def add_sliding(
    sliding: np.ndarray | None, at: int, axes: Nine, force: Three, torque: Three
) -> tuple[Three, Three]:
    """Add what acts along the normals of faces without friction."""
    if sliding is None:
        return force, torque
    else:
        fx, fy, fz = on_body(sliding, at, axes)
        tx, ty, tz = on_body(sliding, at + 27 * LANES, axes)
        fx, fy, fz = on_axes(axes, fx, fy, fz)
        tx, ty, tz = on_axes(axes, tx, ty, tz)
        return (force[0] + fx, force[1] + fy, force[2] + fz), (
            torque[0] + tx, torque[1] + ty, torque[2] + tz)


@compiled
def contracted(values: np.ndarray, at: int, axes: Nine) -> Vector:
    """Sum of nine numbers times the components of the axes."""
    first = fma(load_at(values, at), axes[0], fma(
        load_at(values, at + LANES), axes[1], load_at(values, at + 2 * LANES) * axes[2]))
    second = fma(load_at(values, at + 3 * LANES), axes[3], fma(
        load_at(values, at + 4 * LANES), axes[4], load_at(values, at + 5 * LANES) * axes[5]))
    third = fma(load_at(values, at + 6 * LANES), axes[6], fma(
        load_at(values, at + 7 * LANES), axes[7], load_at(values, at + 8 * LANES) * axes[8]))
    return first + (second + third)


@compiled
def mean_traction_power(
    sliding: np.ndarray | None, tractions: Tractions, varying: Varying | None, w: int,
    state: State, row: int, s: int, time: float, h: float
) -> Vector:
    """
    Mean power [W] of a row on a block over a drift of `h` from `time` on, before it moves.

    Exact where it is steady, but for products of what turns without friction: these, and what is
    not steady, by a Gauss rule of order 10, beyond that of any method.
    """
    axes = axes_of_lanes(state.orientation, s)
    velocity, spin = state.linear_velocity, state.angular_velocity
    v = load(velocity, 0, s), load(velocity, 1, s), load(velocity, 2, s)
    omega = load(spin, 0, s), load(spin, 1, s), load(spin, 2, s)
    parts = power_of_turning(tractions.turning, row, axes, v, omega)
    parts = add_power_of_fixed(tractions.fixed, row, axes, v, omega, parts)
    slid = sliding_parts(sliding, row, axes, v, omega)
    if is_steady(varying, w):
        factors = mean_turn_factors(h, omega[0], omega[1], omega[2])
        mean = add_mean_sliding(slid, factors, omega, h, power_of(parts, factors))
        return splat(factor_of(varying, w, time)) * mean
    near = power_then(varying, w, parts, slid, omega, time, (0.5 - NEAR) * h) + power_then(
        varying, w, parts, slid, omega, time, (0.5 + NEAR) * h)
    far = power_then(varying, w, parts, slid, omega, time, (0.5 - FAR) * h) + power_then(
        varying, w, parts, slid, omega, time, (0.5 + FAR) * h)
    middle = power_then(varying, w, parts, slid, omega, time, 0.5 * h)
    return fma(splat(NEAR_WEIGHT), near, fma(
        splat(FAR_WEIGHT), far, splat(MIDDLE_WEIGHT) * middle))


@compiled
def power_of_turning(
    turning: np.ndarray | None, row: int, axes: Nine, v: Three, omega: Three
) -> Four:
    """
    Parts of `power_of` [W] on a block in free flight, of what turns with the bodies.

    With v and omega constant, the power of a force f that turns with the body is v . f, and its
    torque keeps the part along omega. A force of fixed direction gives F . v and the sum over k of
    e_k . (omega x R S_k), where omega x R S_k turns too. Both turn by Rodrigues' formula.
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
    """Add the parts of what keeps its direction."""
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


@compiled
def power_of(parts: Four, factors: Three) -> Vector:
    """Power [W] with cos x, sin x / |omega| and (1 - cos x) / |omega|^2, or their means."""
    return fma(parts[1], factors[0], fma(
        parts[2], factors[1], fma(parts[3], factors[2], parts[0])))


@compiled
def power_then(
    varying: Varying | None, w: int, parts: Four, slid: Sliding | None, omega: Three, time: float,
    later: float
) -> Vector:
    """Power [W] of a row on a block `later` [s] than `time`, after free flight."""
    factors = turn_factors(later, omega[0], omega[1], omega[2])
    power = add_sliding_power(slid, factors, power_of(parts, factors))
    return splat(factor_of(varying, w, time + later)) * power


@compiled
def sliding_parts(
    sliding: np.ndarray | None, row: int, axes: Nine, v: Three, omega: Three
) -> Sliding | None:
    """
    Parts of `add_sliding_power` of what acts along the normals of faces without friction.

    The axes e_j turn by Rodrigues' formula, so force and torque on body axes, which are linear in
    them, have three parts; so have the components e_i . v, while e_i . omega stays.
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
        along = p * ox, p * oy, p * oz, q * ox, q * oy, q * oz, r * ox, r * oy, r * oz
        at = SLIDING * LANES * row
        forces = (
            *on_body(sliding, at, axes), *on_body(sliding, at, across),
            *on_body(sliding, at, along))
        at = at + 27 * LANES
        torques = (
            along_spin(on_body(sliding, at, axes), p, q, r),
            along_spin(on_body(sliding, at, across), p, q, r),
            along_spin(on_body(sliding, at, along), p, q, r))
        return forces, (*seen(axes, v), *seen(across, v), *seen(along, v)), torques


@compiled
def on_body(sliding: np.ndarray, at: int, axes: Nine) -> Three:
    """Three contractions."""
    return (
        contracted(sliding, at, axes), contracted(sliding, at + 9 * LANES, axes),
        contracted(sliding, at + 18 * LANES, axes))


@compiled
def along_spin(torque: Three, p: Vector, q: Vector, r: Vector) -> Vector:
    """Power [W] of a torque on body axes, along which the spin is p, q, r."""
    return fma(torque[0], p, fma(torque[1], q, torque[2] * r))


@compiled
def seen(axes: Nine, v: Three) -> Three:
    """Components of a vector along axes."""
    return (
        fma(axes[0], v[0], fma(axes[1], v[1], axes[2] * v[2])),
        fma(axes[3], v[0], fma(axes[4], v[1], axes[5] * v[2])),
        fma(axes[6], v[0], fma(axes[7], v[1], axes[8] * v[2])))


@compiled
def mean_products(h: float, omega: Three) -> Six:
    """Means over a time from 0 to `h` [s] of the products of the three `turn_factors`."""
    zero = splat(0.0)
    aa, ab, ac, bb, bc, cc = zero, zero, zero, zero, zero, zero
    for node in range(5):
        weight = splat(_WEIGHTS[node])
        one, two, three = turn_factors(_NODES[node] * h, omega[0], omega[1], omega[2])
        first, second, third = weight * one, weight * two, weight * three
        aa, ab, ac = fma(first, one, aa), fma(first, two, ab), fma(first, three, ac)
        bb, bc, cc = fma(second, two, bb), fma(second, three, bc), fma(third, three, cc)
    return aa, ab, ac, bb, bc, cc


@compiled
def add_mean_sliding(
    slid: Sliding | None, factors: Three, omega: Three, h: float, power: Vector
) -> Vector:
    """Add its mean over a time from 0 to `h` [s]; `factors`: the means of these."""
    if slid is None:
        return power
    else:
        forces, speeds, torques = slid
        power = fma(factors[0], torques[0], fma(
            factors[1], torques[1], fma(factors[2], torques[2], power)))
        aa, ab, ac, bb, bc, cc = mean_products(h, omega)
        for k in range(3):
            f, g, e = forces[k], forces[k + 3], forces[k + 6]
            u, v, w = speeds[k], speeds[k + 3], speeds[k + 6]
            power = fma(f, fma(aa, u, fma(ab, v, ac * w)), power)
            power = fma(g, fma(ab, u, fma(bb, v, bc * w)), power)
            power = fma(e, fma(ac, u, fma(bc, v, cc * w)), power)
        return power


@compiled
def add_sliding_power(slid: Sliding | None, factors: Three, power: Vector) -> Vector:
    """Add the power [W] of these parts with cos x, sin x / |omega|, (1 - cos x) / |omega|^2."""
    if slid is None:
        return power
    else:
        forces, speeds, torques = slid
        one, two, three = factors
        power = fma(one, torques[0], fma(two, torques[1], fma(three, torques[2], power)))
        power = fma(
            fma(one, forces[0], fma(two, forces[3], three * forces[6])),
            fma(one, speeds[0], fma(two, speeds[3], three * speeds[6])), power)
        power = fma(
            fma(one, forces[1], fma(two, forces[4], three * forces[7])),
            fma(one, speeds[1], fma(two, speeds[4], three * speeds[7])), power)
        return fma(
            fma(one, forces[2], fma(two, forces[5], three * forces[8])),
            fma(one, speeds[2], fma(two, speeds[5], three * speeds[8])), power)
