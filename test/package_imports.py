# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""The modules of the package and what each imports of it, read from the sources."""

import ast
from pathlib import Path
from typing import NamedTuple

import icofabric_sim

PACKAGE = Path(icofabric_sim.__file__).parent


def _name(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix('').parts
    return '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)


MODULES = {_name(path): path for path in sorted(PACKAGE.rglob('*.py'))}


class Import(NamedTuple):
    """A module of the package, imported in a line."""

    module: str
    line: int
    late: bool  # within a function, or for types only: no part of loading the module


def imports_of(name: str) -> list[Import]:
    """Return what the module `name` imports of the package, wherever in its text."""
    tree = ast.parse(MODULES[name].read_text())
    found = []
    for node in ast.walk(tree):
        late = node not in tree.body
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
