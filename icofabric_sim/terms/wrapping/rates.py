# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Rates of the lengths of wrapped connectors.

A path is the shortest, so its length is stationary in the places where it leaves the shells. Its
rate is that of the free segment between the two material points there.
"""

from typing import NamedTuple

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import any_lane, insert, lane, LANES, splat, Vector
from icofabric_sim.terms.shared import Links, partner_slot, State
from icofabric_sim.terms.wrapping.force import entering, SMALLEST_LENGTH
from icofabric_sim.terms.wrapping.pairs import taut
from icofabric_sim.terms.wrapping.path import apart, leaving, Point, Pose, pose_of, wound
from icofabric_sim.terms.wrapping.record import Wrapping
import numpy as np


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
    free = max(apart(p, q), SMALLEST_LENGTH)
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
