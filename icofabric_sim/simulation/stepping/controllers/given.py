# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A given step, whose error is measured.

The time until the next measurement depends on its effect on the sum of errors, and on the duration
of the motion so far.
"""

import math

from icofabric_sim.kernels.integrators.splitting import NEVER
from icofabric_sim.simulation.model.layout import has_jumps
from icofabric_sim.simulation.stepping.pieces import Pieces, StepChoice, StepController

# Most shortest periods until the next measurement, which only serves reports.
_LARGEST_GAP = 128
# Number of intervals of the motion so far, each with a measurement: errors of high order vary
# tenfold within a few periods. For smooth motion of constant energy, half of them suffice.
_PARTS, _SMOOTH_PARTS = 4, 2
# Number of steps in three periods above which only a quarter of a period is measured at first.
_LONG_PERIOD = 15

RANK = 0


def suits(choice: StepChoice) -> bool:
    """Return True if the step is given and steps have equal length."""
    return choice.given > 0.0 and not choice.embedded


def make(pieces: Pieces, choice: StepChoice) -> 'GivenStep':
    """Return the controller; raise ValueError if the step is too long or far too short."""
    pieces.rates.require_possible(choice.given)
    return GivenStep(pieces)


class GivenStep(StepController):
    """Steps of `solver.step`."""

    held_back = False

    def __init__(self, pieces: Pieces) -> None:
        """Keep the step of the trajectory."""
        self._pieces = pieces
        if pieces.trajectory.method.runs_through_contacts:
            # Only pairs in contact contribute to the frequency.
            pieces.contact.phase.counts_listed = False
            pieces.contact.phase.lists_by_few_axes = True

    def outlook(self) -> tuple[float, float]:
        """
        Return the step, and the number of steps ahead: one, or more if they run through contacts.
        """
        pieces = self._pieces
        method, step = pieces.trajectory.method, pieces.trajectory.step
        # A step too long for contacts ends the run just before a contact, and no sooner.
        through = method.runs_through_contacts and (
            step * math.sqrt(pieces.contact.phase.least_rate) <= method.stability)
        return step, float(pieces.monitor.search_interval) if through else 1.0

    def propose(self, *, probe: bool, shorter: float) -> float:
        """Return the step, and measure its error if due and requested."""
        pieces, errors = self._pieces, self._pieces.errors.probe
        if not pieces.errors.is_estimated:
            errors.checks_left = NEVER
            return pieces.trajectory.step
        fastest, step = pieces.rates.fastest(), pieces.trajectory.step
        errors.follow_forces()
        is_new = errors.is_new or pieces.rates.load_rate > errors.load_rate
        if not errors.reads_differences:
            if probe or is_new:
                if not probe:
                    pieces.trajectory.save()
                self._measure(fastest, jumped=not probe)
        elif is_new or (probe and pieces.trajectory.ledger.rough < 0.0 and errors.may_measure):
            if not probe:
                pieces.trajectory.save()
            self._measure_briefly(fastest)
        else:
            errors.read_differences(step, fastest)
            if probe:
                errors.checks_left = NEVER
        return step

    def follow_jump(self) -> bool:
        """Request a measurement of the error, as loads may be faster."""
        return True

    def _measure_briefly(self, fastest: float) -> None:
        """Measure the error until health checks compute it from differences."""
        errors, rates = self._pieces.errors.probe, self._pieces.rates
        step = self._pieces.trajectory.step
        errors.begin()
        # A load and its errors may last a few steps only.
        is_pulse = rates.load_rate > rates.fabric.rate
        error = errors.measured(
            min(step, rates.pulse_step()), fastest, given=True, brief=not is_pulse,
            least=self._pieces.monitor.interval if is_pulse else 1)
        before = errors.present_rate
        if math.isnan(error):
            error = before
        errors.read_differences(step, fastest, error if errors.is_new else max(error, before))
        errors.is_new = False
        # Inputs may cut steps so often that no difference becomes known.
        errors.checks_left = errors.checks_to_difference(self._pieces.monitor.interval)

    def _measure(self, fastest: float, *, jumped: bool) -> None:
        """Measure the error of the step; `jumped` means that loads are new."""
        errors, rates = self._pieces.errors.probe, self._pieces.rates
        step = min(self._pieces.trajectory.step, rates.pulse_step())
        method = self._pieces.trajectory.method
        errors.begin()
        if errors.is_new or jumped:
            errors.gap = 1
        interval = self._pieces.monitor.interval
        steps = errors.steps_of_period(step, fastest)
        # At first as far as the next health check, so that nothing is missed of how a motion
        # begins. Kinks come so often that less will do.
        has_kinks = has_jumps(self._pieces.trajectory.model.links)
        is_long = errors.gap == 1 and (not has_kinks or self._pieces.errors.touching is not None)
        error = errors.measured(
            step, fastest, least=interval if is_long else 1, given=True,
            brief=jumped and not is_long and 3 * steps > _LONG_PERIOD)
        if math.isnan(error):
            error = errors.rate
        change = errors.add(errors.free_rate if jumped else error)
        # Not before the end of the measured window.
        unit = interval * step
        first = max(math.ceil(min(errors.span / unit, steps)), 1)
        errors.pace(
            math.inf if jumped else change, first=first,
            largest=max(_LARGEST_GAP * steps // interval, first), unit=unit,
            part=_SMOOTH_PARTS if errors.is_smooth and method.symplectic else _PARTS)
        errors.end(error)
        errors.checks_left = errors.gap
        errors.is_new = False
