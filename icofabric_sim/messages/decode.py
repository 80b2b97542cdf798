# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Decoding of messages: arrays as views, and ValueError for malformed data.

Both byte orders are read. Times are integer nanoseconds. Arrays are read-only views into the
message if its byte order allows. They are not aligned in memory: copy an array before long
computations.
"""
from __future__ import annotations

import math
from typing import NamedTuple

from icofabric_sim.messages.arrays import Float64MultiArrayBytes, StringBytes, UInt8MultiArrayBytes
from icofabric_sim.messages.cdr import CdrReader
from icofabric_sim.messages.diagnostics import DiagnosticArrayBytes, DiagnosticStatus
from icofabric_sim.messages.marker import MarkerBytes
from icofabric_sim.messages.stamped import ClockBytes, PoseArrayBytes
import numpy as np
from numpy.typing import NDArray

Buffer = bytes | bytearray | memoryview
Floats = NDArray[np.float64]


class PoseArrayValues(NamedTuple):
    """PoseArray: `values` (n, 7) contains position [m] and orientation x, y, z, w."""

    nanoseconds: int
    frame_id: str
    values: Floats


class MarkerPoints(NamedTuple):
    """Marker with its points [m] (m, 3); `marker_type` and `action` are the numbers in ROS."""

    nanoseconds: int
    frame_id: str
    namespace: str
    marker_id: int
    marker_type: int
    action: int
    pose: Floats
    scale: Floats
    color: Floats
    points: Floats


class LabelledArray(NamedTuple):
    """Float64MultiArray with one label for each dimension of `values`."""

    labels: tuple[str, ...]
    values: Floats


def decode_pose_array(data: Buffer) -> PoseArrayValues:
    """Return (nanoseconds, frame_id, values)."""
    reader = CdrReader(data, PoseArrayBytes.TYPE)
    nanoseconds, frame_id = reader.time(), reader.string()
    count = reader.count(56)
    values = reader.floats(7 * count).reshape(count, 7)
    reader.finish()
    return PoseArrayValues(nanoseconds, frame_id, values)


def decode_clock(data: Buffer) -> int:
    """Return the time [ns]."""
    reader = CdrReader(data, ClockBytes.TYPE)
    nanoseconds = reader.time()
    reader.finish()
    return nanoseconds


def decode_string(data: Buffer) -> str:
    """Return the text."""
    reader = CdrReader(data, StringBytes.TYPE)
    text = reader.string()
    reader.finish()
    return text


def decode_uint8_multi_array(data: Buffer) -> bytes:
    """Return the bytes, ignoring the declared shape."""
    reader = CdrReader(data, UInt8MultiArrayBytes.TYPE)
    for _ in range(reader.count(12)):
        reader.string()
        reader.integer('I')  # size
        reader.integer('I')  # stride
    offset = reader.integer('I')
    values = reader.take(reader.count(1))
    reader.finish()
    return values[offset:]


def decode_float64_multi_array(data: Buffer) -> LabelledArray:
    """Return the labels and the numbers in their shape; without a declared shape, one row."""
    reader = CdrReader(data, Float64MultiArrayBytes.TYPE)
    labels, shape = [], []
    for _ in range(reader.count(12)):
        labels.append(reader.string())
        shape.append(reader.integer('I'))
        reader.integer('I')  # the stride follows from the sizes
    offset = reader.integer('I')
    count = reader.count(8)
    values = reader.floats(count)[offset:]
    reader.finish()
    if not labels:
        return LabelledArray((), values)
    if not math.prod(shape) == count - offset:
        raise reader.error(f'{count} numbers from number {offset} on do not fill shape {shape}')
    return LabelledArray(tuple(labels), values.reshape(shape))


def decode_marker_points(data: Buffer) -> MarkerPoints:
    """Return a marker that is a list of points; colours per point and texture are skipped."""
    reader = CdrReader(data, MarkerBytes.TYPE)
    found = _read_marker(reader)
    reader.finish()
    return found


def decode_marker_array(data: Buffer) -> list[MarkerPoints]:
    """Return the markers of a MarkerArray, each like `decode_marker_points`."""
    reader = CdrReader(data, 'visualization_msgs/msg/MarkerArray')
    # The smallest marker takes at least 140 bytes.
    found = [_read_marker(reader) for _ in range(reader.count(140))]
    reader.finish()
    return found


def _read_marker(reader: CdrReader) -> MarkerPoints:
    nanoseconds, frame_id, namespace = reader.time(), reader.string(), reader.string()
    marker_id, marker_type, action = (reader.integer('i') for _ in range(3))
    pose, scale = reader.floats(7), reader.floats(3)
    color = reader.floats(4, 'f')
    reader.time()  # lifetime
    reader.integer('B')  # frame_locked
    count = reader.count(24)
    points = reader.floats(3 * count).reshape(count, 3)
    reader.floats(4 * reader.count(16), 'f')  # colors
    reader.string()  # texture_resource
    reader.time()  # texture stamp
    reader.string()  # texture frame
    reader.string()  # texture format
    _skip_bytes(reader)  # texture data
    reader.floats(2 * reader.count(8), 'f')  # uv_coordinates
    reader.string()  # text
    reader.string()  # mesh_resource
    reader.string()  # mesh_file name
    _skip_bytes(reader)  # mesh_file data
    reader.integer('B')  # mesh_use_embedded_materials
    return MarkerPoints(nanoseconds, frame_id, namespace, marker_id, marker_type, action,
                        pose, scale, color, points)


def decode_diagnostic_array(data: Buffer) -> tuple[int, list[DiagnosticStatus]]:
    """Return the stamp [ns] and the statuses."""
    reader = CdrReader(data, DiagnosticArrayBytes.TYPE)
    nanoseconds, _ = reader.time(), reader.string()
    statuses = []
    for _ in range(reader.count(20)):
        level = reader.integer('B')
        name, message, hardware_id = (reader.string() for _ in range(3))
        values = {reader.string(): reader.string() for _ in range(reader.count(8))}
        statuses.append(DiagnosticStatus(level, name, message, hardware_id, values))
    reader.finish()
    return nanoseconds, statuses


def _skip_bytes(reader: CdrReader) -> None:
    reader.skip(reader.count(1))
