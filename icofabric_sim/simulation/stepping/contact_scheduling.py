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
What contacts ask of a trajectory: neighbour searches, the frequency they add, and their end.
"""

import math

from icofabric_sim.kernels.records import State
from icofabric_sim.simulation.contact.broad_phase import BroadPhase, LOOK_AFTER
from icofabric_sim.simulation.errors import SimulationError
from icofabric_sim.simulation.model.stability import Frequency, largest_frequency, with_anchors
from icofabric_sim.simulation.stepping.faults import unsafe_step
from icofabric_sim.simulation.stepping.trajectory import Trajectory
import numpy as np


class ContactScheduledTrajectory(Trajectory):
    """A trajectory that knows what can touch; derived classes choose the steps."""

    # The largest frequency of the fabric alone, in the configuration looked at last.
    _fabric: Frequency
    # Whether it is the speed of bodies that limits the step.
    _held_back: bool

    @property
    def frequency(self) -> Frequency:
        """
        Largest frequency of the configuration looked at last, with what contacts can make of it.
        """
        if self.watch is None or self.watch.rate == 0.0:
            return self._fabric
        return self._fabric._replace(rate=math.sqrt(self._fabric.rate**2 + self.watch.rate))

    @property
    def limit(self) -> float:
        """Stability limit of the step [s] in the configuration looked at last."""
        rate = self.frequency.rate + self.packed.velocity_rate
        if self.watch is not None:
            rate += self.watch.velocity_rate
        return self.method.stability / rate if rate > 0.0 else math.inf

    def _largest_frequency(self, *, locate: bool = False) -> Frequency:
        return with_anchors(
            largest_frequency(self.packed, self.state, locate=locate), self.packed, self.loads,
            self.state, self.time)

    def _look_for_contacts(self, time: float, *, way: float = 0.0) -> None:
        """
        Find what can touch from the present state on at `time` [s], for a `way` [m] of bodies.
        """
        if self.watch is None:
            return
        before = self.ledger.contact_rate
        self.watch.look(time, self.state, *self._outlook(self.watch), way=way)
        self._follow_watch()
        # The bound that was found at the last look, with the contacts of now.
        ledger = self.ledger
        spin = ledger.spin_weight * ledger.spin
        fabric = max((ledger.rate - spin) ** 2 - before, 0.0)
        ledger.rate = math.sqrt(fabric + self.watch.rate) + spin

    def _outlook(self, watch: BroadPhase) -> tuple[float, float]:
        """The step [s] that contacts will ask for, and for how many of them to look ahead."""
        if self.fixed:
            return self.step, 1.0
        # Contacts are stiffer than the fabric, whose frequency is of the state looked at before.
        return (
            self.method.chosen / math.sqrt(watch.least_rate), LOOK_AFTER / self.method.stages)

    def _pace(self, step: float) -> None:
        """Say how often bodies are asked how far they have moved, and whether kernels may look."""
        if self.watch is not None:
            self.watch.pace(step, self.method.stages, alone=not self._held_back)

    def _require_room(self) -> None:
        """Refuse a start in which shells overlap by far; note one in which they overlap."""
        if self.watch is None:
            return
        if self.ledger.deepest > self.ledger.deepest_limit:
            self._fail(
                f'{self.watch.note(self.time, self.state)}; move them apart, or set contact.mode '
                'never')
        if self.ledger.deepest > self.ledger.told_limit:
            self.ledger.told_limit = math.inf
            self.watch.found = self.watch.found or self.watch.note(self.time, self.state)

    def _meet_overlap(self, time: float, *, stop: bool) -> None:
        """Say once that shells overlap by more than they should, or stop."""
        if self.watch is None:
            return
        found = self.watch.note(time, self.state)
        if not stop:
            self.ledger.told_limit = math.inf
            self.watch.found = self.watch.found or found
            self.watch.announce()
            return
        self._return_to_saved()
        self._fail(
            f'{found}, which is more than a fifth of the inscribed radius '
            f'({self.ledger.deepest_limit:.3g} m): they might pass through each other. '
            f'Give a larger contact.stiffness than {self.watch.setup.stiffness:.4g} N/m; the last '
            f'good state, of t = {self._saved_time:.9g} s, is kept')

    def _is_far(self, step: float) -> bool:
        """
        Whether bodies may come so far in a given `step` [s] that contacts are not known there.
        """
        return self.fixed and self.watch is not None and step > self.watch.longest_step

    def _refuse_passing(self, before: State, after: State, start: float, end: float) -> None:
        """
        Stop `before` a step in which shells may pass through each other: that state is kept.

        It is the present one, or it was saved.
        """
        found = '' if self.watch is None else self.watch.passing_by(before, after, start, end)
        if found:
            if before is self.state:
                self._save()
            self._return_to_saved()
            if self.loads is not None:
                np.copyto(self.loads.work, self.loads.earlier_work)
            self._fail(
                f'{found}. Start again with a smaller solver.step than {self.step!r} s, or 0 to '
                'have it chosen; contact.mode never lets shells pass through each other. The '
                f'last good state, of t = {self._saved_time:.9g} s, is kept')

    def _require_safe_step(self, time: float) -> None:
        if not self.fixed or self.step <= self.limit:
            return
        if self.watch is not None and self.step <= self.method.stability / max(
                self._fabric.rate + self.packed.velocity_rate, 1e-300):
            self._fail(
                f'solver.step {self.step!r} s is too long for what touches, or may, from t = '
                f'{time:.9g} s on: with a contact stiffness of {self.watch.setup.stiffness:.4g} '
                f'N/m the stability limit is {self.limit:.6g} s; start again with a smaller step, '
                'with 0 to have it chosen, or with a smaller contact.stiffness; contact.mode '
                'never lets shells pass through each other')
        frequency = self._largest_frequency(locate=True)
        self._fail(unsafe_step(self.step, self.limit, frequency, time))

    def _fail(self, message: str) -> None:
        self._failure = SimulationError(message)
        raise self._failure
