# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Validate a flat dictionary to `Parameters`, or raise a `ParameterError` with the reason.

This module checks the name, type and range of each value. Combinations of values are checked
where they are used, see `scene.py`.
"""

from collections.abc import Iterator, Mapping
import dataclasses
from dataclasses import dataclass, replace
import difflib
import math
import re
from typing import Any

from icofabric_sim import checks
from icofabric_sim.checks import shown
from icofabric_sim.parameters.table import (
    BY_NAME,
    FAMILIES,
    Specification,
    STATIC,
    Value,
)

# A letter, then letters, digits, single underscores: also a valid ROS topic token.
_NAME = re.compile(r'[A-Za-z](?:[A-Za-z0-9]|_(?!_))*')
# Leaves room for namespaces: ROS allows 247 characters in the full name of ~/loads/NAME.
_MAX_NAME_LENGTH = 100
_TYPE_WORDS = {bool: 'true or false', int: 'an integer', float: 'a number', str: 'a text'}
_MODE_WORDS = {True: 'always', False: 'never'}


class ParameterError(ValueError):
    """
    Invalid name or value of a parameter.

    The message states the name, the value, the unit and the allowed values.
    """

    def __init__(self, name: str, message: str) -> None:
        """Store the parameter's `name` apart from the `message`, for callers that report both."""
        # Names and values may have line breaks.
        super().__init__(' '.join(message.splitlines()))
        self.name = name

    def __reduce__(self) -> tuple[Any, ...]:
        """Support pickling and copying: the base class keeps only the message."""
        return type(self), (self.name, *self.args), vars(self)


@dataclass(frozen=True)
class Parameters(Mapping[str, Value]):
    """
    Complete, valid set of parameters.

    Contains every static parameter, and all fields of every named group, load, support, ...;
    `explicit` holds the names that were given rather than filled in with defaults.
    """

    table: Mapping[str, Value]
    explicit: frozenset[str]
    # Contents of files that a recorded scene names, see named_files.py.
    files: Mapping[str, Any] = dataclasses.field(default_factory=dict, compare=False)

    def __getitem__(self, name: str) -> Any:
        """Return the value of the parameter with the dotted `name`."""
        return self.table[name]

    def __iter__(self) -> Iterator[str]:
        """Iterate over dotted names."""
        return iter(self.table)

    def __len__(self) -> int:
        """Count the parameters."""
        return len(self.table)

    def names(self, family: str) -> list[str]:
        """Return the names of one family (`groups`, `loads`, ...), sorted."""
        prefix = checks.text('family', family) + '.'
        return sorted({key.split('.')[1] for key in self.table if key.startswith(prefix)})

    def given(self) -> dict[str, Value]:
        """Return the values that were given, without the defaults."""
        return {name: value for name, value in self.table.items() if name in self.explicit}

    def complete(self) -> dict[str, Value]:
        """
        Return all values that a parameter file can hold, without overruled defaults.

        A file with both a thickness and an inner edge length would be refused when read.
        """
        overruled = set()
        if self.table['shell.inner_edge_length'] > 0.0:  # type: ignore[operator]
            overruled = {'shell.thickness'} - self.explicit
        return {name: value for name, value in self.table.items() if name not in overruled}

    def with_changes(self, changes: Mapping[str, Any]) -> 'Parameters':
        """Return a set with all `changes` applied together, or raise ParameterError."""
        checks.mapping('changes', changes)
        return replace(make_parameters({**self.given(), **changes}), files=self.files)


def make_parameters(flat: Mapping[str, Any]) -> Parameters:
    """Validate a flat dictionary of dotted names and complete it with the defaults."""
    values: dict[str, Value] = {entry.name: _copy(entry.default) for entry in STATIC}
    for name, value in flat.items():
        values[name] = validate_value(name, value)
    for family, fields in FAMILIES.items():
        for member in sorted(
            {name.split('.')[1] for name in flat if name.startswith(family + '.')}
        ):
            for field in fields:
                name = f'{family}.{member}.{field.name}' if field.name else f'{family}.{member}'
                if name in values:
                    continue
                if field.required:
                    raise ParameterError(
                        name,
                        f'{name} is missing: {family}.{member} needs it ({field.description})',
                    )
                values[name] = _copy(field.default)
    return Parameters(values, frozenset(flat))


def find_specification(name: str) -> Specification:
    """Return the specification of a dotted `name`, or raise ParameterError if it is unknown."""
    if name in BY_NAME:
        return BY_NAME[name]
    family, _, rest = name.partition('.')
    if family in FAMILIES and rest:
        member, _, field_name = rest.partition('.')
        if not _NAME.fullmatch(member) or len(member) > _MAX_NAME_LENGTH:
            raise ParameterError(
                name,
                f'{name}: {member!r} is not a valid name; use a letter, then letters, digits '
                f'and single underscores, at most {_MAX_NAME_LENGTH} in all',
            )
        for field in FAMILIES[family]:
            if field.name == field_name:
                return field
        allowed = ', '.join(
            f'{family}.{member}' + (f'.{field.name}' if field.name else '')
            for field in FAMILIES[family]
        )
        raise ParameterError(name, f'{name} is not a parameter; allowed: {allowed}')
    raise ParameterError(name, f'{name} is not a parameter; {_nearest(name)}')


def validate_value(name: str, value: Any) -> Value:
    """
    Return `value` in the type of the parameter, or raise ParameterError.

    Integers become floats if the parameter is a float.
    """
    entry = find_specification(name)
    if name == 'contact.mode' and isinstance(value, bool):
        value = _MODE_WORDS[value]  # YAML reads the words off and on as booleans
    result = _convert(name, value, entry)
    if entry.choices and result not in entry.choices:
        raise ParameterError(
            name, f'{name} must be one of {_listing(entry.choices)}, got {shown(value)}'
        )
    for element in result if isinstance(result, list) else [result]:
        _check_range(name, element, value, entry)
    return result


def _convert(name: str, value: Any, entry: Specification) -> Value:
    default = entry.default
    if isinstance(default, list):
        kind = type(default[0])
        elements = _plain(value)
        if not isinstance(elements, list) or len(elements) != len(default):
            raise ParameterError(
                name,
                f'{name} must be a list of {len(default)} values{_unit(entry)}, '
                f'got {shown(value)}',
            )
        return [_convert_scalar(name, element, kind, value) for element in elements]
    return _convert_scalar(name, _plain(value), type(default), value)


def _convert_scalar(name: str, value: Any, kind: type[Any], given: Any) -> Any:
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        try:
            value = float(value)
        except OverflowError:
            raise ParameterError(
                name, f'{name} is too large for a number: {shown(given)}') from None
    if type(value) is not kind:
        raise ParameterError(name, f'{name} must be {_TYPE_WORDS[kind]}, got {shown(given)}')
    if kind is float and not math.isfinite(value):
        raise ParameterError(name, f'{name} must be finite, got {shown(given)}')
    if kind is int and not -(2**63) <= value < 2**63:
        raise ParameterError(name, f'{name} must fit in 64 bits, got {shown(given)}')
    return value


def _check_range(name: str, element: Any, given: Any, entry: Specification) -> None:
    if entry.minimum is None or isinstance(element, (str, bool)):
        return
    low = element > entry.minimum if entry.open_minimum else element >= entry.minimum
    high = entry.maximum is None or element <= entry.maximum
    if entry.smallest is not None:
        low = element == 0.0 or element >= entry.smallest
    if not (low and high):
        bound = f'above {entry.minimum:g}' if entry.open_minimum else f'at least {entry.minimum:g}'
        if entry.smallest is not None:
            bound = f'at least {entry.smallest:g}'
        if entry.maximum is not None:
            bound += f' and at most {entry.maximum:g}'
        if entry.smallest is not None:
            bound += ', or 0'
        raise ParameterError(name, f'{name} must be {bound}{_unit(entry)}, got {shown(given)}')


def _plain(value: Any) -> Any:
    """Convert NumPy scalars and arrays, array.array and tuples to plain Python."""
    if hasattr(value, 'tolist'):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [element.item() if hasattr(element, 'item') else element for element in value]
    return value


def _copy(value: Value) -> Value:
    return list(value) if isinstance(value, list) else value  # type: ignore[return-value]


def _unit(entry: Specification) -> str:
    return f' [{entry.unit}]' if entry.unit else ''


def _listing(choices: tuple[Any, ...]) -> str:
    return ', '.join(str(choice) for choice in choices)


def _nearest(name: str) -> str:
    close = difflib.get_close_matches(name, BY_NAME, n=3, cutoff=0.5)
    if close:
        return f'did you mean {" or ".join(close)}?'
    group = name.split('.')[0]
    own = [entry for entry in BY_NAME if entry.startswith(group + '.')]
    families = ', '.join(f'{family}.NAME.*' for family in FAMILIES)
    return f'allowed: {", ".join(own or sorted(BY_NAME))}, {families}'
