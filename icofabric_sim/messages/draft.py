# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Large message written in place, so that there is never a second copy of it."""
from __future__ import annotations

from collections.abc import Callable
import io
import math

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
