# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Group selectors: resolve `z_max and not ids 0 5` to an array of body numbers."""

import re
from typing import NamedTuple, NoReturn

from icofabric_sim.checks import number_in
from icofabric_sim.parameters.validation import ParameterError
import numpy as np

_EXTREMES = {f'{axis}_{end}': (k, end) for k, axis in enumerate('xyz') for end in ('min', 'max')}
# Grid axes: rows are counted along x, columns along y, levels along z of the fabric.
_GRID = {'row': 0, 'column': 1, 'level': 2}
_INTEGER = re.compile(r'[+-]?[0-9]{1,100}')
_HELP = (
    'use x_min, x_max, y_min, y_max, z_min, z_max, level K, row K, column K, ids K K ..., '
    'box x0 y0 z0 x1 y1 z1 or all, combined by and, or, not'
)


class Bodies(NamedTuple):
    """Woven state of the bodies that selectors choose from."""

    position: np.ndarray  # (n, 3) woven rest positions [m], loose bodies after the woven ones
    grid: np.ndarray  # (m, 3) grid positions of the woven bodies on the fabric's own axes, m <= n
    pitch: float  # W [m]


def select(name: str, text: str, bodies: Bodies) -> np.ndarray:
    """
    Return the body numbers that the selector `text` of the parameter `name` chooses.

    The result is a sorted int32 array, never empty.
    """
    words = text.split()
    if not words:
        raise ParameterError(name, f'{name} is an empty selector; {_HELP}')
    parser = Parser(name, text, words, bodies)
    mask = parser.any_of()
    if parser.at < len(words):
        parser.fail(f'unexpected {words[parser.at]!r}')
    chosen = np.flatnonzero(mask).astype(np.int32)
    if not len(chosen):
        raise ParameterError(
            name,
            f'{name}: {text!r} selects no body of the {len(bodies.position)}; {_extent(bodies)}',
        )
    return chosen


def check_syntax(name: str, text: str) -> None:
    """Raise ParameterError if `text` is not a selector; without a fabric, any number is valid."""
    words = text.split()
    if not words:
        raise ParameterError(name, f'{name} is an empty selector; {_HELP}')
    parser = Parser(name, text, words, None)
    parser.any_of()
    if parser.at < len(words):
        parser.fail(f'unexpected {words[parser.at]!r}')


def _extent(bodies: Bodies) -> str:
    if not len(bodies.grid):
        return 'the weave has no bodies'
    low, high = bodies.grid.min(axis=0), bodies.grid.max(axis=0)
    return (
        f'there are rows {low[0]} to {high[0]}, columns {low[1]} to {high[1]}, '
        f'levels {low[2]} to {high[2]}'
    )


class Parser:
    """Recursive-descent parser: any_of > all_of > one; `not` binds tightest, `or` loosest."""

    help = _HELP

    def __init__(self, name: str, text: str, words: list[str], bodies: Bodies | None) -> None:
        self.name, self.text, self.words, self.bodies = name, text, words, bodies
        self.at = 0

    def fail(self, why: str) -> NoReturn:
        raise ParameterError(
            self.name, f'{self.name}: cannot read the selector {self.text!r}: {why}; {self.help}'
        )

    def next_is(self, word: str) -> bool:
        if self.at < len(self.words) and self.words[self.at] == word:
            self.at += 1
            return True
        return False

    def any_of(self) -> np.ndarray:
        mask = self.all_of()
        while self.next_is('or'):
            mask = mask | self.all_of()
        return mask

    def all_of(self) -> np.ndarray:
        mask = self.one()
        while self.next_is('and'):
            mask = mask & self.one()
        return mask

    def one(self) -> np.ndarray:
        if self.next_is('not'):
            # A loop, because recursion over a thousand words would overflow the stack.
            negated = True
            while self.next_is('not'):
                negated = not negated
            mask = self.one()
            return ~mask if negated else mask
        if self.at >= len(self.words):
            self.fail('a word is missing at the end')
        word = self.words[self.at]
        self.at += 1
        return self.true() if word == 'all' else self.atom(word)

    def atom(self, word: str) -> np.ndarray:
        """Return the mask of a word other than `all` and `not`, with its arguments."""
        if word in _EXTREMES:
            return self.extreme(*_EXTREMES[word])
        if word in _GRID:
            return self.on_grid(_GRID[word], self.integers(1)[0])
        if word == 'ids':
            return self.ids(self.integers(None))
        if word == 'box':
            return self.box(np.array(self.numbers(6)))
        self.fail(f'{word!r} is unknown')

    def true(self) -> np.ndarray:
        return np.ones(0 if self.bodies is None else len(self.bodies.position), dtype=bool)

    def extreme(self, axis: int, end: str) -> np.ndarray:
        if self.bodies is None or not len(self.bodies.position):
            return self.true()
        along = self.bodies.position[:, axis]
        reach = 0.5 * self.bodies.pitch
        # Strictly within W/2: in an axis-aligned weave the next layer is W away, so round-off has
        # no effect.
        return along < along.min() + reach if end == 'min' else along > along.max() - reach

    def on_grid(self, axis: int, index: int) -> np.ndarray:
        mask = ~self.true()
        if self.bodies is not None:
            mask[: len(self.bodies.grid)] = self.bodies.grid[:, axis] == index
        return mask

    def ids(self, numbers: list[int]) -> np.ndarray:
        mask = ~self.true()
        for number in numbers:
            if self.bodies is None:
                continue
            if not 0 <= number < len(mask):
                self.fail(f'there is no body {number}; bodies are numbered 0 to {len(mask) - 1}')
            mask[number] = True
        return mask

    def box(self, corners: np.ndarray) -> np.ndarray:
        low, high = corners[:3], corners[3:]
        if not (low <= high).all():
            self.fail('the second corner of a box must not lie below the first')
        if self.bodies is None:
            return self.true()
        position = self.bodies.position
        return np.all((position >= low) & (position <= high), axis=1)

    def numbers(self, count: int) -> list[float]:
        values: list[float] = []
        for word in self.words[self.at:self.at + count]:
            try:
                values.append(number_in(word))
            except ValueError:
                self.fail(f'{word!r} is not a number')
        if len(values) < count or not np.isfinite(values).all():
            self.fail(f'{count} finite numbers are needed')
        self.at += count
        return values

    def integers(self, count: int | None) -> list[int]:
        values: list[int] = []
        while self.at < len(self.words) and (count is None or len(values) < count):
            # Only ASCII digits, because int() also accepts 1_0 and digits of other scripts.
            if not _INTEGER.fullmatch(self.words[self.at]):
                break
            values.append(int(self.words[self.at]))
            self.at += 1
        if not values or (count is not None and len(values) < count):
            self.fail('an integer is needed')
        return values
