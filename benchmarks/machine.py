# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
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
