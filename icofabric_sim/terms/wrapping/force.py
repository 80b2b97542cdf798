# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Connectors wrapped over the shells they are attached to, instead of passing through.

Vectors compute every connector as straight. If a connector of a block enters a shell, its lane is
computed again alone: by the same law for the length of its taut path (path.py), with its tension
along the free segment, at the point where this leaves the shell. The wrapped segment turns with
the shell. By virtual work the force at that point is therefore the whole wrench, and minus the
gradient of the energy. Both ends compute the same numbers, the body in the lower slot first, and
use them with opposite signs.
"""

import math
from typing import NamedTuple

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    any_lane,
    bits,
    insert,
    lane,
    LANES,
    load_at,
    splat,
    Vector,
    where,
)
from icofabric_sim.terms.laws import replace_alone
from icofabric_sim.terms.maxwell.record import Maxwell
from icofabric_sim.terms.shared import LINK_COUNT, Links, partner_slot, Six, Variety
from icofabric_sim.terms.shells import axes_at, enters_from
from icofabric_sim.terms.wrapping.pairs import taut
from icofabric_sim.terms.wrapping.path import (
    apart,
    leaving,
    LOST,
    Point,
    Pose,
    pose_of,
    STRAIGHT,
    turned,
    wound,
)
from icofabric_sim.terms.wrapping.record import Wrapping
import numpy as np

# [m]
SMALLEST_LENGTH = 1e-150


class Band(NamedTuple):
    """A connector from its own end, straight and wrapped over the shells."""

    force: Point  # [N] on the own body, less that of the straight connector
    torque: Point  # [N m] about its centre, likewise
    energy: float  # [J] less that of the straight connector
    bound: float  # of what the connector adds to the squared frequency of the own body [1/s^2]
    lost: int  # number of ends without a path


@compiled
def law_of(
    variety: Variety | None, links: Links, link: int, s: int, length: float
) -> tuple[float, float, float]:
    """
    Return tension [N], energy [J], largest slope [N/m] of a connector by its spring (eqs 1, 2).
    """
    if variety is None:
        k, rest = links.stiffness, links.natural_length
        most = k
    else:
        rest = variety.natural_length[link, s]
        most = max(variety.extension[link, s], variety.compression[link, s])
        k = variety.extension[link, s] if length > rest else variety.compression[link, s]
    return k * (length - rest), 0.5 * k * (length - rest) ** 2, most


@compiled
def arm_law(
    maxwell: Maxwell | None, rest: np.ndarray | None, link: int, s: int, length: float
) -> tuple[float, float, float]:
    """
    Return tension [N], energy [J] and slope [N/m] of a connector's Maxwell arm; 0 without one.
    """
    if maxwell is None:
        return 0.0, 0.0, 0.0
    if rest is None:
        return 0.0, 0.0, 0.0
    k = one_of(maxwell.own_stiffness, maxwell.stiffness, link, s)
    stretch = length - rest[link, s]
    return k * stretch, 0.5 * k * stretch**2, k


@compiled
def one_of(own: np.ndarray | None, value: float, link: int, s: int) -> float:
    """Return the individual or the common value of a connector."""
    if own is None:
        return value
    else:
        mine: float = own[link, s]
        return mine


@compiled
def moment(pose: Pose, point: Point, force: Point) -> Point:
    """Return the torque about the centre of a body."""
    x, y, z = point[0] - pose[0], point[1] - pose[1], point[2] - pose[2]
    return (
        y * force[2] - z * force[1], z * force[0] - x * force[2], x * force[1] - y * force[0])


@compiled
def coupling(
    wrapping: Wrapping, edge: int, way: int, place: float, pose: Pose, direction: Point,
    free: float
) -> tuple[float, float]:
    """
    Return how strongly a place on the last edge follows the motion, |P t| / l [1/m]; 1 / E_qq [m].

    E_qq >= away^2 / wound^3 is the second derivative of the length along the edge.
    """
    if way < 0:
        return 0.0, 0.0
    row = wrapping.ways[edge, way]
    t = turned(pose, row[3], row[4], row[5])
    along = t[0] * direction[0] + t[1] * direction[1] + t[2] * direction[2]
    part = math.sqrt(max(1.0 - along * along, 0.0)) / free
    return part, wound(wrapping, edge, way, place) ** 3 / row[7] ** 2


@compiled
def band_of(
    wrapping: Wrapping, links: Links, maxwell: Maxwell | None, inverse_mass: float,
    inverse_inertia: float, position: np.ndarray, orientation: np.ndarray,
    rest: np.ndarray | None, link: int, own: int, other: int
) -> Band:
    """
    Return the wrapped connector from slot `own` to slot `other`, with its Maxwell arm.

    The bound is that of terms/links/bound.py for a straight connector between the points
    where it leaves the shells. With these points fixed on their bodies the length has the same
    first derivative, and no smaller second one, because the places minimise the length. If the
    connector pushes, the compliance of the places counts instead: sums (c . m)^2 / E_qq over the
    ends, with |c . m| at most |P t| / l (|du_1| + |du_2|) + |dtheta| of the end's own body. The
    Hessian already includes the straight spring that is replaced, so its non-positive terms are
    subtracted.
    """
    none = (0.0, 0.0, 0.0)
    edge = link >> 1
    if own < other:
        pose, far = pose_of(position, orientation, own), pose_of(position, orientation, other)
        edges = edge, edge ^ 1
    else:
        pose, far = pose_of(position, orientation, other), pose_of(position, orientation, own)
        edges = edge ^ 1, edge
    way, place, far_way, far_place = taut(wrapping, pose, edges[0], far, edges[1])
    lost = (1 if way == LOST else 0) + (1 if far_way == LOST else 0)
    if way < 0 and far_way < 0:
        return Band(none, none, 0.0, 0.0, lost)
    a, b = leaving(wrapping, pose, edges[0], STRAIGHT, 0.0), leaving(
        wrapping, far, edges[1], STRAIGHT, 0.0)
    p, q = leaving(wrapping, pose, edges[0], way, place), leaving(
        wrapping, far, edges[1], far_way, far_place)
    straight, free = max(apart(a, b), SMALLEST_LENGTH), max(apart(p, q), SMALLEST_LENGTH)
    length = free + wound(wrapping, edges[0], way, place) + wound(
        wrapping, edges[1], far_way, far_place)
    old_pull, old_energy, _ = replace_alone(
        links.laws, links.variety, link, own, straight,
        law_of(links.variety, links, link, own, straight))
    pull, energy, slope = replace_alone(
        links.laws, links.variety, link, own, length,
        law_of(links.variety, links, link, own, length))
    arm_pull, arm_energy, _ = arm_law(maxwell, rest, link, own, straight)
    old_pull, old_energy = old_pull + arm_pull, old_energy + arm_energy
    arm_pull, arm_energy, arm_slope = arm_law(maxwell, rest, link, own, length)
    pull, energy, slope = pull + arm_pull, energy + arm_energy, slope + arm_slope
    direction = ((q[0] - p[0]) / free, (q[1] - p[1]) / free, (q[2] - p[2]) / free)
    new = (pull * direction[0], pull * direction[1], pull * direction[2])
    old = (
        old_pull * ((b[0] - a[0]) / straight), old_pull * ((b[1] - a[1]) / straight),
        old_pull * ((b[2] - a[2]) / straight))
    part, give = coupling(wrapping, edges[0], way, place, pose, direction, free)
    far_part, far_give = coupling(
        wrapping, edges[1], far_way, far_place, far, direction, free)
    if own < other:
        force = (new[0] - old[0], new[1] - old[1], new[2] - old[2])
        one, two = moment(pose, p, new), moment(pose, a, old)
        arm = apart(p, (pose[0], pose[1], pose[2]))
    else:
        force = (old[0] - new[0], old[1] - new[1], old[2] - new[2])
        one, two = moment(far, b, old), moment(far, q, new)
        arm = apart(q, (far[0], far[1], far[2]))
        part, give, far_part, far_give = far_part, far_give, part, give
    torque = (one[0] - two[0], one[1] - two[1], one[2] - two[2])
    near = inverse_mass + arm * arm * inverse_inertia
    bound = 2.0 * (slope + max(pull, 0.0) / free) * near + abs(pull) * arm * inverse_inertia
    width = math.sqrt(
        wrapping.points[edge, 0] ** 2 + wrapping.points[edge, 1] ** 2
        + wrapping.points[edge, 2] ** 2)
    old_near = inverse_mass + width * width * inverse_inertia
    bound += 2.0 * max(-old_pull, 0.0) / straight * old_near
    bound += abs(old_pull) * width * inverse_inertia
    if pull < 0.0:
        root = math.sqrt(near)
        bound += 2.0 * abs(pull) * (
            give * (part * root + math.sqrt(inverse_inertia)) ** 2
            + far_give * (far_part * root) ** 2)
    return Band(force, torque, energy - old_energy, bound, lost)


@compiled
def entering(
    wrapping: Wrapping, links: Links, orientation: np.ndarray, points: np.ndarray, stride: int,
    block: int, s: int, link: int
) -> Vector:
    """Return 1 in the lanes whose connector enters a shell at either of its ends, else 0."""
    edge = link >> 1
    at, place = 3 * edge * stride + s, links.place[block, link]
    ux = load_at(points, place) - load_at(points, at)
    uy = load_at(points, place + stride) - load_at(points, at + stride)
    uz = load_at(points, place + 2 * stride) - load_at(points, at + 2 * stride)
    partner = partner_slot(links, stride, block, link)
    zero, one = splat(0.0), splat(1.0)
    vx, vy, vz = zero - ux, zero - uy, zero - uz
    here = enters_from(
        wrapping.shells, orientation, axes_at(wrapping.shells, points, stride, edge, s), edge, s,
        ux, uy, uz)
    there = enters_from(
        wrapping.shells, orientation, axes_at(wrapping.shells, points, stride, edge ^ 1, partner),
        edge ^ 1, partner, vx, vy, vz)
    either = where(here, one, where(there, one, zero))
    return where(bits(links.present[block, link]), either, zero)


@compiled
def add_force(
    wrapping: Wrapping | None, links: Links, maxwell: Maxwell | None, position: np.ndarray,
    orientation: np.ndarray, rest: np.ndarray | None, points: np.ndarray, block: int, s: int,
    wrench: Six
) -> Six:
    """Add the changes due to wrapping to the force [N] and torque [N m] of a block."""
    if wrapping is None:
        return wrench
    else:
        for link in range(LINK_COUNT):
            lanes = entering(
                wrapping, links, orientation, points, position.shape[1], block, s, link)
            if any_lane(lanes > splat(0.0)):
                wrench = add_bands(
                    wrapping, links, maxwell, position, orientation, rest, block, s, link, lanes,
                    wrench)
        return wrench


@compiled
def add_bands(
    wrapping: Wrapping, links: Links, maxwell: Maxwell | None, position: np.ndarray,
    orientation: np.ndarray, rest: np.ndarray | None, block: int, s: int, link: int,
    lanes: Vector, wrench: Six
) -> Six:
    """
    Add the changes due to wrapping of one connector of each body, in lanes where it is wrapped.
    """
    fx, fy, fz, tx, ty, tz = wrench
    partner = partner_slot(links, position.shape[1], block, link)
    for i in range(LANES):
        if lane(lanes, i) > 0.0:
            band = band_of(
                wrapping, links, maxwell, 1.0, 1.0, position, orientation, rest, link, s + i,
                partner + i)
            fx = insert(fx, i, lane(fx, i) + band.force[0])
            fy = insert(fy, i, lane(fy, i) + band.force[1])
            fz = insert(fz, i, lane(fz, i) + band.force[2])
            tx = insert(tx, i, lane(tx, i) + band.torque[0])
            ty = insert(ty, i, lane(ty, i) + band.torque[1])
            tz = insert(tz, i, lane(tz, i) + band.torque[2])
    return fx, fy, fz, tx, ty, tz
