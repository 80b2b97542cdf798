# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Values of a parameter in a sweep: a list, a range with a count, or a range to sample."""

from collections.abc import Mapping, Sequence
import math
import re
from typing import Any, NamedTuple

from icofabric_sim.checks import shown
from icofabric_sim.parameters.validation import find_specification, ParameterError, validate_value
import numpy as np

# `weave.size[2]`: one element of a list.
_ELEMENT = re.compile(r'(.+)\[([0-9])\]')
_NUMBER = r'[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?'
_RANGE = re.compile(rf'\s*({_NUMBER})\s*\.\.\s*({_NUMBER})\s*(?:/\s*(\d+))?\s*(log)?\s*')
_WISH = ("a list of values, or a range such as '0.1..0.7/13' or {from: 0.1, to: 0.7, count: 13}; "
         "append 'log', or set log: true, for logarithmic spacing")
_MAX_RANGE_COUNT = 1_000_000


class Name(NamedTuple):
    """A parameter, or one element of a parameter that is a list."""

    parameter: str
    element: int | None

    @property
    def is_integer(self) -> bool:
        """True if the parameter is an integer."""
        default = find_specification(self.parameter).default
        return type(default[0] if isinstance(default, list) else default) is int

    @property
    def unit(self) -> str:
        """Unit, '' without one."""
        return find_specification(self.parameter).unit


class Range(NamedTuple):
    """Range from `low` to `high`."""

    low: float
    high: float
    value_count: int | None  # None: to be sampled
    logarithmic: bool

    def at(self, place: float, *, is_integer: bool) -> float | int:
        """Return the value at a fraction from 0 to 1, of which all integers have equal shares."""
        if is_integer:
            span = int(self.high) - int(self.low) + 1
            return int(self.low) + min(int(place * span), span - 1)
        if place in (0.0, 1.0):
            return self.high if place else self.low
        if self.logarithmic:
            value = math.exp((1.0 - place) * math.log(self.low) + place * math.log(self.high))
        else:
            value = (1.0 - place) * self.low + place * self.high
        return min(max(value, self.low), self.high)

    def values(self, *, is_integer: bool) -> list[float | int]:
        """Return evenly spaced values, both ends included."""
        assert self.value_count is not None
        if self.value_count == 1:
            places = np.zeros(1)
        else:
            places = np.linspace(0.0, 1.0, self.value_count)
        found = [self.at(float(place), is_integer=False) for place in places]
        return [round(value) for value in found] if is_integer else found


def parse_name(text: Any) -> Name:
    """Parse 'name' or 'name[i]'. Raise ParameterError if there is no such parameter."""
    if not isinstance(text, str):
        raise ValueError(f'vary: {shown(text)} must be a string, the name of a parameter')
    match = _ELEMENT.fullmatch(text)
    if match is None:
        find_specification(text)
        return Name(text, None)
    entry = find_specification(match[1])
    size = len(entry.default) if isinstance(entry.default, list) else 0
    if not int(match[2]) < size:
        what = f'has {size} elements, counted from 0' if size else 'is not a list'
        raise ParameterError(match[1], f'{text}: {match[1]} {what}')
    return Name(match[1], int(match[2]))


def parse_values(text: str, given: Any) -> list[Any] | Range:
    """Return the values or the range of the parameter `text`; raise ValueError if invalid."""
    name = parse_name(text)
    if isinstance(given, np.ndarray):
        given = given.tolist()
    if isinstance(given, range):
        given = list(given)
    if isinstance(given, Mapping):
        return _checked(text, name, _range_of(text, given))
    if isinstance(given, str):
        match = _RANGE.fullmatch(given)
        if match is None:
            raise ValueError(f'vary: {text} must be {_WISH}, got {shown(given)}')
        count = None if match[3] is None else int(match[3])
        return _checked(text, name, Range(
            float(match[1]), float(match[2]), count, match[4] is not None))
    if not isinstance(given, Sequence) or isinstance(given, bytes) or not given:
        raise ValueError(f'vary: {text} must be {_WISH}, got {shown(given)}')
    return [validated_value(name, value) for value in given]


def validated_value(name: Name, value: Any) -> Any:
    """Return a value in the type of the parameter; raise ParameterError if it does not fit."""
    if name.element is None:
        return validate_value(name.parameter, value)
    default = list(find_specification(name.parameter).default)  # type: ignore[arg-type]
    default[name.element] = value
    return validate_value(name.parameter, default)[name.element]  # type: ignore[index]


def _range_of(text: str, given: Mapping[str, Any]) -> Range:
    unknown = sorted(map(str, given.keys() - {'from', 'to', 'count', 'log'}))
    if unknown or not {'from', 'to'} <= given.keys():
        said = f'; unknown key {unknown[0]}' if unknown else ''
        raise ValueError(f'vary: {text} must be {_WISH}{said}')
    for word in ('from', 'to'):
        value = given[word]
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise ValueError(f'vary: {text}: {word} must be a number, got {shown(value)}')
    count = given.get('count')
    if count is not None and (isinstance(count, bool) or not isinstance(count, int)):
        raise ValueError(f'vary: {text}: count must be an integer, got {shown(count)}')
    if not isinstance(given.get('log', False), bool):
        raise ValueError(f'vary: {text}: log must be true or false, got {shown(given["log"])}')
    return Range(float(given['from']), float(given['to']), count, given.get('log', False))


def _checked(text: str, name: Name, found: Range) -> Range:
    default = find_specification(name.parameter).default
    sample = default[0] if isinstance(default, list) else default
    if isinstance(sample, (str, bool)) or (isinstance(default, list) and name.element is None):
        way = f', or vary one element, such as {text}[0]' if isinstance(default, list) else ''
        raise ValueError(
            f'vary: {text} is not a single number, so it takes no range; list whole values{way}')
    if not (math.isfinite(found.low) and math.isfinite(found.high) and found.low < found.high):
        raise ValueError(
            f'vary: {text}: the lower end must be below the upper end, got {found.low:g} to '
            f'{found.high:g}')
    if found.logarithmic and not found.low > 0.0:
        raise ValueError(
            f'vary: {text}: a logarithmic range must start above 0, got {found.low:g}')
    if found.value_count is not None and not 2 <= found.value_count <= _MAX_RANGE_COUNT:
        raise ValueError(
            f'vary: {text}: the count of a range must be from 2 to {_MAX_RANGE_COUNT:,}, '
            f'got {found.value_count}')
    if name.is_integer:
        if found.low != int(found.low) or found.high != int(found.high) or found.logarithmic:
            raise ValueError(
                f'vary: {text} is an integer: both ends must be integers and the spacing linear, '
                f'got {found.low:g} to {found.high:g}')
        if found.value_count is not None and (found.high - found.low) % (found.value_count - 1):
            raise ValueError(
                f'vary: {text}: {found.value_count} evenly spaced values from {found.low:g} to '
                f'{found.high:g} are not all integers; list the values')
    return found
