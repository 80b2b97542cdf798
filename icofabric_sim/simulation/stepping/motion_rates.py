# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Rates of the motion: the largest frequency, the stability limit, the fastest term."""

from collections.abc import Callable
from dataclasses import replace
from enum import Enum
import math

from icofabric_sim.simulation.model.stability import (
    fastest_motion,
    Frequency,
)
from icofabric_sim.simulation.stepping.contact_scheduler import ContactScheduler
from icofabric_sim.simulation.stepping.faults import fastest_term, stiffest_term, unsafe_step
from icofabric_sim.simulation.stepping.method_calls import MethodCalls
from icofabric_sim.simulation.stepping.trajectory import Start, Trajectory
import numpy as np

# A step below this part of the stability limit would never come to an end.
_SHORTEST_STEP = 1e-9


class Term(Enum):
    """Term of the motion that may have the largest rate."""

    FABRIC, SPIN, LOADS, LOSSES, CONTACTS = range(5)


class MotionRates:
    """Rates [rad/s] that steps must resolve, in the configuration examined last."""

    def __init__(
        self, trajectory: Trajectory, contact: ContactScheduler, calls: MethodCalls,
        start: Start, pulse_step: Callable[[], float]
    ) -> None:
        """Start at `start`; `pulse_step` returns the longest step [s] that resolves the loads."""
        self._trajectory, self._contact, self._calls = trajectory, contact, calls
        # The largest frequency of the fabric alone, and the rate of the loads alone.
        self.fabric, self.load_rate = start.frequency, start.load_rate
        self.pulse_step = pulse_step

    @property
    def frequency(self) -> Frequency:
        """Largest frequency, with an upper bound of the contribution of contacts."""
        if self._contact.phase.rate == 0.0:
            return self.fabric
        return self.fabric._replace(rate=math.sqrt(self.fabric.rate**2 + self._contact.phase.rate))

    @property
    def limit(self) -> float:
        """Stability limit of the step [s]."""
        trajectory = self._trajectory
        rate = self.frequency.rate + trajectory.packed.velocity_rate + (
            self._contact.phase.velocity_rate)
        return trajectory.method.stability / rate if rate > 0.0 else math.inf

    def measure(self) -> None:
        """Compute the largest frequency of the fabric again."""
        self.fabric = self._calls.frequency()

    def fastest(self, *, contacts: bool = True, losses: bool = True) -> float:
        """
        Return the rate [rad/s] of the fastest motion; 0 without motion or acceleration.

        `contacts` includes their frequency, `losses` the rates of dissipative forces.
        """
        trajectory, phase = self._trajectory, self._contact.phase
        frequency = self.frequency if contacts else self.fabric
        packed = trajectory.packed if losses else replace(
            trajectory.packed, velocity_rate=0.0)
        rate = fastest_motion(
            packed, trajectory.velocity_spread, frequency.rate, trajectory.ledger.spin,
            self.load_rate, phase.passing, phase.fall)
        return rate if rate > 0.0 else self._acceleration_rate()

    def _acceleration_rate(self) -> float:
        """
        Return the rate [rad/s] at which forces move resting bodies by a or rotate them by 1 rad.
        """
        trajectory = self._trajectory
        with trajectory.evaluations.estimating():
            trajectory.refresh()
        acceleration = trajectory.packed.layout.gather(trajectory.work.acceleration)
        linear, angular = np.linalg.norm(acceleration.reshape(-1, 2, 3), axis=2).max(
            axis=0, initial=0.0)
        return math.sqrt(max(float(linear) / trajectory.half_edge, float(angular)))

    def fastest_term(self) -> str:
        """Return the name of the fastest motion or vibration, with its parameters."""
        return fastest_term(self._terms())

    def fastest_kind(self) -> Term:
        """Return the term that moves or vibrates fastest."""
        kinds = (Term.FABRIC, Term.SPIN, Term.LOADS, Term.LOSSES, Term.CONTACTS)
        rates = tuple(self._terms().values())
        return kinds[max(range(len(rates)), key=rates.__getitem__)]

    def fastest_bodies(self) -> tuple[int, ...]:
        """Return the bodies with the largest amplitudes in the fastest vibration of the fabric."""
        return self._calls.frequency(locate=True).bodies

    def _terms(self) -> dict[str, float]:
        """Return rates [rad/s] by the names of their terms, in the order of `Term`."""
        trajectory, contact = self._trajectory, self._contact
        rates = {
            stiffest_term(trajectory.packed, anchored=trajectory.loads.anchors is not None): (
                self.fabric.rate),
            'spinning bodies': trajectory.ledger.spin,
            'bodies under loads and drives': self.load_rate,
            'what takes energy from velocities (damping, Maxwell arms, drag, magnetic field)': (
                trajectory.packed.velocity_rate)}
        if contact.phase.is_possible:
            rates[f'contacts (contact.stiffness {contact.phase.stiffness:.4g} N/m)'] = math.sqrt(
                contact.phase.rate)
        return rates

    def require_possible(self, step: float) -> None:
        """Raise ValueError for a given `step` [s] that is too long or far too short."""
        if self.limit < math.inf and not step >= _SHORTEST_STEP * self.limit:
            raise ValueError(
                f'solver.step {step!r} s is too short to come to an end with: the stability '
                f'limit is {self.limit:.6g} s; choose a longer one, or 0 to have it chosen'
            )
        if not step <= self.limit:
            rate = self.fabric.rate + self._trajectory.packed.velocity_rate
            raise ValueError(
                f'solver.step {step!r} s is beyond the stability limit '
                f'{self.limit:.6g} s of the method in this scene (largest frequency '
                f'{rate:.6g} rad/s); choose a smaller one, or 0 to have it chosen'
            )

    def require_stable(self, time: float) -> None:
        """End the run at `time` [s] if a given step exceeds the stability limit."""
        trajectory, contact = self._trajectory, self._contact
        step = trajectory.step
        if not trajectory.is_given or step <= self.limit:
            return
        if contact.phase.is_possible and step <= trajectory.method.stability / max(
                self.fabric.rate + trajectory.packed.velocity_rate, 1e-300):
            trajectory.fail(
                f'solver.step {step!r} s is too long for present or possible contacts from t = '
                f'{time:.9g} s on: with a contact stiffness of {contact.phase.stiffness:.4g} '
                f'N/m the stability limit is {self.limit:.6g} s; start again with a smaller step, '
                'with 0 to have it chosen, or with a smaller contact.stiffness; contact.mode '
                'never lets shells pass through each other')
        trajectory.fail(unsafe_step(step, self.limit, self._calls.frequency(locate=True), time))
