# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of std_msgs: text, bytes, and arrays of numbers with a label for each dimension."""
from __future__ import annotations

from collections.abc import Sequence
import math
from typing import ClassVar

from icofabric_sim import checks
from icofabric_sim.messages.cdr import CdrBuilder
from icofabric_sim.messages.draft import Fill, NumbersBytes


class StringBytes:
    """std_msgs/String message."""

    TYPE: ClassVar[str] = 'std_msgs/msg/String'

    def __init__(self, text: str) -> None:
        layout = CdrBuilder()
        layout.string(text, 'text')
        self._message = bytes(layout.data)

    def to_bytes(self) -> bytes:
        return self._message


class UInt8MultiArrayBytes:
    """std_msgs/UInt8MultiArray message: one row of bytes, without labels."""

    TYPE: ClassVar[str] = 'std_msgs/msg/UInt8MultiArray'

    def __init__(self, data: bytes) -> None:
        if not isinstance(data, (bytes, bytearray, memoryview)):
            raise TypeError(f'data must be bytes, got {checks.shown(data)}')
        if not len(data) < 2**32:
            raise ValueError(f'a ROS sequence holds less than 2^32 bytes, got {len(data)}')
        layout = CdrBuilder()
        layout.numbers('I', 0, 0, len(data))  # no dimensions, data_offset
        self._message = bytes(layout.data) + data

    def to_bytes(self) -> bytes:
        return self._message


class Float64MultiArrayBytes(NumbersBytes):
    """
    std_msgs/Float64MultiArray message of fixed shape in row order, with a label per dimension.

    `values` is a view of this shape into the stored message.
    """

    TYPE: ClassVar[str] = 'std_msgs/msg/Float64MultiArray'

    def __init__(self, labels: Sequence[str], shape: Sequence[int]) -> None:
        labels = checks.items('labels', labels, 'texts')
        shape = [
            checks.count('each size in shape', size)
            for size in checks.items('shape', shape, 'sizes')]
        if len(labels) != len(shape):
            raise ValueError(
                f'labels must be as many as the {len(shape)} dimensions of shape, got '
                f'{checks.shown(labels)}')
        if not all(math.prod(shape[i:]) < 2**32 for i in range(len(shape))):
            raise ValueError(
                f'sizes in shape must be below 2^32 in all, got {checks.shown(shape)}')
        layout = CdrBuilder()
        layout.numbers('I', len(shape))
        for dimension, (label, size) in enumerate(zip(labels, shape)):
            layout.string(label, 'labels')
            # The stride of a dimension is the count of numbers from it inwards
            # (std_msgs/MultiArrayLayout), so the first one is the count of all.
            layout.numbers('I', size, math.prod(shape[dimension:]))
        layout.numbers('I', 0)  # data_offset
        count = math.prod(shape)
        layout.numbers('I', count)
        if count:
            layout.align(8)
        super().__init__(bytes(layout.data), tuple(shape))

    def to_bytes(self) -> bytes:
        return self._message.tobytes()

    def filled(self, fill: Fill) -> bytes:
        """
        Return a message whose numbers, shaped like `values`, are written by `fill`.

        The message is built in place; `values` is not changed.
        """
        return self._written(self._head, fill)
