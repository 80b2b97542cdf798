# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Convert parameters between nested dictionaries, flat ones and the text of parameter files."""

from collections.abc import Iterator, Mapping
import logging
import math
import os
import re
import sys
from typing import Any

from icofabric_sim.checks import shown
from icofabric_sim.parameters.rcl_parameters import (
    full_node_name,
    section_matches,
    unused_notice,
    Value,
)
from icofabric_sim.parameters.rcl_scalars import Scalar
from icofabric_sim.parameters.sections import is_own_parameter
from icofabric_sim.parameters.yaml_events import ParameterFileError, SECTION_KEY
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')
# A YAML key must end within 1024 characters; escapes take up to ten each.
_MAX_NAME_LENGTH = 100
_PLAIN_KEY = re.compile('[A-Za-z_][A-Za-z0-9_]*', re.ASCII)
# ROS reads any key as text; other YAML readers turn these words into values.
_QUOTED_KEYS = {'y', 'n', 'yes', 'no', 'on', 'off', 'true', 'false', 'null'}


def flatten_parameters(
        nested: Mapping[str, Any], *, node_name: str = 'icofabric',
        namespace: str = '/') -> dict[str, Value]:
    """
    Convert nested dictionaries to one dictionary of dotted names and plain values.

    Names may contain dots. Tuples, NumPy scalars, NumPy arrays and paths become plain values, and
    integers in a list with floats become floats. From the dictionary of a whole parameter file
    (`{'/**': {'ros__parameters': ...}}`) the sections of this node are used. Other values that a
    parameter file cannot hold raise ParameterFileError.
    """
    if not isinstance(nested, Mapping):
        raise ParameterFileError(
            f'parameters must be a dictionary of names and values, got {shown(nested)}; '
            'load_scene(path) reads a file')
    node = full_node_name(node_name, namespace)
    sections = list(_sections(nested, ''))
    if sections and not any(section_matches(path, node) for path, _ in sections):
        _LOGGER.warning(
            '%s', unused_notice('the dictionary', [path for path, _ in sections], node))
    flat: dict[str, Value] = {}
    for path, section in sections if sections else [('/**', nested)]:
        if section_matches(path, node):
            if not isinstance(section, Mapping):
                raise ParameterFileError(
                    f'{SECTION_KEY} of {path!r} must be a dictionary, got {shown(section)}')
            own: dict[str, Value] = {}
            _flatten(section, '', own)
            flat.update(own)
    return {name: value for name, value in flat.items() if is_own_parameter(name)}


def dump_parameters(flat: Mapping[str, Any]) -> str:
    """
    Return the text of a parameter file that ROS and this package read to the same values.

    Types are preserved, and floats are bit-identical.
    """
    tree: dict[str, Any] = {}
    single: dict[str, str] = {}
    for name, value in flat.items():
        text = _value_text(_plain(name, value))
        words = name.split('.')
        heads = {'.'.join(words[:count]) for count in range(1, len(words))}
        if heads & flat.keys() or not all(_PLAIN_KEY.fullmatch(word) for word in words):
            single[name] = text  # on a separate line, because ROS confuses it in a map
            continue
        branch = tree
        for word in words[:-1]:
            branch = branch.setdefault(word, {})
        branch[words[-1]] = text
    lines = ['/**:', f'  {SECTION_KEY}:' if flat else f'  {SECTION_KEY}: {{}}']
    lines += [f'    {_key_text(name)}: {text}' for name, text in single.items()]
    lines += _tree_lines(tree, '    ')
    return '\n'.join(lines) + '\n'


def _sections(nested: Mapping[str, Any], path: str) -> Iterator[tuple[str, Any]]:
    for key, value in nested.items():
        joined = f'{path}/{key}' if path and not path.endswith('/') else f'{path}{key}'
        if key == SECTION_KEY and path:
            yield path, value
        elif isinstance(value, Mapping):
            yield from _sections(value, joined)


def _flatten(nested: Mapping[str, Any], prefix: str, flat: dict[str, Value]) -> None:
    for key, value in nested.items():
        if not isinstance(key, str) or not key or '\0' in key:
            raise ParameterFileError(
                f'{shown(key)} below {prefix.rstrip(".") or "the top"!r} is not a parameter name; '
                'use a string')
        name = prefix + key
        if isinstance(value, Mapping):
            if not value:
                raise ParameterFileError(
                    f'parameter {name!r} is an empty dictionary; write parameters into it or '
                    'leave it out')
            _flatten(value, name + '.', flat)
        elif name in flat:
            raise ParameterFileError(f'parameter {name!r} is given twice; give it once')
        else:
            # In Python an integer is a number; a list in a parameter file has one type.
            flat[name] = _plain(name, value, numbers_alike=True)


def _plain(name: str, value: Any, *, numbers_alike: bool = False) -> Value:
    """Convert to plain Python; `numbers_alike` makes integers in a list with floats floats."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, (list, tuple)):
        return _plain_scalar(name, value)
    if not value:
        raise ParameterFileError(
            f'parameter {name!r} is an empty list, which ROS cannot hold; leave it out')
    items = [_plain_scalar(name, item) for item in value]
    kinds = {type(item) for item in items}
    if numbers_alike and kinds == {int, float}:
        return [float(item) for item in items]
    if len(kinds) > 1:
        names = ' and '.join(sorted(kind.__name__ for kind in kinds))
        raise ParameterFileError(
            f'parameter {name!r} mixes {names} in one list {shown(value)}, which ROS '
            'refuses; give all one type')
    return items  # type: ignore[return-value]


def _plain_scalar(name: str, value: Any) -> Scalar:
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        if not -2**63 <= value < 2**63:
            raise ParameterFileError(
                f'parameter {name!r}: {shown(value)} does not fit in 64 bits; use a float')
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value)
    if isinstance(value, os.PathLike):
        value = os.fspath(value)
    if isinstance(value, str):
        if '\0' in value or not _is_text(value):
            raise ParameterFileError(
                f'parameter {name!r}: {shown(value)} has a character that ROS cannot hold (NUL '
                'or half of a surrogate pair); remove it')
        return str(value)
    remedy = 'leave it out' if value is None else (
        'give a bool, int, float, string, or a flat list of one of these')
    raise ParameterFileError(
        f'parameter {name!r}: ROS cannot hold {shown(value)} of type {type(value).__name__}; '
        f'{remedy}')


def _is_text(text: str) -> bool:
    return not any('\ud800' <= character <= '\udfff' for character in text)


def _tree_lines(tree: dict[str, Any], indent: str) -> list[str]:
    lines = []
    for name, value in tree.items():
        key = _quoted(name) if name.lower() in _QUOTED_KEYS else name
        if isinstance(value, dict):
            lines += [f'{indent}{key}:', *_tree_lines(value, indent + '  ')]
        else:
            lines.append(f'{indent}{key}: {value}')
    return lines


def _key_text(name: str) -> str:
    if not isinstance(name, str) or not name or '\0' in name or len(name) > _MAX_NAME_LENGTH or (
            not _is_text(name)):
        raise ParameterFileError(
            f'{name!r} is not a parameter name; use a string of 1 to {_MAX_NAME_LENGTH} '
            'characters')
    return _quoted(name)


def _value_text(value: Value) -> str:
    if isinstance(value, list):
        return '[' + ', '.join(_value_text(item) for item in value) + ']'
    if isinstance(value, bool):
        return 'true' if value else 'false'
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return _float_text(value)
    return _quoted(value)


def _float_text(value: float) -> str:
    if math.isnan(value):
        return '.nan'
    if math.isinf(value):
        return '.inf' if value > 0.0 else '-.inf'
    # ROS reads an inexact decimal subnormal as a string.
    if 0.0 < abs(value) < sys.float_info.min:
        return value.hex()
    text = repr(value)
    # Other YAML readers require a point in every float.
    return text if '.' in text else text.replace('e', '.0e')


def _quoted(text: str) -> str:
    if text.isprintable() and "'" not in text:
        return f"'{text}'"
    return '"' + ''.join(
        character if character.isprintable() and character not in '"\\' else _escape(character)
        for character in text) + '"'


def _escape(character: str) -> str:
    code = ord(character)
    if character in '"\\':
        return '\\' + character
    return f'\\x{code:02x}' if code < 256 else f'\\u{code:04x}' if code < 65536 else (
        f'\\U{code:08x}')
