# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Prediction of contacts for the step control of the embedded pair, with bodies elsewhere.

Searches and all tests of contacts run in this process, which receives the state when necessary.
Speeds and displacements of points of shells are computed where the bodies are.
"""

from collections.abc import Callable
from typing import Any

from icofabric_sim.kernels.contact.clearance import CLEAR, judge_clear, mean_velocity, way_between
from icofabric_sim.kernels.contact.displacement import FREE, MAX_REACH
from icofabric_sim.kernels.contact.landing import foresee, land, NEVER_MEET
from icofabric_sim.kernels.records import Contacts, State, Team, Watch
from icofabric_sim.simulation.devices.near_pairs import team_of_one
import numpy as np

Mean = tuple[float, float, float]
_FIRST_SLOPE = range(1)


class Foresight:
    """Prediction of contacts for trial steps elsewhere."""

    def __init__(
        self, have_state: Callable[[range], Any],
        quickest: Callable[[Mean, float], tuple[float, float]]
    ) -> None:
        """
        Use `have_state` to copy the state and some slopes to this process.

        `quickest` returns the largest speed [m/s] of a point at the stages relative to a mean
        velocity, and the largest squared displacement [m^2] since the last search at a time [s].
        """
        self._have_state, self._quickest = have_state, quickest

    def pieces(self) -> dict[str, Any]:
        """Return the functions of the step control by name."""
        return {'foresee': self._foresee, 'land': self._land, 'find_clear': self._find_clear}

    # With the arguments of there.

    def _foresee(
        self, contacts: Contacts | None, watch: Watch | None, blocks: Any, state: State,
        trail: Any, team: Team, time: float, h: float, close: float, meeting: np.ndarray,
        first: int, last: int
    ) -> float:
        if watch is None:
            return NEVER_MEET
        self._have_state(_FIRST_SLOPE)
        return float(foresee(
            contacts, watch, blocks, state, trail, team_of_one(), time, h, close, meeting, first,
            last))

    def _land(
        self, contacts: Contacts | None, team: Team, state: State, slope: np.ndarray,
        tried: float, close: float, meeting: np.ndarray
    ) -> float:
        if contacts is None:
            return NEVER_MEET
        self._have_state(_FIRST_SLOPE)
        return float(land(contacts, team_of_one(), state, slope, tried, close, meeting))

    def _find_clear(
        self, watch: Watch | None, blocks: Any, state: State, trail: Any, stages: int,
        team: Team, time: float, h: float, first: int, last: int
    ) -> int:
        if watch is None:
            return CLEAR
        mean = (0.0, 0.0, 0.0)
        if watch.nearby.free:
            self._have_state(range(0))
            x, y, z = mean_velocity(state, watch.nearby.slots)
            mean = float(x), float(y), float(z)
        speed, moved = self._quickest(mean, float(time))
        needed = way_between(h, speed)
        if needed <= 0.5 * watch.limits[MAX_REACH] and not (
                watch.limits[FREE] - moved**0.5 > needed):
            # It will be searched for.
            self._have_state(range(0))
        return int(judge_clear(watch, state, needed, moved))
