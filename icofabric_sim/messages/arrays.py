# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Messages of std_msgs: text, and arrays of numbers with a label for each dimension.
"""
from __future__ import annotations

from collections.abc import Sequence
import math
from typing import ClassVar

from icofabric_sim.messages.cdr import aligned_buffer, CdrBuilder
import numpy as np
from numpy.typing import NDArray


class StringBytes:
    """
    A std_msgs/String.
    """

    TYPE: ClassVar[str] = 'std_msgs/msg/String'

    def __init__(self, text: str) -> None:
        layout = CdrBuilder()
        layout.string(text)
        self._message = bytes(layout.data)

    def to_bytes(self) -> bytes:
        return self._message


class Float64MultiArrayBytes:
    """
    A std_msgs/Float64MultiArray of fixed shape, row by row, one label for each dimension.

    `values` is a view into the message in that shape.
    """

    TYPE: ClassVar[str] = 'std_msgs/msg/Float64MultiArray'

    def __init__(self, labels: Sequence[str], shape: Sequence[int]) -> None:
        if len(labels) != len(shape):
            raise ValueError(f'{len(shape)} dimensions need as many labels, got {list(labels)!r}')
        if not all(0 <= size and math.prod(shape[i:]) < 2**32 for i, size in enumerate(shape)):
            raise ValueError(f'sizes must be at least 0 and below 2^32 in all, got {shape!r}')
        layout = CdrBuilder()
        layout.numbers('I', len(shape))
        for dimension, (label, size) in enumerate(zip(labels, shape)):
            layout.string(label)
            # The stride of a dimension is the count of numbers from it inwards
            # (std_msgs/MultiArrayLayout), so the first one is the count of all.
            layout.numbers('I', size, math.prod(shape[dimension:]))
        layout.numbers('I', 0)  # data_offset
        count = math.prod(shape)
        layout.numbers('I', count)
        if count:
            layout.align(8)
        start = layout.size
        self._message = aligned_buffer(start + 8 * count)
        self._message[:start] = np.frombuffer(layout.data, np.uint8)
        self.values: NDArray[np.float64] = self._message[start:].view('<f8').reshape(tuple(shape))

    def to_bytes(self) -> bytes:
        return self._message.tobytes()
