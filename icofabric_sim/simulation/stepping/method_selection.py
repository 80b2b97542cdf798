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
What `solver.method: auto` stands for in a scene.

Each method's fact sheet says what error it adds for motion of one size (bodies that move by their
half edge, or turn by a radian, in a second) when step times frequency is 1. With that the work of
each method for a wanted accuracy can be compared before the run. How lively the run will become
is estimated from its start, its loads and its weight; the step itself is then measured.
"""

import math
from typing import NamedTuple

from icofabric_sim.simulation.stepping.accuracy_probe import AIM
from icofabric_sim.simulation.stepping.methods import Method, METHODS

# Evaluations that dop8 needs for each kinked connector in a radian of the fastest vibration at a
# tolerance of 1e-8 of the motion, measured in fabrics of 6 to 240 connectors; they go with the
# tolerance to this power. Every crossing costs it some steps; those of one length pass many at no
# further cost.
_KINK, _KINK_TOLERANCE, _KINK_POWER = 200.0, 1e-8, -0.2
# Below so many a crossing is rare, and how lively the motion is says too little.
_FEW_KINKS = 30
# Strain in a radian of the fastest vibration above which connectors collapse now and then: of 35
# random scenes those whose error was above the tolerance at times were above it.
_WILD = 0.009


class Choice(NamedTuple):
    """A method, and why."""

    name: str
    reason: str


def choose_method(
    tolerance: float, liveliness: float, *, fixed_ratio: float | None = None,
    kinks: int = 0, bent: bool = False, strain: float = 0.0, contact: str = ''
) -> Choice:
    """
    The method with the least work for the error that may be added in a second.

    `liveliness` [1/s]: speeds over a, or spins, that are expected; `fixed_ratio`: a given step
    times the largest frequency, which leaves only the method to be chosen; `kinks`: of how many
    connectors the slope jumps; `bent`: of some the slope has corners; `strain`: by how much of
    their length connectors are expected to change while the fastest vibration turns by a radian;
    `contact`: why shells are expected to touch.
    """
    candidates = {name: method for name, method in METHODS.items() if method.symplectic}
    if fixed_ratio is not None:
        return _for_fixed_step(candidates, tolerance, liveliness, fixed_ratio)
    if bent:
        return Choice(
            'dop8', 'the slopes of tabled laws have corners, and only steps that adapt see where: '
            'with steps of one length all methods lose their order')
    if contact:
        return Choice(
            'dop8', f'{contact}: a contact begins within a step and asks for short ones while it '
            'lasts, which only steps that adapt find')
    if strain > _WILD:
        return Choice(
            'dop8', f'connectors are expected to change by {strain:.2g} of their length in a '
            f'radian of the fastest vibration (more than {_WILD:g}): some may collapse within a '
            'step, and only steps that adapt see that')
    if kinks:
        return _for_kinks(tolerance, liveliness, kinks)
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


def _for_kinks(tolerance: float, liveliness: float, kinks: int) -> Choice:
    """
    Where slopes jump all methods with steps of one length are of order 2, so the plainest is best.
    """
    plain = 1.0 / _allowed_ratio(METHODS['leapfrog'], tolerance, liveliness)
    lively = liveliness if liveliness > 0.0 else tolerance / _KINK_TOLERANCE
    adaptive = kinks * _KINK * (tolerance / (_KINK_TOLERANCE * lively)) ** _KINK_POWER
    why = (
        f'{kinks:,} connectors pull otherwise than they push: with steps of one length all '
        f'methods fall to about order 2 there, so the leapfrog needs about {plain:.3g} '
        f'evaluations for each radian of the fastest vibration, and dop8, whose steps find every '
        f'crossing, {adaptive:.3g}')
    few = kinks < _FEW_KINKS or adaptive < plain
    return Choice('dop8' if few else 'leapfrog', why)


def _allowed_ratio(method: Method, tolerance: float, liveliness: float) -> float:
    """Step times frequency for the wanted accuracy, as far as the method may go."""
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
