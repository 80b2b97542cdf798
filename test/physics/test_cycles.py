# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Slabs that are loaded and unloaded again, and the energy that they lose."""

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.statics.cycles import CYCLE_COLUMNS
import numpy as np
import pytest

STIFF = {'bending_stiffness': 0.02}


def slab(**connector):
    return make_scene(
        weave={'size': [5, 3, 3], 'connector_angle': 0.3}, connector={**STIFF, **connector})


@pytest.mark.parametrize('kind, most', [
    ('pull', 0.1), ('push', 0.1), ('shear', 0.1), ('hydrostatic', 0.1), ('bend', 0.8),
    ('twist', -0.8)])
def test_without_breaks_nothing_is_lost(kind, most):
    amounts = np.linspace(0.0, most, 5)[1:]
    first, second = ico.measure_cycles(slab(), kind, amounts, count=2)
    for cycle in (first, second):
        assert cycle.loading_work > 1e-3
        assert abs(cycle.loop_area) < 1e-9 * cycle.loading_work
        assert abs(cycle.energy_gain) < 1e-12 * cycle.loading_work
        assert cycle.released_energy == 0.0 and cycle.broken == 0
    there, back = first.points[:4], first.points[4:]
    measure = ico.measure_moment_curve if kind in ('bend', 'twist') else ico.measure_curve
    alone = measure(slab(), kind, amounts)
    assert [point.energy for point in there] == [point.energy for point in alone]
    # The way back goes through the same states.
    assert [point.energy for point in back[:-1]] == pytest.approx(
        [point.energy for point in there[2::-1]], rel=1e-9)
    assert abs(back[-1].energy) < 1e-12 * there[-1].energy
    # And the work is the energy stored, but for the curvature of the steps.
    assert first.loading_work == pytest.approx(there[-1].energy, rel=0.02)


@pytest.mark.parametrize('kind, most', [('pull', 0.1), ('bend', 0.8)])
def test_a_loop_with_breaks_loses_what_breaks_release(kind, most):
    """
    The area of the loop comes to the energy of the breaks, four times closer with half the steps.
    """
    scene, off = slab(break_length_extension=0.0505), []
    for count in (5, 10, 20):
        first, second = ico.measure_cycles(
            scene, kind, np.linspace(0.0, most, count + 1)[1:], count=2)
        assert first.broken > 3 and first.released_energy > 0.1 * first.loading_work
        assert first.loop_area == pytest.approx(
            first.released_energy + first.energy_gain, rel=0.03)
        assert first.loop_area == first.loading_work - first.unloading_work
        off.append((
            first.loop_area - first.released_energy - first.energy_gain) / first.loading_work)
        # What is broken stays so: the second loop is narrower, and closed.
        assert second.broken == 0 and second.points[-1].broken == first.broken
        assert abs(second.loop_area) < 1e-9 * second.loading_work
        assert second.loading_work == pytest.approx(first.unloading_work, rel=1e-9)
    assert off[0] > 3.0 * off[1] > 9.0 * off[2] > 0.0
    breaks = [each for point in first.points for each in point.breaks]
    assert sum(each.released_energy for each in breaks) == first.released_energy
    assert len({each.connector for each in breaks}) == first.broken
    assert len(first) == len(CYCLE_COLUMNS) + 1


def test_pre_stress_is_work_that_comes_back():
    """A slab held at a length that is not its own: the loop is closed all the same."""
    [cycle] = ico.measure_cycles(slab(natural_length=0.0485), 'pull', [0.02, 0.04])
    assert cycle.points[0].rest_stress > 0.0 and cycle.points[0].broken == 0
    assert abs(cycle.loop_area) < 1e-9 * cycle.loading_work
    assert abs(cycle.energy_gain) < 1e-9 * cycle.loading_work


def test_a_cycle_that_ends_early_has_no_loss():
    """Cut short by the one who asks for states: there is no way back yet."""
    from icofabric_sim.statics.cycles import CycleRun

    run = CycleRun(slab(), 'pull', [0.01, 0.02])
    for number, _ in enumerate(run.points()):
        if number == 1:
            break
    [cycle] = run.cycles()
    assert len(cycle.points) == 2
    assert np.isnan([cycle.loading_work, cycle.unloading_work, cycle.loop_area]).all()


@pytest.mark.parametrize('arguments, more, word', [
    (('pull', [0.2, 0.1]), {}, 'amounts'), (('bend', [0.1, -0.2]), {}, 'amounts'),
    (('fly', [0.1]), {}, 'kind'), (('pull', [0.1]), {'count': 0}, 'count'),
    (('pull', [0.1]), {'about': 1}, 'about applies to a bend only')])
def test_arguments_are_judged(arguments, more, word):
    with pytest.raises(ValueError, match=word):
        ico.measure_cycles(slab(), *arguments, **more)
