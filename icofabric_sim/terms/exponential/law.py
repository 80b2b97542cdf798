# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Tension, slope and energy of connectors of a block, with x = alpha (l - D).

    tension k/alpha (e^x - 1),    slope k e^x,    energy k/alpha^2 (e^x - 1 - x)

All three use one evaluation of e^x - 1 and e^x - 1 - x, without cancellation near x = 0. Energies
are exact integrals of tensions up to rounding.
"""

import math

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import (
    fabs,
    fma,
    lane,
    load,
    rsqrt,
    splat,
    Vector,
    where,
)
from icofabric_sim.terms.exponential.record import Exponential
from icofabric_sim.terms.shared import Variety

# Beyond this |x| numbers overflow: e^x is taken there as e^700, and the run stops.
_MAX_EXPONENT = 700.0
# Adding and subtracting this number rounds to integers.
_ROUNDING = 1.5 * 2.0**52
# ln 2 in two parts, whose first has 21 zero bits at its end.
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_BITS = (512.0, 256.0, 128.0, 64.0, 32.0, 16.0, 8.0, 4.0, 2.0, 1.0)
_COEFFICIENTS = tuple(1.0 / math.factorial(n) for n in range(13, 1, -1))
_FIRST = 1.0 / math.factorial(14)


@compiled
def power_of_two(number: Vector) -> Vector:
    """Return 2^number of integers of magnitude up to 1023."""
    zero, scale, left = splat(0.0), splat(1.0), fabs(number)
    for bit in _BITS:
        factor = where(number < zero, splat(2.0**-bit), splat(2.0**bit))
        taken = left > splat(bit - 0.5)
        scale = where(taken, scale * factor, scale)
        left = where(taken, left - splat(bit), left)
    return scale


@compiled
def growth(x: Vector) -> tuple[Vector, Vector]:
    """
    Return e^x - 1 and e^x - 1 - x.

    With n = round(x / ln 2) and r = x - n ln 2, e^x = 2^n e^r, and the series of e^r - 1 - r ends
    at r^14 / 14! < 2^-56 r^2.
    """
    most = splat(_MAX_EXPONENT)
    x = where(x > most, most, where(x < splat(-_MAX_EXPONENT), splat(-_MAX_EXPONENT), x))
    number = (x * splat(1.0 / math.log(2.0)) + splat(_ROUNDING)) - splat(_ROUNDING)
    r = fma(number, splat(-_LN2_LOW), fma(number, splat(-_LN2_HIGH), x))
    series = splat(_FIRST)
    for coefficient in _COEFFICIENTS:
        series = fma(series, r, splat(coefficient))
    rest = r * r * series
    scale = power_of_two(number)
    grown = fma(scale, r + rest, scale - splat(1.0))
    return grown, where(fabs(number) < splat(0.5), rest, grown - x)


@compiled
def replace_factor(
    exponential: Exponential | None, variety: Variety, link: int, s: int, square: Vector,
    factor: Vector
) -> Vector:
    """Return tension over length [N/m]."""
    if exponential is None:
        return factor
    else:
        inverse = rsqrt(square)
        alpha, k, x = stretched(exponential, variety, link, s, square * inverse)
        grown, _ = growth(x)
        return where(fabs(alpha) > splat(0.0), k * grown * inverse, factor)


@compiled
def stretched(
    exponential: Exponential, variety: Variety, link: int, s: int, length: Vector
) -> tuple[Vector, Vector, Vector]:
    """Return alpha [1/m], k/alpha [N] and x = alpha (l - D); x is 0 by other laws."""
    alpha = load(exponential.alpha, link, s)
    k = load(variety.extension, link, s) / where(
        fabs(alpha) > splat(0.0), alpha, splat(1.0))
    return alpha, k, alpha * (length - load(variety.natural_length, link, s))


@compiled
def replace_pull(
    exponential: Exponential | None, variety: Variety, link: int, s: int, length: Vector,
    pull: Vector
) -> Vector:
    """Return the tension [N]."""
    if exponential is None:
        return pull
    else:
        alpha, k, x = stretched(exponential, variety, link, s, length)
        grown, _ = growth(x)
        return where(fabs(alpha) > splat(0.0), k * grown, pull)


@compiled
def replace_slope(
    exponential: Exponential | None, variety: Variety, link: int, s: int, length: Vector,
    slope: Vector
) -> Vector:
    """Return the slope of the tension [N/m]."""
    if exponential is None:
        return slope
    else:
        alpha, k, x = stretched(exponential, variety, link, s, length)
        grown, _ = growth(x)
        return where(fabs(alpha) > splat(0.0), alpha * k * (grown + splat(1.0)), slope)


@compiled
def replace_largest_slope(
    exponential: Exponential | None, variety: Variety, link: int, s: int, length: Vector,
    slope: Vector
) -> Vector:
    """Return the slope [N/m] at the present length; health checks follow its growth."""
    return replace_slope(exponential, variety, link, s, length, slope)


@compiled
def replace_energy(
    exponential: Exponential | None, variety: Variety, link: int, s: int, length: Vector,
    energy: Vector
) -> Vector:
    """Return the energy [J]."""
    if exponential is None:
        return energy
    else:
        alpha, k, x = stretched(exponential, variety, link, s, length)
        _, rest = growth(x)
        there = fabs(alpha) > splat(0.0)
        return where(there, k / where(there, alpha, splat(1.0)) * rest, energy)


@compiled
def replace_alone(
    exponential: Exponential | None, variety: Variety, link: int, s: int, length: float,
    law: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Return tension [N], energy [J] and slope [N/m] of one connector."""
    if exponential is None:
        return law
    else:
        alpha, k = exponential.alpha[link, s], variety.extension[link, s]
        if alpha == 0.0:
            return law
        grown, rest = growth(splat(alpha * (length - variety.natural_length[link, s])))
        return (
            k / alpha * lane(grown, 0), k / alpha**2 * lane(rest, 0), k * (lane(grown, 0) + 1.0))
