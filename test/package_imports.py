# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The modules of the package and what each imports of it, read from the sources.

As a script it draws the imports between rooms: counts to read, or a graph for Graphviz.
"""

import ast
from collections import Counter
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
import sys
from typing import NamedTuple

import icofabric_sim

PACKAGE = Path(icofabric_sim.__file__).parent


def _name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix('').parts
    return '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)


# Ground floor first. A module imports from its own room and from those before it.
ROOMS = (
    'version', 'checks', 'libraries', 'process', 'geometry', 'runtime', 'terms', 'parameters',
    'kernels', 'scene', 'simulation', 'statics', 'messages', 'bag', 'running', 'sweeps',
    'pictures', 'terminal', 'viewer', 'commands', 'ros')
# Modules of `kernels` below `terms`.
RUNTIME = (
    'icofabric_sim.kernels.runtime', 'icofabric_sim.kernels.rotations',
    'icofabric_sim.kernels.probable_error')
# Documented names for users, above everything.
ROOF = ('icofabric_sim', 'icofabric_sim.contact')

MODULES = {_name(path): path for path in sorted(PACKAGE.rglob('*.py'))}


class Import(NamedTuple):
    """A module of the package, imported in a line."""

    module: str
    line: int
    late: bool  # within a function, or for types only: no part of loading the module


@cache
def imports_of(name: str) -> list[Import]:
    """Return what the module `name` imports of the package, wherever in its text."""
    tree = ast.parse(MODULES[name].read_text())
    top = set(tree.body)
    found = []
    for node in ast.walk(tree):
        late = node not in top
        if isinstance(node, ast.Import):
            found += [Import(alias.name, node.lineno, late) for alias in node.names
                      if alias.name.partition('.')[0] == PACKAGE.name]
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f'{name} line {node.lineno}: a relative import'
            base = node.module or ''
            if base.partition('.')[0] == PACKAGE.name:
                for alias in node.names:
                    full = f'{base}.{alias.name}'
                    found.append(Import(full if full in MODULES else base, node.lineno, late))
    return found


def room_of(name: str) -> str:
    """The room of a module; of one at the top of the package its own name."""
    if '.'.join(name.split('.')[:3]) in RUNTIME:
        return 'runtime'
    return name.split('.')[1] if '.' in name else name


def height(room: str) -> int:
    """On which floor a room is; what is none stands above all of them."""
    return ROOMS.index(room) if room in ROOMS else len(ROOMS)


def floor_of(name: str) -> int:
    """On which floor a module is."""
    return len(ROOMS) if name in ROOF else height(room_of(name))


def arrows() -> Counter[tuple[str, str]]:
    """How many modules of a room import from another room, those within functions included."""
    return Counter(
        pair for name in MODULES if name not in ROOF
        for pair in {(room_of(name), room_of(target.module)) for target in imports_of(name)
                     if target.module not in ROOF}
        if pair[0] != pair[1])


def circle() -> list[str]:
    """Modules that import each other in a circle; none where there is no circle."""
    graph = {name: {target.module for target in imports_of(name)} for name in MODULES}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def main(arguments: list[str]) -> None:
    """Print the arrows between rooms; with `dot`, as a graph for Graphviz."""
    found = sorted(arrows().items(), key=lambda item: (height(item[0][0]), item))
    if arguments == ['dot']:
        lines = [f'  {one} -> {other} [label={count}];' for (one, other), count in found]
        print('\n'.join(['digraph rooms {', '  rankdir=TB;', *lines, '}']))
        return
    if arguments:
        raise SystemExit(f'package_imports.py takes nothing or the word dot, got {arguments}')
    up = sum(height(other) > height(one) for (one, other), _ in found)
    for (one, other), count in found:
        print(f'{one:15} -> {other:15} {count:4} modules')
    print(f'{len(MODULES)} modules, {len(found)} arrows between rooms, {up} of them up; a circle: '
          f'{" -> ".join(circle()) or "none"}')


if __name__ == '__main__':
    main(sys.argv[1:])
