# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Twisting for Warp: the torque of one connector on one of its bodies."""

from importlib import import_module
from typing import Any

wp: Any = import_module('warp')

_HALF = wp.constant(wp.float64(0.5))


@wp.func
def torque_of(kappa: wp.float64, own: wp.mat33d, other: wp.mat33d):
    """Return the torque [N m] between bodies with these axes, exactly opposite at the other."""
    total = wp.cross(own[0], other[0]) + wp.cross(own[1], other[1])
    total = total + wp.cross(own[2], other[2])
    return _HALF * kappa * total
