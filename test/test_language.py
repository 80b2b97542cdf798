# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Names and texts keep to docs/style.md: docs/language.py finds no breach."""

from collections import Counter
import importlib.util
import inspect
from pathlib import Path
import re

import icofabric_sim as ico
from icofabric_sim import contact
import pytest

ROOT = Path(__file__).resolve().parents[1]

# Checks of numpydoc: a docstring (GL08) whose summary (SS01) ends with a period (SS03) and is
# imperative (SS05); parameters as in the signature, in its order, with descriptions (PR01 to PR03,
# PR07, PR10); described return values (RT01, RT03) and yields (YD01).
NUMPYDOC = {
    'GL08', 'SS01', 'SS03', 'SS05', 'PR01', 'PR02', 'PR03', 'PR07', 'PR10', 'RT01', 'RT03', 'YD01'}


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


def test_code_has_no_breaches(counts):
    assert counts.examined['docstrings'] > 1000 and counts.examined['constants'] > 100
    assert not [str(place) for place in counts.places if place.path.suffix == '.py']


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


def public_callables():
    """Return exported functions, and public methods of exported classes, by dotted name."""
    exported = {f'icofabric_sim.{name}': getattr(ico, name) for name in ico.__all__}
    exported |= {
        f'icofabric_sim.contact.{name}': value for name, value in vars(contact).items()
        if getattr(value, '__module__', '') == contact.__name__ and not name.startswith('_')}
    found = {name: value for name, value in exported.items() if inspect.isfunction(value)}
    for name, value in exported.items():
        if inspect.isclass(value) and not issubclass(value, Exception):
            found |= {
                f'{name}.{key}': getattr(value, key) for key, member in vars(value).items()
                if not key.startswith('_') and (
                    inspect.isfunction(member) or isinstance(member, classmethod))}
    return found


def test_docstrings_of_the_public_api_follow_numpydoc():
    validate = pytest.importorskip('numpydoc.validate').validate
    found = []
    for name, function in public_callables().items():
        doc = inspect.getdoc(function) or ''
        # A method without parameters may have a single line, which names the result.
        checks = NUMPYDOC - {'RT01'} if '\n' not in doc else NUMPYDOC
        found += [f'{name}: {code} {text}' for code, text in validate(name)['errors']
                  if code in checks]
        if re.match('Raise ', doc) and '\nRaises\n---' not in doc:
            found.append(f'{name}: no section Raises')
    assert found == []
