# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Steps that end where a contact begins or ends: foreseen, whatever is listed."""

from contact_scenes import crowd
from fabrics import changed, same_state
import icofabric_sim as ico
from icofabric_sim.kernels.integrators import embedded
import pytest

# As other tests compile them.
FLOOR = {'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -0.065}


def run(scene, until, caution=1.0):
    """The state at the end, how many searches and pairs tested; they reach `caution` times far."""
    simulation, searches = ico.compile_scene(scene), []
    phase = simulation._driver.contact.phase
    phase._caution, search = caution, phase.search
    phase.search = lambda time, *args, **kwargs: (
        searches.append(time), search(time, *args, **kwargs))[1]
    simulation.advance_to(until)
    return simulation, len(searches)


@pytest.mark.parametrize('changes', [
    {}, {**FLOOR, 'contact.damping': 0.5, 'contact.friction': 0.6}], ids=['free', 'on a floor'])
def test_steps_do_not_depend_on_how_far_searches_reach(changes):
    scene = changed(crowd(), changes)
    far, seldom = run(scene, 0.03, caution=10.0)
    near, often = run(scene, 0.03, caution=0.02)
    assert often > 1.5 * seldom
    assert far.status.deepest_overlap > 0.0
    assert same_state(far.snapshot(), near.snapshot())
    assert far.status.step_count == near.status.step_count
    assert far.status.error_estimate == near.status.error_estimate
    refused = [
        one._driver.trajectory.control.numbers[embedded.REFUSED] for one in (far, near)]
    assert refused[0] == refused[1] > 0
