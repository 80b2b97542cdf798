# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Reads the sections of parameter files twice: as they are meant and as ROS takes them.

`rcl_parameters` tells what a node gets. Here the same text is read as a tree, as a person reads
it, which gives each value its dotted name and its line. What ROS refuses is then refused with
that name, and where the two readings differ, so that ROS would use something else than what the
file says, that is refused too. YAML tags build nothing, aliases are never expanded.
"""

import math
from typing import Any

from icofabric_sim.parameters.rcl_file_walk import walk_file
from icofabric_sim.parameters.rcl_parameters import (
    Origin,
    origin,
    RclParameters,
    RefusedByRos,
    section_matches,
    Setting,
    Value,
)
from icofabric_sim.parameters.rcl_scalars import Scalar
from icofabric_sim.parameters.yaml_events import (
    FORM,
    make_trees,
    ParameterFileError,
    read_events,
    SECTION_KEY,
    Tree,
)

# Parameters that every ROS node has: no part of a scene.
_ROS_OWN = ('use_sim_time', 'start_type_description_service')
_ROS_OWN_PREFIX = 'qos_overrides.'


def is_own_parameter(name: str) -> bool:
    """Whether a parameter belongs to the node itself, not to ROS."""
    return name not in _ROS_OWN and not name.startswith(_ROS_OWN_PREFIX)


class ParameterSet:
    """Parameter files and overrides, taken in order, as one node sees them."""

    def __init__(self, node: str) -> None:
        self.node = node
        self._actual = RclParameters()
        self._meant: dict[str, dict[str, Setting]] = {}

    def add_file(self, data: bytes, source: str) -> None:
        """Take the text of one parameter file; `source` is its name in messages."""
        events = read_events(data, source)
        trees = make_trees(events)
        if not trees:
            raise ParameterFileError(f'{source}: the file is empty; {FORM}')
        for tree in trees:
            if tree.is_map:
                self._walk_names(tree, '', source)
            elif not tree.is_missing:
                raise ParameterFileError(
                    f'{source}:{tree.line}: expected the name of a node; {FORM}')
        try:
            walk_file(self._actual, events, source)
        except RefusedByRos as refused:
            raise ParameterFileError(
                f'{source}:{refused.line}: ROS cannot read this: {refused.reason}; '
                f'{FORM}') from None

    def add_override(self, section: str, name: str, text: str, source: str) -> None:
        """Take one value of the command line, for the nodes of `section`."""
        events = read_events(text.encode('utf-8', 'surrogateescape'), source, name=name)
        trees = make_trees(events)
        if len(trees) != 1:
            raise ParameterFileError(
                f'{source}: parameter {name!r} has no single value; write {name}:=value')
        try:
            self._take_value(trees[0], name, section, Origin(source))
            self._actual.read_override(section, name, events, source)
        except RefusedByRos as refused:
            raise ParameterFileError(
                f'{source}: parameter {name!r}: {refused.reason}') from None

    def parameters(self, *, with_ros_own: bool = False) -> dict[str, Value]:
        """Name to value of the node, as ROS hands them over, without those of ROS itself."""
        meant: dict[str, Setting] = {}
        for section, settings in self._meant.items():
            if section_matches(section, self.node):
                meant.update(settings)
        actual = self._actual.settings_of(self.node)
        _refuse_differences(meant, actual)
        for name in _ROS_OWN:
            if name in meant and not isinstance(meant[name].value, bool):
                raise ParameterFileError(
                    f'{meant[name].origin}: parameter {name!r} must be true or false, got '
                    f'{meant[name].value!r}; ROS needs it')
        return {name: setting.value for name, setting in meant.items()
                if with_ros_own or is_own_parameter(name)}

    def hidden_overrides(self) -> list[str]:
        """One sentence for each override without effect, because ROS prefers another section."""
        actual = self._actual.settings_of(self.node)
        return [
            f'{setting.origin} has no effect: ROS takes {name!r} from {winner.origin}, whose '
            f'section comes later; write -p {self.node.rpartition("/")[2]}:{name}:=...'
            for section, settings in self._meant.items() if section_matches(section, self.node)
            for name, setting in settings.items() if not setting.origin.line
            for winner in [actual[name]]
            if winner is not None and winner.origin != setting.origin]

    def _walk_names(self, tree: Tree, path: str, source: str) -> None:
        for key, value in tree.pairs():
            if not key.is_scalar:
                raise ParameterFileError(
                    f'{source}:{key.line}: a list or map cannot be a name; {FORM}')
            if key.text.startswith(SECTION_KEY):
                if not value.is_map:
                    raise ParameterFileError(
                        f'{source}:{key.line}: {SECTION_KEY} of {path!r} holds no parameters; '
                        f'write them below it, or delete it')
                self._meant.setdefault(path, {})
                self._walk_parameters(value, '', path, source)
            elif value.is_map:
                joined = path + key.text if path.endswith('/') else f'{path}/{key.text}'
                self._walk_names(value, joined if path else key.text, source)
            else:
                raise ParameterFileError(
                    f'{source}:{key.line}: {key.text!r} stands outside {SECTION_KEY}; {FORM}')

    def _walk_parameters(self, tree: Tree, prefix: str, section: str, source: str) -> None:
        for key, value in tree.pairs():
            name = prefix + (key.text if key.is_scalar else '?')
            where = f'{source}:{value.line}: parameter {name!r}'
            if section_matches(section, self.node):
                if not key.is_scalar:
                    raise ParameterFileError(
                        f'{source}:{key.line}: a list or map below {prefix or SECTION_KEY!r} '
                        'cannot be a name; write a word')
                if not key.text or '\0' in key.text:
                    raise ParameterFileError(
                        f'{source}:{key.line}: parameter {name!r} is no name; write a word')
                if value.is_map and not value.children:
                    raise ParameterFileError(
                        f'{where} is an empty map; write parameters into it or delete it')
            if value.is_map:
                self._walk_parameters(value, name + '.', section, source)
            else:
                first = value.children[0] if value.children else value
                self._take_value(value, name, section, origin(source, first.event))

    def _take_value(self, tree: Tree, name: str, section: str, place: Origin) -> None:
        where = f'{place}: parameter {name!r}'
        ours = section_matches(section, self.node)
        items = [tree] if tree.is_scalar else tree.children
        if ours:
            _refuse_what_ros_spoils(tree, items, where)
        if any(item.is_missing for item in items):
            raise ParameterFileError(f'{where} has no value; write one or delete the line')
        if not tree.is_map and all(item.is_scalar for item in items):
            values = [item.scalar() for item in items]
            if len({type(value) for value in values}) > 1:
                raise ParameterFileError(f'{where} {_mixed(values)}')
            self._meant.setdefault(section, {})[name] = Setting(
                values[0] if tree.is_scalar else values, place)  # type: ignore[arg-type]


def _refuse_what_ros_spoils(tree: Tree, items: list[Tree], where: str) -> None:
    if tree.is_map or not all(item.is_scalar for item in items):
        raise ParameterFileError(
            f'{where} is a list or map inside a value, which ROS flattens or refuses; write one '
            'list of numbers or of words')
    if not items:
        raise ParameterFileError(
            f'{where} is an empty list, which ROS turns into no value; delete the line')
    for item in items:
        if item.is_null:
            raise ParameterFileError(
                f'{where} is {item.text}, but ROS has no null; delete the line, or quote the '
                'word if a text is meant')
        if '\0' in item.text:
            raise ParameterFileError(
                f'{where} holds a NUL character, at which ROS cuts a text; remove it')


def _mixed(values: list[Scalar]) -> str:
    kinds = {type(value) for value in values}
    names = ' and '.join(sorted(kind.__name__ for kind in kinds))
    if kinds == {int, float}:
        whole = next(value for value in values if isinstance(value, int))
        remedy = f'write {whole} as {float(whole)!r}'
    elif bool in kinds:
        remedy = 'quote the words that ROS takes for true or false (y, n, on, off, yes, no)'
    else:
        remedy = 'quote what is meant as a text, or write all as numbers'
    return f'mixes {names} in one list, which ROS refuses; {remedy}'


def _same(one: Any, other: Any) -> bool:
    if type(one) is not type(other):
        return False
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(_same(a, b) for a, b in zip(one, other))
    if isinstance(one, float) and isinstance(other, float) and math.isnan(one):
        return math.isnan(other)
    return one == other


def _refuse_differences(meant: dict[str, Setting], actual: dict[str, Setting | None]) -> None:
    """Raise where ROS would hand over something else than what is written."""
    names_by_origin = {setting.origin: name for name, setting in actual.items() if setting}
    for name, wanted in meant.items():
        got = actual.get(name)
        if got is None:
            other = names_by_origin.get(wanted.origin)
            as_what = f'takes it for {other!r}' if other else 'loses it'
            raise ParameterFileError(
                f'{wanted.origin}: parameter {name!r}: ROS {as_what}, because a name with a dot '
                'or slash has a map below it, or a name has both a value and a map, nearby; write '
                'one nested map per word')
        if not _same(wanted.value, got.value):
            raise ParameterFileError(
                f'{wanted.origin}: parameter {name!r}: ROS would ignore {wanted.value!r} and keep '
                f'{got.value!r} from {got.origin}: {_why_ignored(wanted.value, got)}')
    for name, extra in actual.items():
        if name not in meant:
            where = extra.origin if extra else 'parameters'
            raise ParameterFileError(
                f'{where}: ROS makes up a parameter {name!r}, because a name with a dot or slash '
                'has a map below it nearby; write one nested map per word')


def _why_ignored(wanted: Value, got: Setting) -> str:
    kept, lost = _kind(got.value), _kind(wanted)
    if kept == lost:
        return 'it was given as a nested map more than once before; give it in one place'
    if kept == 'int' and lost == 'float':
        remedy = f'write {float(got.value)!r} in {got.origin}'  # type: ignore[arg-type]
    else:
        remedy = 'give it once, or with one type'
    return f'of {kept} and {lost} for one parameter it keeps the {kept}; {remedy}'


def _kind(value: Value) -> str:
    if isinstance(value, list):
        return f'list of {type(value[0]).__name__}'
    return type(value).__name__
