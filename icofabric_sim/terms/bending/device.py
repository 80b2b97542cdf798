# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Bending for Warp: the wrench of one connector on one of its bodies."""

from importlib import import_module
from typing import Any

wp: Any = import_module('warp')

_ONE = wp.constant(wp.float64(1.0))
# Lower bound of squared lengths [m^2], where a force has no direction.
_MIN_SQUARE = wp.constant(wp.float64(1e-300))


@wp.func
def wrench_of(
    kappa: wp.float64, u: wp.vec3d, arm: wp.vec3d, own: wp.vec3d, other: wp.vec3d
):
    """
    Return force [N] and torque [N m] by a connector along `u` [m], as force.py.

    `own` and `other` are its woven directions in the bodies at both ends, world frame.
    """
    force, torque = wp.vec3d(), wp.vec3d()
    square = wp.dot(u, u)
    if square > _MIN_SQUARE:
        inverse = _ONE / wp.sqrt(square)
        d = u * inverse
        n = own - d
        m = n + (other - d)
        factor = kappa * inverse
        force = factor * (wp.dot(m, d) * d - m)
        torque = kappa * wp.cross(n, d) + wp.cross(arm, force)
    return force, torque
