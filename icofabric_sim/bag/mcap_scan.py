# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Sequential reading of an MCAP file that may lack its index, e.g. after a kill."""
from __future__ import annotations

from collections.abc import Callable, Iterator
import io
from pathlib import Path
import struct
from typing import BinaryIO, NamedTuple
import zlib

from icofabric_sim.bag import zstd
from icofabric_sim.bag.storage import StoredTopic

_MAGIC = b'\x89MCAP0\r\n'
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 3, 4, 5, 6, 15
_LENGTH = struct.Struct('<BQ')


class Damage(Exception):
    """Error with the position up to which a file is readable."""


class ScannedMessage(NamedTuple):
    """Message, and the number of bytes read so far."""

    topic: StoredTopic
    nanoseconds: int
    data: bytes
    offset: int


class McapScan:
    """One pass over the records of a file, with at most one chunk in memory."""

    def __init__(
        self, path: Path, *, on_damage: Callable[[str], None],
        on_topic: Callable[[StoredTopic], None],
    ) -> None:
        """
        Scan the file at `path`.

        `on_damage` is called for skipped chunks, `on_topic` for each topic, also without messages.
        """
        self.path = path
        self.compressed = False  # whether any chunk read so far was compressed
        self._on_damage, self._on_topic = on_damage, on_topic
        self._schemas: dict[int, tuple[str, str]] = {}
        self._topics: dict[int, StoredTopic] = {}

    def messages(self) -> Iterator[ScannedMessage]:
        """Yield the messages in the order of writing; raise Damage where reading ends early."""
        size = self.path.stat().st_size
        with self.path.open('rb') as file:
            if file.read(8) != _MAGIC:
                raise Damage('no MCAP header')
            while True:
                start = file.tell()
                head = file.read(_LENGTH.size)
                if len(head) < _LENGTH.size:
                    raise Damage(f'truncated at byte {start}')
                operation, length = _LENGTH.unpack(head)
                if file.tell() + length > size:
                    raise Damage(f'incomplete last record at byte {start}')
                if operation == _DATA_END:
                    break
                try:
                    yield from self._top_record(file, operation, length, start)
                except Damage:
                    raise
                except Exception as error:  # any error that damaged bytes cause
                    raise Damage(f'unreadable at byte {start} ({error!r})') from error
            file.seek(max(0, size - 8))
            if file.read() != _MAGIC:
                raise Damage('no index')

    def _top_record(
        self, file: BinaryIO, operation: int, length: int, start: int,
    ) -> Iterator[ScannedMessage]:
        end = file.tell() + length
        if not 1 <= operation <= _DATA_END and operation < 128:
            raise Damage(f'no record at byte {start}')
        if operation == _CHUNK:
            chunk = self._chunk(file.read(length), start)
            if chunk is not None:
                yield from self._records(chunk, end)
        elif operation in (_SCHEMA, _CHANNEL, _MESSAGE):
            yield from self._record(operation, file.read(length), end)
        file.seek(end)

    def _chunk(self, content: bytes, start: int) -> bytes | None:
        size, checksum = struct.unpack_from('<QI', content, 16)
        compression, place = _text(content, 28)
        (stored,) = struct.unpack_from('<Q', content, place)
        data = content[place + 8:place + 8 + stored]
        try:
            data = _plain(data, compression)
        except Exception as error:  # any error of a decompressor
            self._on_damage(f'the chunk at byte {start} is unreadable and skipped ({error})')
            return None
        self.compressed = self.compressed or bool(compression)
        if len(data) != size or checksum and zlib.crc32(data) != checksum:
            self._on_damage(f'the chunk at byte {start} is damaged and skipped')
            return None
        return data

    def _records(self, chunk: bytes, end: int) -> Iterator[ScannedMessage]:
        stream = io.BytesIO(chunk)
        while head := stream.read(_LENGTH.size):
            operation, length = _LENGTH.unpack(head)
            yield from self._record(operation, stream.read(length), end)

    def _record(self, operation: int, content: bytes, end: int) -> Iterator[ScannedMessage]:
        if operation == _MESSAGE:
            (number,) = struct.unpack_from('<H', content)
            (nanoseconds,) = struct.unpack_from('<Q', content, 6)
            yield ScannedMessage(self._topics[number], nanoseconds, content[22:], end)
        elif operation == _SCHEMA:
            (number,) = struct.unpack_from('<H', content)
            name, place = _text(content, 2)
            _, place = _text(content, place)
            self._schemas[number] = name, _text(content, place)[0]
        elif operation == _CHANNEL:
            number, schema = struct.unpack_from('<HH', content)
            name, place = _text(content, 4)
            _, place = _text(content, place)
            (length,) = struct.unpack_from('<I', content, place)
            described, end = {}, place + 4 + length
            place += 4
            while place < end:
                key, place = _text(content, place)
                described[key], place = _text(content, place)
            self._topics[number] = StoredTopic(
                name, *self._schemas[schema], described.get('offered_qos_profiles', ''),
                described.get('topic_type_hash', ''))
            self._on_topic(self._topics[number])


def _plain(data: bytes, compression: str) -> bytes:
    if compression == 'lz4':  # not used by this package
        from lz4.frame import decompress  # type: ignore[import-untyped]
        return bytes(decompress(data))
    if compression == 'zstd':
        return zstd.decompress(data)
    if compression:
        raise ValueError(f'unknown compression {compression!r}')
    return data


def _text(content: bytes, place: int) -> tuple[str, int]:
    (length,) = struct.unpack_from('<I', content, place)
    end = place + 4 + length
    if end > len(content):
        raise ValueError(f'a text ends at {end} in a record of {len(content)} bytes')
    return content[place + 4:end].decode(), end
