# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Parse YAML text to YAML events, with error messages for users.

The events come from libyaml, which ROS also uses, through PyYAML, which rclpy requires. ROS
installations have libyaml 0.1.7 to 0.2.5. The few forms that only newer versions read are refused,
so that a file means the same in every installation.
"""

from dataclasses import dataclass
import re
from typing import Any

from icofabric_sim.parameters.rcl_scalars import NULL_WORDS, resolve_scalar, Scalar, STRING_TAG
import yaml

# PyYAML built without libyaml falls back to its own parser, which refuses more tabs.
_LOADER: Any = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)

SECTION_KEY = 'ros__parameters'
_MAX_DEPTH = 32
FILE_FORM_HINT = ('a parameter file has the form "/**:", below it "ros__parameters:", below that '
        '"name: value"')


@dataclass
class Tree:
    """YAML node; `children` are the items of a list, or alternating keys and values of a map."""

    event: Any
    line: int
    children: list['Tree']

    @property
    def is_scalar(self) -> bool:
        return isinstance(self.event, yaml.ScalarEvent)

    @property
    def is_map(self) -> bool:
        return isinstance(self.event, yaml.MappingStartEvent)

    @property
    def text(self) -> str:
        return str(self.event.value)

    @property
    def is_quoted(self) -> bool:
        return self.event.style in ("'", '"')

    @property
    def is_missing(self) -> bool:
        return self.is_scalar and not self.text and not self.is_quoted

    @property
    def is_null(self) -> bool:
        return (self.is_scalar and self.event.style in ('', None)
                and self.text in NULL_WORDS and self.event.tag != STRING_TAG)

    def scalar(self) -> Scalar:
        return resolve_scalar(self.text, quoted=self.is_quoted, tag=self.event.tag)

    def pairs(self) -> list[tuple['Tree', 'Tree']]:
        return list(zip(self.children[::2], self.children[1::2], strict=True))


class ParameterFileError(ValueError):
    """Invalid parameter file, override or dictionary; states the place, the name and a remedy."""


def read_events(data: bytes, source: str, *, name: str | None = None) -> list[Any]:
    """
    Return all events of a YAML text.

    Errors state the `source` and the line. If the text is the value of one parameter, they state
    the `name` of the parameter instead of the line.
    """
    try:
        text = data.decode('utf-8-sig')
    except UnicodeDecodeError as error:
        where = _where(source, data.count(b'\n', 0, error.start) + 1, name)
        raise ParameterFileError(
            f'{where}not UTF-8 text (byte 0x{data[error.start]:02x}); give a YAML file saved as '
            'UTF-8') from None
    events = []
    place = _Place()
    try:
        for event in yaml.parse(data, Loader=_LOADER):
            events.append(event)
            place.enter(event)
            where = _where(source, event.start_mark.line + 1, name) + str(place)
            if len(place.levels) > _MAX_DEPTH:
                raise ParameterFileError(
                    f'{where}nested more than {_MAX_DEPTH} levels deep; write fewer levels')
            if isinstance(event, yaml.AliasEvent):
                raise ParameterFileError(
                    f'{where}ROS refuses aliases (*{event.anchor}); write the value again')
            _refuse_new_forms(event, text, place.levels[-1].in_brackets, where)
    except ParameterFileError:
        raise
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        raise ParameterFileError(_explain(error, data, source, name or place)) from None
    return events


@dataclass
class _Level:
    is_map: bool
    in_brackets: bool
    at_key: bool
    key: str | None = None


class _Place:
    """Current parameter in a stream of events; its text is empty or ends in a colon."""

    def __init__(self) -> None:
        self.levels = [_Level(False, False, False)]

    def enter(self, event: Any) -> None:
        if isinstance(event, yaml.CollectionEndEvent):
            self.levels.pop()
        elif isinstance(event, yaml.NodeEvent):
            level = self.levels[-1]
            if level.at_key:
                level.key = event.value if isinstance(event, yaml.ScalarEvent) else '?'
            level.at_key = level.is_map and not level.at_key
            if isinstance(event, yaml.CollectionStartEvent):
                is_map = isinstance(event, yaml.MappingStartEvent)
                self.levels.append(_Level(is_map, bool(event.flow_style), is_map))

    def __str__(self) -> str:
        keys = [level.key for level in self.levels if level.key is not None]
        if SECTION_KEY not in keys:
            return ''
        keys = keys[keys.index(SECTION_KEY) + 1:]
        return f'parameter {".".join(keys)!r}: ' if keys else ''


def make_trees(events: list[Any]) -> list[Tree]:
    """Return one tree for each document."""
    root: list[Tree] = []
    open_trees: list[list[Tree]] = [root]
    for event in events:
        if isinstance(event, yaml.NodeEvent):
            tree = Tree(event, event.start_mark.line + 1, [])
            open_trees[-1].append(tree)
            if isinstance(event, yaml.CollectionStartEvent):
                open_trees.append(tree.children)
        elif isinstance(event, yaml.CollectionEndEvent):
            open_trees.pop()
    return root


def _refuse_new_forms(event: Any, text: str, in_brackets: bool, where: str) -> None:
    if isinstance(event, yaml.DocumentStartEvent) and event.version not in (None, (1, 1)):
        raise ParameterFileError(
            f'{where}not every ROS reads YAML {event.version[0]}.{event.version[1]}; delete '
            'the line that begins with %YAML')
    if not isinstance(event, yaml.ScalarEvent):
        return
    if event.style == '"':
        written = text[event.start_mark.index:event.end_mark.index]
        if '\\' in written and '/' in re.findall(r'\\(.)', written, re.DOTALL):
            raise ParameterFileError(
                f'{where}not every ROS reads "\\/" in a quoted text; write "/" alone')
        if any('\ud800' <= character <= '\udfff' for character in event.value):
            raise ParameterFileError(
                f'{where}a character is half of a surrogate pair; write it as \\U and 8 digits')
    elif in_brackets and event.style in ('', None) and re.search('[:?]', event.value):
        raise ParameterFileError(
            f'{where}not every ROS reads {event.value!r} inside brackets; quote it, or put a '
            'space after the colon if a map is meant')


def _where(source: str, line: int, name: str | None) -> str:
    return f'{source}:{line}: ' if name is None else f'{source}: parameter {name!r}: '


def _explain(error: Exception, data: bytes, source: str, place: 'str | _Place') -> str:
    name = place if isinstance(place, str) else None
    if isinstance(error, yaml.reader.ReaderError):
        where = _where(source, data.count(b'\n', 0, error.position) + 1, name)
        return f'{where}not a text file ({error.reason}); give a YAML file saved as UTF-8'
    mark = getattr(error, 'problem_mark', None) or getattr(error, 'context_mark', None)
    where = _where(source, mark.line + 1 if mark else 1, name)
    what = getattr(error, 'problem', None) or str(error)
    context = getattr(error, 'context', None)
    tip = 'indent with spaces' if 'token' in what or 'tab' in what else (
        'check the indentation, quotes and brackets here and on the line above')
    if name is None:
        where += str(place)
    return f'{where}not valid YAML: {what}{f" {context}" if context else ""}; {tip}'
