# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Trees of the state of a running simulation, by name.

Each object returns its state by `state_tree()` as plain values, lists, arrays and subtrees, and
restores it by `load_state()`. The tree may come from a file, so every value is validated when it
is read.
"""

from collections.abc import Mapping
import math
from typing import Any, NoReturn

import numpy as np

# JSON has no numbers for these values.
_SPECIAL = {'inf': math.inf, '-inf': -math.inf, 'nan': math.nan}
_LARGEST_COUNT = 2**62


class StateTree:
    """Validating reader of a state tree; a ValueError names a missing or invalid value."""

    def __init__(self, values: Mapping[str, Any], place: str = '') -> None:
        """Read from `values`; `place` is the name of this subtree."""
        self._values, self._place = values, place

    def __contains__(self, name: str) -> bool:
        """Return True if the tree has a value of this name."""
        return self._values.get(name) is not None

    def number(
        self, name: str, least: float = -math.inf, most: float = math.inf, *, finite: bool = True
    ) -> float:
        """Return a number in a range; `finite` excludes infinite ones and NaN."""
        value = as_number(self._found(name))
        if value is None or (finite and not math.isfinite(value)):
            self._refuse(name, 'must be a finite number' if finite else 'must be a number')
        if value < least or value > most:
            self._refuse(name, f'must lie between {least!r} and {most!r}')
        return value

    def count(self, name: str, least: int = 0, most: int = _LARGEST_COUNT) -> int:
        """Return a whole number in a range."""
        value = self._found(name)
        if type(value) is not int or not least <= value <= most:
            self._refuse(name, f'must be a whole number from {least} to {most}')
        return int(value)

    def flag(self, name: str) -> bool:
        """Return a truth value."""
        value = self._found(name)
        if not isinstance(value, bool):
            self._refuse(name, 'must be true or false')
        return bool(value)

    def text(self, name: str) -> str:
        """Return a text."""
        value = self._found(name)
        if not isinstance(value, str):
            self._refuse(name, 'must be a text')
        return str(value)

    def entries(self, name: str) -> list[Any]:
        """Return a list, whose entries the caller validates."""
        value = self._found(name)
        if not isinstance(value, list):
            self._refuse(name, 'must be a list')
        return list(value)

    def array(self, name: str, shape: tuple[int, ...] | None = None) -> np.ndarray:
        """Return an array of doubles, of this shape if one is given."""
        value = self._found(name)
        if not isinstance(value, np.ndarray) or value.dtype != np.float64:
            self._refuse(name, 'must be an array of doubles')
        if shape is not None and value.shape != shape:
            self._refuse(name, f'must have the shape {shape}')
        return np.asarray(value)

    def part(self, name: str) -> 'StateTree':
        """Return a subtree."""
        value = self._found(name)
        if not isinstance(value, Mapping):
            self._refuse(name, 'must be an object with entries')
        return StateTree(value, self._path(name))

    def _path(self, name: str) -> str:
        return f'{self._place}.{name}' if self._place else name

    def _found(self, name: str) -> Any:
        if self._values.get(name) is None:
            raise ValueError(f'{self._path(name)} is missing')
        return self._values[name]

    def _refuse(self, name: str, wish: str) -> NoReturn:
        value = self._values[name]
        if isinstance(value, np.ndarray):
            shown = f'one of the shape {value.shape}'
        elif isinstance(value, (Mapping, list)):
            shown = f'a {type(value).__name__}'
        else:
            text = repr(value)
            shown = text if len(text) <= 60 else text[:60] + '...'
        raise ValueError(f'{self._path(name)} {wish}, got {shown}')


def as_number(value: Any) -> float | None:
    """Return a number, or the text of inf, -inf or nan, as a float; None for other values."""
    if isinstance(value, str):
        return _SPECIAL.get(value)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        return float(value)
    except OverflowError:
        return None


def plain_number(value: float) -> float | str:
    """Return a float in a form for JSON that `as_number` reads."""
    return float(value) if math.isfinite(value) else str(float(value))


def remembered_numbers(what: str, values: np.ndarray, count: int) -> np.ndarray:
    """Return stored numbers of broken objects; raise ValueError if they are invalid."""
    numbers = np.where((values >= 0.0) & (values < count), values, -1.0).astype(np.int64)
    if values.ndim != 1 or not (numbers == values).all() or not (np.diff(numbers) > 0).all():
        raise ValueError(f'broken {what} must be numbers of {what} in rising order')
    return numbers
