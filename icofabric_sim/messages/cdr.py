# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
CDR encoding of ROS 2 messages: writing, and reading of possibly malformed data.

Source: OMG DDSI-RTPS 2.5, section 10 (encapsulation) and OMG DDS-XTypes 1.3, section 7.4 (XCDR
version 1). A message has four bytes of header. Each number is aligned to its size, counted from
the byte after the header. A string is its length with the final NUL, its bytes and the NUL; a
sequence is its length and its items. Messages are written in little endian.
"""
from __future__ import annotations

import struct
from typing import SupportsIndex

from icofabric_sim import checks
import numpy as np
from numpy.typing import NDArray

HEADER_SIZE = 4
LITTLE_ENDIAN_HEADER = b'\x00\x01\x00\x00'
NANOSECONDS_PER_SECOND = 1_000_000_000
# A ROS stamp holds 0 to 2^31 s.
_LAST_NANOSECOND = 2**31 * NANOSECONDS_PER_SECOND - 1
# A message may be padded to a multiple of four bytes (DDS-XTypes 1.3, section 7.6.3.1.2), and
# rclpy also pads for the alignment of an empty float64 sequence at the end.
PADDING_BELOW = 8

_PREFIXES = {b'\x00\x00': '>', b'\x00\x01': '<'}
_SIZES = {'B': 1, 'i': 4, 'I': 4, 'f': 4, 'd': 8}


def split_nanoseconds(nanoseconds: SupportsIndex) -> tuple[int, int]:
    """Split a time in integer nanoseconds into the seconds and nanoseconds of a ROS stamp."""
    return divmod(
        checks.count('nanoseconds', nanoseconds, 0, _LAST_NANOSECOND), NANOSECONDS_PER_SECOND)


def aligned_buffer(size: int) -> NDArray[np.uint8]:
    """
    Return `size` zero bytes in which the float64 numbers of a message are aligned in memory.

    CDR alignment counts from byte 4, so that byte is at a multiple of eight.
    """
    raw = np.zeros(size + 8, np.uint8)
    start = -(raw.ctypes.data + HEADER_SIZE) % 8
    return raw[start:start + size]


class CdrBuilder:
    """Writer of the parts of a message in order."""

    def __init__(self, *, offset: int | None = None) -> None:
        """Start a message, or with `offset` a part that follows that number of bytes."""
        self.data = bytearray(LITTLE_ENDIAN_HEADER if offset is None else b'')
        self._offset = offset or 0

    @property
    def size(self) -> int:
        """Return the bytes of the message so far, including those before `offset`."""
        return self._offset + len(self.data)

    def align(self, size: int) -> None:
        self.data.extend(bytes((HEADER_SIZE - self.size) % size))

    def numbers(self, kind: str, *values: float) -> None:
        """Append numbers of one `struct` type: B, i, I, f or d."""
        self.align(_SIZES[kind])
        self.data.extend(struct.pack(f'<{len(values)}{kind}', *values))

    def string(self, text: str, name: str = 'text') -> None:
        """Append a text; `name` is the argument's name for errors."""
        if '\0' in checks.text(name, text):
            raise ValueError(
                f'{name} must be a text without the NUL character, got {checks.shown(text)}')
        try:
            encoded = text.encode() + b'\0'
        except UnicodeEncodeError:
            raise ValueError(
                f'{name} must be a text that UTF-8 can hold, got {checks.shown(text)}') from None
        self.numbers('I', len(encoded))
        self.data.extend(encoded)

    def header(self, frame_id: str) -> None:
        """Append a std_msgs/Header with stamp zero."""
        self.numbers('I', 0, 0)
        self.string(frame_id, 'frame_id')


class CdrReader:
    """Reader of the parts of a message in order; raises ValueError for malformed data."""

    def __init__(self, data: bytes | bytearray | memoryview, type_name: str) -> None:
        try:
            view = memoryview(data)
            if view.itemsize != 1:
                raise TypeError
            self._view = view.cast('B')
        except TypeError:
            raise TypeError(
                f'data must be the bytes of a {type_name}, got {checks.shown(data)}') from None
        self._type_name = type_name
        self._position = HEADER_SIZE
        if len(self._view) < HEADER_SIZE:
            raise self.error(f'{len(self._view)} bytes are too short for a message')
        kind = bytes(self._view[:2])
        if kind not in _PREFIXES:
            raise self.error(f'encoding 0x{kind.hex()} is not plain CDR (0x0000 or 0x0001)')
        self._prefix = _PREFIXES[kind]

    def error(self, reason: str) -> ValueError:
        return ValueError(f'not a {self._type_name}: {reason}')

    def _take(self, size: int, alignment: int) -> int:
        """Skip `size` bytes aligned to `alignment`; return their start."""
        start = self._position + (HEADER_SIZE - self._position) % alignment
        if not start + size <= len(self._view):
            raise self.error(
                f'it ends at byte {len(self._view)}, but byte {start + size} is needed')
        self._position = start + size
        return start

    def integer(self, kind: str) -> int:
        """Read an integer of a `struct` type: B, i or I."""
        size = _SIZES[kind]
        value: int = struct.unpack_from(self._prefix + kind, self._view, self._take(size, size))[0]
        return value

    def time(self) -> int:
        """Read a stamp as integer nanoseconds, negative before the epoch."""
        seconds = self.integer('i')
        return seconds * NANOSECONDS_PER_SECOND + self.integer('I')

    def string(self) -> str:
        length = self.integer('I')
        if length == 0:  # some middlewares write an empty string without its NUL
            return ''
        start = self._take(length, 1)
        raw = bytes(self._view[start:start + length])
        if raw[-1] or 0 in raw[:-1]:
            raise self.error(f'the string at byte {start} does not end at its NUL')
        try:
            return raw[:-1].decode()
        except UnicodeDecodeError as error:
            raise self.error(f'the string at byte {start} is not UTF-8 ({error.reason})') from None

    def count(self, item_size: int) -> int:
        """Read the length of a sequence whose items take at least `item_size` bytes each."""
        count = self.integer('I')
        if not count * item_size <= len(self._view) - self._position:
            raise self.error(
                f'{count} items are declared, but {len(self._view) - self._position} bytes left')
        return count

    def floats(self, count: int, kind: str = 'd') -> NDArray[np.float64]:
        """Read `count` numbers, as a read-only view if the message allows one."""
        if count == 0:  # an empty sequence has no alignment bytes
            return np.empty(0)
        size = _SIZES[kind]
        start = self._take(count * size, size)
        values = np.frombuffer(self._view, f'{self._prefix}f{size}', count, start)
        # Any bit pattern may occur, also a signalling NaN.
        with np.errstate(invalid='ignore'):
            values = values.astype(np.float64, copy=False)
        values.flags.writeable = False
        return values

    def take(self, size: int) -> bytes:
        """Read `size` bytes."""
        start = self._take(size, 1)
        return bytes(self._view[start:start + size])

    def skip(self, size: int) -> None:
        self._take(size, 1)

    def finish(self) -> None:
        """Raise ValueError if more than padding is left."""
        left = len(self._view) - self._position
        if not left < PADDING_BELOW:
            raise self.error(f'{left} bytes follow its end')
