# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A granular gas that cools: its temperature falls as T0 / (1 + t / tau)."""

from collections.abc import Iterator

from icofabric_sim.simulation.simulation import compile_scene
from icofabric_validation.named.crowds import crowd
from icofabric_validation.named.problem import Curve, Point, PremiseError, Problem
import numpy as np

_SPEED, _DAMPING = 0.5, 0.1


def _solve(long: bool) -> Iterator[Curve]:
    """
    Restitution falls linearly with the speed, 1 - e = 2 c v / 3, so dT/dt goes with T squared.

    A shell takes part in it with three velocities and three spins of the same energy.
    """
    # The mean of some small gases: single ones scatter.
    size, end, looks, gases = ((8, 8, 16), 1.5, 60, 1) if long else ((4, 4, 8), 0.8, 40, 3)
    first = crowd(size, within='walls', parameters={}).shell
    times, temperature, steps = end * np.arange(looks + 1) / looks, np.zeros(looks + 1), 0
    for number in range(gases):
        scene = crowd(size, within='walls', parameters={
            'initial_random.velocity_sigma': _SPEED, 'initial_random.seed': number,
            'initial_random.spin_sigma': _SPEED * float(np.sqrt(first.mass / first.inertia)),
            'contact.stiffness': 1e6, 'contact.damping': _DAMPING, 'solver.tolerance': 0.1,
            'solver.energy_limit': 0.1})
        simulation = compile_scene(scene)
        for look, time in enumerate(times):
            simulation.advance_to(float(time))
            temperature[look] += simulation.snapshot().energy['kinetic']
        steps += simulation.status.step_count
    # 1 / T is a straight line in time. What is left of it, over T, once the grid on which the
    # shells begin is forgotten: at first they collide less often.
    inverse = temperature[0] / temperature
    told = times >= 0.2 * end
    rate, start = np.polyfit(times[told], inverse[told], 1)
    error = np.abs((start + rate * times[told]) / inverse[told] - 1.0).max()
    if not inverse[-1] > 2.0:
        raise PremiseError(f'the gas must cool to half, and has cooled to {1.0 / inverse[-1]:.3g}')
    if not 0.5 < start < 1.1:
        raise PremiseError(
            f'the line must begin near T0, or a little above, and begins at {1.0 / start:.3g} of '
            'it')
    yield Curve(
        f'{simulation.status.method_name}, {gases} x {scene.body_count} shells',
        'T0 over T at the end', (Point(float(inverse[-1]), float(error), steps),), 0.05,
        is_refined=False)


PROBLEM = Problem(
    'granular_gas', 'a gas of shells cools by its collisions',
    'Haff, J. Fluid Mech. 134, 401 (1983), with 1 - e linear in the speed of impact',
    'largest deviation of 1 / T from a straight line of time that is fitted to it, relative',
    _solve, has_long_form=True)
