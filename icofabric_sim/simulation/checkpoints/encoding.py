# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0

r"""
Encoding of a checkpoint as bytes: a describing text, the arrays, and a checksum.

    16 bytes  b'icofabric-state\n'
     8 bytes  total length, an unsigned integer in little-endian order like all numbers
     8 bytes  length of the text
              the text: JSON, an object with `header` and `arrays`, a list of [name, shape];
              padded with blanks to a multiple of 64
              the arrays of doubles in sequence
    32 bytes  SHA-256 of all preceding bytes

Decoding executes no code and needs no more memory than the bytes themselves.
"""

from collections.abc import Iterator, Mapping, Sequence
import hashlib
import json
import math
import re
from typing import Any, NoReturn

import numpy as np

_MAGIC_BYTES = b'icofabric-state\n'
HEAD = len(_MAGIC_BYTES) + 16
_CHECKSUM_SIZE = 32
_ALIGNMENT_SIZE = 64
_MIN_TOTAL_SIZE = HEAD + _CHECKSUM_SIZE
_DOUBLE = np.dtype('<f8')
_MAX_DIMENSION = 2**48
_NAME = re.compile(r'[a-z_]{1,40}(\.[a-z_]{1,40}){0,7}')


def encode(header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Iterator[bytes]:
    """Yield the bytes in batches."""
    text = json.dumps(
        {'header': header, 'arrays': [[name, arrays[name].shape] for name in arrays]},
        allow_nan=False, sort_keys=True, separators=(',', ':')).encode()
    text += b' ' * (-(HEAD + len(text)) % _ALIGNMENT_SIZE)
    size = sum(array.size for array in arrays.values()) * _DOUBLE.itemsize
    total = HEAD + len(text) + size + _CHECKSUM_SIZE
    digest = hashlib.sha256()

    def noted(piece: bytes) -> bytes:
        digest.update(piece)
        return piece

    yield noted(_MAGIC_BYTES + total.to_bytes(8, 'little') + len(text).to_bytes(8, 'little'))
    yield noted(text)
    for array in arrays.values():
        yield noted(np.ascontiguousarray(array, _DOUBLE).tobytes())
    yield digest.digest()


def claimed_size(head: bytes) -> int:
    """
    Return the total length stated in the first HEAD bytes; raise ValueError if they are invalid.
    """
    if not head.startswith(_MAGIC_BYTES):
        raise ValueError('it is not a checkpoint of icofabric_sim: its first bytes are others')
    if len(head) < HEAD:
        raise ValueError('it is cut short in its first bytes')
    return int.from_bytes(head[len(_MAGIC_BYTES):len(_MAGIC_BYTES) + 8], 'little')


def decode(data: bytes) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """
    Return header and arrays, which are views of the bytes; raise ValueError if they are invalid.
    """
    total = claimed_size(data[:HEAD])
    if len(data) != total:
        what = 'cut short' if len(data) < total else 'followed by something else'
        raise ValueError(f'it is {what}: it has {len(data):,} bytes instead of {total:,}')
    if total < _MIN_TOTAL_SIZE:
        raise ValueError(f'its length is given as {total} bytes, fewer than any checkpoint')
    view = memoryview(data)
    if hashlib.sha256(view[:-_CHECKSUM_SIZE]).digest() != view[-_CHECKSUM_SIZE:]:
        raise ValueError('its checksum is wrong: it was damaged or altered')
    length = int.from_bytes(view[HEAD - 8:HEAD], 'little')
    if length > total - HEAD - _CHECKSUM_SIZE:
        raise ValueError(
            f'the length of its text is given as {length:,} bytes, more than there are')
    content = _parsed(bytes(view[HEAD:HEAD + length]))
    if not isinstance(content, dict) or set(content) != {'header', 'arrays'}:
        raise ValueError('its text is not an object with a header and arrays')
    if not isinstance(content['header'], dict) or not isinstance(content['arrays'], list):
        raise ValueError('its header is not an object, or its arrays are not a list')
    numbers = view[HEAD + length:total - _CHECKSUM_SIZE]
    return content['header'], _arrays(content['arrays'], numbers)


def _parsed(text: bytes) -> Any:
    try:
        return json.loads(text.decode(), parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        reason = 'nested too deeply' if isinstance(error, RecursionError) else str(error)
        raise ValueError(f'its text cannot be read: {reason:.200}') from error


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f'{name} is not a number in JSON')


def _arrays(entries: Sequence[Any], view: memoryview) -> dict[str, np.ndarray]:
    arrays: dict[str, np.ndarray] = {}
    start = 0
    for entry in entries:
        if not isinstance(entry, list) or len(entry) != 2:
            raise ValueError('its list of arrays has an entry other than a name with a shape')
        name, shape = entry
        if not isinstance(name, str) or not _NAME.fullmatch(name) or name in arrays:
            raise ValueError(f'it has an array with a name that is wrong or used: {name!r:.60}')
        if not isinstance(shape, list) or len(shape) > 4 or not all(
            type(count) is int and 0 <= count <= _MAX_DIMENSION for count in shape
        ):
            raise ValueError(f'its array {name} has an invalid shape: {shape!r:.60}')
        size = math.prod(shape) * _DOUBLE.itemsize
        if size > len(view) - start:
            raise ValueError(
                f'its array {name} claims to have {size:,} bytes, but {len(view) - start:,} are '
                'left')
        values = np.frombuffer(view[start:start + size], _DOUBLE)
        arrays[name] = values.reshape(shape)
        start += size
    if start != len(view):
        raise ValueError(f'{len(view) - start:,} of its bytes belong to no array')
    return arrays
