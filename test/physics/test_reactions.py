# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Reactions of supports, drives, anchors and planes: Newton's balance of the whole, statics."""

import math

from fabrics import snapshot_of
import icofabric_sim as ico
from icofabric_sim.geometry.rotations import rotate_quaternions
from icofabric_sim.messages import decode_float64_multi_array
from icofabric_sim.messages.topics import Outputs
from icofabric_sim.simulation.reports.load_cells import tensions_of
import numpy as np
import pytest

EDGE = 0.01


def momentum(snapshot, shell):
    """Momentum [kg m/s] and angular momentum about the origin [kg m^2/s] of all bodies."""
    linear = shell.mass * snapshot.linear_velocity
    angular = np.cross(snapshot.position, linear) + shell.inertia * snapshot.angular_velocity
    return np.concatenate([linear.sum(axis=0), angular.sum(axis=0)])


def wrench_of(reactions, *names):
    """Force [N] and torque about the origin [N m] of all, or of some."""
    chosen = [k for k, name in enumerate(reactions.names) if not names or name in names]
    force, torque = reactions.force[chosen], reactions.torque[chosen]
    torque = torque + np.cross(reactions.point[chosen], force)
    return np.concatenate([force.sum(axis=0), torque.sum(axis=0)])


def weight(snapshot, scene):
    """Weight [N] and its moment about the origin [N m]."""
    force = scene.shell.mass * np.array(scene.parameters['gravity'])
    return np.concatenate([
        len(snapshot.position) * force, np.cross(snapshot.position, force).sum(axis=0)])


def rate_of_momentum(scene, time, span):
    """Central difference at a time [s] of a run, and what its supports, drives and planes bear."""
    simulation = ico.compile_scene(scene)
    ends = []
    for moment in (time - span, time, time + span):
        simulation.advance_to(moment)
        ends.append(momentum(simulation.snapshot(), scene.shell))
        if moment == time:
            reactions, middle = simulation.reactions(), simulation.snapshot()
    return (ends[2] - ends[0]) / (2.0 * span), reactions, middle


def shaken():
    """A slab on a shaking table, under a weight."""
    return ico.load_scene('shaken_slab').with_changes({
        'gravity': [0.3, 0.0, -9.81], 'solver.tolerance': 1e-8})


def test_reactions_and_weight_are_the_rate_of_momentum():
    scene = shaken()
    rate, reactions, middle = rate_of_momentum(scene, 0.1313, 2e-5)
    assert reactions.names == ('drives.table',)
    scale = np.abs(reactions.force).max()
    arm = np.abs(middle.position).max()
    unit = np.array([1.0] * 3 + [arm] * 3) * scale
    found = wrench_of(reactions) + weight(middle, scene)
    # The difference over 4e-5 s errs by (w h)^2 / 6, with w of the damped motion.
    assert np.abs((found - rate) / unit).max() < 1e-5
    assert np.abs(rate / unit).max() > 0.02
    # The sum over bodies is the same, and nothing is borne where nothing is held.
    free = np.ones(scene.body_count, bool)
    free[scene.groups['table']] = False
    assert not reactions.on_bodies[free].any()
    total = reactions.on_bodies[:, :3].sum(axis=0)
    assert total == pytest.approx(reactions.force.sum(axis=0), abs=1e-12 * scale)


def test_measuring_changes_no_bit():
    scene = shaken()
    watched, alone = ico.compile_scene(scene), ico.compile_scene(scene)
    for moment in np.linspace(0.001, 0.01, 7):
        watched.advance_to(moment)
        watched.reactions()
        watched.contacts()
    alone.advance_to(0.01)
    for one, other in zip(states(watched), states(alone)):
        assert (one == other).all()
    assert watched.error_estimate == alone.error_estimate


def states(simulation):
    snapshot = simulation.snapshot()
    return (snapshot.position, snapshot.orientation, snapshot.linear_velocity,
            snapshot.angular_velocity)


def test_at_rest_they_are_those_of_statics():
    scene = ico.load_scene('hanging_slab')
    rest = ico.solve_equilibrium(scene)
    simulation = ico.compile_scene(scene)
    still = np.zeros((scene.body_count, 3))
    simulation.set_state(
        position=rest.snapshot.position, orientation=rest.snapshot.orientation,
        linear_velocity=still, angular_velocity=still)
    reactions = simulation.reactions()
    weighs = scene.body_count * scene.shell.mass * 9.81
    assert np.abs(reactions.on_bodies - rest.reaction).max() < 1e-8 * weighs
    assert reactions.force[0] == pytest.approx([0.0, 0.0, weighs], abs=1e-8 * weighs)
    assert np.abs(simulation.tensions() - rest.tension).max() < 1e-9 * weighs


def test_a_floor_bears_what_falls_on_it_with_losses():
    scene = ico.Scene.from_parameters({
        'weave': {'size': [1, 1, 1]}, 'gravity': [0.0, 0.0, -9.81],
        'planes': {'floor': {'normal': [0.0, 0.0, 1.0], 'offset': -1.62 * EDGE}},
        'contact': {'stiffness': 1e5, 'damping': 2.0, 'friction': 0.3},
        'initial': {'push': {
            'group': 'all', 'linear_velocity': [0.2, 0.0, -0.3],
            'angular_velocity': [0.0, 10.0, 5.0]}},
        'solver': {'tolerance': 1e-9, 'method': 'dop8'}})
    simulation, shell = ico.compile_scene(scene), scene.shell
    # Impulse of the floor by Gauss' rule over windows that are short beside a contact.
    nodes, weights = np.polynomial.legendre.leggauss(3)
    time, span, impulse, seen = 0.0, 2e-6, np.zeros(6), 0
    start = momentum(simulation.snapshot(), shell)
    for _ in range(600):
        for node, part in zip(nodes, weights):
            simulation.advance_to(time + 0.5 * span * (1.0 + node))
            reactions = simulation.reactions()
            contacts = simulation.contacts()
            seen += len(contacts.overlap)
            assert reactions.force[0] == pytest.approx(contacts.force.sum(axis=0))
            impulse += 0.5 * span * part * (
                wrench_of(reactions) + weight(simulation.snapshot(), scene))
        time += span
    simulation.advance_to(time)
    change = momentum(simulation.snapshot(), shell) - start
    assert seen > 100 and change[2] > 0.1 * shell.mass * 0.3
    assert abs(change[0]) > 1e-3 * change[2]  # friction
    assert impulse == pytest.approx(change, abs=2e-4 * change[2])


def test_an_anchor_bears_a_body_that_hangs_on_it():
    scene = ico.Scene.from_parameters({
        'weave': {'size': [1, 1, 1]}, 'gravity': [0.0, 0.0, -9.81], 'contact': {'mode': 'never'},
        'connector': {'stiffness': 100.0, 'natural_length': 0.01},
        'anchors': {'hook': {'body': 0, 'edge': 'up', 'position': [0.0, 0.0, 0.06]}}})
    simulation = ico.compile_scene(scene)
    rest = ico.solve_equilibrium(scene).snapshot
    simulation.set_state(position=rest.position, orientation=rest.orientation)
    reactions, weighs = simulation.reactions(), scene.shell.mass * 9.81
    assert reactions.names == ('anchors.hook',)
    assert reactions.force[0] == pytest.approx([0.0, 0.0, weighs], abs=1e-7 * weighs)
    assert reactions.point[0] == pytest.approx([0.0, 0.0, 0.06])
    assert not reactions.torque.any() and not reactions.on_bodies.any()


def test_a_damper_pulls_beside_its_spring():
    scene = ico.load_scene('hanging_slab').with_changes({'connector.damping': 0.5})
    simulation, random = ico.compile_scene(scene), np.random.default_rng(5)
    place = simulation.snapshot().position
    velocity = random.normal(0.0, 0.1, place.shape)
    velocity[scene.groups['wall']] = 0.0
    lengths, span = [], 1e-6
    for way in (-span, span):
        simulation.set_state(position=place + way * velocity)
        lengths.append(simulation.snapshot().connector_length)
    rate = (lengths[1] - lengths[0]) / (2.0 * span)
    simulation.set_state(position=place)
    still = simulation.tensions()
    simulation.set_state(linear_velocity=velocity)
    assert np.abs(rate).max() > 0.1
    assert simulation.tensions() - still == pytest.approx(0.5 * rate, abs=1e-8)


def test_the_tension_of_a_damped_connector_around_a_shell_is_not_known():
    scene = ico.load_scene('twisted_column').with_changes({'connector.damping': 0.5})
    position, orientation = scene.initial.position, scene.initial.orientation
    woven = snapshot_of(scene, position, orientation)
    assert np.isfinite(tensions_of(scene, woven)).all()
    turn = np.zeros_like(position)
    turn[::3, 2] = 1.5  # rad
    wound = snapshot_of(scene, position, rotate_quaternions(turn, orientation))
    around = wound.obstructed != 0
    assert around.any() and not around.all()
    assert (np.isnan(tensions_of(scene, wound)) == around).all()


def test_topics_say_what_was_measured():
    scene = ico.load_scene('hanging_slab').with_changes(
        {'groups.top': 'z_max', 'publish.connectors': 'top top'})
    simulation, outputs = ico.compile_scene(scene), Outputs(scene)
    simulation.advance_to(0.01)
    reactions, chosen = simulation.reactions(), scene.published_connectors
    assert 0 < len(chosen) < scene.connector_count
    sent = decode_float64_multi_array(outputs.reactions(reactions)).values
    assert (sent[:, :3] == reactions.force).all() and (sent[:, 6:] == reactions.point).all()
    sent = decode_float64_multi_array(outputs.tensions(simulation.tensions())).values
    assert (sent[:, 0] == chosen).all()
    assert (sent[:, 1] == simulation.tensions()[chosen]).all() and sent[:, 1].any()
    sent = decode_float64_multi_array(outputs.contacts(simulation.contacts())).values
    assert sent.shape == (0, 15)
    with pytest.raises(ValueError, match='publish.connectors'):
        scene.with_changes({'publish.connectors': 'top nowhere'})


def test_at_rest_they_have_the_names_and_values_of_a_run():
    """A support, a drive that holds, an anchor and a floor share the weight of a slab."""
    half = 0.02 * (1.0 + math.sqrt(5.0)) / 4.0
    scene = ico.Scene.from_parameters({
        'weave.size': [4, 3, 3], 'weave.connector_angle': 0.25, 'contact.stiffness': 2e4,
        'groups.wall': 'x_min', 'supports.wall.group': 'wall', 'groups.tip': 'x_max',
        'drives.tip.group': 'tip', 'drives.tip.freedoms': 'tz', 'anchors.tie.body': 8,
        'anchors.tie.edge': 'up', 'anchors.tie.position': [0.01, 0.0, 0.1],
        'anchors.tie.stiffness': 20.0, 'gravity': [0.0, 0.0, -9.81],
        'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -0.2,
        # On the floor, far below the slab.
        'bodies.ball.position': [0.05, 0.5, -0.2 + half], 'groups.ball': 'ids 18',
        'supports.ball.group': 'ball', 'supports.ball.fix': 'tx ty rotation',
        'connector.bending_stiffness': 0.02, 'connector.twisting_stiffness': 0.02})
    assert scene.body_count == 19
    found = ico.solve_equilibrium(scene)
    assert found.converged
    simulation = ico.compile_scene(scene)
    snapshot = found.snapshot
    simulation.set_state(
        position=snapshot.position, orientation=snapshot.orientation,
        linear_velocity=np.zeros((19, 3)), angular_velocity=np.zeros((19, 3)))
    running, at_rest = simulation.reactions(), found.reactions
    assert at_rest.names == running.names == (
        'supports.ball', 'supports.wall', 'drives.tip', 'anchors.tie', 'planes.floor')
    scale = np.abs(running.force).max()
    assert at_rest.force == pytest.approx(running.force, abs=1e-7 * scale)
    assert at_rest.point == pytest.approx(running.point, abs=1e-9)
    assert at_rest.torque == pytest.approx(running.torque, abs=1e-7 * scale)
    weight = 19 * scene.shell.mass * 9.81
    assert at_rest.force[:, 2].sum() == pytest.approx(weight, rel=1e-8)
    # Each has its part.
    assert (np.abs(at_rest.force[1:]).max(axis=1) > 1e-3 * scale).all()
    assert at_rest.force[-1, 2] == pytest.approx(scene.shell.mass * 9.81, rel=1e-6)
