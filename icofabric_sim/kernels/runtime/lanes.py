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
from icofabric_sim.kernels.runtime.lane_types import LANES
from numba.extending import overload
import numpy as np

__all__ = [
    'any_lane', 'bits', 'fabs', 'fma', 'insert', 'lane', 'LANES', 'load', 'load_at', 'load_pair',
    'maximum', 'rsqrt', 'splat', 'sqrt', 'store', 'store_at', 'where']

# Untyped: Numba calls intrinsics without their first argument.
emit: Any = lane_types
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


overload(load)(lambda array, row, index: lambda array, row, index: emit.load_row(
    array, row, index))
overload(load_at)(lambda array, index: lambda array, index: emit.load_flat(array, index))
overload(load_pair)(lambda array, places, stride, offset: (
    lambda array, places, stride, offset: emit.load_pairs(array, places, stride, offset)))
overload(store)(lambda array, row, index, value: lambda array, row, index, value: emit.store_row(
    array, row, index, value))
overload(store_at)(lambda array, index, value: lambda array, index, value: emit.store_flat(
    array, index, value))
overload(splat)(lambda value: lambda value: emit.spread(float(value)))
overload(fma)(lambda a, b, c: lambda a, b, c: emit.multiply_add(a, b, c))
overload(fabs)(lambda a: lambda a: emit.magnitude(a))
overload(sqrt)(lambda a: lambda a: emit.square_root(a))
overload(rsqrt)(lambda a: lambda a: emit.inverse_square_root(a))
overload(where)(lambda mask, a, b: lambda mask, a, b: emit.choose(mask, a, b))
overload(maximum)(lambda a, b: lambda a, b: emit.choose(a > b, a, b))
overload(bits)(lambda byte: lambda byte: emit.unpack_bits(np.uint8(byte)))
overload(any_lane)(lambda mask: lambda mask: emit.is_any(mask))
overload(lane)(lambda value, index: lambda value, index: emit.lane_of(value, index))
overload(insert)(lambda value, index, number: lambda value, index, number: emit.replace_lane(
    value, index, number))
