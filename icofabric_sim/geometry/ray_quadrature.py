# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Integrals of a density along rays from the centre, split at its discontinuities.

A point of a ray is x = (1 - s) y, where y lies on the outer surface and s is the depth as a
fraction of the distance to the centre: lambda1 of eq 34 is 1 - s. Depth keeps full precision for
thin shells. Intervals are halved where the rule and its two halves disagree. At every second
level the interval is split at its steepest point instead, found by bisection to machine
precision, so that a jump falls between two intervals.
"""

from typing import Callable, Final

import numpy as np

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)
_NODES, _WEIGHTS = (1.0 + _NODES) / 2.0, _WEIGHTS / 2.0
# Samples this far inside the ends of an interval, relative to its length, catch a jump that lies
# between an end and the first node.
_INSET: Final = 1e-6
# Weights that extrapolate the values at the nodes to the two ends.
_TO_ENDS: Final = np.linalg.solve(
    np.vander(_NODES, increasing=True).T,
    np.vander([_INSET, 1.0 - _INSET], _NODES.size, increasing=True).T).T
_RULE_TOLERANCE: Final = 1e-12
_DEPTH_LIMIT: Final = 30
_BISECTIONS: Final = 50
_POINTS_PER_CALL: Final = 200_000


class DensityProbe:
    """The user's density with checks, a count, the largest value and a note of jumps."""

    def __init__(
            self, density: Callable[[np.ndarray], np.ndarray], half_edge: float,
            evaluation_limit: int) -> None:
        self._density = density
        self._half_edge = half_edge
        self._limit = evaluation_limit
        self.count = 0
        self.largest = 0.0
        self.jump_seen = False

    @property
    def exhausted(self) -> bool:
        return self.count >= self._limit

    def sample(self, ends: np.ndarray, depths: np.ndarray) -> np.ndarray:
        """Return the density [kg/m^3], (i, n), on rays that end at (i, 3) at the depths (i, n)."""
        values = np.empty(depths.shape)
        step = max(1, _POINTS_PER_CALL // depths.shape[1])
        for start in range(0, depths.shape[0], step):
            part = slice(start, start + step)
            points = self._half_edge * (
                (1.0 - depths[part])[:, :, None] * ends[part][:, None, :])
            values[part] = self._checked(points.reshape(-1, 3)).reshape(depths[part].shape)
        return values

    def _checked(self, points: np.ndarray) -> np.ndarray:
        values = np.asarray(self._density(points), dtype=np.float64)
        if values.shape not in ((), (points.shape[0],)):
            raise ValueError(
                f'the density function must return ({points.shape[0]},) values in kg/m^3 for '
                f'({points.shape[0]}, 3) points, got shape {values.shape}')
        values = np.broadcast_to(values, points.shape[:1])
        bad = ~((values >= 0.0) & (values < np.inf))
        if bad.any():
            first = int(np.argmax(bad))
            raise ValueError(
                'the density function must return finite values that are not negative, got '
                f'{float(values[first])!r} kg/m^3 at {points[first].tolist()} m')
        self.count += values.size
        self.largest = max(self.largest, float(values.max()))
        return values


def integrate_rays(
        probe: DensityProbe, ends: np.ndarray, depths: np.ndarray,
        tolerance: float, *, panels: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """
    Integrate density times (1 - s)^2, (1 - s)^3 and (1 - s)^4 over the depth s on each ray.

    Parameters
    ----------
    probe
        The density.
    ends
        Where the rays meet the outer surface, in units of a, (r, 3).
    depths
        Increasing; the integrals run from the first to the last. Discontinuities are expected
        at the interior depths.
    tolerance
        Largest error due to a jump next to an end, relative to the largest possible integral.
    panels
        Intervals to start with between two depths.

    Returns
    -------
    Integrals, (r, 3), and their estimated errors, (r,) [kg/m^3].
    """
    grid = np.concatenate([
        np.linspace(low, high, panels + 1)[:-1] for low, high in zip(depths[:-1], depths[1:])]
        + [depths[-1:]])
    ray = np.repeat(np.arange(ends.shape[0]), grid.size - 1)
    low, high = (np.tile(part, ends.shape[0]) for part in (grid[:-1], grid[1:]))
    span = float(depths[-1] - depths[0])
    integrals, errors = np.zeros((ends.shape[0], 3)), np.zeros(ends.shape[0])
    whole = _apply_rule(probe, ends[ray], low, high)[1]
    for depth in range(_DEPTH_LIMIT + 1):
        middle = 0.5 * (low + high)
        left_values, left = _apply_rule(probe, ends[ray], low, middle)
        right_values, right = _apply_rule(probe, ends[ray], middle, high)
        inset = _INSET * (middle - low)
        at_ends = np.stack([low + inset, middle - inset, middle + inset, high - inset], axis=1)
        end_values = probe.sample(ends[ray], at_ends)
        surprise = np.abs(np.concatenate(
            [left_values @ _TO_ENDS.T, right_values @ _TO_ENDS.T], axis=1) - end_values)
        hidden = surprise.max(axis=1) * _NODES[0] * (middle - low)
        difference = np.abs(left + right - whole).max(axis=1)
        scale = probe.largest * span
        good = (difference <= _RULE_TOLERANCE * scale) & (hidden <= tolerance * scale)
        if depth == _DEPTH_LIMIT or probe.exhausted:
            good[:] = True
        np.add.at(integrals, ray[good], (left + right)[good])
        np.add.at(errors, ray[good], np.maximum(
            difference, np.where(hidden > tolerance * scale, hidden, 0.0))[good])
        if good.all():
            break
        bad = ~good
        ray, low, middle, high = ray[bad], low[bad], middle[bad], high[bad]
        if depth % 2 == 0:
            whole = np.concatenate([left[bad], right[bad]])
        else:
            middle = _steepest_place(probe, ends[ray], low, high, np.concatenate(
                [end_values[bad, :1], left_values[bad], end_values[bad, 1:3],
                 right_values[bad], end_values[bad, 3:]], axis=1))
            whole = np.concatenate([
                _apply_rule(probe, ends[ray], low, middle)[1],
                _apply_rule(probe, ends[ray], middle, high)[1]])
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
        ray = np.concatenate([ray, ray])
    return integrals, errors


# Where the samples of one interval lie, in shares of it.
_PLACES: Final = np.concatenate([
    [_INSET / 2.0], _NODES / 2.0, [0.5 - _INSET / 2.0, 0.5 + _INSET / 2.0], 0.5 + _NODES / 2.0,
    [1.0 - _INSET / 2.0]])


def _apply_rule(
        probe: DensityProbe, ends: np.ndarray, low: np.ndarray,
        high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the densities at the nodes, (i, 6), and the three integrals, (i, 3)."""
    length = (high - low)[:, None]
    depths = low[:, None] + length * _NODES
    values = probe.sample(ends, depths)
    terms = values * _WEIGHTS * length * (1.0 - depths) ** 2
    radius = 1.0 - depths
    return values, np.stack([
        terms.sum(axis=1), (terms * radius).sum(axis=1), (terms * radius ** 2).sum(axis=1)],
        axis=1)


def _steepest_place(
        probe: DensityProbe, ends: np.ndarray, low: np.ndarray, high: np.ndarray,
        values: np.ndarray) -> np.ndarray:
    """Return a depth in each interval, (i,), found by bisection towards the larger difference."""
    probe.jump_seen = True
    index = np.argmax(np.abs(np.diff(values, axis=1)), axis=1)
    row = np.arange(index.size)
    length = high - low
    near, far = low + length * _PLACES[index], low + length * _PLACES[index + 1]
    near_values, far_values = values[row, index], values[row, index + 1]
    for _ in range(_BISECTIONS):
        place = 0.5 * (near + far)
        value = probe.sample(ends, place[:, None])[:, 0]
        upper = np.abs(far_values - value) > np.abs(near_values - value)
        near, near_values = np.where(upper, place, near), np.where(upper, value, near_values)
        far, far_values = np.where(upper, far, place), np.where(upper, far_values, value)
    return 0.5 * (near + far)
