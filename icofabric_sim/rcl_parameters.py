# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Which parameters a ROS 2 node really gets from parameter files and overrides.

rcl does not build a tree: it walks the YAML events with a few counters, keeps one slot per type
for each parameter, and names nested parameters by cutting text at dots. This has effects that no
reader of the file would guess (an integer given earlier hides a float given later; a dotted key
inside a map renames its neighbours). This module does the same walk, so that the effects can be
found and refused. Facts: rcl 9.2 (ROS 2 Jazzy), rcl_yaml_param_parser/src/parse.c and
namespace.c; which sections a node takes: rclpy/src/rclpy/node.cpp.
"""

from bisect import insort
from collections.abc import Iterable
from dataclasses import dataclass, field
import re
from typing import Any, NamedTuple

from icofabric_sim.rcl_scalars import resolve_scalar, Scalar
import yaml

Value = Scalar | list[bool] | list[int] | list[float] | list[str]

SECTION_KEY = 'ros__parameters'

# The order in which rclpy looks at the slots of a parameter.
_SCALARS = (bool, int, float, str)
_NAMESPACE_LEVEL, _PARAMETER_LEVEL = 1, 2
# rmw/validate_namespace.h, rmw/validate_node_name.h
_LONGEST_NAMESPACE, _LONGEST_NODE_NAME = 245, 255


class Origin(NamedTuple):
    """
    Where a value was written: a file and its line, or an argument of the command line.
    """

    source: str
    line: int = 0

    def __str__(self) -> str:
        return f'{self.source}:{self.line}' if self.line else self.source


class Setting(NamedTuple):
    """
    A value and where it was written.
    """

    value: Value
    origin: Origin


class RefusedByRos(Exception):
    """
    ROS would refuse this input: the line and why.
    """

    def __init__(self, line: int, reason: str) -> None:
        super().__init__(line, reason)
        self.line = line
        self.reason = reason


@dataclass
class _Entry:
    name: str
    slots: dict[tuple[bool, type], Setting] = field(default_factory=dict)

    def setting(self) -> Setting | None:
        for key in [(is_list, kind) for is_list in (False, True) for kind in _SCALARS]:
            if key in self.slots:
                return self.slots[key]
        return None


@dataclass
class _Section:
    name: str
    entries: list[_Entry] = field(default_factory=list)
    _found: dict[str, list[int]] = field(default_factory=dict)

    def find(self, name: str) -> int:
        """
        Index of the first entry with this name, which is made if there is none.
        """
        indices = self._found.setdefault(name, [])
        if not indices:
            indices.append(len(self.entries))
            self.entries.append(_Entry(name))
        return indices[0]

    def rename(self, index: int, name: str) -> None:
        self._found[self.entries[index].name].remove(index)
        insort(self._found.setdefault(name, []), index)
        self.entries[index].name = name


class _Names:
    """
    A namespace as rcl keeps it: one text and a count of names, which can come apart.
    """

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


class RclParameters:
    """
    All sections that the files and overrides read so far have made, in the order of ROS.
    """

    def __init__(self) -> None:
        self.sections: list[_Section] = []

    def find_section(self, name: str) -> _Section:
        for section in self.sections:
            if section.name == name:
                return section
        self.sections.append(_Section(name))
        return self.sections[-1]

    def read_file(self, events: Iterable[Any], source: str) -> None:
        """
        Take the events of one parameter file; raise RefusedByRos where ROS would.
        """
        _FileWalk(self, source).walk(events)

    def read_override(self, section: str, name: str, events: Iterable[Any], source: str) -> None:
        """
        Take the events of the value of one `-p` rule; raise RefusedByRos where ROS would.
        """
        entry = self.section_entry(section, name)
        is_list, kind = False, None
        for event in events:
            if isinstance(event, yaml.ScalarEvent):
                kind = _store(entry, event, is_list, kind, Origin(source))
            elif isinstance(event, yaml.SequenceStartEvent):
                is_list, kind = True, None
            elif isinstance(event, yaml.SequenceEndEvent):
                is_list = False
            elif isinstance(event, (yaml.MappingStartEvent, yaml.AliasEvent)):
                raise RefusedByRos(0, 'maps and aliases cannot be the value of an override')

    def section_entry(self, section: str, name: str) -> _Entry:
        found = self.find_section(section)
        return found.entries[found.find(name)]

    def settings_of(self, node: str) -> dict[str, Setting | None]:
        """
        Name to setting, None where ROS has the name without a value, for a full node name.
        """
        settings: dict[str, Setting | None] = {}
        for section in self.sections:
            if section_matches(section.name, node):
                settings.update((entry.name, entry.setting()) for entry in section.entries)
        return settings


def section_matches(section: str, node: str) -> bool:
    """
    Whether a node with this full name takes the parameters of a section of a parameter file.
    """
    pattern = section if section.startswith('/') else '/' + section
    return re.fullmatch(pattern.replace('/*', r'(/\w+)'), node, re.ASCII) is not None


def _store(entry: _Entry, event: Any, is_list: bool, kind: type | None, origin: Origin) -> type:
    line = event.start_mark.line + 1
    quoted = event.style in ("'", '"')
    if not event.value and not quoted:
        raise RefusedByRos(line, 'there is a name without a value')
    scalar = resolve_scalar(event.value, quoted=quoted, tag=event.tag)
    if not is_list:
        entry.slots[False, type(scalar)] = Setting(scalar, origin)
        return type(scalar)
    if kind is None:
        values: list[Any] = [scalar]
        entry.slots[True, type(scalar)] = Setting(values, origin)
    elif kind is type(scalar) and (True, kind) in entry.slots:
        entry.slots[True, kind].value.append(scalar)  # type: ignore[union-attr, arg-type]
    else:
        raise RefusedByRos(line, 'the values of a list must all have one type')
    return type(scalar)


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
    """
    The counters with which rcl walks the events of one file (parse_file_events, parse_key).
    """

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
        self.section: _Section | None = None
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
        self.list_kind = _store(
            self.section.entries[self.entry_index], event, self.is_list, self.list_kind,
            Origin(self.source, line))
        if not self.is_list:
            self.is_key = True
