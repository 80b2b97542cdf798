# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Compilation of kernels that a run may need later, in another process beside the run.

A scene whose shells cannot touch yet is compiled without contacts. The first contact would then
interrupt the run for the time of the compilation, and so would the first input, which ends a step
early. If these kernels are not on disk, a process of lowest priority compiles them, and the run
loads them from disk. The process ends with the process that started it. ICOFABRIC_COMPILE_AHEAD=0
in the environment disables this compilation.

A live run never compiles or loads kernels itself: a thread waits for the process and loads the
kernels (`ContactKernels`). If shells touch before, simulated time waits.
"""

import atexit
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import os
import pickle
import subprocess
import sys
import threading
import time
from typing import Any

from icofabric_sim.kernels.runtime.kernel_guard import end_compiling, no_compiling
from icofabric_sim.kernels.runtime.target import target
from icofabric_sim.process.compile_notice import compile_notice, KernelsMissing
from icofabric_sim.scene.scene import Scene
import numpy as np

# Most bodies of a scene that is built a second time to compile its kernels.
MAX_BODY_COUNT = 20_000
# Compiling processes by the estimated kernel variant, the oldest first. A slider of a parameter
# builds the scene many times a second.
_processes: dict[object, subprocess.Popen[bytes]] = {}
_MAX_PROCESS_COUNT = 2
# Processes for which a thread waits.
_awaited: set[subprocess.Popen[bytes]] = set()
# A forked child leaves the processes of its parent alone.
os.register_at_fork(after_in_child=_processes.clear)
os.register_at_fork(after_in_child=_awaited.clear)
_LOWEST_PRIORITY = 19
# Most processes started for the same kernels.
_MAX_TRY_COUNT = 3
# Parameters whose terms are in all kernel variants.
_NO_KIND = ('gravity', 'groups.', 'loads.', 'supports.')
# Set when this process ends: no more compilation.
_ending = threading.Event()


def may_compile_elsewhere(scene: Scene) -> bool:
    """Return True if another process may compile for a scene."""
    is_enabled = os.environ.get('ICOFABRIC_COMPILE_AHEAD', '1') != '0'
    return is_enabled and scene.body_count <= MAX_BODY_COUNT


def compile_ahead(
    scene: Scene, *, method: str, present: str, rotation: str
) -> subprocess.Popen[bytes] | None:
    """
    Start a process that compiles the kernels that a scene may need later.

    `method` is for steps with contacts, `present` for steps before the first contact. Returns the
    process, or None without one.
    """
    if not may_compile_elsewhere(scene):
        return None
    # First the missing kernels of the present scene, which are fewer.
    given = scene.parameters.given()
    kinds = [{**given, **changes} for changes in kinds_of_steps(
        method, present=present, may_touch=given.get('contact.mode', 'auto') == 'auto')]
    task = pickle.dumps((kinds, rotation, False, _LOWEST_PRIORITY))
    # Collect ended processes, so that none remains.
    for key in [key for key, process in _processes.items() if process.poll() is not None]:
        del _processes[key]
    # A kernel variant depends on the terms of a scene and on words, not on magnitudes.
    kind = (rotation, *sorted(
        (name, value if isinstance(value, (str, bool)) else bool(np.any(value)))
        for name, value in given.items() if not name.startswith(_NO_KIND)))
    if kind in _processes:
        return _processes[kind]
    while len(_processes) >= _MAX_PROCESS_COUNT:
        oldest = _processes.pop(next(iter(_processes)))
        oldest.kill()
        oldest.wait()
    process = _begin(task)
    if process is not None:
        _processes[kind] = process
    return process


def compile_elsewhere(scene: Scene, *, is_measured: bool = False) -> None:
    """
    Compile the kernels of a scene in another process, and wait; or those that measure forces.

    Without such a process, return immediately: the caller then compiles and blocks other threads.
    """
    if not may_compile_elsewhere(scene):
        return
    parameters = scene.parameters
    process = _begin(pickle.dumps(
        ([parameters.given()], parameters['solver.rotation'], is_measured, 0)))
    if process is None:
        return
    _awaited.add(process)
    try:
        with counted_as_compiling():
            process.wait()
    finally:
        _awaited.discard(process)
    if _ending.is_set():
        raise RuntimeError('the process ends')


@contextmanager
def counted_as_compiling() -> Iterator[None]:
    """Count the time of the block as compilation, for waits on another process or thread."""
    try:
        compile_notice.begin(kept=True)
        yield
    finally:
        compile_notice.end()


def _begin(task: bytes) -> subprocess.Popen[bytes] | None:
    """Start a process with its task; return None if the process cannot start."""
    with suppress(OSError):
        process = subprocess.Popen(
            [sys.executable, '-m', 'icofabric_sim.simulation.precompile_process'],
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            start_new_session=True, env=_environment())
        if process.stdin is not None:
            with process.stdin as pipe:
                pipe.write(task)
        return process
    return None


def kinds_of_steps(
    method: str, *, present: str, may_touch: bool
) -> 'list[dict[str, Any]]':
    """
    Return changes of a scene for each later kernel variant, the first needed one first.

    `method` is for steps with contacts and afterwards, `present` for steps before. If they differ,
    the present method never computes contacts.
    """
    kinds: list[dict[str, Any]] = [{}]
    if may_touch:
        kinds.append(touching(method))
        if method != present:
            # Shells have separated again.
            kinds.append({'solver.method': method})
    return kinds


def touching(method: str) -> dict[str, Any]:
    """Return changes of a scene for steps with contacts by `method`."""
    return {'contact.mode': 'always', 'solver.method': method}


class ContactKernels:
    """Kernels that a simulation may need later, compiled and loaded by a thread."""

    def __init__(
        self, process: 'subprocess.Popen[bytes] | None',
        begin: Callable[[], 'subprocess.Popen[bytes] | None'], make_ready: Callable[[], object],
        on_ready: Callable[[], object] = lambda: None,
    ) -> None:
        """
        Wait for the `process` that compiles the kernels, if any, and load them by `make_ready`.

        A process that was killed for another scene is restarted by `begin`.
        """
        self._process, self._begin = process, begin
        self._make_ready, self._on_ready = make_ready, on_ready
        self._began, self._is_hurried = time.monotonic(), False
        self._is_given_up = False
        self._thread = threading.Thread(target=self._work, name='kernels', daemon=True)
        self._thread.start()

    @property
    def are_ready(self) -> bool:
        """True if compilation and loading have ended."""
        return not self._thread.is_alive()

    @property
    def seconds(self) -> float:
        """Wall time [s] since the request."""
        return time.monotonic() - self._began

    def wait(self) -> None:
        """Wait until the kernels are ready."""
        self.hurry()
        self._thread.join()

    def hurry(self) -> None:
        """
        Raise the process to normal priority, because the run waits.

        Systems permit this for root or with a suitable RLIMIT_NICE; otherwise the priority is
        unchanged.
        """
        self._is_hurried = True
        if self._process is not None and self._process.poll() is None:
            with suppress(OSError):
                os.setpriority(os.PRIO_PROCESS, self._process.pid, 0)

    def give_up(self) -> None:
        """Load no more kernels, because another simulation has replaced this one."""
        self._is_given_up = True

    def _work(self) -> None:
        try:
            self._load()
        finally:
            self._on_ready()

    def _load(self) -> None:
        for _ in range(_MAX_TRY_COUNT):
            if self._process is not None:
                self._process.wait()
            if _ending.is_set() or self._is_given_up:
                return
            # Other errors are reported when the kernels are used.
            with suppress(Exception):
                try:
                    with no_compiling(loading=True):
                        self._make_ready()
                    return
                except KernelsMissing:
                    if self._process is not None and self._process.returncode == 0:
                        break
                    self._process = self._begin()
                    if self._is_hurried:
                        self.hurry()
        # Another process could not compile all kernels.
        with suppress(Exception):
            self._make_ready()


def _environment() -> dict[str, str]:
    """Return an environment in which the process compiles for the same target as this one."""
    native = {} if target().level else {'ICOFABRIC_NATIVE': '1'}
    return {**os.environ, **native}


@atexit.register
def _end() -> None:
    _ending.set()
    end_compiling()
    for process in (*_processes.values(), *_awaited):
        process.kill()
        process.wait()
