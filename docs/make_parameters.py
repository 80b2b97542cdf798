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
"""
Writes docs/parameters.md from the tables in the code; a test holds both together.

    .venv/bin/python docs/make_parameters.py
"""

from pathlib import Path

from icofabric_sim.parameters.table import (
    Change,
    FAMILIES,
    Specification,
    STATIC,
)
from icofabric_sim.simulation.stepping.methods import IMPLICIT, Method, METHODS

# What each entry of the column means, after its words.
_EFFECTS = {
    Change.FIXED: 'refused while the node runs',
    Change.AT_ONCE: 'the fabric is not touched; `record.*` acts on the next bag',
    Change.REBUILDS: 'another fabric is built beside the running one, which it replaces between '
    'two steps; it goes on from the same state at the same time. `initial.*` and '
    '`initial_random.*` are seen at the next reset',
    Change.RESTARTS: 'built and replaced like that, but it starts from its initial state; the '
    'time runs on',
}
_HEAD = """# Parameters

Made by `docs/make_parameters.py` from `icofabric_sim/parameters/table.py`. SI units, radians.
One tree for the node, for scene files and for Python. *Change* says what a change at run time
does; a change of several parameters at once does the most that any of them does.

{effects}
| parameter | default | unit | allowed | change | meaning |
|---|---|---|---|---|---|
"""


_METHODS = """
## Methods

What `solver.method` can be, from `icofabric_sim.METHODS`. `auto` picks one of these for each scene
([accuracy.md](accuracy.md)), and `icofabric info` says which and why. *Evaluations* of all forces
for each step; *stable*: the longest stable step times the largest frequency of the fabric. Where a
connector with two stiffnesses crosses its natural length, `srkn4` and `srkn6` are of order 4 and
not symplectic in that step, the other splittings of order 2.

| method | order | symplectic | evaluations | stable | source |
|---|---|---|---|---|---|
"""


def allowed(entry: Specification) -> str:
    if entry.choices:
        return ', '.join(f'`{choice}`' for choice in entry.choices)
    if entry.minimum is None:
        return ''
    text = f'> {entry.minimum:g}' if entry.open_minimum else f'>= {entry.minimum:g}'
    if entry.smallest is not None:
        text = f'0, or >= {entry.smallest:g}'
    return text if entry.maximum is None else f'{text}, <= {entry.maximum:g}'


def row(name: str, entry: Specification) -> str:
    default = '(needed)' if entry.required else f'`{entry.default!r}`'
    return (f'| `{name}` | {default} | {entry.unit} | {allowed(entry)} | '
            f'{entry.change.value} | {entry.description} |\n')


def method_row(name: str, method: Method) -> str:
    return (f'| `{name}` | {method.order} | {"yes" if method.symplectic else "no"} | '
            f'{method.stages} | {method.stability:g} | {method.source} |\n')


def text() -> str:
    effects = ''.join(
        f'- *{change.value}*: {_EFFECTS[change]}.\n' for change in Change)
    parts = [_HEAD.format(effects=effects)]
    parts += [row(entry.name, entry) for entry in STATIC]
    for family, fields in FAMILIES.items():
        parts += [row(f'{family}.NAME' + (f'.{field.name}' if field.name else ''), field)
                  for field in fields]
    parts.append('\nNAME: a letter, then letters, digits, single underscores.')
    parts.append('\n')
    parts.append(_METHODS)
    parts += [method_row(name, method) for name, method in {**METHODS, **IMPLICIT}.items()]
    return ''.join(parts)


if __name__ == '__main__':
    (Path(__file__).parent / 'parameters.md').write_text(text(), encoding='utf-8')
