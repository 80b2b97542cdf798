# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Anchors for Warp: the tension and the motion of one anchor."""

from importlib import import_module
from typing import Any

wp: Any = import_module('warp')

_ZERO_F64, _TWO, _THREE = (wp.constant(wp.float64(x)) for x in (0.0, 2.0, 3.0))
# Lower bound of squared lengths [m^2], where a force has no direction.
_MIN_SQUARE = wp.constant(wp.float64(1e-300))


@wp.func
def point_at(
    start: wp.vec3d, first: wp.vec3d, second: wp.vec3d, third: wp.vec3d, t: wp.float64
):
    """Return position [m] and velocity [m/s] of the point of an anchor, as force.py."""
    return start + t * (first + t * (second + t * third)), first + t * (
        _TWO * second + t * (_THREE * third))


@wp.func
def pull_along(
    u: wp.vec3d, extension: wp.float64, compression: wp.float64, natural_length: wp.float64
):
    """Return the force [N] of an anchor along `u` [m] from its body (eqs 1 and 2)."""
    length = wp.sqrt(wp.max(wp.dot(u, u), _MIN_SQUARE))
    stretch = length - natural_length
    tension = compression * stretch
    if stretch > _ZERO_F64:
        tension = extension * stretch
    return (tension / length) * u
