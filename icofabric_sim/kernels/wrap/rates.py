# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Rates of the lengths of wrapped connectors, and damping along them.

A path is the shortest, so its length is stationary in the places where it leaves the shells. Its
rate is that of the free segment between the two material points there.
"""

import math
from typing import NamedTuple

from icofabric_sim.kernels.records import Links, Model, State, Wrapping
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import any_lane, insert, lane, LANES, splat, Vector
from icofabric_sim.kernels.wrap.forces import arm_law, entering, one_of
from icofabric_sim.kernels.wrap.pairs import taut
from icofabric_sim.kernels.wrap.path import apart, leaving, Point, Pose, pose_of, wound
from icofabric_sim.terms.damping.record import Damping
from icofabric_sim.terms.maxwell.record import Maxwell
from icofabric_sim.terms.shared import add_wrench, partner_slot
import numpy as np

_SMALLEST_LENGTH = 1e-150


class Run(NamedTuple):
    """A connector wrapped over its shells, seen from one end; world frame."""

    arm: Point  # [m] from the centre of the body to where it leaves its shell
    direction: Point  # unit vector from there along the free part
    length: float  # [m] of the whole path
    rate: float  # [m/s] of the length


@compiled
def run_of(wrapping: Wrapping, state: State, link: int, own: int, other: int) -> Run:
    """
    Return connector number `link` of the body in slot `own`, which leads to slot `other`.

    The body in the lower slot comes first, so that both ends have the same numbers.
    """
    edge = link >> 1
    if own < other:
        run, _ = runs_between(wrapping, state, edge, edge ^ 1, own, other)
        return run
    _, run = runs_between(wrapping, state, edge ^ 1, edge, other, own)
    return run


@compiled
def runs_between(
    wrapping: Wrapping, state: State, edge: int, far_edge: int, first: int, second: int
) -> tuple[Run, Run]:
    """Return a connector from an edge of the body in slot `first`, seen from either end."""
    pose = pose_of(state.position, state.orientation, first)
    far = pose_of(state.position, state.orientation, second)
    way, place, far_way, far_place = taut(wrapping, pose, edge, far, far_edge)
    p = leaving(wrapping, pose, edge, way, place)
    q = leaving(wrapping, far, far_edge, far_way, far_place)
    free = max(apart(p, q), _SMALLEST_LENGTH)
    x, y, z = (q[0] - p[0]) / free, (q[1] - p[1]) / free, (q[2] - p[2]) / free
    length = free + wound(wrapping, edge, way, place) + wound(
        wrapping, far_edge, far_way, far_place)
    v, w = speed_at(state, pose, p, first), speed_at(state, far, q, second)
    rate = x * (w[0] - v[0]) + y * (w[1] - v[1]) + z * (w[2] - v[2])
    return (
        Run((p[0] - pose[0], p[1] - pose[1], p[2] - pose[2]), (x, y, z), length, rate),
        Run((q[0] - far[0], q[1] - far[1], q[2] - far[2]), (-x, -y, -z), length, rate))


@compiled
def speed_at(state: State, pose: Pose, point: Point, s: int) -> Point:
    """Return the velocity [m/s] of the point of a body that is at a `point` of the world."""
    x, y, z = point[0] - pose[0], point[1] - pose[1], point[2] - pose[2]
    velocity, spin = state.linear_velocity, state.angular_velocity
    return (
        velocity[0, s] + spin[1, s] * z - spin[2, s] * y,
        velocity[1, s] + spin[2, s] * x - spin[0, s] * z,
        velocity[2, s] + spin[0, s] * y - spin[1, s] * x)


@compiled
def change_rates(
    wrapping: Wrapping | None, links: Links, state: State, points: np.ndarray, block: int,
    link: int, s: int, length: Vector, rate: Vector
) -> tuple[Vector, Vector]:
    """Replace lengths [m] of straight connectors and their rates [m/s] in wrapped lanes."""
    if wrapping is None:
        return length, rate
    else:
        stride = state.position.shape[1]
        lanes = entering(
            wrapping, links, state.orientation, points, stride, block, s, link)
        if any_lane(lanes > splat(0.0)):
            partner = partner_slot(links, stride, block, link)
            for i in range(LANES):
                if lane(lanes, i) > 0.0:
                    run = run_of(wrapping, state, link, s + i, partner + i)
                    length = insert(length, i, run.length)
                    rate = insert(rate, i, run.rate)
        return length, rate


@compiled
def add_wrapped_damping(
    wrapping: Wrapping | None, damping: Damping | None, links: Links | None, model: Model,
    state: State, points: np.ndarray, speeds: np.ndarray, linear: np.ndarray,
    angular: np.ndarray, block: int, s: int, spent: Vector
) -> Vector:
    """
    Add the changes due to wrapping to the damping of a block; return `spent` plus the power [W].
    """
    if wrapping is None:
        return spent
    if damping is None:
        return spent
    if links is None:
        return spent
    stride, zero = state.position.shape[1], splat(0.0)
    fx, fy, fz, tx, ty, tz = zero, zero, zero, zero, zero, zero
    found = False
    for link in range(12):
        lanes = entering(
            wrapping, links, state.orientation, points, stride, block, s, link)
        if not any_lane(lanes > zero):
            continue
        found = True
        partner = partner_slot(links, stride, block, link)
        at, place = 3 * (link >> 1) * stride + s, links.place[block, link]
        for i in range(LANES):
            if lane(lanes, i) > 0.0:
                c = one_of(damping.own, damping.coefficient, link, s + i)
                force, arm, rate = straight_damping(
                    state.position, points, speeds, c, at + i, place + i, s + i)
                run = run_of(wrapping, state, link, s + i, partner + i)
                pull = c * run.rate
                x, y, z = run.direction
                x, y, z = pull * x, pull * y, pull * z
                r, q = run.arm, arm
                fx = insert(fx, i, lane(fx, i) + (x - force[0]))
                fy = insert(fy, i, lane(fy, i) + (y - force[1]))
                fz = insert(fz, i, lane(fz, i) + (z - force[2]))
                tx = insert(tx, i, lane(tx, i) + (r[1] * z - r[2] * y) - (
                    q[1] * force[2] - q[2] * force[1]))
                ty = insert(ty, i, lane(ty, i) + (r[2] * x - r[0] * z) - (
                    q[2] * force[0] - q[0] * force[2]))
                tz = insert(tz, i, lane(tz, i) + (r[0] * y - r[1] * x) - (
                    q[0] * force[1] - q[1] * force[0]))
                # Half of the power counts for either end.
                spent = insert(spent, i, lane(spent, i) + 0.5 * c * (
                    run.rate * run.rate - rate * rate))
    if found:
        add_wrench(
            model.supports, model.inverse_mass, model.inverse_inertia, linear, angular, s, fx, fy,
            fz, tx, ty, tz)
    return spent


@compiled
def creep_around(
    wrapping: Wrapping | None, maxwell: Maxwell | None, links: Links | None, state: State,
    points: np.ndarray, slope: np.ndarray, row: int, block: int, s: int, spent: Vector
) -> Vector:
    """
    Replace the creep rates of Maxwell arms in wrapped lanes; return `spent` plus the power [W].

    Slopes of their rest lengths begin at `row`; their forces are included in the wrench
    (forces.py).
    """
    if wrapping is None:
        return spent
    if maxwell is None:
        return spent
    if links is None:
        return spent
    if state.rest is None:
        return spent
    stride = state.position.shape[1]
    for link in range(12):
        lanes = entering(wrapping, links, state.orientation, points, stride, block, s, link)
        if not any_lane(lanes > splat(0.0)):
            continue
        partner = partner_slot(links, stride, block, link)
        for i in range(LANES):
            if lane(lanes, i) > 0.0:
                run = run_of(wrapping, state, link, s + i, partner + i)
                rate = one_of(maxwell.own_rate, maxwell.rate, link, s + i)
                before = slope[row + link, s + i]
                slope[row + link, s + i] = rate * (run.length - state.rest[link, s + i])
                if rate > 0.0:
                    straight = state.rest[link, s + i] + before / rate
                    _, old, _ = arm_law(maxwell, state.rest, link, s + i, straight)
                    _, new, _ = arm_law(maxwell, state.rest, link, s + i, run.length)
                    # An arm dissipates twice its rate times its energy; half counts for each end.
                    spent = insert(spent, i, lane(spent, i) + rate * (new - old))
    return spent


@compiled
def straight_damping(
    position: np.ndarray, points: np.ndarray, speeds: np.ndarray, c: float, at: int, place: int,
    s: int
) -> tuple[Point, Point, float]:
    """
    Return force [N] on a body by a straight connector, its arm [m], and its length's rate [m/s].
    """
    stride = position.shape[1]
    ux, uy = points[place] - points[at], points[place + stride] - points[at + stride]
    uz = points[place + 2 * stride] - points[at + 2 * stride]
    wx, wy = speeds[place] - speeds[at], speeds[place + stride] - speeds[at + stride]
    wz = speeds[place + 2 * stride] - speeds[at + 2 * stride]
    length = max(math.sqrt(ux * ux + uy * uy + uz * uz), _SMALLEST_LENGTH)
    rate = (ux * wx + uy * wy + uz * wz) / length
    pull = c * rate / length
    arm = (
        points[at] - position[0, s], points[at + stride] - position[1, s],
        points[at + 2 * stride] - position[2, s])
    return (pull * ux, pull * uy, pull * uz), arm, rate


@compiled
def measure_runs(
    wrapping: Wrapping, state: State, first: np.ndarray, second: np.ndarray, edge: np.ndarray,
    far_edge: np.ndarray, found: np.ndarray, length: np.ndarray, rate: np.ndarray
) -> None:
    """
    Write lengths [m] and rates [m/s] of connectors, (c,), where `found` (c,) is not 0.

    From edges of bodies in slots `first` to edges of those in slots `second`.
    """
    for c in range(found.shape[0]):
        if found[c] != 0:
            if first[c] < second[c]:
                run, _ = runs_between(
                    wrapping, state, int(edge[c]), int(far_edge[c]), first[c], second[c])
            else:
                _, run = runs_between(
                    wrapping, state, int(far_edge[c]), int(edge[c]), second[c], first[c])
            length[c], rate[c] = run.length, run.rate
