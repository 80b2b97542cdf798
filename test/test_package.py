# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The manifests agree with each other and with the tree, and only `ros/` knows ROS."""
import ast
import configparser
import importlib.util
from pathlib import Path
import re
import shutil
import subprocess
import sys
import tarfile
from types import SimpleNamespace
from xml.etree import ElementTree
import zipfile

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / 'icofabric_sim'
EXECUTABLES = {
    'fabric_node': 'icofabric_sim.ros.fabric_node:main',
    'icofabric': 'icofabric_sim.commands.main:main',
    'replay_node': 'icofabric_sim.ros.replay_node:main',
    'viewer_node': 'icofabric_sim.ros.viewer_node:main',
}
ROS_MESSAGES = {
    'builtin_interfaces', 'diagnostic_msgs', 'geometry_msgs', 'rcl_interfaces', 'rosgraph_msgs',
    'std_msgs', 'std_srvs', 'visualization_msgs'}
ROS = ROS_MESSAGES | {
    'ament_index_python', 'launch', 'launch_ros', 'rclpy', 'rpyutils', 'simulation_interfaces'}
# SPDX, https://spdx.dev/ids
HEADER = """# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""


def sources(folder):
    return sorted(path for path in folder.rglob('*.py') if '__pycache__' not in path.parts)


def imported_packages(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition('.')[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield node.module.partition('.')[0]


@pytest.fixture(scope='module')
def manifest():
    return ElementTree.parse(ROOT / 'package.xml').getroot()


@pytest.fixture(scope='module')
def distribution(tmp_path_factory):
    """What setup.py says, as a package index or colcon would read it."""
    base = tmp_path_factory.mktemp('egg')
    subprocess.run(
        [sys.executable, 'setup.py', '-q', 'egg_info', '--egg-base', str(base)], cwd=ROOT,
        check=True, capture_output=True, text=True, timeout=60)
    return base / 'icofabric_sim.egg-info'


@pytest.fixture(scope='module')
def data_files():
    """Files by installation folder, from the arguments that setup.py hands to setuptools."""
    code = ('import json, setuptools\n'
            'setuptools.setup = lambda **words: print(json.dumps(words["data_files"]))\n'
            'import runpy; runpy.run_path("setup.py")\n')
    output = subprocess.run([sys.executable, '-c', code], cwd=ROOT, check=True,
                            capture_output=True, text=True, timeout=60).stdout
    return dict(yaml.safe_load(output))


def requirement_lines(name):
    lines = (line.partition('#')[0].strip() for line in (ROOT / name).read_text().splitlines())
    return [line for line in lines if line]


def requirement_name(line):
    return re.sub(r'[-_.]+', '-', re.match(r'[\w.-]+', line)[0]).lower()


def test_one_version(manifest, distribution):
    version = manifest.findtext('version')
    assert re.fullmatch(r'\d+\.\d+\.\d+', version)
    assert f'\nVersion: {version}\n' in (distribution / 'PKG-INFO').read_text()
    assert f'## [{version}]' in (ROOT / 'CHANGELOG.md').read_text()
    written = [str(path.relative_to(ROOT)) for path in [ROOT / 'setup.py', *sources(PACKAGE)]
               if re.search(rf'[\'"]{re.escape(version)}[\'"]', path.read_text())]
    assert written in ([], ['icofabric_sim/version.py'])
    import icofabric_sim
    assert getattr(icofabric_sim, '__version__', version) == version


def test_names_and_licence_agree(manifest, distribution):
    information = (distribution / 'PKG-INFO').read_text()
    assert manifest.findtext('name') == PACKAGE.name
    assert '\nLicense: Apache-2.0\n' in information
    assert manifest.findtext('license') == 'Apache-2.0'
    assert 'Apache License\n' in (ROOT / 'LICENSE').read_text()
    # colcon falls back to a plain Python package, without ROS hooks, when this is malformed.
    email = manifest.find('maintainer').get('email')
    assert re.fullmatch(r'[\w.+-]+@[a-z0-9-]+(\.[a-z0-9-]+)*\.[a-z]{2,}', email)
    assert f'\nMaintainer-email: {email}\n' in information
    assert manifest.findtext('export/build_type') == 'ament_python'


def test_executables(distribution):
    entry_points = configparser.ConfigParser()
    entry_points.read(distribution / 'entry_points.txt')
    assert dict(entry_points['console_scripts']) == EXECUTABLES
    scripts = configparser.ConfigParser()
    scripts.read(ROOT / 'setup.cfg')
    assert scripts['develop']['script_dir'] == '$base/lib/icofabric_sim'
    assert scripts['install']['install_scripts'] == '$base/lib/icofabric_sim'


@pytest.mark.parametrize('target', EXECUTABLES.values(), ids=EXECUTABLES)
def test_executable_has_its_function(target):
    module, _, function = target.partition(':')
    tree = ast.parse((ROOT / (module.replace('.', '/') + '.py')).read_text())
    assert function in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_all_subpackages_are_installed(distribution):
    folders = {path.parent for path in sources(PACKAGE)}
    assert [] == [str(folder) for folder in folders if not (folder / '__init__.py').is_file()]
    listed = (distribution / 'SOURCES.txt').read_text().splitlines()
    for path in sources(PACKAGE):
        assert f'./{path.relative_to(ROOT)}' in listed
    assert (distribution / 'top_level.txt').read_text().split() == ['icofabric_sim']


def test_data_files(data_files):
    share = 'share/icofabric_sim'
    assert data_files['share/ament_index/resource_index/packages'] == ['resource/icofabric_sim']
    assert data_files[share] == ['package.xml']
    assert data_files[f'{share}/launch'] == [
        f'launch/{name}.launch.py' for name in ('compare', 'replay', 'simulate')]
    assert data_files[f'{share}/rviz'] == ['rviz/compare.rviz', 'rviz/icofabric.rviz']
    present = sorted(f'config/{path.name}' for path in (ROOT / 'config').glob('*.*'))
    assert data_files[f'{share}/config'] == present
    assert 'config/hanging_slab.yaml' in present
    for files in data_files.values():
        assert all((ROOT / file).is_file() for file in files)


def test_requirements():
    run = requirement_lines('requirements.txt')
    others = [*requirement_lines('requirements-test.txt'),
              *requirement_lines('requirements-docs.txt')]
    for line in ('ros-jazzy-rclpy[fastrtps]==7.1.6', 'ros-jazzy-common-interfaces==5.3.6',
                 'numpy', 'scipy', 'rosbags', 'pytest', 'numba'):
        assert line in run
    locked = requirement_lines('requirements.lock')
    assert all(re.fullmatch(r'[a-z0-9-]+==[0-9][0-9a-z.]*', line) for line in locked)
    names = [requirement_name(line) for line in locked]
    assert names == sorted(set(names))
    assert {requirement_name(line) for line in run + others} <= set(names)
    for pinned in (line for line in run if '==' in line):
        assert re.sub(r'\[.*\]', '', pinned) in locked


@pytest.fixture(scope='module')
def uv_settings():
    spec = importlib.util.spec_from_file_location('uv_settings', ROOT / '.ci/uv_settings.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.uv_settings


def test_uv_is_told_what_pip_is_told(uv_settings):
    assert any(line.startswith('uv==') for line in requirement_lines('requirements.lock'))
    assert uv_settings([]) == {}
    assert uv_settings([
        ":env:.default-timeout='180'\n", ":env:.disable-pip-version-check='1'\n",
        ":env:.index-url='https://a/simple'\n", "freeze.quiet='1'\n",
        "global.extra-index-url='file:///b\\nfile:///c'\n", "global.find-links='/d\\n/e'\n",
        "global.index-url='https://f/simple'\n", "install.index-url='https://g/simple'\n"]) == {
            'UV_DEFAULT_INDEX': 'https://a/simple', 'UV_INDEX': 'file:///b file:///c',
            'UV_FIND_LINKS': '/d,/e', 'UV_HTTP_TIMEOUT': '180',
            'UV_INDEX_STRATEGY': 'unsafe-best-match'}
    with pytest.raises(ValueError, match='global.proxy'):
        uv_settings(["global.proxy='http://a'\n"])


def test_the_site_is_an_extra(distribution):
    wanted = (distribution / 'requires.txt').read_text().partition('[docs]\n')[2]
    assert sorted(wanted.partition('\n\n')[0].split()) == sorted(
        requirement_lines('requirements-docs.txt'))


def test_declared_dependencies_cover_the_imports(manifest):
    declared = {element.text for element in manifest.findall('exec_depend')}
    keys = {'llvmlite': 'python3-numba', 'matplotlib': 'python3-matplotlib',
            'numba': 'python3-numba', 'numpy': 'python3-numpy',
            'rosbags': 'python3-rosbags-pip', 'scipy': 'python3-scipy', 'yaml': 'python3-yaml',
            'PIL': 'python3-matplotlib',  # which needs and brings it
            # rosbags needs and brings them; the former is in the standard library since 3.14.
            'backports': 'python3-rosbags-pip', 'lz4': 'python3-rosbags-pip'}
    known = {
        *sys.stdlib_module_names, 'compression', 'icofabric_sim', 'simulation_interfaces'}
    for path in [*sources(PACKAGE), *sources(ROOT / 'launch')]:
        for name in set(imported_packages(path)) - known:
            assert keys.get(name, name) in declared, f'{path.relative_to(ROOT)} imports {name}'


# What Numba and llvmlite document for extensions.
DOCUMENTED = {
    'numba', 'numba.types', 'numba.extending', 'llvmlite', 'llvmlite.ir', 'llvmlite.binding'}
NUMBA_PRIVATE = PACKAGE / 'kernels' / 'runtime' / 'numba_private.py'


def imported_modules(path):
    """Return modules and `from` names of a file, dotted."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found |= {node.module, *(f'{node.module}.{alias.name}' for alias in node.names)}
    return found


def test_private_modules_of_numba_are_imported_in_one_module():
    allowed = re.compile('|'.join(rf'{name}(\.\w+)?' for name in sorted(DOCUMENTED)))
    private = {'numba.core', 'numba.np', 'numba.misc', 'llvmlite.binding.ffi'}
    users = 0
    for path in [*sources(PACKAGE), *sources(ROOT / 'validation' / 'icofabric_validation')]:
        found = {name for name in imported_modules(path)
                 if name.partition('.')[0] in ('numba', 'llvmlite')}
        users += bool(found)
        if path != NUMBA_PRIVATE:
            wrong = {name for name in found if name in private or not allowed.fullmatch(name)}
            assert not wrong, f'{path.relative_to(ROOT)}: import {wrong} from numba_private'
    assert users > 15


def test_private_attributes_of_numba_are_used_in_one_module():
    """Attributes that numba_private.py uses; other modules of kernels have their own names."""
    private = {
        name for node in ast.walk(ast.parse(NUMBA_PRIVATE.read_text()))
        for name in [getattr(node, 'attr', ''), getattr(node, 'name', None) or '']
        if isinstance(node, (ast.Attribute, ast.FunctionDef)) and re.match('_[a-z]', name)
    } - {'_replace'}  # of named tuples
    assert {'_cache', '_compiler', '_engine', '_final_module', '_load_index'} <= private
    for path in sources(PACKAGE):
        text = path.read_text()
        if path == NUMBA_PRIVATE or 'numba' not in text:
            continue
        for node in ast.walk(ast.parse(text)):
            name = getattr(node, 'attr', getattr(node, 'value', ''))
            if isinstance(node, (ast.Attribute, ast.Constant)) and name in private:
                raise AssertionError(
                    f'{path.relative_to(ROOT)}:{node.lineno}: {name} belongs to numba_private')


def test_only_ros_folder_imports_ros():
    outside = [path for path in sources(PACKAGE) if PACKAGE / 'ros' not in path.parents]
    assert len(outside) > 10
    for path in outside:
        assert not ROS & set(imported_packages(path)), path.relative_to(ROOT)


def test_everything_else_imports_without_ros():
    code = f"""
import importlib, pkgutil, sys

class NoRos:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in {sorted(ROS)!r}:
            raise ImportError('no ROS here: ' + name)

sys.meta_path.insert(0, NoRos())
import icofabric_sim
count = 0
for module in pkgutil.walk_packages(icofabric_sim.__path__, 'icofabric_sim.',
                                    onerror=lambda name: None):
    if not module.name.startswith('icofabric_sim.ros') and '__main__' not in module.name:
        importlib.import_module(module.name)
        count += 1
try:
    import rclpy
except ImportError:
    print(count)
"""
    done = subprocess.run([sys.executable, '-c', code], cwd=ROOT, capture_output=True, text=True,
                          timeout=120)
    assert done.returncode == 0, done.stderr
    expected = [path for path in sources(PACKAGE)
                if path.relative_to(PACKAGE).parts[0] not in ('ros', '__init__.py')
                and path.name != '__main__.py']
    assert int(done.stdout) == len(expected)


def test_headers():
    for folder in ('icofabric_sim', 'test', 'launch', 'validation', 'examples', 'docs'):
        for path in sources(ROOT / folder):
            assert path.read_text().startswith(HEADER), path.relative_to(ROOT)
    assert (ROOT / 'setup.py').read_text().startswith(HEADER)


def test_launch_file_compiles_and_keeps_its_arguments():
    text = (ROOT / 'launch' / 'simulate.launch.py').read_text()
    compile(text, 'simulate.launch.py', 'exec')
    declared = set(re.findall(r"DeclareLaunchArgument\(\s*'(\w+)'", text))
    assert {'scene', 'namespace', 'record', 'rviz'} <= declared


def test_rviz_shows_the_topics_of_the_node():
    view = yaml.safe_load((ROOT / 'rviz' / 'icofabric.rviz').read_text())['Visualization Manager']
    assert view['Global Options']['Fixed Frame'] == 'world'
    topics = {display['Topic']['Value']: (display['Class'].split('/')[1], display['Topic'])
              for display in view['Displays'] if 'Topic' in display}
    assert {topic: kind for topic, (kind, _) in topics.items()} == {
        '/icofabric/poses': 'PoseArray',
        '/icofabric/connectors': 'Marker',
        '/icofabric/icosahedra': 'Marker'}
    for _, topic in topics.values():
        assert topic['Reliability Policy'] == 'Reliable'


@pytest.fixture(scope='module')
def archives(tmp_path_factory):
    """Names of the files in a wheel and in a source archive, without their first folder."""
    tree = tmp_path_factory.mktemp('archives') / 'tree'
    shutil.copytree(ROOT, tree, ignore=lambda folder, names: [
        name for name in names if name.startswith('.') or name in (
            '__pycache__', 'runs', 'build', 'dist', 'test', 'validation')
        or name.endswith('.egg-info')])
    subprocess.run(
        [sys.executable, 'setup.py', '-q', 'sdist', 'bdist_wheel'], cwd=tree, check=True,
        capture_output=True, text=True, timeout=120)
    wheel, = (tree / 'dist').glob('*.whl')
    source, = (tree / 'dist').glob('*.tar.gz')
    with zipfile.ZipFile(wheel) as archive:
        in_wheel = set(archive.namelist())
    with tarfile.open(source) as archive:
        in_source = {name.partition('/')[2] for name in archive.getnames()}
    return in_wheel, in_source


def shipped(folder):
    """Files of a folder of the tree that users need, by their path in it."""
    return {
        path.relative_to(ROOT).as_posix() for path in (ROOT / folder).rglob('*')
        if path.is_file() and '__pycache__' not in path.parts
        and path.suffix not in ('.pyc', '.nbi', '.nbc')}


def test_a_wheel_and_a_source_archive_hold_what_they_need(archives):
    in_wheel, in_source = archives
    code = shipped('icofabric_sim')
    assert len(code) > 300
    assert not code - in_wheel and not code - in_source
    assert not [name for name in in_wheel | in_source if name.endswith(('.nbc', '.pyc'))]
    shared = {name.partition('/share/')[2] for name in in_wheel if '/share/' in name}
    for folder, kinds in (('config', ''), ('launch', '.launch.py'), ('rviz', '.rviz')):
        files = {name for name in shipped(folder) if name.endswith(kinds)}
        assert files and not files - in_source
        assert not {f'icofabric_sim/{name}' for name in files} - shared
    assert {'icofabric_sim/package.xml',
            'ament_index/resource_index/packages/icofabric_sim'} <= shared
    assert {'LICENSE', 'package.xml', 'setup.py', 'requirements.lock'} <= in_source
    assert [name for name in in_wheel if name.endswith('/LICENSE')]


def test_workers_begin_with_the_files_that_take_longest():
    """Each stands in the list of test/conftest.py once; what is not in it keeps its order."""
    spec = importlib.util.spec_from_file_location('order_of_files', ROOT / 'test' / 'conftest.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    names = module.LONG_FILES
    assert len(set(names)) == len(names) > 30
    assert [name for name in names if not (ROOT / 'test' / f'{name}.py').exists()
            and not (ROOT / f'{name}.py').exists()] == []

    given = ['test_rooms', 'test_package', names[1], 'test_figures', names[0]]

    def order(**config):
        items = [SimpleNamespace(
            path=ROOT / 'test' / f'{name}.py', name='test_it', fixturenames=(), module=pytest)
            for name in given]
        module.pytest_collection_modifyitems(SimpleNamespace(**config), items)
        return [item.path.relative_to(ROOT / 'test').with_suffix('').as_posix() for item in items]

    assert order() == given
    assert order(workerinput={}) == [
        names[0], names[1], 'test_rooms', 'test_package', 'test_figures']
