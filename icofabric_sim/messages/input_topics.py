# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Input messages: the topic and frame of each target, and the decoded values.

    ~/wrench         WrenchStamped   the body of the frame icosahedron_K
    ~/loads/NAME     WrenchStamped   a load channel
    ~/drives/NAME    TwistStamped    a drive
    ~/planes/NAME    TwistStamped    a plane that may move
    ~/pull           PointStamped    target point of a drag of the body of frame icosahedron_K
"""

import re
from typing import NamedTuple, TYPE_CHECKING

from icofabric_sim.messages.cdr import CdrReader
from icofabric_sim.messages.decode import Buffer, Floats
from icofabric_sim.messages.frames import parse_body_frame, shown_frame
from icofabric_sim.messages.stamped import (
    PointStampedBytes,
    TwistStampedBytes,
    WrenchStampedBytes,
)
from icofabric_sim.simulation.inputs.input_types import (
    BodyTarget,
    ChannelTarget,
    DriveTarget,
    PlaneTarget,
    Pull,
    PullTarget,
    Target,
    Twist,
    Value,
    Wrench,
)
import numpy as np

if TYPE_CHECKING:
    from icofabric_sim.scene.scene import Scene

INPUT_TYPES = (WrenchStampedBytes.TYPE, TwistStampedBytes.TYPE, PointStampedBytes.TYPE)
PULL = '~/pull'
_BODIES = '~/wrench'
_NAME = r'([A-Za-z][A-Za-z0-9_]*)'
_CHANNEL = re.compile(f'~/loads/{_NAME}')
_DRIVE, _PLANE = re.compile(f'~/drives/{_NAME}'), re.compile(f'~/planes/{_NAME}')


class StampedPair(NamedTuple):
    """WrenchStamped (force [N], torque [N m]) or TwistStamped (linear [m/s], angular [rad/s])."""

    nanoseconds: int
    frame_id: str
    first: Floats
    second: Floats


class StampedPoint(NamedTuple):
    """PointStamped (point [m])."""

    nanoseconds: int
    frame_id: str
    point: Floats


class InputMessage(NamedTuple):
    """Decoded input: target, value and stamp."""

    target: Target
    value: Value
    stamp: int  # [ns] of simulated time, 0: at once
    frame_id: str


def topic_of(target: Target) -> str:
    """Return the input topic of a target."""
    if isinstance(target, PullTarget):
        return PULL
    if isinstance(target, BodyTarget):
        return _BODIES
    # loads.NAME, drives.NAME or planes.NAME
    return f'~/{str(target).replace(".", "/")}'


def input_topics(scene: 'Scene') -> dict[str, str]:
    """Return the input topics of a scene, with their message types."""
    topics = [
        _BODIES, PULL, *(topic_of(ChannelTarget(name)) for name in scene.loads),
        *(topic_of(DriveTarget(name)) for name in scene.drives),
        *(topic_of(PlaneTarget(name)) for name in scene.platens)]
    return {topic: input_type(topic) for topic in topics}


def input_type(topic: str) -> str:
    """Return the message type of an input topic, '' for other topics."""
    if topic == _BODIES or _CHANNEL.fullmatch(topic):
        return WrenchStampedBytes.TYPE
    if topic == PULL:
        return PointStampedBytes.TYPE
    moves = _DRIVE.fullmatch(topic) or _PLANE.fullmatch(topic)
    return TwistStampedBytes.TYPE if moves else ''


def target_of(topic: str, frame_id: str) -> Target | None:
    """Return the target of messages on a topic with a frame, or None."""
    if drive := _DRIVE.fullmatch(topic):
        return DriveTarget(drive[1])
    if plane := _PLANE.fullmatch(topic):
        return PlaneTarget(plane[1])
    if channel := _CHANNEL.fullmatch(topic):
        return ChannelTarget(channel[1])
    body = parse_body_frame(frame_id) if topic in (_BODIES, PULL) else None
    if body is None:
        return None
    return PullTarget(body) if topic == PULL else BodyTarget(body)


def decode_input(topic: str, data: Buffer) -> InputMessage:
    """Decode a message of an input topic; raise ValueError if malformed or without a body."""
    kind = input_type(topic)
    value: Value
    if kind == PointStampedBytes.TYPE:
        stamp, frame_id, point = decode_point_stamped(data)
        value = Pull(np.array(point))
    elif kind == TwistStampedBytes.TYPE:
        stamp, frame_id, *parts = decode_twist_stamped(data)
        value = Twist(*(np.array(part) for part in parts))
    else:
        stamp, frame_id, *parts = decode_wrench_stamped(data)
        value = Wrench(*(np.array(part) for part in parts))
    target = target_of(topic, frame_id)
    if target is None:
        raise ValueError(
            f"its header.frame_id is {shown_frame(frame_id)}; it must be 'icosahedron_K' with "
            'body number K')
    return InputMessage(target, value, stamp, frame_id)


def decode_wrench_stamped(data: Buffer) -> StampedPair:
    """Return (nanoseconds, frame_id, force, torque)."""
    return _decode_pair(CdrReader(data, WrenchStampedBytes.TYPE))


def decode_twist_stamped(data: Buffer) -> StampedPair:
    """Return (nanoseconds, frame_id, linear, angular)."""
    return _decode_pair(CdrReader(data, TwistStampedBytes.TYPE))


def decode_point_stamped(data: Buffer) -> StampedPoint:
    """Return (nanoseconds, frame_id, point)."""
    reader = CdrReader(data, PointStampedBytes.TYPE)
    nanoseconds, frame_id = reader.time(), reader.string()
    point = reader.floats(3)
    reader.finish()
    return StampedPoint(nanoseconds, frame_id, point)


def _decode_pair(reader: CdrReader) -> StampedPair:
    nanoseconds, frame_id = reader.time(), reader.string()
    values = reader.floats(6)
    reader.finish()
    return StampedPair(nanoseconds, frame_id, values[:3], values[3:])
