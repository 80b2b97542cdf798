# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A leapfrog for springs alone, with which `icofabric benchmark terms` compares the package.

The layout of bodies, the vector functions and the leapfrog are those of the package, but the
kernel only has quaternions and springs: no gravity, supports, loads, threads or health checks. The
excess time of the package is the cost of terms that a scene does not have.
"""

from icofabric_sim.kernels.records import Links, State
from icofabric_sim.kernels.rotations import half_angle_factors
import icofabric_sim.kernels.runtime.lanes as lanes
from icofabric_sim.kernels.runtime.lanes import fma, load, load_at, splat, store, store_at
import numba
import numpy as np

# Number of blocks that are drifted and kicked together, as in the package.
TILE = 64

compiled = numba.njit(nogil=True, error_model='numpy')
# As in the package, for functions of every block.
inlined = numba.njit(nogil=True, error_model='numpy', forceinline=True)


@inlined
def pull(links, points, stride, block, first, stiffness, minus_rest, px, py, pz):
    """Return the forces of the two connectors at one edge, whose points are p."""
    zero = splat(0.0)
    fx, fy, fz = zero, zero, zero
    for link in range(first, first + 2):
        place = links.place[block, link]
        ux = load_at(points, place) - px
        uy = load_at(points, place + stride) - py
        uz = load_at(points, place + 2 * stride) - pz
        square = lanes.maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(1e-300))
        factor = fma(minus_rest, lanes.rsqrt(square), stiffness)
        factor = lanes.where(lanes.bits(links.present[block, link]), factor, zero)
        fx, fy, fz = fma(factor, ux, fx), fma(factor, uy, fy), fma(factor, uz, fz)
    return fx, fy, fz


@inlined
def springs(links, points, stride, block, s):
    """Return force and torque of all springs on a block."""
    zero = splat(0.0)
    fx, fy, fz, tx, ty, tz = zero, zero, zero, zero, zero, zero
    stiffness = splat(links.stiffness)
    minus_rest = splat(-links.stiffness * links.natural_length)
    for pair in range(3):
        at = 6 * pair * stride + s
        px, py = load_at(points, at), load_at(points, at + stride)
        pz, mx = load_at(points, at + 2 * stride), load_at(points, at + 3 * stride)
        my, mz = load_at(points, at + 4 * stride), load_at(points, at + 5 * stride)
        ax, ay, az = pull(
            links, points, stride, block, 4 * pair, stiffness, minus_rest, px, py, pz)
        bx, by, bz = pull(
            links, points, stride, block, 4 * pair + 2, stiffness, minus_rest, mx, my, mz)
        fx, fy, fz = fx + (ax + bx), fy + (ay + by), fz + (az + bz)
        sx, sy, sz = px - mx, py - my, pz - mz
        ax, ay, az = ax - bx, ay - by, az - bz
        tx = fma(sy, az, tx - sz * ay)
        ty = fma(sz, ax, ty - sx * az)
        tz = fma(sx, ay, tz - sy * ax)
    half = splat(0.5)
    return fx, fy, fz, half * tx, half * ty, half * tz


@inlined
def kick(state, a, h, s):
    """Add h times the accelerations to the velocities of a block."""
    step = splat(h)
    velocity, spin = state.linear_velocity, state.angular_velocity
    for k in range(3):
        store(velocity, k, s, fma(step, a[k], load(velocity, k, s)))
        store(spin, k, s, fma(step, a[k + 3], load(spin, k, s)))


@compiled
def push(links, slot, inverse_mass, inverse_inertia, state, points, acceleration, h, again, keep,
         first, last):
    """Kick by `h`, and by `again` if not 0; store the accelerations if `keep`."""
    stride = state.position.shape[1]
    mass, inertia = splat(inverse_mass), splat(inverse_inertia)
    for block in range(first, last):
        s = slot[block]
        fx, fy, fz, tx, ty, tz = springs(links, points, stride, block, s)
        a = (fx * mass, fy * mass, fz * mass, tx * inertia, ty * inertia, tz * inertia)
        kick(state, a, h, s)
        if again != 0.0:
            kick(state, a, again, s)
        if keep:
            for k in range(3):
                store(acceleration, k, s, a[k])
                store(acceleration, k + 3, s, a[k + 3])


@compiled
def push_once(links, slot, inverse_mass, inverse_inertia, state, points, h, first, last):
    """Kick by `h` only, the least work of a step."""
    stride = state.position.shape[1]
    mass, inertia = splat(inverse_mass), splat(inverse_inertia)
    for block in range(first, last):
        s = slot[block]
        fx, fy, fz, tx, ty, tz = springs(links, points, stride, block, s)
        kick(state, (fx * mass, fy * mass, fz * mass, tx * inertia, ty * inertia, tz * inertia),
             h, s)


@compiled
def push_kept(slot, state, acceleration, h, first, last):
    """Kick by `h` with stored accelerations."""
    step = splat(h)
    for block in range(first, last):
        s = slot[block]
        for k in range(3):
            store(state.linear_velocity, k, s, fma(
                step, load(acceleration, k, s), load(state.linear_velocity, k, s)))
            store(state.angular_velocity, k, s, fma(
                step, load(acceleration, k + 3, s), load(state.angular_velocity, k, s)))


@compiled
def drift(half_width, slot, state, points, h, first, last):
    """Move and rotate freely over `h`, then update the attachment points."""
    step, zero, width = splat(h), splat(0.0), splat(half_width)
    twice, less = splat(2.0 * half_width), splat(-2.0 * half_width)
    position, orientation = state.position, state.orientation
    stride = position.shape[1]
    for block in range(first, last):
        s = slot[block]
        px = fma(step, load(state.linear_velocity, 0, s), load(position, 0, s))
        py = fma(step, load(state.linear_velocity, 1, s), load(position, 1, s))
        pz = fma(step, load(state.linear_velocity, 2, s), load(position, 2, s))
        store(position, 0, s, px)
        store(position, 1, s, py)
        store(position, 2, s, pz)
        ox, oy = load(state.angular_velocity, 0, s), load(state.angular_velocity, 1, s)
        oz = load(state.angular_velocity, 2, s)
        cosine, sine = half_angle_factors(h, ox, oy, oz)
        ux, uy, uz = sine * ox, sine * oy, sine * oz
        mx, my, mz = zero - ux, zero - uy, zero - uz
        x, y = load(orientation, 0, s), load(orientation, 1, s)
        z, w = load(orientation, 2, s), load(orientation, 3, s)
        nx = fma(cosine, x, fma(ux, w, fma(uy, z, mz * y)))
        ny = fma(cosine, y, fma(uy, w, fma(uz, x, mx * z)))
        nz = fma(cosine, z, fma(uz, w, fma(ux, y, my * x)))
        nw = fma(cosine, w, fma(mx, x, fma(my, y, mz * z)))
        norm = fma(nx, nx, fma(ny, ny, fma(nz, nz, nw * nw)))
        scale = fma(splat(-0.5), norm, splat(1.5))
        x, y, z, w = nx * scale, ny * scale, nz * scale, nw * scale
        store(orientation, 0, s, x)
        store(orientation, 1, s, y)
        store(orientation, 2, s, z)
        store(orientation, 3, s, w)
        place(points, s, stride, px, py, pz, twice * fma(x, z, w * y),
              twice * fma(y, z, (zero - w) * x), fma(less, fma(x, x, y * y), width))
        place(points, 6 * stride + s, stride, px, py, pz, fma(less, fma(y, y, z * z), width),
              twice * fma(x, y, w * z), twice * fma(x, z, (zero - w) * y))
        place(points, 12 * stride + s, stride, px, py, pz, twice * fma(x, y, (zero - w) * z),
              fma(less, fma(x, x, z * z), width), twice * fma(y, z, w * x))


@inlined
def place(points, at, stride, px, py, pz, ax, ay, az):
    """Set both points of an axis of the bodies."""
    store_at(points, at, px + ax)
    store_at(points, at + stride, py + ay)
    store_at(points, at + 2 * stride, pz + az)
    store_at(points, at + 3 * stride, px - ax)
    store_at(points, at + 4 * stride, py - ay)
    store_at(points, at + 5 * stride, pz - az)


@compiled
def leapfrog(links: Links, slot: np.ndarray, reach: int, inverse_mass: float,
             inverse_inertia: float, state: State, points: np.ndarray, acceleration: np.ndarray,
             h: float, count: int) -> None:
    """Take `count` steps: kick, drift, kick; the state has its accelerations."""
    last = slot.shape[0]
    push_kept(slot, state, acceleration, 0.5 * h, 0, last)
    for step in range(count):
        keep = step + 1 == count
        again = 0.0 if keep else 0.5 * h
        ahead = 0
        for start in range(0, last, TILE):
            end = min(start + TILE, last)
            goal = min(end + reach, last)
            drift(links.half_width, slot, state, points, h, ahead, goal)
            ahead = goal
            push(links, slot, inverse_mass, inverse_inertia, state, points, acceleration,
                 0.5 * h, again, keep, start, end)


@compiled
def leapfrog_once(links: Links, slot: np.ndarray, reach: int, inverse_mass: float,
                  inverse_inertia: float, state: State, points: np.ndarray, h: float,
                  count: int) -> None:
    """Take `count` steps with velocities half a step behind the positions: one kick each."""
    last = slot.shape[0]
    for _ in range(count):
        ahead = 0
        for start in range(0, last, TILE):
            end = min(start + TILE, last)
            goal = min(end + reach, last)
            drift(links.half_width, slot, state, points, h, ahead, goal)
            ahead = goal
            push_once(links, slot, inverse_mass, inverse_inertia, state, points, h, start, end)
