# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of health checks: groups of blocks, whoever adds them up, and what they come to."""

import icofabric_sim as ico
from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.figures import (
    DONE,
    FARTHEST,
    FASTEST,
    FIGURE_COUNT,
    figures_room,
    fold_figures,
    group_size,
    INSIDE,
    LINKS,
    MOMENTS,
    MOVING,
    note_figures,
    STIFFEST,
    SUMMED,
    TURNING,
    WEIGHT,
)
from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.devices.division import bounds_of
import numpy as np
import pytest

# More than 512 blocks of two: sums are formed over groups of some.
WIDE = {
    'weave.size': [21, 21, 43], 'contact.mode': 'never', 'gravity': [0.0, 0.3, -9.81],
    'groups': {'top': 'z_max', 'tip': 'x_max'}, 'supports': {'s': {'group': 'top', 'fix': 'all'}},
    'loads': {'l': {'group': 'tip', 'force': [0.01, 0.0, 0.02], 'profile': 'half_sine',
                    'duration': 0.004}},
    'initial_random': {'velocity_sigma': 0.02, 'spin_sigma': 1.0, 'seed': 3},
    'solver': {'method': 'leapfrog', 'step': 1e-4}}


@pytest.fixture(scope='module')
def moved():
    """The trajectory of a fabric that has moved, and what its snapshot says."""
    simulation = ico.compile_scene(ico.Scene.from_parameters(WIDE))
    simulation.advance_steps(30)
    trajectory = simulation._event_loop.driver.trajectory
    place_all(
        trajectory.model, trajectory.state, trajectory.work, 0,
        len(trajectory.model.blocks.slot))
    return trajectory, simulation.snapshot()


@pytest.mark.parametrize('blocks', [1, 7, 511, 1024, 5000, 16384, 16385, 125_001, 12_500_003])
def test_groups_are_as_many_as_ranks_and_sums_need(blocks):
    size = group_size(blocks)
    count = len(figures_room(blocks, size)) - 1
    assert (count - 1) * size < blocks <= count * size
    assert min(blocks, 512) <= count <= 16384
    for ranks in {1, *(min(count, most) for most in (2, 3, 1000))}:
        bounds = bounds_of(blocks, ranks)
        assert bounds[0] == 0 and bounds[-1] == blocks
        # Whole groups, and about as many for each.
        assert not np.any(bounds[:-1] % size)
        parts = np.diff(bounds)
        assert parts.min() > 0 and np.ptp(parts) <= 2 * size


def test_the_figures_are_the_same_bits_whoever_has_added_up_which_groups(moved):
    trajectory, _ = moved
    model, work = trajectory.model, trajectory.work
    blocks, groups = len(model.blocks.slot), len(work.figures) - 1
    assert 1 < work.group < blocks and groups > 512

    def figures(cuts):
        room = work._replace(figures=np.full_like(work.figures, np.nan))
        for first, last in cuts:
            note_figures(
                model, trajectory.loads, trajectory.state, room, trajectory.time, -1.0, True,
                first, last, blocks)
        return fold_figures(room.figures).copy()

    whole = figures([(0, groups)])
    assert np.isfinite(whole).all() and len(whole) == FIGURE_COUNT
    third = groups // 3
    for cuts in ([(third, groups), (0, third)],
                 [(2 * third, groups), (0, third), (third, 2 * third)]):
        assert figures(cuts).tobytes() == whole.tobytes()


def test_the_sums_are_the_energies_of_the_snapshot(moved):
    trajectory, snapshot = moved
    model, work = trajectory.model, trajectory.work
    blocks = len(model.blocks.slot)
    note_figures(
        model, trajectory.loads, trajectory.state, work, trajectory.time, -1.0, True, 0,
        len(work.figures) - 1, blocks)
    totals = fold_figures(work.figures)
    energy = snapshot.energy
    assert totals[LINKS] + totals[MOMENTS] == pytest.approx(energy['connectors'], rel=1e-12)
    assert -totals[WEIGHT] / model.inverse_mass == pytest.approx(energy['gravity'], rel=1e-12)
    assert totals[DONE] == pytest.approx(energy['work_in'], rel=1e-12)
    assert abs(totals[DONE]) > 1e-9 < energy['connectors']
    assert totals[INSIDE] == (snapshot.obstructed & 1).sum() + (snapshot.obstructed >> 1).sum()
    kinetic = 0.5 * (
        totals[MOVING] / model.inverse_mass + totals[TURNING] / model.inverse_inertia)
    assert kinetic == pytest.approx(energy['kinetic'], rel=1e-12)
    assert work.figures[:-1, :SUMMED].any(axis=1).all()


def test_the_largest_values_are_those_of_all_bodies(moved):
    trajectory, snapshot = moved
    model, work = trajectory.model, trajectory.work
    groups = len(work.figures) - 1
    note_figures(
        model, trajectory.loads, trajectory.state, work, trajectory.time, -1.0, True, 0, groups,
        len(model.blocks.slot))
    totals = fold_figures(work.figures)
    squares = (snapshot.angular_velocity**2).sum(axis=1)
    assert totals[FASTEST] == pytest.approx(squares.max(), rel=1e-14)
    assert totals[FARTHEST] == np.abs(snapshot.position).max()
    largest = work.figures[:groups].max(axis=0)
    assert totals[STIFFEST] == largest[STIFFEST] > 0.0
    # The last group has smaller ones.
    assert totals[FASTEST] > work.figures[groups - 1, FASTEST]


def test_threads_come_to_the_same_ledger():
    ledgers = set()
    for threads in (1, 2, 3):
        simulation = ico.compile_scene(ico.Scene.from_parameters(
            WIDE | {'solver': {'method': 'leapfrog', 'step': 1e-4, 'threads': threads}}))
        simulation.advance_steps(200)
        ledger = simulation._event_loop.driver.trajectory.ledger.numbers
        assert ledger[monitor.CHECK_COUNT] >= 3 and ledger[monitor.KINETIC] > 0.0
        # Steps of a call, of which there are as many as take some milliseconds.
        ledgers.add(np.delete(ledger, monitor.SAVED_AT).tobytes())
    assert len(ledgers) == 1


def test_what_is_not_finite_anywhere_shows(moved):
    trajectory, _ = moved
    work = trajectory.work._replace(figures=trajectory.work.figures.copy())
    state = trajectory.state
    slot = trajectory.packed.layout.slot[-1]
    before = state.position[1, slot]
    state.position[1, slot] = np.nan
    try:
        status = monitor.examine(
            trajectory.model, trajectory.loads, state, work, trajectory.time,
            trajectory.ledger.numbers.copy())
    finally:
        state.position[1, slot] = before
    assert status & monitor.NOT_FINITE
    assert np.isnan(work.figures[:-1, WEIGHT]).sum() == 1
    assert LANES * len(trajectory.model.blocks.slot) >= trajectory.packed.layout.body_count
