# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Closed triangle meshes from STL files (binary or text) and OBJ files."""

import codecs
from functools import lru_cache
import os
from pathlib import Path
import struct
from typing import NamedTuple

from icofabric_sim.checks import number_in
import numpy as np

SUFFIXES = ('.stl', '.obj')
# Points closer to the surface than this fraction of the mesh size count as inside.
_ROUNDING_RATIO = 1e-9
_HEADER, _RECORD = 84, 50  # bytes of a binary STL
_TEXT_WORDS = (b'solid', b'facet', b'outer', b'vertex', b'endloop', b'endfacet')
_MAX_STRIPS = 1024
# [bytes] Larger files are refused as mistakes.
_MAX_FILE_BYTES = 2**30


class TriangleMesh(NamedTuple):
    """Closed surface with the centre of its bounding box at the origin."""

    corners: np.ndarray  # (t, 3, 3) [m]
    half_extent: np.ndarray  # (3,) [m]
    oriented: bool  # all triangles have the same orientation

    def contains(self, points: np.ndarray) -> np.ndarray:
        """
        Return the mask (n,) of points (n, 3) [m] inside or, up to round-off, on the surface.

        A point is inside if the surface has a nonzero winding number there: overlapping parts are
        united, and a part of opposite orientation within another part is a cavity. If triangles
        differ in orientation, a point is inside if a ray from it crosses the surface an odd
        number of times.
        """
        low = -float(self.half_extent[1])
        height = 2.0 * float(self.half_extent[1])
        strips = max(1, min(_MAX_STRIPS, round(len(self.corners) ** 0.5)))
        room = _ROUNDING_RATIO * float(self.half_extent.max())
        low, width = low - 2.0 * room, (height + 4.0 * room) / strips
        # The same round-off as for points, so that every point finds all triangles of its strip.
        ends = [
            np.clip(np.floor((bound - low) / width), 0, strips - 1).astype(np.int64)
            for bound in (self.corners[:, :, 1].min(axis=1), self.corners[:, :, 1].max(axis=1))]
        count = ends[1] - ends[0] + 1
        members = np.repeat(np.arange(len(count), dtype=np.int32), count)
        strip = np.repeat(ends[0] - (np.cumsum(count) - count), count) + np.arange(len(members))
        order = np.argsort(strip, kind='stable')
        first = np.zeros(strips + 1, np.int64)
        np.cumsum(np.bincount(strip, minlength=strips), out=first[1:])
        inside = np.zeros(len(points), bool)
        # Imported here, because scenes without a mesh are checked without the compiler.
        from icofabric_sim.kernels.inside import mark_inside
        mark_inside(
            np.ascontiguousarray(points, np.float64), self.corners, first, members[order], low,
            width, self.oriented, room, inside)
        return inside


def load_mesh(path: str | Path) -> TriangleMesh:
    """Read a closed mesh; raise ValueError if the file or the surface is invalid."""
    path = Path(path).expanduser()
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f'{path} is not a mesh: its name must end in .stl or .obj')
    try:
        status = os.stat(path)
        return _load(path, status.st_mtime_ns, status.st_size)
    except OSError as error:
        raise ValueError(f'{path} cannot be read: {error.strerror}') from error


@lru_cache(maxsize=4)
def _load(path: Path, changed: int, size: int) -> TriangleMesh:
    # Called at every change of a parameter; reads the file again only if it has changed.
    if size > _MAX_FILE_BYTES:
        raise ValueError(f'{path} has {size:,} bytes, more than {_MAX_FILE_BYTES:,}')
    return parse_mesh(path, path.read_bytes())


def parse_mesh(path: Path, data: bytes) -> TriangleMesh:
    """Return the closed mesh in the bytes `data` of the file `path`; raise ValueError as above."""
    data = data.removeprefix(codecs.BOM_UTF8)
    corners = _read_obj(path, data) if path.suffix.lower() == '.obj' else _read_stl(path, data)
    if not len(corners):
        raise ValueError(f'{path} holds no triangles')
    if not np.isfinite(corners).all():
        raise ValueError(f'{path} holds coordinates that are not finite numbers')
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    if not (high > low).all():
        raise ValueError(f'{path} is flat: its sides are {(high - low).tolist()} m')
    oriented = _require_closed(path, corners)
    corners = np.ascontiguousarray(corners - 0.5 * (low + high))
    corners.flags.writeable = False
    return TriangleMesh(corners, 0.5 * (high - low), oriented)


def _read_stl(path: Path, data: bytes) -> np.ndarray:
    count, need = 0, _HEADER
    if len(data) >= _HEADER:
        count = struct.unpack_from('<I', data, _HEADER - 4)[0]
        need += _RECORD * count
        # Some programs write a byte or two after the last triangle.
        if 0 <= len(data) - need < _RECORD:
            record = np.dtype([('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('_', '<u2')])
            return np.frombuffer(data, record, count, _HEADER)['corners'].astype(np.float64)
    if not data.lstrip()[:5].lower() == b'solid':
        raise ValueError(
            f'{path} is neither a text STL, which begins with "solid", nor a binary one: it has '
            f'{len(data):,} bytes, and its {count:,} triangles take {need:,}'
            + (': it may be cut off' if len(data) < need else ''))
    numbers, is_open = [], True
    for number, line in enumerate(data.splitlines(), 1):
        words = line.split()
        first = words[0].lower() if words else b''
        if first == b'vertex':
            numbers.append(_parse_point(path, number, words[1:]))
        is_open = first != b'endsolid' and (is_open or first in _TEXT_WORDS)
    if len(numbers) % 3 or is_open:
        raise ValueError(
            f'{path} is cut off: it has {len(numbers)} corners and no "endsolid" after them')
    return np.array(numbers).reshape(-1, 3, 3)


def _read_obj(path: Path, data: bytes) -> np.ndarray:
    points: list[tuple[float, ...]] = []
    faces: list[tuple[int, int, int]] = []
    for number, line in enumerate(data.splitlines(), 1):
        words = line.partition(b'#')[0].split()
        if words[:1] == [b'v']:
            points.append(_parse_point(path, number, words[1:4]))
        elif words[:1] == [b'f']:
            try:
                corners = [] if b'_' in line else [
                    int(word.split(b'/')[0]) for word in words[1:]]
            except ValueError:
                corners = []
            # Positive indices count from 1, negative ones back from the last point read.
            corners = [k - 1 if k > 0 else len(points) + k for k in corners]
            if len(corners) < 3 or not all(0 <= k < len(points) for k in corners):
                raise ValueError(
                    f'{path}, line {number}: a face needs three or more of the {len(points)} '
                    'points before it')
            faces += [(corners[0], b, c) for b, c in zip(corners[1:], corners[2:])]
    return np.array(points).reshape(-1, 3)[np.array(faces, np.int64).reshape(-1, 3)]


def _parse_point(path: Path, number: int, words: list[bytes]) -> tuple[float, ...]:
    try:
        values = tuple(number_in(word) for word in words)
    except ValueError:
        values = ()
    if len(values) != 3:
        raise ValueError(f'{path}, line {number}: a point needs three numbers')
    return values


def _require_closed(path: Path, corners: np.ndarray) -> bool:
    """Refuse a surface with holes; return True if all triangles have the same orientation."""
    # Adding 0 turns -0 into 0.
    points, number = np.unique(corners.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)
    number = number.reshape(-1, 3)
    start, end = number.ravel(), np.roll(number, -1, axis=1).ravel()
    start, end = start[start != end], end[start != end]
    key = np.minimum(start, end) * len(points) + np.maximum(start, end)
    edges, member, count = np.unique(key, return_inverse=True, return_counts=True)
    open_edges = np.flatnonzero(count % 2)
    if len(open_edges):
        place = points[int(edges[open_edges[0]]) // len(points)]
        raise ValueError(
            f'{path} is not closed: {len(open_edges)} of its {len(edges)} edges, one of them at '
            f'{place.tolist()}, belong to an odd number of triangles; close the holes, and give '
            'adjacent triangles identical corner points')
    return not np.bincount(member, np.where(start < end, 1.0, -1.0)).any()
