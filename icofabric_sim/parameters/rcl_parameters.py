# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Which parameters a ROS 2 node really gets from parameter files and overrides.

rcl keeps one slot per type for each parameter, so that an integer given earlier hides a float
given later. This module keeps the same books, so that such effects can be found and refused;
`rcl_file_walk` fills them from a file. Facts: rcl 9.2 (ROS 2 Jazzy), rcl_yaml_param_parser/src/
parse.c; which sections a node takes: rclpy/src/rclpy/node.cpp.
"""

from bisect import insort
from collections.abc import Iterable
from dataclasses import dataclass, field
import re
from typing import Any, NamedTuple

from icofabric_sim.parameters.rcl_scalars import resolve_scalar, Scalar
import yaml

Value = Scalar | list[bool] | list[int] | list[float] | list[str]

# The order in which rclpy looks at the slots of a parameter.
_SCALARS = (bool, int, float, str)


class Origin(NamedTuple):
    """Where a value was written: a file and its line, or an argument of the command line."""

    source: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        return f'{self.source}:{self.line}' if self.line else self.source


def origin(source: str, event: Any) -> Origin:
    """Where a YAML event of a file was written."""
    return Origin(source, event.start_mark.line + 1, event.start_mark.column + 1)


class Setting(NamedTuple):
    """A value and where it was written."""

    value: Value
    origin: Origin


class RefusedByRos(Exception):
    """ROS would refuse this input: the line and why."""

    def __init__(self, line: int, reason: str) -> None:
        super().__init__(line, reason)
        self.line = line
        self.reason = reason


@dataclass
class Entry:
    """
    A parameter: its name and one slot for each type, alone or as a list, that it was given in.
    """

    name: str
    slots: dict[tuple[bool, type], Setting] = field(default_factory=dict)

    def setting(self) -> Setting | None:
        """What rclpy takes, which need not be what was given last."""
        for key in [(is_list, kind) for is_list in (False, True) for kind in _SCALARS]:
            if key in self.slots:
                return self.slots[key]
        return None


@dataclass
class Section:
    """The parameters below one `ros__parameters`; names may repeat."""

    name: str
    entries: list[Entry] = field(default_factory=list)
    _found: dict[str, list[int]] = field(default_factory=dict)

    def find(self, name: str) -> int:
        """Index of the first entry with this name, which is made if there is none."""
        indices = self._found.setdefault(name, [])
        if not indices:
            indices.append(len(self.entries))
            self.entries.append(Entry(name))
        return indices[0]

    def rename(self, index: int, name: str) -> None:
        self._found[self.entries[index].name].remove(index)
        insort(self._found.setdefault(name, []), index)
        self.entries[index].name = name


class RclParameters:
    """All sections that the files and overrides read so far have made, in the order of ROS."""

    def __init__(self) -> None:
        self.sections: list[Section] = []

    def find_section(self, name: str) -> Section:
        for section in self.sections:
            if section.name == name:
                return section
        self.sections.append(Section(name))
        return self.sections[-1]

    def read_override(self, section: str, name: str, events: Iterable[Any], source: str) -> None:
        """Take the events of the value of one `-p` rule; raise RefusedByRos where ROS would."""
        entry = self.section_entry(section, name)
        is_list, kind = False, None
        for event in events:
            if isinstance(event, yaml.ScalarEvent):
                kind = store_value(entry, event, is_list, kind, Origin(source))
            elif isinstance(event, yaml.SequenceStartEvent):
                is_list, kind = True, None
            elif isinstance(event, yaml.SequenceEndEvent):
                is_list = False
            elif isinstance(event, (yaml.MappingStartEvent, yaml.AliasEvent)):
                raise RefusedByRos(0, 'maps and aliases cannot be the value of an override')

    def section_entry(self, section: str, name: str) -> Entry:
        found = self.find_section(section)
        return found.entries[found.find(name)]

    def settings_of(self, node: str) -> dict[str, Setting | None]:
        """Name to setting, None where ROS has the name without a value, for a full node name."""
        settings: dict[str, Setting | None] = {}
        for section in self.sections:
            if section_matches(section.name, node):
                settings.update((entry.name, entry.setting()) for entry in section.entries)
        return settings


def full_node_name(node_name: str, namespace: str) -> str:
    """Name of a node with its namespace, as rclpy joins them."""
    namespace = namespace.strip('/')
    return f'/{namespace}/{node_name}' if namespace else f'/{node_name}'


def section_matches(section: str, node: str) -> bool:
    """Whether a node with this full name takes the parameters of a section of a parameter file."""
    words = section.removeprefix('/').split('/')
    if not all(re.fullmatch(r'\w+|\*\*?', word, re.ASCII) for word in words):
        return False
    # `*` is one word, `**` any number of them.
    pattern = ''.join('/' + word for word in words).replace('/*', r'(/\w+)')
    return re.fullmatch(pattern, node, re.ASCII) is not None


def store_value(
        entry: Entry, event: Any, is_list: bool, kind: type | None, place: Origin) -> type:
    """Put one YAML scalar into its slot; return its type. `kind` is the type of a list so far."""
    line = event.start_mark.line + 1
    quoted = event.style in ("'", '"')
    if not event.value and not quoted:
        raise RefusedByRos(line, 'there is a name without a value')
    scalar = resolve_scalar(event.value, quoted=quoted, tag=event.tag)
    if not is_list:
        entry.slots[False, type(scalar)] = Setting(scalar, place)
        return type(scalar)
    if kind is None:
        values: list[Any] = [scalar]
        entry.slots[True, type(scalar)] = Setting(values, place)
    elif kind is type(scalar) and (True, kind) in entry.slots:
        entry.slots[True, kind].value.append(scalar)  # type: ignore[union-attr, arg-type]
    else:
        raise RefusedByRos(line, 'the values of a list must all have one type')
    return type(scalar)
