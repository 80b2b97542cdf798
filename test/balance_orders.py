# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Checks that energy balance and motion converge with the order of a method."""

from fabrics import changed
import icofabric_sim as ico
import numpy as np
import pytest


def require_balance_order(scene):
    """Require an energy balance of order 8 of `dop8` with dissipation, also within steps."""
    steps, errors = 1.6e-3 * 0.5 ** np.arange(4), []
    for step in steps:
        simulation = ico.compile_scene(changed(scene, {'solver.step': float(step)}))
        simulation.advance_to(1.6e-2)
        energy = simulation.snapshot().energy
        errors.append(abs(energy['balance_error']))
        simulation.advance_to(1.6e-2 + 0.37 * float(step))
        assert abs(simulation.snapshot().energy['balance_error']) < 2.0 * errors[-1] + 1e-14
    assert energy['dissipated'] > 0.1 * energy['total']
    order = np.diff(np.log(errors)) / np.diff(np.log(steps))
    print('orders of the balance', order, errors)
    assert order[:2].mean() > 7.0


def require_fourth_order(scene, end, steps, work_accuracy):
    """Require order 4 of positions and balance at `end` [s], for two `steps` [s] and work."""
    reference = ico.compile_scene(changed(scene, {
        'solver.method': 'dop8', 'solver.tolerance': 1e-10}))
    reference.advance_to(end)
    exact = reference.snapshot()
    assert reference.balance.worst < 1e-10
    errors, balances = [], []
    for step in steps:
        simulation = ico.compile_scene(changed(scene, {'solver.step': step}))
        simulation.advance_to(end)
        snapshot = simulation.snapshot()
        errors.append(np.abs(snapshot.position - exact.position).max() / scene.shell.half_edge)
        balances.append(simulation.balance.worst)
        assert snapshot.energy['work_in'] == pytest.approx(
            exact.energy['work_in'], rel=work_accuracy)
    assert abs(exact.energy['work_in']) > 0.01 * exact.energy['kinetic']
    assert 12.0 < errors[0] / errors[1] < 22.0
    assert balances[1] < balances[0] / 8.0 and balances[0] < 1e-5
