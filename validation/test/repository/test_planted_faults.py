# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The table of planted faults fits the tree; the script that plants them tells what it finds."""
import ast

from icofabric_validation.repository import planted_faults
from icofabric_validation.repository.planted_faults import Fault, PACKAGE, read_table
from icofabric_validation.source_tree import ROOT
import pytest

ROOMS = ('kernels/', 'simulation/', 'simulation/stepping/', 'statics/', 'bag/', 'running/', 'ros/')


def test_every_fault_can_be_planted():
    """Each old line stands in its file once; what replaces it is Python."""
    faults = read_table()
    assert len(faults) >= 60 and len({fault[:3] for fault in faults}) == len(faults)
    for room in ROOMS:
        assert any(fault.file.startswith(room) for fault in faults), room
    for fault in faults:
        text = (ROOT / PACKAGE / fault.file).read_text(encoding='utf-8')
        ast.parse(text.replace(fault.old, fault.new))
        assert '\n' not in fault.old and '\n' not in fault.new


def small_tree(root, table):
    """A package of one function, a test of it, and a table of faults."""
    for name, text in {
            f'{PACKAGE}/half.py': 'def half(x):\n    return x / 2\n',
            f'{PACKAGE}/__init__.py': '', 'table.yaml': table,
            'test/test_half.py': f'from {PACKAGE}.half import half\n\n\n'
            'def test_half():\n    assert half(6) == 3\n\n\n'
            'def test_wrong_anyway():\n    assert half(6) < 7\n'}.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text, encoding='utf-8')
    return root / 'table.yaml'


ENTRY = 'half.py:\n  tests: [test/test_half.py]\n  faults:\n    - [{old}, {new}]\n'


@pytest.mark.parametrize('table, words', [
    (ENTRY.format(old='x / 3', new='x / 4'), '0 times instead of once'),
    (ENTRY.format(old='x', new='y'), '2 times instead of once'),
    (ENTRY.format(old='x / 2', new='x / 2'), 'the replacement is equal'),
    (ENTRY.format(old='x / 2', new='x').replace('_half.py]', '_third.py]'), 'test_third.py')])
def test_a_table_that_does_not_fit_is_refused(tmp_path, table, words):
    with pytest.raises(ValueError, match=words):
        read_table(small_tree(tmp_path, table), tmp_path)


def test_what_is_caught_and_what_survives(tmp_path, monkeypatch):
    table = ENTRY.format(old='x / 2', new='x / 3') + '    - [x / 2, x * 0.5]\n'
    root = tmp_path / 'tree'
    faults = read_table(small_tree(root, table), root)
    monkeypatch.setattr(planted_faults, 'ROOT', root)
    copies = planted_faults.Copies(tmp_path)
    results = tmp_path / 'results.csv'

    def compare_claim(fault):
        return planted_faults.judge(
            copies, fault, whole=False, known=planted_faults.known_results(results),
            results=results)

    assert [compare_claim(fault) for fault in faults] == ['test/test_half.py::test_half', '']
    # Taken from the table: no test runs again.
    monkeypatch.setattr(planted_faults, 'run_tests', lambda *arguments: pytest.fail('run'))
    assert [compare_claim(fault) for fault in faults] == ['test/test_half.py::test_half', '']
    assert (copies.faulty / PACKAGE / 'half.py').read_text() == (
        root / PACKAGE / 'half.py').read_text()


def test_a_test_that_fails_without_the_fault_catches_nothing(tmp_path, monkeypatch):
    root = tmp_path / 'tree'
    [fault] = read_table(small_tree(root, ENTRY.format(old='x / 2', new='x * 2')), root)
    path = root / 'test' / 'test_half.py'
    path.write_text(path.read_text().replace('half(6) == 3', 'half(6) == 4'))
    monkeypatch.setattr(planted_faults, 'ROOT', root)
    copies = planted_faults.Copies(tmp_path)
    assert isinstance(fault, Fault)
    assert not copies.first_failure(fault, fault.tests)
