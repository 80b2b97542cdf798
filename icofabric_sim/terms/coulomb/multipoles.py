# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Derivatives of f = 1 / r by the vector from one body to another, contracted with vectors.

A charge q has the potential q f, a dipole p the potential -p . grad f. So the energy of two bodies
over 1 / (4 pi eps_0) is q q' f - q p' . grad f + q' p . grad f - p p' : grad grad f. With the
direction n, the derivatives have the norms k! / r^(k + 1).
"""

from icofabric_sim.kernels.rotations import Three, to_world, turn_to_world
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    fma,
    load,
    maximum,
    rsqrt,
    splat,
    Vector,
    where,
)
from icofabric_sim.terms.shared import SMALLEST_SQUARE
import numpy as np


@compiled
def dot(a: Three, b: Three) -> Vector:
    """Return the scalar product."""
    return fma(a[0], b[0], fma(a[1], b[1], a[2] * b[2]))


@compiled
def cross(a: Three, b: Three) -> Three:
    """Return the vector product."""
    return (
        a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@compiled
def scaled(factor: Vector, a: Three) -> Three:
    """Return a vector times a factor."""
    return factor * a[0], factor * a[1], factor * a[2]


@compiled
def plus(factor: Vector, a: Three, b: Three) -> Three:
    """Return a vector times a factor, plus another vector."""
    return fma(factor, a[0], b[0]), fma(factor, a[1], b[1]), fma(factor, a[2], b[2])


@compiled
def second_derivative(a: Three, n: Three, inverse: Vector) -> Three:
    """Return (3 (a . n) n - a) / r^3."""
    cube = inverse * inverse * inverse
    return scaled(cube, plus(splat(3.0) * dot(a, n), n, scaled(splat(-1.0), a)))


@compiled
def third_derivative(a: Three, b: Three, n: Three, inverse: Vector) -> Three:
    """Return 3 ((a . b) n + (a . n) b + (b . n) a - 5 (a . n) (b . n) n) / r^4."""
    square, an, bn = inverse * inverse, dot(a, n), dot(b, n)
    along = dot(a, b) - splat(5.0) * an * bn
    return scaled(splat(3.0) * square * square, plus(along, n, plus(an, b, scaled(bn, a))))


@compiled
def fourth_derivative(a: Three, b: Three, c: Three, n: Three, inverse: Vector) -> Three:
    """Return the fourth derivatives times three vectors."""
    square, five = inverse * inverse, splat(5.0)
    an, bn, cn = dot(a, n), dot(b, n), dot(c, n)
    ab, ac, bc = dot(a, b), dot(a, c), dot(b, c)
    along = splat(35.0) * an * bn * cn - five * (ab * cn + ac * bn + bc * an)
    total = plus(along, n, plus(ab - five * an * bn, c, plus(
        ac - five * an * cn, b, scaled(bc - five * bn * cn, a))))
    return scaled(splat(3.0) * square * square * inverse, total)


@compiled
def moments_of(moment: np.ndarray, orientation: np.ndarray, s: int) -> Three:
    """Return the dipoles of a block in world components."""
    return turn_to_world(
        orientation, s, load(moment, 0, s), load(moment, 1, s), load(moment, 2, s))


@compiled
def moment_at(moment: np.ndarray, orientation: np.ndarray, j: int) -> Three:
    """Return the dipole of the body in slot j in world components, in all lanes."""
    x, y, z = to_world(orientation, j, moment[0, j], moment[1, j], moment[2, j])
    return splat(x), splat(y), splat(z)


@compiled
def direction_from(position: np.ndarray, j: int, s: int) -> tuple[Three, Vector]:
    """
    Return the directions of a block from the body in slot j, and one over the distances [1/m].

    Both are 0 where the distance is.
    """
    smallest = splat(SMALLEST_SQUARE)
    ux, uy = load(position, 0, s) - splat(position[0, j]), load(position, 1, s) - splat(
        position[1, j])
    uz = load(position, 2, s) - splat(position[2, j])
    square = fma(ux, ux, fma(uy, uy, uz * uz))
    inverse = where(square > smallest, rsqrt(maximum(square, smallest)), splat(0.0))
    return scaled(inverse, (ux, uy, uz)), inverse
