# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Axes on which two icosahedra are apart, or overlap.

Both are symmetric about their centres, so the positions of the second centre at which the bodies
touch form the sum of both bodies about the first centre (the Minkowski sum of one and the other
reflected). The line of centres leaves that sum through one of its facets, whose normal is the
axis. The bodies are apart if the second centre lies beyond the facet. The facet belongs to a face
of one body and a vertex of the other, or to an edge of each. If several coincide, the facet is
found by portal refinement (G. Snethen, XenoCollide, Game Programming Gems 7, 2008): a triangle of
points of the sum's surface round the line is moved outwards until it lies in a facet.

Frame: axes of the first body, lengths over its a; q is the matrix from the second body's axes, and
`ratio` the second's a over the first's.
"""

import math

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    fabs,
    fma,
    LANES,
    load_at,
    splat,
    store_at,
    Vector,
    where,
)
from icofabric_sim.terms.contacts.shape import (
    AXES,
    AXIS_COUNT,
    AXIS_FACES,
    EDGE_MIDDLES,
    EDGE_SLOPES,
    EDGE_WAYS,
    farthest,
    farthest_edge,
    INNER,
    lead,
    NORMALS,
    OPPOSITE,
    reach,
    reach_lanes,
    RIDGES,
    WAY_COUNT,
    WAY_ROWS,
)
import numpy as np

# Bound of the rounding error of a scalar product of numbers near 1, with a margin.
ROUNDING = 1e-14
# Four or five rounds are typical; each tests another vertex of the sum, which has some 200.
_ROUNDS = 64
APART, OVERLAP, UNSURE = 0, 1, 2
# Indices of lanes.
NUMBERS = np.arange(float(LANES))
# Edges at a smaller angle [rad] are left to refinement.
SLANT = 1e-5
# Largest difference of the distances of both ends of an edge of a facet.
_LEVEL = 1e-9
# Largest distance by which the line of centres may miss a facet.
_BESIDE = 1e-9
# A stored facet is certain if the line passes at least WITHIN inside it (edges are 2 long), if it
# is at least SLOPING from parallel to another, and if the overlap is above OVERLAPPING. A search
# then finds the same facet for any rounding.
WITHIN, SLOPING, OVERLAPPING = 1e-3, 1e-6, 1e-12
# Numbers of facets: 1 + 32 times an edge of the first body + one of the second (numbers of
# EDGE_MIDDLES); these plus a face of the first, or of the second. 0: none of these.
FACE_OF_FIRST, FACE_OF_SECOND = 1024, 2048
# Offsets in the scratch array of a pair (surface.py): the matrix q, and four rows of a point of
# the sum and the first body's share; the number of the facet that was found; numbers of the
# relevant edge directions of either body.
MATRIX, PORTAL, FACET, OWN_NUMBERS, OTHER_NUMBERS = 0, 9, 488, 512, 528
# The ratio of both sizes.
RATIO = 489
# Directions of edges of either body, six times AXIS_COUNT numbers each; lanes.
OWN, OTHER, ALONG, NUMERATOR, DENOMINATOR, WHICH = 256, 352, 448, 464, 472, 480
FACET_ROOM = 544
Nine = tuple[float, float, float, float, float, float, float, float, float]


@compiled
def turn_back(q: np.ndarray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the transpose of a matrix (3, 3) times a vector."""
    return (q[0, 0] * x + q[1, 0] * y + q[2, 0] * z,
            q[0, 1] * x + q[1, 1] * y + q[2, 1] * z,
            q[0, 2] * x + q[1, 2] * y + q[2, 2] * z)


@compiled
def turn(q: np.ndarray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return a matrix (3, 3) times a vector."""
    return (q[0, 0] * x + q[0, 1] * y + q[0, 2] * z,
            q[1, 0] * x + q[1, 1] * y + q[1, 2] * z,
            q[2, 0] * x + q[2, 1] * y + q[2, 2] * z)


@compiled
def separation_on(
    half_edge: float, other_edge: float, xa: np.ndarray, ra: np.ndarray, xb: np.ndarray,
    rb: np.ndarray, ux: float, uy: float, uz: float
) -> float:
    """
    Return the gap [m] along a unit vector from body A to B, world frame; negative: overlap.

    Centres [m] (3,), matrices from body to world axes (3, 3). The gap is a lower bound of the
    distance, which is the largest gap of all axes.
    """
    ax, ay, az = turn_back(ra, ux, uy, uz)
    bx, by, bz = turn_back(rb, ux, uy, uz)
    between = ux * (xb[0] - xa[0]) + uy * (xb[1] - xa[1]) + uz * (xb[2] - xa[2])
    return between - half_edge * (
        reach(ax, ay, az) + other_edge / half_edge * reach(bx, by, bz))


@compiled
def turn_to(room: np.ndarray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return a vector on the second body's axes in those of the first."""
    return (room[0] * x + room[1] * y + room[2] * z,
            room[3] * x + room[4] * y + room[5] * z,
            room[6] * x + room[7] * y + room[8] * z)


@compiled
def turn_from(room: np.ndarray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return a vector on the first body's axes in those of the second."""
    return (room[0] * x + room[3] * y + room[6] * z,
            room[1] * x + room[4] * y + room[7] * z,
            room[2] * x + room[5] * y + room[8] * z)


@compiled
def put_farthest(room: np.ndarray, ux: float, uy: float, uz: float, row: int) -> float:
    """
    Write the sum's farthest point along u, and the first body's share, into a row of PORTAL.

    Return its scalar product with u.
    """
    ax, ay, az = farthest(ux, uy, uz)
    bx, by, bz = turn_from(room, ux, uy, uz)
    bx, by, bz = farthest(bx, by, bz)
    bx, by, bz = turn_to(room, bx, by, bz)
    ratio = room[RATIO]
    x, y, z = ax + ratio * bx, ay + ratio * by, az + ratio * bz
    k = PORTAL + 6 * row
    room[k] = x
    room[k + 1] = y
    room[k + 2] = z
    room[k + 3] = ax
    room[k + 4] = ay
    room[k + 5] = az
    return ux * x + uy * y + uz * z


@compiled
def corner(room: np.ndarray, row: int) -> tuple[float, float, float]:
    """Return the point of a row of PORTAL."""
    k = PORTAL + 6 * row
    return room[k], room[k + 1], room[k + 2]


@compiled
def cross(
    one: tuple[float, float, float], two: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Return the cross product."""
    return (one[1] * two[2] - one[2] * two[1], one[2] * two[0] - one[0] * two[2],
            one[0] * two[1] - one[1] * two[0])


@compiled
def dot(one: tuple[float, float, float], two: tuple[float, float, float]) -> float:
    """Return the scalar product."""
    return one[0] * two[0] + one[1] * two[1] + one[2] * two[2]


@compiled
def across(c: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return a vector perpendicular to a vector that is not zero."""
    x, y, z = c
    if abs(x) <= abs(y) and abs(x) <= abs(z):
        return 0.0, -z, y
    if abs(y) <= abs(z):
        return z, 0.0, -x
    return -y, x, 0.0


@compiled
def beyond_most(room: np.ndarray, cx: float, cy: float, cz: float) -> tuple[int, float]:
    """
    Return the face normal on which c is farthest out, relative to the sum of both bodies.

    The first result is a number in AXES, AXIS_COUNT more for a normal of the second body; the
    second is the ratio, 1 on the surface of the sum.
    """
    q0, q1, q2 = splat(room[0]), splat(room[1]), splat(room[2])
    q3, q4, q5 = splat(room[3]), splat(room[4]), splat(room[5])
    q6, q7, q8 = splat(room[6]), splat(room[7]), splat(room[8])
    x, y, z = splat(cx), splat(cy), splat(cz)
    # c in the second body's axes, where its normals are the same constants.
    bx, by, bz = (fma(q0, x, fma(q3, y, q6 * z)), fma(q1, x, fma(q4, y, q7 * z)),
                  fma(q2, x, fma(q5, y, q8 * z)))
    own, ratio = splat(INNER), splat(room[RATIO])
    other = ratio * own
    # Ratios are compared as products, because a division takes as long as the rest of the loop.
    most, over, which = splat(0.0), splat(1.0), splat(0.0)
    for k in range(0, AXIS_COUNT, LANES):
        nx = load_at(AXES, k)
        ny = load_at(AXES, AXIS_COUNT + k)
        nz = load_at(AXES, 2 * AXIS_COUNT + k)
        number = load_at(NUMBERS, 0) + splat(float(k))
        far = fabs(fma(nx, x, fma(ny, y, nz * z)))
        whole = own + ratio * reach_lanes(
            fma(q0, nx, fma(q3, ny, q6 * nz)), fma(q1, nx, fma(q4, ny, q7 * nz)),
            fma(q2, nx, fma(q5, ny, q8 * nz)))
        farther = far * over > most * whole
        which = where(farther, number, which)
        most = where(farther, far, most)
        over = where(farther, whole, over)
        far = fabs(fma(nx, bx, fma(ny, by, nz * bz)))
        whole = other + reach_lanes(
            fma(q0, nx, fma(q1, ny, q2 * nz)), fma(q3, nx, fma(q4, ny, q5 * nz)),
            fma(q6, nx, fma(q7, ny, q8 * nz)))
        farther = far * over > most * whole
        which = where(farther, number + splat(float(AXIS_COUNT)), which)
        most = where(farther, far, most)
        over = where(farther, whole, over)
    best = best_lane(room, most, over, which)
    return int(room[WHICH + best]), room[NUMERATOR + best] / room[DENOMINATOR + best]


@compiled
def best_lane(room: np.ndarray, most: Vector, over: Vector, which: Vector) -> int:
    """Return the lane with the largest `most` over `over`; write all three vectors."""
    store_at(room, NUMERATOR, most)
    store_at(room, DENOMINATOR, over)
    store_at(room, WHICH, which)
    best = 0
    for k in range(1, LANES):
        larger = room[NUMERATOR + k] * room[DENOMINATOR + best] > (
            room[NUMERATOR + best] * room[DENOMINATOR + k])
        best = k if larger else best
    return best


@compiled
def within(face: int, x: float, y: float, z: float, margin: float) -> bool:
    """Check that a point in body axes is within the pyramid of a face, by a margin."""
    outside = False
    for k in range(3):
        outside |= (RIDGES[face, k, 0] * x + RIDGES[face, k, 1] * y
                    + RIDGES[face, k, 2] * z > -margin)
    return not outside


@compiled
def find_facet(
    room: np.ndarray, cx: float, cy: float, cz: float
) -> tuple[int, float, float, float, float, float, float, float]:
    """
    Return APART or OVERLAP for two bodies, or UNSURE if neither was found.

    Then the unit axis (3) from the first body to the second, the gap along it (negative: overlap;
    no other axis is examined), and of overlapping bodies the deepest point of both: the point
    where they would touch if they shrank about their centres. c is the second centre, not at the
    first; room[MATRIX:] holds q, row by row. An axis with a gap ends the search. The number of the
    facet goes to room[FACET].
    """
    room[FACET] = 0.0
    square = cx * cx + cy * cy + cz * cz
    bx, by, bz = turn_from(room, cx, cy, cz)
    between = square - reach(cx, cy, cz) - room[RATIO] * reach(bx, by, bz)
    if between > 0.0:
        length = math.sqrt(square)
        gap = between / length
        if gap > ROUNDING:
            return APART, cx / length, cy / length, cz / length, gap, 0.0, 0.0, 0.0
    axis, out = beyond_most(room, cx, cy, cz)
    second = axis >= AXIS_COUNT
    face = AXIS_FACES[axis - AXIS_COUNT if second else axis]
    ux, uy, uz = NORMALS[face, 0], NORMALS[face, 1], NORMALS[face, 2]
    # The normal in the axes of both bodies, towards c.
    if second:
        nx, ny, nz = turn_to(room, ux, uy, uz)
    else:
        nx, ny, nz = ux, uy, uz
    between = nx * cx + ny * cy + nz * cz
    if between < 0.0:
        face = OPPOSITE[face]
        between, nx, ny, nz = -between, -nx, -ny, -nz
    # The facet of a face and the other body's farthest vertex: does the line leave through it?
    number = face + (FACE_OF_SECOND if second else FACE_OF_FIRST)
    inside, nx, ny, nz, gap, x, y, z = facet_of_face(room, number, cx, cy, cz, 0.0)
    if gap > ROUNDING:
        return APART, nx, ny, nz, gap, 0.0, 0.0, 0.0
    if inside:
        room[FACET] = number
        return OVERLAP, nx, ny, nz, gap, x, y, z
    return across_edges(room, cx, cy, cz, out)


@compiled
def facet_of_face(
    room: np.ndarray, number: int, cx: float, cy: float, cz: float, margin: float
) -> tuple[bool, float, float, float, float, float, float, float]:
    """
    Check that the line of centres leaves through the facet of a face, by a margin.

    Then the facet's unit normal (3), the gap along it, and the deepest point of both bodies, as
    `find_facet` returns them. The facet has the other body's farthest vertex. A margin is for
    facets of an earlier evaluation; this vertex must then be farther than any other.
    """
    face, second = number & 31, number >= FACE_OF_SECOND
    nx, ny, nz = NORMALS[face, 0], NORMALS[face, 1], NORMALS[face, 2]
    if second:
        nx, ny, nz = turn_to(room, nx, ny, nz)
        ux, uy, uz = nx, ny, nz
    else:
        ux, uy, uz = turn_from(room, nx, ny, nz)
    x, y, z = farthest(ux, uy, uz)
    between, ratio = nx * cx + ny * cy + nz * cz, room[RATIO]
    if second:
        far = ratio * INNER + (ux * x + uy * y + uz * z)
    else:
        far = INNER + ratio * (ux * x + uy * y + uz * z)
    gap = between - far
    part, out = far / between, between / far
    if second:
        ax, ay, az = x, y, z
        bx, by, bz = turn_from(room, part * cx - x, part * cy - y, part * cz - z)
        inside = within(face, bx, by, bz, margin)
    else:
        bx, by, bz = turn_to(room, ratio * x, ratio * y, ratio * z)
        ax, ay, az = part * cx - bx, part * cy - by, part * cz - bz
        inside = within(face, ax, ay, az, margin)
    if margin > 0.0:
        inside &= between > 0.0 and lead(ux, uy, uz) > SLOPING
    return inside, nx, ny, nz, gap, out * ax, out * ay, out * az


@compiled
def facet_of_edges(
    room: np.ndarray, number: int, cx: float, cy: float, cz: float, margin: float
) -> tuple[bool, float, float, float, float, float, float, float]:
    """
    Check that the line of centres leaves through the facet of an edge of each body, by a margin.

    Results as `facet_of_face`. Both edges must be the farthest along its normal, which is checked
    only with a margin.
    """
    own, other = (number - 1) >> 5, (number - 1) & 31
    e = EDGE_WAYS[own >> 1, 0], EDGE_WAYS[own >> 1, 1], EDGE_WAYS[own >> 1, 2]
    a = EDGE_MIDDLES[own, 0], EDGE_MIDDLES[own, 1], EDGE_MIDDLES[own, 2]
    f = turn_to(
        room, EDGE_WAYS[other >> 1, 0], EDGE_WAYS[other >> 1, 1], EDGE_WAYS[other >> 1, 2])
    ratio = room[RATIO]
    b = turn_to(
        room, ratio * EDGE_MIDDLES[other, 0], ratio * EDGE_MIDDLES[other, 1],
        ratio * EDGE_MIDDLES[other, 2])
    n = cross(e, f)
    length = math.sqrt(dot(n, n))
    # Edges that are nearly parallel have a cross product of rounding only.
    if not length > max(SLANT, margin):
        return False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if dot(n, (cx, cy, cz)) < 0.0:
        length = -length
    scale = 1.0 / length
    nx, ny, nz = scale * n[0], scale * n[1], scale * n[2]
    between = nx * cx + ny * cy + nz * cz
    far = nx * (a[0] - b[0]) + ny * (a[1] - b[1]) + nz * (a[2] - b[2])
    gap = between - far
    # The line leaves through the parallelogram of both where it is within half an edge of its
    # middle along either.
    part, out = far / between, between / far
    r = part * cx - a[0] + b[0], part * cy - a[1] + b[1], part * cz - a[2] + b[2]
    own_part = scale * dot(cross(r, f), (nx, ny, nz))
    other_part = scale * dot(cross(e, r), (nx, ny, nz))
    inside = abs(own_part) <= 1.0 - margin and abs(other_part) <= ratio * (1.0 - margin)
    if margin > 0.0:
        m = turn_from(room, nx, ny, nz)
        sloping, rising = EDGE_SLOPES[own], nx * a[0] + ny * a[1] + nz * a[2]
        inside &= abs(nx * sloping[0] + ny * sloping[1] + nz * sloping[2]) < (
            1.0 - SLOPING) * rising
        sloping = EDGE_SLOPES[other]
        rising = -(nx * b[0] + ny * b[1] + nz * b[2])
        inside &= ratio * abs(m[0] * sloping[0] + m[1] * sloping[1] + m[2] * sloping[2]) < (
            1.0 - SLOPING) * rising
    return (inside, nx, ny, nz, gap, out * (a[0] + own_part * e[0]),
            out * (a[1] + own_part * e[1]), out * (a[2] + own_part * e[2]))


@compiled
def find_facet_again(
    room: np.ndarray, number: int, cx: float, cy: float, cz: float
) -> tuple[int, float, float, float, float, float, float, float]:
    """
    Return the results of `find_facet`, without a search if facet `number` is certain to hold.

    The result therefore does not depend on the number, to the last bit.
    """
    if number > 0:
        if number < FACE_OF_FIRST:
            inside, nx, ny, nz, gap, x, y, z = facet_of_edges(room, number, cx, cy, cz, WITHIN)
        else:
            inside, nx, ny, nz, gap, x, y, z = facet_of_face(room, number, cx, cy, cz, WITHIN)
        if inside and gap < -OVERLAPPING:
            room[FACET] = number
            return OVERLAP, nx, ny, nz, gap, x, y, z
    return find_facet(room, cx, cy, cz)


@compiled
def put_ways(
    room: np.ndarray, at: int, numbers: int, x: float, y: float, z: float, limit: float, m: Nine
) -> int:
    """
    Write the edge directions whose product with (x, y, z) has a square below a limit.

    x, y and z in the body's own axes, then times the matrix m, AXIS_COUNT numbers each, 0 after
    the last; and their numbers. Return how many there are.
    """
    cx, cy, cz, zero = splat(x), splat(y), splat(z), splat(0.0)
    for k in range(0, AXIS_COUNT, LANES):
        along = fma(load_at(WAY_ROWS, k), cx, fma(
            load_at(WAY_ROWS, AXIS_COUNT + k), cy, load_at(WAY_ROWS, 2 * AXIS_COUNT + k) * cz))
        store_at(room, ALONG + k, along * along)
        for row in range(3):
            store_at(room, at + AXIS_COUNT * row + k, zero)
    count = 0
    for way in range(WAY_COUNT):
        room[at + count] = WAY_ROWS[way]
        room[at + AXIS_COUNT + count] = WAY_ROWS[AXIS_COUNT + way]
        room[at + 2 * AXIS_COUNT + count] = WAY_ROWS[2 * AXIS_COUNT + way]
        room[numbers + count] = way
        count += 1 if room[ALONG + way] < limit else 0
    for row in range(3):
        room[at + AXIS_COUNT * row + count] = 0.0
    for k in range(0, AXIS_COUNT, LANES):
        ex = load_at(room, at + k)
        ey = load_at(room, at + AXIS_COUNT + k)
        ez = load_at(room, at + 2 * AXIS_COUNT + k)
        for row in range(3):
            store_at(room, at + AXIS_COUNT * (3 + row) + k, fma(splat(m[3 * row]), ex, fma(
                splat(m[3 * row + 1]), ey, splat(m[3 * row + 2]) * ez)))
    return count


@compiled
def beyond_edges(
    room: np.ndarray, own: int, other: int, cx: float, cy: float, cz: float, out: float
) -> int:
    """
    Return the pair of edge directions across which c is farthest out, more than `out`; or -1.

    Of the first `own` and `other` directions that were written. The result is AXIS_COUNT times the
    number of the first body's direction plus that of the second's.
    """
    x, y, z = splat(cx), splat(cy), splat(cz)
    # Ratios are compared as products, because a division takes as long as the rest of the loop.
    most, over, which = splat(out), splat(1.0), splat(-1.0)
    # The product of nearly parallel edges is rounding only.
    ratio, zero = splat(room[RATIO]), splat(0.0)
    least = splat((1.0 + room[RATIO]) * INNER * SLANT)
    for k in range(0, other, LANES):
        px, py, pz = (load_at(room, OTHER + k), load_at(room, OTHER + AXIS_COUNT + k),
                      load_at(room, OTHER + 2 * AXIS_COUNT + k))
        fx, fy, fz = (load_at(room, OTHER + 3 * AXIS_COUNT + k),
                      load_at(room, OTHER + 4 * AXIS_COUNT + k),
                      load_at(room, OTHER + 5 * AXIS_COUNT + k))
        lane_numbers = load_at(NUMBERS, 0) + splat(float(k))
        for way in range(own):
            ex, ey, ez = (splat(room[OWN + way]), splat(room[OWN + AXIS_COUNT + way]),
                          splat(room[OWN + 2 * AXIS_COUNT + way]))
            nx, ny, nz = ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx
            far = fabs(fma(nx, x, fma(ny, y, nz * z)))
            whole = reach_lanes(nx, ny, nz)
            # The same in the second body's axes.
            ex, ey, ez = (splat(room[OWN + 3 * AXIS_COUNT + way]),
                          splat(room[OWN + 4 * AXIS_COUNT + way]),
                          splat(room[OWN + 5 * AXIS_COUNT + way]))
            whole = whole + ratio * reach_lanes(
                ey * pz - ez * py, ez * px - ex * pz, ex * py - ey * px)
            far = where(whole > least, far, zero)
            farther = far * over > most * whole
            most = where(farther, far, most)
            over = where(farther, whole, over)
            which = where(farther, lane_numbers + splat(float(AXIS_COUNT * way)), which)
    return int(room[WHICH + best_lane(room, most, over, which)])


@compiled
def across_edges(
    room: np.ndarray, cx: float, cy: float, cz: float, out: float
) -> tuple[int, float, float, float, float, float, float, float]:
    """
    Return the results of `find_facet` if no face decides: by edges, or else by refinement.

    On the normals of faces c is `out` times as far out as the sum of both bodies. A normal n
    across an edge e has n . c <= |c - (c . e) e|, and the sum extends by both rho along n at
    least. Most edges need no test therefore.
    """
    least = (1.0 + room[RATIO]) * INNER * out * (1.0 - ROUNDING)
    limit = cx * cx + cy * cy + cz * cz - least * least
    bx, by, bz = turn_from(room, cx, cy, cz)
    own = put_ways(room, OWN, OWN_NUMBERS, cx, cy, cz, limit, (
        room[0], room[3], room[6], room[1], room[4], room[7], room[2], room[5], room[8]))
    other = put_ways(room, OTHER, OTHER_NUMBERS, bx, by, bz, limit, (
        room[0], room[1], room[2], room[3], room[4], room[5], room[6], room[7], room[8]))
    pair = beyond_edges(room, own, other, cx, cy, cz, out)
    if pair < 0:
        return refine(room, cx, cy, cz)
    own = int(room[OWN_NUMBERS + pair // AXIS_COUNT])
    other = int(room[OTHER_NUMBERS + pair % AXIS_COUNT])
    e = EDGE_WAYS[own, 0], EDGE_WAYS[own, 1], EDGE_WAYS[own, 2]
    f = EDGE_WAYS[other, 0], EDGE_WAYS[other, 1], EDGE_WAYS[other, 2]
    n = cross(e, turn_to(room, f[0], f[1], f[2]))
    if dot(n, (cx, cy, cz)) < 0.0:
        n = -n[0], -n[1], -n[2]
    length = math.sqrt(dot(n, n))
    if not length > SLANT:
        return refine(room, cx, cy, cz)
    # Other edges may have the same normal: take the edges that are farthest along it.
    nx, ny, nz = n[0] / length, n[1] / length, n[2] / length
    own, own_back = farthest_edge(nx, ny, nz)
    bx, by, bz = turn_from(room, -nx, -ny, -nz)
    other, other_back = farthest_edge(bx, by, bz)
    if not (own_back < _LEVEL and other_back < _LEVEL):
        return refine(room, cx, cy, cz)
    number = 1 + 32 * own + other
    # The point where the line leaves by edges that are nearly parallel is not precise.
    own, other = own >> 1, other >> 1
    n = cross((EDGE_WAYS[own, 0], EDGE_WAYS[own, 1], EDGE_WAYS[own, 2]), turn_to(
        room, EDGE_WAYS[other, 0], EDGE_WAYS[other, 1], EDGE_WAYS[other, 2]))
    if not math.sqrt(dot(n, n)) > WITHIN:
        return refine(room, cx, cy, cz)
    inside, nx, ny, nz, gap, x, y, z = facet_of_edges(room, number, cx, cy, cz, 0.0)
    if gap > ROUNDING:
        return APART, nx, ny, nz, gap, 0.0, 0.0, 0.0
    if not inside:
        return refine(room, cx, cy, cz)
    room[FACET] = number
    return OVERLAP, nx, ny, nz, gap, x, y, z


@compiled
def refine(
    room: np.ndarray, cx: float, cy: float, cz: float
) -> tuple[int, float, float, float, float, float, float, float]:
    """Return the results of `find_facet` by portal refinement."""
    c = cx, cy, cz
    put_farthest(room, cx, cy, cz, 0)
    n = cross(corner(room, 0), c)
    if not dot(n, n) > 0.0:
        # The line goes through the first point: any perpendicular direction is valid.
        n = across(c)
    put_farthest(room, n[0], n[1], n[2], 1)
    # The sides from one to two, two to three and three to one have the line on their left.
    one, two, three, four = 0, 1, 2, 3
    n = cross(corner(room, 0), corner(room, 1))
    if dot(n, c) < 0.0:
        one, two = two, one
        n = -n[0], -n[1], -n[2]
    inside = False
    for _ in range(_ROUNDS):
        gap = dot(n, c) - put_farthest(room, n[0], n[1], n[2], three)
        if gap > 0.0:
            length = math.sqrt(dot(n, n))
            gap /= length
            if gap > ROUNDING:
                return APART, n[0] / length, n[1] / length, n[2] / length, gap, 0.0, 0.0, 0.0
        new = cross(corner(room, three), c)
        if dot(new, corner(room, two)) < 0.0:
            one, three = three, one
        elif dot(new, corner(room, one)) > 0.0:
            two, three = three, two
        else:
            inside = True
            break
        n = cross(corner(room, one), corner(room, two))
    if not inside:
        return UNSURE, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for _ in range(_ROUNDS):
        p1, p2, p3 = corner(room, one), corner(room, two), corner(room, three)
        n = cross((p2[0] - p1[0], p2[1] - p1[1], p2[2] - p1[2]),
                  (p3[0] - p1[0], p3[1] - p1[1], p3[2] - p1[2]))
        square = dot(n, n)
        if not square > 0.0:
            break
        scale = 1.0 / math.sqrt(square)
        n = n[0] * scale, n[1] * scale, n[2] * scale
        far = put_farthest(room, n[0], n[1], n[2], four)
        gap = dot(n, c) - far
        if gap > ROUNDING:
            return APART, n[0], n[1], n[2], gap, 0.0, 0.0, 0.0
        if far - dot(n, p1) <= ROUNDING:
            # Cramer's rule: c is the sum of the three points times these over the determinant.
            whole = dot(cross(p1, p2), p3)
            if not whole > 0.0:
                break
            first = dot(cross(p2, p3), c) / whole
            second = dot(cross(p3, p1), c) / whole
            third = dot(cross(p1, p2), c) / whole
            if not min(first, min(second, third)) > -_BESIDE:
                # By rounding the line is outside the triangle.
                break
            i, j, k = PORTAL + 6 * one + 3, PORTAL + 6 * two + 3, PORTAL + 6 * three + 3
            return (
                OVERLAP, n[0], n[1], n[2], gap,
                first * room[i] + second * room[j] + third * room[k],
                first * room[i + 1] + second * room[j + 1] + third * room[k + 1],
                first * room[i + 2] + second * room[j + 2] + third * room[k + 2])
        # Of the three triangles with the new point, the one that has the line in it.
        new = cross(corner(room, four), c)
        first, second, third = dot(new, p1), dot(new, p2), dot(new, p3)
        if first <= 0.0 and second >= 0.0:
            three, four = four, three
        elif second <= 0.0 and third >= 0.0:
            one, four = four, one
        else:
            two, four = four, two
    return UNSURE, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
