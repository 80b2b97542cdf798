# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Charged bodies that pass each other: steps of one length stop with their names."""

import math

from fabrics import make_scene, packed_state
import icofabric_sim as ico
from icofabric_sim.simulation.model.electric import COULOMB_CONSTANT
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.simulation.stepping.charge_meetings import meeting_between
import numpy as np
import pytest

LOOSE = {
    'groups.one': 'ids 0', 'groups.two': 'ids 1', 'bodies.b.position': [1.0, 0.0, 0.0],
    'charge.mutual': True, 'charges.one.group': 'one', 'charges.one.charge': 2e-6,
    'charges.two.group': 'two', 'charges.two.charge': -2e-6, 'contact.mode': 'never'}


def comet(changes):
    """Two bodies that attract each other, on ellipses of eccentricity 0.99, from farthest."""
    mass = make_scene((1, 1, 1)).shell.mass
    far, eccentricity = 1.0, 0.99
    axis = far / (1.0 + eccentricity)
    gravity = 2.0 * COULOMB_CONSTANT * 4e-12 / mass  # of the distance, whose mass is half of one
    speed = math.sqrt(gravity / axis * (1.0 - eccentricity) / (1.0 + eccentricity))
    period = 2.0 * math.pi * math.sqrt(axis**3 / gravity)
    scene = make_scene((1, 1, 1), {
        **LOOSE, 'initial.a.group': 'one', 'initial.a.linear_velocity': [0.0, 0.5 * speed, 0.0],
        'initial.b.group': 'two', 'initial.b.linear_velocity': [0.0, -0.5 * speed, 0.0],
        **changes(period)})
    return scene, period


def test_a_run_that_steps_over_a_meeting_names_it():
    scene, period = comet(lambda period: {
        'solver.method': 'leapfrog', 'solver.step': period / 99.0})
    with pytest.raises(ico.SimulationError) as caught:
        ico.compile_scene(scene).advance_to(2.0 * period)
    text = str(caught.value)
    assert 'bodies 0 and 1, whose charges act on each other (charge.mutual), pass' in text
    assert 'energy does not balance' in text and 'solver.method dop8' in text
    assert 'contact.mode auto' in text


@pytest.mark.long
def test_the_way_out_follows_it():
    scene, period = comet(lambda period: {
        'solver.method': 'dop8', 'solver.tolerance': 1e-8 / period})
    run = ico.compile_scene(scene)
    run.advance_to(0.5 * period)
    nearest = run.snapshot().position
    # (1 - e) / (1 + e) of the farthest.
    assert np.linalg.norm(nearest[1] - nearest[0]) == pytest.approx(0.01 / 1.99, rel=1e-4)
    run.advance_to(period)
    assert run.snapshot().position == pytest.approx(scene.position, abs=1e-4)


def test_the_briefest_meeting_of_charged_bodies_is_found():
    scene = make_scene((1, 1, 1), {
        **LOOSE, 'bodies.c.position': [2.0, 0.0, 0.0], 'bodies.d.position': [3.0, 0.0, 0.0]})
    packed = pack_scene(scene)
    # Bodies 0 and 1 pass at 0.05 m after 0.3 s; 2 and 3, without charges, at 0.01 m.
    position = np.array([[0.0] * 3, [0.3, 0.05, 0.0], [2.0, 0.0, 0.0], [2.3, 0.0, 0.01]])
    velocity = np.array([[1.0, 0.0, 0.0], [0.0] * 3, [1.0, 0.0, 0.0], [0.0] * 3])

    def state(time):
        turned = np.tile([0.0, 0.0, 0.0, 1.0], (4, 1))
        return packed_state(packed, position + time * velocity, turned, velocity)

    # Before, after, and not within what lies between.
    for begin, end in ((0.0, 0.4), (0.2, 0.5)):
        found = meeting_between(packed, state(begin), state(end), end - begin, 0.1)
        assert found.bodies == (0, 1)
        assert found.distance == pytest.approx(0.05, rel=1e-9)
        assert found.duration == pytest.approx(0.05, rel=1e-9)
        # Where steps resolve it, it is none.
        assert meeting_between(packed, state(begin), state(end), end - begin, 0.04) is None
    assert meeting_between(packed, state(0.0), state(0.1), 0.1, 0.1) is None
    plain = pack_scene(make_scene((1, 1, 1)))
    one = packed_state(plain, position[:1], np.array([[0.0, 0.0, 0.0, 1.0]]), velocity[:1])
    assert meeting_between(plain, one, one, 1.0, 1.0) is None
