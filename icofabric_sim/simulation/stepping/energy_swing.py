# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
By how much a splitting method lets the energy of a vibration swing, and which steps that allows.

A step of a stable method turns the state of an oscillator along an ellipse in the plane of place
and velocity, scaled so that its energy is a circle; the energy swings as the square of the ratio
of the axes, whatever the amplitude and however long the run.
"""

from functools import lru_cache
import math

_HALVINGS = 30


def energy_swing(kicks: tuple[float, ...], drifts: tuple[float, ...], ratio: float) -> float:
    """
    Part of the energy of an oscillator that comes and goes, with steps of `ratio` [rad].

    `kicks` and `drifts` as in METHODS. Infinite where the method is unstable.
    """
    place, speed = [1.0, 0.0], [0.0, 1.0]  # of both unit states
    first, second = (kicks, drifts) if len(kicks) > len(drifts) else (drifts, kicks)
    for k, weight in enumerate(first):
        for part, kind in ((weight, first), (second[k] if k < len(second) else 0.0, second)):
            for column in range(2):
                if kind is kicks:
                    speed[column] -= part * ratio * place[column]
                else:
                    place[column] += part * ratio * speed[column]
    if not abs(0.5 * (place[0] + speed[1])) < 1.0 or not place[1] * speed[0] < 0.0:
        return math.inf
    square = -place[1] / speed[0]
    return abs(square - 1.0) / max(square, 1.0)


@lru_cache(maxsize=64)
def longest_ratio(
    kicks: tuple[float, ...], drifts: tuple[float, ...], most: float, part: float
) -> float:
    """
    Step times frequency [rad], at most `most`, at which energy swings by no more than a `part`.

    Below `most`, which is within the stable range, it falls with the step.
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
