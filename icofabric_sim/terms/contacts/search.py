# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Neighbour search for bodies, in time linear in their number, for any folding of the fabric.

Space is cut into cubes as wide as the largest distance of a close pair, so the partners of a body
are in its own cube and the 26 around it. Cubes have entries in a table by a hash of their three
numbers. No box around all bodies is needed, which would be huge if some fly away (M. Teschner et
al. 2003, Optimized Spatial Hashing).
"""

import math

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.terms.carriers import offset_of, plane_speed, share_of
from icofabric_sim.terms.contacts.axis import FACET_ROOM, find_facet, OVERLAP
from icofabric_sim.terms.contacts.gap import (
    Axes,
    axes_of,
    edge_of,
    gap_along,
    plane_gap,
    ratio_of,
    widest_gap,
)
from icofabric_sim.terms.contacts.pair import approach, COINCIDE
from icofabric_sim.terms.contacts.record import Nearby
from icofabric_sim.terms.contacts.shape import OUTER
from icofabric_sim.terms.shared import State
import numpy as np

# Largest number of a cube from the origin, in both directions.
_FARTHEST = 1e15


@compiled
def cube_of(coordinate: float, width: float) -> int:
    """Return the number of the cube along one axis."""
    return int(math.floor(min(max(coordinate / width, -_FARTHEST), _FARTHEST)))


@compiled
def place_of(i: int, j: int, k: int, mask: int) -> int:
    """Return the index of a cube in the table."""
    return (i * 73856093 ^ j * 19349663 ^ k * 83492791) & mask


@compiled
def sort_cubes(
    position: np.ndarray, slots: np.ndarray, width: float, cubes: np.ndarray, heads: np.ndarray,
    following: np.ndarray
) -> None:
    """Sort bodies into cubes (3, n), chained from `heads` (a power of two) on by rising number."""
    mask = heads.shape[0] - 1
    heads[:] = -1
    for b in range(slots.shape[0] - 1, -1, -1):
        for k in range(3):
            cubes[k, b] = cube_of(position[k, slots[b]], width)
        place = place_of(cubes[0, b], cubes[1, b], cubes[2, b], mask)
        following[b] = heads[place]
        heads[place] = b


@compiled
def find_close(
    position: np.ndarray, slots: np.ndarray, width: float, cubes: np.ndarray, heads: np.ndarray,
    following: np.ndarray, pairs: np.ndarray, half_edges: np.ndarray | None
) -> int:
    """
    Find pairs of bodies whose centres are closer than `width` [m], lower number first, sorted.

    With individual `half_edges` (n,) [m] the distance `width` is for two of the largest; other
    pairs must be closer, as spheres around them are smaller. As many as fit go into `pairs` (p,
    2); return how many there are.
    """
    mask, square, count, largest = heads.shape[0] - 1, width * width, 0, 0.0
    if half_edges is not None:
        for b in range(slots.shape[0]):
            largest = max(largest, half_edges[b])
    for b in range(slots.shape[0]):
        first, s = count, slots[b]
        x, y, z = position[0, s], position[1, s], position[2, s]
        for number in range(27):
            i = cubes[0, b] + number % 3 - 1
            j = cubes[1, b] + number // 3 % 3 - 1
            k = cubes[2, b] + number // 9 - 1
            c = heads[place_of(i, j, k, mask)]
            while c >= 0:
                # Other cubes may have the same index in the table.
                if c > b and cubes[0, c] == i and cubes[1, c] == j and cubes[2, c] == k:
                    t = slots[c]
                    ux, uy = position[0, t] - x, position[1, t] - y
                    uz = position[2, t] - z
                    if half_edges is not None:
                        square = (width - OUTER * (
                            2.0 * largest - half_edges[b] - half_edges[c])) ** 2
                    if ux * ux + uy * uy + uz * uz < square:
                        if count < pairs.shape[0]:
                            at = count
                            while at > first and pairs[at - 1, 1] > c:
                                pairs[at, 1] = pairs[at - 1, 1]
                                at -= 1
                            pairs[at, 0], pairs[count, 0], pairs[at, 1] = b, b, c
                        count += 1
                c = following[c]
    return count


@compiled
def keep_codes(
    old: np.ndarray, old_codes: np.ndarray, pairs: np.ndarray, codes: np.ndarray
) -> None:
    """Copy the axes of pairs that were in the old list; both lists are sorted."""
    at = 0
    for p in range(pairs.shape[0]):
        while at < old.shape[0] and (
                old[at, 0] < pairs[p, 0]
                or old[at, 0] == pairs[p, 0] and old[at, 1] < pairs[p, 1]):
            at += 1
        codes[p] = 0
        if at < old.shape[0] and old[at, 0] == pairs[p, 0] and old[at, 1] == pairs[p, 1]:
            codes[p] = old_codes[at]


@compiled
def refresh(nearby: Nearby, position: np.ndarray, skin: float) -> int:
    """
    Find close bodies again, those whose spheres are less than `skin` [m] apart.

    Return the number of pairs. If they exceed the size of the list, the old list stays.
    """
    width = 2.0 * nearby.radius + skin
    old = int(nearby.counts[1])
    new = 1 - old
    sort_cubes(
        position, nearby.slots, width, nearby.cubes, nearby.heads, nearby.following)
    found = find_close(
        position, nearby.slots, width, nearby.cubes, nearby.heads, nearby.following,
        nearby.pairs[new], nearby.half_edges)
    if found > nearby.pairs.shape[1]:
        return found
    before = int(nearby.counts[0])
    keep_codes(
        nearby.pairs[old, :before], nearby.codes[old, :before], nearby.pairs[new, :found],
        nearby.codes[new, :found])
    nearby.counts[0], nearby.counts[1] = found, new
    for b in range(nearby.slots.shape[0]):
        for k in range(3):
            nearby.reference[b, k] = position[k, nearby.slots[b]]
    return found


@compiled
def axes_row(axes: np.ndarray, b: int) -> Axes:
    """Return the stored axes of a body."""
    return (
        axes[b, 0], axes[b, 1], axes[b, 2], axes[b, 3], axes[b, 4], axes[b, 5], axes[b, 6],
        axes[b, 7], axes[b, 8])


@compiled
def first_gaps(nearby: Nearby, position: np.ndarray, far: float) -> int:
    """
    Write the gap [m] of each pair along its stored axis, or of its spheres if at least `far`.

    Return the pair with the least gap, -1 without pairs.
    """
    slots, gaps, known, axes = nearby.slots, nearby.gaps, nearby.known, nearby.axes
    pairs, codes = nearby.pairs[nearby.counts[1]], nearby.codes[nearby.counts[1]]
    least, first = math.inf, -1
    for p in range(nearby.counts[0]):
        b, c = pairs[p, 0], pairs[p, 1]
        s, t = slots[b], slots[c]
        dx, dy = position[0, t] - position[0, s], position[1, t] - position[1, s]
        dz = position[2, t] - position[2, s]
        gap = math.sqrt(dx * dx + dy * dy + dz * dz) - 2.0 * nearby.radius
        if gap < far:
            gap = gap_along(
                codes[p], edge_of(nearby.half_edge, nearby.half_edges, b),
                ratio_of(nearby.half_edges, b, c), dx, dy, dz, axes_row(axes, b),
                axes_row(axes, c))
        gaps[p], known[p] = gap, False
        if gap < least:
            least, first = gap, p
    return first


@compiled
def search_gap(nearby: Nearby, position: np.ndarray, p: int, wanted: float) -> float:
    """Search for an axis with a gap of at least `wanted` [m] of a pair; return its gap."""
    which = nearby.counts[1]
    b, c = nearby.pairs[which, p, 0], nearby.pairs[which, p, 1]
    s, t = nearby.slots[b], nearby.slots[c]
    gap, code = widest_gap(
        wanted, edge_of(nearby.half_edge, nearby.half_edges, b),
        ratio_of(nearby.half_edges, b, c), position[0, t] - position[0, s],
        position[1, t] - position[1, s], position[2, t] - position[2, s],
        axes_row(nearby.axes, b), axes_row(nearby.axes, c))
    nearby.gaps[p], nearby.codes[which, p], nearby.known[p] = gap, code, gap < wanted
    return gap


@compiled
def plane_gaps(nearby: Nearby, position: np.ndarray) -> float:
    """
    Write distances [m] of all bodies from all planes, (k, n); return the least.

    Half of the distance from a plane that moves, because both sides may close the gap.
    """
    closest = math.inf
    for k in range(nearby.planes.shape[0]):
        offset = offset_of(nearby.planes, nearby.carriers, position, k)
        share = share_of(nearby.carriers, k)
        for b in range(nearby.slots.shape[0]):
            s = nearby.slots[b]
            gap = share * plane_gap(
                nearby.planes[k], offset, edge_of(nearby.half_edge, nearby.half_edges, b),
                position[0, s], position[1, s], position[2, s], axes_row(nearby.axes, b))
            nearby.to_planes[k, b] = gap
            closest = min(closest, gap)
    return closest


@compiled
def find_reach(nearby: Nearby, position: np.ndarray, least: float, most: float) -> float:
    """
    Return the largest displacement of all bodies [m] before any contact, at most `most`.

    The reach depends on the positions of bodies, not on the stored axes. If it is less than
    `least`, all gaps of less than twice `least` are exact, except those of overlapping bodies,
    which are less than 0. Axes of bodies must be in place (`survey`).
    """
    gaps, known = nearby.gaps, nearby.known
    # The pair that seems to be closest comes first: then few others need be searched.
    first = first_gaps(nearby, position, 2.0 * most)
    reach = min(plane_gaps(nearby, position), most)
    if first >= 0 and gaps[first] < 2.0 * reach:
        reach = min(0.5 * search_gap(nearby, position, first, 2.0 * reach), reach)
    for p in range(nearby.counts[0]):
        if gaps[p] < 2.0 * reach and not known[p]:
            reach = min(0.5 * search_gap(nearby, position, p, 2.0 * reach), reach)
    if reach < least:
        room, places = np.zeros(FACET_ROOM), np.zeros((2, 4, 3))
        for p in range(nearby.counts[0]):
            # Overlapping pairs are listed with any gap, so the long search over axes is skipped.
            if gaps[p] < 2.0 * least and not known[p] and not (
                    gaps[p] < 0.0 and overlap(nearby, position, p, room, places)):
                search_gap(nearby, position, p, 2.0 * least)
    return reach


@compiled
def overlap(
    nearby: Nearby, position: np.ndarray, p: int, room: np.ndarray, places: np.ndarray
) -> bool:
    """
    Check that the line of centres shows an overlap of a pair; False: the pair may still overlap.
    """
    for side in range(2):
        b = nearby.pairs[nearby.counts[1], p, side]
        for k in range(3):
            places[side, 0, k] = position[k, nearby.slots[b]]
            for axis in range(3):
                places[side, 1 + k, axis] = nearby.axes[b, 3 * axis + k]
    b, c = nearby.pairs[nearby.counts[1], p, 0], nearby.pairs[nearby.counts[1], p, 1]
    cx, cy, cz = approach(
        edge_of(nearby.half_edge, nearby.half_edges, b),
        edge_of(nearby.half_edge, nearby.half_edges, c), places[1, 0, 0] - places[0, 0, 0],
        places[1, 0, 1] - places[0, 0, 1], places[1, 0, 2] - places[0, 0, 2], places[0, 1:],
        places[1, 1:], room)
    if not max(abs(cx), max(abs(cy), abs(cz))) > COINCIDE:
        return True
    return find_facet(room, cx, cy, cz)[0] == OVERLAP


@compiled
def survey(nearby: Nearby, state: State) -> tuple[float, float]:
    """
    Return the largest speed of a point [m/s], and displacement of a centre since the list [m].

    If all bodies are free, both are relative to the mean velocity, which goes into
    nearby.velocity, and to the mean displacement. Planes have no displacement. The speed is NaN if
    a number of the state is. Store the axes of all bodies.
    """
    slots, axes, mean = nearby.slots, nearby.axes, nearby.velocity
    reference = nearby.reference
    position, linear, angular = state.position, state.linear_velocity, state.angular_velocity
    count, sound = slots.shape[0], 0.0
    mx, my, mz = 0.0, 0.0, 0.0
    for k in range(3):
        mean[k] = 0.0
    for b in range(count):
        s, row = slots[b], axes_of(state.orientation, slots[b])
        (axes[b, 0], axes[b, 1], axes[b, 2], axes[b, 3], axes[b, 4], axes[b, 5], axes[b, 6],
         axes[b, 7], axes[b, 8]) = row
        mx += position[0, s] - reference[b, 0]
        my += position[1, s] - reference[b, 1]
        mz += position[2, s] - reference[b, 2]
        sound += 0.0 * (
            row[0] + row[1] + row[2] + row[3] + row[4] + row[5] + row[6] + row[7] + row[8])
        for k in range(3):
            mean[k] += linear[k, s]
    part = 1.0 / max(count, 1)
    mx, my, mz = mx * part, my * part, mz * part
    for k in range(3):
        mean[k] = mean[k] * part if nearby.free else 0.0
    speed, moved = 0.0, 0.0
    for b in range(count):
        s, square, spin = slots[b], 0.0, 0.0
        for k in range(3):
            square += (linear[k, s] - mean[k]) ** 2
            spin += angular[k, s] ** 2
        own = math.sqrt(square) + nearby.radius * math.sqrt(spin)
        speed = max(speed, own)
        sound += 0.0 * own
        ux, uy = position[0, s] - reference[b, 0] - mx, position[1, s] - reference[b, 1] - my
        uz = position[2, s] - reference[b, 2] - mz
        moved = max(moved, ux * ux + uy * uy + uz * uz)
        sound += 0.0 * (ux + uy + uz)
    return max(speed, plane_speed(nearby.carriers, linear)) + sound, math.sqrt(moved)
