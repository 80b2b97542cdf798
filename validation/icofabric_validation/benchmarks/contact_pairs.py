# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Families of pairs of shells for `icofabric benchmark contact`, at known distances."""

import math
from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import face_geometry, inscribed_radius
from icofabric_sim.terms.contacts.many import touch_pairs
from icofabric_sim.terms.contacts.pair import contact_scratch, OUT_SIZE
from icofabric_sim.terms.contacts.shape import OUTER
import numpy as np

# Half edge [m].
HALF_EDGE = 0.01


class Pairs(NamedTuple):
    """Pairs of one family."""

    label: str
    xa: np.ndarray  # centres [m], (n, 3)
    ra: np.ndarray  # matrices from body to world axes, (n, 3, 3)
    xb: np.ndarray
    rb: np.ndarray


def families(count: int, seed: int = 1) -> list[Pairs]:
    """Return all families, with `count` pairs each."""
    rng = np.random.default_rng(seed)
    a = HALF_EDGE
    inner = inscribed_radius(1.0)
    ra, rb, way = _random(rng, count)
    near = _at('random, where spheres do not decide', rng, ra, rb, way,
               a * rng.uniform(2.0 * inner, 2.0 * OUTER, size=count))
    touch = _first_touch(ra, rb, way)
    close = _at('random, up to 0.1 a apart', rng, ra, rb, way,
                touch + a * rng.uniform(0.0, 0.1, size=count))
    shallow = _at('random, up to 0.01 a in each other', rng, ra, rb, way,
                  touch - a * rng.uniform(0.0, 0.01, size=count))
    faces = face_geometry(1.0).normals
    own = faces[rng.integers(20, size=count)]
    normal = np.einsum('nij,nj->ni', ra, own)
    rb = ra @ _half_turns(own, rng)
    flat = _at('faces on faces, up to 0.01 a in each other', rng, ra, rb,
               normal + 0.2 * _unit(rng.normal(size=(count, 3))), None)
    touch = _first_touch(flat.ra, flat.rb, _unit(flat.xb - flat.xa))
    flat = _at(flat.label, rng, ra, rb, _unit(flat.xb - flat.xa),
               touch - a * rng.uniform(0.0, 0.01, size=count))
    far = _at('random, 10 a apart', rng, ra, rb, way, np.full(count, 10.0 * a))
    return [near, close, shallow, flat, far]


def _random(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return _rotations(rng, count), _rotations(rng, count), _unit(rng.normal(size=(count, 3)))


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _rotations(rng: np.random.Generator, count: int) -> np.ndarray:
    x, y, z, w = _unit(rng.normal(size=(count, 4))).T
    rows = np.array([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)]])
    return np.ascontiguousarray(np.moveaxis(rows, 2, 0))


def _half_turns(normals: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return rotations by pi about axes across the normals, which reverse the faces."""
    across = _unit(np.cross(normals, rng.normal(size=normals.shape)))
    return 2.0 * across[:, :, None] * across[:, None, :] - np.eye(3)


def _at(
    label: str, rng: np.random.Generator, ra: np.ndarray, rb: np.ndarray, way: np.ndarray,
    centres: np.ndarray | None
) -> Pairs:
    xa = HALF_EDGE * rng.normal(size=(len(ra), 3))
    if centres is None:
        centres = np.full(len(ra), HALF_EDGE)
    return Pairs(label, xa, ra, xa + centres[:, None] * way, rb)


def _first_touch(ra: np.ndarray, rb: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Return the centre distances [m] of first contact, where the line leaves its facet."""
    count = len(ra)
    touching, out = np.zeros(count, bool), np.zeros((count, OUT_SIZE))
    inside = HALF_EDGE * math.sqrt(2.0)
    touch_pairs(
        np.full((count, 2), HALF_EDGE), np.zeros((count, 3)), ra, inside * way, rb,
        contact_scratch(), touching, out)
    along = inside * np.einsum('ni,ni->n', out[:, 12:15], way)
    return inside * (along + out[:, 11]) / along
