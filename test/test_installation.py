# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Installs of the package follow each other in any order, and make repairs its own."""
import os
from pathlib import Path
import shutil
import subprocess
import sys
import sysconfig

ROOT = Path(__file__).resolve().parents[1]
PARTS = ('.ci', 'LICENSE', 'MANIFEST.in', 'Makefile', 'config', 'icofabric_sim', 'launch',
         'package.xml', 'pyproject.toml', 'requirements.lock', 'requirements.txt', 'resource',
         'rviz', 'setup.cfg', 'setup.py', 'validation')
# What `icofabric --version` does without: to build and copy it takes most of the time.
LEFT_OUT = shutil.ignore_patterns(
    '__pycache__', 'bag', 'benchmarks', 'geometry', 'messages', 'named', 'pictures', 'ros',
    'running', 'scene', 'simulation', 'statics', 'stress', 'sweeps', 'test', 'viewer')
MODULE = 'icofabric_sim.process.compile_notice'
LIBRARIES = sysconfig.get_path('purelib')


class Clone:
    """A copy of the tree with a virtual environment in it, which borrows the libraries of this."""

    def __init__(self, folder):
        self.folder = folder
        for part in PARTS:
            if (ROOT / part).is_dir():
                shutil.copytree(ROOT / part, folder / part, ignore=LEFT_OUT)
            else:
                shutil.copy(ROOT / part, folder / part)
        self.environment = folder / '.venv'
        subprocess.run(
            [sys.executable, '-m', 'venv', '--without-pip', self.environment], check=True)
        site, = self.environment.glob('lib/python*/site-packages')
        self.installed = site / 'icofabric_sim'
        # What is named so is searched for packages, but not for links of editable installs.
        (site / 'borrowed.pth').write_text(f'{LIBRARIES}\n')

    def run(self, *words, cwd=None):
        environment = {
            name: value for name, value in os.environ.items() if not name.startswith('PYTHON')}
        done = subprocess.run(
            words, cwd=cwd or self.folder, env=environment, capture_output=True, text=True,
            check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def pip(self, *words):
        self.run(self.environment / 'bin' / 'python', '-m', 'pip', 'install', '--no-index',
                 '--no-build-isolation', '--no-deps', '--no-compile', *words)

    def mark_ready(self):
        """Leave what `.ci/environment` writes once all is installed."""
        of_package = '{.,validation}/{pyproject.toml,setup.py,setup.cfg,package.xml}'
        for mark, files in (
                ('run', 'requirements.txt requirements.lock'), ('package', of_package)):
            key = self.run('bash', '-c', f'{{ pwd; cat {files}; }} | cksum')
            (self.environment / f'.ready-{mark}').write_text(key)

    def imported(self):
        """Return the folder that Python imports the package from, in another folder."""
        assert 'icofabric_sim' in self.run(
            self.environment / 'bin' / 'icofabric', '--version', cwd='/')
        return Path(self.run(
            self.environment / 'bin' / 'python', '-c',
            f'import {MODULE} as module; print(module.__file__)', cwd='/').strip()).parents[1]

    def leave_remnants(self):
        """Leave what older versions and `python -O` write into a plain install."""
        for folder in ('', 'kernels', 'kernels/runtime'):
            cache = self.installed / folder / '__pycache__'
            cache.mkdir(parents=True, exist_ok=True)
            (cache / 'of_none.nbi').write_text('')


def test_installs_follow_each_other_in_any_order(tmp_path):
    clone = Clone(tmp_path)
    own = clone.folder / 'icofabric_sim'
    clone.pip('.')
    assert clone.imported() == clone.installed
    clone.leave_remnants()
    clone.pip('-e', '.[sweep]')
    assert clone.installed.is_dir() and clone.imported() == own
    clone.pip('.[sweep]')
    assert clone.imported() == clone.installed
    # Make mends that, and what remains of it.
    clone.mark_ready()
    clone.leave_remnants()
    assert 'again' in clone.run('.ci/environment', 'run')
    assert clone.imported() == own and not clone.installed.exists()
    assert not clone.run('.ci/environment', 'run')


def test_numba_writes_nothing_into_the_package():
    """Its own cache lies beside the source; a remnant there would shadow an editable install."""
    texts = {path: path.read_text() for path in (ROOT / 'icofabric_sim').rglob('*.py')}
    assert len(texts) > 400
    assert [path for path, text in texts.items() if 'cache=True' in text] == []
