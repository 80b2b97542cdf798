# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Describe the machine that figures were measured on: printed above every table."""

from collections.abc import Iterable
from importlib import import_module, metadata
import os
from pathlib import Path
import platform
import sys
from typing import Any

# What a thread count is called by the libraries that the tools are built on.
THREAD_VARIABLES = (
    'OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS', 'BLIS_NUM_THREADS',
    'NUMBA_NUM_THREADS')
# Flag of the processor, and width of its vectors; the widest first.
_WIDTHS = (('avx512f', 'AVX-512'), ('avx2', 'AVX2'), ('avx', 'AVX'), ('sse2', 'SSE2'))


def use_one_thread() -> None:
    """Have all libraries that are loaded from now on compute with one thread."""
    for name in THREAD_VARIABLES:
        os.environ[name] = '1'


def processor() -> tuple[str, str]:
    """Name of the processor, and the width of its vectors."""
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
    """Names and versions of what is installed of these."""
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
    """Return the module; end with a line that says how to get it where it is missing."""
    try:
        return import_module('mujoco')
    except ImportError:
        sys.exit('MuJoCo is not installed: .venv/bin/pip install mujoco')
