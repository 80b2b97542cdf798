# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A look at what can touch before long, on the spot, while a run goes on.

It is what simulation/contact/neighbour_list.py does, with the same functions and so with the
same results, for as long as nothing can: then there is no reason for the kernels to return.
"""

import math

from icofabric_sim.kernels.contact.displacement import (
    HORIZON,
    LATE,
    LEAST,
    MOST,
    OWN,
    pace,
    ROOM,
    set_reach,
    SKIN,
    SOON,
    SPEED,
)
from icofabric_sim.kernels.contact.search import find_reach, refresh, survey
from icofabric_sim.kernels.records import State, Watch
from icofabric_sim.kernels.runtime.compiled import compiled
import numpy as np

# Bits of the status that kernels return: bodies have moved so far that a new search is due,
# and beyond where contacts are known.
MOVED_FAR, MISSED = 8, 1024


@compiled
def least_reach(limits: np.ndarray, speed: float) -> float:
    """Reach [m] that is wanted for bodies of a `speed` [m/s] where something is near."""
    return min(max(limits[HORIZON] * speed, limits[LEAST]), limits[MOST])


@compiled
def judge_ways(
    watch: Watch | None, most: float, state: State, time: float, step: float
) -> int:
    """
    MOVED_FAR where the longest way has a square [m^2] so large that a new search is due.

    With MISSED where that is too late. Neither where it was enough to look from here, at a `state`
    and a `time` [s] at the end of a step of length `step` [s].
    """
    if watch is None or not most > watch.limits[SOON]:
        return 0
    if most > watch.limits[LATE]:
        return MOVED_FAR | MISSED
    return 0 if look_around(watch, state, time, step) else MOVED_FAR


@compiled
def look_around(watch: Watch, state: State, time: float, step: float) -> bool:
    """
    Look for what can touch: nothing for now, from new places on; else False, and nothing is done.
    """
    limits, nearby = watch.limits, watch.nearby
    if limits[OWN] == 0.0:
        return False
    speed, way = survey(nearby, state)
    if not speed < math.inf:
        return False
    most, skin = limits[MOST], limits[SKIN]
    if 2.0 * (way + most) > skin and refresh(
            nearby, state.position, skin) > nearby.pairs.shape[1]:
        return False
    least = least_reach(limits, speed)
    reach = find_reach(nearby, state.position, least, most)
    if reach < least or step * ROOM * speed > reach:
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

    An assignment to a slice compiles for seconds: it says in words where shapes differ.
    """
    start, end = source.reshape(source.size), target.reshape(source.size)
    for i in range(source.size):
        end[i] = start[i]


@compiled
def can_look_farther(watch: Watch | None, time: float) -> bool:
    """
    Whether a look from where bodies are at `time` [s] would have a longer reach than the last.
    """
    if watch is None:
        return False
    most = (1.0 - 1e-9) * watch.limits[MOST]
    return watch.frame[0] != time or watch.limits[LATE] < most * most
