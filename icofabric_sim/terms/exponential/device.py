# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The law for Warp, by connectors at each body: row `at` of `values` holds alpha [1/m].
"""

from importlib import import_module
from typing import Any

wp: Any = import_module('warp')

_ZERO_F64, _HALF, _TWO = (wp.constant(wp.float64(x)) for x in (0.0, 0.5, 2.0))


@wp.func
def replace_pull(
    values: wp.array(dtype=wp.float64), at: int, k: wp.float64, rest: wp.float64,
    length: wp.float64, pull: wp.float64
):
    """Return the tension [N]: e^x - 1 = 2 sinh(x/2) e^(x/2), without cancellation."""
    alpha = values[at]
    if alpha == _ZERO_F64:
        return pull
    half = _HALF * alpha * (length - rest)
    return k / alpha * (_TWO * wp.sinh(half) * wp.exp(half))


@wp.func
def replace_slope(
    values: wp.array(dtype=wp.float64), at: int, k: wp.float64, rest: wp.float64,
    length: wp.float64, slope: wp.float64
):
    """Return the slope of the tension [N/m]."""
    alpha = values[at]
    if alpha == _ZERO_F64:
        return slope
    return k * wp.exp(alpha * (length - rest))


@wp.func
def replace_energy(
    values: wp.array(dtype=wp.float64), at: int, k: wp.float64, rest: wp.float64,
    length: wp.float64, energy: wp.float64
):
    """Return the energy [J], by the integral of the tension where e^x - 1 - x would cancel."""
    alpha = values[at]
    if alpha == _ZERO_F64:
        return energy
    x = alpha * (length - rest)
    if wp.abs(x) < _HALF:
        total, part = wp.float64(0.5), wp.float64(0.5)
        for n in range(3, 19):
            part = part * x / wp.float64(n)
            total = total + part
        return k / (alpha * alpha) * (x * x * total)
    half = _HALF * x
    return k / (alpha * alpha) * (_TWO * wp.sinh(half) * wp.exp(half) - x)
