# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Contact of two icosahedra, and of one with a plane, by a potential.

    U = K delta^2 / 2,   delta = 4 M_1 / M_0,   M_k = integral of min(p_A, p_B)^k over both bodies

with p the depth below a body's surface (surface.py): delta is four times the mean depth
of the overlap, which is the overlap itself if a face lies on a face. For all features delta grows
in proportion to the overlap. The force is therefore zero at first touch and nowhere jumps, and the
stiffness is about K for faces, edges and vertices alike. For a plane, p is the depth below it.
Overlaps with one apex have closed forms (apex.py).

The results depend on the position and orientation of both bodies only. Exchanging the bodies
changes the signs of all results and no other bit.
"""

import math

from icofabric_sim.kernels.runtime.borrowed import borrowed
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.terms.contacts.apex import (
    ALONG_CENTRES,
    APEX_UNIT,
    cone,
    edges_across,
    FOUND,
    put_features,
    take_lane,
    vertices_in_faces,
)
from icofabric_sim.terms.contacts.axis import (
    APART,
    FACE_OF_FIRST,
    FACE_OF_SECOND,
    FACET,
    find_facet,
    find_facet_again,
    MATRIX,
    OVERLAP,
    put_farthest,
    RATIO,
    ROUNDING,
    turn,
    turn_back,
    turn_from,
)
from icofabric_sim.terms.contacts.gap import Axes
from icofabric_sim.terms.contacts.shape import farthest_vertex, INNER, OUTER, reach, VERTICES
from icofabric_sim.terms.contacts.surface import (
    add_all,
    add_inner,
    add_plane,
    add_surface,
    ALONE,
    contact_scratch,
    M0,
    M1,
    P1,
    S0,
    S1,
    Scratch,
    SUM_COUNT,
    SUMS,
    T0,
    T1,
    turn_normals,
    X1,
)
import numpy as np

__all__ = ['contact_scratch', 'OUT_SIZE', 'Scratch', 'touch_pair', 'touch_plane']

# Numbers in `out` of a pair: force on A (3), torques about their centres on A and B (3 each),
# delta^2 / 2, delta, overlap, unit axis from A to B (3), contact point (3), squared contact area,
# number of the facet that the line of centres leaves through (axis.py, apex.py).
OUT_SIZE = 20
# Centres closer than this times a coincide: no direction separates them.
COINCIDE = 1e-6
# Overlap over a above which the surface between the bodies may be disconnected.
_DEEP = 0.5
# Overlaps of less volume than this times a^3 count as zero; depths are then 1e-66 a.
_NOTHING = 1e-200
# Offset of the overlap [m] along the line of centres, after the evaluation of a contact.
LINE = ALONE + LANES * ALONG_CENTRES


@compiled
def touch_pair(
    half_edge: float, other_edge: float, xa: np.ndarray, ra: np.ndarray, xb: np.ndarray,
    rb: np.ndarray, scratch: Scratch, out: np.ndarray
) -> bool:
    """
    Check that two shells of these half edges [m] touch; write forces for a stiffness of 1 N/m.

    Centres [m] (3,), matrices from body to world axes (3, 3). Write `out` (20,): force on A [N]
    (3), its torque about the centre of A [N m] (3), the torque on B about the centre of B (3),
    energy delta^2 / 2 [J], delta [m], overlap [m], axis (3), contact point [m] (3), square of the
    contact area [m^4], number of the facet or 0. The force on B is opposite. The overlap is that
    along the axis, the normal of the facet of the Minkowski sum that the line of centres leaves
    through: never less than the displacement that separates the bodies. Friction acts at the
    contact point: the centre of depth of the surface between the bodies, from the middle of both
    centres. If the bodies are apart, all numbers are 0 except the axis, which has a gap.

    Bodies whose centres coincide have no force, by symmetry: then delta is rho, its value for
    equal orientations, and the overlap twice that; of two sizes that of the smaller.
    """
    return meet(
        half_edge, other_edge, borrowed(xa), borrowed(ra), borrowed(xb), borrowed(rb), 0,
        borrowed(scratch.room), borrowed(scratch.marks), borrowed(out))


@compiled
def touch_pair_again(
    half_edge: float, other_edge: float, xa: np.ndarray, ra: np.ndarray, xb: np.ndarray,
    rb: np.ndarray, scratch: Scratch, out: np.ndarray
) -> bool:
    """Evaluate a pair as `touch_pair`; the facet of earlier results in `out` may save a search."""
    return meet(
        half_edge, other_edge, borrowed(xa), borrowed(ra), borrowed(xb), borrowed(rb),
        int(out[19]), borrowed(scratch.room), borrowed(scratch.marks), borrowed(out))


@compiled
def meet(
    half_edge: float, other_edge: float, xa: np.ndarray, ra: np.ndarray, xb: np.ndarray,
    rb: np.ndarray, number: int, room: np.ndarray, marks: np.ndarray, out: np.ndarray
) -> bool:
    """Evaluate a pair as `touch_pair`, with the facet to try first and uncounted arrays."""
    for k in range(OUT_SIZE):
        out[k] = 0.0
    dx, dy, dz = xb[0] - xa[0], xb[1] - xa[1], xb[2] - xa[2]
    reach_of_both = OUTER * (half_edge + other_edge)
    square = dx * dx + dy * dy + dz * dz
    if not square < reach_of_both * reach_of_both:
        length = math.sqrt(square)
        out[12], out[13], out[14] = dx / length, dy / length, dz / length
        return False
    # The same arithmetic whichever body comes first.
    swapped = dx < 0.0 or (dx == 0.0 and (dy < 0.0 or (dy == 0.0 and dz < 0.0)))
    if swapped:
        ra, rb = rb, ra
        dx, dy, dz = -dx, -dy, -dz
        half_edge, other_edge = other_edge, half_edge
    found = press(half_edge, other_edge, dx, dy, dz, ra, rb, number, room, marks, out)
    if swapped:
        for k in range(3):
            out[k], out[12 + k] = -out[k], -out[12 + k]
            out[3 + k], out[6 + k] = out[6 + k], out[3 + k]
    return found


@compiled
def press(
    half_edge: float, other_edge: float, dx: float, dy: float, dz: float, ra: np.ndarray,
    rb: np.ndarray, number: int, room: np.ndarray, marks: np.ndarray, out: np.ndarray
) -> bool:
    """Evaluate a body at the origin and another at d, whose first component is not negative."""
    cx, cy, cz = approach(half_edge, other_edge, dx, dy, dz, ra, rb, room)
    if not max(abs(cx), max(abs(cy), abs(cz))) > COINCIDE:
        smaller = min(half_edge, other_edge)
        out[9] = 0.5 * (INNER * smaller) ** 2
        out[10] = INNER * smaller
        out[11] = 2.0 * INNER * smaller
        out[12] = 1.0
        room[LINE] = out[11]
        return True
    verdict, ux, uy, uz, gap, x, y, z = find_facet_again(
        room, number % APEX_UNIT, cx, cy, cz)
    if verdict == APART:
        out[12], out[13], out[14] = turn(ra, ux, uy, uz)
        return False
    number = int(room[FACET])
    out[19] = number
    if number > 0 and gap < 0.0 and half_edge == other_edge and press_apex(
            half_edge, dx, dy, dz, ra, rb, number, ux, uy, uz, room, out):
        return True
    found, ux, uy, uz, gap = press_surface(
        half_edge, ra, verdict, cx, cy, cz, ux, uy, uz, gap, x, y, z, room, marks, out)
    out[12], out[13], out[14] = turn(ra, ux, uy, uz)
    if not found:
        return False
    out[11] = max(0.0, -gap) * half_edge
    # Angular momentum is conserved for any polygons.
    out[6] = -out[3] + (dy * out[2] - dz * out[1])
    out[7] = -out[4] + (dz * out[0] - dx * out[2])
    out[8] = -out[5] + (dx * out[1] - dy * out[0])
    out[15], out[16], out[17] = out[15] - 0.5 * dx, out[16] - 0.5 * dy, out[17] - 0.5 * dz
    length = math.sqrt(cx * cx + cy * cy + cz * cz)
    ux, uy, uz = cx / length, cy / length, cz / length
    vx, vy, vz = turn_from(room, ux, uy, uz)
    room[LINE] = half_edge * (reach(ux, uy, uz) + room[RATIO] * reach(vx, vy, vz) - length)
    return True


@compiled
def press_apex(
    half_edge: float, dx: float, dy: float, dz: float, ra: np.ndarray, rb: np.ndarray,
    number: int, ux: float, uy: float, uz: float, room: np.ndarray, out: np.ndarray
) -> bool:
    """
    Evaluate a pair whose overlap has one apex; return False, and write nothing, if it has not.

    The pair is computed by the same code as pairs in lanes, in one lane: so the bits are equal.
    """
    number += APEX_UNIT
    if number >= APEX_UNIT + FACE_OF_SECOND:
        number += APEX_UNIT * farthest_vertex(ux, uy, uz)
    elif number >= APEX_UNIT + FACE_OF_FIRST:
        vx, vy, vz = turn_from(room, -ux, -uy, -uz)
        number += APEX_UNIT * farthest_vertex(vx, vy, vz)
    exchanged = put_features(
        room, ALONE, 0, dx, dy, dz, axes_in(ra), axes_in(rb), number)
    if number % APEX_UNIT < FACE_OF_FIRST:
        edges_across(room, ALONE, half_edge)
    else:
        vertices_in_faces(room, ALONE, half_edge)
    if room[ALONE + LANES * FOUND] != 1.0:
        return False
    take_lane(room, ALONE, 0, exchanged, number, out)
    return True


@compiled
def axes_in(matrix: np.ndarray) -> Axes:
    """Return world components of the body axes, the columns of a matrix."""
    return (matrix[0, 0], matrix[1, 0], matrix[2, 0], matrix[0, 1], matrix[1, 1], matrix[2, 1],
            matrix[0, 2], matrix[1, 2], matrix[2, 2])


@compiled
def press_surface(
    half_edge: float, ra: np.ndarray, verdict: int, cx: float, cy: float, cz: float, ux: float,
    uy: float, uz: float, gap: float, x: float, y: float, z: float, room: np.ndarray,
    marks: np.ndarray, out: np.ndarray
) -> tuple[bool, float, float, float, float]:
    """
    Evaluate a pair by all polygons of the surface between them, from the results of `find_facet`.

    Return True if there is an overlap, the axis (3), and the gap along the axis.
    """
    turn_normals(room)
    for k in range(SUM_COUNT):
        room[SUMS + k] = 0.0
    # Bodies of two sizes do not have the deepest point of `find_facet` in common.
    if verdict != OVERLAP or gap < -_DEEP or room[RATIO] != 1.0 or not add_surface(
            room, marks, cx, cy, cz, x, y, z):
        add_all(room, cx, cy, cz)
    if room[RATIO] != 1.0:
        add_inner(room, cx, cy, cz)
    if verdict != OVERLAP:
        length = math.sqrt(cx * cx + cy * cy + cz * cz)
        ux, uy, uz = cx / length, cy / length, cz / length
        gap = length - put_farthest(room, ux, uy, uz, 0)
    if not room[SUMS + M0] > _NOTHING:
        return False, ux, uy, uz, gap
    push(half_edge, ra, room, out)
    return True, ux, uy, uz, gap


@compiled
def lean(
    half_edge: float, ra: np.ndarray, ux: float, uy: float, uz: float, gap: float, far: float,
    x: float, y: float, z: float, out: np.ndarray
) -> None:
    """
    Write force and torque on A, energy and delta of an overlap with one apex (apex.py).

    `gap`, below 0, along the axis u, `far` both bodies' extent along it; the apex (3).
    """
    part = INNER / far
    delta = -gap * part * half_edge
    fx, fy, fz = -delta * part * ux, -delta * part * uy, -delta * part * uz
    out[0], out[1], out[2] = turn(ra, fx, fy, fz)
    x, y, z = half_edge * x, half_edge * y, half_edge * z
    out[3], out[4], out[5] = turn(ra, y * fz - z * fy, z * fx - x * fz, x * fy - y * fx)
    out[9] = 0.5 * (delta * delta)
    out[10] = delta


@compiled
def approach(
    half_edge: float, other_edge: float, dx: float, dy: float, dz: float, ra: np.ndarray,
    rb: np.ndarray, room: np.ndarray
) -> tuple[float, float, float]:
    """
    Return the second centre on the first body's axes, over its a.

    Write the matrix between their axes, and the ratio of their sizes.
    """
    room[RATIO] = other_edge / half_edge
    room[MATRIX] = ra[0, 0] * rb[0, 0] + ra[1, 0] * rb[1, 0] + ra[2, 0] * rb[2, 0]
    room[MATRIX + 1] = ra[0, 0] * rb[0, 1] + ra[1, 0] * rb[1, 1] + ra[2, 0] * rb[2, 1]
    room[MATRIX + 2] = ra[0, 0] * rb[0, 2] + ra[1, 0] * rb[1, 2] + ra[2, 0] * rb[2, 2]
    room[MATRIX + 3] = ra[0, 1] * rb[0, 0] + ra[1, 1] * rb[1, 0] + ra[2, 1] * rb[2, 0]
    room[MATRIX + 4] = ra[0, 1] * rb[0, 1] + ra[1, 1] * rb[1, 1] + ra[2, 1] * rb[2, 1]
    room[MATRIX + 5] = ra[0, 1] * rb[0, 2] + ra[1, 1] * rb[1, 2] + ra[2, 1] * rb[2, 2]
    room[MATRIX + 6] = ra[0, 2] * rb[0, 0] + ra[1, 2] * rb[1, 0] + ra[2, 2] * rb[2, 0]
    room[MATRIX + 7] = ra[0, 2] * rb[0, 1] + ra[1, 2] * rb[1, 1] + ra[2, 2] * rb[2, 1]
    room[MATRIX + 8] = ra[0, 2] * rb[0, 2] + ra[1, 2] * rb[1, 2] + ra[2, 2] * rb[2, 2]
    return turn_back(ra, dx / half_edge, dy / half_edge, dz / half_edge)


@compiled
def are_apart(
    half_edge: float, other_edge: float, xa: np.ndarray, ra: np.ndarray, xb: np.ndarray,
    rb: np.ndarray, scratch: Scratch
) -> bool:
    """
    Check that an axis with a gap exists, the first test of `touch_pair`, which returns False then.

    Bodies that are less than 1e-14 a apart may count as touching; `touch_pair` then decides by the
    volume of their overlap.
    """
    return found_gap(half_edge, other_edge, xa, ra, xb, rb, scratch) > 0.0


@compiled
def found_gap(
    half_edge: float, other_edge: float, xa: np.ndarray, ra: np.ndarray, xb: np.ndarray,
    rb: np.ndarray, scratch: Scratch
) -> float:
    """
    Return the gap [m] along the axis that was found, above 0 if the axis separates two bodies.

    Else 0 or less: minus the overlap along the facet that the line of centres leaves through.
    """
    dx, dy, dz = xb[0] - xa[0], xb[1] - xa[1], xb[2] - xa[2]
    reach_of_both = OUTER * (half_edge + other_edge)
    square = dx * dx + dy * dy + dz * dz
    if not square < reach_of_both * reach_of_both:
        return max(math.sqrt(square) - reach_of_both, half_edge * ROUNDING)
    room = borrowed(scratch.room)
    cx, cy, cz = approach(half_edge, other_edge, dx, dy, dz, borrowed(ra), borrowed(rb), room)
    if not max(abs(cx), max(abs(cy), abs(cz))) > COINCIDE:
        return -INNER * (half_edge + other_edge)
    found = find_facet(room, cx, cy, cz)
    return half_edge * (found[4] if found[0] == APART else min(found[4], 0.0))


@compiled
def push(
    half_edge: float, ra: np.ndarray, room: np.ndarray, out: np.ndarray
) -> None:
    """
    Write force and torque on A, energy, delta, contact point (from the centre of A) and area.

    By the position of B, grad delta = -4 (S_1 - (M_1 / M_0) S_0) / M_0, S_k the integral of p^k n.
    """
    mean = room[SUMS + M1] / room[SUMS + M0]
    delta = 4.0 * mean
    factor = -4.0 * delta * half_edge / room[SUMS + M0]
    out[0], out[1], out[2] = turn(
        ra, factor * (room[SUMS + S1] - mean * room[SUMS + S0]),
        factor * (room[SUMS + S1 + 1] - mean * room[SUMS + S0 + 1]),
        factor * (room[SUMS + S1 + 2] - mean * room[SUMS + S0 + 2]))
    factor *= half_edge
    out[3], out[4], out[5] = turn(
        ra, factor * (room[SUMS + T1] - mean * room[SUMS + T0]),
        factor * (room[SUMS + T1 + 1] - mean * room[SUMS + T0 + 1]),
        factor * (room[SUMS + T1 + 2] - mean * room[SUMS + T0 + 2]))
    # If one body is entirely inside the other, there is no surface between them.
    factor = half_edge / room[SUMS + P1] if room[SUMS + P1] > 0.0 else 0.0
    out[15], out[16], out[17] = turn(
        ra, factor * room[SUMS + X1], factor * room[SUMS + X1 + 1], factor * room[SUMS + X1 + 2])
    square = half_edge * half_edge
    out[18] = square * square * (
        room[SUMS + S0] * room[SUMS + S0] + room[SUMS + S0 + 1] * room[SUMS + S0 + 1]
        + room[SUMS + S0 + 2] * room[SUMS + S0 + 2])
    delta *= half_edge
    out[9] = 0.5 * (delta * delta)
    out[10] = delta


@compiled
def touch_plane(
    half_edge: float, normal: np.ndarray, offset: float, xa: np.ndarray, ra: np.ndarray,
    scratch: Scratch, out: np.ndarray
) -> bool:
    """
    Evaluate a shell and a rigid plane, whose free side is normal . x >= offset.

    `normal` (3,) of length 1, `offset` [m]. Results as `touch_pair`. The torque out[6:9] is 0; the
    axis leads from the shell into the plane, and the overlap along it is exact. The contact point
    is relative to the centre of the shell.
    """
    return meet_plane(half_edge, borrowed(normal), offset, borrowed(xa), borrowed(ra),
                      borrowed(scratch.room), borrowed(out))


@compiled
def meet_plane(
    half_edge: float, normal: np.ndarray, offset: float, xa: np.ndarray, ra: np.ndarray,
    room: np.ndarray, out: np.ndarray
) -> bool:
    """Evaluate a shell and a plane as `touch_plane`, with uncounted arrays."""
    for k in range(OUT_SIZE):
        out[k] = 0.0
    out[12], out[13], out[14] = -normal[0], -normal[1], -normal[2]
    height = (normal[0] * xa[0] + normal[1] * xa[1] + normal[2] * xa[2] - offset) / half_edge
    if not height < OUTER:
        return False
    nx, ny, nz = turn_back(ra, normal[0], normal[1], normal[2])
    far = reach(nx, ny, nz)
    overlap = far - height
    if not overlap > 0.0:
        return False
    out[11] = overlap * half_edge
    vertex = farthest_vertex(-nx, -ny, -nz)
    # At this fraction the depths below the plane and below the faces at the vertex are equal.
    part = (INNER + height) / (INNER + far)
    found, px, py, pz, square = cone(room, vertex, -nx, -ny, -nz, overlap, part)
    if found:
        x, y, z = (part * VERTICES[vertex, 0], part * VERTICES[vertex, 1],
                   part * VERTICES[vertex, 2])
        lean(half_edge, ra, -nx, -ny, -nz, -overlap, INNER + far, x, y, z, out)
        out[15], out[16], out[17] = turn(ra, half_edge * px, half_edge * py, half_edge * pz)
        out[18] = (half_edge * half_edge) ** 2 * square
        return True
    for k in range(SUM_COUNT):
        room[SUMS + k] = 0.0
    add_plane(room, nx, ny, nz, -height)
    if not room[SUMS + M0] > _NOTHING:
        out[11] = 0.0
        return False
    push(half_edge, ra, room, out)
    return True
