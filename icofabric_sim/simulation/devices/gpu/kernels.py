# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The kernel that takes steps on a GPU: one thread per body, one launch per force evaluation.

A launch kicks a body at the present positions of all bodies and then drifts the body. Drifted
poses go to a second array, which the next launch reads. So no thread reads what another thread
writes, and the order of threads does not affect the result.
"""

from functools import cache
from importlib import import_module
from typing import Any, NamedTuple

from icofabric_sim.simulation.devices.gpu.forces import (
    anchor_pull,
    arm_anywhere,
    arm_at_midpoint,
    by_laws,
    factor_of,
    kept_law,
    mean_power,
    moments,
    no_moments,
    no_pulls,
    one_law,
    own_law,
    place_of,
    springs,
    turn_of,
    wrench_of,
)
from icofabric_sim.simulation.devices.gpu.options import MOST_REGISTERS, OPTIONS
from icofabric_sim.simulation.devices.gpu.paths import (
    borne,
    on_paths,
    path_of,
    resisted,
    standing,
)
from icofabric_sim.simulation.devices.gpu.records import (
    Acting,
    Clock,
    Fabric,
    Nearness,
    Stage,
)
from icofabric_sim.simulation.devices.gpu.rotations import rotated, to_world

wp: Any = import_module('warp')

_ZERO_F64, _ONE = wp.constant(wp.float64(0.0)), wp.constant(wp.float64(1.0))


class Terms(NamedTuple):
    """Terms of a scene; the kernel has no code for other terms."""

    linked: bool
    midpoints: bool  # connectors attach on the body axes
    one_law: bool  # all connectors follow one law, with k_e = k_c
    moments: bool
    dipole: bool
    held: bool
    loaded: bool
    # True if shells may touch, see contact.py.
    touching: bool = False
    # True if connectors keep their initial slopes in a step, see crossings.py.
    kept: bool = False
    # True if bodies move on paths, see paths.py; true if masses differ.
    driven: bool = False
    own_masses: bool = False
    # Names of laws that replace springs.
    laws: tuple[str, ...] = ()


@wp.func
def time_at(clock: Clock, step: int, drifts: int):
    """Return the time [s] in a step after `drifts` drifts, as kernels/integrators/splitting.py."""
    h = clock.start[1]
    number = clock.index[0] + wp.int64(step)
    count = clock.drifts.shape[0]
    if clock.kick_first == 1 and drifts == count:
        return clock.start[0] + wp.float64(number + wp.int64(1)) * h
    now = clock.start[0] + wp.float64(number) * h
    for i in range(drifts):
        now = now + clock.drifts[i] * h
    return now


@wp.func
def push_loads(
    fabric: Fabric, acting: Acting, block: int, lane: int, mass: wp.vec3d, inertia: wp.float64,
    place: wp.vec3d, turn: wp.vec4d, velocity: wp.vec3d, spin: wp.vec3d, time: wp.float64,
    h: wp.float64
):
    """Return the velocities of a body after its wrenches and anchors have acted over `h`."""
    v, o = velocity, spin
    for m in range(acting.start[block], acting.start[block + 1]):
        if (int(acting.lanes[m]) >> lane) & 1 == 1:
            w = acting.wrench[m]
            if w >= 0:
                force, torque = wrench_of(acting, turn, w)
                step = h * factor_of(acting, w, time)
                v = v + wp.cw_mul(step * mass, force)
                o = o + (step * inertia) * torque
            elif path_of(acting, m) < 0:
                pull, turning, power = anchor_pull(
                    acting, -1 - w - acting.paths, place, turn, time)
                v = v + wp.cw_mul(h * mass, pull)
                o = o + (h * inertia) * turning
                at = fabric.lanes * m + lane
                acting.work[at] = acting.work[at] + h * power
    return v, o


@wp.func
def work_loads(
    fabric: Fabric, acting: Acting, block: int, lane: int, turn: wp.vec4d, velocity: wp.vec3d,
    spin: wp.vec3d, time: wp.float64, h: wp.float64
):
    """Add the work of wrenches in a drift of `h`."""
    for m in range(acting.start[block], acting.start[block + 1]):
        if (int(acting.lanes[m]) >> lane) & 1 == 1:
            w = acting.wrench[m]
            if w >= 0:
                at = fabric.lanes * m + lane
                acting.work[at] = acting.work[at] + h * mean_power(
                    acting, w, turn, velocity, spin, time, h)


@cache
def step_kernel(terms: Terms) -> Any:
    """Return the kernel for scenes with these terms."""
    arm_to = arm_at_midpoint if terms.midpoints else arm_anywhere
    pulls = no_pulls
    if terms.linked:
        law = one_law if terms.one_law else own_law
        pulls = springs(by_laws(kept_law if terms.kept else law, terms.laws), arm_to)
    resistance = moments(arm_to) if terms.moments else no_moments
    held, loaded, dipole, kept = terms.held, terms.loaded, terms.dipole, terms.kept
    touching, driven, own_masses = terms.touching, terms.driven, terms.own_masses

    @wp.kernel(
        module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False,
        cuda_max_registers=MOST_REGISTERS)
    def push_and_drift(
        fabric: Fabric, acting: Acting, near: Nearness, clock: Clock, stage: Stage,
        pose: wp.array(dtype=wp.float64), moved: wp.array(dtype=wp.float64),
        motion: wp.array(dtype=wp.float64), acceleration: wp.array(dtype=wp.float64)
    ):
        thread = wp.tid()
        block = thread / fabric.lanes
        lane = thread - block * fabric.lanes
        if (int(fabric.alive[block]) >> lane) & 1 == 0:
            return
        if wp.static(kept):
            if stage.if_found == 1 and fabric.found[0] == 0:
                return
        s = fabric.slot[block] + lane
        n = fabric.stride
        h = clock.start[1]
        place, turn = place_of(pose, n, s), turn_of(pose, n, s)
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
        linear, angular = wp.vec3d(), wp.vec3d()
        if stage.source > 0:
            if stage.source == 1:
                linear = wp.vec3d(
                    acceleration[s], acceleration[n + s], acceleration[2 * n + s])
                angular = wp.vec3d(
                    acceleration[3 * n + s], acceleration[4 * n + s], acceleration[5 * n + s])
            else:
                force, torque = pulls(
                    fabric, pose, block, lane, s, place, turn, stage.step_part)
                more, moment = resistance(fabric, pose, block, lane, s, place, turn)
                moment = torque + moment
                if wp.static(dipole):
                    moment = moment + wp.cross(to_world(turn, fabric.dipole), fabric.field)
                if wp.static(touching):
                    more = more + wp.vec3d(near.rows[s], near.rows[n + s], near.rows[2 * n + s])
                    moment = moment + wp.vec3d(
                        near.rows[3 * n + s], near.rows[4 * n + s], near.rows[5 * n + s])
                linear = wp.cw_mul(force + more, mass) + weight
                angular = moment * inertia
            if stage.keep == 1:
                for k in range(3):
                    acceleration[k * n + s] = linear[k]
                    acceleration[(k + 3) * n + s] = angular[k]
        # Loaded when forces no longer occupy registers.
        velocity = wp.vec3d(motion[s], motion[n + s], motion[2 * n + s])
        spin = wp.vec3d(motion[3 * n + s], motion[4 * n + s], motion[5 * n + s])
        if stage.source > 0:
            if wp.static(driven):
                weighed, turned = _ONE / fabric.inverse_mass, _ONE / fabric.inverse_inertia
                if wp.static(own_masses):
                    weighed, turned = _ONE * fabric.own_mass[s], _ONE * fabric.own_inertia[s]
                linear, angular = resisted(
                    fabric, acting, block, lane, weighed, turned, velocity, spin, linear,
                    angular, stage.kick * h, stage.again * h)
            for part in range(2):
                # The last kick of a step and the first of the next share their forces.
                kick = wp.where(part == 0, stage.kick, stage.again) * h
                if kick != _ZERO_F64:
                    velocity = velocity + kick * linear
                    spin = spin + kick * angular
                    if wp.static(loaded):
                        kicked, whirled = push_loads(
                            fabric, acting, block, lane, mass, inertia, place, turn, velocity,
                            spin, time_at(clock, stage.push_step, stage.push_drifts), kick)
                        if wp.static(driven):
                            kicked, whirled = borne(
                                acting, block, lane, velocity, spin, kicked, whirled)
                        velocity, spin = kicked, whirled
            for k in range(3):
                motion[k * n + s] = velocity[k]
                motion[(k + 3) * n + s] = spin[k]
        if stage.drift != _ZERO_F64:
            for number in range(2):
                whole = wp.where(number == 0, stage.drift, stage.second) * h
                if whole != _ZERO_F64:
                    if wp.static(loaded):
                        step = wp.where(number == 0, stage.drift_step, stage.second_step)
                        drifts = wp.where(number == 0, stage.drift_drifts, 0)
                        later = wp.where(number == 0, stage.drift_later, _ZERO_F64)
                        now = time_at(clock, step, drifts) + later * h
                        if wp.static(driven):
                            velocity = standing(acting, block, lane, velocity)
                        work_loads(
                            fabric, acting, block, lane, turn, velocity, spin, now, whole)
                    place = place + whole * velocity
                    turn = rotated(turn, spin, whole)
                    if wp.static(driven):
                        place, turn, velocity, spin = on_paths(
                            acting, block, lane, s, n, now + whole, place, turn, velocity, spin)
            for k in range(3):
                moved[k * n + s] = place[k]
            for k in range(4):
                moved[(k + 3) * n + s] = turn[k]
            if wp.static(driven):
                for k in range(3):
                    motion[k * n + s] = velocity[k]
                    motion[(k + 3) * n + s] = spin[k]
    return push_and_drift


@wp.kernel(
    module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
def sample(
    slot: wp.array(dtype=wp.int32), samples: int, lanes: int, stride: int, weight: wp.float64,
    first: int, pose: wp.array(dtype=wp.float64), difference: wp.array(dtype=wp.float64)
):
    """Add poses of sampled blocks to a difference of high order, as kernels/monitor.py."""
    thread = wp.tid()
    i = thread / lanes
    lane = thread - i * lanes
    # Blocks spread over the fabric; 64 bits, as the product may be large.
    block = int(wp.int64(i) * wp.int64(slot.shape[0]) / wp.int64(samples))
    s = slot[block] + lane
    for k in range(7):
        at = k * lanes * samples + thread
        value = weight * pose[k * stride + s]
        if first == 0:
            value = value + difference[at]
        difference[at] = value
