# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Contacts that take energy from the motion: damping in simulations.
"""

from contact_poses import facing, touch_floor, VERTICES
from contact_scenes import A, crowd, loose, momenta, OBLIQUE
from fabrics import changed, same_state
import icofabric_sim as ico
from icofabric_sim import contact, crew
from icofabric_sim.checkpoint import Checkpoint
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

UP = np.array([0.0, 0.0, 1.0])
ON_VERTEX = facing(np.eye(3), VERTICES[0], -UP)
FLOOR = {'planes__floor__normal': [0.0, 0.0, 1.0], 'planes__floor__offset': -0.05}


def dropped_on_vertex(speed, **changes):
    """
    A shell that comes down on a vertex, 1 mm above the floor.
    """
    height = A * np.linalg.norm(VERTICES[0])
    return loose(
        ((0.2, 0.0, -0.049 + height), (0.0, 0.0, -speed), (0.0, 0.0, 0.0),
         Rotation.from_matrix(ON_VERTEX)), **FLOOR, **changes)


@pytest.mark.parametrize('wanted, speed', [(0.98, 1.0), (0.8, 0.3), (0.5, 1.0), (0.1, 2.0)])
def test_a_collision_in_one_point_has_the_restitution_that_its_damping_is_for(wanted, speed):
    out = touch_floor(UP, 0.0, (np.linalg.norm(VERTICES[0]) - 1e-3) * UP, ON_VERTEX)[1]
    share = out[10] / 1e-3
    damping = contact.damping_for(wanted, share * speed)
    simulation = ico.compile_scene(dropped_on_vertex(speed, contact__damping=damping))
    before = simulation.snapshot().energy['total']
    simulation.advance_to(0.03 / speed)
    snapshot = simulation.snapshot()
    assert snapshot.linear_velocity[1, 2] == pytest.approx(wanted * speed, rel=1e-7)
    assert np.abs(snapshot.linear_velocity[1, :2]).max() < 1e-12 * speed
    energy = snapshot.energy
    assert energy['dissipated'] == pytest.approx((1.0 - wanted**2) * before, rel=1e-7)
    # The stronger the damping, the sharper its kink at first touch.
    assert abs(energy['balance_error']) < (1e-7 if wanted < 0.5 else 1e-10) * before
    assert energy['contact'] == 0.0 and simulation.deepest_overlap > 1e-3 * A


def test_damped_collisions_keep_momenta_and_lose_what_the_meter_shows():
    scene = loose(OBLIQUE, contact__damping=1.0)
    simulation = ico.compile_scene(scene)
    before, start = momenta(scene, simulation.snapshot()), simulation.snapshot().energy
    lost = [0.0]
    for time in np.linspace(0.0, 0.07, 300):
        simulation.advance_to(time)
        energy = simulation.snapshot().energy
        # Also within steps, and nothing is ever gained.
        assert abs(energy['balance_error']) < 1e-9 * start['total']
        assert energy['dissipated'] >= lost[-1] - 1e-9 * start['total']
        lost.append(energy['dissipated'])
    after = momenta(scene, simulation.snapshot())
    size = [scene.shell.mass * 1.0, scene.shell.mass * 1.0 * 0.06]
    for one, other, scale in zip(before, after, size):
        assert np.abs(one - other).max() < 1e-12 * scale
    assert lost[-1] > 0.05 * start['total'] and simulation.contact_count == 0


def test_auto_and_always_are_the_same_bits_also_in_pieces_and_from_checkpoints():
    scene = loose(OBLIQUE, contact__damping=1.0)
    auto, always = (
        ico.compile_scene(changed(scene, {'contact.mode': mode})) for mode in ('auto', 'always'))
    auto.advance_to(0.06)
    checkpoints = []
    for time in np.linspace(0.0, 0.06, 37):
        always.advance_to(time)
        always.snapshot()
        checkpoints.append(always.checkpoint())
    assert same_state(auto.snapshot(), always.snapshot())
    assert auto.snapshot().energy == always.snapshot().energy
    touching = 0
    for checkpoint in checkpoints[::4]:
        again = ico.compile_scene(changed(scene, {'contact.mode': 'always'}))
        again.restore(Checkpoint.from_bytes(checkpoint.to_bytes()))
        touching += again.snapshot().energy['contact'] > 0.0
        again.advance_to(0.06)
        assert same_state(again.snapshot(), always.snapshot())
        assert again.checkpoint().difference(always.checkpoint()) == ''
    assert always.snapshot().energy['dissipated'] > 0.0


def test_a_damped_crowd_is_the_same_bits_for_any_threads(monkeypatch):
    scene, ends = crowd(contact__damping=2.0), []
    monkeypatch.setattr(crew, 'BODIES_PER_THREAD', 1)
    for count in (1, 3):
        monkeypatch.setattr(crew, 'core_count', lambda count=count: count)
        simulation = ico.compile_scene(scene)
        before, start = momenta(scene, simulation.snapshot()), simulation.snapshot().energy
        simulation.advance_to(0.06)
        ends.append(simulation.snapshot())
        for one, other, size in zip(before, momenta(scene, ends[-1]), (1.0, 0.1)):
            assert np.abs(one - other).max() < 4e-13 * 27 * scene.shell.mass * size
        assert abs(ends[-1].energy['balance_error']) < 1e-6 * start['total']
        assert ends[-1].energy['dissipated'] > 0.1 * start['total']
    assert same_state(*ends) and ends[0].energy == ends[1].energy


def test_a_damped_press_does_work_that_is_found_again():
    # Driven down onto a loose shell that lies on the floor, and up again.
    scene = loose(
        ((0.0, 0.0, 0.0335), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        planes__floor__normal=[0.0, 0.0, 1.0], planes__floor__offset=-0.0165,
        groups__press='ids 1', drives__press__group='press', drives__press__motion='sine',
        drives__press__linear=[0.0, 0.0, 1.7e-3], drives__press__frequency=40.0,
        contact__damping=3.0)
    simulation = ico.compile_scene(scene)
    touched, lost = 0, 0.0
    for time in np.linspace(0.0, 0.05, 60):
        simulation.advance_to(time)
        energy = simulation.snapshot().energy
        touched += energy['contact'] > 0.0
        assert energy['dissipated'] >= lost - 1e-12
        lost = energy['dissipated']
        assert abs(energy['balance_error']) < 1e-8 * max(energy['work_in'], 1e-4)
    assert touched > 3 and lost > 1e-5


def test_methods_that_cannot_are_refused():
    with pytest.raises(ico.ParameterError) as caught:
        ico.compile_scene(loose(OBLIQUE, contact__damping=1.0, solver__method='srkn4'))
    for part in ('solver.method', 'contact.damping', 'dop8'):
        assert part in str(caught.value)
    simulation = ico.compile_scene(loose(OBLIQUE, contact__damping=1.0, solver__method='auto'))
    assert simulation.method_name == 'dop8' and 'contact.damping' in simulation.method_reason
    # Where nothing touches nothing is damped.
    ico.compile_scene(loose(
        OBLIQUE, contact__damping=1.0, contact__mode='never', solver__method='srkn4'))
    with pytest.raises(ico.ParameterError, match='contact.damping'):
        loose(OBLIQUE, contact__damping=-1.0)


def test_what_is_not_damped_has_no_losses():
    free, damped = (
        ico.compile_scene(loose(
            ((0.0323, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), contact__damping=damping))
        for damping in (0.0, 1.0))
    contacts = [each._stepper.model.contacts for each in (free, damped)]
    assert contacts[0].losses is None and contacts[1].losses is not None
    assert free._stepper.work.spent is None
    # A given step knows its damping.
    assert damped.stability_limit < free.stability_limit
