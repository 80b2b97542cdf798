# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What `claims.py` calls the same, and that pages say what it compares."""

import sys

from icofabric_validation.repository import claims
from icofabric_validation.repository.claims import compare_claim, is_equal, Runs
from icofabric_validation.source_tree import ROOT
import pytest
from test_commands_in_docs import Printed
from test_commands_in_docs import test_command_is_there_as_printed as check_command
import yaml

CLAIMS, FIGURES = (
    yaml.safe_load((ROOT / 'docs' / f'{name}.yaml').read_text('utf-8'))[name]
    for name in ('claims', 'figures'))


@pytest.mark.parametrize('name', CLAIMS)
def test_page_says_what_is_compared(name, monkeypatch):
    claim = CLAIMS[name]
    assert {*claim} <= {
        'figure', 'page', 'said', 'command', 'seen', 'factor', 'scale', 'before', 'ends_with'}
    assert claims.values_on_page(claim, FIGURES)
    commands = [FIGURES[claim['figure']]['command']] if 'figure' in claim else [
        claim[key] for key in ('before', 'command') if key in claim]
    for command in commands:
        check_command(Printed(ROOT / 'docs' / 'claims.yaml', command), monkeypatch)


@pytest.mark.parametrize('said, seen, same', [
    ('20', '20', True), ('20', '19', False), ('1,308', '1308', True), ('0.0390', '0.03904', True),
    ('0.0390', '0.03906', False), ('44.9', '44.8514', True), ('44.9', '44.8', False),
    ('6.5e-9', '6.54e-9', True), ('6.5e-9', '6.6e-9', False), ('chaotic', 'chaotic', True),
    ('chaotic', 'between', False), ('chaotic', '3', False)])
def test_numbers_agree_in_the_digits_that_a_page_prints(said, seen, same):
    assert is_equal(said, seen) is same


@pytest.mark.parametrize('said, seen, right', [
    ('46 (21 to 48)', ['30'], True), ('46 (21 to 48)', ['10'], False),
    ('46 (21 to 48)', ['97'], False), ('93 to 1,074', ['80', '1500'], True),
    ('93 to 1,074', ['80', '2500'], False), ('4.27 (4.20-4.30)', ['4.1'], True),
    ('2', [], False)])
def test_ratios_lie_in_the_range_to_a_factor(said, seen, right):
    assert claims.is_within(said, seen, 2.0) is right


@pytest.mark.parametrize('printed, verdict', [
    ('0.25 of 4', 'equal'), ('0.26 of 4', 'DIFFERENT'), ('nothing', 'DIFFERENT'),
    ('0.25 of 4\n0.25 of 4', 'DIFFERENT')])
def test_a_command_is_run_and_compared(printed, verdict, monkeypatch):
    figures = {'parts': {'value': '0.25 of 4', 'command': 'print'}}
    claim = {'figure': 'parts', 'seen': r'([\d.]+) of (\d+)'}

    class Printing:
        def output(self, command):
            assert command == 'print'
            return 0, printed

    row = compare_claim('parts', claim, figures, Printing())
    assert row.verdict == verdict
    assert verdict in claims.table([row])


@pytest.mark.parametrize('status, wanted, verdict', [
    (1, 0, 'DIFFERENT'), (0, 2, 'DIFFERENT'), (2, 2, 'equal'), (None, 0, 'not seen')])
def test_what_a_command_ends_with_counts(status, wanted, verdict):
    figures = {'parts': {'value': '4', 'command': 'print'}}
    claim = {'figure': 'parts', 'seen': r'(\d+)', 'ends_with': wanted}

    class Ending:
        def output(self, _command):
            return status, '4'

    assert compare_claim('parts', claim, figures, Ending()).verdict == verdict


def test_commands_run_in_a_folder_of_their_own(tmp_path, capsys):
    runs = Runs(tmp_path, 60.0)
    script = tmp_path / 'script.py'
    script.write_text("from pathlib import Path\nPath('runs/made').touch()\nprint('7 of 7')\n")
    command = f'{sys.executable} {script}  # a comment'
    assert runs.output(command) == (0, '7 of 7\n')
    assert (tmp_path / 'runs' / 'made').exists() and not (ROOT / 'runs' / 'made').exists()
    script.write_text('1 / 0')
    # Each command is run once.
    assert runs.output(command) == (0, '7 of 7\n')
    status, text = runs.output(f'{sys.executable} {script}')
    assert status == 1 and 'ZeroDivisionError' in text
    script.write_text('import time\ntime.sleep(60)')
    other = tmp_path / 'other'
    other.mkdir()
    status, text = Runs(other, 0.5).output(f'{sys.executable} {script} ')
    assert status is None and 'more than 0.5 s' in text


def test_commands_of_a_page_are_those_that_end():
    text = (
        'Prose with .venv/bin/icofabric run a.\n\n'
        '    .venv/bin/icofabric info a  # what\n    .venv/bin/icofabric view a\n'
        '    .venv/bin/icofabric run a [--duration 1]\n    ros2 run b\n'
        '```\n.venv/bin/icofabric run a -p b:=1\n```\n')
    assert list(claims.commands_of(text)) == [
        '.venv/bin/icofabric info a', '.venv/bin/icofabric run a -p b:=1']
