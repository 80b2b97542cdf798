# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
What the documents say is what the program does.
"""

import importlib.util
from pathlib import Path
import re

from icofabric_sim.outputs import STRAIN_CLASSES, TOPICS
import pytest

ROOT = Path(__file__).resolve().parent.parent
DOCUMENTS = sorted([ROOT / 'README.md', ROOT / 'CHANGELOG.md', *(ROOT / 'docs').glob('*.md')])


def test_parameter_table_is_made_from_the_schema():
    path = ROOT / 'docs' / 'make_parameters.py'
    specification = importlib.util.spec_from_file_location('make_parameters', path)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    written = (ROOT / 'docs' / 'parameters.md').read_text(encoding='utf-8')
    assert written == module.text(), 'run python docs/make_parameters.py'


@pytest.mark.parametrize('path', DOCUMENTS, ids=lambda path: path.name)
def test_files_that_are_named_exist(path):
    text = path.read_text(encoding='utf-8')
    named = re.findall(r'`((?:config|docs|benchmarks|launch|rviz|test)/[\w./*-]*\w)`', text)
    named += re.findall(r'\]\(((?!http)[\w./-]+)\)', text)
    for name in named:
        base = path.parent if name.startswith('../') or (path.parent / name).exists() else ROOT
        assert list(base.glob(name)), f'{path.name} names {name}'


def test_readme_names_every_topic_and_strain_class():
    text = (ROOT / 'README.md').read_text(encoding='utf-8')
    assert all(f'`{topic.name}`' in text for topic in TOPICS)
    assert all(entry.name in text for entry in STRAIN_CLASSES)
