# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Which bodies are close to each other, in time linear in their number, however a fabric is folded.

Space is cut into cubes as wide as two bodies can be apart and still count as close, so the
partners of a body are in its own cube and the 26 around it. Cubes have places in a table by a
hash of their three numbers: no box around all bodies is needed, which may be huge where some fly
away (M. Teschner et al. 2003, Optimized Spatial Hashing).
"""

import math

from icofabric_sim.kernels.compiled import compiled
from icofabric_sim.kernels.contact_gap import axes_of, gap_along, plane_gap, widest_gap
import numpy as np

# Cubes are counted from the origin up to here, either way.
_FARTHEST = 1e15


@compiled
def cube_of(coordinate: float, width: float) -> int:
    """
    Number of the cube along one axis.
    """
    return int(math.floor(min(max(coordinate / width, -_FARTHEST), _FARTHEST)))


@compiled
def place_of(i: int, j: int, k: int, mask: int) -> int:
    """
    Place of a cube in the table.
    """
    return (i * 73856093 ^ j * 19349663 ^ k * 83492791) & mask


@compiled
def sort_cubes(
    position: np.ndarray, slots: np.ndarray, width: float, cubes: np.ndarray, heads: np.ndarray,
    following: np.ndarray
) -> None:
    """
    Put bodies into cubes (3, n), chained from `heads` (a power of two) on by rising number.
    """
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
    following: np.ndarray, pairs: np.ndarray
) -> int:
    """
    Pairs of bodies whose centres are closer than `width` [m], the lower number first, sorted.

    As many as fit go into `pairs` (p, 2); returns how many there are.
    """
    mask, square, count = heads.shape[0] - 1, width * width, 0
    for b in range(slots.shape[0]):
        first, s = count, slots[b]
        x, y, z = position[0, s], position[1, s], position[2, s]
        for number in range(27):
            i = cubes[0, b] + number % 3 - 1
            j = cubes[1, b] + number // 3 % 3 - 1
            k = cubes[2, b] + number // 9 - 1
            c = heads[place_of(i, j, k, mask)]
            while c >= 0:
                # Others may have the same place in the table.
                if c > b and cubes[0, c] == i and cubes[1, c] == j and cubes[2, c] == k:
                    t = slots[c]
                    ux, uy = position[0, t] - x, position[1, t] - y
                    uz = position[2, t] - z
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
    """
    Take over the axes of pairs that were there before; both lists are sorted.
    """
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
def first_gaps(
    position: np.ndarray, orientation: np.ndarray, slots: np.ndarray, half_edge: float,
    radius: float, far: float, pairs: np.ndarray, codes: np.ndarray, gaps: np.ndarray
) -> None:
    """
    What the axis kept for each pair shows [m]; where spheres around them are `far` apart, that.
    """
    for p in range(pairs.shape[0]):
        s, t = slots[pairs[p, 0]], slots[pairs[p, 1]]
        dx, dy = position[0, t] - position[0, s], position[1, t] - position[1, s]
        dz = position[2, t] - position[2, s]
        gap = math.sqrt(dx * dx + dy * dy + dz * dz) - 2.0 * radius
        if gap < far:
            gap = gap_along(
                codes[p], half_edge, dx, dy, dz, axes_of(orientation, s),
                axes_of(orientation, t))
        gaps[p] = gap


@compiled
def search_gaps(
    position: np.ndarray, orientation: np.ndarray, slots: np.ndarray, half_edge: float,
    wanted: float, pairs: np.ndarray, codes: np.ndarray, gaps: np.ndarray, known: np.ndarray
) -> float:
    """
    Look for axes that show a gap of at least `wanted` [m]; returns the least gap of all pairs.

    `known`: of these pairs the widest gap has been found.
    """
    least = math.inf
    for p in range(pairs.shape[0]):
        if gaps[p] < wanted and not known[p]:
            s, t = slots[pairs[p, 0]], slots[pairs[p, 1]]
            gap, code = widest_gap(
                wanted, half_edge, position[0, t] - position[0, s],
                position[1, t] - position[1, s], position[2, t] - position[2, s],
                axes_of(orientation, s), axes_of(orientation, t))
            gaps[p], codes[p] = gap, code
            known[p] = gap < wanted
        least = min(least, gaps[p])
    return least


@compiled
def plane_gaps(
    position: np.ndarray, orientation: np.ndarray, slots: np.ndarray, half_edge: float,
    planes: np.ndarray, gaps: np.ndarray
) -> None:
    """
    Distances [m] of all bodies from all planes, (k, n).
    """
    for k in range(planes.shape[0]):
        for b in range(slots.shape[0]):
            s = slots[b]
            gaps[k, b] = plane_gap(
                planes[k], half_edge, position[0, s], position[1, s], position[2, s],
                axes_of(orientation, s))


@compiled
def find_reach(
    position: np.ndarray, orientation: np.ndarray, slots: np.ndarray, half_edge: float,
    radius: float, least: float, most: float, pairs: np.ndarray, codes: np.ndarray,
    gaps: np.ndarray, planes: np.ndarray, to_planes: np.ndarray
) -> float:
    """
    Longest way of all bodies, from `least` to `most` [m], before anything can touch.

    `least` where something can before that. Leaves what is known of the gaps, which are exact
    where they are less than twice the result.
    """
    known = np.zeros(pairs.shape[0], np.bool_)
    first_gaps(
        position, orientation, slots, half_edge, radius, 2.0 * most, pairs, codes, gaps)
    plane_gaps(position, orientation, slots, half_edge, planes, to_planes)
    closest = math.inf
    for k in range(planes.shape[0]):
        for b in range(slots.shape[0]):
            closest = min(closest, to_planes[k, b])
    found = search_gaps(
        position, orientation, slots, half_edge, 2.0 * least, pairs, codes, gaps, known)
    if min(0.5 * found, closest) < least:
        return least
    reach = least
    while reach < most:
        further = min(2.0 * reach, most)
        found = search_gaps(
            position, orientation, slots, half_edge, 2.0 * further, pairs, codes, gaps, known)
        reach = min(min(0.5 * found, closest), further)
        if reach < further:
            break
    return reach


@compiled
def survey(
    position: np.ndarray, orientation: np.ndarray, linear: np.ndarray, angular: np.ndarray,
    slots: np.ndarray, radius: float, free: bool, reference: np.ndarray, frame: np.ndarray
) -> tuple[float, float]:
    """
    Largest speed of a point of a body [m/s], and way of a centre from `reference` [m].

    Beside the mean velocity, which goes into `frame` (3,), where all are `free`, and the mean way.
    The speed is not a number where any of the state is none.
    """
    count = slots.shape[0]
    mean, sound = np.zeros(3), 0.0
    frame[:] = 0.0
    for b in range(count):
        s = slots[b]
        for k in range(3):
            mean[k] += (position[k, s] - reference[k, s]) / count
            sound += 0.0 * position[k, s]
            if free:
                frame[k] += linear[k, s] / count
        for value in axes_of(orientation, s):
            sound += 0.0 * value
    speed, way = 0.0, 0.0
    for b in range(count):
        s, square, turning, moved = slots[b], 0.0, 0.0, 0.0
        for k in range(3):
            square += (linear[k, s] - frame[k]) ** 2
            turning += angular[k, s] ** 2
            moved += (position[k, s] - reference[k, s] - mean[k]) ** 2
        own = math.sqrt(square) + radius * math.sqrt(turning)
        sound += 0.0 * own
        speed, way = max(speed, own), max(way, moved)
    return speed + sound, math.sqrt(way)
