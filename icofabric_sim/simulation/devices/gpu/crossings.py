# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Steps on a GPU that keep their order across jumps of the slopes of connectors.

The treatment of kinks is explained in kernels/kinks.py, and the formulas are the same, body by
body. A step is a sequence of launches without branches: launches that correct a step test a flag
that bodies with crossings set.
"""

from collections.abc import Iterator
from functools import cache
from importlib import import_module
from typing import Any

from icofabric_sim.simulation.devices.gpu.forces import (
    arm_anywhere,
    arm_at_midpoint,
    has_link,
    partner_of,
    place_of,
    turn_of,
)
from icofabric_sim.simulation.devices.gpu.options import OPTIONS
from icofabric_sim.simulation.devices.gpu.records import Clock, Fabric, Stage
from icofabric_sim.simulation.stepping.methods import Method
import numpy as np

wp: Any = import_module('warp')

_DOUBLE = wp.float64
_ZERO_F64, _HALF, _ONE = (wp.constant(_DOUBLE(x)) for x in (0.0, 0.5, 1.0))
_MIN_SQUARE = wp.constant(_DOUBLE(1e-300))
# Steps of Newton's method towards a crossing.
_NEWTON = wp.constant(2)
_Three = wp.types.vector(length=3, dtype=_DOUBLE)
_Four = wp.types.vector(length=4, dtype=_DOUBLE)
_Six = wp.types.vector(length=6, dtype=_DOUBLE)
_FourByFour = wp.types.matrix(shape=(4, 4), dtype=_DOUBLE)


def _gauss(count: int, kind: Any) -> tuple[Any, Any]:
    """Return nodes and weights of the Gauss-Legendre rule on [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return wp.constant(kind(*(0.5 * float(1.0 + x) for x in nodes))), wp.constant(
        kind(*(0.5 * float(w) for w in weights)))


# Exact for a quintic times the time, and for a quadratic times the cube of the time.
_NODES, _WEIGHTS = _gauss(4, _Four)
_FEWER_NODES, _FEWER_WEIGHTS = _gauss(3, _Three)
# From moments to their cubic: the inverse of the Hilbert matrix.
_CUBIC = wp.constant(_FourByFour(
    16.0, -120.0, 240.0, -140.0, -120.0, 1200.0, -2700.0, 1680.0,
    240.0, -2700.0, 6480.0, -4200.0, -140.0, 1680.0, -4200.0, 2800.0))


@wp.func
def value_of(c: _Six, x: wp.float64):
    """Return the value of a quintic at x."""
    return c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * (c[4] + x * c[5]))))


@wp.func
def slope_at(c: _Six, x: wp.float64):
    """Return the derivative of a quintic at x."""
    return c[1] + x * ((c[2] + c[2]) + x * (_DOUBLE(3.0) * c[3] + x * (
        _DOUBLE(4.0) * c[4] + x * (_DOUBLE(5.0) * c[5]))))


@wp.func
def crossing(c: _Six, first: wp.float64, last: wp.float64, turn: wp.float64):
    """Return the zero of a quintic in an interval, falling for `turn` 1, rising for -1."""
    low, high = first, last
    above, below = turn * value_of(c, low), turn * value_of(c, high)
    fall = above - below
    x = low + (high - low) * (above / wp.where(fall > _ZERO_F64, fall, _ONE))
    for _step in range(_NEWTON):
        middle = _HALF * (low + high)
        if x < low or x > high:
            x = middle
        value, slope = turn * value_of(c, x), turn * slope_at(c, x)
        if value > _ZERO_F64:
            low = x
        else:
            high = x
        x = wp.where(
            slope < _ZERO_F64, x - value / wp.where(slope < _ZERO_F64, slope, -_ONE),
            _HALF * (low + high))
    if x < low or x > high:
        x = _HALF * (low + high)
    return x


@wp.func
def moments_beyond(c: _Six):
    """
    Return the integrals of g and s g over the part of [0, 1] where the quintic g is negative.
    """
    a, b = wp.float64(0.0), wp.float64(0.0)
    early, late = value_of(c, _HALF) < _ZERO_F64, value_of(c, _ONE) < _ZERO_F64
    if early or late:
        begin = crossing(
            c, wp.where(early, _ZERO_F64, _HALF), wp.where(early, _HALF, _ONE), _ONE)
        end = wp.float64(1.0)
        if early and not late:
            end = crossing(c, _HALF, _ONE, -_ONE)
        span = end - begin
        for k in range(4):
            x = begin + span * _NODES[k]
            term = _WEIGHTS[k] * span * value_of(c, x)
            a = a + term
            b = b + x * term
    return a, b


@wp.func
def moments_foretold(c: _Six):
    """Return the integrals of g, s g, s^2 g, s^3 g where a quadratic g is negative in [0, 1]."""
    found = _Four()
    early, late = value_of(c, _HALF) < _ZERO_F64, value_of(c, _ONE) < _ZERO_F64
    if early or late:
        root = c[1] * c[1] - _DOUBLE(4.0) * c[2] * c[0]
        lower = wp.sqrt(wp.max(root, _ZERO_F64)) - c[1]
        begin = (c[0] + c[0]) / wp.where(lower > _ZERO_F64, lower, _ONE)
        end = wp.float64(1.0)
        if early and not late:
            end = lower / wp.where(c[2] > _ZERO_F64, c[2] + c[2], _ONE)
        span = end - begin
        for k in range(3):
            x = begin + span * _FEWER_NODES[k]
            term = _FEWER_WEIGHTS[k] * span * value_of(c, x)
            powers = _Four(term, x * term, x * (x * term), x * (x * (x * term)))
            found = found + powers
    return found


@wp.kernel(module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
def note(
    fabric: Fabric, clock: Clock, kick: wp.float64, begins: int,
    before: wp.array(dtype=wp.float64), motion: wp.array(dtype=wp.float64),
    noted: wp.array(dtype=wp.float64)
):
    """
    Store velocities and accelerations of each body, from those before and after a kick.

    Velocities are those before the kick if the kick `begins` a step, else those after. The result
    has twelve rows.
    """
    thread = wp.tid()
    block = thread / fabric.lanes
    lane = thread - block * fabric.lanes
    if (int(fabric.alive[block]) >> lane) & 1 == 0:
        return
    if begins == 1 and thread == 0:
        fabric.found[0] = 0
    s = fabric.slot[block] + lane
    n = fabric.stride
    per = _ONE / wp.abs(kick * clock.start[1])
    for k in range(6):
        at = k * n + s
        noted[at] = wp.where(begins == 1, before[at], motion[at])
        noted[6 * n + at] = per * (motion[at] - before[at])


@wp.func
def rate_of(noted: wp.array(dtype=wp.float64), n: int, s: int, arm: wp.vec3d):
    """Return the velocity [m/s] of an attachment point."""
    spin = wp.vec3d(noted[3 * n + s], noted[4 * n + s], noted[5 * n + s])
    return wp.vec3d(noted[s], noted[n + s], noted[2 * n + s]) + wp.cross(spin, arm)


@wp.func
def second_of(noted: wp.array(dtype=wp.float64), n: int, s: int, arm: wp.vec3d):
    """Return the acceleration [m/s^2] of an attachment point."""
    spin = wp.vec3d(noted[3 * n + s], noted[4 * n + s], noted[5 * n + s])
    linear = wp.vec3d(noted[6 * n + s], noted[7 * n + s], noted[8 * n + s])
    angular = wp.vec3d(noted[9 * n + s], noted[10 * n + s], noted[11 * n + s])
    return linear + (wp.cross(angular, arm) + wp.cross(spin, wp.cross(spin, arm)))


@wp.func
def stretch_of(
    fabric: Fabric, noted: wp.array(dtype=wp.float64), link: int, s: int, other: int,
    arm: wp.vec3d, far: wp.vec3d, u: wp.vec3d, h: wp.float64
):
    """
    Return extension, h times its rate and h^2 / 2 times its second derivative [m] of a connector.
    """
    n = fabric.stride
    v = rate_of(noted, n, other, far) - rate_of(noted, n, s, arm)
    a = second_of(noted, n, other, far) - second_of(noted, n, s, arm)
    length = wp.sqrt(wp.max(wp.dot(u, u), _MIN_SQUARE))
    rate = wp.dot(u, v) / length
    second = ((wp.dot(v, v) + wp.dot(u, a)) - rate * rate) / length
    return length - fabric.natural[link * n + s], h * rate, _HALF * h * h * second


@wp.func
def inverses(fabric: Fabric, s: int, held: int):
    """Return the inverse masses [1/kg] and inverse inertia [1/(kg m^2)] of a body."""
    n = fabric.stride
    mass = wp.vec3d(fabric.inverse_mass, fabric.inverse_mass, fabric.inverse_mass)
    inertia = fabric.inverse_inertia
    if held == 1:
        mass = wp.vec3d(
            fabric.free_mass[s], fabric.free_mass[n + s], fabric.free_mass[2 * n + s])
        inertia = fabric.free_inertia[s] + _ZERO_F64
    return mass, inertia


@wp.func
def strike_body(
    fabric: Fabric, motion: wp.array(dtype=wp.float64), s: int, held: int, impulse: wp.vec3d,
    turning: wp.vec3d
):
    """Apply an impulse [N s] and an angular impulse [N m s] to a body."""
    n = fabric.stride
    mass, inertia = inverses(fabric, s, held)
    for k in range(3):
        motion[k * n + s] = motion[k * n + s] + impulse[k] * mass[k]
        motion[(k + 3) * n + s] = motion[(k + 3) * n + s] + turning[k] * inertia


class Crossings:
    """Kernels for connectors attached at edge midpoints, or at any points."""

    def __init__(self, *, midpoints: bool) -> None:
        """Define the kernels, which are compiled at first use."""
        arm_to = arm_at_midpoint if midpoints else arm_anywhere

        @wp.kernel(
            module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
        def foretell(
            fabric: Fabric, clock: Clock, kick: wp.float64, held: int,
            pose: wp.array(dtype=wp.float64), noted: wp.array(dtype=wp.float64),
            motion: wp.array(dtype=wp.float64)
        ):
            thread = wp.tid()
            block = thread / fabric.lanes
            lane = thread - block * fabric.lanes
            if (int(fabric.alive[block]) >> lane) & 1 == 0:
                return
            s = fabric.slot[block] + lane
            n = fabric.stride
            h = clock.start[1]
            place, turn = place_of(pose, n, s), turn_of(pose, n, s)
            impulse, turning = wp.vec3d(), wp.vec3d()
            for link in range(12):
                at = link * n + s
                if has_link(fabric, block, lane, link) == 1:
                    edge = link >> 1
                    other = partner_of(fabric, block, lane, link)
                    arm = arm_to(fabric, turn, edge)
                    far = arm_to(fabric, turn_of(pose, n, other), edge ^ 1)
                    u = (place_of(pose, n, other) + far) - (place + arm)
                    e, v, a = stretch_of(fabric, noted, link, s, other, arm, far, u, h)
                    fabric.start[at] = e
                    fabric.start[12 * n + at] = v
                    fabric.start[24 * n + at] = a
                    jump = fabric.extension[at] - fabric.compression[at]
                    side = wp.where(e > _ZERO_F64, _ONE, -_ONE)
                    c = _Six(side * e, side * v, side * a, _ZERO_F64, _ZERO_F64, _ZERO_F64)
                    crosses = jump != _ZERO_F64 and (
                        value_of(c, _HALF) < _ZERO_F64 or value_of(c, _ONE) < _ZERO_F64)
                    fabric.active[at] = wp.where(crosses, wp.uint8(1), wp.uint8(0))
                    if crosses:
                        # On the other side, the stiffness is larger by - side x jump.
                        forces = -jump * (_CUBIC * moments_foretold(c))
                        for k in range(4):
                            fabric.forces[12 * k * n + at] = forces[k]
                        square = wp.max(wp.dot(u, u), _MIN_SQUARE)
                        pull = (kick * h * forces[0] / wp.sqrt(square)) * u
                        impulse = impulse + pull
                        turning = turning + wp.cross(arm, pull)
            strike_body(fabric, motion, s, held, impulse, turning)

        @wp.kernel(
            module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
        def account(
            fabric: Fabric, clock: Clock, pose: wp.array(dtype=wp.float64),
            noted: wp.array(dtype=wp.float64)
        ):
            thread = wp.tid()
            block = thread / fabric.lanes
            lane = thread - block * fabric.lanes
            if (int(fabric.alive[block]) >> lane) & 1 == 0:
                return
            s = fabric.slot[block] + lane
            n = fabric.stride
            h = clock.start[1]
            place, turn = place_of(pose, n, s), turn_of(pose, n, s)
            for link in range(12):
                at = link * n + s
                jump = fabric.extension[at] - fabric.compression[at]
                if has_link(fabric, block, lane, link) == 1 and jump != _ZERO_F64:
                    edge = link >> 1
                    other = partner_of(fabric, block, lane, link)
                    arm = arm_to(fabric, turn, edge)
                    far = arm_to(fabric, turn_of(pose, n, other), edge ^ 1)
                    u = (place_of(pose, n, other) + far) - (place + arm)
                    e, v, a = stretch_of(fabric, noted, link, s, other, arm, far, u, h)
                    first, rate = fabric.start[at], fabric.start[12 * n + at]
                    curve = fabric.start[24 * n + at]
                    side = wp.where(first > _ZERO_F64, _ONE, -_ONE)
                    d = side * (((e - first) - rate) - curve)
                    v = side * ((v - rate) - (curve + curve))
                    a = side * (a - curve)
                    c = _Six(
                        side * first, side * rate, side * curve,
                        _DOUBLE(10.0) * d + (a - _DOUBLE(4.0) * v),
                        _DOUBLE(-15.0) * d + (_DOUBLE(7.0) * v - (a + a)),
                        _DOUBLE(6.0) * d + (a - _DOUBLE(3.0) * v))
                    crosses = value_of(c, _HALF) < _ZERO_F64 or side * e < _ZERO_F64
                    was = int(fabric.active[at])
                    if crosses or was != 0:
                        whole, moment = wp.float64(0.0), wp.float64(0.0)
                        if crosses:
                            zeroth, first_moment = moments_beyond(c)
                            whole = -jump * zeroth
                            moment = -jump * (zeroth - first_moment)
                        if was != 0:
                            # Applied impulse, and impulse times the remaining time.
                            for k in range(4):
                                force = fabric.forces[12 * k * n + at]
                                order = _DOUBLE(k + 1)
                                whole = whole - force / order
                                moment = moment - force / (order * (order + _ONE))
                        early = _DOUBLE(2.0) * h * moment
                        fabric.forces[at] = h * whole - early
                        fabric.forces[12 * n + at] = early
                        fabric.active[at] = wp.uint8(2)
                        # All threads that write this flag write the same value.
                        fabric.found[0] = 1

        @wp.kernel(
            module='unique', enable_backward=False, module_options=OPTIONS, grid_stride=False)
        def strike(
            fabric: Fabric, row: int, held: int, pose: wp.array(dtype=wp.float64),
            motion: wp.array(dtype=wp.float64)
        ):
            thread = wp.tid()
            block = thread / fabric.lanes
            lane = thread - block * fabric.lanes
            if (int(fabric.alive[block]) >> lane) & 1 == 0 or fabric.found[0] == 0:
                return
            s = fabric.slot[block] + lane
            n = fabric.stride
            place, turn = place_of(pose, n, s), turn_of(pose, n, s)
            impulse, turning = wp.vec3d(), wp.vec3d()
            for link in range(12):
                at = link * n + s
                if has_link(fabric, block, lane, link) == 1 and int(fabric.active[at]) != 0:
                    edge = link >> 1
                    other = partner_of(fabric, block, lane, link)
                    arm = arm_to(fabric, turn, edge)
                    u = (place_of(pose, n, other) + arm_to(
                        fabric, turn_of(pose, n, other), edge ^ 1)) - (place + arm)
                    square = wp.max(wp.dot(u, u), _MIN_SQUARE)
                    pull = (fabric.forces[row * n + at] / wp.sqrt(square)) * u
                    impulse = impulse + pull
                    turning = turning + wp.cross(arm, pull)
            strike_body(fabric, motion, s, held, impulse, turning)

        self.foretell, self.account, self.strike = foretell, account, strike


@cache
def crossings(*, midpoints: bool) -> Crossings:
    """Return the kernels."""
    return Crossings(midpoints=midpoints)


def kinked_stages(method: Method, step: int) -> Iterator[Any]:
    """
    Yield the launches of the step kernel in one step, see `kinked_steps` of integrators/kinked.py.

    These are the first kick, drifts with the kicks after them, and the last kick. Launches that
    correct the step follow: back by half of it, forward to its end, and the accelerations there.
    """
    kicks, drifts = method.kicks, method.drifts
    first = Stage()
    first.source, first.kick, first.push_step = 1, kicks[0], step
    yield first
    part = 0.0
    for number in range(len(drifts) + 1):
        stage = Stage()
        if number:
            part += drifts[number - 1]
            stage.source, stage.kick, stage.step_part = 2, kicks[number], part
            stage.push_step, stage.push_drifts = step, number
            stage.keep = int(number == len(drifts))
        if number < len(drifts):
            stage.drift, stage.drift_step, stage.drift_drifts = drifts[number], step, number
        yield stage
    for turn, later in ((-0.5, 0.0), (0.5, -0.5)):
        stage = Stage()
        stage.drift, stage.drift_step, stage.drift_drifts = turn, step, len(drifts)
        stage.drift_later, stage.if_found = later, 1
        yield stage
    last = Stage()
    last.source, last.keep, last.step_part, last.if_found = 2, 1, -1.0, 1
    yield last
