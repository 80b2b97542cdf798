# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Steps of one length, as long as stability and the tolerance allow.

Their error is measured (accuracy_probe.py) at the start of a motion, after changes, and from time
to time. Between measurements, a step is kept while its error is about right.
"""

import math

from icofabric_sim.simulation.contact.broad_phase import LOOK_AFTER
from icofabric_sim.simulation.model.layout import has_jumps
from icofabric_sim.simulation.stepping.accuracy_probe import TARGET_RATIO
from icofabric_sim.simulation.stepping.energy_swing import longest_ratio
from icofabric_sim.simulation.stepping.faults import too_fast
from icofabric_sim.simulation.stepping.method_selection import longest_at_kinks
from icofabric_sim.simulation.stepping.methods import Method
from icofabric_sim.simulation.stepping.pieces import Pieces, StepChoice
import numpy as np

# Step times frequency over the largest one of the method: above the first the step is shortened,
# below the second lengthened.
_MAX_STEP_RATIO, _MIN_STEP_RATIO = 1.25, 0.4
# The exact frequency is computed again once its bound has grown by the first ratio, and if steps
# exceed the second ratio to the limit of the method.
_GROWN, _NEAR_LIMIT_RATIO = 1.1, 0.9
# Range of the measured error rate over the tolerance in which a step is kept.
_MAX_ERROR_RATIO, _MIN_ERROR_RATIO = 0.4, 0.02
# Number of shortest periods until the next measurement, which takes three: first and largest.
_FIRST_GAP, _LARGEST_GAP = 2, 64
# The same if contacts keep steps short, whose errors are measured after the steps.
_LARGEST_GAP_HELD = 512
# Number of intervals of the motion so far, each with a measurement.
_PARTS = 2
# The largest gap if inputs are so frequent that the roughness of the motion is unknown.
_LARGEST_BLIND_GAP = 16
# A measurement is due early if the roughness of the motion has grown by this ratio, and so far
# that the error may exceed the tolerance.
_ROUGHER = 1.5
# Limits of the ratio of a change of the step, and most changes until it is accurate enough.
_LARGEST_CHANGE = 0.1, 4.0
_MAX_TRIAL_COUNT = 8
# An error that does not decrease with the step is round-off up to this ratio to its floor; above,
# the step was so long that it skipped curved parts of the motion.
_ROUNDINGS = 1e4

# Product of step and the bound of a contact's frequency for methods that run through contacts: at
# most, from the second tolerance [1/s] on; and the largest square of that with what touches, as
# stiff as it is: 4 is the limit of stability. Where collisions lose energy the balance errs by a
# part of that, as the square of the step, 0.01 of it with 1.0. So steps become shorter from a
# quarter of its limit on, and longer by the last factor once what moves is below the part before
# that of its scale.
_CONTACT, _LOOSE, _STABLE, _CALM, _CALMER = 0.8, 0.1, 2.9, 0.0625, 1.75
# Stiffer contacts shorten the step by powers of the first ratio; a step below the second ratio to
# the one that contacts allow becomes longer. So a single contact rarely changes the step.
_FEWER, _RELAXED = 2.0**-0.25, 0.8
# Health checks that a search covers there: a search takes as long as some thousand tests of
# separated pairs.
_SEARCHED = 3.0
# The same if more pairs than the second number are listed: separated pairs then cost more than
# searches, because they exceed the cache.
_SEARCHED_IN_CROWDS, _CROWD = 1.0, 4_000
# A face that hits a face comes near the bound of the frequency, and its energy swings by up to
# 0.01 of the largest at so many times the step at which that of a vibration at the bound swings
# by half of that (measured over phases of drops at 3 m/s). No collision asks for shorter steps.
_FACES = 2.5
# Collisions whose energy oscillates by more than the first fraction of the limit of the balance
# are repeated with half of the step. Below the second fraction of that, steps are doubled.
_SWINGS, _SWUNG = 0.25, 0.5
# No limit: the value is only recorded.
_ANY = 1e300
# Where slopes of connectors jump, methods that mend kinks add up to _DRIFT * ratio^_DRIFT_ORDER
# of the energy for each radian of the fastest vibration: measured for stiffness ratios from 1.25
# to 50, whatever the size and the amplitude (docs/decisions/kinks.md). With srkn8 it strays at
# random, by up to _STRAY * ratio^2 times the square root of the radians.
_DRIFT, _DRIFT_ORDER, _STRAY = 1.5e-6, 5.5, 1.4e-4
# Radians in which the first steps may use up half of the limit; the least part of these steps
# that is left as that comes near.
_RADIANS, _LEAST_PART = 1e4, 0.2

RANK = 0


def _largest_ratio(method: Method, energy_limit: float) -> float:
    """
    Return step times frequency at which the energy oscillates by half of its limit.

    The energy of a vibration with leapfrog oscillates by a fraction (w h)^2 / 4, whatever the
    tolerance.
    """
    if method.implicit or not energy_limit > 0.0:
        return math.inf
    if method.order <= 2:
        return math.sqrt(2.0 * energy_limit)
    if not method.symplectic:
        return math.inf
    return longest_ratio(method.kicks, method.drifts, method.chosen, 0.5 * energy_limit)


def _largest_ratio_at_kinks(method: Method, energy_limit: float, error: float) -> float:
    """
    Return step times frequency for which energy errors at kinks stay within half of the limit.

    The tolerance of small motion may require nothing, but the relative drift does not depend on
    amplitude. `error` is the present relative error of the balance. Steps shorten as the error
    grows, so that long runs continue.
    """
    if method.order <= 2 or not energy_limit > 0.0:
        return math.inf
    half = 0.5 * energy_limit
    if method.mends_kinks:
        ratio = (half / (_DRIFT * _RADIANS)) ** (1.0 / _DRIFT_ORDER)
    else:
        ratio = math.sqrt(half / (_STRAY * math.sqrt(_RADIANS)))
    return ratio * max(1.0 - error / half, _LEAST_PART)


def suits(choice: StepChoice) -> bool:
    """Return True if the step is chosen and steps have equal length."""
    return not choice.given > 0.0 and not choice.embedded


def make(pieces: Pieces, choice: StepChoice) -> 'MeasuredStep':
    """Return the controller; raise ValueError if the tolerance is below round-off."""
    pieces.errors.probe.require_possible(pieces.rates.fabric.rate)
    return MeasuredStep(pieces, choice.output_period)


class MeasuredStep:
    """The longest step that the tolerance allows, as measured."""

    def __init__(self, pieces: Pieces, output_period: float) -> None:
        """Use steps of `output_period` [s] if no time scale is known."""
        self._pieces, self._output_period = pieces, output_period
        self.held_back = False
        self._runs_through = pieces.trajectory.method.runs_through_contacts
        if self._runs_through:
            # Only pairs in contact contribute to the frequency.
            pieces.contact.phase.counts_listed = False
            pieces.contact.phase.lists_by_few_axes = True

    def outlook(self) -> tuple[float, float]:
        """Return the step for contacts, stiffer than the fabric, and the number of steps ahead."""
        method = self._pieces.trajectory.method
        if self._runs_through:
            listed = self._pieces.contact.phase.contacts
            crowd = listed is not None and len(listed.pairs) > _CROWD
            searched = _SEARCHED_IN_CROWDS if crowd else _SEARCHED
            return self._contact_step(), searched * self._pieces.monitor.search_interval
        return (
            method.chosen / math.sqrt(self._pieces.contact.phase.least_rate),
            LOOK_AFTER / method.stages)

    def propose(self, *, probe: bool, shorter: float) -> float:
        """Return a stable and accurate step: the present one if suitable."""
        pieces = self._pieces
        trajectory, rates, errors = pieces.trajectory, pieces.rates, pieces.errors.probe
        errors.follow_forces()
        rate = rates.fastest()
        if not rate < math.inf:
            trajectory.fail(too_fast(trajectory.time, rates.fastest_term()))
        method, ledger = trajectory.method, trajectory.ledger
        chosen = min(method.chosen, _largest_ratio(method, ledger.limit))
        if has_jumps(trajectory.packed.model.links):
            chosen = min(chosen, _largest_ratio_at_kinks(
                method, ledger.limit, ledger.balance.error_in_parts))
        step = trajectory.step * shorter ** (-1.0 / trajectory.order)
        if not rate > 0.0:
            # Steps of any length are exact.
            step, rate = self._output_period, chosen / self._output_period
        cap = chosen / rate
        through = self._runs_through and pieces.contact.phase.rate > 0.0
        contact = math.inf
        if through:
            free, contact = rates.fastest(contacts=False), self._contact_step()
            cap = min(chosen / free if free > 0.0 else math.inf, contact)
        longest, stable = pieces.contact.phase.longest_step, cap
        self.held_back = longest < cap
        cap = min(cap, longest, self._longest_at_kinks())
        least, most = (_RELAXED, 1.0) if cap == contact else (_MIN_STEP_RATIO, _MAX_STEP_RATIO)
        if not least * min(cap, errors.step) <= step <= most * cap:
            step = rounded_down(min(cap, errors.step))
        # Steps limited by later contacts provide no information on longer ones.
        longer = not through and step > _MAX_STEP_RATIO * errors.measured_step
        jumped = errors.is_new or longer or rates.load_rate > errors.load_rate
        if probe and not jumped and not shorter > 1.0 and self._may_wait:
            # Measured again after enough steps of the run.
            errors.checks_left = -(-errors.steps_to_measure // pieces.monitor.interval_with(step))
            ledger.rough_limit = max(ledger.rough_limit, _ROUGHER * ledger.rough)
        elif probe or jumped:
            if not probe:
                trajectory.save()
            allowed = rounded_down(cap)
            if errors.reads_differences:
                step = self._follow_differences(
                    step, allowed, rate, jumped=not probe, excess=shorter)
            else:
                step = self._measure(
                    step, allowed, rate, jumped=not probe, held=cap == contact)
        if through:
            ledger.swing, ledger.swing_limit = 0.0, self._largest_swing
            if step * math.sqrt(pieces.contact.phase.least_rate) <= self._contact_ratios[1]:
                # As short as any collision requires.
                ledger.swing_limit = _ANY
        if not trajectory.time + step > trajectory.time:
            # The step would vanish by round-off when added to the time.
            trajectory.fail(too_fast(trajectory.time, rates.fastest_term()))
        # The exact frequency is computed again once its bound exceeds the first value; near
        # the limit of the method at every health check.
        near = min(_GROWN * ledger.rate, _NEAR_LIMIT_RATIO * method.stability / step)
        ledger.high = max(_MAX_STEP_RATIO * chosen / step, near)
        # The bound of the frequency at health checks excludes contacts. A lower bound does not
        # lengthen steps that later contacts or crossings keep short.
        follows = errors.step >= cap and not through and not cap < stable
        ledger.low = _MIN_STEP_RATIO * chosen / step if follows else 0.0
        return step

    def _contact_step(self) -> float:
        """Return a step [s] that runs through contacts."""
        contact = self._pieces.contact
        most, least = self._contact_ratios
        ratio = max(most * self._pieces.trajectory.ledger.swing_part, least)
        step = ratio / math.sqrt(contact.phase.least_rate)
        while step * step * contact.phase.rate > _STABLE:
            step *= _FEWER
        return step

    @property
    def _contact_ratios(self) -> tuple[float, float]:
        """Longest and shortest step for collisions, times the bound of the contact frequency."""
        pieces = self._pieces
        trajectory, ledger = pieces.trajectory, pieces.trajectory.ledger
        most = _CONTACT * math.sqrt(min(pieces.errors.probe.tolerance / _LOOSE, 1.0))
        least = min(most, _FACES * _largest_ratio(trajectory.method, ledger.limit))
        if ledger.kinetic + ledger.contact < _CALM * ledger.scale:
            most *= _CALMER
        if ledger.limit > 0.0:
            left, wanted = 1.0, 1.5 - 2.0 * ledger.balance.error_in_parts / ledger.limit
            while left > wanted and left * most > least:
                left *= _FEWER
            most *= left
        return max(most, least), least

    @property
    def _largest_swing(self) -> float:
        """Relative energy oscillation that contacts may cause in a step."""
        limit = self._pieces.trajectory.ledger.limit
        return _SWINGS * limit if limit > 0.0 else _ANY

    def _longest_at_kinks(self) -> float:
        """
        Return the longest step [s] for later crossings of slack connectors, unseen in the motion.
        """
        pieces = self._pieces
        trajectory, rates = pieces.trajectory, pieces.rates
        packed, frequency = trajectory.packed, rates.fabric.rate
        if trajectory.method.implicit or not (
                frequency > 0.0 and has_jumps(packed.model.links)):
            return math.inf
        # Bodies with a common motion have no crossing.
        speed = self._pieces.calls.relative_speed() / trajectory.half_edge
        # And the speed gained within a radian of the fastest vibration.
        acceleration = rates.load_rate**2
        if packed.gravity is not None and packed.held:
            acceleration += float(np.linalg.norm(packed.gravity)) / trajectory.half_edge
        liveliness = max(speed + acceleration / frequency, trajectory.ledger.spin)
        tolerance = pieces.errors.probe.tolerance
        return longest_at_kinks(trajectory.method, tolerance, liveliness) / frequency

    @property
    def _may_wait(self) -> bool:
        """True if a measurement at kinks or tables is too expensive now, and not urgent."""
        trajectory, errors = self._pieces.trajectory, self._pieces.errors.probe
        ledger, model = trajectory.ledger, trajectory.model
        if errors.is_smooth or errors.reads_differences or not (
                model.contacts is None and model.wrapping is None):
            return False
        pressing = ledger.kinetic > ledger.lively or (
            _MAX_ERROR_RATIO * ledger.rough > ledger.rough_limit)
        return not (pressing or errors.may_measure)

    def excess(self) -> float | None:
        """
        Return the probable ratio of the error to the tolerance after rougher motion.

        None where this is the first time that roughness is known.
        """
        ledger = self._pieces.trajectory.ledger
        if ledger.rough_limit == 0.0:
            self._expect(ledger.rough)
            return None
        return _MAX_ERROR_RATIO * ledger.rough / ledger.rough_limit

    def follow_contacts(self) -> bool:
        """Return True: another step is proposed."""
        return True

    def follow_touching(self) -> bool:
        """Return True if moving contacts require a shorter or permit a longer step."""
        ledger = self._pieces.trajectory.ledger
        allowed = self._largest_swing * ledger.balance.scale
        if ledger.swing_part < 1.0 and 4.0 * ledger.swing <= _SWUNG * allowed:
            ledger.swing_part *= 2.0
        ledger.swing = 0.0
        step, wanted = self._pieces.trajectory.step, self._contact_step()
        return step > wanted or step < _RELAXED * min(wanted, self._pieces.errors.probe.step)

    def follow_swing(self) -> None:
        """Halve the next steps: collisions made too much energy oscillate."""
        trajectory = self._pieces.trajectory
        most, least = self._contact_ratios
        ratio = 0.5 * trajectory.step * math.sqrt(self._pieces.contact.phase.least_rate)
        while trajectory.ledger.swing_part * most > max(ratio, least):
            trajectory.ledger.swing_part *= 0.5

    def follow_jump(self) -> bool:
        """Return True: another step is proposed."""
        return True

    def _measure(
        self, step: float, cap: float, fastest: float, *, jumped: bool, held: bool
    ) -> float:
        """
        Return an accurate step up to `cap` [s], close to `step` if possible.

        `fastest` is the rate [rad/s] of the fastest motion. `jumped` means that loads are new.
        `held` means that contacts keep steps short, whose errors are measured after the steps.
        """
        errors, trajectory = self._pieces.errors.probe, self._pieces.trajectory
        tolerance, order = errors.tolerance, trajectory.order
        errors.begin()
        before = step
        step = min(step, cap)
        floor = errors.floor(fastest)
        touching = self._pieces.errors.touching
        known = math.inf if touching is None or jumped else touching.rate_with(step)
        if held and step >= cap and known <= _MAX_ERROR_RATIO * tolerance:
            # The intervals measured after the steps provide the error already.
            errors.take_over()
            error = known
        else:
            error = errors.measured(step, fastest)
        if math.isnan(error):
            # The next health check measures again, if the run reaches it.
            errors.add(errors.free_rate)
            errors.end(errors.rate)
            errors.checks_left = 1
            return step
        change = errors.add(errors.free_rate if jumped else error)
        low = _MIN_ERROR_RATIO if not errors.is_new else 0.25 * TARGET_RATIO
        best = error, step
        for _ in range(_MAX_TRIAL_COUNT):
            if error <= _MAX_ERROR_RATIO * tolerance and (error >= low * tolerance or step >= cap):
                break
            if error <= floor:
                # Shorter steps only add round-off.
                break
            wish = (TARGET_RATIO * tolerance / error) ** (1.0 / order) if error < math.inf else 0.0
            change = min(max(wish, _LARGEST_CHANGE[0]), _LARGEST_CHANGE[1])
            other = min(rounded_down(step * change), cap)
            if other == step:
                break
            found = errors.measured(other, fastest)
            if math.isnan(found):
                break
            if other < step and error <= found < math.inf and error <= _ROUNDINGS * floor:
                # Round-off dominates and adds the same error to every step, however short.
                break
            step, error = other, found
            best = min(best, (error, step))
            low = 0.25 * TARGET_RATIO
        if error > max(_MAX_ERROR_RATIO * tolerance, best[0]):
            # No tried step is accurate enough.
            error, step = best
        rough = trajectory.ledger.rough
        is_held = held and step >= cap
        largest = _LARGEST_GAP if rough >= 0.0 else _LARGEST_BLIND_GAP
        if is_held:
            largest = _LARGEST_GAP_HELD
        steps = errors.steps_of_period(step, fastest)
        errors.pace(
            math.inf if jumped else change, first=_FIRST_GAP, largest=largest, unit=steps * step,
            part=_PARTS)
        errors.end(error)
        steps *= errors.gap
        errors.checks_left = -(-steps // self._pieces.monitor.interval_with(step))
        errors.is_new = False
        # Differences grow with the step as the error does.
        self._expect(rough * (step / before) ** order)
        errors.step, errors.measured_step = math.inf if step >= cap else step, step
        return step

    def _follow_differences(
        self, step: float, cap: float, fastest: float, *, jumped: bool, excess: float
    ) -> float:
        """
        Return a step as `_measure`, by differences if known for the present step.

        Otherwise a quarter of a period is measured, and the next health check provides
        differences. `excess` is the ratio of the error of the last step to the allowed one. If
        above 1, no step longer than `step` is tried, because the motion ahead is rougher.
        """
        errors, trajectory = self._pieces.errors.probe, self._pieces.trajectory
        ledger, rates, tolerance = trajectory.ledger, self._pieces.rates, errors.tolerance
        order, floor = trajectory.order, errors.floor(fastest)
        is_pulse = rates.load_rate > rates.fabric.rate
        is_known = not jumped and not errors.is_new and ledger.rough >= 0.0 and (
            step == trajectory.step)
        errors.begin()
        if errors.is_new and not is_pulse:
            speed = max(self._pieces.calls.relative_speed() / trajectory.half_edge, ledger.spin)
            step = errors.expected_step(step, speed)
        step = min(rounded_down(step), cap)
        if excess > 1.0:
            cap = step
        if is_known:
            error = errors.present_rate
            # Longer steps are measured first, because differences do not predict a collapse.
            low = _MIN_ERROR_RATIO * tolerance if errors.may_measure else 0.0
        else:
            error = errors.measured(step, fastest, brief=not is_pulse)
            low = 0.25 * TARGET_RATIO * tolerance
        for _ in range(_MAX_TRIAL_COUNT):
            if not error > _MAX_ERROR_RATIO * tolerance and (not error < low or step >= cap):
                break
            if error <= floor:
                # Shorter steps only add round-off.
                break
            wish = (TARGET_RATIO * tolerance / error) ** (1.0 / order)
            change = min(max(wish, _LARGEST_CHANGE[0]), _LARGEST_CHANGE[1])
            other = min(rounded_down(step * change), cap)
            if other == step:
                break
            found = errors.measured(other, fastest, brief=not is_pulse)
            if math.isnan(found) or (
                    other < step and error <= found and error <= _ROUNDINGS * floor):
                break
            step, error, low = other, found, 0.25 * TARGET_RATIO * tolerance
        if math.isnan(error):
            error = errors.present_rate
        is_same = step == trajectory.step and not jumped
        errors.gap = min(2 * errors.gap, _LARGEST_GAP) if is_same else _FIRST_GAP
        errors.read_differences(step, fastest, None if is_known and is_same else error)
        steps = errors.steps_of_period(step, fastest) * errors.gap
        errors.checks_left = -(-steps // self._pieces.monitor.interval_with(step))
        errors.is_new = False
        errors.step, errors.measured_step = math.inf if step >= cap else step, step
        ledger.rough_limit = errors.largest_difference(_MAX_ERROR_RATIO * tolerance, step)
        if is_same:
            # A run that did not return is not checked again at each health check.
            ledger.rough_limit = max(ledger.rough_limit, _ROUGHER * ledger.rough)
        return step

    def _expect(self, rough: float) -> None:
        """Store the roughness for the measured error; rougher motion requires a new step."""
        errors, ledger = self._pieces.errors.probe, self._pieces.trajectory.ledger
        error = max(errors.rate, 1e-3 * TARGET_RATIO * errors.tolerance)
        room = max(_MAX_ERROR_RATIO * errors.tolerance / error, _ROUGHER)
        # If unknown, the next health check determines the roughness.
        ledger.rough_limit = room * rough if rough >= 0.0 else 0.0


def rounded_down(step: float) -> float:
    """
    Return the nearest lower number with a mantissa of 12 bits.

    So the last bits of the frequency rarely affect the step.
    """
    mantissa, exponent = math.frexp(step)
    return math.ldexp(math.floor(mantissa * 4096.0) / 4096.0, exponent)
