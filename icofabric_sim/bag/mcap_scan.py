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
"""Reading an MCAP file from its start, as far as it goes: one that was killed has no index."""
from __future__ import annotations

from collections.abc import Callable, Iterator
import io
from pathlib import Path
import struct
from typing import BinaryIO, NamedTuple
import zlib

from icofabric_sim.bag import zstd

_MAGIC = b'\x89MCAP0\r\n'
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 3, 4, 5, 6, 15
_LENGTH = struct.Struct('<BQ')


class Damage(Exception):
    """The place up to which a file can be read."""


class ScannedTopic(NamedTuple):
    """A channel: its topic, the type and its definition, the profiles and the hash where known."""

    name: str
    type_name: str
    definition: str
    qos: str
    digest: str


class ScannedMessage(NamedTuple):
    """A message, and how far the file is read [bytes]."""

    topic: ScannedTopic
    nanoseconds: int
    data: bytes
    offset: int


class McapScan:
    """One pass over the records of a file; no more than a chunk is in memory."""

    def __init__(
        self, path: Path, *, on_damage: Callable[[str], None],
        on_topic: Callable[[ScannedTopic], None],
    ) -> None:
        """
        Scan the file at `path`.

        `on_damage` is called for chunks that are left out, `on_topic` for each topic, also for
        one without messages.
        """
        self.path = path
        self.compressed = False  # whether a chunk was, among those read so far
        self._on_damage, self._on_topic = on_damage, on_topic
        self._schemas: dict[int, tuple[str, str]] = {}
        self._topics: dict[int, ScannedTopic] = {}

    def messages(self) -> Iterator[ScannedMessage]:
        """
        Yield the messages as they were written; Damage says where reading ended before the end.
        """
        size = self.path.stat().st_size
        with self.path.open('rb') as file:
            if file.read(8) != _MAGIC:
                raise Damage('it does not begin as MCAP')
            while True:
                start = file.tell()
                head = file.read(_LENGTH.size)
                if len(head) < _LENGTH.size:
                    raise Damage(f'its end is missing, from byte {start} on')
                operation, length = _LENGTH.unpack(head)
                if file.tell() + length > size:
                    raise Damage(f'the last record was not complete, from byte {start} on')
                if operation == _DATA_END:
                    break
                try:
                    yield from self._top_record(file, operation, length, start)
                except Damage:
                    raise
                except Exception as error:  # whatever the bytes lead to
                    raise Damage(f'unreadable at byte {start} ({error!r})') from error
            file.seek(max(0, size - 8))
            if file.read() != _MAGIC:
                raise Damage('its index is missing')

    def _top_record(
        self, file: BinaryIO, operation: int, length: int, start: int,
    ) -> Iterator[ScannedMessage]:
        end = file.tell() + length
        if not 1 <= operation <= _DATA_END and operation < 128:
            raise Damage(f'no record begins at byte {start}')
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
        except Exception as error:  # noqa: BLE001 - whatever the decompressors raise
            self._on_damage(f'the chunk at byte {start} is unreadable and left out ({error})')
            return None
        self.compressed = self.compressed or bool(compression)
        if len(data) != size or checksum and zlib.crc32(data) != checksum:
            self._on_damage(f'the chunk at byte {start} is damaged and left out')
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
            self._topics[number] = ScannedTopic(
                name, *self._schemas[schema], described.get('offered_qos_profiles', ''),
                described.get('topic_type_hash', ''))
            self._on_topic(self._topics[number])


def _plain(data: bytes, compression: str) -> bytes:
    if compression == 'lz4':  # never ours
        from lz4.frame import decompress  # type: ignore[import-untyped]
        return bytes(decompress(data))
    if compression == 'zstd':
        return zstd.decompress(data)
    if compression:
        raise ValueError(f'compressed as {compression!r}, which is not known')
    return data


def _text(content: bytes, place: int) -> tuple[str, int]:
    (length,) = struct.unpack_from('<I', content, place)
    end = place + 4 + length
    if end > len(content):
        raise ValueError(f'a text ends at {end} in a record of {len(content)} bytes')
    return content[place + 4:end].decode(), end
