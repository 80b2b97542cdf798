# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Rules by which a ROS 2 node selects sections of parameter files and resolves repeated parameters.

Sources: rcl 9.2 (ROS 2 Jazzy), rcl_yaml_param_parser/src/parse.c and namespace.c; for the
selection of sections rclpy/src/rclpy/node.cpp.
"""

from collections.abc import Collection
import re
from typing import Any, NamedTuple

from icofabric_sim.parameters.rcl_scalars import Scalar

Value = Scalar | list[bool] | list[int] | list[float] | list[str]

# The order in which rclpy reads the slots of a parameter.
_SLOTS = [(is_list, kind) for is_list in (False, True) for kind in (bool, int, float, str)]
# rmw/validate_namespace.h, rmw/validate_node_name.h
_MAX_NAMESPACE_LENGTH, _MAX_NODE_NAME_LENGTH = 245, 255
_NAME_PATTERN = re.compile('[A-Za-z_][A-Za-z0-9_]*')


class Origin(NamedTuple):
    """Source of a value: a file and a line, or an argument of the command line."""

    source: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        return f'{self.source}:{self.line}' if self.line else self.source


def origin(source: str, event: Any) -> Origin:
    """Return the place of a YAML event in its file."""
    return Origin(source, event.start_mark.line + 1, event.start_mark.column + 1)


class Setting(NamedTuple):
    """Value of a parameter and its origin."""

    value: Value
    origin: Origin


class Entries:
    """
    Values that one section gives to one parameter, as rcl stores them.

    rcl adds an entry each time the name is reached through a map. A name written with dots adds
    only the first entry; otherwise its value goes into that first entry. The last entry
    counts. An entry has a slot for each type, and rclpy takes the first filled slot, so an
    earlier value can hide a later one.
    """

    def __init__(self) -> None:
        self._entries: list[dict[tuple[bool, type], Setting]] = []

    def add(self, setting: Setting, *, in_map: bool) -> None:
        if in_map or not self._entries:
            self._entries.append({})
        value = setting.value
        first = value[0] if isinstance(value, list) else value
        self._entries[-1 if in_map else 0][isinstance(value, list), type(first)] = setting

    def effective(self) -> Setting:
        """Return the value that a node gets."""
        return next(self._entries[-1][slot] for slot in _SLOTS if slot in self._entries[-1])


def section_name_error(name: str) -> str:
    """Return the reason why ROS refuses a section name, or '' if the name is valid."""
    namespace, found, node_name = name.rpartition('/')
    if found and name not in ('/**', '/*'):
        for token in namespace.removeprefix('/').split('/') if namespace else []:
            if token not in ('*', '**') and not (
                    _NAME_PATTERN.fullmatch(token) and len(token) < _MAX_NAMESPACE_LENGTH):
                return f'{token!r} is not a valid part of a namespace'
    if node_name not in ('*', '**') and not (
            _NAME_PATTERN.fullmatch(node_name) and len(node_name) <= _MAX_NODE_NAME_LENGTH):
        return f'{node_name!r} is not a valid name'
    return ''


def full_node_name(node_name: str, namespace: str) -> str:
    """Return the name of a node with its namespace, as rclpy joins them."""
    namespace = namespace.strip('/')
    return f'/{namespace}/{node_name}' if namespace else f'/{node_name}'


def unused_notice(source: str, sections: Collection[str], node: str) -> str:
    """Return a sentence that names the `sections` of `source`, none of which is for `node`."""
    return (
        f'{source} has no section for the node {node}, so none of its parameters is used; its '
        f'sections: {", ".join(sections) or "none"}; name one /** or {node}')


def section_matches(section: str, node: str) -> bool:
    """Return True if the node with this full name uses a section of a parameter file."""
    words = section.removeprefix('/').split('/')
    if not all(re.fullmatch(r'\w+|\*\*?', word, re.ASCII) for word in words):
        return False
    # `*` matches one word, `**` any number of words.
    pattern = ''.join('/' + word for word in words).replace('/*', r'(/\w+)')
    return re.fullmatch(pattern, node, re.ASCII) is not None
