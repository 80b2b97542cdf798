# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Messages as bytes beside the values that any decoder must find in them."""
from __future__ import annotations

import dataclasses
from typing import Any

from icofabric_sim import messages
import numpy as np

FRAME_IDS = ['', 'w', 'ab', 'odo', 'base', 'world', 'fabric', 'fabric1', 'fabric_2', 'ümläut']
COUNTS = [0, 1, 2, 7]
STAMPS = [0, 1, 1_500_000_000, (2**31 - 1) * 10**9 + 999_999_999]
Case = tuple[str, str, bytes, dict[str, Any]]


def plain(message: Any) -> Any:
    """Turn a decoded message of rosbags or rclpy into dictionaries, lists and numbers."""
    if hasattr(message, 'get_fields_and_field_types'):
        names = list(message.get_fields_and_field_types())
    elif dataclasses.is_dataclass(message):
        names = [field.name for field in dataclasses.fields(message)
                 if not field.name.isupper() and field.name != '__msgtype__']
    elif isinstance(message, bytes) and len(message) == 1:
        return message[0]
    elif isinstance(message, str | int | float | bool | np.integer):
        return message
    else:
        return [plain(item) for item in message]
    return {name: plain(getattr(message, name)) for name in names}


def stamp(nanoseconds: int) -> dict[str, int]:
    return {'sec': nanoseconds // 10**9, 'nanosec': nanoseconds % 10**9}


def header(nanoseconds: int, frame_id: str) -> dict[str, Any]:
    return {'stamp': stamp(nanoseconds), 'frame_id': frame_id}


def point(values: np.ndarray) -> dict[str, float]:
    return dict(zip('xyz', values.tolist()))


def pose_case(frame_id: str, count: int, nanoseconds: int) -> Case:
    values = np.random.default_rng(count).normal(size=(count, 7))
    layout = messages.PoseArrayBytes(frame_id, count)
    layout.values[:] = values
    poses = [
        {'position': point(row), 'orientation': dict(zip('xyzw', row[3:].tolist()))}
        for row in values]
    return (f'PoseArray-{frame_id}-{count}-{nanoseconds}', layout.TYPE,
            layout.stamped(nanoseconds),
            {'header': header(nanoseconds, frame_id), 'poses': poses})


def marker_case(frame_id: str, namespace: str, kind: messages.MarkerType, count: int,
                action: messages.MarkerAction = messages.MarkerAction.ADD) -> Case:
    values = np.random.default_rng(count).normal(size=(count, 3))
    layout = messages.MarkerBytes(
        frame_id, namespace, -3, kind, color=(0.5, 0.25, 0.125, 1.0), scale=(0.01, 0.5, 2.0))
    layout.point_count = count
    layout.points[:] = values
    shown = values if action == messages.MarkerAction.ADD else values[:0]
    expected = {
        'header': header(12_000_000_034, frame_id), 'ns': namespace, 'id': -3,
        'type': int(kind), 'action': int(action),
        'pose': {'position': point(np.zeros(3)), 'orientation': {'x': 0, 'y': 0, 'z': 0, 'w': 1}},
        'scale': {'x': 0.01, 'y': 0.5, 'z': 2.0},
        'color': {'r': 0.5, 'g': 0.25, 'b': 0.125, 'a': 1.0},
        'lifetime': stamp(0), 'frame_locked': False,
        'points': [point(row) for row in shown], 'colors': [], 'texture_resource': '',
        'texture': {'header': header(0, ''), 'format': '', 'data': []}, 'uv_coordinates': [],
        'text': '', 'mesh_resource': '', 'mesh_file': {'filename': '', 'data': []},
        'mesh_use_embedded_materials': False}
    return (f'Marker-{frame_id}-{namespace}-{kind.name}-{count}-{action.name}', layout.TYPE,
            layout.stamped(12_000_000_034, action=action), expected)


def array_case(labels: list[str], shape: list[int]) -> Case:
    values = np.random.default_rng(sum(shape)).normal(size=shape)
    layout = messages.Float64MultiArrayBytes(labels, shape)
    layout.values[...] = values
    strides = [int(np.prod(shape[index:])) for index in range(len(shape))]
    dimensions = [
        {'label': label, 'size': size, 'stride': stride}
        for label, size, stride in zip(labels, shape, strides)]
    return (f'Float64MultiArray-{labels}-{shape}', layout.TYPE, layout.to_bytes(),
            {'layout': {'dim': dimensions, 'data_offset': 0}, 'data': values.ravel().tolist()})


def pair_case(kind: str, frame_id: str) -> Case:
    first, second = np.random.default_rng(len(frame_id)).normal(size=(2, 3))
    if kind == 'wrench':
        wrench = messages.WrenchStampedBytes(frame_id)
        wrench.force[:], wrench.torque[:] = first, second
        return (f'WrenchStamped-{frame_id}', wrench.TYPE, wrench.stamped(7_000_000_008),
                {'header': header(7_000_000_008, frame_id),
                 'wrench': {'force': point(first), 'torque': point(second)}})
    twist = messages.TwistStampedBytes(frame_id)
    twist.linear[:], twist.angular[:] = first, second
    return (f'TwistStamped-{frame_id}', twist.TYPE, twist.stamped(7_000_000_008),
            {'header': header(7_000_000_008, frame_id),
             'twist': {'linear': point(first), 'angular': point(second)}})


def point_case(frame_id: str) -> Case:
    stamped = messages.PointStampedBytes(frame_id)
    values = np.array([1.0, -2.5, 3e-3])
    stamped.point[:] = values
    return (f'PointStamped-{frame_id}', stamped.TYPE, stamped.stamped(7_000_000_008),
            {'header': header(7_000_000_008, frame_id), 'point': point(values)})


def diagnostic_case(name: str) -> Case:
    statuses = [
        messages.DiagnosticStatus(messages.WARN, name, 'slow', 'cpu', {'pace': '0.5', 'k': ''}),
        messages.DiagnosticStatus(messages.OK, '', '')]
    expected = [
        {'level': status.level, 'name': status.name, 'message': status.message,
         'hardware_id': status.hardware_id,
         'values': [{'key': key, 'value': value} for key, value in status.values.items()]}
        for status in statuses]
    layout = messages.DiagnosticArrayBytes()
    return (f'DiagnosticArray-{name}', layout.TYPE, layout.stamped(9_000_000_001, statuses),
            {'header': header(9_000_000_001, ''), 'status': expected})


def cases() -> list[Case]:
    kinds, actions = messages.MarkerType, messages.MarkerAction
    found = [pose_case(frame, count, 2_000_000_003) for frame in FRAME_IDS for count in COUNTS]
    found += [pose_case('world', 2, nanoseconds) for nanoseconds in STAMPS]
    found += [marker_case(frame, frame[1:], kinds.LINE_LIST, count)
              for frame in FRAME_IDS for count in (0, 2, 14)]
    found += [marker_case('world', 'shells', kinds.TRIANGLE_LIST, 60)]
    found += [marker_case('world', 'shells', kinds.TRIANGLE_LIST, 6, action)
              for action in actions]
    found += [array_case(*shape) for shape in (
        ([], []), (['body'], [0]), (['quantity'], [7]), (['body', 'x y z'], [3, 13]),
        (['a', 'bc', 'def'], [2, 0, 4]), (['a', 'bc', 'def'], [2, 3, 4]))]
    found += [pair_case(kind, frame) for kind in ('wrench', 'twist') for frame in FRAME_IDS]
    found += [point_case(frame) for frame in FRAME_IDS]
    found += [diagnostic_case(name) for name in FRAME_IDS]
    found += [('String-' + text, messages.StringBytes.TYPE,
               messages.StringBytes(text).to_bytes(), {'data': text})
              for text in [*FRAME_IDS, 'a: [1, 2]\n' * 1000]]
    found += [(f'UInt8MultiArray-{len(data)}', messages.UInt8MultiArrayBytes.TYPE,
               messages.UInt8MultiArrayBytes(data).to_bytes(),
               {'layout': {'dim': [], 'data_offset': 0}, 'data': list(data)})
              for data in (b'', b'\0', bytes(range(256)))]
    found += [(f'Clock-{nanoseconds}', messages.ClockBytes.TYPE,
               messages.ClockBytes().stamped(nanoseconds), {'clock': stamp(nanoseconds)})
              for nanoseconds in STAMPS]
    return found


CASES = cases()
