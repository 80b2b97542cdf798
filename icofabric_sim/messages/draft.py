# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""A large message written where it will stay, so that at no time there is a second copy of it."""
from __future__ import annotations

from collections.abc import Callable
import io
import math

import numpy as np
from numpy.typing import NDArray

# Writes the numbers of a message; what it is given must not be kept.
Fill = Callable[[NDArray[np.float64]], object]


class Draft:
    """
    The bytes of one message while they may still change, all zero at first.

    A BytesIO hands out the memory that it has written, as bytes, once nothing can write to it any
    more; until then it hands out a copy.
    """

    def __init__(self, size: int) -> None:
        self._file = io.BytesIO()
        self._file.seek(size - 1)
        self._file.write(b'\0')  # and zeros before it, in one piece

    def put(self, start: int, data: bytes | memoryview) -> None:
        """Write `data` at byte `start`."""
        self._file.seek(start)
        self._file.write(data)

    def fill(self, start: int, shape: tuple[int, ...], fill: Fill) -> None:
        """
        Have float64 numbers of this shape written at byte `start`.

        They are not aligned in memory: CDR counts from its fifth byte.
        """
        count = math.prod(shape)
        if count:
            fill(np.frombuffer(self._file.getbuffer(), '<f8', count, start).reshape(shape))

    def finish(self) -> bytes:
        """Return the message."""
        return self._file.getvalue()
