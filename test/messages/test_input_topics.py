# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Topics and frames of inputs, and what their messages put on which target."""

import icofabric_sim as ico
from icofabric_sim.messages import PointStampedBytes, TwistStampedBytes, WrenchStampedBytes
from icofabric_sim.messages.frames import body_frame, parse_body_frame
from icofabric_sim.messages.input_topics import (
    decode_input,
    input_topics,
    input_type,
    target_of,
    topic_of,
)
from icofabric_sim.simulation.inputs.input_types import (
    BodyTarget,
    ChannelTarget,
    DriveTarget,
    PullTarget,
    restored_target,
    stored_target,
    Twist,
    Wrench,
)
import pytest
from recorded_runs import DRIVEN_SCENE

TARGETS = [
    (BodyTarget(7), '~/wrench', 7), (ChannelTarget('tip_2'), '~/loads/tip_2', 'tip_2'),
    (DriveTarget('top'), '~/drives/top', 'drives.top')]


@pytest.mark.parametrize(('target', 'topic', 'stored'), TARGETS)
def test_target_survives_its_topic_and_its_checkpoint(target, topic, stored):
    message = (TwistStampedBytes if topic == '~/drives/top' else WrenchStampedBytes)(body_frame(7))
    first, second = (message.linear, message.angular) if isinstance(target, DriveTarget) else (
        message.force, message.torque)
    first[:], second[:] = (1.0, -2.0, 3.0), (0.1, 0.2, -0.3)
    assert topic_of(target) == topic and input_type(topic) == message.TYPE
    found = decode_input(topic, message.stamped(12))
    assert found.target == target and found.stamp == 12 and found.frame_id == 'icosahedron_7'
    assert type(found.value) is (Twist if isinstance(target, DriveTarget) else Wrench)
    assert [part.tolist() for part in found.value] == [[1.0, -2.0, 3.0], [0.1, 0.2, -0.3]]
    assert stored_target(target) == stored and restored_target(stored) == target


def test_targets_of_one_name_are_different():
    assert ChannelTarget('top') != DriveTarget('top')
    assert len({ChannelTarget('top'), DriveTarget('top'), ChannelTarget('top')}) == 2


def test_scene_names_its_topics():
    scene = ico.Scene.from_parameters({**DRIVEN_SCENE, 'loads': {'tip': {'group': 'top'}}})
    assert input_topics(scene) == {
        '~/wrench': WrenchStampedBytes.TYPE, '~/loads/tip': WrenchStampedBytes.TYPE,
        '~/drives/top': TwistStampedBytes.TYPE, '~/pull': PointStampedBytes.TYPE}
    for other in ('~/poses', '~/loads', '~/loads/', '~/loads/2', '~/drives/a/b', '/wrench'):
        assert input_type(other) == ''


@pytest.mark.parametrize('frame', [
    '', 'icosahedron', 'icosahedron_', 'icosahedron_01', 'icosahedron_-1', 'icosahedron_1 ',
    'icosahedron_\u0661', 'icosahedron_99999999999', 'Icosahedron_1'])
def test_frame_of_no_body_is_refused(frame):
    assert parse_body_frame(frame) is None
    with pytest.raises(ValueError, match="frame_id .* must be 'icosahedron_K'"):
        decode_input('~/wrench', WrenchStampedBytes(frame).stamped(0))


def test_pull_is_read_as_it_is_written():
    message = PointStampedBytes(body_frame(7))
    message.point[:] = 1.0, -2.0, 3.0
    found = decode_input('~/pull', message.stamped(12))
    assert found.target == PullTarget(7) and topic_of(found.target) == '~/pull'
    assert found.value.point.tolist() == [1.0, -2.0, 3.0] and not found.value.is_release
    message.point[:] = float('nan')
    assert decode_input('~/pull', message.stamped(0)).value.is_release
    with pytest.raises(ValueError, match="must be 'icosahedron_K'"):
        decode_input('~/pull', PointStampedBytes('world').stamped(0))


def test_frames_of_bodies_are_read_as_they_are_written():
    for body in (0, 1, 10, 9_999_999_999):
        assert parse_body_frame(body_frame(body)) == body


@pytest.mark.parametrize(('topic', 'frame'), [
    ('~/wrench', ''), ('~/wrench', 'world'), ('~/poses', 'icosahedron_1'),
    ('~/wrench_2', 'icosahedron_1')])
def test_topic_or_frame_of_no_target(topic, frame):
    assert target_of(topic, frame) is None
    assert target_of('~/wrench', 'icosahedron_1') == BodyTarget(1)
    assert target_of('~/loads/a', frame) == ChannelTarget('a')
