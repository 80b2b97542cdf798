# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Messages from snapshots: bit by bit what NumPy makes of them, and never twice in memory."""
import tracemalloc

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.geometry.icosahedron import circumscribed_radius, FACES, vertices
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.messages import (
    decode_float64_multi_array,
    decode_marker_points,
    decode_pose_array,
    MarkerAction,
    MarkerType,
)
from icofabric_sim.messages.markers import OBSTRUCTED, SHELL_CLASSES, STRAIN_CLASSES
from icofabric_sim.messages.topics import CONNECTORS, ICOSAHEDRA, Outputs, POSES, Recorded, TOPICS
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.simulation.model.snapshot import Snapshot
import numpy as np
import pytest
from runner_helpers import ListSink, make_runner, run

NOW = 12_000_000_034
SCENES = [
    {'weave': {'size': [4, 5, 3]}},
    {'weave': {'kind': 'bias', 'size': [4, 3, 3], 'variant': 1}, 'frame_id': 'map'},
    {'weave': {'size': [3, 3, 3], 'connected': False}},
    {'weave': {'size': [5, 5, 5], 'connector_angle': 0.4},
     'groups': {'top': 'z_max'}, 'supports': {'ceiling': {'group': 'top'}},
     'bodies': {'ball': {'position': [1.0, 2.0, 3.0]}}},
]


def scattered(scene, spread, seed=0):
    """A snapshot with bodies displaced and turned by about `spread` of a and of a radian."""
    generator = np.random.default_rng(seed)
    count = scene.body_count
    position = scene.position + spread * scene.geometry.half_edge * generator.normal(
        size=(count, 3))
    orientation = scene.orientation + spread * generator.normal(size=(count, 4))
    orientation /= np.linalg.norm(orientation, axis=1, keepdims=True)
    velocity, spin = generator.normal(size=(2, count, 3))
    return Snapshot(
        0.25, position, orientation, velocity, spin, scene.connector_count, pack_scene(scene),
        {'work_in': 0.5, 'start': 0.25})


def plain_ends(scene, snapshot):
    """
    Ends of all connectors [m], (c, 2, 3), in whole-array NumPy with the operations of the kernel.
    """
    x, y, z, w = snapshot.orientation.T
    h = 0.5 * scene.geometry.cube_width
    arms = np.stack([
        np.stack([h * 2.0 * (x * z + w * y), h * 2.0 * (y * z - w * x),
                  h * (1.0 - 2.0 * (x * x + y * y))], axis=1),
        np.stack([h * (1.0 - 2.0 * (y * y + z * z)), h * 2.0 * (x * y + w * z),
                  h * 2.0 * (x * z - w * y)], axis=1),
        np.stack([h * 2.0 * (x * y - w * z), h * (1.0 - 2.0 * (x * x + z * z)),
                  h * 2.0 * (y * z + w * x)], axis=1)], axis=1)
    bodies, edges = scene.connectors.bodies, scene.connectors.edges
    sign = np.where(edges & 1, -1.0, 1.0)[..., None]
    return snapshot.position[bodies] + sign * arms[bodies, edges >> 1]


@pytest.mark.parametrize('sections', SCENES)
@pytest.mark.parametrize('spread', [0.0, 0.01, 0.3])
def test_messages_are_bit_by_bit_those_of_plain_numpy(sections, spread):
    scene = ico.Scene.from_parameters(sections)
    snapshot = scattered(scene, spread)
    outputs = Outputs(scene)
    poses = decode_pose_array(outputs.poses(snapshot, NOW))
    assert poses.frame_id == sections.get('frame_id', 'world') and poses.nanoseconds == NOW
    assert (poses.values == np.hstack([snapshot.position, snapshot.orientation])).all()
    state = decode_float64_multi_array(outputs.state(snapshot))
    assert (state.values == np.hstack([
        snapshot.position, snapshot.orientation, snapshot.linear_velocity,
        snapshot.angular_velocity])).all()

    markers = [decode_marker_points(data) for data in outputs.connectors(snapshot, NOW)]
    ends = plain_ends(scene, snapshot)
    length = np.sqrt(((ends[:, 1] - ends[:, 0]) ** 2).sum(axis=1))
    assert (snapshot.connector_length == length).all()
    assert (snapshot.connector_ends == ends).all()
    strain = length / scene.connectors.natural_length - 1.0
    classes = np.searchsorted([entry.above for entry in STRAIN_CLASSES[1:]], strain)
    classes[snapshot.obstructed > 0] = len(STRAIN_CLASSES)
    if not scene.connector_count:
        assert markers == []
        return
    assert [marker.marker_id for marker in markers] == [0, 1, 2, 3, 4, 6]
    assert {marker.namespace for marker in markers} == {'connectors'}
    for number, (marker, entry) in enumerate(zip(markers, (*STRAIN_CLASSES, OBSTRUCTED))):
        chosen = ends[classes == number].reshape(-1, 3)
        assert marker.points.shape == chosen.shape and (marker.points == chosen).all()
        assert marker.action == (MarkerAction.ADD if len(chosen) else MarkerAction.DELETE)
        assert marker.marker_type == MarkerType.LINE_LIST and marker.nanoseconds == NOW
        np.testing.assert_allclose(marker.color, entry.color, rtol=1e-6)
    assert np.count_nonzero(np.bincount(classes)) >= (1 if spread == 0.0 else 2)


def test_strains_on_a_bound_and_beyond_numbers_have_a_class():
    scene = make_scene((3, 3, 3))
    snapshot = scattered(scene, 0.0)
    natural = scene.connectors.natural_length
    lengths = np.full(scene.connector_count, natural)
    bounds = np.array([entry.above for entry in STRAIN_CLASSES[1:]])
    lengths[:4] = (1.0 + bounds) * natural
    lengths[4:7] = np.nan, np.inf, 0.0
    expected = np.searchsorted(bounds, lengths / natural - 1.0)
    assert expected[4] == expected[5] == 4 and expected[6] == 0
    snapshot.__dict__['connector_length'] = lengths
    markers = [decode_marker_points(data) for data in Outputs(scene).connectors(snapshot, NOW)]
    assert [len(marker.points) // 2 for marker in markers] == np.bincount(
        expected, minlength=6).tolist()


def test_connector_messages_depend_on_nothing_but_the_state():
    scene = make_scene((4, 4, 4))
    calm, wild = scattered(scene, 0.0), scattered(scene, 0.5)
    outputs = Outputs(scene)
    first = list(outputs.connectors(calm, NOW))
    assert list(outputs.connectors(wild, NOW)) != first
    assert list(outputs.connectors(calm, NOW)) == first
    # Lists that the wild state had are removed for all subscribers.
    assert [decode_marker_points(data).action for data in first] == [2, 2, 0, 2, 2, 2]


def peak_while(action):
    tracemalloc.start()
    try:
        return action(), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize('spread', [0.0, 0.5])
def test_a_message_is_in_memory_once(spread):
    scene = make_scene((20, 20, 20))
    snapshot = scattered(scene, spread)
    outputs = Outputs(scene)
    for data in (*outputs.connectors(snapshot, NOW), *outputs.icosahedra(snapshot, NOW)):
        del data  # what is made only once is there
    lengths = 11 * scene.connector_count  # and classes, and what is obstructed
    message, peak = peak_while(lambda: outputs.poses(snapshot, NOW))
    assert len(message) > 200_000 and peak < 1.1 * len(message)
    message, peak = peak_while(lambda: outputs.state(snapshot))
    assert peak < 1.1 * len(message)

    def largest(messages):
        size = 0
        for data in messages:
            size = max(size, len(data))
            del data
        return size

    state = scattered(scene, spread)  # of which nothing is known yet
    size, peak = peak_while(lambda: largest(outputs.connectors(state, NOW)))
    assert size > 200_000 and peak < 1.1 * size + lengths
    size, peak = peak_while(lambda: largest(outputs.icosahedra(state, NOW)))
    assert size > 1440 * scene.body_count and peak < 1.1 * size


def test_shells_stand_where_the_bodies_are():
    scene = ico.Scene.from_parameters(SCENES[3])
    snapshot = scattered(scene, 0.3)
    markers = [decode_marker_points(data) for data in Outputs(scene).icosahedra(snapshot, NOW)]
    held = scene.supports.translation.all(axis=1)
    assert [len(marker.points) for marker in markers] == [60 * (~held).sum(), 60 * held.sum()]
    assert 0 < held.sum() < scene.body_count
    axes = cosines_from_quaternions(snapshot.orientation)
    for number, (marker, bodies) in enumerate(zip(markers, (~held, held))):
        assert marker.marker_type == MarkerType.TRIANGLE_LIST and marker.marker_id == number
        assert marker.namespace == 'icosahedra' and marker.scale.tolist() == [1, 1, 1]
        np.testing.assert_allclose(marker.color, SHELL_CLASSES[number].color, rtol=1e-6)
        corners = snapshot.position[bodies, None] + np.einsum(
            'va,nai->nvi', vertices(scene.shell.half_edge), axes[bodies])
        triangles = marker.points.reshape(-1, 20, 3, 3)
        np.testing.assert_allclose(triangles, corners[:, FACES], rtol=0, atol=1e-14)
        arms = triangles - snapshot.position[bodies][:, None, None]
        np.testing.assert_allclose(
            np.linalg.norm(arms, axis=-1), circumscribed_radius(scene.shell.half_edge))
        outward = np.cross(
            triangles[:, :, 1] - triangles[:, :, 0], triangles[:, :, 2] - triangles[:, :, 0])
        assert (np.einsum('nfi,nfi->nf', outward, arms.mean(axis=2)) > 0.0).all()


def test_shells_of_a_size_of_their_own_are_shown_in_it():
    scene = make_scene((3, 3, 2), {
        'groups.low': 'z_min', 'masses.low.group': 'low', 'masses.low.edge_length': 0.012,
        'groups.side': 'x_min', 'supports.side.group': 'side',
        'bodies.ball.position': [0.0, 0.0, 0.3], 'bodies.ball.edge_length': 0.05})
    snapshot = scattered(scene, 0.1)
    places, numbers = [], []
    for data in Outputs(scene).icosahedra(snapshot, NOW):
        marker = decode_marker_points(data)
        numbers.append(marker.marker_id)
        for shell in marker.points.reshape(-1, 60, 3):
            places.append((shell.mean(axis=0), np.linalg.norm(shell[0] - shell[1])))
    assert len(numbers) == len(set(numbers)) == 5 and len(places) == scene.body_count
    for place, edge in places:
        body = int(np.argmin(np.linalg.norm(snapshot.position - place, axis=1)))
        assert np.linalg.norm(snapshot.position[body] - place) < 1e-12
        assert edge == pytest.approx(2.0 * scene.body_half_edges[body])
    assert set(scene.body_half_edges.tolist()) == {0.01, 0.006, 0.025}


def test_shells_of_many_bodies_come_in_a_few_lists():
    scene = make_scene((46, 46, 47), connector={'stiffness': 1.0}, weave={
        'size': [46, 46, 47], 'connected': False}, groups={'top': 'z_max'},
        supports={'ceiling': {'group': 'top'}})
    snapshot = scattered(scene, 0.1)
    seen, points = [], 0
    for data in Outputs(scene).icosahedra(snapshot, NOW):
        marker = decode_marker_points(data)
        seen.append(marker.marker_id)
        points += len(marker.points)
    assert points == 60 * scene.body_count and scene.body_count > 49_000
    assert len(seen) == len(set(seen)) and 2 < len(seen) <= ICOSAHEDRA.depth


def test_shells_are_built_for_those_who_listen_and_for_no_bag(monkeypatch):
    assert ICOSAHEDRA in TOPICS and ICOSAHEDRA.recorded is Recorded.NEVER
    assert not ICOSAHEDRA.latched
    listener = ListSink(ICOSAHEDRA, CONNECTORS)
    runner = run(make_runner(listener, marker_rate=20.0))
    times = {time for time, _ in listener.of(ICOSAHEDRA)}
    assert times == {time for time, _ in listener.of(CONNECTORS)} == {0, 50_000_000, 100_000_000}
    listener.messages.clear()
    runner.reset()
    run(runner)
    for topic, namespace in ((ICOSAHEDRA, 'icosahedra'), (CONNECTORS, 'connectors')):
        markers = [decode_marker_points(data) for _, data in listener.of(topic)]
        actions = [marker.action for marker in markers]
        assert actions.count(MarkerAction.DELETEALL) == 1
        # Shown again after it.
        assert MarkerAction.ADD in actions[actions.index(MarkerAction.DELETEALL):]
        assert {marker.namespace for marker in markers} == {namespace}
    monkeypatch.setattr(Outputs, 'icosahedra', lambda *arguments: pytest.fail('built'))
    run(make_runner(sink := ListSink(POSES)))
    assert sink.of(POSES)
