# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Build a wheel with compiled kernels for this Python, numba and llvmlite: `make wheel`.

    .venv/bin/python .ci/wheel.py hanging_slab free_slab

The kernels of the scenes, by default those of `icofabric warm`, are compiled from an empty cache
for each level of x86-64 that this processor can run. setup.py adds the folder of compiled kernels
to the wheel, and the versions that the kernels need to the requirements. Parts, from which the
kernels of other scenes are linked, take ten times as much space and are left out by default.
"""

import argparse
from importlib.metadata import version
import os
from pathlib import Path
import pickle
import shutil
import subprocess
import sys

ROOT = Path(__file__).resolve().parents[1]
# The files that a wheel is built from.
_PARTS = (
    'LICENSE', 'config', 'icofabric_sim', 'launch', 'package.xml', 'pyproject.toml', 'resource',
    'rviz', 'setup.cfg', 'setup.py')
# The compiled kernels depend on these packages in this version.
_PINNED = ('numba', 'llvmlite')


def compile_kernels(folder: Path, scenes: list[str]) -> Path:
    """Compile the kernels of `scenes` for each level; return the folder of this source."""
    from icofabric_sim.kernels.runtime.disk_cache import stamp_folder_name
    from icofabric_sim.kernels.runtime.target import host_levels, LEVELS, settings_of

    environment = {
        name: value for name, value in os.environ.items()
        if not name.startswith(('NUMBA_', 'ICOFABRIC_'))}
    levels = host_levels()
    if not levels:
        raise SystemExit('this processor has no level of x86-64 from 3 on: no kernels to compile')
    for level in LEVELS:
        if level not in levels:
            print(f'{level} is left out, because this processor cannot run its kernels')
            continue
        print(f'{level}:', flush=True)
        subprocess.run(
            [sys.executable, '-m', 'icofabric_sim.commands.main', 'warm', *scenes], check=True,
            env={**environment, **settings_of(level), 'NUMBA_CACHE_DIR': str(folder)})
    return folder / 'icofabric_sim' / stamp_folder_name()


def is_part(entry: Path) -> bool:
    """Return True if an entry of the cache is a part, which is linked into kernels only."""
    library, *_ = pickle.loads(entry.read_bytes())
    _, kind, _ = library
    return kind == 'part'


def build(scenes: list[str], output: Path, *, parts: bool = False) -> Path:
    """Build the wheel in the folder `output` and return its path."""
    work = ROOT / 'build' / 'wheel'
    shutil.rmtree(work, ignore_errors=True)
    kernels = compile_kernels(work / 'cache', scenes)
    tree = work / 'tree'
    ignored = shutil.ignore_patterns('__pycache__', '*.lock')
    tree.mkdir(parents=True)
    for part in _PARTS:
        if (ROOT / part).is_dir():
            shutil.copytree(ROOT / part, tree / part, ignore=ignored)
        else:
            shutil.copy2(ROOT / part, tree / part)
    compiled = tree / 'icofabric_sim' / 'kernels' / 'compiled'
    shutil.copytree(kernels, compiled / kernels.name, ignore=ignored)
    if not parts:
        # An index may name an entry without a file: such an entry is compiled.
        for entry in compiled.rglob('*.nbc'):
            if is_part(entry):
                entry.unlink()
    (compiled / 'requirements.txt').write_text(
        ''.join(f'{name}=={version(name)}\n' for name in _PINNED))
    subprocess.run(
        [sys.executable, '-m', 'pip', '--disable-pip-version-check', 'wheel', '--quiet',
         '--no-deps', '--no-build-isolation', '--wheel-dir', str(work / 'dist'), str(tree)],
        check=True)
    wheel, = (work / 'dist').glob('*.whl')
    output.mkdir(parents=True, exist_ok=True)
    return Path(shutil.copy2(wheel, output))


def main(arguments: list[str]) -> None:
    """Build the wheel that the arguments describe."""
    parser = argparse.ArgumentParser(
        description='Build a wheel with the compiled kernels of scenes.')
    parser.add_argument(
        'scenes', metavar='SCENE', nargs='*',
        help='example scenes or parameter files (default: those of `icofabric warm`)')
    parser.add_argument(
        '--output', type=Path, default=ROOT / 'dist', metavar='FOLDER',
        help='folder of the wheel (default: dist)')
    parser.add_argument(
        '--parts', action='store_true',
        help='also contain the parts from which kernels of other scenes are linked')
    chosen = parser.parse_args(arguments)
    wheel = build(chosen.scenes, chosen.output, parts=chosen.parts)
    print(f'{wheel} ({wheel.stat().st_size / 1e6:.0f} MB)')


if __name__ == '__main__':
    main(sys.argv[1:])
