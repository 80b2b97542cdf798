# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""What a figure was measured on: printed above every table; and what a script needs."""

from importlib import import_module, metadata
import os
import platform
import sys
from typing import Any


def describe_machine() -> str:
    """Processor, cores and versions in one line."""
    name = 'unknown processor'
    with open('/proc/cpuinfo', encoding='utf-8') as file:
        for line in file:
            if line.startswith('model name'):
                name = line.split(':', 1)[1].strip()
                break
    versions = ', '.join(f'{item} {metadata.version(item)}' for item in ('numpy', 'numba'))
    cores = len(os.sched_getaffinity(0))
    return f'{name}, {cores} cores, Python {platform.python_version()}, {versions}'


def import_mujoco() -> Any:
    """Return the module; end with a line that says how to get it where it is missing."""
    try:
        return import_module('mujoco')
    except ImportError:
        sys.exit('MuJoCo is not installed: .venv/bin/pip install mujoco')
