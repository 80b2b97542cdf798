# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""How often health checks come, and that a coarse bound of the frequency hides nothing."""

import math

import icofabric_sim as ico
from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.figures import fold_figures, note_figures, STIFFEST
from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.frequency_bound import frequency_bound
from icofabric_sim.simulation.stepping.methods import METHODS
from icofabric_sim.simulation.stepping.step_monitor import CHECK_INTERVAL, SHORTEST_INTERVAL
import numpy as np
import pytest

SCENE = {
    'weave.size': [5, 5, 5], 'contact.mode': 'never',
    'initial_random': {'velocity_sigma': 0.02, 'spin_sigma': 1.0, 'seed': 3}}


def simulation_with(**solver):
    return ico.compile_scene(ico.Scene.from_parameters(SCENE | {'solver': solver}))


def driver_of(simulation):
    return simulation._event_loop.driver


@pytest.mark.parametrize(('method', 'ratio'), [
    ('leapfrog', 0.02), ('leapfrog', 0.3), ('leapfrog', 1.2), ('srkn4', 1.3), ('srkn6', 1.0),
    ('srkn8', 1.6), ('srkn8', 0.1)])
def test_given_steps_are_checked_in_every_period_and_no_more_often_than_that_pays(method, ratio):
    frequency = simulation_with(method='leapfrog', step=1e-5).status.largest_frequency
    simulation = simulation_with(method=method, step=ratio / frequency, energy_limit=0.5)
    ledger = driver_of(simulation).trajectory.ledger.numbers
    period = math.floor(2.0 * math.pi / ratio)
    steps = max(CHECK_INTERVAL // METHODS[method].stages, SHORTEST_INTERVAL)
    expected = max(min(period, steps), SHORTEST_INTERVAL)
    before = ledger[monitor.CHECK_COUNT]
    simulation.advance_steps(4 * expected)
    assert ledger[monitor.CHECK_COUNT] - before in (4, 5)
    assert driver_of(simulation).monitor.interval == pytest.approx(expected, abs=1)


@pytest.mark.parametrize('method', ['leapfrog', 'srkn4', 'srkn6', 'srkn8', 'dop8'])
@pytest.mark.parametrize('tolerance', [1e-2, 1e-6])
def test_chosen_steps_are_checked_in_every_period_or_difference(method, tolerance):
    simulation = simulation_with(method=method, tolerance=tolerance)
    driver = driver_of(simulation)
    ledger = driver.trajectory.ledger.numbers
    lasted, looks, time = [], ledger[monitor.CHECK_COUNT], 0.0
    for _ in range(12):
        simulation.advance_steps(driver.monitor.interval)
        assert ledger[monitor.CHECK_COUNT] > looks
        lasted.append(simulation.time - time)
        looks, time = ledger[monitor.CHECK_COUNT], simulation.time
    # The last of some adaptive steps may be longer than the first; and others are checked once a
    # whole difference is known.
    longest = 1.5 if method == 'dop8' else 1.0
    difference = (METHODS[method].order + 1) * driver.trajectory.step * (method != 'dop8')
    assert 0.0 < max(lasted) <= max(
        longest * 2.0 * math.pi / driver.rates.fabric.rate, 1.001 * difference)


@pytest.mark.parametrize('changes', [
    {}, {'connector': {'stiffness_compression': 100.0}},
    {'connector': {'attachment': {'up': [0.0, 0.001, 0.0162]}}}])
def test_a_coarse_bound_is_no_less_than_the_close_one_and_close_above_its_limit(changes):
    simulation = ico.compile_scene(ico.Scene.from_parameters(
        SCENE | changes | {'solver': {'method': 'leapfrog', 'step': 1e-4}}))
    simulation.advance_steps(30)
    trajectory = driver_of(simulation).trajectory
    model, work, state = trajectory.model, trajectory.work, trajectory.state
    blocks = len(model.blocks.slot)
    place_all(model, state, work, 0, blocks)
    close = frequency_bound(model, state, work)

    def bound(limit):
        note_figures(
            model, trajectory.loads, state, work, trajectory.time, limit, False, 0,
            len(work.figures) - 1, blocks)
        return fold_figures(work.figures)[STIFFEST]

    assert bound(-1.0) == bound(0.9 * close) == close
    assert close < bound(math.inf) < 6.0 * close
    limit = 0.5 * (close + bound(math.inf))
    assert close <= bound(limit) <= limit


def test_the_rate_that_a_health_check_finds_too_high_is_too_high():
    simulation = simulation_with(method='leapfrog', step=1e-4)
    simulation.advance_steps(10)
    trajectory = driver_of(simulation).trajectory
    ledger = trajectory.ledger
    ledger.high, ledger.low, ledger.spin_weight = np.inf, np.inf, 1.0
    arguments = trajectory.model, trajectory.loads, trajectory.state, trajectory.work
    monitor.examine(*arguments, trajectory.time, ledger.numbers)
    close, ledger.low = ledger.rate, 0.0
    for high, found in ((0.999 * close, monitor.RATE_HIGH), (1.001 * close, 0), (np.inf, 0)):
        ledger.high = high
        status = monitor.examine(*arguments, trajectory.time, ledger.numbers)
        assert status & (monitor.RATE_HIGH | monitor.RATE_LOW) == found
        assert ledger.rate >= 0.999 * close
