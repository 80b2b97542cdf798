# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
The books of a run: what a look found, what is asked of it, and whether the energy balances.

The numbers are one array that kernels write (kernels/monitor.py); here they get names.
"""

import math
from typing import Any, NamedTuple

from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.records import Loads, State
from icofabric_sim.memory import Memory
from icofabric_sim.model import PackedScene
import numpy as np

# Energies below this part of those of stretching all connectors to twice their length, or of
# lifting all bodies by the size of the fabric, are rounding.
_REST = 1e-12


class EnergyBalance(NamedTuple):
    """
    All energy, less the work done and with what was spent, beside what it was at the start.
    """

    error: float  # [J], when looked at last
    scale: float  # [J], largest energy seen or work done
    worst: float  # largest error so far, in parts of the scale
    work: float  # [J] done by loads
    limit: float  # part of the scale that stops a run


class Ledger:
    """
    Energies, work and rates of one run.
    """

    def __init__(self, packed: PackedScene, energy_limit: float) -> None:
        """
        Allow a balance error of `energy_limit` times the largest energy seen or work done.
        """
        self.numbers = np.zeros(monitor.LEDGER_COUNT)
        self.numbers[monitor.LIMIT] = energy_limit
        self._packed = packed

    def __getitem__(self, place: int) -> float:
        """
        A number by its place in kernels/monitor.py.
        """
        return float(self.numbers[place])

    def __setitem__(self, place: int, value: float) -> None:
        """
        Ask something of the next look.
        """
        self.numbers[place] = value

    def restart(self) -> None:
        """
        Forget the past: the state has jumped.
        """
        self.numbers[[
            monitor.EARLIER_WORK, monitor.SCALE, monitor.WORST, monitor.LOST,
            monitor.DEEPEST_EVER]] = 0.0
        self.numbers[monitor.LIVELY] = self.numbers[monitor.ROUGH_LIMIT] = math.inf
        self.numbers[[monitor.REGULAR, monitor.ROUGHEST]] = 0.0
        self.numbers[monitor.ROUGH] = -1.0

    def open(self, state: State, moving: float) -> None:
        """
        Take what a look has just found for the start of the balance.

        `moving`: kinetic energy [J] of driven bodies, which nobody has had to give them yet.
        """
        numbers = self.numbers
        numbers[monitor.EARLIER_WORK] -= moving
        numbers[monitor.WORK] -= moving
        numbers[monitor.BASE_HEIGHT] = numbers[monitor.HEIGHT]
        numbers[monitor.BASE] = (
            numbers[monitor.KINETIC] + numbers[monitor.STORED] + numbers[monitor.HEIGHT]
            - numbers[monitor.WORK] + numbers[monitor.SPENT])
        numbers[monitor.SCALE] = self._smallest_scale(state)
        numbers[monitor.WORST] = numbers[monitor.ERROR] = 0.0
        monitor.balance(numbers)

    def keep_work(self, loads: Loads | None) -> None:
        """
        Add what loads have done that are about to be replaced.
        """
        if loads is not None:
            self.numbers[monitor.EARLIER_WORK] += math.fsum(loads.work)

    def memory(self) -> dict[str, Any]:
        """
        All numbers, but for what a call of kernels says of itself.
        """
        numbers = self.numbers.copy()
        numbers[monitor.SAVED_AT] = -1.0
        return {'numbers': numbers}

    def recall(self, memory: Memory) -> None:
        """
        Go on from there; limit and size are those of the scene.
        """
        kept = [monitor.LIMIT, monitor.INVERSE_SIZE, monitor.DEEPEST_LIMIT]
        numbers = memory.array('numbers', self.numbers.shape).copy()
        numbers[kept] = self.numbers[kept]
        np.copyto(self.numbers, numbers)

    @property
    def balance(self) -> EnergyBalance:
        """
        The balance as it was looked at last.
        """
        return EnergyBalance(*(self[place] for place in (
            monitor.ERROR, monitor.SCALE, monitor.WORST, monitor.WORK, monitor.LIMIT)))

    def describe_imbalance(self, time: float) -> str:
        """
        Sentence on an energy that does not balance at `time` [s].
        """
        balance = self.balance
        return (
            f'the energy does not balance at t = {time:.9g} s: an error of {balance.error:.3g} J, '
            f'{abs(balance.error) / balance.scale:.3g} of the largest energy seen or work done '
            f'({balance.scale:.3g} J), is above solver.energy_limit {balance.limit:.3g}')

    def _smallest_scale(self, state: State) -> float:
        """
        Energy [J] beside which that of a fabric at rest is rounding.
        """
        scale, packed = 0.0, self._packed
        if packed.connectors is not None:
            connectors = packed.connectors
            scale += len(connectors.first) * float(
                (connectors.extension * connectors.natural_length**2).max())
        if packed.model.dipole is not None:
            scale += packed.layout.body_count * packed.model.dipole.largest
        if packed.model.gravity is not None:
            extent = float(np.abs(state.position).max())
            weight = float(np.linalg.norm(packed.model.gravity)) / packed.model.inverse_mass
            scale += weight * extent * packed.layout.body_count
        return _REST * scale
