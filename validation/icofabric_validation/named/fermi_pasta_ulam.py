# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Alternating stiff and soft springs: the energy of the stiff ones is an adiabatic invariant."""

from collections.abc import Iterator
import math
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.simulation import compile_scene, Simulation
from icofabric_validation.named.chain import (
    chain_parameters,
    chain_state,
    set_chain_state,
    write_law,
)
from icofabric_validation.named.problem import Curve, Point, Problem
import numpy as np

# Three stiff springs between four soft ones; body 8 of the odd row is fixed beyond the end.
_PAIRS = ((1, 2), (3, 4), (5, 6))
_BODIES = 9
_OMEGA = 50.0
_ROOT = math.sqrt(0.5)


def _simulation(folder: str, omega: float, solver: dict[str, Any]) -> Simulation:
    """Compile H = sum p^2 / 2 + omega^2 / 4 sum (q_2i - q_2i-1)^2 + sum (q_2i+1 - q_2i)^4."""
    path = Path(folder) / 'quartic.csv'
    write_law(path, lambda r: 4.0 * r**3, -3.0, 3.0, 1200)
    values: dict[str, Any] = {'connector.law': str(path), 'solver.energy_limit': 1.0, **solver}
    for number, (one, other) in enumerate(_PAIRS):
        values |= {
            f'groups.left{number}': f'ids {one}', f'groups.right{number}': f'ids {other}',
            f'connector_groups.stiff{number}.between': f'left{number} right{number}',
            f'connector_groups.stiff{number}.stiffness': 0.5 * omega**2}
    simulation = compile_scene(
        Scene.from_parameters(chain_parameters(_BODIES, 'ids 0 7 8', values)))
    # x_01 = y_01 = 1, x_11 = 1 / omega, y_11 = 1: sums and differences over sqrt(2).
    q, v = np.zeros(_BODIES), np.zeros(_BODIES)
    q[1:3] = _ROOT * (1.0 - 1.0 / omega), _ROOT * (1.0 + 1.0 / omega)
    v[1:3] = 0.0, 2.0 * _ROOT
    set_chain_state(simulation, q, v)
    return simulation


def _stiff_energy(simulation: Simulation, omega: float) -> float:
    """Return the sum of (y_1i^2 + omega^2 x_1i^2) / 2 [J]."""
    q, v = chain_state(simulation)
    x, y = _ROOT * (q[2:7:2] - q[1:6:2]), _ROOT * (v[2:7:2] - v[1:6:2])
    return float(0.5 * np.sum(y * y + omega**2 * x * x))


def _energy_changes(
    omega: float, solver: dict[str, Any], duration: float, samples: int
) -> tuple[float, float, int]:
    """Return the largest relative changes of the stiff and the total energy, and the steps."""
    with TemporaryDirectory() as folder:
        simulation = _simulation(folder, omega, solver)
    first, total = _stiff_energy(simulation, omega), simulation.snapshot().energy['total']
    most, drift = 0.0, 0.0
    for time in duration * np.arange(1, samples + 1) / samples:
        simulation.advance_to(float(time))
        most = max(most, abs(_stiff_energy(simulation, omega) - first) / first)
        drift = max(drift, abs(simulation.snapshot().energy['total'] - total) / total)
    return most, drift, simulation.status.step_count


def _solve(long: bool) -> Iterator[Curve]:
    # Total energy with given steps, for a time in which the stiff springs exchange energy.
    for method, parts, order, allowed in (
            ('leapfrog', (0.4, 0.2, 0.1), 2.0, 2e-3), ('srkn4', (1.0, 0.5, 0.25), 4.0, 6e-8)):
        points = []
        for part in parts:
            step = part / _OMEGA
            _, drift, steps = _energy_changes(
                _OMEGA, {'solver.method': method, 'solver.step': step}, 40.0, 2000)
            points.append(Point(step, drift, steps))
        yield Curve(f'{method}, total energy', 'step [s]', tuple(points), allowed, order=order)
    # Deviations of the stiff energy are of order 1 / omega for exponentially long times.
    points = []
    for omega in (50.0, 100.0, 200.0):
        most, _, steps = _energy_changes(
            omega, {'solver.method': 'leapfrog', 'solver.step': 0.1 / omega}, 20.0, 2000)
        points.append(Point(1.0 / omega, most, steps))
    yield Curve('leapfrog, stiff energy', '1 over omega [s]', tuple(points), 5e-2, order=1.0)
    # Steps of half a radian, as many as in the source.
    count = 1_000_000 if long else 50_000
    step = 0.5 / _OMEGA
    most, drift, steps = _energy_changes(
        _OMEGA, {'solver.method': 'leapfrog', 'solver.step': step}, count * step, 2000)
    for of, error, allowed in (('stiff', most, 0.15), ('total', drift, 0.03)):
        yield Curve(
            f'leapfrog, {of} energy, long', 'steps', (Point(float(steps), error, steps),), allowed,
            is_refined=False)


PROBLEM = Problem(
    'fermi_pasta_ulam', 'alternating stiff and soft springs, many steps',
    'Hairer, Lubich, Wanner, Geometric Numerical Integration, I.5.1, XIII',
    'largest relative change of the energy of the stiff springs, or of the total', _solve,
    has_long_form=True)
