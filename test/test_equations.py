# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""docs/equations.md is complete, and what it names exists."""

import ast
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
import re
from typing import NamedTuple

from icofabric_sim.geometry.rotations import cosines_from_quaternions
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parent.parent
TEXT = (ROOT / 'docs' / 'equations.md').read_text(encoding='utf-8')
ERRATA = (ROOT / 'docs' / 'errata.md').read_text(encoding='utf-8')
ROOMS = {path.parent.name for path in (ROOT / 'icofabric_sim').glob('*/__init__.py')}
EQUATIONS, TABLES, FIGURES, CORRECTIONS = 65, 10, 7, 18


class Row(NamedTuple):
    kind: str  # head of the first column
    cells: list[str]


def rows(text):
    """Yield the rows of all tables of a page."""
    kind = ''
    for line in text.splitlines():
        if not line.startswith('|'):
            kind = ''
            continue
        cells = [cell.strip() for cell in line.strip('|').split('|')]
        if not kind:
            kind, width = cells[0], len(cells)
        elif set(line) - set('|-'):
            assert len(cells) == width, line
            yield Row(kind, cells)


ROWS = list(rows(TEXT))
CORRECTED = [row for row in rows(ERRATA) if row.kind == 'no'][:CORRECTIONS]
CITING = [row for row in ROWS if row.kind in ('eq', 'table', 'formula')]
NAMES = sorted(
    name for name in set(re.findall(r'`((?:\w+\.)+\w+)`', TEXT)) if name.split('.')[0] in ROOMS)
SHOWN = sorted(set(re.findall(r'`([\w/]+\.py)::(\w+)`', TEXT)))


def numbers(kind):
    return [row.cells[0] for row in ROWS + CORRECTED if row.kind == kind]


@pytest.mark.parametrize('kind, last, letter', [
    ('eq', EQUATIONS, ''), ('table', TABLES, ''), ('figure', FIGURES, ''),
    ('no', CORRECTIONS, 'C')])
def test_no_number_is_missing(kind, last, letter):
    assert numbers(kind) == [f'{letter}{number}' for number in range(1, last + 1)]


@pytest.mark.parametrize('row', CITING, ids=lambda row: f'{row.kind} {row.cells[0]}')
def test_every_row_says_where_and_by_what(row):
    _, *says, place, shown, _ = row.cells
    assert all(says)
    assert re.search(r'`\w+\.[\w.]+`|^the same|^as eq \d+$', place), place
    assert re.search(r'\.py::\w+`', shown), shown


@pytest.mark.parametrize('name', NAMES)
def test_what_is_named_of_the_code_exists(name):
    words = f'icofabric_sim.{name}'.split('.')
    assert not any(word.startswith('_') for word in words)
    end = len(words)
    while end > 2 and not is_module('.'.join(words[:end])):
        end -= 1
    found = import_module('.'.join(words[:end]))
    for word in words[end:]:
        assert hasattr(found, word), f'{name}: there is no {word} in {found.__name__}'
        found = getattr(found, word)


def is_module(name):
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:
        return False


@cache
def functions_of(path):
    tree = ast.parse((ROOT / 'test' / path).read_text(encoding='utf-8'))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize('path, name', SHOWN, ids='::'.join)
def test_tests_that_are_named_exist(path, name):
    assert name.startswith('test_') and name in functions_of(path)


def test_many_names_are_checked():
    """The patterns above find what the page has."""
    assert len(NAMES) > 60 and len(SHOWN) > 50
    assert TEXT.count('.py::') == len(re.findall(r'`[\w/]+\.py::\w+`', TEXT))


def test_every_correction_is_applied_somewhere():
    listed = set(numbers('no'))
    cited = {word for row in ROWS for cell in row.cells
             for word in re.findall(r'\bC\d+\b', cell)}
    assert cited == listed
    # Where the correction says that it is, the row of that equation cites it.
    by_number = {row.cells[0]: row.cells[-1] for row in ROWS if row.kind == 'eq'}
    for row in CORRECTED:
        for words in re.findall(r'^eqs? ([\d, ]+)', row.cells[1]):
            for number in re.findall(r'\d+', words):
                assert re.search(rf'\b{row.cells[0]}\b', by_number[number]), (row.cells[0], number)


def test_sources_cite_equations_and_tables_that_there_are():
    for path in (ROOT / 'icofabric_sim').rglob('*.py'):
        text = path.read_text(encoding='utf-8')
        for word, first, last in re.findall(r'\b(eqs?|Tables?) (\d+)(?:-(\d+))?', text):
            limit = EQUATIONS if word.startswith('eq') else TABLES
            assert all(1 <= int(n) <= limit for n in (first, last) if n), f'{path}: {word} {first}'


def test_quaternion_equation_in_world_and_in_body_components():
    """Eq 22 and eq 24 are one: omega q is q times omega on body axes, as pure quaternions."""
    def product(p, q):
        return np.hstack([
            p[:, 3:] * q[:, :3] + q[:, 3:] * p[:, :3] + np.cross(p[:, :3], q[:, :3]),
            p[:, 3:] * q[:, 3:] - (p[:, :3] * q[:, :3]).sum(axis=1, keepdims=True)])

    generator = np.random.default_rng(3)
    q = generator.standard_normal((100, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    omega = generator.standard_normal((100, 3))
    on_body = np.einsum('nij,nj->ni', cosines_from_quaternions(q), omega)
    pure, pure_on_body = (np.hstack([part, np.zeros((100, 1))]) for part in (omega, on_body))
    np.testing.assert_allclose(product(pure, q), product(q, pure_on_body), atol=1e-14)
    assert np.abs(omega - on_body).max() > 1.0
