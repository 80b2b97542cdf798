# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Forces and torques on one body on a GPU: connectors, moments, wrenches and anchors.

The formulas are those of terms/links and terms/wrenches, or in `device.py` of a term. A body sums
the forces of its connectors in the order of their numbers, without scattered writes.
"""

from collections.abc import Iterator
from importlib import import_module
from typing import Any

from icofabric_sim.simulation.devices.gpu.records import Acting, Fabric
from icofabric_sim.simulation.devices.gpu.rotations import (
    arm_on_axis,
    axes_of,
    half_angle_factors,
    mean_of_turning,
    on_axes,
    sine_and_cosine,
    to_world,
    turned_by,
)
from icofabric_sim.terms.anchors.device import point_at, pull_along
from icofabric_sim.terms.bending.device import wrench_of as wrench_of_bending
from icofabric_sim.terms.profiles import (
    FAR_OFFSET,
    FAR_WEIGHT,
    MIDDLE_WEIGHT,
    NEAR_OFFSET,
    NEAR_WEIGHT,
)
from icofabric_sim.terms.registry import LAWS
from icofabric_sim.terms.twisting.device import torque_of as torque_of_twisting

wp: Any = import_module('warp')

_DOUBLE = wp.float64
_ZERO_F64, _HALF, _ONE = (wp.constant(_DOUBLE(x)) for x in (0.0, 0.5, 1.0))
# Lower bound of squared lengths, where a force has no direction.
_MIN_SQUARE = wp.constant(_DOUBLE(1e-300))
# Gauss rule for the mean power of a wrench over a drift.
_Five = wp.types.vector(length=5, dtype=_DOUBLE)
_NODES = wp.constant(_Five(
    0.5 - NEAR_OFFSET, 0.5 + NEAR_OFFSET, 0.5 - FAR_OFFSET, 0.5 + FAR_OFFSET, 0.5))
_WEIGHTS = wp.constant(_Five(
    NEAR_WEIGHT, NEAR_WEIGHT, FAR_WEIGHT, FAR_WEIGHT, MIDDLE_WEIGHT))


@wp.func
def place_of(pose: wp.array(dtype=wp.float64), stride: int, s: int):
    """Return the position [m] of a body."""
    return wp.vec3d(pose[s], pose[stride + s], pose[2 * stride + s])


@wp.func
def turn_of(pose: wp.array(dtype=wp.float64), stride: int, s: int):
    """Return the orientation of a body, a quaternion x y z w."""
    return wp.vec4d(
        pose[3 * stride + s], pose[4 * stride + s], pose[5 * stride + s], pose[6 * stride + s])


@wp.func
def partner_of(fabric: Fabric, block: int, lane: int, link: int):
    """Return the slot of the body at the other end, where connectors end at the opposite edge."""
    return fabric.place[12 * block + link] - 3 * ((link >> 1) ^ 1) * fabric.stride + lane


@wp.func
def has_link(fabric: Fabric, block: int, lane: int, link: int):
    """Return 1 if a body has this connector, else 0."""
    return (int(fabric.present[12 * block + link]) >> lane) & 1


@wp.func
def one_law(fabric: Fabric, link: int, s: int, square: wp.float64, step_part: wp.float64):
    """Return tension over length [N/m] if all connectors follow one law."""
    return fabric.stiffness - fabric.stiffness * fabric.natural_length / wp.sqrt(square)


@wp.func
def own_law(fabric: Fabric, link: int, s: int, square: wp.float64, step_part: wp.float64):
    """Return tension over length [N/m] with k_e and k_c of each connector (eq 2)."""
    at = link * fabric.stride + s
    rest = fabric.natural[at]
    k = wp.where(square > rest * rest, fabric.extension[at], fabric.compression[at])
    return k - k * rest / wp.sqrt(square)


@wp.func
def kept_law(fabric: Fabric, link: int, s: int, square: wp.float64, step_part: wp.float64):
    """
    Return tension over length [N/m] with the slope at the start of the step and corrections.

    The corrections are those of crossings. For negative `step_part`, the law of the connector
    applies.
    """
    if step_part < _ZERO_F64:
        return own_law(fabric, link, s, square, step_part)
    n = fabric.stride
    at = link * n + s
    k = wp.where(fabric.start[at] > _ZERO_F64, fabric.extension[at], fabric.compression[at])
    tension = -(k * fabric.natural[at])
    if int(fabric.active[at]) != 0:
        x = step_part
        tension = tension + (fabric.forces[at] + x * (fabric.forces[12 * n + at] + x * (
            fabric.forces[24 * n + at] + x * fabric.forces[36 * n + at])))
    return k + tension / wp.sqrt(square)


def by_laws(spring: Any, laws: tuple[str, ...]) -> Any:
    """Return the function of tension over length [N/m] in which `laws` replace the `spring`."""
    for first, device in law_rows(laws):
        spring = _by_law(spring, device.replace_pull, first)
    return spring


def law_rows(laws: tuple[str, ...]) -> Iterator[tuple[int, Any]]:
    """Yield for each law the number of its first row of `Fabric.laws`, and its functions."""
    row = 0
    for law in LAWS:
        if law.name in laws:
            yield row, law.module('device')
            row += len(law.record._fields)


def _by_law(spring: Any, replace_pull: Any, row: int) -> Any:
    """Return `spring` with the tension of connectors that follow a law."""
    @wp.func
    def law(fabric: Fabric, link: int, s: int, square: wp.float64, step_part: wp.float64):
        factor = spring(fabric, link, s, square, step_part)
        length, at = wp.sqrt(square), link * fabric.stride + s
        return replace_pull(
            fabric.laws, at + 12 * row * fabric.stride, fabric.extension[at], fabric.natural[at],
            length, factor * length) / length
    return law


@wp.func
def arm_at_midpoint(fabric: Fabric, q: wp.vec4d, edge: int):
    """Return the arm [m] to an attachment point on a body axis."""
    arm = arm_on_axis(q, fabric.half_width, edge >> 1)
    if edge & 1 == 1:
        arm = -arm
    return arm


@wp.func
def arm_anywhere(fabric: Fabric, q: wp.vec4d, edge: int):
    """Return the arm [m] to any attachment point."""
    return to_world(q, fabric.attachment[edge])


def springs(law: Any, arm_to: Any) -> Any:
    """
    Return the function of the forces of all connectors at a body, with this law and these arms.
    """
    @wp.func
    def pulls(
        fabric: Fabric, pose: wp.array(dtype=wp.float64), block: int, lane: int, s: int,
        place: wp.vec3d, turn: wp.vec4d, step_part: wp.float64
    ):
        force, torque = wp.vec3d(), wp.vec3d()
        for edge in range(6):
            arm = arm_to(fabric, turn, edge)
            end = place + arm
            pull = wp.vec3d()
            for side in range(2):
                link = 2 * edge + side
                if has_link(fabric, block, lane, link) == 1:
                    other = partner_of(fabric, block, lane, link)
                    far = place_of(pose, fabric.stride, other) + arm_to(
                        fabric, turn_of(pose, fabric.stride, other), edge ^ 1)
                    u = far - end
                    square = wp.max(wp.dot(u, u), _MIN_SQUARE)
                    pull = pull + law(fabric, link, s, square, step_part) * u
            force = force + pull
            torque = torque + wp.cross(arm, pull)
        return force, torque
    return pulls


@wp.func
def no_pulls(
    fabric: Fabric, pose: wp.array(dtype=wp.float64), block: int, lane: int, s: int,
    place: wp.vec3d, turn: wp.vec4d, step_part: wp.float64
):
    """Return zero force and torque, for scenes without connectors."""
    return wp.vec3d(), wp.vec3d()


@wp.func
def no_moments(
    fabric: Fabric, pose: wp.array(dtype=wp.float64), block: int, lane: int, s: int,
    place: wp.vec3d, turn: wp.vec4d
):
    """Return zero force and torque, for scenes without bending and twisting."""
    return wp.vec3d(), wp.vec3d()


@wp.func
def stiffness_of(
    values: wp.array(dtype=wp.float64), stride: int, link: int, s: int
):
    """Return the stiffness against a moment [N m/rad] of a connector."""
    if values.shape[0] == 0:
        return _ZERO_F64
    if values.shape[0] == 1:
        return values[0] + _ZERO_F64
    return values[link * stride + s] + _ZERO_F64


def moments(arm_to: Any) -> Any:
    """
    Return the function of forces and torques by bending and twisting at a body, with these arms.
    """
    @wp.func
    def resistance(
        fabric: Fabric, pose: wp.array(dtype=wp.float64), block: int, lane: int, s: int,
        place: wp.vec3d, turn: wp.vec4d
    ):
        force, torque = wp.vec3d(), wp.vec3d()
        own = axes_of(turn)
        for link in range(12):
            if has_link(fabric, block, lane, link) == 1:
                edge = link >> 1
                other = partner_of(fabric, block, lane, link)
                there = turn_of(pose, fabric.stride, other)
                axes = axes_of(there)
                kappa = stiffness_of(fabric.bending, fabric.stride, link, s)
                if kappa > _ZERO_F64:
                    arm = arm_to(fabric, turn, edge)
                    u = (place_of(pose, fabric.stride, other) + arm_to(
                        fabric, there, edge ^ 1)) - (place + arm)
                    push, turning = wrench_of_bending(
                        kappa, u, arm, on_axes(own, fabric.direction[link]),
                        on_axes(axes, fabric.direction[link]))
                    force, torque = force + push, torque + turning
                kappa = stiffness_of(fabric.twisting, fabric.stride, link, s)
                if kappa > _ZERO_F64:
                    torque = torque + torque_of_twisting(kappa, own, axes)
        return force, torque
    return resistance


def dampers(arm_to: Any) -> Any:
    """Return the function of damping forces of all connectors at a body, with these arms."""
    @wp.func
    def losing(
        fabric: Fabric, pose: wp.array(dtype=wp.float64), motion: wp.array(dtype=wp.float64),
        block: int, lane: int, s: int, place: wp.vec3d, turn: wp.vec4d, velocity: wp.vec3d,
        spin: wp.vec3d
    ):
        force, torque, taken = wp.vec3d(), wp.vec3d(), wp.float64(0.0)
        n = fabric.stride
        for edge in range(6):
            arm = arm_to(fabric, turn, edge)
            end, speed = place + arm, velocity + wp.cross(spin, arm)
            loss = wp.vec3d()
            for side in range(2):
                link = 2 * edge + side
                if has_link(fabric, block, lane, link) == 1:
                    t = partner_of(fabric, block, lane, link)
                    other = arm_to(fabric, turn_of(pose, n, t), edge ^ 1)
                    u = (place_of(pose, n, t) + other) - end
                    moving = wp.vec3d(motion[t], motion[n + t], motion[2 * n + t]) + wp.cross(
                        wp.vec3d(motion[3 * n + t], motion[4 * n + t], motion[5 * n + t]), other)
                    inverse = _ONE / wp.sqrt(wp.max(wp.dot(u, u), _MIN_SQUARE))
                    rate = wp.dot(u, moving - speed) * inverse
                    tension = stiffness_of(fabric.damping, n, link, s) * rate
                    taken = taken + tension * rate
                    loss = loss + (tension * inverse) * u
            force = force + loss
            torque = torque + wp.cross(arm, loss)
        # Either end counts half of the dissipation.
        return force, torque, _HALF * taken
    return losing


@wp.func
def no_dampers(
    fabric: Fabric, pose: wp.array(dtype=wp.float64), motion: wp.array(dtype=wp.float64),
    block: int, lane: int, s: int, place: wp.vec3d, turn: wp.vec4d, velocity: wp.vec3d,
    spin: wp.vec3d
):
    """Return zero force, torque and power, for scenes without damped connectors."""
    return wp.vec3d(), wp.vec3d(), wp.float64(0.0)


@wp.func
def factor_of(acting: Acting, w: int, time: wp.float64):
    """Return the factor of a wrench at `time` [s]."""
    after = time - acting.varying[5 * w]
    factor = acting.varying[5 * w + 1] + acting.varying[5 * w + 2] * after
    if acting.varying[5 * w + 3] != _ZERO_F64:
        sine, cosine = sine_and_cosine(acting.varying[5 * w + 4] * after)
        factor = factor + acting.varying[5 * w + 3] * sine
    return factor


@wp.func
def vector_at(vectors: wp.array(dtype=wp.vec3d), i: int):
    """Return a vector of an array, as a value that may be modified."""
    return vectors[i]


@wp.func
def wrench_of(acting: Acting, turn: wp.vec4d, w: int):
    """
    Return force [N] and torque about the centre [N m] of a wrench on a body, world frame.

    The factor of its profile is not applied.
    """
    force, torque = vector_at(acting.force, w), vector_at(acting.torque, w)
    if int(acting.turning[w]) != 0:
        force, torque = to_world(turn, force), to_world(turn, torque)
    point = to_world(turn, acting.point[w])
    return force, torque + wp.cross(point, force)


@wp.func
def steady_power(
    acting: Acting, w: int, turn: wp.vec4d, velocity: wp.vec3d, spin: wp.vec3d, h: wp.float64
):
    """Return the mean power [W] of a steady wrench over a drift, see terms/wrenches/work.py."""
    force, torque = wrench_of(acting, turn, w)
    if int(acting.turning[w]) != 0:
        mean = mean_of_turning(force, spin, h)
        return wp.dot(mean, velocity) + wp.dot(torque, spin)
    point = to_world(turn, acting.point[w])
    mean = mean_of_turning(wp.cross(spin, point), spin, h)
    return wp.dot(force, velocity + mean) + wp.dot(acting.torque[w], spin)


@wp.func
def power_after(
    acting: Acting, w: int, turn: wp.vec4d, velocity: wp.vec3d, spin: wp.vec3d,
    time: wp.float64, later: wp.float64
):
    """Return the power [W] of a wrench `later` [s] than `time`, after free flight."""
    cosine, sine = half_angle_factors(later, spin)
    axis = sine * spin
    force, torque = vector_at(acting.force, w), vector_at(acting.torque, w)
    if int(acting.turning[w]) != 0:
        force = turned_by(to_world(turn, force), cosine, axis)
        # A torque that rotates about omega keeps its component along omega.
        torque = to_world(turn, torque)
    point = turned_by(to_world(turn, acting.point[w]), cosine, axis)
    power = wp.dot(force, velocity + wp.cross(spin, point)) + wp.dot(torque, spin)
    return factor_of(acting, w, time + later) * power


@wp.func
def mean_power(
    acting: Acting, w: int, turn: wp.vec4d, velocity: wp.vec3d, spin: wp.vec3d,
    time: wp.float64, h: wp.float64
):
    """Return the mean power [W] of a wrench over a drift, see terms/wrenches/work.py."""
    if acting.varying[5 * w + 2] == _ZERO_F64 and acting.varying[5 * w + 3] == _ZERO_F64:
        return acting.varying[5 * w + 1] * steady_power(acting, w, turn, velocity, spin, h)
    mean = wp.float64(0.0)
    for node in range(5):
        mean = mean + _WEIGHTS[node] * power_after(
            acting, w, turn, velocity, spin, time, _NODES[node] * h)
    return mean


@wp.func
def anchor_pull(acting: Acting, a: int, place: wp.vec3d, turn: wp.vec4d, time: wp.float64):
    """Return force [N], torque about the centre [N m] and power of the point [W] of an anchor."""
    t = time - acting.anchor_start[a]
    point, speed = point_at(
        acting.anchor_cubic[4 * a], acting.anchor_cubic[4 * a + 1], acting.anchor_cubic[4 * a + 2],
        acting.anchor_cubic[4 * a + 3], t)
    arm = to_world(turn, acting.anchor_arm[a])
    u = (point - place) - arm
    force = pull_along(
        u, acting.anchor_law[3 * a], acting.anchor_law[3 * a + 1], acting.anchor_law[3 * a + 2])
    return force, wp.cross(arm, force), wp.dot(force, speed)
