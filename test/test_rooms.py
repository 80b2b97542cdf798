# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The rooms of the package: imports point down only, and no modules import each other in a circle.
"""

import ast
import re

from icofabric_sim.kernels.records import Model
from icofabric_sim.terms.registry import LAWS, LOADS, TERMS
from package_imports import (
    arrows,
    circle,
    floor_of,
    height,
    imports_of,
    main,
    MODULES,
    PACKAGE,
    ROOF,
    room_of,
    ROOMS,
)

RIMS = {'commands', 'ros'}
# Modules of `terms` that folders of terms import.
SHARED_BY_TERMS = (
    'carriers', 'gyration', 'laws', 'loads', 'masses', 'meters', 'profiles', 'shared', 'shells',
    'turning')


def test_every_module_has_a_room():
    assert {room_of(name) for name in MODULES if name not in ROOF} == {*ROOMS}
    # Rooms, and the documented imports.
    assert len([path for path in PACKAGE.iterdir()
                if path.suffix == '.py' or any(path.glob('*.py'))]) <= 22


def test_imports_point_down():
    up = [f'{MODULES[name].relative_to(PACKAGE)}:{target.line} imports {target.module}'
          for name in MODULES if name not in ROOF
          for target in imports_of(name)
          if floor_of(target.module) > floor_of(name)
          # Rims are users: they may take what is documented for users.
          and not (target.module in ROOF and room_of(name) in RIMS)]
    assert not up, up


def test_no_circles():
    """Imports within functions count, too."""
    assert sum(len(imports_of(name)) for name in MODULES) > 1000
    assert not circle()


def test_no_attribute_is_reached_five_dots_deep():
    """An object in between offers a method instead; items and calls end or continue a chain."""
    deep = []
    for path in MODULES.values():
        for node in ast.walk(ast.parse(path.read_text())):
            depth, part = 0, node
            while isinstance(part, (ast.Attribute, ast.Subscript)):
                depth += isinstance(part, ast.Attribute)
                part = part.value
            if depth >= 5:
                deep.append(f'{path.relative_to(PACKAGE)}:{node.lineno}')
    assert not deep, deep


def test_the_drawing_shows_every_arrow(capsys):
    main([])
    *rows, last = capsys.readouterr().out.splitlines()
    found = {tuple(row.split()[:3:2]) for row in rows}
    assert found == set(arrows()) and ('ros', 'running') in found
    assert all(height(one) > height(other) for one, other in found)
    assert last == (f'{len(MODULES)} modules, {len(rows)} arrows between rooms, 0 of them up; '
                    'a circle: none')
    main(['dot'])
    drawn = capsys.readouterr().out
    assert {*re.findall(r'(\w+) -> (\w+) ', drawn)} == found


def test_the_product_never_imports_its_validation():
    """Verbs of icofabric_validation are found as entry points of an installed package."""
    imported = set()
    for path in MODULES.values():
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                imported |= {alias.name.partition('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                imported.add((node.module or '').partition('.')[0])
    assert 'icofabric_sim' in imported and 'icofabric_validation' not in imported


def test_rims_are_started_only_when_asked_for():
    """Nodes take words from commands within functions."""
    for name in MODULES:
        if name not in ROOF and room_of(name) in RIMS:
            others = {room_of(target.module) for target in imports_of(name)
                      if not target.late and target.module not in ROOF} & RIMS
            assert others <= {room_of(name)}, name


def test_a_scene_describes_and_does_not_pack():
    """Records for kernels are packed in simulation/model; a scene asks only what lies inside."""
    taken = {target.module for name in MODULES if name not in ROOF and room_of(name) == 'scene'
             for target in imports_of(name) if room_of(target.module) == 'kernels'}
    assert taken == {'icofabric_sim.kernels.inside'}


def test_a_term_imports_its_own_folder_and_what_all_terms_share():
    """
    Its kernels call no other term; `terms` lies below `parameters`.

    A term that changes another one reads the record of that term.
    """
    folders = {name.split('.')[2] for name in MODULES
               if room_of(name) == 'terms' and MODULES[name].parent.parent.name == 'terms'}
    assert len(folders) >= 5 and folders <= {part.name for part in (*TERMS, *LAWS, *LOADS)}
    shared = {f'icofabric_sim.terms.{name}' for name in SHARED_BY_TERMS}
    read = {name: set() for name in folders} | {
        term.name: {f'icofabric_sim.terms.{other}.record' for other in term.changes}
        for term in TERMS}
    for name in MODULES:
        if room_of(name) != 'terms':
            continue
        own, path = '.'.join(name.split('.')[:3]), MODULES[name]
        for target in imports_of(name):
            if room_of(target.module) == 'terms':
                if path.parent.name in folders:
                    assert target.module.startswith(f'{own}.') or (
                        target.module in shared) or target.module in read[path.parent.name], (
                        name, target)
                else:
                    assert target.module in shared | {'icofabric_sim.terms.interface'} or (
                        name in ('icofabric_sim.terms.laws', 'icofabric_sim.terms.loads')), (
                        name, target)
            else:
                assert room_of(target.module) in ('geometry', 'runtime'), (name, target)


def test_terms_with_a_record_are_fields_of_the_model():
    found = {term.name for term in TERMS if term.has('record')}
    assert found <= {*Model._fields}
    assert all(Model._defaults[name] is None for name in found)
