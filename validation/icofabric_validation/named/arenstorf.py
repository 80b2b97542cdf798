# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A satellite on a closed orbit between earth and moon, in rotating axes."""

from collections.abc import Iterator
import math

from icofabric_validation.named.free_bodies import yield_refined_curves
from icofabric_validation.named.problem import Curve, Problem
import numpy as np

# Mass of the moon over the total mass, and the orbit of eqs (0.1) and (0.2) of the source.
_MOON = 0.012277471
_EARTH = 1.0 - _MOON
_START = np.array([[0.994, 0.0, 0.0]])
_VELOCITY = np.array([[0.0, -2.00158510637908252240537862224, 0.0]])
_PERIOD = 17.0652165601579625588917206249


def _acceleration(time: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    (px, py, _), (vx, vy, _) = x[0].tolist(), v[0].tolist()
    earth = _EARTH / math.hypot(px + _MOON, py) ** 3
    moon = _MOON / math.hypot(px - _EARTH, py) ** 3
    return np.array([[
        px + 2.0 * vy - earth * (px + _MOON) - moon * (px - _EARTH),
        py - 2.0 * vx - (earth + moon) * py,
        0.0]])


def _solve(long: bool) -> Iterator[Curve]:
    yield from yield_refined_curves(
        _acceleration, _START, _VELOCITY, _PERIOD, _START,
        tolerances=(1e-4, 1e-6, 1e-8, 1e-10, 1e-12),
        steps=tuple(_PERIOD / n for n in (8192, 12288) + ((16384, 32768) if long else ())),
        allowed=1e-9, allowed_given=1e-4, floor=3e-11)


PROBLEM = Problem(
    'arenstorf', 'a satellite on a closed orbit between earth and moon, in rotating axes',
    'Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, (II.0.1), (II.0.2)',
    'distance from the start after one period', _solve, has_long_form=True)
