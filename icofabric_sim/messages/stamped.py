# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of stamped numbers: poses, wrenches, twists, and the clock."""
from __future__ import annotations

from collections.abc import Sequence
import struct
from typing import ClassVar, SupportsIndex

from icofabric_sim import checks
from icofabric_sim.messages.cdr import CdrBuilder, LITTLE_ENDIAN_HEADER, split_nanoseconds
from icofabric_sim.messages.draft import Fill, NumbersBytes
import numpy as np
from numpy.typing import NDArray


class _StampedNumbers(NumbersBytes):
    """Header followed by float64 numbers, preceded by the row count if `count_written`."""

    def __init__(
        self, frame_id: str, rows: int, columns: int, *, count_written: bool,
        first: Sequence[float] | float = 0.0,
    ) -> None:
        """Build the header; each row of the stored message is initially `first`."""
        layout = CdrBuilder()
        layout.header(frame_id)
        if count_written:
            layout.numbers('I', rows)
        if rows:
            layout.align(8)
        super().__init__(bytes(layout.data), (rows, columns), first)

    def stamped(self, nanoseconds: SupportsIndex) -> bytes:
        """Return the message with this stamp, integer nanoseconds of simulated time."""
        self._message[4:12].view('<u4')[:] = split_nanoseconds(nanoseconds)
        return self._message.tobytes()


class PoseArrayBytes(_StampedNumbers):
    """
    geometry_msgs/PoseArray message of a fixed number of bodies.

    `values` (n, 7) is a view into the stored message: position [m], orientation x, y, z, w.
    """

    TYPE: ClassVar[str] = 'geometry_msgs/msg/PoseArray'

    def __init__(self, frame_id: str, body_count: int) -> None:
        body_count = checks.count('body_count', body_count, 0, 2**32 - 1)
        super().__init__(
            frame_id, body_count, 7, count_written=True, first=(0, 0, 0, 0, 0, 0, 1))

    def filled(self, nanoseconds: SupportsIndex, fill: Fill) -> bytes:
        """
        Return a message with this stamp [ns] whose numbers are written by `fill`.

        The numbers are shaped like `values`. The message is built in place; `values` is not
        changed.
        """
        stamp = struct.pack('<II', *split_nanoseconds(nanoseconds))
        return self._written(self._head[:4] + stamp + self._head[12:], fill)


class WrenchStampedBytes(_StampedNumbers):
    """geometry_msgs/WrenchStamped; `force` [N] and `torque` [N m] are views into the message."""

    TYPE: ClassVar[str] = 'geometry_msgs/msg/WrenchStamped'

    def __init__(self, frame_id: str) -> None:
        super().__init__(frame_id, 2, 3, count_written=False)
        self.force: NDArray[np.float64] = self.values[0]
        self.torque: NDArray[np.float64] = self.values[1]


class TwistStampedBytes(_StampedNumbers):
    """
    geometry_msgs/TwistStamped; `linear` [m/s] and `angular` [rad/s] are views into the message.
    """

    TYPE: ClassVar[str] = 'geometry_msgs/msg/TwistStamped'

    def __init__(self, frame_id: str) -> None:
        super().__init__(frame_id, 2, 3, count_written=False)
        self.linear: NDArray[np.float64] = self.values[0]
        self.angular: NDArray[np.float64] = self.values[1]


class PointStampedBytes(_StampedNumbers):
    """geometry_msgs/PointStamped; `point` (3,) [m] is a view into the message."""

    TYPE: ClassVar[str] = 'geometry_msgs/msg/PointStamped'

    def __init__(self, frame_id: str) -> None:
        super().__init__(frame_id, 1, 3, count_written=False)
        self.point: NDArray[np.float64] = self.values[0]


class ClockBytes:
    """rosgraph_msgs/Clock message."""

    TYPE: ClassVar[str] = 'rosgraph_msgs/msg/Clock'

    def stamped(self, nanoseconds: SupportsIndex) -> bytes:
        """Return the message with this time, integer nanoseconds of simulated time."""
        return LITTLE_ENDIAN_HEADER + struct.pack('<II', *split_nanoseconds(nanoseconds))
