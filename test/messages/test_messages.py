# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Message bytes against rosbags' own encoder and decoder, value by value, and against nonsense."""
from __future__ import annotations

from typing import Any

from icofabric_sim import messages
from message_cases import CASES, plain
import numpy as np
import pytest
from rosbags.typesys import get_typestore, Stores

TYPES = get_typestore(Stores.ROS2_JAZZY)
PARAMETERS = pytest.mark.parametrize(
    ('type_name', 'data', 'expected'), [case[1:] for case in CASES],
    ids=[case[0][:60] for case in CASES])
DECODERS = {
    messages.PoseArrayBytes.TYPE: messages.decode_pose_array,
    messages.MarkerBytes.TYPE: messages.decode_marker_points,
    messages.WrenchStampedBytes.TYPE: messages.decode_wrench_stamped,
    messages.TwistStampedBytes.TYPE: messages.decode_twist_stamped,
    messages.PointStampedBytes.TYPE: messages.decode_point_stamped,
    messages.ClockBytes.TYPE: messages.decode_clock,
    messages.StringBytes.TYPE: messages.decode_string,
    messages.Float64MultiArrayBytes.TYPE: messages.decode_float64_multi_array,
    messages.UInt8MultiArrayBytes.TYPE: messages.decode_uint8_multi_array,
    messages.DiagnosticArrayBytes.TYPE: messages.decode_diagnostic_array,
}
ONE_OF_EACH = {case[1]: case for case in CASES}


@PARAMETERS
def test_rosbags_decodes_our_bytes(type_name: str, data: bytes, expected: dict) -> None:
    assert type(data) is bytes
    assert plain(TYPES.deserialize_cdr(data, type_name)) == expected


@PARAMETERS
def test_rosbags_encodes_the_same_length(type_name: str, data: bytes, expected: dict) -> None:
    assert len(TYPES.serialize_cdr(TYPES.deserialize_cdr(data, type_name), type_name)) == len(data)


@PARAMETERS
@pytest.mark.parametrize('little_endian', [True, False])
def test_decoders_read_rosbags_bytes_of_both_byte_orders(
    type_name: str, data: bytes, expected: dict, little_endian: bool,
) -> None:
    message = TYPES.deserialize_cdr(data, type_name)
    other = bytes(TYPES.serialize_cdr(message, type_name, little_endian=little_endian))
    check_decoded(type_name, DECODERS[type_name](other), expected)
    check_decoded(type_name, DECODERS[type_name](bytearray(other + bytes(7))), expected)


def check_decoded(type_name: str, decoded: Any, expected: dict) -> None:
    def nanoseconds(stamp: dict) -> int:
        return stamp['sec'] * 10**9 + stamp['nanosec']

    def rows(items: list[dict]) -> list[list[float]]:
        return [list(item.values()) for item in items]

    if type_name == messages.ClockBytes.TYPE:
        assert decoded == nanoseconds(expected['clock'])
    elif type_name == messages.StringBytes.TYPE:
        assert decoded == expected['data']
    elif type_name == messages.UInt8MultiArrayBytes.TYPE:
        assert list(decoded) == expected['data']
    elif type_name == messages.Float64MultiArrayBytes.TYPE:
        dimensions = expected['layout']['dim']
        assert list(decoded.labels) == [item['label'] for item in dimensions]
        assert decoded.values.ravel().tolist() == expected['data']
        if dimensions:
            assert list(decoded.values.shape) == [item['size'] for item in dimensions]
    elif type_name == messages.DiagnosticArrayBytes.TYPE:
        assert decoded[0] == nanoseconds(expected['header']['stamp'])
        assert [status._replace(values=dict(status.values)) for status in decoded[1]] == [
            messages.DiagnosticStatus(
                item['level'], item['name'], item['message'], item['hardware_id'],
                {pair['key']: pair['value'] for pair in item['values']})
            for item in expected['status']]
    else:
        assert decoded.nanoseconds == nanoseconds(expected['header']['stamp'])
        assert decoded.frame_id == expected['header']['frame_id']
        if type_name == messages.PoseArrayBytes.TYPE:
            assert decoded.values.shape == (len(expected['poses']), 7)
            assert decoded.values.tolist() == [
                [*pose['position'].values(), *pose['orientation'].values()]
                for pose in expected['poses']]
        elif type_name == messages.MarkerBytes.TYPE:
            assert decoded.namespace == expected['ns']
            assert decoded[3:6] == (expected['id'], expected['type'], expected['action'])
            assert decoded.points.tolist() == rows(expected['points'])
            assert decoded.color.tolist() == list(expected['color'].values())
            assert decoded.scale.tolist() == list(expected['scale'].values())
            assert decoded.pose.tolist() == [0, 0, 0, 0, 0, 0, 1]
        elif type_name == messages.PointStampedBytes.TYPE:
            assert decoded.point.tolist() == list(expected['point'].values())
        else:
            first, second = expected.get('wrench', expected.get('twist')).values()
            assert decoded[2].tolist() == list(first.values())
            assert decoded[3].tolist() == list(second.values())


@pytest.mark.parametrize('type_name', DECODERS)
def test_every_truncation_is_a_value_error(type_name: str) -> None:
    data = ONE_OF_EACH[type_name][2]
    for size in range(0, len(data), max(1, len(data) // 500)):
        with pytest.raises(ValueError, match=f'not a {type_name}'):
            DECODERS[type_name](data[:size])
    with pytest.raises(ValueError, match='bytes follow its end'):
        DECODERS[type_name](data + bytes(8))


@pytest.mark.parametrize('type_name', DECODERS)
def test_garbage_is_read_or_a_value_error(type_name: str) -> None:
    generator = np.random.default_rng(20)
    refused = 0
    good = ONE_OF_EACH[type_name][2]
    for _ in range(2000):
        if generator.random() < 0.5:
            data = b'\0\1\0\0' + generator.bytes(int(generator.integers(0, 300)))
        else:
            damaged = bytearray(good)
            for place in generator.integers(0, len(good), 4):
                damaged[place] = generator.integers(0, 256)
            data = bytes(damaged)
        try:
            DECODERS[type_name](data)
        except ValueError as error:
            refused += 1
            assert type(error) is ValueError and f'not a {type_name}' in str(error)
    assert refused > 100


def test_other_encodings_are_refused() -> None:
    data = messages.StringBytes('hello').to_bytes()
    for kind in (b'\0\2', b'\0\3', b'\0\6', b'\0\7', b'\1\0', b'\xff\xff'):
        with pytest.raises(ValueError, match='is not plain CDR'):
            messages.decode_string(kind + data[2:])


def test_an_announced_count_allocates_nothing() -> None:
    data = bytearray(messages.PoseArrayBytes('world', 1).stamped(0))
    place = data.index(b'world\0') + 8  # the length takes 4 bytes, the text 6, padding 2
    assert data[place] == 1
    data[place:place + 4] = b'\xff' * 4
    with pytest.raises(ValueError, match='4294967295 items are declared, but 56 bytes left'):
        messages.decode_pose_array(bytes(data))


def test_values_are_aligned_views_and_sent_bytes_do_not_change() -> None:
    poses = messages.PoseArrayBytes('fabric', 5)
    assert poses.values.flags.aligned and poses.values.base is not None
    poses.values[:] = np.arange(35.0).reshape(5, 7)
    sent = poses.stamped(5)
    poses.values[:] = -1.0
    again = poses.stamped(np.int64(6))
    assert messages.decode_pose_array(sent).values.tolist() == np.arange(
        35.0).reshape(5, 7).tolist()
    assert np.all(messages.decode_pose_array(again).values == -1.0)
    assert messages.decode_pose_array(again).nanoseconds == 6
    decoded = messages.decode_pose_array(sent).values
    with pytest.raises(ValueError, match='read-only'):
        decoded[:] = 0.0


def test_a_new_pose_array_is_unturned() -> None:
    assert messages.PoseArrayBytes('world', 2).values.tolist() == [[0, 0, 0, 0, 0, 0, 1]] * 2


def test_stamps_are_integers_that_ros_can_hold() -> None:
    clock = messages.ClockBytes()
    with pytest.raises(TypeError):
        clock.stamped(1.5)  # type: ignore[arg-type]
    for nanoseconds in (-1, 2**31 * 10**9):
        with pytest.raises(ValueError, match=f'got {nanoseconds}$'):
            clock.stamped(nanoseconds)


def test_negative_stamps_of_others_are_read() -> None:
    data = messages.ClockBytes().stamped(10**9)
    assert messages.decode_clock(data[:4] + b'\xff' * 4 + data[8:]) == -10**9


def test_marker_grows_and_shrinks() -> None:
    marker = messages.MarkerBytes('world', 'c', 1, messages.MarkerType.LINE_LIST)
    for count in (2, 1000, 4, 0, 1002, 3000):
        marker.point_count = count
        values = np.arange(3.0 * count).reshape(count, 3)
        marker.points[:] = values
        decoded = messages.decode_marker_points(marker.stamped(count))
        assert decoded.points.tolist() == values.tolist()
        assert decoded.nanoseconds == count and decoded.namespace == 'c'
        assert decoded.color.tolist() == [1, 1, 1, 1]
    marker.color = (0.0, 1.0, 0.0, 0.5)
    marker.scale = (0.25, 0.0, 0.0)
    decoded = messages.decode_marker_points(marker.stamped(0))
    assert decoded.color.tolist() == [0, 1, 0, 0.5] and decoded.scale.tolist() == [0.25, 0, 0]
    assert (marker.color, marker.scale) == ((0, 1, 0, 0.5), (0.25, 0, 0))


@pytest.mark.parametrize(('change', 'reason'), [
    ({'point_count': 3}, 'a multiple of 2 points, got 3'),
    ({'point_count': -2}, 'point_count must be an integer from 0 .* got -2'),
    ({'color': (0, 0, 0)}, 'color must be four'),
    ({'color': (0, 0, 0, float('nan'))}, 'color must be four'),
    ({'scale': (1, 1, -1)}, 'scale must be three'),
    ({'scale': (1, 1, float('inf'))}, 'scale must be three'),
])
def test_marker_refuses(change: dict[str, Any], reason: str) -> None:
    marker = messages.MarkerBytes('world', 'c', 1, messages.MarkerType.LINE_LIST)
    with pytest.raises(ValueError, match=reason):
        setattr(marker, *change.popitem())


def test_layouts_refuse_what_ros_cannot_hold() -> None:
    with pytest.raises(ValueError, match='NUL'):
        messages.StringBytes('a\0b')
    with pytest.raises(ValueError, match='body_count'):
        messages.PoseArrayBytes('world', -1)
    with pytest.raises(ValueError, match='marker_id'):
        messages.MarkerBytes('world', 'c', 2**31, messages.MarkerType.LINE_LIST)
    with pytest.raises(ValueError, match='labels must be as many'):
        messages.Float64MultiArrayBytes(['a'], [1, 2])
    with pytest.raises(ValueError, match='sizes in shape must be'):
        messages.Float64MultiArrayBytes(['a', 'b'], [0, 2**33])
    with pytest.raises(ValueError, match='level'):
        messages.DiagnosticArrayBytes().stamped(0, [messages.DiagnosticStatus(4, 'a', 'b')])


def test_array_whose_layout_does_not_fit_is_refused() -> None:
    data = bytearray(messages.Float64MultiArrayBytes(['rows'], [4]).to_bytes())
    size_at = data.index(b'rows\0') + 8
    assert data[size_at] == 4
    data[size_at] = 5
    with pytest.raises(ValueError, match=r'do not fill shape \[5\]'):
        messages.decode_float64_multi_array(bytes(data))


@pytest.mark.parametrize('count', [0, 1, 7])
def test_filled_messages_are_the_bytes_of_those_that_are_kept(count: int) -> None:
    values = np.random.default_rng(count).normal(size=(count, 7))

    def write(numbers: np.ndarray) -> None:
        numbers[:] = values.reshape(numbers.shape)

    poses = messages.PoseArrayBytes('fabric', count)
    filled = poses.filled(5, write)
    poses.values[:] = values
    assert type(filled) is bytes and filled == poses.stamped(5)
    array = messages.Float64MultiArrayBytes(['rows', 'columns'], [count, 7])
    filled = array.filled(write)
    array.values[:] = values
    assert type(filled) is bytes and filled == array.to_bytes()
    marker = messages.MarkerBytes(
        'fabric', 'c', 1, messages.MarkerType.TRIANGLE_LIST, color=(0.5, 0.25, 0.0, 1.0))
    points = np.random.default_rng(count).normal(size=(3 * count, 3))

    def write_points(numbers: np.ndarray) -> None:
        numbers[:] = points

    filled = marker.filled(7, 3 * count, write_points)
    assert marker.point_count == 0
    marker.point_count = 3 * count
    marker.points[:] = points
    assert type(filled) is bytes and filled == marker.stamped(7)


def test_a_filled_message_does_not_change_any_more() -> None:
    kept = []
    poses = messages.PoseArrayBytes('world', 2)
    data = poses.filled(0, kept.append)  # which is asked not to keep it
    kept[0][:] = 1.0
    assert not messages.decode_pose_array(data).values.any()
    assert poses.values.tolist() == [[0, 0, 0, 0, 0, 0, 1]] * 2


def test_filled_markers_hold_whole_items() -> None:
    marker = messages.MarkerBytes('world', 'c', 1, messages.MarkerType.LINE_LIST)
    with pytest.raises(ValueError, match='a multiple of 2 points, got 3'):
        marker.filled(0, 3, lambda points: None)
