# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Contents of the files that a scene names (tables, laws, meshes), stored with a recorded run.

A recorded scene is a parameter file followed by the file contents in comments, which ROS skips.
A scene built from a recording uses these contents instead of the files on disk.
"""

from base64 import b64decode, b64encode
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
import hashlib
import json
from typing import NamedTuple
import zlib

from icofabric_sim.parameters.validation import Parameters

# Larger compressed contents are not recorded, only their checksum.
MAX_RECORDED_BYTES = 4 * 2**20
# Contents that unpack to more are damaged or hostile.
_MAX_UNPACKED_BYTES = 2**30
_FILE_PREFIX, _CONTENT_PREFIX = '# file: ', '# + '
_LINE_LENGTH = 96


class NamedFile(NamedTuple):
    """Checksum and content of a file that a scene names."""

    total: str  # SHA-256
    content: bytes | None  # None: too large to be recorded


_recorded_files: ContextVar[Mapping[str, NamedFile]] = ContextVar('kept')
_read_files: ContextVar[dict[str, NamedFile]] = ContextVar('noted')


@contextmanager
def use_recorded_files(files: Mapping[str, NamedFile]) -> Iterator[dict[str, NamedFile]]:
    """Read from the recorded `files` inside the block; yield a dictionary of all files read."""
    noted: dict[str, NamedFile] = {}
    kept_before, noted_before = _recorded_files.set(files), _read_files.set(noted)
    try:
        yield noted
    finally:
        _recorded_files.reset(kept_before)
        _read_files.reset(noted_before)


def recorded_content(name: str) -> bytes | None:
    """Return the recorded content of the file `name`, or None if it must be read from disk."""
    file = _recorded_files.get({}).get(name)
    if file is None or file.content is None:
        return None
    _read_files.get({})[name] = file
    return file.content


def register_content(name: str, content: bytes) -> None:
    """Register the content read from a file; raise ValueError if the recorded one differs."""
    total = hashlib.sha256(content).hexdigest()
    wanted = _recorded_files.get({}).get(name)
    if wanted is not None and wanted.total != total:
        raise ValueError(
            f'the file {name!r} differs from that of the recorded run: its SHA-256 is {total}, '
            f'recorded was {wanted.total}; restore the file of the recorded run')
    noted = _read_files.get(None)
    if noted is not None:
        noted[name] = NamedFile(total, content)


def append_files(text: str, files: Mapping[str, NamedFile]) -> str:
    """Return the text of a parameter file followed by the contents of `files` in comments."""
    lines = []
    for name, file in sorted(files.items()):
        facts: dict[str, str | int] = {'name': name, 'sha256': file.total}
        packed = b'' if file.content is None else zlib.compress(file.content)
        if file.content is not None and len(packed) <= MAX_RECORDED_BYTES:
            facts['bytes'] = len(file.content)
        else:
            packed = b''
        lines.append(_FILE_PREFIX + json.dumps(facts))
        letters = b64encode(packed).decode('ascii')
        lines += [
            _CONTENT_PREFIX + letters[start:start + _LINE_LENGTH]
            for start in range(0, len(letters), _LINE_LENGTH)]
    return text + ''.join(line + '\n' for line in lines)


def extract_files(text: str) -> dict[str, NamedFile]:
    """Return the files stored behind a parameter file; raise ValueError if they are damaged."""
    found: dict[str, NamedFile] = {}
    facts: dict[str, str | int] = {}
    letters: list[str] = []

    def finish() -> None:
        if not facts:
            return
        try:
            name, total = str(facts['name']), str(facts['sha256'])
            content = None
            if 'bytes' in facts:
                unpacker = zlib.decompressobj()
                content = unpacker.decompress(
                    b64decode(''.join(letters), validate=True), _MAX_UNPACKED_BYTES)
                if len(content) != facts['bytes'] or (
                        hashlib.sha256(content).hexdigest() != total):
                    raise ValueError('its content does not match its checksum')
        except (KeyError, ValueError, zlib.error) as error:
            raise ValueError(f'a file recorded with the scene is damaged: {error}') from None
        found[name] = NamedFile(total, content)

    for line in text.splitlines():
        if line.startswith(_FILE_PREFIX):
            finish()
            try:
                facts, letters = dict(json.loads(line[len(_FILE_PREFIX):])), []
            except (ValueError, TypeError) as error:
                raise ValueError(f'a file recorded with the scene is damaged: {error}') from None
        elif line.startswith(_CONTENT_PREFIX) and facts:
            letters.append(line[len(_CONTENT_PREFIX):])
    finish()
    return found


def with_recorded_files(parameters: Parameters, text: str) -> Parameters:
    """Return the parameters of a recorded scene together with the files behind its text."""
    return replace(parameters, files=extract_files(text))
