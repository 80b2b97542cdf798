# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Frames of bodies for tf2."""

from collections.abc import Sequence
from typing import ClassVar, SupportsIndex

from icofabric_sim.messages.cdr import (
    aligned_buffer,
    CdrBuilder,
    HEADER_SIZE,
    split_nanoseconds,
)
import numpy as np

_NUMBERS = 7  # translation, rotation x y z w


class TransformsBytes:
    """tf2_msgs/TFMessage of a fixed set of frames in one parent frame."""

    TYPE: ClassVar[str] = 'tf2_msgs/msg/TFMessage'

    def __init__(self, frame_id: str, children: Sequence[str]) -> None:
        """Build the message; `children` are the names of the frames."""
        layout, stamps, numbers = CdrBuilder(), [], []
        layout.numbers('I', len(children))
        for child in children:
            layout.align(4)
            stamps.append(layout.size)
            layout.header(frame_id)
            layout.string(child, 'children')
            layout.align(8)
            numbers.append(layout.size)
            layout.numbers('d', *[0.0] * (_NUMBERS - 1), 1.0)
        # Multiples of both sizes, counted from the first byte of the content.
        self._size = layout.size
        self._message = aligned_buffer(self._size + (HEADER_SIZE - self._size) % 8)
        self._message[:self._size] = np.frombuffer(bytes(layout.data), np.uint8)
        content = self._message[HEADER_SIZE:]
        self._stamps, self._values = content.view('<u4'), content.view('<f8')
        first = (np.array(stamps, np.int64) - HEADER_SIZE) // 4
        self._stamp_places = first[:, None] + np.arange(2)
        first = (np.array(numbers, np.int64) - HEADER_SIZE) // 8
        self._places = first[:, None] + np.arange(_NUMBERS)

    def filled(
        self, nanoseconds: SupportsIndex, position: np.ndarray, orientation: np.ndarray
    ) -> bytes:
        """Return the message: `position` (n, 3) [m], `orientation` (n, 4) x y z w, parent axes."""
        self._stamps[self._stamp_places] = split_nanoseconds(nanoseconds)
        self._values[self._places[:, :3]] = position
        self._values[self._places[:, 3:]] = orientation
        return self._message[:self._size].tobytes()
