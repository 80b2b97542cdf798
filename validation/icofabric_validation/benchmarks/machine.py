# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Description of the machine, which is printed above every table."""

from collections.abc import Iterable
from importlib import import_module, metadata
import os
from pathlib import Path
import platform
import sys
from typing import Any

# Environment variables for the number of threads of libraries.
THREAD_VARIABLES = (
    'OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS', 'BLIS_NUM_THREADS',
    'NUMBA_NUM_THREADS')
# Flag of the processor, and width of its vectors; the widest first.
_WIDTHS = (('avx512f', 'AVX-512'), ('avx2', 'AVX2'), ('avx', 'AVX'), ('sse2', 'SSE2'))


def use_one_thread() -> None:
    """Limit all libraries that are imported later to one thread."""
    for name in THREAD_VARIABLES:
        os.environ[name] = '1'


def processor() -> tuple[str, str]:
    """Return the name of the processor, and the width of its vectors."""
    name, flags = platform.machine() or 'unknown processor', set()
    try:
        text = Path('/proc/cpuinfo').read_text(encoding='utf-8')
    except OSError:
        text = ''
    for line in text.splitlines():
        key, _, value = line.partition(':')
        if key.strip() == 'model name':
            name = value.strip()
        elif key.strip() == 'flags':
            flags = set(value.split())
    return name, next((width for flag, width in _WIDTHS if flag in flags), 'unknown vectors')


def versions(distributions: Iterable[str]) -> str:
    """Return names and versions of the installed distributions among `distributions`."""
    found = []
    for name in distributions:
        try:
            found.append(f'{name} {metadata.version(name)}')
        except metadata.PackageNotFoundError:
            continue
    return ', '.join(found)


def machine_lines(
    distributions: Iterable[str], *, threads: str = 'one thread each'
) -> list[str]:
    """Return lines with processor, vectors, cores and load, then versions."""
    from icofabric_sim.version import __version__
    name, width = processor()
    cores = len(os.sched_getaffinity(0))
    load = os.getloadavg()[0]
    return [
        f'{name}, {width}, {cores} cores (load {load:.1f} at the start), {threads}',
        f'icofabric_sim {__version__}, Python {platform.python_version()}, '
        + versions(('numpy', 'numba', *distributions))]


def describe_machine() -> str:
    """Return processor, cores and versions in one line."""
    cores = len(os.sched_getaffinity(0))
    return (f'{processor()[0]}, {cores} cores, Python {platform.python_version()}, '
            + versions(('numpy', 'numba')))


def import_mujoco() -> Any:
    """Import MuJoCo; exit with the install command if it is missing."""
    try:
        return import_module('mujoco')
    except ImportError:
        sys.exit('MuJoCo is not installed: .venv/bin/pip install mujoco')
