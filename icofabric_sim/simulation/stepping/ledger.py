# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Ledger of a run: results and limits of health checks, and the energy balance.

The values are one array that kernels write (kernels/monitor.py); this module names them.
"""

import math
from typing import Any, NamedTuple

from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.records import Loads, Model
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.model.packing import force_rate, PackedScene
from icofabric_sim.simulation.stepping.named_numbers import At
from icofabric_sim.terms.masses import largest_of, units_of
import numpy as np

# Part of a coordinate, and of a sum, that counts as rounding: a few operations make it.
_ROUNDING = 16.0 * float(np.finfo(float).eps)
# Energy of motions so small beside the tolerance that errors within it may take a part of it that
# counts, in parts of `floor`; and how far the floor is raised above an error that is allowed.
_SMALL_ENERGY_RATIO, _FLOOR_MARGIN_RATIO = 1e6, 1.25
_CONSTANTS = [
    monitor.MASS, monitor.INERTIA, monitor.LARGEST_MASS, monitor.LARGEST_INERTIA, monitor.GRAVITY,
    monitor.DIPOLE]
# What the balance of the energy has found since it began.
_BALANCE = [
    monitor.BASE, monitor.BASE_LINKED, monitor.BASE_BENT, monitor.BASE_FIELD,
    monitor.BASE_ANCHORED, monitor.BASE_CONTACT, monitor.BASE_HEIGHT, monitor.EARLIER_WORK,
    monitor.WORK, monitor.SCALE, monitor.WORST, monitor.ERROR, monitor.LOST, monitor.NOISE,
    monitor.DEEPEST_EVER]


class EnergyBalance(NamedTuple):
    """Energy plus dissipation less work, compared with the energy at the start."""

    error: float  # [J], at the last health check
    # [J], the largest sum of energies that moved, were exchanged or put in
    scale: float
    worst: float  # largest error so far, in parts of the scale
    work: float  # [J] done by loads
    limit: float  # part of the scale that stops a run

    @property
    def error_in_parts(self) -> float:
        """Magnitude of the error over the scale; 0 without motion."""
        return abs(self.error) / self.scale if self.scale > 0.0 else 0.0


class Ledger:
    """
    Energies, work and rates of one run, and the limits of its health checks.

    What each number is: kernels/monitor.py.
    """

    __slots__ = ('_least_floor', '_packed', 'numbers')

    # Found by the last health check.
    rate = At(monitor.RATE)  # [rad/s] bound of the largest frequency
    spin = At(monitor.SPIN)  # [rad/s]
    kinetic = At(monitor.KINETIC)  # [J]
    stored = At(monitor.STORED)  # [J]
    height = At(monitor.HEIGHT)  # [J]
    anchored = At(monitor.ANCHORED)  # [J]
    work = At(monitor.WORK)  # [J] of all loads
    spent = At(monitor.SPENT)  # [J] taken by forces that depend on velocities
    rough = At(monitor.ROUGH)  # -1: not known
    roughest = At(monitor.ROUGHEST)  # of single steps
    contact = At(monitor.CONTACT)  # [J], which `stored` includes
    touching = At(monitor.TOUCHING)  # pairs
    linked = At(monitor.LINKED)  # [J], which `stored` includes, as the next two
    bent = At(monitor.BENT)  # [J]
    field = At(monitor.FIELD)  # [J]
    worked = At(monitor.WORKED)  # [J] of all loads, sizes added
    tensions = At(monitor.TENSIONS)  # [N], sizes added
    extent = At(monitor.EXTENT)  # [m], the largest coordinate
    deepest = At(monitor.DEEPEST)  # [m] overlap
    deepest_ever = At(monitor.DEEPEST_EVER)  # [m]
    obstructed = At(monitor.OBSTRUCTED)  # ends of connectors
    # The balance of the energy [J].
    base = At(monitor.BASE)
    scale = At(monitor.SCALE)
    worst = At(monitor.WORST)  # part of the scale
    error = At(monitor.ERROR)
    limit = At(monitor.LIMIT)  # part of the scale
    floor = At(monitor.FLOOR)
    noise = At(monitor.NOISE)
    lost = At(monitor.LOST)
    earlier_work = At(monitor.EARLIER_WORK)
    bodies = At(monitor.BODIES)
    rounding = At(monitor.ROUNDING)
    inverse_size = At(monitor.INVERSE_SIZE)  # [1/m^2]
    # What a health check looks out for.
    high = At(monitor.HIGH)  # [rad/s]
    low = At(monitor.LOW)  # [rad/s]
    spin_weight = At(monitor.SPIN_WEIGHT)
    lively = At(monitor.LIVELY)  # [J]
    rough_limit = At(monitor.ROUGH_LIMIT)
    contact_rate = At(monitor.CONTACT_RATE)  # [1/s^2]
    deepest_limit = At(monitor.DEEPEST_LIMIT)  # [m]
    reported_limit = At(monitor.TOLD_LIMIT)  # [m]
    obstructed_limit = At(monitor.OBSTRUCTED_LIMIT)
    obstructed_every = At(monitor.OBSTRUCTED_EVERY)
    until_obstructed = At(monitor.UNTIL_OBSTRUCTED)
    swing_limit = At(monitor.SWING_LIMIT)  # part of the scale; inf: it is not asked for
    # What contacts make swing, and the part of the longest step that is left because of that.
    swing = At(monitor.SWING)  # [J]
    swing_part = At(monitor.SWING_PART)
    # How steps were taken.
    saved_at = At(monitor.SAVED_AT)  # steps of the last call when the state was saved; -1: never
    regular = At(monitor.REGULAR)  # steps of one length until now
    # What the motion's roughness adds up to, see `AccuracyProbe`.
    steady_rough = At(monitor.STEADY_ROUGH)  # at the last check that knew it
    rough_sum = At(monitor.ROUGH_SUM)  # over steps
    uncounted = At(monitor.PENDING_STEPS)  # steps that are not in the sum yet

    def __init__(self, packed: PackedScene, energy_limit: float) -> None:
        """Allow a balance error of `energy_limit` times the scale of the balance."""
        self.numbers = np.zeros(monitor.LEDGER_COUNT)
        self.limit = energy_limit
        self.bodies = packed.layout.body_count
        self.rounding = _ROUNDING
        self.numbers[_CONSTANTS] = _constants(packed.model)
        self._packed = packed
        self._least_floor = 0.0

    @classmethod
    def over(cls, numbers: np.ndarray) -> 'Ledger':
        """Return a ledger of `numbers` that kernels and devices write, without the scene."""
        ledger = object.__new__(cls)
        ledger.numbers = numbers
        return ledger

    def restart(self) -> None:
        """Reset the ledger after a jump of the state."""
        self.numbers[[
            monitor.EARLIER_WORK, monitor.SCALE, monitor.WORST, monitor.LOST,
            monitor.DEEPEST_EVER, monitor.NOISE, monitor.CHECK_COUNT]] = 0.0
        self.lively = self.rough_limit = self.swing_limit = math.inf
        self.numbers[[
            monitor.REGULAR, monitor.ROUGHEST, monitor.SWING, monitor.STEADY_ROUGH,
            monitor.ROUGH_SUM, monitor.PENDING_STEPS]] = 0.0
        self.swing_part = 1.0
        self.rough = -1.0

    def continue_from(self, before: 'Ledger') -> None:
        """Continue an earlier energy balance of the same motion."""
        self.numbers[_BALANCE] = before.numbers[_BALANCE]

    def open(
        self, moving: float, squares: float, rate: float, speed: float
    ) -> None:
        """
        Begin the balance with the figures of the last health check.

        `moving`: kinetic energy [J] of driven bodies, for which no work was needed;
        `squares` [N^2/kg]: of the forces and torques of all bodies over their masses and inertias,
        summed, by anchors too, and without that of what falls freely; `rate` [rad/s]: the largest
        frequency;
        `speed` [1/s]: what the tolerance may add to velocities over a, and to spins.
        """
        numbers = self.numbers
        masses = self._packed.masses
        mass, inertia = float(masses.mass.mean()), float(masses.inertia.mean())
        self.earlier_work -= moving
        self.work -= moving
        for base, part in (
                (monitor.BASE_LINKED, monitor.LINKED), (monitor.BASE_BENT, monitor.BENT),
                (monitor.BASE_FIELD, monitor.FIELD), (monitor.BASE_ANCHORED, monitor.ANCHORED),
                (monitor.BASE_CONTACT, monitor.CONTACT), (monitor.BASE_HEIGHT, monitor.HEIGHT)):
            numbers[base] = numbers[part]
        self.base = (
            self.kinetic + self.stored + self.height
            - self.work + self.spent)
        # What the forces at the start can set free, at least: health checks may find the fabric
        # back where it began. Forces without bounds end the run where the step is chosen.
        self.scale = 0.5 * squares / rate**2 if 0.0 < rate < math.inf else 0.0
        self.floor = self._least_floor = 0.5 * speed**2 * self.bodies * (
            mass / self.inverse_size + inertia)
        self.worst = self.error = 0.0
        monitor.balance(numbers)

    def allow(self, errors: float, rate: float) -> bool:
        """
        Raise the floor if `errors` of the method explain that of the balance; return True if so.

        Errors are positions over a, angles, and velocities over the largest frequency `rate`
        [rad/s]. With |dy|^2 = errors^2 (M a^2 + Lambda) for each body, y mass-scaled, an energy E
        changes by at most W sqrt(2 E) |dy| + W^2 |dy|^2 / 2. This applies to small motion only,
        where the change is a relevant fraction of E without a fault.
        """
        masses = self._packed.masses
        inertia = float(masses.mass.mean() / self.inverse_size + masses.inertia.mean())
        moved = rate * errors * math.sqrt(self.bodies * inertia)
        explained = moved * math.sqrt(2.0 * self.scale) + 0.5 * moved**2
        error = abs(self.error)
        if not (error <= explained and self.limit > 0.0 and (
                self.scale <= _SMALL_ENERGY_RATIO * self.floor)):
            return False
        self.floor = max(self.floor, _FLOOR_MARGIN_RATIO * error)
        return True

    def allow_rounding(self, loads: Loads, model: Model, span: float) -> None:
        """
        Allow for round-off of the energy that `loads` may move in a `span` [s].

        A motion that starts and stops between two health checks leaves no other trace.
        """
        rate, masses = force_rate(loads, model, 1.0 / math.sqrt(self.inverse_size)), (
            self._packed.masses)
        speed = rate * rate * span  # velocities over a, and spins
        inertia = float(masses.mass.max() / self.inverse_size + masses.inertia.max())
        energy = 0.5 * self.rounding * self.bodies * inertia * speed * speed
        if energy < math.inf:
            self.floor = max(self.floor, energy)

    def keep_work(self, loads: Loads) -> None:
        """Add the work of loads that are about to be replaced."""
        self.earlier_work += math.fsum(loads.work)

    def state_tree(self) -> dict[str, Any]:
        """Return all numbers, except those that only describe one kernel call."""
        numbers = self.numbers.copy()
        numbers[monitor.SAVED_AT] = -1.0
        return {'numbers': numbers}

    def load_state(self, tree: StateTree) -> None:
        """Restore the values from a checkpoint, with limit and size of the scene."""
        kept = [
            monitor.LIMIT, monitor.INVERSE_SIZE, monitor.DEEPEST_LIMIT, monitor.BODIES,
            monitor.ROUNDING, *_CONSTANTS]
        numbers = tree.array('numbers', self.numbers.shape).copy()
        numbers[kept] = self.numbers[kept]
        if not 0.0 <= numbers[monitor.REGULAR] < math.inf:
            raise ValueError('numbers must count the steps of one length')
        # It may have been raised on the way there, but not since.
        numbers[monitor.FLOOR] = max(numbers[monitor.FLOOR], self._least_floor)
        np.copyto(self.numbers, numbers)

    @property
    def balance(self) -> EnergyBalance:
        """Energy balance at the last health check."""
        return EnergyBalance(
            self.error, float(monitor.least_scale(self.numbers)), self.worst,
            self.work, self.limit)

    def describe_imbalance(self, time: float) -> str:
        """Return a sentence on an energy that does not balance at `time` [s]."""
        balance = self.balance
        return (
            f'the energy does not balance at t = {time:.9g} s: an error of {balance.error:.3g} J, '
            f'{abs(balance.error) / balance.scale:.3g} of the largest energy that moved, was '
            f'exchanged or put in ({balance.scale:.3g} J), is above solver.energy_limit '
            f'{balance.limit:.3g}')


def _constants(model: Model) -> tuple[float, ...]:
    """Return the numbers of a ledger that depend on the model alone."""
    masses = model.masses, model.inverse_mass, model.inverse_inertia
    gravity = 0.0 if model.gravity is None else math.sqrt(
        sum(part * part for part in model.gravity.acceleration.tolist()))
    return (
        *units_of(*masses), *largest_of(*masses), gravity,
        0.0 if model.dipole is None else model.dipole.largest)
