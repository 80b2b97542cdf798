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
The books of a run: what a look found, what is asked of it, and whether the energy balances.

The numbers are one array that kernels write (kernels/monitor.py); here they get names.
"""

import math
from typing import Any, NamedTuple

from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.records import Loads
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.state_tree import StateTree
import numpy as np

# Part of a coordinate, and of a sum, that counts as rounding: a few operations make it.
_ROUNDING = 16.0 * float(np.finfo(float).eps)


class EnergyBalance(NamedTuple):
    """All energy, less the work done and with what was spent, beside what it was at the start."""

    error: float  # [J], when looked at last
    # [J], the largest sum of energies that moved, were exchanged or put in
    scale: float
    worst: float  # largest error so far, in parts of the scale
    work: float  # [J] done by loads
    limit: float  # part of the scale that stops a run


class Ledger:
    """Energies, work and rates of one run."""

    def __init__(self, packed: PackedScene, energy_limit: float) -> None:
        """Allow a balance error of `energy_limit` times the scale of the balance."""
        self.numbers = np.zeros(monitor.LEDGER_COUNT)
        self.numbers[monitor.LIMIT] = energy_limit
        self.numbers[monitor.BODIES] = packed.layout.body_count
        self.numbers[monitor.ROUNDING] = _ROUNDING
        self._packed = packed

    def __getitem__(self, place: int) -> float:
        """A number by its place in kernels/monitor.py."""
        return float(self.numbers[place])

    def __setitem__(self, place: int, value: float) -> None:
        """Ask something of the next look."""
        self.numbers[place] = value

    def restart(self) -> None:
        """Forget the past: the state has jumped."""
        self.numbers[[
            monitor.EARLIER_WORK, monitor.SCALE, monitor.WORST, monitor.LOST,
            monitor.DEEPEST_EVER, monitor.NOISE, monitor.LOOKS]] = 0.0
        self.numbers[monitor.LIVELY] = self.numbers[monitor.ROUGH_LIMIT] = math.inf
        self.numbers[[monitor.REGULAR, monitor.ROUGHEST]] = 0.0
        self.numbers[monitor.ROUGH] = -1.0

    def open(
        self, moving: float, acceleration: np.ndarray, rate: float, speed: float
    ) -> None:
        """
        Take what a look has just found for the start of the balance.

        `moving`: kinetic energy [J] of driven bodies, which nobody has had to give them yet;
        `acceleration` (n, 6) [m/s^2, rad/s^2] of the bodies, `rate` [rad/s] the largest frequency;
        `speed` [1/s]: what the tolerance may add to velocities over a, and to spins.
        """
        numbers, model = self.numbers, self._packed.model
        mass, inertia = 1.0 / model.inverse_mass, 1.0 / model.inverse_inertia
        numbers[monitor.EARLIER_WORK] -= moving
        numbers[monitor.WORK] -= moving
        for base, part in (
                (monitor.BASE_LINKED, monitor.LINKED), (monitor.BASE_BENT, monitor.BENT),
                (monitor.BASE_FIELD, monitor.FIELD), (monitor.BASE_ANCHORED, monitor.ANCHORED),
                (monitor.BASE_CONTACT, monitor.CONTACT), (monitor.BASE_HEIGHT, monitor.HEIGHT)):
            numbers[base] = numbers[part]
        numbers[monitor.BASE] = (
            numbers[monitor.KINETIC] + numbers[monitor.STORED] + numbers[monitor.HEIGHT]
            - numbers[monitor.WORK] + numbers[monitor.SPENT])
        # What the forces at the start can set free, at least: looks may find the fabric back where
        # it began. That of anchors is not in the accelerations; what falls freely has no way back.
        if model.gravity is not None and model.supports is None:
            acceleration = acceleration - np.append(model.gravity, np.zeros(3))
        # Forces without bounds end the run where the step is chosen.
        with np.errstate(over='ignore', invalid='ignore'):
            squares = (acceleration**2).reshape(-1, 2, 3).sum(axis=(0, 2))
            set_free = (0.5 * (mass * squares[0] + inertia * squares[1]) / rate**2
                        if 0.0 < rate < math.inf else 0.0)
        numbers[monitor.SCALE] = set_free + numbers[monitor.ANCHORED]
        numbers[monitor.FLOOR] = 0.5 * speed**2 * numbers[monitor.BODIES] * (
            mass / numbers[monitor.INVERSE_SIZE] + inertia)
        numbers[monitor.WORST] = numbers[monitor.ERROR] = 0.0
        monitor.balance(numbers)

    def keep_work(self, loads: Loads | None) -> None:
        """Add what loads have done that are about to be replaced."""
        if loads is not None:
            self.numbers[monitor.EARLIER_WORK] += math.fsum(loads.work)

    def state_tree(self) -> dict[str, Any]:
        """All numbers, but for what a call of kernels says of itself."""
        numbers = self.numbers.copy()
        numbers[monitor.SAVED_AT] = -1.0
        return {'numbers': numbers}

    def load_state(self, tree: StateTree) -> None:
        """Go on from there; limit and size are those of the scene."""
        kept = [
            monitor.LIMIT, monitor.INVERSE_SIZE, monitor.DEEPEST_LIMIT, monitor.BODIES,
            monitor.ROUNDING, monitor.FLOOR]
        numbers = tree.array('numbers', self.numbers.shape).copy()
        numbers[kept] = self.numbers[kept]
        np.copyto(self.numbers, numbers)

    @property
    def balance(self) -> EnergyBalance:
        """The balance as it was looked at last."""
        return EnergyBalance(
            self[monitor.ERROR], float(monitor.least_scale(self.numbers)), self[monitor.WORST],
            self[monitor.WORK], self[monitor.LIMIT])

    def describe_imbalance(self, time: float) -> str:
        """Sentence on an energy that does not balance at `time` [s]."""
        balance = self.balance
        return (
            f'the energy does not balance at t = {time:.9g} s: an error of {balance.error:.3g} J, '
            f'{abs(balance.error) / balance.scale:.3g} of the largest energy that moved, was '
            f'exchanged or put in ({balance.scale:.3g} J), is above solver.energy_limit '
            f'{balance.limit:.3g}')
