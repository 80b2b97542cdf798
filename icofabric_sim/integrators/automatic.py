# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
What `solver.method: auto` stands for in a scene.

Each method's fact sheet says what error it adds for motion of one size (bodies that move by their
half edge, or turn by a radian, in a second) when step times frequency is 1. With that the work of
each method for a wanted accuracy can be compared before the run. How lively the run will become
is estimated from its start, its loads and its weight; the step itself is then measured.
"""

import math
from typing import NamedTuple

from icofabric_sim.integrators.methods import Method, METHODS
from icofabric_sim.step_choice import AIM

# Strain in a radian of the fastest vibration above which connectors collapse now and then: of 35
# random scenes those whose error was above the tolerance at times were above it.
_WILD = 0.009


class Choice(NamedTuple):
    """
    A method, and why.
    """

    name: str
    reason: str


def choose_method(
    tolerance: float, liveliness: float, *, fixed_ratio: float | None = None,
    kinked: bool = False, strain: float = 0.0, contact: str = ''
) -> Choice:
    """
    The method with the least work for the error that may be added in a second.

    `liveliness` [1/s]: speeds over a, or spins, that are expected; `fixed_ratio`: a given step
    times the largest frequency, which leaves only the method to be chosen; `kinked`: some forces
    have a slope that jumps; `strain`: by how much of their length connectors are expected to
    change while the fastest vibration turns by a radian; `contact`: why shells are expected to
    touch.
    """
    candidates = {name: method for name, method in METHODS.items() if method.symplectic}
    if fixed_ratio is not None:
        return _for_fixed_step(candidates, tolerance, liveliness, fixed_ratio)
    if kinked:
        return Choice(
            'dop8', 'connectors pull otherwise than they push, and only steps that adapt see '
            'where their slope jumps: with steps of one length all methods fall to about order 2')
    if contact:
        return Choice(
            'dop8', f'{contact}: a contact begins within a step and asks for short ones while it '
            'lasts, which only steps that adapt find')
    if strain > _WILD:
        return Choice(
            'dop8', f'connectors are expected to change by {strain:.2g} of their length in a '
            f'radian of the fastest vibration (more than {_WILD:g}): some may collapse within a '
            'step, and only steps that adapt see that')
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


def _allowed_ratio(method: Method, tolerance: float, liveliness: float) -> float:
    """
    Step times frequency for the wanted accuracy, as far as the method may go.
    """
    if not liveliness > 0.0:
        return method.chosen
    accurate = (AIM * tolerance / (method.error * liveliness)) ** (1.0 / method.order)
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
