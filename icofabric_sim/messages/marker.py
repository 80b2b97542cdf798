# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
visualization_msgs/Marker message made of points: lines between bodies, or triangles of shells.
"""
from __future__ import annotations

from collections.abc import Sequence
import enum
import struct
from typing import ClassVar, SupportsIndex

from icofabric_sim import checks
from icofabric_sim.messages.cdr import aligned_buffer, CdrBuilder, split_nanoseconds
from icofabric_sim.messages.draft import Draft, Fill
import numpy as np
from numpy.typing import NDArray


class MarkerType(enum.IntEnum):
    """Marker types that are lists of points, by their numbers in visualization_msgs/Marker."""

    LINE_LIST = 5
    TRIANGLE_LIST = 11


class MarkerAction(enum.IntEnum):
    """Marker actions, by their numbers in visualization_msgs/Marker."""

    ADD = 0
    DELETE = 2
    DELETEALL = 3


# Fields of a marker after its points, without colours, texture, text and mesh: empty texts, and
# zeros for numbers and for the lengths of sequences.
_FIELDS_AFTER_POINTS = {
    'colors': 0, 'texture_resource': '', 'texture stamp, seconds': 0,
    'texture stamp, nanoseconds': 0, 'texture frame': '', 'texture format': '', 'texture data': 0,
    'uv_coordinates': 0, 'text': '', 'mesh_resource': '', 'mesh_file name': '',
    'mesh_file data': 0}
_POINTS_PER_ITEM = {MarkerType.LINE_LIST: 2, MarkerType.TRIANGLE_LIST: 3}


def append_fields_after_points(layout: CdrBuilder) -> None:
    """Append the last fields of a marker, which are all empty."""
    for value in _FIELDS_AFTER_POINTS.values():
        if value == '':
            layout.string('')
        else:
            layout.numbers('I', 0)
    layout.numbers('B', 0)  # mesh_use_embedded_materials


class MarkerBytes:
    """
    Marker with a fixed namespace and id, in the axes of its frame, shown until replaced.

    `point_count` is the number of points in the stored message; `points` is a view of them. The
    capacity is kept when the count decreases, and doubled when it is exceeded. Views taken before
    such a change are not part of the message any more, and their points are lost. `filled` creates
    a separate message each time.
    """

    TYPE: ClassVar[str] = 'visualization_msgs/msg/Marker'

    def __init__(
        self, frame_id: str, namespace: str, marker_id: int, marker_type: MarkerType, *,
        color: Sequence[float] = (1.0, 1.0, 1.0, 1.0),
        scale: Sequence[float] | None = None,
    ) -> None:
        """
        Build the message; color: red, green, blue, alpha (0 to 1); scale [m].

        A LINE_LIST uses only x of the scale, as the width of its lines (default 0.001 m). A
        TRIANGLE_LIST multiplies its points by the scale (default 1).
        """
        self.marker_type = checks.member('marker_type', marker_type, MarkerType)
        marker_id = checks.count('marker_id', marker_id, -2**31, 2**31 - 1)
        if scale is None:
            scale = (0.001, 0.0, 0.0) if self.marker_type is MarkerType.LINE_LIST else (1, 1, 1)
        layout = CdrBuilder()
        layout.header(frame_id)
        layout.string(namespace, 'namespace')
        layout.numbers('i', marker_id, self.marker_type)
        self._action_offset = layout.size
        layout.numbers('i', MarkerAction.ADD)
        layout.numbers('d', 0, 0, 0, 0, 0, 0, 1)  # pose: at the origin, not rotated
        self._scale_offset = layout.size
        layout.numbers('d', 0, 0, 0)
        self._color_offset = layout.size
        layout.numbers('f', 0, 0, 0, 0)
        layout.numbers('I', 0, 0)  # lifetime 0: until replaced
        layout.numbers('B', 0)  # frame_locked
        layout.align(4)
        self._count_offset = layout.size
        layout.numbers('I', 0)
        self._head_size = layout.size
        layout.align(8)
        self._points_offset = layout.size

        # Only items of up to four bytes follow, and the size of a point is a multiple of four: the
        # rest of the message is the same after any number of points.
        rest = CdrBuilder(offset=self._head_size)
        append_fields_after_points(rest)
        self._rest = bytes(rest.data)

        self._count = 0
        self._reserve(0, np.frombuffer(layout.data, np.uint8))
        self.color = color
        self.scale = scale

    def _reserve(self, capacity: int, head: NDArray[np.uint8]) -> None:
        self._buffer = aligned_buffer(self._points_offset + 24 * capacity)
        self._buffer[:self._points_offset] = head
        self._memory = self._buffer.data
        self._points = self._buffer[self._points_offset:].view('<f8').reshape(capacity, 3)

    @property
    def point_count(self) -> int:
        return self._count

    @point_count.setter
    def point_count(self, count: int) -> None:
        count = self._checked('point_count', count)
        if count > len(self._points):
            self._reserve(
                max(count, 2 * len(self._points)), self._buffer[:self._points_offset])
        self._count = count

    @property
    def points(self) -> NDArray[np.float64]:
        """Return the points of the next message [m], (point_count, 3), as a view."""
        return self._points[:self._count]

    @property
    def color(self) -> tuple[float, ...]:
        return struct.unpack_from('<4f', self._memory, self._color_offset)

    @color.setter
    def color(self, value: Sequence[float]) -> None:
        numbers = checks.array('color', value, (4,))
        if not ((numbers >= 0.0) & (numbers <= 1.0)).all():
            raise ValueError(f'color must be four numbers from 0 to 1, got {checks.shown(value)}')
        struct.pack_into('<4f', self._memory, self._color_offset, *numbers)

    @property
    def scale(self) -> tuple[float, ...]:
        return struct.unpack_from('<3d', self._memory, self._scale_offset)

    @scale.setter
    def scale(self, value: Sequence[float]) -> None:
        numbers = checks.array('scale', value, (3,), 'm')
        if not (numbers >= 0.0).all():
            raise ValueError(
                f'scale must be three lengths of at least 0 m, got {checks.shown(value)}')
        struct.pack_into('<3d', self._memory, self._scale_offset, *numbers)

    def stamped(
        self, nanoseconds: SupportsIndex, *, action: MarkerAction = MarkerAction.ADD,
    ) -> bytes:
        """
        Return the message with this stamp [ns]; only ADD includes the points.

        DELETE removes the marker of this namespace and id, DELETEALL all markers of the topic.
        """
        action = checks.member('action', action, MarkerAction)
        count = self._count if action == MarkerAction.ADD else 0
        end = self._stamp(nanoseconds, action, count)
        return b''.join((self._memory[:end + 24 * count], self._rest))

    def filled(self, nanoseconds: SupportsIndex, count: int, fill: Fill) -> bytes:
        """
        Return a message with this stamp [ns] of `count` points, written by `fill` (count, 3).

        The message is built in place; `points` and `point_count` are not changed.
        """
        count = self._checked('count', count)
        checks.function('fill', fill)
        start = self._stamp(nanoseconds, MarkerAction.ADD, count)
        end = start + 24 * count
        draft = Draft(end + len(self._rest))
        draft.put(0, self._memory[:start])
        draft.put(end, self._rest)
        draft.fill(start, (count, 3), fill)
        return draft.finish()

    def _checked(self, name: str, count: int) -> int:
        step = _POINTS_PER_ITEM[self.marker_type]
        if checks.count(name, count, 0, 2**32 - 1) % step:
            raise ValueError(
                f'{name}: a {self.marker_type.name} holds a multiple of {step} points, got '
                f'{count!r}')
        return int(count)

    def _stamp(self, nanoseconds: SupportsIndex, action: MarkerAction, count: int) -> int:
        """Complete the part before the points; return its end."""
        struct.pack_into('<II', self._memory, 4, *split_nanoseconds(nanoseconds))
        struct.pack_into('<i', self._memory, self._action_offset, action)
        struct.pack_into('<I', self._memory, self._count_offset, count)
        return self._points_offset if count else self._head_size
