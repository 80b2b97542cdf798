# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Neighbour search within a kernel, while a run continues.

The search is that of simulation/contact/neighbour_list.py, with the same functions and results.
As long as no contact is possible, the kernels need not return.
"""

import math

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.terms.contacts.displacement import (
    HORIZON,
    LATE,
    MAX_REACH,
    MIN_REACH,
    OWN,
    pace,
    REACH_FACTOR,
    set_reach,
    SKIN,
    SOON,
    SPEED,
)
from icofabric_sim.terms.contacts.record import Watch
from icofabric_sim.terms.contacts.search import find_reach, refresh, survey
from icofabric_sim.terms.shared import State
import numpy as np

# Bits of the status that kernels return: bodies have moved so far that a new search is due,
# and beyond where contacts are known.
MOVED_FAR, MISSED = 8, 1024


@compiled
def least_reach(limits: np.ndarray, speed: float) -> float:
    """Return the required reach [m] for bodies of a `speed` [m/s] if pairs are near."""
    return min(max(limits[HORIZON] * speed, limits[MIN_REACH]), limits[MAX_REACH])


@compiled
def judge_ways(
    watch: Watch | None, most: float, state: State, time: float, step: float
) -> int:
    """
    Return MOVED_FAR if the square `most` [m^2] of the largest displacement requires a search.

    With MISSED if the search is too late. Return 0 if a search within the kernel was enough, at a
    `state` and a `time` [s] at the end of a step of length `step` [s].
    """
    if watch is None or not most > watch.limits[SOON]:
        return 0
    if most > watch.limits[LATE]:
        return MOVED_FAR | MISSED
    return 0 if look_around(watch, state, time, step) else MOVED_FAR


@compiled
def look_around(watch: Watch, state: State, time: float, step: float) -> bool:
    """
    Search for possible contacts; without any, return True and set new reference positions.

    Otherwise return False and change nothing.
    """
    limits, nearby = watch.limits, watch.nearby
    if limits[OWN] == 0.0:
        return False
    speed, way = survey(nearby, state)
    if not speed < math.inf:
        return False
    most, skin = limits[MAX_REACH], limits[SKIN]
    if 2.0 * (way + most) > skin and refresh(
            nearby, state.position, skin) > nearby.pairs.shape[1]:
        return False
    least = least_reach(limits, speed)
    reach = find_reach(nearby, state.position, least, most)
    if reach < least or step * REACH_FACTOR * speed > reach:
        return False
    frame = watch.frame
    frame[0] = time
    for k in range(3):
        frame[1 + k] = nearby.velocity[k]
    limits[SPEED] = speed
    set_reach(limits, reach, False)
    pace(limits, step)
    copy_numbers(state.position, watch.reference)
    copy_numbers(state.orientation, watch.turned)
    return True


@compiled
def copy_numbers(source: np.ndarray, target: np.ndarray) -> None:
    """
    Copy an array into another one of its shape.

    An assignment to a slice compiles for seconds, because of its error messages on shapes.
    """
    start, end = source.reshape(source.size), target.reshape(source.size)
    for i in range(source.size):
        end[i] = start[i]


@compiled
def can_look_farther(watch: Watch | None, time: float) -> bool:
    """Check that a search from the positions at `time` [s] has a longer reach than the last."""
    if watch is None:
        return False
    most = (1.0 - 1e-9) * watch.limits[MAX_REACH]
    return watch.frame[0] != time or watch.limits[LATE] < most * most
