# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The reference motion of a fabric whose connectors have two stiffnesses (eq 2).

The extrapolation of reference.py, of order 16, keeps every connector on its side of the natural
length within a step, so that forces are smooth. A step in which a connector changes sides is
repeated so that it ends at the change, to round-off. Then the connector gets its other stiffness.
"""

from icofabric_validation.benchmarks.reference import (
    COLUMNS,
    COURANT,
    displaced,
    extrapolate,
    motion_of,
    Reference,
    Springs,
    springs_of,
    start_of,
)
from icofabric_validation.benchmarks.scenes import motion_error, PlainScene
import numpy as np

# Largest strain of a connector that counts as being at its natural length.
_ZERO_STRAIN = 1e-13
# Steps over those of the smooth reference, so that no side changes twice within a step.
_STEP_RATIO = 0.5
_MAX_NEWTON_STEPS = 12


def kinked_reference(
    scene: PlainScene, duration: float, *, displacement: float = 1e-7
) -> Reference:
    """Return the reference motion of `scene` at `duration` [s]; growth of one displacement."""
    start = start_of(scene)
    count = int(np.ceil(duration * scene.frequency_bound / (_STEP_RATIO * COURANT)))
    end, _ = follow(scene, start, duration, count)
    finer, crossings = follow(scene, start, duration, (3 * count + 1) // 2)
    uncertainty = motion_error(motion_of(end), motion_of(finer), scene.half_edge)
    moved = displaced(start, np.random.RandomState(7), displacement, scene.half_edge)
    before = motion_error(motion_of(moved), motion_of(start), scene.half_edge)
    moved, _ = follow(scene, moved, duration, count)
    after = motion_error(motion_of(moved), motion_of(end), scene.half_edge)
    return Reference(motion_of(finer), duration, uncertainty, after / before, crossings)


def follow(
    scene: PlainScene, start: np.ndarray, duration: float, count: int
) -> tuple[np.ndarray, int]:
    """Return the state (n, 18) at `duration` [s] by at least `count` steps, and side changes."""
    springs, y = springs_of(scene), start.copy()
    excess, rate = _strains(springs, y)
    longer = np.where(np.abs(excess) > _ZERO_STRAIN * scene.natural_length, excess, rate) > 0.0
    time, crossings, longest = 0.0, 0, duration / count
    while time < duration:
        sides = springs._replace(
            stiffness=np.where(longer, scene.stiffness, scene.compression))
        h = min(longest, duration - time)
        sign = np.where(longer, 1.0, -1.0)
        part, y = _first_crossing(sides, y, sign, h)
        time = duration if part == 1.0 and h == duration - time else time + part * h
        excess, rate = _strains(springs, y)
        over = (sign * excess < _ZERO_STRAIN * scene.natural_length) & (sign * rate < 0.0)
        longer ^= over
        crossings += int(over.sum())
    return y, crossings


def _first_crossing(
    springs: Springs, y: np.ndarray, sign: np.ndarray, h: float
) -> tuple[float, np.ndarray]:
    """Return the fraction of a step `h` [s] until the first side change, or 1, and the state."""
    close = _ZERO_STRAIN * springs.natural_length
    start, start_rate = (sign * values for values in _strains(springs, y))
    end = extrapolate(springs, y, h, 1, COLUMNS)
    now, rate = (sign * values for values in _strains(springs, end))
    late = np.flatnonzero(now < -close)
    if not len(late):
        turned = np.flatnonzero((start_rate < 0.0) & (rate > 0.0) & (start > close))
        x = start_rate[turned] / (start_rate[turned] - rate[turned])
        there = _cubic(x, start[turned], h * start_rate[turned], now[turned], h * rate[turned])
        if not (there < -close).any():
            return 1.0, end
        # Two crossings in a step: up to the turning point.
        middle = float(x[there < -close].min())
        part, end = _first_crossing(springs, y, sign, middle * h)
        return middle * part, end
    x = _roots(start[late], h * start_rate[late], now[late], h * rate[late])
    first, part = late[np.argmin(x)], float(x.min())
    for _ in range(_MAX_NEWTON_STEPS):
        part = min(max(part, 1e-14), 1.0)
        end = extrapolate(springs, y, part * h, 1, COLUMNS)
        now, rate = (sign * values for values in _strains(springs, end))
        late = np.flatnonzero(now < -close)
        if len(late):
            first = late[np.argmin(-now[late] / rate[late])]
        elif abs(now[first]) <= close:
            break
        part -= float(now[first] / (h * rate[first]))
    return part, end


def _roots(
    low: np.ndarray, rise: np.ndarray, high: np.ndarray, slope: np.ndarray
) -> np.ndarray:
    """Return the zeros in 0 to 1 of cubics from `low` >= 0 to `high` < 0, by bisection."""
    left, right = np.zeros_like(low), np.ones_like(low)
    for _ in range(50):
        x = 0.5 * (left + right)
        above = _cubic(x, low, rise, high, slope) > 0.0
        left, right = np.where(above, x, left), np.where(above, right, x)
    return 0.5 * (left + right)


def _cubic(
    x: np.ndarray, low: np.ndarray, rise: np.ndarray, high: np.ndarray, slope: np.ndarray
) -> np.ndarray:
    """Return cubics from `low` with slope `rise` at 0 to `high` with `slope` at 1."""
    y = 1.0 - x
    return np.asarray(
        low * y * y * (1.0 + 2.0 * x) + high * x * x * (1.0 + 2.0 * y)
        + x * y * (rise * y - slope * x))


def _strains(springs: Springs, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return extensions of connectors [m] and their rates [m/s]."""
    ends, speeds = [], []
    for body, axis, arm in (
            (springs.first, springs.first_axis, springs.first_arm),
            (springs.second, springs.second_axis, springs.second_arm)):
        axes = y[:, 6:15].reshape(-1, 3, 3)
        arms = arm[:, None] * axes[body, axis]
        ends.append(y[body, :3] + arms)
        speeds.append(y[body, 3:6] + np.cross(y[body, 15:], arms))
    span, speed = ends[1] - ends[0], speeds[1] - speeds[0]
    length = np.linalg.norm(span, axis=1)
    return length - springs.natural_length, (span * speed).sum(axis=1) / length
