# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
The walk of ROS 2 through the YAML events of a parameter file.

rcl builds no tree: it walks the events with a few counters, and it makes the names of nested
parameters by joining text with dots and cutting it again. This has effects that no reader of the
file would guess (a dotted key with a map below it renames its neighbours), and this module has
the same ones. Facts: rcl 9.2 (ROS 2 Jazzy), rcl_yaml_param_parser/src/parse.c and namespace.c.
"""

from collections.abc import Iterable
import re
from typing import Any

from icofabric_sim.parameters.rcl_parameters import (
    origin,
    RclParameters,
    RefusedByRos,
    Section,
    store_value,
)
from icofabric_sim.parameters.yaml_events import SECTION_KEY
import yaml

_NAMESPACE_LEVEL, _PARAMETER_LEVEL = 1, 2
# rmw/validate_namespace.h, rmw/validate_node_name.h
_LONGEST_NAMESPACE, _LONGEST_NODE_NAME = 245, 255


def walk_file(parameters: RclParameters, events: Iterable[Any], source: str) -> None:
    """
    Add what ROS takes from the events of one file; raise RefusedByRos where ROS would refuse.
    """
    _FileWalk(parameters, source).walk(events)


class _Names:
    """A namespace as rcl keeps it: one text and a count of names, which can come apart."""

    def __init__(self, separator: str) -> None:
        self.separator = separator
        self.text: str | None = None
        self.count = 0

    def push(self, name: str) -> None:
        if self.count == 0 or self.text is None:
            self.text = name
        elif self.text.endswith(self.separator):
            self.text += name
        else:
            self.text += self.separator + name
        self.count += 1

    def pop(self) -> None:
        if self.count == 1:
            self.text = None
        elif self.count > 1 and self.text is not None:
            head, found, _ = self.text.rpartition(self.separator)
            self.text = head if found else self.text
        self.count = max(self.count - 1, 0)


def _check_section_name(name: str, line: int) -> None:
    namespace, found, node_name = name.rpartition('/')
    if found and name not in ('/**', '/*'):
        for token in namespace.removeprefix('/').split('/') if namespace else []:
            if token in ('*', '**'):
                continue
            if not re.fullmatch('[A-Za-z_][A-Za-z0-9_]*', token) or (
                    len(token) + 1 > _LONGEST_NAMESPACE):
                raise RefusedByRos(line, f'{name!r} is not the name of a node: {token!r} is no '
                                         'valid part of a namespace')
    if node_name not in ('*', '**') and (
            not re.fullmatch('[A-Za-z_][A-Za-z0-9_]*', node_name) or (
                len(node_name) > _LONGEST_NODE_NAME)):
        raise RefusedByRos(line, f'{name!r} is not the name of a node')


class _FileWalk:
    """The counters with which rcl walks the events of one file (parse_file_events, parse_key)."""

    def __init__(self, parameters: RclParameters, source: str) -> None:
        self.parameters = parameters
        self.source = source
        self.node_names = _Names('/')
        self.parameter_names = _Names('.')
        self.level = _NAMESPACE_LEVEL
        self.depth = 0
        self.is_key = True
        self.is_list = False
        self.is_new_map = False
        self.list_kind: type | None = None
        self.section: Section | None = None
        self.entry_index = 0

    def walk(self, events: Iterable[Any]) -> None:
        for event in events:
            line = event.start_mark.line + 1
            if isinstance(event, yaml.ScalarEvent):
                if self.is_key:
                    self.key(event.value, line)
                    self.is_key = False
                else:
                    self.value(event, line)
            elif isinstance(event, yaml.SequenceStartEvent):
                if self.is_key:
                    raise RefusedByRos(line, 'a list stands where a name is expected')
                if self.level < _PARAMETER_LEVEL:
                    raise RefusedByRos(line, f'there is a list before {SECTION_KEY}')
                self.is_list, self.list_kind = True, None
            elif isinstance(event, yaml.SequenceEndEvent):
                self.is_list, self.is_key = False, True
            elif isinstance(event, yaml.MappingStartEvent):
                self.depth += 1
                self.is_key = True
                # The map right below ros__parameters gives no prefix.
                self.is_new_map = not (
                    self.level == _PARAMETER_LEVEL
                    and self.depth - (self.node_names.count + 1) == 2)
            elif isinstance(event, yaml.MappingEndEvent):
                self.end_map()
            elif isinstance(event, yaml.AliasEvent):
                raise RefusedByRos(line, 'aliases (*name) are not supported')

    def end_map(self) -> None:
        if self.level == _PARAMETER_LEVEL:
            if self.parameter_names.count > 0:
                self.parameter_names.pop()
            else:
                self.level = _NAMESPACE_LEVEL
        elif self.depth == self.node_names.count + 1:
            self.node_names.pop()
        self.depth -= 1

    def key(self, text: str, line: int) -> None:
        if not text:
            raise RefusedByRos(line, 'there is an empty name')
        text = text.partition('\0')[0]
        if self.level == _PARAMETER_LEVEL:
            self.parameter_key(text, line)
        elif not text.startswith(SECTION_KEY):
            self.node_names.push(text)
        elif self.node_names.count == 0 or self.node_names.text is None:
            raise RefusedByRos(line, f'there is no node name before {SECTION_KEY}')
        else:
            _check_section_name(self.node_names.text, line)
            self.section = self.parameters.find_section(self.node_names.text)
            self.node_names.pop()
            self.level = _PARAMETER_LEVEL

    def parameter_key(self, text: str, line: int) -> None:
        assert self.section is not None
        entries = self.section.entries
        if self.is_new_map:
            if self.entry_index >= len(entries):
                raise RefusedByRos(line, 'there is a map without a name')
            self.parameter_names.text = entries[self.entry_index].name
            self.parameter_names.count += 1
            self.is_new_map = False
        prefix = self.parameter_names.text
        if prefix is None:
            self.entry_index = self.section.find(text)
        else:
            # rcl renames the entry that stands for the map itself, or makes another one.
            self.entry_index = self.section.find(prefix)
            self.section.rename(self.entry_index, f'{prefix}.{text}')

    def value(self, event: Any, line: int) -> None:
        if self.level < _PARAMETER_LEVEL or self.section is None or not self.section.entries:
            raise RefusedByRos(line, f'there is a value before {SECTION_KEY}')
        if self.entry_index >= len(self.section.entries):
            raise RefusedByRos(line, 'there is a value without a name')
        self.list_kind = store_value(
            self.section.entries[self.entry_index], event, self.is_list, self.list_kind,
            origin(self.source, event))
        if not self.is_list:
            self.is_key = True
