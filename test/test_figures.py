# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A figure stands in docs/figures.yaml, with its command; pages quote it from there."""

from datetime import date
from pathlib import Path
import re
import runpy

import pytest
from test_commands_in_docs import Printed
from test_commands_in_docs import test_command_is_there_as_printed as check_command
import yaml

ROOT = Path(__file__).resolve().parent.parent
FILL = runpy.run_path(str(ROOT / 'docs' / 'fill_figures.py'))
PAGES, QUOTE, FIGURES = FILL['PAGES'], FILL['QUOTE'], FILL['read_figures']()
MACHINES = yaml.safe_load((ROOT / 'docs' / 'figures.yaml').read_text('utf-8'))['machines']
TEXTS = {page: page.read_text(encoding='utf-8') for page in PAGES}


@pytest.mark.parametrize('name', FIGURES)
def test_figure_says_how_it_was_measured(name, monkeypatch):
    figure = FIGURES[name]
    assert {*figure} - {'phrase'} == {
        'value', 'unit', 'what', 'command', 'machine', 'load', 'date'}
    assert isinstance(figure['value'], str) and isinstance(figure['date'], date)
    assert figure['machine'] in MACHINES
    check_command(Printed(ROOT / 'docs' / 'figures.yaml', figure['command']), monkeypatch)


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_page_is_filled(page):
    text = TEXTS[page]
    assert text == FILL['filled'](text, FIGURES), 'run .venv/bin/python docs/fill_figures.py'
    # A comment that is not closed would not be filled.
    assert text.count('<!--') == 2 * len(QUOTE.findall(text))


def test_every_figure_is_quoted():
    quoted = {name for text in TEXTS.values() for name, _, _ in QUOTE.findall(text)}
    assert quoted == {*FIGURES}


def stated_apart(text):
    """What a page states with a number of its own, of the figures in the file."""
    rest = QUOTE.sub('(quoted)', text)
    return [f'{found.group()!r}: {name}' for name, figure in FIGURES.items()
            if 'phrase' in figure for found in re.finditer(figure['phrase'], rest)]


@pytest.mark.parametrize('page', PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_page_states_no_figure_of_its_own(page):
    assert not stated_apart(TEXTS[page])


@pytest.mark.parametrize('text', [
    'Killed at 40 random moments: all good', 'at most 0.3 s of wall time lost',
    'A step costs 15 times as much with a table of 5 rows', 'One evaluation takes 0.9 us',
    'a million bodies take 3 times as long',
    'An rclpy message of objects costs 77 to 1,200 times more'])
def test_figures_that_were_stated_twice_are_found(text):
    assert stated_apart(text)


def test_no_page_corrects_its_own_table():
    """Where a measurement is repeated its table is replaced; what was before is history."""
    for page in PAGES:
        if 'decisions' not in page.parts and page.name != 'CHANGELOG.md':
            assert not re.search(r'since that table|\*later\b', TEXTS[page], re.IGNORECASE), page
