# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What the documents say is what the program does."""

import argparse
from fnmatch import fnmatch
import importlib
import importlib.util
from pathlib import Path
import re
import runpy

import icofabric_sim
from icofabric_sim.commands.main import load_verb, VERBS
from icofabric_sim.messages.topics import Recorded, STRAIN_CLASSES, TOPICS
from icofabric_sim.parameters.table import Change, FAMILIES, STATIC
from icofabric_sim.ros.standard_services import ACTION, SERVICES, topic_name
from icofabric_sim.simulation.stepping.methods import IMPLICIT, METHODS
from icofabric_sim.terms.registry import support_rows
import pytest

ROOT = Path(__file__).resolve().parent.parent
DOCUMENTS = sorted([ROOT / 'README.md', ROOT / 'CHANGELOG.md', *(ROOT / 'docs').rglob('*.md')])


def test_parameter_table_is_made_from_the_schema():
    path = ROOT / 'docs' / 'make_parameters.py'
    specification = importlib.util.spec_from_file_location('make_parameters', path)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    written = (ROOT / 'docs' / 'parameters.md').read_text(encoding='utf-8')
    assert written == module.text(), 'run .venv/bin/python docs/make_parameters.py'


@pytest.mark.parametrize('name', ['README.md', 'docs/ros.md'])
def test_pages_say_what_a_change_does_in_the_words_of_the_table(name):
    text = ' '.join((ROOT / name).read_text(encoding='utf-8').split())
    for change in Change:
        assert f'*{change.value}*' in text, change


def test_page_of_the_node_names_all_that_restarts_the_motion():
    text = ' '.join((ROOT / 'docs' / 'ros.md').read_text(encoding='utf-8').split())
    [listing] = re.findall(rf'\*{Change.RESTARTS.value}\* \(([^)]*)\)', text)
    sections = {entry.name.split('.')[0] for entry in STATIC if entry.change is Change.RESTARTS}
    sections |= {family for family, fields in FAMILIES.items()
                 if any(field.change is Change.RESTARTS for field in fields)}
    assert {*re.findall(r'`(\w+)\.\*`', listing)} == sections


@pytest.mark.parametrize('path', DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_files_that_are_named_exist(path):
    text = path.read_text(encoding='utf-8')
    named = re.findall(r'`((?:config|docs|validation|launch|rviz|test)/[\w./*-]*\w)`', text)
    named += re.findall(r'\]\(((?!http)[\w./-]+)\)', text)
    for name in named:
        base = path.parent if name.startswith('../') or (path.parent / name).exists() else ROOT
        assert list(base.glob(name)), f'{path.name} names {name}'


def anchors_of(text):
    """Anchors of the headings of a page, as GitHub and MyST make them."""
    text = re.sub(r'^```.*?^```', '', text, flags=re.DOTALL | re.MULTILINE)
    found = []
    for heading in re.findall(r'^#{1,4} +(.+?) *$', text, re.MULTILINE):
        plain = re.sub(r'\[([^]]*)\]\([^)]*\)|[*`]', r'\1', heading).lower()
        anchor = re.sub(r'[^\w\- ]', '', plain).replace(' ', '-')
        found.append(f'{anchor}-{found.count(anchor)}' if anchor in found else anchor)
    return found


def links_of(text):
    """Targets of links within the documents: `page.md`, `page.md#anchor`, `#anchor`."""
    text = re.sub(r'^```.*?^```', '', text, flags=re.DOTALL | re.MULTILINE)
    return [target for target in re.findall(r'\]\(([^()\s]+)\)', text)
            if not re.match(r'https?:|mailto:', target)]


@pytest.mark.parametrize('path', DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_to_files_and_headings(path):
    for target in links_of(path.read_text(encoding='utf-8')):
        name, _, anchor = target.partition('#')
        page = (path.parent / name).resolve() if name else path
        assert page.exists(), f'{path.name} links to {target}'
        if anchor:
            assert page.suffix == '.md' and anchor in anchors_of(page.read_text('utf-8')), (
                f'{path.name} links to {target}')


def test_a_wrong_link_is_found(tmp_path):
    page = tmp_path / 'page.md'
    page.write_text('# The `first` start\n\n[there](#the-first-start)\n', encoding='utf-8')
    test_links_lead_to_files_and_headings(page)
    for wrong in ('#the-first-end', 'other.md', 'page.md#first'):
        page.write_text(f'# The `first` start\n\n[there]({wrong})\n', encoding='utf-8')
        with pytest.raises(AssertionError, match='links to'):
            test_links_lead_to_files_and_headings(page)


def test_the_site_contains_every_page():
    docs = ROOT / 'docs'
    listed = []
    for page in ('index', 'decisions/README'):
        text = (docs / f'{page}.md').read_text(encoding='utf-8')
        for tree in re.findall(r'^```\{toctree\}\n(.*?)^```', text, re.DOTALL | re.MULTILINE):
            listed += [(docs / f'{page}.md').parent / f'{name}.md'
                       for name in re.findall(r'^[\w/]+$', tree, re.MULTILINE)]
    assert len(listed) == len(set(listed))
    assert set(listed) == {*docs.rglob('*.md')} - {docs / 'index.md'}


def test_the_python_reference_has_every_public_name_and_the_fields_of_records():
    text = (ROOT / 'docs' / 'api.md').read_text(encoding='utf-8')
    documented = re.findall(r'^\.\. (?:auto|py:)\w+:: icofabric_sim\.(\w+)$', text, re.MULTILINE)
    assert {*documented} == {*icofabric_sim.__all__, 'contact'}
    fields_of = runpy.run_path(str(ROOT / 'docs' / 'conf.py'))['fields_of']
    fields = dict(fields_of(icofabric_sim.Snapshot))
    assert fields['position'] == '(n, 3) [m]' and fields['ledger'].startswith('[J] work in')
    assert 'table' not in fields


def test_modules_that_comments_name_exist():
    """A name alone, or with the end of its path."""
    there = [path.relative_to(ROOT).as_posix() for path in ROOT.rglob('*.py')]
    named = 0
    for path in (ROOT / 'icofabric_sim').rglob('*.py'):
        for name in re.findall(r'(?<![\w/{}*.-])((?:\w+/)*\w+\.py)\b', path.read_text('utf-8')):
            named += 1
            assert any(f'/{module}'.endswith(f'/{name}') for module in there), f'{path}: {name}'
    assert named > 50


def test_page_of_the_node_names_every_topic_and_strain_class():
    text = (ROOT / 'docs' / 'ros.md').read_text(encoding='utf-8')
    assert all(f'`{topic.name}`' in text for topic in TOPICS)
    recorded = {Recorded.NEVER: 'no', Recorded.IF_MEASURED: 'if `record.measured`'}
    for topic in TOPICS:
        if not topic.rate:
            continue
        [row] = re.findall(fr'^\| `{topic.name}` \|.*', text, re.MULTILINE)
        _, kind, _, rate, kept = (cell.strip() for cell in row.strip('|').split(' | '))
        assert kind == topic.type.replace('/msg/', '/'), row
        assert rate == ('latched' if topic.latched else f'`{topic.rate}`'), row
        assert kept == recorded.get(topic.recorded, 'yes'), row
    assert all(entry.name in text for entry in STRAIN_CLASSES)


def test_page_of_the_node_names_every_service_and_no_other():
    text = (ROOT / 'docs' / 'ros.md').read_text(encoding='utf-8')
    own = re.findall(r"\((?:SetBool|Trigger), '(~/\w+)'", (
        ROOT / 'icofabric_sim' / 'ros' / 'verbs.py').read_text(encoding='utf-8'))
    assert {'~/pause', '~/reset', '~/step', '~/record'} <= {*own}
    assert all(f'`{name}`' in text for name in own)
    [standard] = re.findall(r'Where the package `simulation_interfaces`.*?\n\n', text, re.DOTALL)
    assert set(re.findall(r'~/\w+', standard)) == {topic_name(name) for name in STANDARD}


def test_page_of_accuracy_names_every_method_and_which_auto_takes():
    text = (ROOT / 'docs' / 'accuracy.md').read_text(encoding='utf-8')
    sheet, _, choice = text.partition('| `auto` takes |')
    assert re.findall(r'^\| `(\w+)` \|', sheet, re.MULTILINE) == [*METHODS, *IMPLICIT]
    taken = set(re.findall(r'`(\w+)`', ' '.join(
        line.split('|')[2] for line in re.findall(r'^\|[^-].*\|$', choice, re.MULTILINE))))
    assert taken == {*METHODS, *IMPLICIT} - {'tsit5'}


def quoted(text):
    """What stands in backticks or in blocks of code."""
    blocks = re.findall(r'^```.*?^```', text, re.DOTALL | re.MULTILINE)
    rest = re.sub(r'^```.*?^```', '', text, flags=re.DOTALL | re.MULTILINE)
    lines = re.findall(r'^    +\S.*$', rest, re.MULTILINE)
    return [*re.findall(r'`([^`]+)`', rest), *(
        line for block in [*blocks, *lines] for line in block.splitlines())]


MODULES = sorted(
    str(path) for folder in ('icofabric_sim', 'validation', 'docs', 'examples', 'launch', 'test')
    for path in (ROOT / folder).rglob('*.py'))
SOURCE = '\n'.join(
    Path(name).read_text('utf-8') for name in MODULES if '/icofabric_sim/' in name)
STANDARD = (*SERVICES, ACTION)
EXECUTABLES = re.findall(
    r"'(\w+) = icofabric_sim\.", (ROOT / 'setup.py').read_text(encoding='utf-8'))


def options_of(verb):
    """All options of `icofabric VERB`."""
    parser = argparse.ArgumentParser()
    load_verb(verb).add_arguments(parser)
    parsers = [parser]
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            parsers += action.choices.values()
    return {option for one in parsers for option in one._option_string_actions}


def is_python(name):
    """Whether it is something in a module of the package, such as contact.restitution."""
    module, _, attribute = name.partition('.')
    return importlib.util.find_spec(f'icofabric_sim.{module}') is not None and hasattr(
        importlib.import_module(f'icofabric_sim.{module}'), attribute)


@pytest.mark.parametrize('path', DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_executables_verbs_and_options_that_are_named_exist(path):
    text = path.read_text(encoding='utf-8')
    assert 'fabric_node' in EXECUTABLES and 'icofabric' in EXECUTABLES
    for name in re.findall(r'(?<![\w/.])([a-z]\w*_node)\b(?!\.)', text):
        assert name in EXECUTABLES, f'{path.name} names the executable {name}'
    for words in quoted(text):
        for verb, options in re.findall(
                r'(?<![\w/.:])(?:\.venv/bin/)?icofabric ([a-z][\w-]*)([^|&;#\n]*)', words):
            assert verb in VERBS, f'{path.name} names icofabric {verb}'
            for option in re.findall(r'(?<![\w-])(--[a-z][a-z-]*)', options):
                assert option in options_of(verb), f'{path.name} names {option} of {verb}'


@pytest.mark.parametrize('path', DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_names_of_parameters_topics_modules_and_python_exist(path):
    known = {setting.name for setting in STATIC} | {
        f'{family}.NAME.{field.name}' for family, fields in FAMILIES.items() for field in fields}
    text = path.read_text(encoding='utf-8')
    first_words = {name.split('.')[0] for name in known}
    for words in quoted(text):
        for name in re.findall(r'^([a-z_]+(?:\.[a-zA-Z_*]+)+)(?=$|[: =])', words):
            family = name.split('.')[0]
            if family not in first_words or name.endswith(('.py', '.yaml', '.csv')):
                continue
            pattern = re.escape(name).replace(r'\*', r'[\w.]+').replace('EDGE', r'\w+')
            assert any(re.fullmatch(pattern, one) or one.startswith(f'{name}.')
                       for one in known) or is_python(name), f'{path.name} names {name}'
        for name in re.findall(r'(?<!\w)(~/[a-z_]+)', words):
            assert f"'{name}" in SOURCE or name in {topic_name(one) for one in STANDARD}, (
                f'{path.name} names {name}')
        for name in re.findall(r'^((?:[\w*]+/)*[\w*]+\.py)\b', words):
            assert any(fnmatch(module, f'*/{name}') for module in MODULES), (
                f'{path.name} names {name}')
        for name in re.findall(r'(?<![\w.])ico\.(\w+)', words):
            assert hasattr(icofabric_sim, name), f'{path.name} names ico.{name}'
        for target in re.findall(r'^\s*make ([a-z][\w-]*)', words):
            assert re.search(
                rf'^{target}:', (ROOT / 'Makefile').read_text('utf-8'), re.MULTILINE), (
                f'{path.name} names make {target}')


def test_the_table_of_support_is_that_of_the_registry():
    page = (ROOT / 'docs' / 'adding_a_force.md').read_text(encoding='utf-8')
    table = page.partition('## What does not compute a term')[2].strip().splitlines()
    assert table[2:] == support_rows() and len(table) > 9
