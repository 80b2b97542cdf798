# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of a run are read only, and reading them leaves the run as it is."""

from fabrics import make_scene, RANDOM
import icofabric_sim as ico
from icofabric_sim.simulation.reports.status import SimulationStatus
import pytest

FIGURES = [
    name for name, member in vars(SimulationStatus).items() if isinstance(member, property)]


@pytest.fixture
def moving():
    """A fabric in motion under a wrench."""
    simulation = ico.compile_scene(make_scene(
        **RANDOM, groups={'tip': 'x_max'}, loads={'tip': {'group': 'tip'}}))
    simulation.apply_wrench('tip', (0.0, 0.0, 0.1))
    simulation.advance_to(0.0123)
    return simulation


def test_figures_say_how_the_run_stands(moving):
    status = moving.status
    assert status.step_count > 10 and 0.0 < status.step <= status.stability_limit
    assert status.next_step_time - status.step <= moving.time <= status.next_step_time
    method = ico.METHODS[status.method_name]
    assert status.stability_limit == pytest.approx(method.stability / status.largest_frequency)
    assert status.error_rate > 0.0 and status.method_reason
    assert status.active_loads.keys() == {'tip'} and status.waiting_loads == 0
    assert status.contact_count == status.broken_count == status.obstructed_ends == 0
    assert status.proximity is None and status.obstruction == status.error_estimate_lacks == ''
    before = status.step_count
    moving.advance_steps(3)
    assert status.step_count == before + 3


def test_names_of_the_readme_are_the_same_figures(moving):
    assert moving.error_estimate == moving.status.error_estimate > 0.0
    assert moving.balance == moving.status.balance and moving.balance.worst > 0.0


def test_reading_leaves_no_trace_and_nothing_can_be_set(moving):
    before = moving.checkpoint().to_bytes()
    assert len(FIGURES) >= 20
    for name in FIGURES:
        getattr(moving.status, name)
        with pytest.raises(AttributeError):
            setattr(moving.status, name, 0)
        assert getattr(SimulationStatus, name).__doc__
    with pytest.raises(AttributeError):
        moving.status = None
    assert moving.checkpoint().to_bytes() == before


def test_a_simulation_offers_what_is_done_with_it():
    offered = [name for name in vars(ico.Simulation) if not name.startswith('_')]
    assert len(offered) <= 25, offered
    assert not {*offered} & {*FIGURES} - {'error_estimate', 'balance'}
