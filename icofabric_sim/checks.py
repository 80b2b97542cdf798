# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Validated conversions of external arguments.

Each function returns the argument in the type used internally, or raises an error that names the
argument, the requirement and the value. TypeError: a wrong type; ValueError: out of range, not
finite or of another shape. Integers count as numbers, also those of NumPy; booleans and texts do
not. `renamed_attributes` and `renamed_text` are for errors that give the new name of an attribute.
"""

import codecs
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from enum import IntEnum
import math
from numbers import Real
import operator
import os
import reprlib
from typing import Any, TypeVar

import numpy as np

T = TypeVar('T')
E = TypeVar('E', bound=IntEnum)
Class = TypeVar('Class', bound=type)

_COUNTS = {2: 'two', 3: 'three', 4: 'four', 6: 'six'}
_MAX_SHOWN_LENGTH = 80  # characters of a value in a message
_MAX_LEVELS = 8  # levels of nested lists that are searched for booleans
_SHORT_REPR = reprlib.Repr()
_SHORT_REPR.maxstring = _SHORT_REPR.maxother = _MAX_SHOWN_LENGTH
_SHORT_REPR.maxlong = 30
# Quaternions within this distance from unit length are normalised, others rejected.
_MAX_UNIT_ERROR = 1e-3
_ROUND_OFF = 4e-16
_BOOLEANS = (bool, np.bool_)
_SHOWN_AS_THEY_ARE = (
    type(None), str, bytes, *_BOOLEANS, int, float, complex, np.generic, list, tuple, dict, set,
    frozenset, range, os.PathLike)


def number(
    name: str, value: Any, *, unit: str = '', least: float | None = None,
    above: float | None = None, most: float | None = None, below: float | None = None,
    wish: str = ''
) -> float:
    """Return a finite number within bounds; `wish` replaces the bounds in the error message."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if not isinstance(value, Real) or isinstance(value, _BOOLEANS):
        raise TypeError(_refusal(name, wish or _range(least, above, most, below), unit, value))
    try:
        result = float(value)
    except OverflowError:
        result = math.inf
    if (
        math.isfinite(result) and (least is None or result >= least)
        and (above is None or result > above) and (most is None or result <= most)
        and (below is None or result < below)
    ):
        return result
    raise ValueError(_refusal(name, wish or _range(least, above, most, below), unit, value))


def positive(name: str, value: Any, unit: str = '') -> float:
    """Return a finite number above 0."""
    return number(name, value, unit=unit, wish='a positive, finite number', above=0.0)


def count(name: str, value: Any, least: int = 0, most: int | None = None) -> int:
    """Return an integer within bounds, both included."""
    try:
        result = operator.index(value)
        if not isinstance(value, _BOOLEANS) and least <= result and (
                most is None or result <= most):
            return result
        kind: type[Exception] = TypeError if isinstance(value, _BOOLEANS) else ValueError
    except TypeError:
        kind = TypeError
    bounds = f'an integer of at least {least}' if most is None else (
        f'an integer from {least} to {most}')
    raise kind(_refusal(name, bounds, '', value))


def flag(name: str, value: Any) -> bool:
    """Return True or False."""
    if not isinstance(value, _BOOLEANS):
        raise TypeError(_refusal(name, 'True or False', '', value))
    return bool(value)


def text(name: str, value: Any, wish: str = 'a text') -> str:
    """Return a text."""
    if not isinstance(value, str):
        raise TypeError(_refusal(name, wish, '', value))
    return str(value)


def choice(name: str, value: Any, choices: Collection[str]) -> str:
    """Return one of a closed set of words."""
    wish = f'one of {", ".join(choices)}'
    if text(name, value, wish) not in choices:
        raise ValueError(_refusal(name, wish, '', value))
    return str(value)


def path(name: str, value: Any, wish: str = 'the path of a file') -> str:
    """Return a path as a text."""
    # An integer would be used as a file descriptor.
    found = os.fspath(value) if isinstance(value, os.PathLike) else value
    if not isinstance(found, str):
        raise TypeError(_refusal(name, f'{wish}, a text or a Path', '', value))
    if not found or '\0' in found:
        raise ValueError(_refusal(name, wish, '', value))
    return found


def instance(name: str, value: Any, kind: type[T], way: str = '') -> T:
    """Return an object of a class; `way` describes how to create one."""
    if not isinstance(value, kind):
        shown_kind = f'{_article(kind.__name__)} {kind.__name__}'
        raise TypeError(_refusal(name, shown_kind, '', value) + (f'; {way}' if way else ''))
    return value


def member(name: str, value: Any, kind: type[E]) -> E:
    """Return a member of an enumeration of integers, from itself or its number."""
    wish = f'one of {", ".join(f"{kind.__name__}.{each.name}" for each in kind)}'
    if isinstance(value, _BOOLEANS) or not isinstance(value, int):
        raise TypeError(_refusal(name, wish, '', value))
    if value not in tuple(kind):
        raise ValueError(_refusal(name, wish, '', value))
    return kind(value)


def items(name: str, value: Any, wish: str) -> list[Any]:
    """Return the items of an iterable other than a text; the caller validates them."""
    if isinstance(value, (str, bytes, Mapping)) or not isinstance(value, Iterable):
        raise TypeError(_refusal(name, f'a list of {wish}', '', value))
    return list(value)


def function(name: str, value: Any, wish: str = 'a function') -> Callable[..., Any]:
    """Return a callable."""
    if not callable(value):
        raise TypeError(_refusal(name, wish, '', value))
    return value  # type: ignore[no-any-return]


def mapping(name: str, value: Any, wish: str = 'a dictionary of names and values') -> Mapping[
        str, Any]:
    """Return a dictionary whose keys are texts."""
    if not isinstance(value, Mapping):
        raise TypeError(_refusal(name, wish, '', value))
    for key in value:
        if not isinstance(key, str):
            raise TypeError(f'{name} must be {wish}; the name {shown(key)} is not a text')
    return value


def array(
    name: str, value: Any, shape: Sequence[int | str], unit: str = '', *, row: str = 'row',
    finite: bool = True
) -> np.ndarray:
    """
    Return a new array of doubles; `row` names a row in error messages.

    `shape`: sizes; a word such as 'n' stands for any size, a first one such as '[n]' for an
    optional axis, and '...' for any axes.
    """
    wish = _wish_of(shape)
    if not isinstance(value, np.ndarray) and _holds_boolean(value, _MAX_LEVELS):
        raise TypeError(_refusal(name, wish, unit, value))
    try:
        found = np.asarray(value)
    except ValueError:
        raise ValueError(
            f'{name} must be {wish}{_of(unit)}, got rows of different lengths') from None
    except Exception:  # noqa: BLE001 - an object that claims to be an array
        raise TypeError(_refusal(name, wish, unit, value)) from None
    if found.dtype.kind == 'O' and all(isinstance(part, Real) for part in found.flat) and (
            found.ndim or not isinstance(value, Real)):
        try:
            found = found.astype(float)
        except OverflowError:
            raise ValueError(_refusal(name, wish, unit, value)) from None
    if found.dtype.kind not in 'iuf':
        raise TypeError(_refusal(name, wish, unit, value))
    if not _fits(found.shape, tuple(shape)):
        raise ValueError(
            _refusal(name, wish, unit, value) if len(shape) == 1 and found.size <= 4
            else f'{name} must be {wish}{_of(unit)}, got the shape {found.shape}')
    with np.errstate(over='ignore'):
        result = np.array(found, dtype=float, order='C', subok=False)
    if finite and not np.isfinite(result).all():
        if result.ndim < 2:
            raise ValueError(_refusal(name, wish, unit, value))
        found = result.reshape(-1, result.shape[-1])
        worst = int(np.argmin(np.isfinite(found).all(axis=1)))
        raise ValueError(
            f'{name} of {row} {worst} must be finite{_of(unit)}, got {shown(found[worst])}')
    return result


def quaternions(
    name: str, value: Any, shape: Sequence[int | str], *, row: str = 'row'
) -> np.ndarray:
    """Return quaternions x, y, z, w, normalised if they are close to unit length."""
    found = array(name, value, shape, row=row)
    length = np.linalg.norm(found, axis=-1, keepdims=True)
    off = np.abs(length - 1.0)
    if not (off <= _MAX_UNIT_ERROR).all():
        worst = int(np.argmax(off))
        which = f' of {row} {worst}' if found.ndim > 1 else ''
        raise ValueError(
            f'{name}{which} must be a unit quaternion x, y, z, w, got '
            f'{shown(found.reshape(-1, 4)[worst])}')
    return np.where(off <= _ROUND_OFF, found, found / length)


def directions(name: str, value: Any, *, single: bool = False) -> np.ndarray:
    """Return unit vectors (..., 3) along nonzero directions; `single`: one vector, (3,)."""
    found = array(name, value, (3,) if single else ('...', 3))
    if not found.size:
        raise ValueError(f'{name} must hold at least one direction, got the shape {found.shape}')
    # Squares of very large and very small numbers overflow or underflow.
    size = np.abs(found).max(axis=-1, keepdims=True)
    if not size.all():
        raise ValueError(f'{name} must be three numbers, not all 0, got a direction of zeros')
    found /= size
    return np.asarray(found / np.linalg.norm(found, axis=-1, keepdims=True))


def alike_rows(name: str, value: np.ndarray, other: str, reference: np.ndarray) -> None:
    """Reject two arrays (..., 3) whose leading axes are incompatible."""
    try:
        np.broadcast_shapes(value.shape[:-1], reference.shape[:-1])
    except ValueError:
        raise ValueError(
            f'{name} and {other} must have the same number of rows, or one, got the shapes '
            f'{value.shape} and {reference.shape}') from None


def decoded(content: bytes) -> str:
    """Return the text of a UTF-8 file; raise ValueError with the detected encoding otherwise."""
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) or b'\0' in content:
        raise ValueError('this is UTF-16, or not text; save it as UTF-8')
    try:
        return content.decode('utf-8-sig')
    except UnicodeDecodeError as error:
        line = content.count(b'\n', 0, error.start) + 1
        raise ValueError(
            f'this is not UTF-8 (byte 0x{content[error.start]:02x} in line {line}); save it as '
            'UTF-8') from None


def number_in(word: str | bytes) -> float:
    """Return the number that a word of a file states; Python alone reads 1_0 as 10."""
    text = word.decode('ascii') if isinstance(word, bytes) else word
    if '_' in text or not text.isascii():
        raise ValueError(f'{text!r} is not a number')
    return float(text)


def counted(number: int, noun: str) -> str:
    """Return a count in words: 1 body, 1,000 bodies."""
    several = f'{noun[:-1]}ies' if noun.endswith('y') else f'{noun}s'
    return f'{number:,} {noun if number == 1 else several}'


def shown(value: Any) -> str:
    """Return a value as a message shows it: short, on one line."""
    kind = type(value).__name__
    if isinstance(value, np.ndarray) and (value.size > 6 or value.ndim > 1):
        return f'an array of shape {value.shape} and type {value.dtype}'
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, _SHOWN_AS_THEY_ARE):
        if callable(value) and hasattr(value, '__name__'):
            return f'{kind} {value.__name__}'
        return f'{_article(kind)} {kind}'
    try:
        words = ' '.join(_SHORT_REPR.repr(value).split())
    except Exception:  # an integer of thousands of digits, or a class of the user
        return f'{_article(kind)} {kind}'
    return words if len(words) <= _MAX_SHOWN_LENGTH else words[:_MAX_SHOWN_LENGTH] + '...'


def _refusal(name: str, wish: str, unit: str, value: Any) -> str:
    return f'{name} must be {wish}{_of(unit)}, got {shown(value)}'


def _of(unit: str) -> str:
    return f' [{unit}]' if unit else ''


def _range(
    least: float | None, above: float | None, most: float | None, below: float | None
) -> str:
    bounds = (
        ('at least', least), ('above', above), ('at most', most), ('below', below))
    words = ' and '.join(f'{word} {bound:.17g}' for word, bound in bounds if bound is not None)
    return f'a finite number, {words}' if words else 'a finite number'


def _wish_of(shape: Sequence[int | str]) -> str:
    if len(shape) == 1 and isinstance(shape[0], int):
        return f'{_COUNTS.get(shape[0], shape[0])} finite numbers'
    sizes = ', '.join(map(str, shape)) + (',' if len(shape) == 1 else '')
    if _may_lack(shape):
        rest = f'{_wish_of(shape[1:])} or '
        return f'{rest}of the shape ({sizes})'.replace('[', '').replace(']', '')
    return f'finite numbers of the shape ({sizes})'


def _fits(found: tuple[int, ...], wanted: tuple[int | str, ...]) -> bool:
    if _may_lack(wanted) and len(found) < len(wanted):
        wanted = wanted[1:]
    if wanted and wanted[0] == '...':
        wanted = wanted[1:]
        found = found[max(len(found) - len(wanted), 0):]
    return len(found) == len(wanted) and all(
        isinstance(size, str) or size == own for own, size in zip(found, wanted))


def renamed_attributes(**names: str) -> Callable[[Class], Class]:
    """
    Return a decorator of classes whose attributes have new names.

    Reading an attribute by a former name raises AttributeError with the new name. `names` maps
    former names to new ones. Type checkers do not see the decorated `__getattr__`, so they still
    report attributes that the class lacks.
    """
    def decorate(cls: Class) -> Class:
        def find_missing(self: Any, name: str) -> Any:
            if name in names:
                raise AttributeError(renamed_text(cls.__name__, name, names))
            return object.__getattribute__(self, name)

        cls.__getattr__ = find_missing  # type: ignore[attr-defined]
        return cls

    return decorate


def renamed_text(owner: str, name: str, names: Mapping[str, str]) -> str:
    """Return the error for a former name of an attribute of `owner`."""
    return f'{owner}.{name} has been renamed: use {owner}.{names[name]}'


def _may_lack(shape: Sequence[int | str]) -> bool:
    return str(shape[0]).startswith('[')


def _holds_boolean(value: Any, levels: int) -> bool:
    if isinstance(value, (list, tuple)) and levels:
        return any(_holds_boolean(part, levels - 1) for part in value)
    if isinstance(value, np.ndarray):
        return value.dtype.kind == 'b'
    return isinstance(value, _BOOLEANS)


def _article(word: str) -> str:
    return 'an' if word[:1].lower() in 'aeio' else 'a'
