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
"""
Kernels with contact, compiled by another process while a run goes on without it.

A scene whose shells cannot touch yet is compiled without contact; the first contact would then
hold the run up for as long as the compiler takes. So where they are not on disk a process of
lowest priority makes them ready; the run finds them there. It ends with the one that began it.
ICOFABRIC_COMPILE_AHEAD=0 in the environment forbids it.
"""

import atexit
from contextlib import suppress
import os
import pickle
import subprocess
import sys

from icofabric_sim.kernels.runtime.target import target
from icofabric_sim.scene.scene import Scene
import numpy as np

# A larger scene would be built once more beside the first.
_LARGEST = 20_000
# What is being compiled, by its likely kind, the oldest first. A parameter that is moved by hand
# builds the scene many times a second.
_processes: dict[object, subprocess.Popen[bytes]] = {}
_MOST = 2


def compile_contact_ahead(
    scene: Scene, *, method: str, rotation: str, body_wrenches: bool
) -> None:
    """Begin to compile the kernels with contact of a scene, in another process."""
    if os.environ.get('ICOFABRIC_COMPILE_AHEAD', '1') == '0' or scene.body_count > _LARGEST:
        return
    given = {
        **scene.parameters.given(), 'contact.mode': 'always', 'solver.method': method}
    task = pickle.dumps((given, rotation, body_wrenches))
    # Those that have ended are taken note of, so that none of them stays behind.
    for key in [key for key, process in _processes.items() if process.poll() is not None]:
        del _processes[key]
    # Which terms there are makes a kind, and words; how large numbers are does not.
    kind = (rotation, body_wrenches, *sorted(
        (name, value if isinstance(value, (str, bool)) else bool(np.any(value)))
        for name, value in given.items()))
    if kind in _processes:
        return
    while len(_processes) >= _MOST:
        oldest = _processes.pop(next(iter(_processes)))
        oldest.kill()
        oldest.wait()
    # The run goes on where the process cannot be started.
    with suppress(OSError):
        process = subprocess.Popen(
            [sys.executable, '-m', 'icofabric_sim.simulation.precompile_process'],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            start_new_session=True, env=_environment())
        if not _processes:
            atexit.register(_end)
        _processes[kind] = process
        if process.stdin is not None:
            with process.stdin as pipe:
                pipe.write(task)


def _environment() -> dict[str, str]:
    """Return an environment in which the process compiles for what this one does."""
    native = {} if target().level else {'ICOFABRIC_NATIVE': '1'}
    return {**os.environ, **native}


def _end() -> None:
    for process in _processes.values():
        process.kill()
        process.wait()
