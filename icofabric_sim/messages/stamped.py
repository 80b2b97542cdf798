# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Messages of numbers under a stamp: poses, wrenches, twists, and the clock.
"""
from __future__ import annotations

import struct
from typing import ClassVar, SupportsIndex

from icofabric_sim.messages.cdr import (
    aligned_buffer,
    CdrBuilder,
    LITTLE_ENDIAN_HEADER,
    split_nanoseconds,
)
import numpy as np
from numpy.typing import NDArray


class _StampedNumbers:
    """
    A header followed by float64 numbers; `count_written` puts their rows before them.
    """

    def __init__(self, frame_id: str, rows: int, columns: int, *, count_written: bool) -> None:
        layout = CdrBuilder()
        layout.header(frame_id)
        if count_written:
            layout.numbers('I', rows)
        if rows:
            layout.align(8)
        start = layout.size
        self._message = aligned_buffer(start + 8 * rows * columns)
        self._message[:start] = np.frombuffer(layout.data, np.uint8)
        self._stamp = self._message[4:12].view('<u4')
        self._numbers = self._message[start:].view('<f8').reshape(rows, columns)

    def stamped(self, nanoseconds: SupportsIndex) -> bytes:
        """
        Return the message with this stamp, integer nanoseconds of simulated time.
        """
        self._stamp[:] = split_nanoseconds(nanoseconds)
        return self._message.tobytes()


class PoseArrayBytes(_StampedNumbers):
    """
    A geometry_msgs/PoseArray of a fixed number of bodies.

    `values` (n, 7) is a view into the message: position [m], orientation x, y, z, w.
    """

    TYPE: ClassVar[str] = 'geometry_msgs/msg/PoseArray'

    def __init__(self, frame_id: str, body_count: int) -> None:
        if not 0 <= body_count < 2**32:
            raise ValueError(f'body_count must lie in 0 to 2^32 - 1, got {body_count!r}')
        super().__init__(frame_id, body_count, 7, count_written=True)
        self.values: NDArray[np.float64] = self._numbers
        self.values[:, 6] = 1.0


class WrenchStampedBytes(_StampedNumbers):
    """
    A geometry_msgs/WrenchStamped; `force` [N] and `torque` [N m] are views into the message.
    """

    TYPE: ClassVar[str] = 'geometry_msgs/msg/WrenchStamped'

    def __init__(self, frame_id: str) -> None:
        super().__init__(frame_id, 2, 3, count_written=False)
        self.force: NDArray[np.float64] = self._numbers[0]
        self.torque: NDArray[np.float64] = self._numbers[1]


class TwistStampedBytes(_StampedNumbers):
    """
    A geometry_msgs/TwistStamped; `linear` [m/s] and `angular` [rad/s] are views into the message.
    """

    TYPE: ClassVar[str] = 'geometry_msgs/msg/TwistStamped'

    def __init__(self, frame_id: str) -> None:
        super().__init__(frame_id, 2, 3, count_written=False)
        self.linear: NDArray[np.float64] = self._numbers[0]
        self.angular: NDArray[np.float64] = self._numbers[1]


class ClockBytes:
    """
    A rosgraph_msgs/Clock.
    """

    TYPE: ClassVar[str] = 'rosgraph_msgs/msg/Clock'

    def stamped(self, nanoseconds: SupportsIndex) -> bytes:
        """
        Return the message with this time, integer nanoseconds of simulated time.
        """
        return LITTLE_ENDIAN_HEADER + struct.pack('<II', *split_nanoseconds(nanoseconds))
