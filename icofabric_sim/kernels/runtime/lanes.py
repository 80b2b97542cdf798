# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Vectors in kernels: one lane for each of LANES bodies in neighbouring slots.

Compiled, a vector is a register (lane_types.py). With NUMBA_DISABLE_JIT=1 a vector is a NumPy
array and the bodies of the functions below run, so the same kernels work in plain Python. Both
agree except for the last bit: a compiled `fma` rounds once, and `rsqrt` may be off by two units in
the last place.
"""

from typing import Any

from icofabric_sim.kernels.runtime import lane_types
from icofabric_sim.kernels.runtime.lane_types import define, LANES
from numba import types
import numpy as np

__all__ = [
    'any_lane', 'bits', 'fabs', 'fma', 'insert', 'lane', 'LANES', 'load', 'load_at', 'load_pair',
    'maximum', 'rsqrt', 'splat', 'sqrt', 'store', 'store_at', 'where']

# A vector: np.ndarray of shape (LANES,) to Python, `lane_types.Lanes` to Numba.
Vector = Any


def load(array: np.ndarray, row: int, index: int) -> Vector:
    """Return elements index to index + LANES of a row of a 2-D array."""
    return array[row, index:index + LANES].copy()


def load_at(array: np.ndarray, index: int) -> Vector:
    """Return elements index to index + LANES of a 1-D array."""
    return array[index:index + LANES].copy()


def load_pair(
    array: np.ndarray, places: Vector, stride: int, offset: int
) -> tuple[Vector, Vector]:
    """
    Return for each lane two adjacent numbers of a 1-D array of doubles.

    The first is at index `offset` + `stride` * place, with the place of the lane rounded down.
    """
    index = stride * places.astype(np.int32) + offset
    return array[index], array[index + 1]


def store(array: np.ndarray, row: int, index: int, value: Vector) -> None:
    """Write elements index to index + LANES of a row of a 2-D array."""
    array[row, index:index + LANES] = value


def store_at(array: np.ndarray, index: int, value: Vector) -> None:
    """Write elements index to index + LANES of a 1-D array."""
    array[index:index + LANES] = value


def splat(value: float) -> Vector:
    """Return a vector with one number in all lanes."""
    return np.full(LANES, float(value))


def fma(a: Vector, b: Vector, c: Vector) -> Vector:
    """Compute a b + c."""
    return a * b + c


def fabs(a: Vector) -> Vector:
    """Compute absolute values."""
    return np.abs(a)


def sqrt(a: Vector) -> Vector:
    """Compute square roots."""
    return np.sqrt(a)


def rsqrt(a: Vector) -> Vector:
    """Compute 1 / sqrt(a), for normal positive numbers."""
    return 1.0 / np.sqrt(a)


def where(mask: Any, a: Vector, b: Vector) -> Vector:
    """Return `a` where the mask is true, else `b`."""
    return np.where(mask, a, b)


def maximum(a: Vector, b: Vector) -> Vector:
    """Return the larger of two numbers; `b` where either is not a number."""
    return np.where(a > b, a, b)


def bits(byte: int) -> Any:
    """Return a mask from the low bits of a byte, lane 0 first."""
    return (int(byte) >> np.arange(LANES)) & 1 == 1


def any_lane(mask: Any) -> bool:
    """Check that the mask is true in at least one lane."""
    return bool(np.any(mask))


def lane(value: Vector, index: int) -> float:
    """Return the number in one lane."""
    return float(value[index])


def insert(value: Vector, index: int, number: float) -> Vector:
    """Return the vector with another number in one lane."""
    changed = value.copy()
    changed[index] = number
    return changed


_ROW, _VECTOR, _MASK = types.Array, lane_types.lanes_type, lane_types.mask_type
_INDEX, _NUMBER = types.intp, types.float64
define(load, (_ROW, _INDEX, _INDEX), _VECTOR, lane_types.load_row)
define(load_at, (_ROW, _INDEX), _VECTOR, lane_types.load_flat)
define(
    load_pair, (_ROW, _VECTOR, types.int32, _INDEX), types.UniTuple(_VECTOR, 2),
    lane_types.load_pairs)
define(store, (_ROW, _INDEX, _INDEX, _VECTOR), types.void, lane_types.store_row)
define(store_at, (_ROW, _INDEX, _VECTOR), types.void, lane_types.store_flat)
define(splat, (_NUMBER,), _VECTOR, lane_types.spread)
define(fma, (_VECTOR, _VECTOR, _VECTOR), _VECTOR, lane_types.multiply_add)
define(fabs, (_VECTOR,), _VECTOR, lane_types.magnitude)
define(sqrt, (_VECTOR,), _VECTOR, lane_types.square_root)
define(rsqrt, (_VECTOR,), _VECTOR, lane_types.inverse_square_root)
define(where, (_MASK, _VECTOR, _VECTOR), _VECTOR, lane_types.choose)
define(maximum, (_VECTOR, _VECTOR), _VECTOR, lane_types.larger)
define(bits, (types.uint8,), _MASK, lane_types.unpack_bits)
define(any_lane, (_MASK,), types.boolean, lane_types.is_any)
define(lane, (_VECTOR, types.int32), _NUMBER, lane_types.lane_of)
define(insert, (_VECTOR, types.int32, _NUMBER), _VECTOR, lane_types.replace_lane)
