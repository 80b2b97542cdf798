# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Step control of an embedded pair whose bodies are with ranks or on a GPU.

The control of a single process (kernels/integrators/embedded.py) selects, accepts and rejects
steps. It runs in Python and asks an object that stands for the bodies. Searches and all tests of
contacts run in this process, which receives the state when necessary. Speeds and displacements of
points of shells are computed where the bodies are.
"""

from abc import abstractmethod

from icofabric_sim.kernels.integrators.embedded import adaptive_pair, fixed_pair
from icofabric_sim.kernels.integrators.splitting import NEVER
from icofabric_sim.kernels.integrators.tableau import Pair
from icofabric_sim.kernels.records import Loads, Model, State, Team, Work
from icofabric_sim.simulation.devices.executor import Call, Remote, Steps
from icofabric_sim.simulation.devices.near_pairs import team_of_one
from icofabric_sim.terms.contacts.clearance import CLEAR, judge_clear, mean_velocity, way_between
from icofabric_sim.terms.contacts.displacement import FREE, MAX_REACH
from icofabric_sim.terms.contacts.force import set_tests, tests_of
from icofabric_sim.terms.contacts.landing import foresee, land, NEVER_MEET
from icofabric_sim.terms.contacts.rebuild_check import can_look_farther
from icofabric_sim.terms.contacts.record import Watch
import numpy as np

Mean = tuple[float, float, float]


class DistantBodies(Remote):
    """Bodies elsewhere, as kernels/integrators/bodies.py asks them."""

    # Under an embedded control each step keeps the work of loads where it begins.
    _keeps_work = False

    def __init__(self, pair: Pair) -> None:
        """Take the steps of `pair`."""
        self._pair = pair

    def take(
        self, model: Model, loads: Loads, state: State, saved: State, work: Work, team: Team,
        control: np.ndarray, count: int, since_check: int, check_interval: int,
        watch: Watch | None, ledger: np.ndarray
    ) -> Steps:
        """Take steps as `adaptive_pair` does."""
        call = Call(
            model, loads, state, saved, work, watch, ledger, of_run=check_interval < NEVER)
        return self._take(
            call, adaptive_pair, self._pair, control, count, since_check, check_interval, ledger)

    def advance(
        self, model: Model, loads: Loads, state: State, saved: State, work: Work, team: Team,
        origin: float, index: int, h: float, count: int, since_check: int, check_interval: int,
        watch: Watch | None, ledger: np.ndarray
    ) -> Steps:
        """Take steps as `fixed_pair` does."""
        call = Call(
            model, loads, state, saved, work, watch, ledger, of_run=check_interval < NEVER)
        return self._take(
            call, fixed_pair, self._pair, origin, index, h, count, since_check, check_interval,
            ledger)

    @abstractmethod
    def have_state(self, slopes: range = range(0)) -> None:
        """Copy the state and some slopes to this process."""

    @abstractmethod
    def _quickest(self, mean: Mean, time: float) -> tuple[float, float]:
        """
        Return how fast points of shells move, and how far they have moved since the last search.

        The largest speed [m/s] at the stages relative to the `mean` velocity, and the largest
        squared displacement [m^2] at a `time` [s].
        """

    # What the control asks.

    def finish(self) -> bool:
        """Return True: there is one control."""
        return True

    def search(self, time: float, step: float, ledger: np.ndarray) -> int:
        """Return the status of displacements and overlaps at `time` [s]."""
        if self._call.watch is not None and self._call.of_run:
            self.exchange(is_guarded=False, is_searched=True)
        return super().search(time, step, ledger)

    def count_tests(self) -> int:
        """Return the number of pairs tested so far."""
        return int(tests_of(self._call.model.contacts, 0))

    def repeat_count(self, tests: int) -> None:
        """Set the number of tested pairs."""
        set_tests(self._call.model.contacts, 0, tests)

    def can_search_farther(self, time: float) -> bool:
        """Check that a search has a longer reach than the last one."""
        return bool(can_look_farther(self._call.watch, time))

    def foresee_contact(self, time: float, h: float, close: float, meeting: np.ndarray) -> float:
        """Return when a contact begins or ends within `h` [s]."""
        call = self._call
        if call.watch is None:
            return NEVER_MEET
        self.have_state(range(1))
        return float(foresee(
            call.model.contacts, call.watch, call.model.blocks, call.state, call.work.trail,
            team_of_one(), time, h, close, meeting, 0, len(call.model.blocks.slot)))

    def land_on_contact(self, h: float, close: float, meeting: np.ndarray) -> float:
        """Return when a contact begins or ends within a refused step of `h` [s]."""
        contacts, trail = self._call.model.contacts, self._call.work.trail
        if contacts is None:
            return NEVER_MEET
        assert trail is not None
        self.have_state(range(1))
        return float(land(
            contacts, team_of_one(), self._call.state, trail.slopes[0], h, close, meeting))

    def check_clear(self, pair: Pair, time: float, h: float) -> int:
        """Check that no contact is possible within a step from `time` [s]."""
        watch, state = self._call.watch, self._call.state
        if watch is None:
            return CLEAR
        mean = (0.0, 0.0, 0.0)
        if watch.nearby.free:
            self.have_state()
            x, y, z = mean_velocity(state, watch.nearby.slots)
            mean = float(x), float(y), float(z)
        speed, moved = self._quickest(mean, float(time))
        needed = way_between(h, speed)
        if needed <= 0.5 * watch.limits[MAX_REACH] and not (
                watch.limits[FREE] - moved**0.5 > needed):
            # It will be searched for.
            self.have_state()
        return int(judge_clear(watch, state, needed, moved))
