# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A feature whose library is missing ends in one line that has the command to install it."""
import ast
import pickle
import re
import shlex
import subprocess
import sys

from icofabric_sim import libraries
from icofabric_sim.commands import info
from icofabric_sim.commands.main import main
from package_imports import MODULES, PACKAGE
import pytest

PICTURE = 'needs matplotlib, which is not installed: '
VERBS = {
    'render': ['render', 'bag'],
    'plot': ['plot', 'bag', 'energy'],
    'film gif': ['film', 'bag', 'film.gif'],
    'film webp': ['film', 'free_slab', 'film.webp', '--duration', '0.01'],
    'film mp4': ['film', 'bag', 'film.mp4'],
    'statics': ['statics', 'hanging_slab', '--picture', 'rest.png'],
    'modes': ['modes', 'free_slab', '--picture', 'modes.png'],
    'bands': ['modes', 'free_slab', '--bands', 'bands.png'],
    'animate': ['modes', 'free_slab', '--animate', 'mode.gif'],
    'elasticity': ['elasticity', 'free_slab', '--picture', 'elastic.png'],
    'tables': ['tables', '--figure', 'figure.png'],
    'document': ['document', '--figure', '2', 'figure.png'],
    'sweep': ['sweep', 'fall.yaml', '--picture', 'sweep.png'],
    'stress': ['stress', '--map', '--picture', 'map.png'],
    'study': ['study', '--quick'],
    'benchmark': ['benchmark', 'scaling', '--output', 'figures'],
}


@pytest.fixture
def said(tmp_path, monkeypatch, capsys):
    """Return what a verb writes to stderr, run in a folder of its own without some modules."""
    fall = (PACKAGE.parent / 'examples' / 'fall.yaml').read_text()
    (tmp_path / 'fall.yaml').write_text(fall)
    monkeypatch.chdir(tmp_path)

    def run(words, *missing):
        for name in missing:
            monkeypatch.setitem(sys.modules, name, None)
        assert main(words) == 2
        assert not list(tmp_path.glob('*.png'))
        return capsys.readouterr().err

    return run


@pytest.mark.parametrize('words', VERBS.values(), ids=VERBS)
def test_no_verb_begins_a_picture_without_matplotlib(words, said):
    line, = said(words, 'matplotlib', 'PIL').splitlines()
    assert PICTURE in line
    assert line.endswith(f'{sys.executable} -m pip install matplotlib')


def test_an_error_of_any_missing_module_is_one_line(said, monkeypatch):
    def fail(arguments):
        raise ModuleNotFoundError("No module named 'yaml.nodes'", name='yaml.nodes')

    monkeypatch.setattr(info, 'main', fail)
    line, = said(['info', 'free_slab']).splitlines()
    assert line == (
        f'icofabric info: yaml is not installed: {sys.executable} -m pip install PyYAML')
    # A module of the package is no library.
    monkeypatch.setitem(sys.modules, 'icofabric_sim.commands.info', None)
    with pytest.raises(ModuleNotFoundError):
        main(['info', 'free_slab'])


def test_the_python_of_the_system_is_asked_for_the_users_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(libraries.sysconfig, 'get_path', lambda name: str(tmp_path))
    monkeypatch.setattr(sys, 'prefix', sys.base_prefix)
    assert '--user' not in libraries.install_command('viser')
    (tmp_path / 'EXTERNALLY-MANAGED').write_text('')
    assert shlex.split(libraries.install_command('viser'))[1:] == [
        '-m', 'pip', 'install', '--user', '--break-system-packages', 'viser>=1.1,<1.2']


def test_a_missing_library_survives_pickle():
    with pytest.raises(ImportError) as caught:
        libraries.require_library('of_nobody', 'a test', without='a review does not')
    again = pickle.loads(pickle.dumps(caught.value))
    assert type(again) is libraries.MissingLibrary and str(again) == str(caught.value)
    assert str(again).startswith('a test needs of_nobody, which is not installed: ')
    assert str(again).endswith('install of_nobody; a review does not')


def test_commands_name_what_the_extras_do():
    done = subprocess.run(
        [sys.executable, '-c', 'import os, setuptools; setuptools.setup = lambda **words: print('
         'repr(words["extras_require"])); exec(open("setup.py").read()); os.chdir("validation"); '
         'exec(open("setup.py").read())'],
        cwd=PACKAGE.parent, capture_output=True, text=True, check=True)
    own, validation = map(ast.literal_eval, done.stdout.splitlines())
    extras = {**own, **validation}
    named = {name for names in libraries.REQUIREMENTS.values() for name in names}
    every = {name for names in extras.values() for name in names}
    # PyYAML is needed by all.
    assert named - {'PyYAML', './validation'} <= every
    for extra, module in (('viewer', 'viser'), ('mpi', 'mpi4py'), ('ros', 'rclpy')):
        assert extras[extra] == list(libraries.REQUIREMENTS[module])
    page = (PACKAGE.parent / 'docs' / 'howto' / 'install.md').read_text()
    rows = dict(re.findall(r'^\| `(\w+)` \|.*\| (.*) \|$', page, re.MULTILINE))
    assert rows == {extra: ', '.join(names) for extra, names in extras.items()
                    if extra not in ('test', 'docs')}


def test_no_other_module_writes_commands_of_pip():
    """No index has the package, and pip replaces an editable install by what it is given."""
    texts = {name: path.read_text() for name, path in MODULES.items()
             if name != libraries.__name__}
    assert [name for name, text in texts.items() if 'pip install' in text] == []
    assert [name for name, text in texts.items() if 'icofabric_sim[' in text] == []
