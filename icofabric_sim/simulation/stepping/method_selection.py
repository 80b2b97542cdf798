# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Choice of the method for `solver.method: auto` in a scene.

The fact sheet of a method states its error for motion of unit size (bodies move by their half
edge, or rotate by a radian, in a second) if step times frequency is 1. So the work of each method
for a required accuracy can be compared before the run. The size of the motion is estimated from
initial state, loads and weight; the step is measured later.
"""

from collections.abc import Collection
import math
from typing import NamedTuple

from icofabric_sim.simulation.stepping.accuracy_probe import TARGET_RATIO
from icofabric_sim.simulation.stepping.methods import (
    ADAPTIVE,
    facts_of,
    KINK_ORDER,
    Method,
    METHODS,
)

# Where slopes jump: what methods that mend kinks add in a second to motion of 1 a/s at step x
# frequency 1, measured on S1 with 100 and 500 N/m.
_KINK_ERROR = 1.5e-5
# Strain in a radian of the fastest vibration above which connectors collapse now and then: of 35
# random scenes those whose error was above the tolerance at times were above it.
WILD = 0.009

# Of so many loose shells, with and without losses, some contact begins or ends at nearly every
# moment: from this tolerance [1/s] on steps that run through contacts cost less than steps that
# end at each. And how much damping may add to a push at expected speeds, in parts of it. Measured:
# docs/decisions/steps_through_contacts.md.
MANY_LOSING, MANY_FREE, LOOSE_CONTACTS, _MOST_DAMPED = 16, 64, 0.01, 10.0
# The same of connected shells, from another tolerance on: docs/decisions/contact_speed.md.
MANY_WOVEN, LOOSE_WOVEN = 2_000, 0.1


# Costs of dop8 and of sdirk4 where connectors are damped, see `for_damping`, and by how much the
# second has to be less.
_DAMPED_STEP, _IMPLICIT_STEP, _SMALL_FACTORS, _FACTORS, _GAIN = 25.0, 7.0, 10.0, 0.16, 3.0


class Choice(NamedTuple):
    """A method, and the reason of its choice."""

    name: str
    reason: str


def choose_method(
    tolerance: float, liveliness: float, *, fixed_ratio: float | None = None,
    kinks: int = 0, bent: bool = False, strain: float = 0.0, contact: str = '', losses: str = '',
    loose: int = 0, woven: int = 0, is_dense: bool = False, damped: float = 0.0,
    among: Collection[str] = tuple(METHODS)
) -> Choice:
    """
    Return the method with the least work for the allowed error per second.

    `liveliness` [1/s] is the expected speed over a, or spin. `fixed_ratio` is a given step times
    the largest frequency. `kinks` is the number of connectors whose slope jumps. `bent` means that
    slopes have corners. `strain` is the expected relative change of connector lengths within a
    radian of the fastest vibration. `contact` is the reason to expect contacts, `losses` the
    dissipation by contacts. `loose` is the number of bodies without connectors, `woven` that with
    connectors. `is_dense` means that faces of woven neighbours nearly touch. `damped` is
    contact.damping times the expected speed [m/s]. `among` are the names to choose from, with
    leapfrog and dop8.
    """
    candidates = {
        name: method for name, method in METHODS.items() if method.symplectic and name in among}
    if fixed_ratio is not None and losses:
        return Choice(ADAPTIVE, losses)
    if fixed_ratio is not None:
        if kinks:
            candidates = {name: _at_kinks(method) for name, method in candidates.items()}
        return _for_fixed_step(candidates, tolerance, liveliness, fixed_ratio)
    if bent:
        return Choice(
            ADAPTIVE, 'the slopes of tabled laws have corners, and only steps that adapt see '
            'where: with steps of one length all methods lose their order')
    many = loose >= (MANY_LOSING if losses else MANY_FREE)
    crowded = is_dense and bool(losses) and woven >= MANY_LOSING
    which = f'{woven:,} shells woven face to face' if crowded else f'{loose:,} loose shells'
    runs_through = (
        f'{losses or contact}; of {which} some begin or cease to touch at nearly every moment, '
        f'and for a solver.tolerance of {LOOSE_CONTACTS:g} 1/s or more steps that run through '
        'contacts cost less than steps that end at each')
    if (many or crowded) and damped <= _MOST_DAMPED:
        if tolerance >= LOOSE_CONTACTS:
            return Choice('leapfrog', runs_through)
        if crowded:
            return Choice(ADAPTIVE, runs_through)
    if woven >= MANY_WOVEN and (losses or contact) and tolerance >= LOOSE_WOVEN and (
            damped <= _MOST_DAMPED):
        return Choice(
            'leapfrog', f'{losses or contact}; of {woven:,} shells some begin or cease to touch '
            'at nearly every moment once they meet, and for a solver.tolerance of '
            f'{LOOSE_WOVEN:g} 1/s or more steps that run through contacts cost less than steps '
            'that end at each')
    if losses:
        return Choice(ADAPTIVE, losses)
    if contact:
        return Choice(
            ADAPTIVE, f'{contact}: a contact begins within a step and asks for short ones while '
            'it lasts, which only steps that adapt find')
    if strain > WILD:
        return Choice(
            ADAPTIVE, f'connectors are expected to change by {strain:.2g} of their length in a '
            f'radian of the fastest vibration (more than {WILD:g}): some may collapse within a '
            'step, and only steps that adapt see that')
    if kinks:
        return _for_kinks(candidates, tolerance, liveliness, kinks)
    work = {
        name: method.stages / _allowed_ratio(method, tolerance, liveliness)
        for name, method in candidates.items()}
    # Of two that cost the same, the more accurate one.
    name = min(work, key=lambda name: (round(work[name], 6), -METHODS[name].order))
    others = ', '.join(
        f'{other} {work[other]:.3g}' for other in work if other != name)
    return Choice(
        name,
        f'least work for {tolerance:g} in a second with motion of about {liveliness:.2g} a/s or '
        f'rad/s: {work[name]:.3g} evaluations for each radian of the fastest vibration '
        f'({others})')


def for_damping(
    tolerance: float, frequency: float, damping: float, bodies: int, *, touching: float = 0.0
) -> Choice | None:
    """
    Return an implicit method if steps of dop8 that resolve the damping cost more; else None.

    `frequency` [rad/s] is that of the fastest vibration, `damping` [rad/s] the largest rate at
    which dissipative forces slow bodies. Steps of dop8 are about 25 over this rate, those of
    sdirk4 about 7 tolerance^(1/3) over the frequency. A step of sdirk4 costs as much as ten steps
    of dop8, for many bodies as 0.16 for each. `touching` [rad/s] is the frequency of expected
    contacts, on which bodies bounce at times; its cube root counts
    (docs/decisions/implicit_steps.md).
    """
    explicit = damping / _DAMPED_STEP
    followed = frequency ** (2.0 / 3.0) * max(frequency, touching) ** (1.0 / 3.0)
    implicit = followed / (_IMPLICIT_STEP * tolerance ** (1.0 / 3.0)) * max(
        _SMALL_FACTORS, _FACTORS * bodies)
    if not explicit > _GAIN * implicit:
        return None
    return Choice(
        'sdirk4', f'connectors are damped so strongly that motion dies out at rates up to '
        f'{damping:.3g} rad/s, beside vibrations up to {frequency:.3g} rad/s: implicit steps do '
        'not follow the first')


def method_near_contact(
    first: Choice, *, is_possible: bool, is_expected: bool
) -> Choice | None:
    """
    Return the method that replaces `first` once shells are near each other, if any.

    `is_possible` means that shells can touch; `is_expected`, that `first` was chosen for contacts.
    """
    if not is_possible or is_expected or facts_of(first.name).adaptive:
        return None
    return Choice(
        ADAPTIVE, f'{first.name} until shells are near each other, where a contact may begin '
        'within a step and asks for short ones while it lasts, which only steps that adapt find')


def _at_kinks(method: Method) -> Method:
    """Return the facts of a method at jumps of slopes."""
    if method.mends_kinks:
        return method._replace(order=KINK_ORDER, error=max(method.error, _KINK_ERROR))
    plain = METHODS['leapfrog']
    return method._replace(order=plain.order, error=max(method.error, plain.error))


def _for_kinks(
    candidates: dict[str, Method], tolerance: float, liveliness: float, kinks: int
) -> Choice:
    """
    Return the candidate with the least work if slopes of connectors jump.

    Steps of dop8 find every crossing, which took 30 to 40 times as long wherever it was measured.
    """
    work = {
        name: method.stages / _allowed_ratio(_at_kinks(method), tolerance, liveliness)
        for name, method in candidates.items()}
    name = min(
        work, key=lambda name: (round(work[name], 6), -_at_kinks(METHODS[name]).order))
    others = ', '.join(f'{other} {work[other]:.3g}' for other in work if other != name)
    return Choice(
        name,
        f'{kinks:,} connectors pull otherwise than they push: least work for {tolerance:g} in a '
        f'second where methods with steps of one length are of order 2, or {KINK_ORDER} where '
        f'they correct the errors of crossings: {work[name]:.3g} evaluations for each radian of '
        f'the fastest vibration ({others})')


def longest_at_kinks(method: Method, tolerance: float, liveliness: float) -> float:
    """
    Return step times frequency up to which errors at crossings meet the tolerance.

    `liveliness` [1/s] is the speed over a; at rest, the result is infinite. While connectors are
    slack, the motion does not show the error of the first one that tightens.
    """
    if not liveliness > 0.0:
        return math.inf
    facts = _at_kinks(method)
    return float((tolerance / (facts.error * liveliness)) ** (1.0 / facts.order))


def _allowed_ratio(method: Method, tolerance: float, liveliness: float) -> float:
    """Return step times frequency for the required accuracy, limited by the method."""
    if not liveliness > 0.0:
        return method.chosen
    accurate = (TARGET_RATIO * tolerance / (method.error * liveliness)) ** (1.0 / method.order)
    return min(accurate, method.chosen)


def _for_fixed_step(
    candidates: dict[str, Method], tolerance: float, liveliness: float, ratio: float
) -> Choice:
    stable = {
        name: method for name, method in candidates.items() if ratio <= method.stability
    } or candidates
    for name, method in stable.items():
        if ratio <= method.chosen and method.error * liveliness * ratio**method.order <= tolerance:
            return Choice(name, 'the least work with which solver.step is accurate enough')
    best = min(
        stable, key=lambda name: stable[name].error * min(ratio, math.pi) ** stable[name].order)
    return Choice(best, 'the most accurate with solver.step, which is long for the tolerance')
