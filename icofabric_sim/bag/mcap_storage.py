# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Writer of one MCAP file that loses at most the open chunk if the process is killed.

The format is defined at mcap.dev/spec. The contents are those of rosbag2's plugin: profile,
metadata record (also at the start, for killed files) and type hashes.
"""
from __future__ import annotations

from collections.abc import Iterable
import contextlib
import os
from pathlib import Path
import struct
import zlib

from icofabric_sim.bag import zstd
from icofabric_sim.bag.storage import qos_entries, Tally, to_yaml, TopicEntry, ZSTD_LEVEL

_MAGIC = b'\x89MCAP0\r\n'
# Opcodes of the records.
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _MESSAGE_INDEX, _CHUNK_INDEX = range(1, 9)
_STATISTICS, _METADATA, _METADATA_INDEX, _SUMMARY_OFFSET, _DATA_END = range(11, 16)
_CHUNK_BYTES = 2**20
# Smaller blocks are joined before they are written.
_WRITE_BYTES = 2**14


class McapFile:
    """One .mcap file being written."""

    def __init__(self, path: Path, *, compression: str, metadata: str) -> None:
        """Create a file; `metadata` is the metadata of the bag so far."""
        from icofabric_sim.version import __version__

        self.path = path
        self.tally = Tally()
        self._zstd = compression == 'zstd'
        self._descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR | os.O_CLOEXEC, 0o644)
        self._end = 0  # size of the valid part of the file
        self._schemas: dict[str, tuple[int, bytes]] = {}  # type: number, record
        self._channels: dict[str, tuple[int, bytes]] = {}  # topic: number, record
        self._definitions: list[bytes] = []  # records not yet in the file
        self._chunk_indexes: list[bytes] = []
        self._chunks: list[tuple[int, Tally]] = []  # start and contents of each chunk
        self._metadata_indexes: list[bytes] = []
        self._rest = 0  # bytes after the last chunk, once known
        self._begin_chunk()
        try:
            self._write([_MAGIC, _record(
                _HEADER, _string('ros2') + _string(f'icofabric_sim {__version__}'))])
            record, index = _metadata(metadata, self._end)
            self._write([record])
            self._metadata_indexes.append(index)
        except BaseException:
            self.abandon()
            path.unlink(missing_ok=True)
            raise

    @property
    def size(self) -> int:
        # The compressed size of an open chunk is not known.
        return self._end + (0 if self._zstd else self._chunk_size)

    def add_topic(self, topic: TopicEntry) -> None:
        if topic.type_name not in self._schemas:
            number = len(self._schemas) + 1
            record = _record(
                _SCHEMA, struct.pack('<H', number) + _string(topic.type_name)
                + _string(topic.definition.encoding) + _string(topic.definition.text))
            self._schemas[topic.type_name] = number, record
            self._definitions.append(record)
        number = len(self._channels) + 1
        described = {
            'offered_qos_profiles': to_yaml(qos_entries(topic.qos)),
            'topic_type_hash': topic.definition.digest,
        }
        record = _record(
            _CHANNEL, struct.pack('<HH', number, self._schemas[topic.type_name][0])
            + _string(topic.name) + _string('cdr') + _strings(described))
        self._channels[topic.name] = number, record
        self._definitions.append(record)

    def write(self, topic: str, nanoseconds: int, data: bytes) -> None:
        for definition in self._definitions:
            self._append(definition)
        self._definitions.clear()
        number = self._channels[topic][0]
        self._index.setdefault(number, []).extend((nanoseconds, self._chunk_size))
        self._pending.add(topic, nanoseconds)
        self._append(struct.pack(
            '<BQHIQQ', _MESSAGE, 22 + len(data), number, 0, nanoseconds, nanoseconds))
        self._append(data)
        if self._chunk_size > _CHUNK_BYTES:
            self.flush()

    def flush(self) -> None:
        """Close the chunk; an empty one is kept open, because it would have no valid times."""
        if not self._index:
            return
        pieces, stored, checksum = self._pieces, self._chunk_size, 0
        # A disk without power may leave a chunk of the right length with wrong bytes.
        for piece in pieces:
            checksum = zlib.crc32(piece, checksum)
        head = struct.pack(
            '<QQQI', self._pending.first, self._pending.last, self._chunk_size, checksum)
        if self._zstd:
            pieces = [zstd.compress(b''.join(pieces), ZSTD_LEVEL)]
            stored = len(pieces[0])
        head += _string('zstd' if self._zstd else '') + struct.pack('<Q', stored)
        start = self._end
        length = 9 + len(head) + stored
        offsets, indexes, position = b'', [], start + length
        for number, places in self._index.items():
            offsets += struct.pack('<HQ', number, position)
            indexes.append(_record(_MESSAGE_INDEX, struct.pack(
                f'<HI{len(places)}Q', number, 8 * len(places), *places)))
            position += len(indexes[-1])
        self._write([struct.pack('<BQ', _CHUNK, len(head) + stored), head, *pieces, *indexes])
        self._chunk_indexes.append(_record(
            _CHUNK_INDEX,
            struct.pack('<QQQQI', self._pending.first, self._pending.last, start, length,
                        len(offsets))
            + offsets + struct.pack('<Q', position - start - length)
            + _string('zstd' if self._zstd else '')
            + struct.pack('<QQ', stored, self._chunk_size)))
        self._chunks.append((start, self._pending))
        self.tally.merge(self._pending)
        self._begin_chunk()

    def roll_back(self) -> None:
        # Part of a chunk may be in the file if the disk was full.
        os.ftruncate(self._descriptor, self._end)
        self._definitions.clear()
        self._begin_chunk()

    def shorten(self) -> bool:
        kept, start = len(self._chunks), self._end
        while kept and self._end - start < self._rest:
            kept -= 1
            start, _ = self._chunks[kept]
        if not kept:
            return False
        # The end is written before the file is truncated, so that it fits into the existing file.
        self._end = start
        del self._chunks[kept:], self._chunk_indexes[kept:]
        self.tally = Tally()
        for _, tally in self._chunks:
            self.tally.merge(tally)
        return True

    def finish(self, metadata: str) -> None:
        # The data section also declares topics without messages.
        pieces = [*self._definitions]
        start = self._end + sum(map(len, pieces))
        record, index = _metadata(metadata, start)
        data_end = _record(_DATA_END, struct.pack('<I', 0))
        summary_start = position = start + len(record) + len(data_end)
        metadata_indexes = [*self._metadata_indexes, index]
        groups: list[tuple[int, list[bytes]]] = [
            (_SCHEMA, [record for _, record in self._schemas.values()]),
            (_CHANNEL, [record for _, record in self._channels.values()]),
            (_CHUNK_INDEX, self._chunk_indexes),
            (_METADATA_INDEX, metadata_indexes),
            (_STATISTICS, [self._statistics(len(metadata_indexes))])]
        summary, offsets = b'', b''
        for operation, records in groups:
            group = b''.join(records)
            if group:
                offsets += _record(
                    _SUMMARY_OFFSET, struct.pack('<BQQ', operation, position, len(group)))
            summary += group
            position += len(group)
        summary += offsets + struct.pack('<BQQQ', _FOOTER, 20, summary_start, position)
        pieces += [record, data_end, summary, struct.pack('<I', zlib.crc32(summary)), _MAGIC]
        self._rest = sum(map(len, pieces))
        self._write(pieces)
        os.ftruncate(self._descriptor, self._end)  # removes remains of a discarded chunk
        self.abandon()

    def abandon(self) -> None:
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            with contextlib.suppress(OSError):
                os.close(descriptor)

    def _begin_chunk(self) -> None:
        self._pieces: list[bytes] = []
        self._chunk_size = 0
        self._index: dict[int, list[int]] = {}  # channel: time, offset, time, offset ...
        self._pending = Tally()

    def _append(self, piece: bytes) -> None:
        self._chunk_size += len(piece)
        pieces = self._pieces
        if pieces and len(pieces[-1]) + len(piece) < _WRITE_BYTES:
            pieces[-1] += piece
        else:
            pieces.append(piece)

    def _write(self, pieces: Iterable[bytes]) -> None:
        """Write at the end; data of a failed write is not part of the file yet."""
        end = self._end
        for piece in pieces:
            view = memoryview(piece)
            while view:
                count = os.pwrite(self._descriptor, view, end)
                view, end = view[count:], end + count
        self._end = end

    def _statistics(self, metadata_count: int) -> bytes:
        tally = self.tally
        counts = b''.join(
            struct.pack('<HQ', number, tally.counts.get(topic, 0))
            for topic, (number, _) in self._channels.items())
        return _record(_STATISTICS, struct.pack(
            '<QHIIIIQQI', tally.message_count, len(self._schemas), len(self._channels), 0,
            metadata_count, len(self._chunk_indexes),
            tally.first if tally.message_count else 0, tally.last, len(counts)) + counts)


def _metadata(text: str, start: int) -> tuple[bytes, bytes]:
    """Return the metadata record of the bag for position `start`, and its index."""
    record = _record(_METADATA, _string('rosbag2') + _strings({'serialized_metadata': text}))
    return record, _record(
        _METADATA_INDEX, struct.pack('<QQ', start, len(record)) + _string('rosbag2'))


def _record(operation: int, content: bytes) -> bytes:
    return struct.pack('<BQ', operation, len(content)) + content


def _string(text: str) -> bytes:
    data = text.encode()
    return struct.pack('<I', len(data)) + data


def _strings(entries: dict[str, str]) -> bytes:
    data = b''.join(_string(key) + _string(value) for key, value in entries.items())
    return struct.pack('<I', len(data)) + data
