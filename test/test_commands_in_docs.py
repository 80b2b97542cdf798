# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Commands that pages and docstrings print exist as printed: program, script, verb and options.

Nothing is run: each command line is parsed by the parser of its program.
"""

import argparse
import ast
from importlib import import_module
from pathlib import Path
import re
import runpy
import shlex
import sys
from typing import NamedTuple

from icofabric_sim.commands import main as icofabric
from icofabric_sim.messages.input_topics import input_type
from icofabric_sim.parameters.file import check_ros_arguments
from icofabric_sim.parameters.table import STATIC
from icofabric_sim.ros.ros_parameters import make_start_parameters
from icofabric_sim.ros.start import non_ros_arguments
from icofabric_sim.running.replay.replay_parameters import judge_options
import pytest
import yaml

ROOT = Path(__file__).resolve().parent.parent
PAGES = sorted([ROOT / 'README.md', *(ROOT / 'docs').rglob('*.md')])
VALIDATION = ROOT / 'validation' / 'icofabric_validation'
PROGRAMS = sorted(path for room in ('benchmarks', 'robustness', 'repository')
                  for path in (VALIDATION / room).glob('*.py'))
SCRIPTS = [*PROGRAMS, *sorted(path for folder in ('docs', 'examples', 'launch')
                              for path in (ROOT / folder).glob('*.py'))]
SETUP = ''.join((ROOT / folder / 'setup.py').read_text(encoding='utf-8')
                for folder in ('.', 'validation'))
EXECUTABLES = re.findall(r"'(\w+) = icofabric_sim\.", SETUP)
# A line whose first word is one of these is a command. Of programs of .venv the name alone is
# not: it is not found in a shell where .venv is not activated.
IN_VENV = ('python', 'pip', 'pytest', 'dask', *EXECUTABLES)
ELSEWHERE = ('make', 'ros2', 'rosdep', 'colcon', 'source')


class Parsed(Exception):
    """The command line was accepted."""


class Printed(NamedTuple):
    """A command and where it stands."""

    path: Path
    text: str

    @property
    def place(self):
        return f'{self.path.relative_to(ROOT)}: {self.text}'


def is_command(line):
    first = (line.split() or [''])[0]
    if first in ELSEWHERE or first.startswith('.venv/bin/'):
        return True
    # Prose begins with these words too; a command goes on with a verb, an option or a file.
    return first in IN_VENV and bool(re.match(r'\S+ +(-|[\w/.]+\.py\b|[a-z]+( [\w-]|$))', line))


def commands_of(path):
    """All commands of a page, or of the docstring of a script."""
    text = path.read_text(encoding='utf-8')
    if path.suffix == '.py':
        text = ast.get_docstring(ast.parse(text)) or ''
    fenced = re.findall(r'^```(?!python)[^\n]*\n(.*?)^```', text, re.DOTALL | re.MULTILINE)
    rest = re.sub(r'^```.*?^```', '', text, flags=re.DOTALL | re.MULTILINE)
    lines = [line.strip() for line in '\n'.join(fenced).splitlines()]
    lines += [line.strip() for line in re.findall(r'^(?:    |\t)\s*(\S.*)$', rest, re.MULTILINE)]
    # Within a sentence `icofabric VERB` names a verb; what is given a place is a command.
    lines += [words for words in re.findall(r'`([^`\n]+)`', rest)
              if re.match(r'(\.venv/bin/\w+|python|ros2 param set|make) ', words)]
    for line in lines:
        if is_command(line):
            plain = re.sub(r'\s#\s.*$', '', line)
            yield from (Printed(path, part.strip()) for part in plain.split('&&'))


COMMANDS = [command for path in [*PAGES, *SCRIPTS] for command in commands_of(path)]


def words_of(command):
    """Its words; what is in brackets may be left out, but has to be right too."""
    text = re.sub(r'\|\w+', '', command.text)
    return shlex.split(re.sub(r'(?<!\S)\[|\](?!\S)', '', text) if '[-' in text else text)


def parse(command, monkeypatch, call):
    """Call a program up to where its command line is parsed."""
    original = argparse.ArgumentParser.parse_args

    def parse_args(parser, *arguments, **others):
        original(parser, *arguments, **others)
        raise Parsed

    monkeypatch.setattr(argparse.ArgumentParser, 'parse_args', parse_args)
    try:
        call()
    except Parsed:
        return
    except SystemExit as exit_:
        pytest.fail(f'{command.place} ends with {exit_.code}')
    pytest.fail(f'{command.place} does not read its command line')


def check_python(command, words, monkeypatch):
    if words[0] == '-m':
        words = [f'validation/{words[1].replace(".", "/")}.py', *words[2:]]
    script, *arguments = words
    path = ROOT / script
    assert path.is_file(), f'{command.place}: there is no {script}'
    if 'ArgumentParser' not in path.read_text(encoding='utf-8'):
        assert not arguments, f'{command.place}: {script} takes no arguments'
        return
    monkeypatch.setattr(sys, 'argv', words)
    monkeypatch.syspath_prepend(path.parent)
    main = runpy.run_path(str(path), run_name='parsed')['main']
    parse(command, monkeypatch, main)


def check_node(command, name, arguments):
    given = check_ros_arguments(arguments)
    own = non_ros_arguments(arguments)
    if name == 'replay_node':
        judge_options(given, *own)
    elif name == 'viewer_node':
        from icofabric_sim.ros.viewer import DEFAULTS
        assert not own and given.keys() <= DEFAULTS.keys(), command.place
    else:
        assert name == 'fabric_node' and own in ([], ['--ranks']), command.place
        make_start_parameters(given)


def check_executable(command, name, arguments, monkeypatch):
    if name == 'icofabric':
        parse(command, monkeypatch, lambda: icofabric.main(arguments))
    else:
        check_node(command, name, arguments)


def check_pip(command, words):
    assert words[0] == 'install', command.place
    # Libraries of extras, never the package: pip would replace an editable install by a copy.
    assert words[1:] and all(f"'{word}'" in SETUP for word in words[1:]), command.place


def check_dask(command, words):
    verb, *options = words
    program = import_module(f'distributed.cli.dask_{verb}').main
    # Parsed by its own parser, and not begun.
    assert program.make_context(verb, options).params, command.place


def check_ros2(command, words, monkeypatch):
    match words:
        case ['run', 'icofabric_sim', name, *arguments]:
            assert name in EXECUTABLES, command.place
            check_executable(command, name, arguments, monkeypatch)
        case ['launch', 'icofabric_sim', name, *arguments]:
            text = (ROOT / 'launch' / name).read_text(encoding='utf-8')
            for argument in arguments:
                own = argument.split(':=')[0]
                assert f"'{own.removeprefix('left_').removeprefix('right_')}'" in text, (
                    f'{command.place}: {name} has no argument {own}')
        case ['param', 'set', '/icofabric', name, _]:
            known = {setting.name for setting in STATIC} | {'seek', 'rate', 'loop', 'stay'}
            assert name in known, command.place
        case ['service', 'call', service, kind, _]:
            package, folder, name = kind.split('/')
            assert hasattr(import_module(f'{package}.{folder}'), name), command.place
            wanted = service.replace('/icofabric/', '~/')
            assert any(f"'{wanted}'" in path.read_text(encoding='utf-8')
                       for path in (ROOT / 'icofabric_sim' / 'ros').glob('*.py')), command.place
        case ['topic', 'pub', *_, topic, kind, message]:
            assert input_type(topic.replace('/icofabric/', '~/')) == kind, command.place
            package, folder, name = kind.split('/')
            message_class = getattr(import_module(f'{package}.{folder}'), name)
            fields = message_class.get_fields_and_field_types()
            assert yaml.safe_load(message).keys() <= fields.keys(), command.place
        case ['param', 'dump', '/icofabric', *_] | ['param', 'load', '/icofabric', _]:
            pass  # test_what_is_dumped_can_be_loaded
        case ['bag', 'play', _]:
            pass
        case _:
            pytest.fail(f'{command.place} is not known to this test')


@pytest.mark.parametrize('command', COMMANDS, ids=lambda command: command.place)
def test_command_is_there_as_printed(command, monkeypatch):
    monkeypatch.chdir(ROOT)
    program, *words = words_of(command)
    if program == '.venv/bin/mpiexec':
        option, count, program, *words = words
        assert option == '-n' and count.isdigit(), command.place
    name = Path(program).name
    if program.startswith('.venv/bin/'):
        assert name in IN_VENV, f'{command.place}: .venv has no {name} of ours'
        if name == 'python':
            check_python(command, words, monkeypatch)
        elif name == 'pip':
            check_pip(command, words)
        elif name == 'dask':
            check_dask(command, words)
        else:
            check_executable(command, name, words, monkeypatch)
    elif program == 'ros2':
        check_ros2(command, words, monkeypatch)
    elif program == 'make':
        makefile = (ROOT / 'Makefile').read_text(encoding='utf-8')
        assert re.search(rf'^{words[0]}:|^[\w -]*\b{words[0]}:', makefile, re.MULTILINE), (
            command.place)
    else:
        assert program in ELSEWHERE, f'{command.place}: write .venv/bin/{name}'


def test_commands_are_found():
    found = {command.path.name for command in COMMANDS}
    assert {'README.md', 'performance.md', 'statics.md', 'pile.py', 'push.py'} <= found
    assert len(COMMANDS) > 60


def test_every_benchmark_that_is_a_program_prints_its_command():
    assert len(PROGRAMS) > 40
    for path in PROGRAMS:
        if 'def main() -> ' in path.read_text(encoding='utf-8') and path.stem != 'listener':
            module = path.relative_to(ROOT / 'validation').with_suffix('').as_posix()
            assert any(module.replace('/', '.') in command.text
                       for command in commands_of(path)), path.name


@pytest.mark.parametrize('line', [
    'python -m icofabric_validation.benchmarks.pile',
    '.venv/bin/python -m icofabric_validation.benchmarks.heap',
    '.venv/bin/python -m icofabric_validation.benchmarks.pile --deep',
    '.venv/bin/icofabric fold x',
    'icofabric run hanging_slab', '.venv/bin/icofabric run hanging_slab --for 2',
    '.venv/bin/fabric_node --ros-args -p weave.sise:=2', 'ros2 run icofabric_sim node',
    'ros2 launch icofabric_sim simulate.launch.py stage:=x', 'make tests',
    '.venv/bin/mpiexec -n 2 .venv/bin/icofabric run hanging_slab --all-ranks',
    '.venv/bin/mpiexec .venv/bin/icofabric run hanging_slab --ranks'])
def test_wrong_commands_are_found(line, tmp_path, monkeypatch):
    page = tmp_path / 'page.md'
    page.write_text(f'# Title\n\n    {line}\n', encoding='utf-8')
    [command] = commands_of(page)
    with pytest.raises((AssertionError, ValueError, pytest.fail.Exception)):
        test_command_is_there_as_printed(Printed(ROOT / 'page.md', command.text), monkeypatch)
