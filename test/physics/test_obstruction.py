# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Connectors that run into the shell that they are attached to."""

import logging

from fabrics import BOTH_FORMS, FORMS, make_scene, pair_face_to_face, RANDOM, same_state
import icofabric_sim as ico
from icofabric_sim.geometry.icosahedron import face_geometry, vertices
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.obstruction import clips
from icofabric_sim.messages import decode_diagnostic_array, decode_marker_points, MarkerAction
from icofabric_sim.messages.markers import OBSTRUCTED, STRAIN_CLASSES
from icofabric_sim.messages.topics import Outputs
from icofabric_sim.running.diagnostics import HealthReport, WARN
from icofabric_sim.running.runner import Runner
from icofabric_sim.simulation.stepping.events.entering import Entering
from icofabric_sim.terms.shells import Shells
import numpy as np
import pytest

CALM = {'contact.mode': 'never', 'solver.method': 'leapfrog'}


def brute(scene, snapshot):
    """
    Bits as `Snapshot.obstructed`, from the normals of all faces that hold the attachment point.

    A direction leads into a convex body from a point of its surface where it leads below every
    face that holds the point.
    """
    half_edge, bits = scene.shell.half_edge, np.zeros(scene.connector_count, int)
    faces = face_geometry(half_edge)
    cosines = cosines_from_quaternions(snapshot.orientation)
    height = half_edge * ((1.0 + np.sqrt(5.0)) / 2.0) ** 2 / np.sqrt(3.0)
    for number, (bodies, points) in enumerate(
            zip(scene.connectors.bodies, scene.connectors.points_body)):
        ends = snapshot.connector_ends[number]
        for end in range(2):
            direction = cosines[bodies[end]] @ (ends[1 - end] - ends[end])
            holding = np.abs(faces.normals @ points[end] - height) < 1e-9 * height
            assert holding.sum() == 2
            if (faces.normals[holding] @ direction < 0.0).all():
                bits[number] |= 1 << end
    return bits


def scattered(turn=0.8, seed=2, **changes):
    """A fabric with its bodies turned about at random."""
    scene = make_scene((4, 3, 3), {**CALM, **changes})
    simulation = ico.compile_scene(scene)
    generator = np.random.default_rng(seed)
    orientation = scene.orientation + turn * generator.normal(size=(scene.body_count, 4))
    orientation /= np.linalg.norm(orientation, axis=1, keepdims=True)
    return scene, simulation, orientation


@pytest.mark.parametrize('form', FORMS)
def test_every_obstructed_connector_is_found_and_no_other(form):
    scene, _, orientation = scattered()
    simulation = ico.compile_scene(scene, rotation=form)
    simulation.set_state(orientation=orientation)
    snapshot = simulation.snapshot()
    wanted = brute(scene, snapshot)
    assert np.array_equal(snapshot.obstructed, wanted)
    assert {0, 1, 2, 3} == set(wanted.tolist())
    # The look at the running state counts the same ends.
    ends = int((wanted & 1).sum() + (wanted >> 1).sum())
    assert simulation.status.obstructed_ends == ends


# A vertex, a face, a point on an edge beside its middle, two stalks and a point within.
ANYWHERE = {
    'connector.attachment.up': (0.01 * vertices(1.0)[0]).tolist(),
    'connector.attachment.south': (0.01 * vertices(1.0)[[2, 4, 0]].mean(axis=0)).tolist(),
    'connector.attachment.west': [0.004, 0.01 * 0.5 * (1.0 + 5.0**0.5), 0.0],
    'connector.attachment.north': [0.021, 0.0, 0.001],
    'connector.attachment.east': [0.001, -0.01, 0.002], 'connector.attachment_scale': 1.2}


# Some shells smaller, some larger than those that the connectors are attached for.
SIZED = {
    'groups.low': 'x_min', 'masses.low.group': 'low', 'masses.low.edge_length': 0.014,
    'groups.high': 'x_max', 'masses.high.group': 'high', 'masses.high.edge_length': 0.024}


@pytest.mark.parametrize('form', BOTH_FORMS)
@pytest.mark.parametrize('changes', [
    ANYWHERE, {'connector.attachment_scale': 1.3}, SIZED,
    pytest.param({**ANYWHERE, **SIZED}, marks=pytest.mark.long)],
    ids=['anywhere', 'stalks', 'sizes', 'both'])
def test_from_any_points_the_open_segment_meets_the_interior(changes, form):
    scene, _, orientation = scattered(**changes)
    simulation = ico.compile_scene(scene, rotation=form)
    simulation.set_state(orientation=orientation)
    snapshot = simulation.snapshot()
    faces = face_geometry(0.01)
    heights = float(faces.normals[0] @ faces.centroids[0]) * scene.body_half_edges / 0.01
    cosines = cosines_from_quaternions(snapshot.orientation)
    fine, wanted = np.linspace(0.0, 1.0, 4001)[1:-1, None], snapshot.obstructed
    sure = outside = 0
    for number, (bodies, points) in enumerate(
            zip(scene.connectors.bodies, scene.connectors.points_body)):
        ends = snapshot.connector_ends[number]
        for end in range(2):
            span = cosines[bodies[end]] @ (ends[1 - end] - ends[end])
            height = heights[bodies[end]]
            deepest = ((points[end] + fine * span) @ faces.normals.T - height).max(axis=1).min()
            if (faces.normals @ points[end] < height * (1.0 - 1e-9)).all():
                assert not wanted[number] & 1 << end
            elif abs(deepest) > 2e-3 * height:
                assert bool(wanted[number] & 1 << end) == (deepest < 0.0)
                sure += 1
                outside += (faces.normals @ points[end]).max() > height * (1.0 + 1e-9)
    assert sure > 40 and outside > 15 and set(wanted.tolist()) >= {0, 1, 2}
    ends = int((wanted & 1).sum() + (wanted >> 1).sum())
    assert simulation.status.obstructed_ends == ends


def test_a_connector_that_lies_along_its_face_is_not_in_its_shell():
    # From the middle of a face outwards, along it, and inwards; from a stalk past a vertex.
    normal = face_geometry(1.0).normals[3]
    depth = 1.0 - face_geometry(1.0).normals @ normal
    depth[3] = 0.0
    stalk = 2.0 * (1.0 - face_geometry(1.0).normals @ normal) - 1.0
    shells = Shells(face_geometry(1.0).normals, np.array([depth, stalk]))
    beside = np.cross(normal, [1.0, 0.0, 0.0])
    for direction, inside in ((normal, False), (beside, False), (-normal, True)):
        assert clips(shells, 0, 0, *direction) == inside
        assert not clips(shells, 0, 1, *(0.9 * direction))
    assert clips(shells, 0, 1, *(-1.1 * normal)) and not clips(
        shells, 0, 1, *(-1.0 * normal))


def test_a_woven_fabric_has_none():
    for changes in ({}, {'weave.variant': 3}, {'weave.kind': 'bias'},
                    {'weave.connector_angle': 0.6}):
        snapshot = ico.compile_scene(make_scene((4, 4, 4), {**CALM, **changes})).snapshot()
        assert snapshot.connector_count > 10 and not snapshot.obstructed.any()


def turned_pair(**changes):
    """Two bodies on a line, of which one turns until the connector runs into its shell."""
    scene = make_scene((2, 2, 1), {**CALM, **changes})
    simulation = ico.compile_scene(scene)
    position, orientation = pair_face_to_face(
        scene, scene.geometry.cube_width + scene.geometry.connector_length)
    spin = np.zeros((2, 3))
    spin[1, 2] = 400.0
    simulation.set_state(position=position, orientation=orientation, angular_velocity=spin)
    return simulation


def test_it_is_said_once(caplog):
    simulation = turned_pair()
    with caplog.at_level(logging.WARNING):
        for time in np.linspace(0.0, 0.1, 30):
            simulation.advance_to(time)
    said = [record.message for record in caplog.records if 'enters the shell' in record.message]
    assert len(said) == 1
    assert 'connector 0' in said[0] and 'of body 1' in said[0] and 't = 0.0' in said[0]
    assert simulation.status.obstruction in said[0]
    # A checkpoint knows that it was said.
    other = turned_pair()
    other.restore(simulation.checkpoint())
    caplog.clear()
    other.advance_to(0.2)
    assert not caplog.records and other.status.obstruction == simulation.status.obstruction
    simulation.reset_time()
    assert simulation.status.obstruction == ''


@pytest.mark.parametrize('method', ['leapfrog', 'dop8'])
def test_stop_ends_the_run(method):
    simulation = turned_pair(**{'connector.obstruction': 'stop', 'solver.method': method})
    with pytest.raises(ico.SimulationError, match='connector 0, between bodies 0 and 1, enters'):
        simulation.advance_to(0.1)
    assert 0.0 < simulation.time < 0.05
    snapshot = simulation.snapshot()
    assert snapshot.time == simulation.time and snapshot.obstructed.tolist() == [2]
    # Not before: the same motion is free of it until shortly before.
    free = turned_pair(**{'solver.method': method})
    free.advance_to(0.5 * simulation.time)
    assert not free.snapshot().obstructed.any() and free.status.obstruction == ''


@pytest.mark.parametrize('method', ['srkn6', 'dop8'])
def test_looking_changes_no_bit(method, monkeypatch):
    scene = make_scene((3, 3, 2), {**CALM, 'solver.method': method}, **RANDOM)
    ends = []
    for blind in (False, True):
        if blind:
            monkeypatch.setattr(
                'icofabric_sim.simulation.stepping.obstruction.Obstruction.is_watching',
                property(lambda _: False))
        simulation = ico.compile_scene(scene)
        simulation.advance_to(0.05)
        assert bool(simulation.status.obstruction) is not blind
        ends.append(simulation.snapshot())
    assert same_state(*ends)


def test_it_is_marked_and_counted():
    scene, simulation, orientation = scattered()
    simulation.set_state(orientation=orientation)
    snapshot = simulation.snapshot()
    lists = {}
    for message in Outputs(scene).connectors(snapshot, 0):
        marker = decode_marker_points(message)
        if marker.action == MarkerAction.ADD:
            lists[marker.marker_id] = np.array(marker.points).reshape(-1, 2, 3)
    entry = lists[len(STRAIN_CLASSES) + 1]
    assert np.array_equal(entry, snapshot.connector_ends[snapshot.obstructed > 0])
    assert sum(map(len, lists.values())) == scene.connector_count
    assert OBSTRUCTED.name == 'in the shell it is attached to'
    runner = Runner(simulation, [])
    simulation.advance_to(0.001)
    _, [status] = decode_diagnostic_array(HealthReport('/icofabric').bytes(runner.status()))
    values = dict(status.values)
    assert int(values['connector ends in their shells']) == simulation.status.obstructed_ends > 0
    assert status.level == WARN
    assert 'connector ends were in their own shells' in values['reasons']
    assert monitor.OBSTRUCTED < monitor.LEDGER_COUNT


def test_stop_ends_a_run_of_long_steps_at_the_first_that_shows_one_or_within_it():
    changes = {
        'contact.mode': 'never', 'solver.method': 'dop8', 'solver.tolerance': 1e-3,
        'initial_random.velocity_sigma': 0.1, 'initial_random.spin_sigma': 8.0}
    one_by_one, clear = ico.compile_scene(make_scene((3, 3, 3), changes)), 0.0
    for _ in range(200):
        one_by_one.advance_steps(1)
        seen = one_by_one.snapshot()
        if seen.obstructed.any():
            break
        clear = seen.time
    assert seen.obstructed.any() and one_by_one.status.step_count > 3
    stopping = ico.compile_scene(make_scene((3, 3, 3), {
        **changes, 'connector.obstruction': 'stop'}))
    with pytest.raises(ico.SimulationError, match='enters the shell') as caught:
        stopping.advance_to(1.0)
    stopped = float(str(caught.value).split('at t = ')[1].split(' s')[0])
    assert clear < stopped < seen.time * (1.0 + 1e-5)


def test_looks_within_steps_change_no_bit_and_end_a_step_where_one_shows_a_connector(monkeypatch):
    changes = {
        'contact.mode': 'never', 'solver.method': 'dop8', 'solver.tolerance': 1e-3,
        'initial_random.velocity_sigma': 0.1, 'initial_random.spin_sigma': 8.0}
    looks, enters = [], Entering._enters
    monkeypatch.setattr(Entering, '_enters', lambda self, state: (
        looks.append(self._step.control.start), enters(self, state))[1])
    ends = []
    for mode in ('warn', 'stop'):
        simulation = ico.compile_scene(make_scene((3, 3, 3), {
            **changes, 'connector.obstruction': mode}))
        simulation.advance_to(0.02)
        ends.append(simulation.snapshot())
    assert same_state(*ends) and simulation.status.step_count > 3
    # At most a radian of the fastest motion apart.
    assert len(looks) > 0.5 * simulation.status.step_count
    # As if the second look showed one; the state there does not, and the run goes on.
    looks.clear()
    monkeypatch.setattr(Entering, '_enters', lambda self, state: (
        looks.append(self._step.control.start), len(looks) == 2)[1])
    simulation.advance_to(0.0245)
    control = simulation._driver.trajectory.control
    assert len(looks) >= 2 and looks[1] < control.start < 0.0245
    assert simulation.status.obstruction == ''
