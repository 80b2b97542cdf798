# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Changes of damping and of Maxwell arms along wrapped connectors."""

import math

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import any_lane, insert, lane, LANES, splat, Vector
from icofabric_sim.terms.damping.record import Damping
from icofabric_sim.terms.maxwell.record import Maxwell
from icofabric_sim.terms.shared import add_wrench, LINK_COUNT, Links, partner_slot, State, Supports
from icofabric_sim.terms.wrapping.force import arm_law, entering, one_of, SMALLEST_LENGTH
from icofabric_sim.terms.wrapping.path import Point
from icofabric_sim.terms.wrapping.rates import run_of
from icofabric_sim.terms.wrapping.record import Wrapping
import numpy as np


@compiled
def change_damping(
    wrapping: Wrapping | None, damping: Damping | None, links: Links | None, supports: Supports
    | None, inverse_mass: float, inverse_inertia: float, state: State, points: np.ndarray,
    speeds: np.ndarray, linear: np.ndarray, angular: np.ndarray, block: int, s: int, spent:
    Vector
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
    for link in range(LINK_COUNT):
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
            supports, inverse_mass, inverse_inertia, linear, angular, s, fx, fy,
            fz, tx, ty, tz)
    return spent


@compiled
def change_maxwell(
    wrapping: Wrapping | None, maxwell: Maxwell | None, links: Links | None, state: State,
    points: np.ndarray, slope: np.ndarray, row: int, block: int, s: int, spent: Vector
) -> Vector:
    """
    Replace the creep rates of Maxwell arms in wrapped lanes; return `spent` plus the power [W].

    Slopes of their rest lengths begin at `row`; their forces are included in the wrench
    (force.py).
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
    for link in range(LINK_COUNT):
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
    length = max(math.sqrt(ux * ux + uy * uy + uz * uz), SMALLEST_LENGTH)
    rate = (ux * wx + uy * wy + uz * wz) / length
    pull = c * rate / length
    arm = (
        points[at] - position[0, s], points[at + stride] - position[1, s],
        points[at + 2 * stride] - position[2, s])
    return (pull * ux, pull * uy, pull * uz), arm, rate
