# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Some bodies of a fabric are published, recorded and made frames; what reads them knows which."""

from dataclasses import replace

import icofabric_sim as ico
from icofabric_sim.bag import BagError
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.bag.summary import summarise_bag
from icofabric_sim.messages import decode_float64_multi_array, decode_pose_array, topics
from icofabric_sim.messages.topics import Outputs
from icofabric_sim.pictures.render import draw_sheet, recorded_bodies, RunMoments
from icofabric_sim.pictures.run_plots import plot_run
from icofabric_sim.running.broadcast import Broadcast
from icofabric_sim.running.recording import BagSink, summarise_run
from icofabric_sim.running.replay.comparison import CloseComparison
from icofabric_sim.running.replay.verify import verify_run
from icofabric_sim.running.runner import Runner
from icofabric_sim.viewer.sight import Sight
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import get_typestore, Stores
from runner_helpers import ListSink

CHOSEN = {'publish.group': 'tip', 'publish.stride': 3, 'tf.group': 'tip'}


@pytest.fixture(scope='module')
def scene():
    return ico.load_scene('hanging_slab').with_changes(CHOSEN)


@pytest.fixture(scope='module')
def bag(scene, tmp_path_factory):
    path = tmp_path_factory.mktemp('published') / 'bag'
    simulation = ico.compile_scene(scene.with_changes({
        'record.path': str(path), 'duration': 0.1, 'real_time_factor': 0.0}))
    sink = BagSink(path, simulation, live=False)
    runner = Runner(simulation, [sink])
    runner.run(until_finished=True)
    sink.close(summary=summarise_run(runner.status()))
    return path, simulation.snapshot()


def test_messages_hold_the_chosen_bodies_in_order(scene):
    simulation, outputs = ico.compile_scene(scene), Outputs(scene)
    simulation.advance_to(0.02)
    s, chosen = simulation.snapshot(), np.sort(scene.groups['tip'])[::3]
    assert 0 < len(chosen) < len(scene.groups['tip']) < scene.body_count
    poses = decode_pose_array(outputs.poses(s, 7))
    assert (poses.values == np.hstack([s.position, s.orientation])[chosen]).all()
    state = decode_float64_multi_array(outputs.state(s)).values
    assert (state == np.hstack([
        s.position, s.orientation, s.linear_velocity, s.angular_velocity])[chosen]).all()
    spins = decode_float64_multi_array(outputs.body_spin(s)).values
    assert (spins == s.angular_velocity_body[chosen]).all() and spins.any()
    assert (decode_float64_multi_array(outputs.bodies()).values == chosen).all()


def test_all_are_published_where_nothing_is_said():
    scene = ico.load_scene('hanging_slab')
    assert scene.published_bodies is None and scene.framed_bodies is None
    sink = ListSink(*topics.TOPICS)
    Broadcast([sink], ico.compile_scene(scene)).start(0)
    sent = {topic for topic, _, _ in sink.messages}
    assert topics.POSES in sent and not sent & {topics.BODIES, topics.TF}


def test_every_so_many_th_of_all():
    scene = ico.load_scene('hanging_slab').with_changes({'publish.stride': 10})
    assert scene.published_bodies.tolist() == list(range(0, scene.body_count, 10))


@pytest.mark.parametrize('changes, words', [
    ({'publish.group': 'nobody'}, 'publish.group: there is no group .nobody.; known: all, tip'),
    ({'tf.group': 'nobody'}, 'tf.group: there is no group .nobody.'),
    ({'publish.stride': 0}, 'publish.stride must be at least 1, got 0'),
    ({'groups.none': 'x_min and x_max', 'publish.group': 'none'}, 'none')])
def test_what_chooses_nobody_is_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        ico.load_scene('hanging_slab').with_changes(changes)


@pytest.mark.parametrize('changes, words', [
    ({'frame_id': '', 'tf.group': 'tip'}, "frame_id is '': tf2 refuses an empty parent frame"),
    ({'frame_id': '/world'}, "frame_id is '/world': tf2 refuses a leading /"),
    ({'frame_id': 'icosahedron_3'}, 'this is the frame of a body'),
    ({'frame_id': 'icosahedron'}, 'this is the frame of a body')])
def test_frames_that_tf2_cannot_resolve_are_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        ico.load_scene('hanging_slab').with_changes(changes)


@pytest.mark.parametrize('frame', ['', 'map', 'robot/base', 'icosahedra'])
def test_other_frames_are_taken(frame):
    scene = ico.load_scene('hanging_slab').with_changes({'frame_id': frame})
    assert scene.parameters['frame_id'] == frame


def test_frames_are_what_other_tools_read(scene):
    simulation, outputs = ico.compile_scene(scene), Outputs(scene)
    simulation.advance_to(0.02)
    s, store = simulation.snapshot(), get_typestore(Stores.ROS2_JAZZY)
    message = store.deserialize_cdr(outputs.tf(s, 1_000_000_007), 'tf2_msgs/msg/TFMessage')
    assert len(message.transforms) == len(scene.groups['tip'])
    for body, frame in zip(np.sort(scene.groups['tip']), message.transforms):
        assert frame.child_frame_id == f'icosahedron_{body}'
        assert frame.header.frame_id == 'world'
        assert (frame.header.stamp.sec, frame.header.stamp.nanosec) == (1, 7)
        place, turn = frame.transform.translation, frame.transform.rotation
        assert (place.x, place.y, place.z) == tuple(s.position[body])
        assert (turn.x, turn.y, turn.z, turn.w) == tuple(s.orientation[body])


def test_a_bag_holds_them_and_is_simulated_again(bag, scene):
    path, end = bag
    with RecordedRun(path) as run:
        frames = list(run.poses())
        assert len(frames) == 7
        assert (frames[-1].position == end.position[scene.published_bodies]).all()
        report = verify_run(run)
    assert report.verdict == 'identical', report.lines()
    assert summarise_bag(path).largest_displacement[1] in scene.published_bodies
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        counts = {one.topic: one.msgcount for one in reader.connections}
    assert counts['/tf'] == 7 and counts['/icofabric/bodies'] == 1


def test_poses_that_are_too_far_name_their_body(bag):
    path, _ = bag
    with RecordedRun(path) as run:
        simulation = ico.compile_scene(run.scene_at(0))
        comparison = CloseComparison(run, lambda: simulation)
        outputs, s = Outputs(simulation.scene), simulation.snapshot()
        assert comparison.difference(topics.POSES, 0, outputs.poses(s, 0)) == ''
        body = int(simulation.scene.published_bodies[1])
        place = s.position.copy()
        place[body, 0] += 1e-3
        text = comparison.difference(
            topics.POSES, 0, outputs.poses(replace(s, position=place), 0))
    assert text.startswith(f'body {body}: 0.001 m'), text


def test_pictures_show_the_recorded_bodies(bag, tmp_path):
    path, _ = bag
    assert draw_sheet(path, tmp_path / 'sheet.png', moments=2)
    with RecordedRun(path) as run:
        scene = run.scene_at(0)
        names = ' '.join(map(str, scene.published_bodies))
        plot_run(run, 'displacement', tmp_path / 'tip.png', groups=[names])
        moment = next(RunMoments(run).at(run.pose_times()[-1:]))
        assert np.flatnonzero(moment.known).tolist() == scene.published_bodies.tolist()
        assert np.isfinite(moment.position).all()
        with pytest.raises(ValueError, match='no poses of body 0, as publish.group'):
            recorded_bodies(scene, '--bodies', '0')
        for groups, words in (([], 'no group of which it holds all poses'),
                              ([names], 'forces are drawn of all bodies')):
            with pytest.raises(BagError, match=words):
                plot_run(run, 'tension', tmp_path / 'tension.png', groups=groups)


def test_the_viewer_shows_the_published_bodies(scene):
    simulation, outputs, sight = ico.compile_scene(scene), Outputs(scene), Sight()
    simulation.advance_to(0.02)
    s = simulation.snapshot()
    sight.feed(topics.WEAVE, outputs.weave(scene.parameters))
    sight.feed(topics.POSES, outputs.poses(s, 0))
    seen = sight.fabric.seen
    assert np.flatnonzero(seen).tolist() == scene.published_bodies.tolist()
    poses = sight.poses()
    assert (poses[seen, :3] == s.position[seen]).all() and len(poses) == scene.body_count
    assert (poses[~seen, :3] == scene.position[~seen]).all()
    sight.sample()
    assert sight.curves[-1].displacement > 0.0
