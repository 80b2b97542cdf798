# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A cooling granular gas, whose temperature falls as T0 / (1 + t / tau)."""

from collections.abc import Iterator

from icofabric_sim.simulation.simulation import compile_scene
from icofabric_validation.named.crowds import crowd
from icofabric_validation.named.problem import Curve, Point, PremiseError, Problem
import numpy as np

_SPEED, _DAMPING = 0.5, 0.1


def _solve(long: bool) -> Iterator[Curve]:
    """
    Yield the deviation of 1 / T from a line.

    Restitution falls linearly with the speed, 1 - e = 2 c v / 3, so dT/dt is proportional to T^2.
    The three velocities and three spins of a shell have equal energies.
    """
    # The mean over small gases, which scatter.
    size, end, samples, gases = ((8, 8, 16), 1.5, 60, 1) if long else ((4, 4, 8), 0.8, 40, 3)
    first = crowd(size, within='walls', parameters={}).shell
    times, temperature, steps = end * np.arange(samples + 1) / samples, np.zeros(samples + 1), 0
    for number in range(gases):
        scene = crowd(size, within='walls', parameters={
            'initial_random.velocity_sigma': _SPEED, 'initial_random.seed': number,
            'initial_random.spin_sigma': _SPEED * float(np.sqrt(first.mass / first.inertia)),
            'contact.stiffness': 1e6, 'contact.damping': _DAMPING, 'solver.tolerance': 0.1,
            'solver.energy_limit': 0.1})
        simulation = compile_scene(scene)
        for sample, time in enumerate(times):
            simulation.advance_to(float(time))
            temperature[sample] += simulation.snapshot().energy['kinetic']
        steps += simulation.status.step_count
    # 1 / T is linear in time, once the shells have left their initial grid, on which they collide
    # less often.
    inverse = temperature[0] / temperature
    fitted = times >= 0.2 * end
    rate, start = np.polyfit(times[fitted], inverse[fitted], 1)
    error = np.abs((start + rate * times[fitted]) / inverse[fitted] - 1.0).max()
    if not inverse[-1] > 2.0:
        raise PremiseError(
            f'the gas must cool to half of T0, but has cooled to {1.0 / inverse[-1]:.3g} T0')
    if not 0.5 < start < 1.1:
        raise PremiseError(
            f'the line must begin at T0 or slightly above, but begins at {1.0 / start:.3g} T0')
    yield Curve(
        f'{simulation.status.method_name}, {gases} x {scene.body_count} shells',
        'T0 over T at the end', (Point(float(inverse[-1]), float(error), steps),), 0.05,
        is_refined=False)


PROBLEM = Problem(
    'granular_gas', 'a gas of shells cools by collisions',
    'Haff, J. Fluid Mech. 134, 401 (1983), with 1 - e linear in the impact speed',
    'largest relative deviation of 1 / T from a line fitted in time',
    _solve, has_long_form=True)
