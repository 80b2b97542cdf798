# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`make wheel`: a wheel with compiled kernels, which a fresh environment runs at once."""

from importlib.metadata import version
import importlib.util
import json
import os
from pathlib import Path
import pickle
import subprocess
import sys
import zipfile

from icofabric_sim.kernels.runtime.target import host_levels, settings_of
import pytest

ROOT = Path(__file__).resolve().parents[1]
SCENE = 'free_slab'


@pytest.fixture
def wheel_builder(tmp_path, monkeypatch):
    """The module .ci/wheel.py, for a copy of the tree."""
    spec = importlib.util.spec_from_file_location('wheel_builder', ROOT / '.ci' / 'wheel.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    tree = tmp_path / 'tree'
    tree.mkdir()
    for part in module._PARTS:
        (tree / part).symlink_to(ROOT / part)
    monkeypatch.setattr(module, 'ROOT', tree)
    return module


def entries(folder, scenes):
    """Write an index, a kernel, a part and a lock as a cache has them."""
    cache = folder / 'icofabric_sim' / '0123456789abcdef' / 'kernels'
    cache.mkdir(parents=True)
    (cache / 'some-1.py311.nbi').write_text(' '.join(scenes))
    for kind in ('kernel', 'part'):
        (cache / f'{kind}.nbc').write_bytes(pickle.dumps((('name', kind, b'code'), None)))
    (cache / 'icofabric.lock').touch()
    return cache.parent


@pytest.mark.parametrize('parts', [False, True])
def test_a_wheel_lists_its_kernels_and_pins_the_compiler(
        parts, wheel_builder, tmp_path, monkeypatch):
    monkeypatch.setattr(wheel_builder, 'compile_kernels', entries)
    wheel_builder.main([SCENE, '--output', str(tmp_path / 'dist'), *['--parts'] * parts])
    path, = (tmp_path / 'dist').iterdir()
    tag = f'cp{sys.version_info[0]}{sys.version_info[1]}'
    assert f'-{tag}-{tag}-linux_' in path.name
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
        record, = (name for name in names if name.endswith('/RECORD'))
        metadata, = (name for name in names if name.endswith('/METADATA'))
        recorded = archive.read(record).decode()
        required = archive.read(metadata).decode().splitlines()
        folder = 'icofabric_sim/kernels/compiled'
        assert archive.read(f'{folder}/0123456789abcdef/kernels/some-1.py311.nbi') == b'free_slab'
    found = {Path(name).name for name in names if name.startswith(folder)}
    assert found == {
        'some-1.py311.nbi', 'kernel.nbc', 'requirements.txt', *['part.nbc'] * parts}
    assert all(f'{folder}/' in recorded and name in recorded for name in found)
    for name in ('numba', 'llvmlite'):
        assert f'Requires-Dist: {name}=={version(name)}' in required
    # A clone has no compiled kernels: another wheel of this tree is for any Python.
    assert not (ROOT / folder).exists()


MOTION = """
import hashlib, json, sys, time
begun = time.perf_counter()
import icofabric_sim as ico
from icofabric_sim.parameters.file import load_parameter_file
from icofabric_sim.process.compile_notice import compile_notice
compile_notice.is_forbidden = sys.argv[2] == 'forbidden'
scene = ico.Scene.from_parameters(load_parameter_file(sys.argv[1]))
simulation = ico.compile_scene(scene)
simulation.advance_to(1e-3)
simulation.snapshot()
first = time.perf_counter() - begun
simulation.advance_to(0.1)
snapshot, digest = simulation.snapshot(), hashlib.sha256()
for name in ('position', 'orientation', 'linear_velocity', 'angular_velocity'):
    digest.update(getattr(snapshot, name).tobytes())
assert abs(snapshot.linear_velocity).max() > 0.0
print(json.dumps([ico.__file__, digest.hexdigest(), first]))
"""


def motion(package, compiling, home, **changes):
    """Run the scene with the package in a folder; return the motion and seconds to a pose."""
    environment = {
        name: value for name, value in os.environ.items()
        if not name.startswith(('NUMBA_', 'ICOFABRIC_', 'XDG_'))}
    environment |= {
        'HOME': str(home), 'PYTHONPATH': str(package), 'ICOFABRIC_COMPILE_AHEAD': '0', **changes}
    done = subprocess.run(
        [sys.executable, '-c', MOTION, str(ROOT / 'config' / f'{SCENE}.yaml'), compiling],
        env=environment, capture_output=True, text=True, timeout=900, cwd=home)
    assert done.returncode == 0, done.stderr
    used, digest, seconds = json.loads(done.stdout)
    assert Path(used).is_relative_to(package)
    return digest, seconds


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_a_wheel_and_a_clone_give_the_same_bits(wheel_builder, tmp_path):
    """The wheel compiles nothing, and its first pose is there within 3 s."""
    wheel_builder.main([SCENE, '--output', str(tmp_path / 'dist')])
    path, = (tmp_path / 'dist').iterdir()
    installed = tmp_path / 'installed'
    with zipfile.ZipFile(path) as archive:
        archive.extractall(installed)
    levels = host_levels()
    assert levels
    for level in levels:
        homes = [tmp_path / f'{who}-{level}' for who in ('wheel', 'clone')]
        for home in homes:
            home.mkdir()
        # Numba has read the bytecode of its own modules once.
        motion(installed, 'forbidden', homes[0], **settings_of(level))
        shipped, seconds = motion(installed, 'forbidden', homes[0], **settings_of(level))
        assert seconds < 3.0
        assert not list(homes[0].rglob('*.nbc'))
        cloned, _ = motion(ROOT, 'allowed', homes[1], **settings_of(level))
        assert list(homes[1].rglob('*.nbc'))
        assert shipped == cloned
