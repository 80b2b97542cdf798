# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Read the sections of parameter files and overrides to the parameters that a node gets.

rcl builds no tree: it walks the YAML events with a few counters, and joins and cuts names as
text. Some forms make it lose its position or deliver values other than those written. This reader
builds a tree and refuses these forms with the name of the parameter:

- lists and maps in lists, and empty maps;
- a map below a dotted name, or below a name that also has a value;
- further names after `ros__parameters`;
- a value that an earlier value hides.

YAML tags construct no objects, and aliases are never expanded. A test compares random files with
a real node.
"""

from dataclasses import dataclass, field

from icofabric_sim.parameters.rcl_parameters import (
    Entries,
    Origin,
    origin,
    section_matches,
    section_name_error,
    Setting,
    unused_notice,
    Value,
)
from icofabric_sim.parameters.rcl_scalars import Scalar
from icofabric_sim.parameters.yaml_events import (
    FILE_FORM_HINT,
    make_trees,
    ParameterFileError,
    read_events,
    SECTION_KEY,
    Tree,
)

# Parameters that every ROS node has; not part of a scene.
_ROS_OWN = ('use_sim_time', 'start_type_description_service')
_ROS_OWN_PREFIX = 'qos_overrides.'


def is_own_parameter(name: str) -> bool:
    """Return True if a parameter belongs to the scene or the node, not to ROS."""
    return name not in _ROS_OWN and not name.startswith(_ROS_OWN_PREFIX)


@dataclass
class _Section:
    """Parameters written for one node, or for all nodes that match a pattern."""

    entries: dict[str, Entries] = field(default_factory=dict)
    maps: set[str] = field(default_factory=set)  # names with a map below


class ParameterSet:
    """Parameter files and overrides, applied in order, as one node gets them."""

    def __init__(self, node: str) -> None:
        self.node = node
        self._sections: dict[str, _Section] = {}
        # Origins of the names in the current document, by section and name.
        self._written: dict[tuple[str, str], Origin] = {}
        self._unused_files: list[str] = []

    def add_file(self, data: bytes, source: str) -> None:
        """Add the text of one parameter file; `source` is its name in messages."""
        trees = make_trees(read_events(data, source))
        sections: dict[str, None] = {}
        if not trees:
            raise ParameterFileError(f'{source}: the file is empty; {FILE_FORM_HINT}')
        for tree in trees:
            if not tree.is_map:
                raise ParameterFileError(
                    f'{source}:{tree.line}: expected the name of a node; {FILE_FORM_HINT}')
            self._written.clear()
            self._walk_names(tree, '', source, sections)
        if not any(section_matches(name, self.node) for name in sections):
            self._unused_files.append(unused_notice(source, sections, self.node))

    def add_override(self, section: str, name: str, text: str, source: str) -> None:
        """Add one value from the command line, for the nodes of `section`."""
        trees = make_trees(read_events(text.encode('utf-8', 'surrogateescape'), source, name=name))
        if len(trees) != 1:
            raise ParameterFileError(
                f'{source}: parameter {name!r} has no single value; write {name}:=value')
        self._add_value(trees[0], name, section, Origin(source), in_map=False)

    def parameters(self, *, with_ros_own: bool = False) -> dict[str, Value]:
        """Return the names and values that ROS gives the node, without ROS's own by default."""
        kept = self._kept()
        for name in _ROS_OWN:
            if name in kept and not isinstance(kept[name].value, bool):
                raise ParameterFileError(
                    f'{kept[name].origin}: parameter {name!r} must be true or false, got '
                    f'{kept[name].value!r}; ROS needs it')
        return {name: setting.value for name, setting in kept.items()
                if with_ros_own or is_own_parameter(name)}

    def notices(self) -> list[str]:
        """
        Return one sentence for each file and each override without effect.

        A file has no effect if its sections are for other nodes, an override if ROS prefers a
        section.
        """
        kept = self._kept()
        return self._unused_files + [
            f'{setting.origin} has no effect: ROS takes {name!r} from {kept[name].origin}, whose '
            f'section comes later; write -p {self.node.rpartition("/")[2]}:{name}:=...'
            for section in self._own_sections() for name, entries in section.entries.items()
            for setting in [entries.effective()]
            if not setting.origin.line and setting.origin != kept[name].origin]

    def _own_sections(self) -> list[_Section]:
        return [section for name, section in self._sections.items()
                if section_matches(name, self.node)]

    def _kept(self) -> dict[str, Setting]:
        """Return the effective settings: later sections win, ordered by first mention."""
        return {name: entries.effective() for section in self._own_sections()
                for name, entries in section.entries.items()}

    def _walk_names(
        self, tree: Tree, path: str, source: str, sections: dict[str, None]
    ) -> None:
        pairs = tree.pairs()
        lines: dict[str, int] = {}
        for index, (key, value) in enumerate(pairs):
            where = f'{source}:{key.line}'
            if not key.is_scalar or not key.text or '\0' in key.text:
                raise ParameterFileError(
                    f'{where}: a list, a map or an empty text cannot be a name; {FILE_FORM_HINT}')
            if key.text in lines:
                raise ParameterFileError(
                    f'{where}: {key.text!r} {_duplicate_error(lines[key.text])}')
            lines[key.text] = key.line
            if key.text.startswith(SECTION_KEY):
                if not path:
                    raise ParameterFileError(
                        f'{where}: there is no node name before {SECTION_KEY}; {FILE_FORM_HINT}')
                wrong = section_name_error(path)
                if wrong:
                    raise ParameterFileError(
                        f'{where}: {path!r} is not the name of a node: {wrong}; {FILE_FORM_HINT}')
                if not value.is_map:
                    raise ParameterFileError(
                        f'{where}: {SECTION_KEY} of {path!r} holds no parameters; '
                        f'write them below it, or delete it')
                if index + 1 < len(pairs):
                    raise ParameterFileError(
                        f'{source}:{pairs[index + 1][0].line}: ROS loses the name of the node '
                        f'after {SECTION_KEY} of {path!r}; begin a new section with the whole '
                        'name')
                self._sections.setdefault(path, _Section())
                sections[path] = None
                self._walk_parameters(value, '', path, source)
            elif not value.is_map:
                raise ParameterFileError(
                    f'{where}: {key.text!r} stands outside {SECTION_KEY}; {FILE_FORM_HINT}')
            elif path and ('/' in key.text or path.endswith('/')):
                raise ParameterFileError(
                    f'{where}: {key.text!r} below {path!r}: ROS loses the name of the node if '
                    'a part of it has a slash; write the whole name as one key')
            else:
                self._walk_names(
                    value, f'{path}/{key.text}' if path else key.text, source, sections)

    def _walk_parameters(self, tree: Tree, prefix: str, section: str, source: str) -> None:
        ours = section_matches(section, self.node)
        lines: dict[str, int] = {}
        for key, value in tree.pairs():
            if not key.is_scalar:
                raise ParameterFileError(
                    f'{source}:{key.line}: a list or map below {prefix or SECTION_KEY!r} '
                    'cannot be a name; write a word')
            name = prefix + key.text
            if not key.text or '\0' in key.text:
                raise ParameterFileError(
                    f'{source}:{key.line}: parameter {name!r} is not a name; write a word')
            if ours and key.text in lines:
                raise ParameterFileError(
                    f'{source}:{key.line}: parameter {name!r} {_duplicate_error(lines[key.text])}')
            lines[key.text] = key.line
            if not value.is_map:
                first = value.children[0] if value.children else value
                self._add_value(
                    value, name, section, origin(source, first.event), in_map=bool(prefix))
                continue
            where = f'{source}:{value.line}: parameter {name!r}'
            if not value.children:
                raise ParameterFileError(
                    f'{where} is an empty map; write parameters into it or delete it')
            if ours and '.' in key.text:
                raise ParameterFileError(
                    f'{where}: ROS confuses names near a dotted name with a map below it; write '
                    'one nested map per word')
            if ours and name in self._sections[section].entries:
                raise ParameterFileError(f'{where} {_VALUE_AND_MAP_ERROR}')
            self._sections[section].maps.add(name)
            self._walk_parameters(value, name + '.', section, source)

    def _add_value(
        self, tree: Tree, name: str, section: str, place: Origin, *, in_map: bool
    ) -> None:
        where = f'{place}: parameter {name!r}'
        ours = section_matches(section, self.node)
        items = [tree] if tree.is_scalar else tree.children
        if tree.is_map or not all(item.is_scalar for item in items):
            raise ParameterFileError(
                f'{where} is a list or map inside a value, which ROS flattens or refuses; write '
                'one list of numbers or of words')
        if any(item.is_missing for item in items):
            raise ParameterFileError(f'{where} has no value; write one or delete the line')
        values = [item.scalar() for item in items]
        if len({type(value) for value in values}) > 1:
            raise ParameterFileError(f'{where} {_mixed_types_error(values)}')
        if not ours:
            return
        _refuse_lossy_items(items, where)
        if place.line:
            before = self._written.setdefault((section, name), place)
            if before is not place:
                raise ParameterFileError(f'{where} {_duplicate_error(before.line)}')
        known = self._sections.setdefault(section, _Section())
        if name in known.maps:
            raise ParameterFileError(f'{where} {_VALUE_AND_MAP_ERROR}')
        setting = Setting(
            values[0] if tree.is_scalar else values, place)  # type: ignore[arg-type]
        entries = known.entries.setdefault(name, Entries())
        entries.add(setting, in_map=in_map)
        kept = entries.effective()
        if kept is not setting:
            raise ParameterFileError(
                f'{where}: ROS would ignore {setting.value!r} and keep {kept.value!r} from '
                f'{kept.origin}: {_hidden_value_reason(setting.value, kept)}')


def _duplicate_error(line: int) -> str:
    return f'is written twice, first in line {line}, and one of the two would be lost; keep one'


_VALUE_AND_MAP_ERROR = (
    'has both a value and a map, of which ROS loses one; give it in one place, or write one '
    'nested map per word')


def _refuse_lossy_items(items: list[Tree], where: str) -> None:
    if not items:
        raise ParameterFileError(
            f'{where} is an empty list, which ROS turns into no value; delete the line')
    for item in items:
        if item.is_null:
            raise ParameterFileError(
                f'{where} is {item.text}, but ROS has no null; delete the line, or quote the '
                'word to give it as a string')
        if '\0' in item.text:
            raise ParameterFileError(
                f'{where} has a NUL character, which ends a string in ROS; remove it')


def _mixed_types_error(values: list[Scalar]) -> str:
    kinds = {type(value) for value in values}
    names = ' and '.join(sorted(kind.__name__ for kind in kinds))
    if kinds == {int, float}:
        whole = next(value for value in values if isinstance(value, int))
        remedy = f'write {whole} as {float(whole)!r}'
    elif bool in kinds:
        remedy = 'quote the words that ROS reads as true or false (y, n, on, off, yes, no)'
    else:
        remedy = 'quote the numbers to make them strings, or write numbers only'
    return f'mixes {names} in one list, which ROS refuses; {remedy}'


def _hidden_value_reason(wanted: Value, got: Setting) -> str:
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
