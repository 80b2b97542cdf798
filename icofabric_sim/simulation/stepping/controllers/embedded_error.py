# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Adaptive steps, whose length follows the error estimate of the embedded Runge-Kutta pair.

The kernel accepts or rejects each step (kernels/integrators/embedded.py); this module sets the
criteria. A given step is kept, apart from steps that an event ends.
"""

import math

from icofabric_sim.kernels.integrators.embedded import ANY
from icofabric_sim.kernels.integrators.splitting import NEVER
from icofabric_sim.simulation.model.layout import has_jumps, has_tables
from icofabric_sim.simulation.stepping.embedded_control import EmbeddedControl
from icofabric_sim.simulation.stepping.faults import too_fast
from icofabric_sim.simulation.stepping.pieces import Pieces, StepChoice, StepController
import numpy as np

# Tolerance per radian of the fastest motion above which steps are so long that the estimate of
# their error may be three times too small; the estimate is then limited by the second ratio.
_LOOSE, _LOOSE_AIM = 1e-6, 0.3
# The estimate may be too small, too, in a step with a kink of a tension: errors of whole runs were
# up to 1.9 times the tolerance. The limit stays above round-off times the second number, because
# no step is short enough close to round-off.
_KINKED_AIM, _ABOVE_ROUNDING = 0.4, 10.0
# Angle [rad] of the fastest motion in the first step after a jump; later, the error decides.
_FIRST_STEP = 0.5
# Shortest step over the first one.
_SHORTEST_PART = 1e-9
# Largest angle [rad] of a step with possible contacts. A contact that starts and ends between two
# force evaluations, up to 0.27 of a step apart, is not detected; so its depth is at most about a
# hundredth of the amplitude of bodies.
_CLOSE_STEP = 1.0
# Squared angle of a contact with a kink, over the tolerance per radian, and its maximum.
_KINK, _LARGEST_KINK = 1e3, 1e-4
# Number of steps ahead that a search for contacts covers.
_AHEAD = 6.0
# A step across a jump of a force may err by the tolerance of this angle [rad] of the fastest
# motion. With a whole period, smooth steps would use this reserve, too.
_SPARE = 0.1
# Round-off of contact forces in the estimate of the error, over a coordinate.
_NOISE_RATIO = 0.25 * float(np.finfo(float).eps)
# Largest ratio of noise to the tolerance: at a ratio of 2.5, no step was short enough, and steps
# shrank to 1e-11 s.
_LARGEST_NOISE = 0.5

RANK = 0


def suits(choice: StepChoice) -> bool:
    """Return True if the kernel accepts or rejects each step."""
    return choice.embedded


def make(pieces: Pieces, choice: StepChoice) -> 'EmbeddedError':
    """Return the controller; raise ValueError if step or tolerance are impossible."""
    if choice.given > 0.0:
        pieces.rates.require_possible(choice.given)
    else:
        pieces.errors.probe.require_possible(pieces.rates.fabric.rate)
    return EmbeddedError(pieces, choice)


class EmbeddedError(StepController):
    """Criteria by which the kernel accepts a step, and the length of the first step."""

    held_back = False

    def __init__(self, pieces: Pieces, choice: StepChoice) -> None:
        """Write the criteria to the control of the trajectory."""
        self._pieces, self._given = pieces, choice.given
        self._output_period = choice.output_period
        # Steps do not depend on additional pairs in the list.
        pieces.contact.phase.lists_by_few_axes = True

    @property
    def _control(self) -> EmbeddedControl:
        control = self._pieces.trajectory.control
        assert control is not None
        return control

    def outlook(self) -> tuple[float, float]:
        """Return the step before contacts, as the motion allows, and the number of steps ahead."""
        trajectory, contact = self._pieces.trajectory, self._pieces.contact
        if self._given > 0.0:
            return trajectory.step, 1.0
        step = trajectory.method.chosen / math.sqrt(contact.phase.least_rate)
        return max(step, min(self._control.next, self._control.close)), _AHEAD

    def propose(self, *, probe: bool, shorter: float) -> float:
        """Return the given step, or the first step of a motion; later, the error decides."""
        pieces, control = self._pieces, self._control
        trajectory, contact = pieces.trajectory, pieces.contact
        first = self._first_step()
        # Candidate pairs must not matter: steps do not depend on searches.
        rate = pieces.rates.fastest(contacts=False)
        if control.next == 0.0:
            control.next = first
        tolerance = pieces.errors.probe.tolerance
        control.tolerance = tolerance * (_LOOSE_AIM if tolerance > _LOOSE * rate else 1.0)
        if self._has_kinks:
            least = _ABOVE_ROUNDING * pieces.errors.probe.floor(rate)
            control.tolerance = min(
                control.tolerance, max(_KINKED_AIM * tolerance, least))
        control.shortest = first * _SHORTEST_PART
        control.longest = ANY
        control.close = 0.0
        if contact.phase.is_possible:
            # Implicit steps do not resolve decaying motion, after which bodies are slow.
            followed = rate if not trajectory.method.implicit else pieces.rates.fastest(
                contacts=False, losses=False)
            control.close = _CLOSE_STEP / followed if followed > 0.0 else ANY
        control.kinked = self._kinked_rate(rate)
        # Around shells, the geodesic may change to the other side.
        rate = rate or 1.0 / self._output_period
        control.spare = 0.0 if trajectory.model.wrapping is None else _SPARE / rate
        size, fastest = trajectory.half_edge**-2, rate**-2
        control.scales[:] = size, 4.0 if trajectory.state.orientation.ndim == 2 else 0.5, (
            size * fastest), fastest
        self.follow_contacts()
        trajectory.ledger.high, trajectory.ledger.low = math.inf, 0.0
        pieces.errors.probe.checks_left = NEVER
        self._keep_given()
        return self._given or trajectory.step or first

    def follow_contacts(self) -> bool:
        """
        Set limits of steps at first contact, where forces have a kink; return False.

        In a step of length h with a kink, a velocity v errs by about (w h)^2 v, with the frequency
        w of the contact. At the length below, this is less than the fraction of a that the
        tolerance allows in a few hundred radians of w. Round-off of positions causes noise in
        large forces.
        """
        control, contact = self._control, self._pieces.contact
        control.kink = control.floor = control.resume = 0.0
        if self._pieces.trajectory.model.wrapping is not None:
            # A jump of force in such a short step is no reason to stop.
            control.kink = control.shortest
        if not contact.phase.is_possible:
            return False
        # Independent of earlier contacts: steps must not depend on searches.
        rate = math.sqrt(contact.phase.least_rate)
        part = min(_KINK * control.tolerance / rate, _LARGEST_KINK)
        control.kink = max(control.kink, math.sqrt(part) / rate)
        # Such a short step is always accepted: it must not count as too short before.
        control.shortest = min(control.shortest, control.kink)
        # Estimated step in a contact.
        control.resume = _FIRST_STEP / rate
        if contact.phase.rate > 0.0:
            trajectory = self._pieces.trajectory
            extent = trajectory.extent
            noise = contact.phase.stiffness * trajectory.model.inverse_mass * extent
            # In the measure of errors of velocities.
            noise *= _NOISE_RATIO * math.sqrt(control.scales[2])
            if noise > _LARGEST_NOISE * control.tolerance:
                control.floor = noise / _LARGEST_NOISE
                contact.note_rounding(extent, control.floor)
        return False

    def follow_jump(self) -> bool:
        """Start the next step without data of the last one, at most as long as a first step."""
        control = self._control
        control.has_last = 0.0
        control.next = min(control.next, self._first_step())
        self._keep_given()
        return False

    def _keep_given(self) -> None:
        """Accept every error of a given step, and limit steps to this length."""
        if self._given > 0.0:
            control = self._control
            control.tolerance = ANY
            control.longest = control.next = self._given
            # Of the given length, even with possible contacts.
            control.close = self._given if self._pieces.contact.phase.is_possible else 0.0

    def _first_step(self) -> float:
        rates, time = self._pieces.rates, self._pieces.trajectory.time
        # Without candidate pairs, as above: a first step with too large an error is rejected.
        rate = rates.fastest(contacts=False)
        if not rate < math.inf:
            self._pieces.trajectory.fail(too_fast(time, rates.fastest_term()))
        # The rate of a body force is unknown, and far ahead it may not be finite.
        longest = self._output_period if rate == 0.0 or (
            self._pieces.trajectory.packed.external is not None) else math.inf
        return min(_FIRST_STEP / rate, longest) if rate > 0.0 else longest

    @property
    def _has_kinks(self) -> bool:
        """True if tensions have kinks, or jump where wrapped connectors change their path."""
        model = self._pieces.trajectory.model
        links = model.links
        return has_jumps(links) or model.wrapping is not None or has_tables(links)

    def _kinked_rate(self, rate: float) -> float:
        """
        Return the squared rate [1/s^2] of the fastest motion if forces may have kinks; else 0.
        """
        model, contact = self._pieces.trajectory.model, self._pieces.contact
        if not contact.phase.is_possible and model.wrapping is None and not self._has_kinks:
            return 0.0
        # With any possible contact: estimates must not depend on searches, either.
        return rate * rate + contact.phase.least_rate
