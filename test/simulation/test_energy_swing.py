# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""How far splitting methods let the energy of a vibration swing, beside an oscillator's path."""

import math

from icofabric_sim.simulation.stepping.energy_swing import energy_swing, longest_ratio
from icofabric_sim.simulation.stepping.methods import METHODS
import numpy as np
import pytest

SPLITTINGS = [name for name, method in METHODS.items() if method.symplectic]


def followed(method, ratio, count=4000):
    """Least over largest energy of an oscillator at step ends, less 1."""
    place, speed, energies = 1.0, 0.3, []
    first, second = (method.kicks, method.drifts) if len(method.kicks) > len(method.drifts) else (
        method.drifts, method.kicks)
    for _ in range(count):
        for k, weight in enumerate(first):
            for part, kicks in ((weight, first is method.kicks), (
                    second[k] if k < len(second) else 0.0, second is method.kicks)):
                if kicks:
                    speed -= part * ratio * place
                else:
                    place += part * ratio * speed
        energies.append(place * place + speed * speed)
    return 1.0 - min(energies) / max(energies)


@pytest.mark.parametrize('name', SPLITTINGS)
@pytest.mark.parametrize('ratio', [0.3, 1.1, 1.9])
def test_it_is_that_of_an_oscillator(name, ratio):
    method = METHODS[name]
    found = energy_swing(method.kicks, method.drifts, ratio)
    assert found == pytest.approx(followed(method, ratio), rel=0.02, abs=1e-12)
    assert found > 0.0


def test_the_leapfrog_has_a_closed_form():
    method = METHODS['leapfrog']
    for ratio in (0.01, 0.2, 1.0, 1.9):
        assert energy_swing(method.kicks, method.drifts, ratio) == pytest.approx(
            ratio**2 / 4.0, rel=1e-9)
    assert energy_swing(method.kicks, method.drifts, 2.01) == math.inf


@pytest.mark.parametrize('name', SPLITTINGS)
def test_steps_are_as_long_as_the_energy_allows(name):
    method = METHODS[name]
    for part in (1e-2, 1e-5, 1e-8):
        ratio = longest_ratio(method.kicks, method.drifts, method.chosen, part)
        swings = energy_swing(method.kicks, method.drifts, ratio)
        assert swings <= part
        assert ratio == method.chosen or swings == pytest.approx(part, rel=1e-3)
    assert np.all(np.diff([
        longest_ratio(method.kicks, method.drifts, method.chosen, 10.0**-k)
        for k in range(2, 9)]) <= 0.0)
