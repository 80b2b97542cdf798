# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Effect of a splitting method on a vibration: oscillation of its energy, and phase error.

A step of a stable method moves the state of an oscillator along an ellipse in the plane of
position and velocity, scaled so that constant energy is a circle. The energy oscillates by the
squared ratio of the axes, whatever the amplitude and the length of the run.
"""

from functools import lru_cache
import math

_HALVINGS = 30


def energy_swing(kicks: tuple[float, ...], drifts: tuple[float, ...], ratio: float) -> float:
    """
    Return the relative oscillation of the energy of an oscillator with steps of `ratio` [rad].

    `kicks` and `drifts` are as in METHODS. The result is infinite if the method is unstable.
    """
    place, speed = _step_matrix(kicks, drifts, ratio)
    if not abs(0.5 * (place[0] + speed[1])) < 1.0 or not place[1] * speed[0] < 0.0:
        return math.inf
    square = -place[1] / speed[0]
    return abs(square - 1.0) / max(square, 1.0)


def _step_matrix(
    kicks: tuple[float, ...], drifts: tuple[float, ...], ratio: float
) -> tuple[list[float], list[float]]:
    """Return the positions and speeds after a step from both unit states."""
    place, speed = [1.0, 0.0], [0.0, 1.0]
    first, second = (kicks, drifts) if len(kicks) > len(drifts) else (drifts, kicks)
    for k, weight in enumerate(first):
        for part, kind in ((weight, first), (second[k] if k < len(second) else 0.0, second)):
            for column in range(2):
                if kind is kicks:
                    speed[column] -= part * ratio * place[column]
                else:
                    place[column] += part * ratio * speed[column]
    return place, speed


@lru_cache(maxsize=64)
def phase_error(kicks: tuple[float, ...], drifts: tuple[float, ...], ratio: float) -> float:
    """
    Return the phase error [rad] of an oscillator in a step of `ratio` [rad].

    `kicks` and `drifts` are as in METHODS. The result is infinite if the method is unstable.
    """
    place, speed = _step_matrix(kicks, drifts, ratio)
    cosine = 0.5 * (place[0] + speed[1])
    return abs(math.acos(cosine) - ratio) if abs(cosine) < 1.0 else math.inf


@lru_cache(maxsize=64)
def longest_ratio(
    kicks: tuple[float, ...], drifts: tuple[float, ...], most: float, part: float
) -> float:
    """
    Return step times frequency [rad], at most `most`, with an energy oscillation up to `part`.

    Below `most`, which must be stable, the oscillation decreases with the step.
    """
    if energy_swing(kicks, drifts, most) <= part:
        return most
    low, high = 0.0, most
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if energy_swing(kicks, drifts, middle) <= part:
            low = middle
        else:
            high = middle
    return low
