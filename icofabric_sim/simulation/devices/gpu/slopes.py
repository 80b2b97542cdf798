# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Kernels of an embedded Runge-Kutta pair on a GPU: slopes, stages, errors and energy flows.

The formulas are those of kernels/rhs.py, probable_error.py and terms, with one thread per
body. A stage is written to separate arrays, which the next launch reads, so that no thread reads
what another thread writes.
"""

from functools import cache
from importlib import import_module
from typing import Any, NamedTuple

from icofabric_sim.simulation.devices.gpu.contact import way_of
from icofabric_sim.simulation.devices.gpu.forces import (
    anchor_pull,
    arm_anywhere,
    arm_at_midpoint,
    by_laws,
    dampers,
    factor_of,
    moments,
    no_dampers,
    no_moments,
    no_pulls,
    one_law,
    own_law,
    place_of,
    springs,
    turn_of,
    wrench_of,
)
from icofabric_sim.simulation.devices.gpu.kernels import Terms
from icofabric_sim.simulation.devices.gpu.monitor import larger, SHARE
from icofabric_sim.simulation.devices.gpu.options import MOST_REGISTERS, OPTIONS
from icofabric_sim.simulation.devices.gpu.paths import left_free, path_of, path_power
from icofabric_sim.simulation.devices.gpu.records import Acting, Fabric, Nearness
from icofabric_sim.simulation.devices.gpu.rotations import to_world

wp: Any = import_module('warp')

_DOUBLE = wp.float64
_ZERO_F64, _HALF, _ONE, _TWO, _TWENTY = (
    wp.constant(_DOUBLE(x)) for x in (0.0, 0.5, 1.0, 2.0, 20.0))
_TINY, _HUNDREDTH = wp.constant(_DOUBLE(1e-300)), wp.constant(_DOUBLE(0.01))
_SLOPE, _KINK = wp.constant(_DOUBLE(26.0)), wp.constant(_DOUBLE(1.7))
# Rows of a state and of its slope: position, orientation, velocity, spin.
STATE_ROW_COUNT = 13
# First rows of each quantity; without contacts and arms the last one is the spin.
_FIRSTS = wp.constant(wp.types.vector(length=5, dtype=wp.int32)(0, 3, 7, 10, 13))


class Losses(NamedTuple):
    """Dissipative terms of a scene; the kernel has no code for other terms."""

    damped: bool
    dragged: bool


@wp.func
def slot_of(fabric: Fabric, thread: int):
    """Return the slot of the body of a thread; -1 without a body."""
    block = thread / fabric.lanes
    lane = thread - block * fabric.lanes
    if (int(fabric.alive[block]) >> lane) & 1 == 0:
        return -1
    return fabric.slot[block] + lane


@cache
def slope_kernel(terms: Terms, losses: Losses) -> Any:
    """Return the kernel of slopes for scenes with these terms."""
    arm_to = arm_at_midpoint if terms.midpoints else arm_anywhere
    pulls = no_pulls
    if terms.linked:
        pulls = springs(by_laws(one_law if terms.one_law else own_law, terms.laws), arm_to)
    resistance = moments(arm_to) if terms.moments else no_moments
    held, loaded, dipole = terms.held, terms.loaded, terms.dipole
    damped, dragged = losses
    touching, driven, own_masses = terms.touching, terms.driven, terms.own_masses
    losing = dampers(arm_to) if damped and terms.linked else no_dampers

    @wp.kernel(
        module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False,
        cuda_max_registers=MOST_REGISTERS)
    def find_slope(
        fabric: Fabric, acting: Acting, near: Nearness, time: wp.float64, index: int,
        pose: wp.array(dtype=wp.float64), motion: wp.array(dtype=wp.float64),
        slopes: wp.array2d(dtype=wp.float64), spent: wp.array2d(dtype=wp.float64),
        power: wp.array2d(dtype=wp.float64)
    ):
        thread = wp.tid()
        s = slot_of(fabric, thread)
        if s < 0:
            return
        block = thread / fabric.lanes
        lane = thread - block * fabric.lanes
        n = fabric.stride
        place, turn = place_of(pose, n, s), turn_of(pose, n, s)
        velocity = wp.vec3d(motion[s], motion[n + s], motion[2 * n + s])
        spin = wp.vec3d(motion[3 * n + s], motion[4 * n + s], motion[5 * n + s])
        mass = wp.vec3d(fabric.inverse_mass, fabric.inverse_mass, fabric.inverse_mass)
        inertia = fabric.inverse_inertia
        weight = fabric.gravity
        if wp.static(held):
            mass = wp.vec3d(
                fabric.free_mass[s], fabric.free_mass[n + s], fabric.free_mass[2 * n + s])
            inertia = fabric.free_inertia[s]
            for k in range(3):
                if mass[k] == _ZERO_F64:
                    weight[k] = _ZERO_F64
        force, torque = pulls(fabric, pose, block, lane, s, place, turn, -_ONE)
        more, moment = resistance(fabric, pose, block, lane, s, place, turn)
        force, torque = force + more, torque + moment
        if wp.static(dipole):
            torque = torque + wp.cross(to_world(turn, fabric.dipole), fabric.field)
        if wp.static(touching):
            force = force + wp.vec3d(near.rows[s], near.rows[n + s], near.rows[2 * n + s])
            torque = torque + wp.vec3d(
                near.rows[3 * n + s], near.rows[4 * n + s], near.rows[5 * n + s])
        if wp.static(damped or dragged):
            taken = _ZERO_F64
            more, moment, taken = losing(
                fabric, pose, motion, block, lane, s, place, turn, velocity, spin)
            force, torque = force + more, torque + moment
            if wp.static(dragged):
                force = force - fabric.drag_linear * velocity
                torque = torque - fabric.drag_angular * spin
                taken = taken + (
                    fabric.drag_linear * wp.dot(velocity, velocity)
                    + fabric.drag_angular * wp.dot(spin, spin))
            spent[index, s] = taken
        if wp.static(loaded):
            for m in range(acting.start[block], acting.start[block + 1]):
                at = fabric.lanes * m + lane
                given = _ZERO_F64
                if (int(acting.lanes[m]) >> lane) & 1 == 1:
                    w = acting.wrench[m]
                    if w >= 0:
                        push, turning = wrench_of(acting, turn, w)
                        factor = factor_of(acting, w, time)
                        push, turning = factor * push, factor * turning
                        given = wp.dot(push, velocity) + wp.dot(turning, spin)
                        force, torque = force + push, torque + turning
                    elif path_of(acting, m) < 0:
                        push, turning, given = anchor_pull(
                            acting, -1 - w - acting.paths, place, turn, time)
                        force, torque = force + push, torque + turning
                power[index, at] = given
        linear = wp.cw_mul(force, mass) + weight
        angular = inertia * torque
        if wp.static(driven):
            weighed, turned = _ONE / fabric.inverse_mass, _ONE / fabric.inverse_inertia
            if wp.static(own_masses):
                weighed, turned = _ONE * fabric.own_mass[s], _ONE * fabric.own_inertia[s]
            for m in range(acting.start[block], acting.start[block + 1]):
                p = path_of(acting, m)
                if (int(acting.lanes[m]) >> lane) & 1 == 1 and p >= 0:
                    power[index, fabric.lanes * m + lane] = -path_power(
                        acting, p, weighed, turned, velocity, spin, linear, angular)
                    linear, angular = left_free(acting, p, linear, angular)
        for k in range(3):
            slopes[index, k * n + s] = velocity[k]
            slopes[index, (k + 7) * n + s] = linear[k]
            slopes[index, (k + 10) * n + s] = angular[k]
        half = _HALF * spin
        # dq/dt = omega q / 2 (eq 22), scalar last.
        vector = wp.vec3d(turn[0], turn[1], turn[2])
        change = turn[3] * half + wp.cross(half, vector)
        for k in range(3):
            slopes[index, (k + 3) * n + s] = change[k]
        slopes[index, 6 * n + s] = -wp.dot(half, vector)
    return find_slope


@wp.kernel(module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
def combine(
    fabric: Fabric, weights: wp.array(dtype=wp.float64), h: wp.float64, ends: int,
    slopes: wp.array2d(dtype=wp.float64), pose: wp.array(dtype=wp.float64),
    motion: wp.array(dtype=wp.float64), to_pose: wp.array(dtype=wp.float64),
    to_motion: wp.array(dtype=wp.float64)
):
    """
    Compute a stage of a step of `h` [s]; the end of the step, with unit quaternion, if `ends`.
    """
    s = slot_of(fabric, wp.tid())
    if s < 0:
        return
    n = fabric.stride
    for k in range(13):
        total = wp.float64(0.0)
        for j in range(weights.shape[0]):
            # Many weights of high-order methods are 0.
            if weights[j] != _ZERO_F64:
                total = total + weights[j] * slopes[j, k * n + s]
        if k < 7:
            to_pose[k * n + s] = pose[k * n + s] + h * total
        else:
            at = (k - 7) * n + s
            to_motion[at] = motion[at] + h * total
    if ends != 0:
        turn = turn_of(to_pose, n, s)
        scale = _ONE / wp.sqrt(wp.dot(turn, turn))
        for k in range(4):
            to_pose[(k + 3) * n + s] = scale * turn[k]


@wp.kernel(module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
def judge(
    fabric: Fabric, error_5: wp.array(dtype=wp.float64), error_3: wp.array(dtype=wp.float64),
    scales: wp.vec4d, smooth: wp.float64, slopes: wp.array2d(dtype=wp.float64),
    found: wp.array2d(dtype=wp.float64)
):
    """Compute the error of a step of length 1 for each body, for step control and as estimate."""
    thread = wp.tid()
    found[0, thread] = _ZERO_F64
    found[1, thread] = _ZERO_F64
    s = slot_of(fabric, thread)
    if s < 0:
        return
    n = fabric.stride
    largest_5, largest_3, squares = wp.float64(0.0), wp.float64(0.0), wp.float64(0.0)
    for part in range(4):
        square_5, square_3 = wp.float64(0.0), wp.float64(0.0)
        for k in range(_FIRSTS[part], _FIRSTS[part + 1]):
            first, second = wp.float64(0.0), wp.float64(0.0)
            for j in range(error_5.shape[0]):
                value = slopes[j, k * n + s]
                first = first + error_5[j] * value
                second = second + error_3[j] * value
            square_5 = square_5 + first * first
            square_3 = square_3 + second * second
        squares = squares + (square_5 + square_3)
        largest_5 = wp.max(largest_5, scales[part] * square_5)
        largest_3 = wp.max(largest_3, scales[part] * square_3)
    # wp.max drops NaN; a product with 0 keeps it.
    found[0, thread] = largest_5 / wp.sqrt(
        wp.max(largest_5 + _HUNDREDTH * largest_3, _TINY)) + _ZERO_F64 * squares
    # See kernels/probable_error.py.
    of_5, of_3 = wp.sqrt(largest_5), wp.sqrt(largest_3)
    ratio = wp.min(of_5 / wp.sqrt(wp.max(largest_3, _TINY)), _ONE)
    probable = (_SLOPE * ratio * wp.sqrt(ratio) / (_TWENTY * ratio + _ONE)) * of_5
    found[1, thread] = wp.max(probable, _KINK * (of_5 - smooth * of_3))


@wp.kernel(module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
def find_quickest(
    fabric: Fabric, near: Nearness, time: wp.float64, stages: int, mean: wp.vec3d,
    slopes: wp.array2d(dtype=wp.float64), pose: wp.array(dtype=wp.float64),
    found: wp.array2d(dtype=wp.float64)
):
    """
    Compute the largest speed [m/s] of a point of each body relative to `mean` at all stages.

    Also computes its squared displacement [m^2] since the last search at `time` [s], the start of
    the step, as `fastest_points` of terms/contacts/clearance.py.
    """
    thread = wp.tid()
    found[0, thread] = _ZERO_F64
    found[1, thread] = _ZERO_F64
    s = slot_of(fabric, thread)
    if s < 0:
        return
    n = fabric.stride
    fastest, spin = wp.float64(0.0), wp.float64(0.0)
    for j in range(stages):
        u = wp.vec3d(slopes[j, s], slopes[j, n + s], slopes[j, 2 * n + s]) - mean
        fastest = wp.max(fastest, wp.dot(u, u))
        square = wp.float64(0.0)
        for k in range(3, 7):
            square = square + slopes[j, k * n + s] * slopes[j, k * n + s]
        spin = wp.max(spin, square)
    found[0, thread] = wp.sqrt(fastest) + _TWO * near.radius * wp.sqrt(spin)
    found[1, thread] = way_of(near, pose, n, s, time)


@wp.kernel(module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
def fold_largest(
    count: int, values: wp.array2d(dtype=wp.float64), folded: wp.array2d(dtype=wp.float64)
):
    """Compute the largest of some values in each row; infinite if any is NaN."""
    row, share = wp.tid()
    total = wp.float64(0.0)
    for k in range(SHARE * share, wp.min(SHARE * share + SHARE, count)):
        total = larger(total, values[row, k])
    folded[row, share] = total


@wp.kernel(module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
def add_flow(
    weights: wp.array(dtype=wp.float64), h: wp.float64, power: wp.array2d(dtype=wp.float64),
    keeps: int, done: wp.array(dtype=wp.float64), before: wp.array(dtype=wp.float64)
):
    """
    Add the energies [J] that flow in a step: the weighted sums of powers.

    If `keeps` is not 0, the values of `done` are first copied to `before`.
    """
    at = wp.tid()
    total = wp.float64(0.0)
    for j in range(weights.shape[0]):
        total = total + weights[j] * power[j, at]
    if keeps != 0:
        before[at] = done[at]
    done[at] = done[at] + h * total
