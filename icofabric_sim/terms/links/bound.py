# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Bounds of the frequencies of connectors, and their energies and tensions from the same loop."""

import math
from typing import Any

from icofabric_sim.kernels.runtime.compiled import compiled, inlined
from icofabric_sim.kernels.runtime.lanes import (
    any_lane,
    bits,
    fabs,
    fma,
    load,
    load_at,
    maximum,
    rsqrt,
    splat,
    sqrt,
    Vector,
    where,
)
from icofabric_sim.terms.laws import Laws, replace_energy, replace_largest_slope, replace_pull
from icofabric_sim.terms.links.force import arm_of, slope_of
from icofabric_sim.terms.shared import Links, Six, SMALLEST_SQUARE, Variety
import numpy as np

Block = tuple[Six, Six, Six, Six, Six, Six]


@compiled
def add_limited_bound(
    links: Links | None, inverse_mass: float, inverse_inertia: float, points: np.ndarray,
    position: np.ndarray, block: int, s: int, limit: Vector
) -> tuple[Vector, Vector, Vector]:
    """
    Return the bound of the squared frequency [1/s^2], energy and tension for bodies of a block.

    The second variation of a connector's energy for small motions (dx, dtheta) of its two bodies
    is k (n.du)^2 + f/l |P du|^2 + moments of f, with du = du_2 - du_1 and
    du_i = dx_i + dtheta_i x s_i. From (x - y)^2 <= 2 x^2 + 2 y^2 it is at most the sum over both
    ends of 2 k (n.du_i)^2 + 2 max(f/l, 0) |du_i|^2 + |f| |s| |dtheta_i|^2, a block-diagonal form:
    its largest eigenvalue, in mass-scaled coordinates, bounds that of the fabric.

    The trace of its first part is at most 2 k (1/m + s^2/Lambda) for each connector. If the trace
    proves that the bound is at most the `limit` [1/s^2], the trace is the bound; else see
    `stiffest_direction`. Half of each connector's energy [J] and of the magnitude of its tension
    [N] counts for either end.
    """
    zero = splat(0.0)
    energy = zero
    if links is None:
        return zero, energy, zero
    else:
        stride = position.shape[1]
        square = links.half_width ** 2
        stiffness, minus_rest = splat(links.stiffness), splat(-links.natural_length)
        # |du_i|^2 <= (|dx| + |s| |dtheta|)^2 <= (1/m + s^2/Lambda) |y|^2 by Cauchy and Schwarz,
        # y mass-scaled.
        spread = splat(inverse_mass + square * inverse_inertia)
        moment = splat(links.half_width * inverse_inertia)
        tension, pulls, trace = zero, zero, zero
        for edge in range(6):
            at = 3 * edge * stride + s
            px, py = load_at(points, at), load_at(points, at + stride)
            pz = load_at(points, at + 2 * stride)
            for link in range(2 * edge, 2 * edge + 2):
                place = links.place[block, link]
                there = bits(links.present[block, link])
                ux = load_at(points, place) - px
                uy = load_at(points, place + stride) - py
                uz = load_at(points, place + 2 * stride) - pz
                squared = maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(SMALLEST_SQUARE))
                inverse = where(there, rsqrt(squared), zero)
                stretch, pull, slope = bound_parts(
                    links.variety, link, s, squared, inverse, stiffness, minus_rest)
                length = squared * inverse
                pull = replace_pull(links.laws, links.variety, link, s, length, pull)
                slope = replace_largest_slope(
                    links.laws, links.variety, link, s, length, slope)
                stretch, pull = where(there, stretch, zero), where(there, pull, zero)
                energy = stored_part(
                    links.laws, links.variety, link, s, there, length, stretch, pull, energy)
                tension = fma(maximum(pull, zero), inverse, tension)
                pulls = pulls + fabs(pull)
                trace = trace + where(there, slope, zero)
        # With individual laws the stiffnesses are in the sums.
        twice = splat(2.0 * links.stiffness if links.variety is None else 2.0)
        rest = fma(spread + spread, tension, moment * pulls)
        bound = fma(twice * spread, trace, rest)
        if any_lane(bound > limit):
            bound = fma(twice, stiffest_direction(
                links, inverse_mass, inverse_inertia, points, position, block, s), rest)
        share = 0.25 * links.stiffness if links.variety is None else 0.25
        return bound, energy * splat(share), splat(0.5) * pulls


@compiled
def stiffest_direction(
    links: Links, inverse_mass: float, inverse_inertia: float, points: np.ndarray,
    position: np.ndarray, block: int, s: int
) -> Vector:
    """
    Return a bound of the largest eigenvalue of the sum of k (n.du)^2 of each body's connectors.

    In mass-scaled coordinates, divided by the stiffness if all connectors share it. Each 6 x 6
    block is bounded by the largest absolute row sum of its square. In the woven rest state the
    bound is close, because neighbours that move against each other make (x - y)^2 = 2 x^2 + 2 y^2.
    """
    zero = splat(0.0)
    root_m, root_i = math.sqrt(inverse_mass), math.sqrt(inverse_inertia)
    stride = position.shape[1]
    stiffness, minus_rest = splat(links.stiffness), splat(-links.natural_length)
    b00, b01, b02, b03, b04, b05 = zero, zero, zero, zero, zero, zero
    b11, b12, b13, b14, b15, b22 = zero, zero, zero, zero, zero, zero
    b23, b24, b25, b33, b34, b35 = zero, zero, zero, zero, zero, zero
    b44, b45, b55 = zero, zero, zero
    for edge in range(6):
        at = 3 * edge * stride + s
        px, py = load_at(points, at), load_at(points, at + stride)
        pz = load_at(points, at + 2 * stride)
        sx, sy, sz = arm_of(links.attachment, points, position, edge, s)
        sx, sy, sz = sx * splat(root_i), sy * splat(root_i), sz * splat(root_i)
        for link in range(2 * edge, 2 * edge + 2):
            place = links.place[block, link]
            there = bits(links.present[block, link])
            ux = load_at(points, place) - px
            uy = load_at(points, place + stride) - py
            uz = load_at(points, place + 2 * stride) - pz
            squared = maximum(fma(ux, ux, fma(uy, uy, uz * uz)), splat(SMALLEST_SQUARE))
            inverse = where(there, rsqrt(squared), zero)
            _, _, slope = bound_parts(
                links.variety, link, s, squared, inverse, stiffness, minus_rest)
            slope = replace_largest_slope(
                links.laws, links.variety, link, s, squared * inverse, slope)
            weight = inverse * root_of(links.variety, slope)
            nx, ny, nz = ux * weight, uy * weight, uz * weight
            r0, r1, r2 = nx * splat(root_m), ny * splat(root_m), nz * splat(root_m)
            r3, r4, r5 = sy * nz - sz * ny, sz * nx - sx * nz, sx * ny - sy * nx
            b00, b01, b02 = fma(r0, r0, b00), fma(r0, r1, b01), fma(r0, r2, b02)
            b03, b04, b05 = fma(r0, r3, b03), fma(r0, r4, b04), fma(r0, r5, b05)
            b11, b12, b13 = fma(r1, r1, b11), fma(r1, r2, b12), fma(r1, r3, b13)
            b14, b15, b22 = fma(r1, r4, b14), fma(r1, r5, b15), fma(r2, r2, b22)
            b23, b24, b25 = fma(r2, r3, b23), fma(r2, r4, b24), fma(r2, r5, b25)
            b33, b34, b35 = fma(r3, r3, b33), fma(r3, r4, b34), fma(r3, r5, b35)
            b44, b45, b55 = fma(r4, r4, b44), fma(r4, r5, b45), fma(r5, r5, b55)
    return largest_of_block((
        (b00, b01, b02, b03, b04, b05), (b01, b11, b12, b13, b14, b15),
        (b02, b12, b22, b23, b24, b25), (b03, b13, b23, b33, b34, b35),
        (b04, b14, b24, b34, b44, b45), (b05, b15, b25, b35, b45, b55)))


@inlined
def largest_of_block(rows: Block) -> Vector:
    """
    Return a bound of the largest eigenvalue of a symmetric block B: the root of that of B B.

    A largest absolute row sum bounds every eigenvalue. The bound from the square is closer because
    the other eigenvalues count less: 1.1 instead of 1.2 times the largest in a moving fabric.
    """
    # No loop over these tuples, because each access would need a jump.
    first, second, third, fourth, fifth, sixth = rows
    scale = maximum(maximum(first[0], second[1]), maximum(third[2], fourth[3]))
    scale = maximum(scale, maximum(fifth[4], sixth[5]))
    # Entries are divided by the largest on the diagonal, so that their squares stay finite.
    inverse = splat(1.0) / maximum(scale, splat(SMALLEST_SQUARE))
    first, second, third = times(first, inverse), times(second, inverse), times(third, inverse)
    fourth, fifth, sixth = times(fourth, inverse), times(fifth, inverse), times(sixth, inverse)
    e01, e02, e03 = along(first, second), along(first, third), along(first, fourth)
    e04, e05, e12 = along(first, fifth), along(first, sixth), along(second, third)
    e13, e14, e15 = along(second, fourth), along(second, fifth), along(second, sixth)
    e23, e24, e25 = along(third, fourth), along(third, fifth), along(third, sixth)
    e34, e35, e45 = along(fourth, fifth), along(fourth, sixth), along(fifth, sixth)
    most = maximum(
        along(first, first) + e01 + e02 + e03 + e04 + e05,
        e01 + along(second, second) + e12 + e13 + e14 + e15)
    most = maximum(most, e02 + e12 + along(third, third) + e23 + e24 + e25)
    most = maximum(most, e03 + e13 + e23 + along(fourth, fourth) + e34 + e35)
    most = maximum(most, e04 + e14 + e24 + e34 + along(fifth, fifth) + e45)
    most = maximum(most, e05 + e15 + e25 + e35 + e45 + along(sixth, sixth))
    return scale * sqrt(most)


@inlined
def times(row: Six, factor: Vector) -> Six:
    """Multiply a row by a factor."""
    return (
        row[0] * factor, row[1] * factor, row[2] * factor, row[3] * factor, row[4] * factor,
        row[5] * factor)


@inlined
def along(first: Six, second: Six) -> Vector:
    """Return the magnitude of the scalar product of two rows."""
    value = fma(first[2], second[2], fma(first[1], second[1], first[0] * second[0]))
    return fabs(fma(first[5], second[5], fma(first[4], second[4], fma(
        first[3], second[3], value))))


@compiled
def bound_parts(
    variety: Variety | None, link: int, s: int, squared: Vector, inverse: Vector,
    stiffness: Vector, minus_rest: Vector
) -> tuple[Vector, Vector, Vector]:
    """
    Return stretch [m], tension [N] and largest slope [N/m] of a connector, 1 if all are alike.

    The larger of k_e and k_c counts: a connector may switch from one to the other between checks.
    """
    if variety is None:
        stretch = fma(squared, inverse, minus_rest)
        return stretch, stiffness * stretch, splat(1.0)
    else:
        k, rest = slope_of(variety, link, s, squared)
        stretch = squared * inverse - rest
        most = maximum(load(variety.extension, link, s), load(variety.compression, link, s))
        return stretch, k * stretch, most


@compiled
def root_of(variety: Variety | None, slope: Vector) -> Vector:
    """Return the square root of a slope, which is 1 if all connectors are alike."""
    if variety is None:
        return slope
    else:
        return sqrt(slope)


@compiled
def stored_part(
    laws: Laws | None, variety: Variety | None, link: int, s: int, there: Any,
    length: Vector, stretch: Vector, pull: Vector, energy: Vector
) -> Vector:
    """Add the energy of a connector by its law, up to a common factor."""
    if laws is None:
        return energy_part(variety, stretch, pull, energy)
    else:
        double = replace_energy(laws, variety, link, s, length, splat(0.5) * (stretch * pull))
        return energy + where(there, double + double, splat(0.0))


@compiled
def energy_part(
    variety: Variety | None, stretch: Vector, pull: Vector, energy: Vector
) -> Vector:
    """Add the energy of a connector, up to a common factor."""
    if variety is None:
        return fma(stretch, stretch, energy)
    else:
        return fma(stretch, pull, energy)
