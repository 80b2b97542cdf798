# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Names and texts keep to docs/style.md: counts of docs/language.py have ceilings."""

from collections import Counter
import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
# Rooms and pages without breaches; those of other rooms may only become fewer.
ROOMS = (
    'parameters', 'scene', 'statics', 'messages', 'bag', 'running', 'sweeps', 'pictures',
    'viewer', 'commands', 'ros')
CEILINGS = {'docstrings': 508, 'constants': 121, 'words': 219, 'sections': 0}


@pytest.fixture(scope='module')
def language():
    spec = importlib.util.spec_from_file_location('language', ROOT / 'docs/language.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope='module')
def counts(language):
    return language.count(ROOT)


def test_pages_are_read_once(counts):
    assert counts.examined['sentences'] > 1000 and counts.mean_length <= 18.0
    pages = [place for place in counts.places if place.path.suffix == '.md']
    assert not [str(place) for place in pages]


def test_breaches_in_code_become_fewer(counts):
    code = [place for place in counts.places if place.path.suffix == '.py']
    found = Counter(place.rule for place in code)
    assert {rule: found[rule] for rule, most in CEILINGS.items() if found[rule] > most} == {}
    package = ROOT / 'icofabric_sim'
    assert not [str(place) for place in code if not place.path.is_relative_to(package)
                or place.path.relative_to(package).parts[0] in ROOMS]


@pytest.mark.parametrize('rule, text', [
    ('docstrings', 'def f():\n    """Whether it is so."""\n'),
    ('words', 'def f():\n    """Return names that nobody has."""\n'),
    ('words', 'TEXT = "the run goes on by another method"\n'),
    ('constants', '_MOST = 3\n')])
def test_a_breach_is_found(language, tmp_path, rule, text):
    path = tmp_path / 'module.py'
    path.write_text(text)
    counts = language.Counts([], Counter(), {})
    language.examine_code(counts, path, {})
    assert [place.rule for place in counts.places] == [rule]


def test_a_long_sentence_and_a_long_cell_are_found(language, tmp_path):
    page = tmp_path / 'page.md'
    long = 'word ' * 36
    page.write_text(f'One {long}.\n\n| {long}|\n\nA short sentence stands here.\n')
    counts = language.Counts([], Counter(), {})
    language.examine_page(counts, page)
    assert [place.rule for place in counts.places] == ['sentences', 'sentences']
    assert counts.lengths[page][-1] == 5
