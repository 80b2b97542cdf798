# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Large message written in place, so that there is never a second copy of it."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
import io
import math

from icofabric_sim import checks
from icofabric_sim.messages.cdr import aligned_buffer
import numpy as np
from numpy.typing import NDArray

# Function that writes the numbers of a message; it must not keep the array.
Fill = Callable[[NDArray[np.float64]], object]


class Draft:
    """
    Bytes of one message under construction, initially zero.

    A BytesIO returns its memory as bytes without a copy once nothing can write to it any more.
    """

    def __init__(self, size: int) -> None:
        self._file = io.BytesIO()
        self._file.seek(size - 1)
        self._file.write(b'\0')  # with zeros before it, in one block

    def put(self, start: int, data: bytes | memoryview) -> None:
        """Write `data` at byte `start`."""
        self._file.seek(start)
        self._file.write(data)

    def fill(self, start: int, shape: tuple[int, ...], fill: Fill) -> None:
        """
        Let `fill` write float64 numbers of this shape at byte `start`.

        They are not aligned in memory: CDR counts from its fifth byte.
        """
        count = math.prod(shape)
        if count:
            fill(np.frombuffer(self._file.getbuffer(), '<f8', count, start).reshape(shape))

    def finish(self) -> bytes:
        """Return the message."""
        return self._file.getvalue()


class NumbersBytes:
    """Message that ends with float64 numbers of a fixed shape."""

    def __init__(
        self, head: bytes, shape: tuple[int, ...], first: Sequence[float] | float = 0.0
    ) -> None:
        """Begin with `head`; each row of the stored message is initially `first`."""
        self._head, self._shape, self._first = head, shape, first

    @cached_property
    def _message(self) -> NDArray[np.uint8]:
        """Return the stored message, which is created on first use and copied for each output."""
        start = len(self._head)
        message = aligned_buffer(start + 8 * math.prod(self._shape))
        message[:start] = np.frombuffer(self._head, np.uint8)
        message[start:].view('<f8').reshape(self._shape)[...] = self._first
        return message

    @property
    def values(self) -> NDArray[np.float64]:
        return self._message[len(self._head):].view('<f8').reshape(self._shape)

    def _written(self, head: bytes, fill: Fill) -> bytes:
        """Return a message with this head, built in place; `values` is not changed."""
        checks.function('fill', fill)
        draft = Draft(len(head) + 8 * math.prod(self._shape))
        draft.put(0, head)
        draft.fill(len(head), self._shape, fill)
        return draft.finish()
