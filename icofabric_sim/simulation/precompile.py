# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Kernels that a run may come to, compiled by another process while it goes on without them.

A scene whose shells cannot touch yet is compiled without contact; the first contact would then
hold the run up for as long as the compiler takes, and so would the first input, which ends a step
of its own length. So where they are not on disk a process of lowest priority makes them ready; the
run finds them there. It ends with the one that began it. ICOFABRIC_COMPILE_AHEAD=0 in the
environment forbids it.

A live run never compiles or loads them itself: a thread waits for that process and loads what it
has made (`ContactKernels`). If shells meet before, simulated time waits.
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

# A larger scene would be built once more beside the first.
LARGEST = 20_000
# What is being compiled, by its likely kind, the oldest first. A parameter that is moved by hand
# builds the scene many times a second.
_processes: dict[object, subprocess.Popen[bytes]] = {}
_MOST = 2
# Processes that a thread waits for.
_awaited: set[subprocess.Popen[bytes]] = set()
# A forked child leaves the processes of its parent alone.
os.register_at_fork(after_in_child=_processes.clear)
os.register_at_fork(after_in_child=_awaited.clear)
_LOWEST = 19  # priority
# So often a process is begun for the same kernels.
_TRIES = 3
# Parameters whose terms are in every kind of kernels.
_NO_KIND = ('gravity', 'groups.', 'loads.', 'supports.')
# This process ends: nothing more is compiled.
_ending = threading.Event()


def may_compile_elsewhere(scene: Scene) -> bool:
    """Whether another process may compile for a scene."""
    return (
        os.environ.get('ICOFABRIC_COMPILE_AHEAD', '1') != '0' and scene.body_count <= LARGEST)


def compile_ahead(
    scene: Scene, *, method: str, present: str, rotation: str
) -> subprocess.Popen[bytes] | None:
    """
    Begin to compile the kernels that a scene may come to, in another process.

    By `method` once something touches, by the `present` one until then.
    Returns the process that does it; None where there is none.
    """
    if not may_compile_elsewhere(scene):
        return None
    # What the present scene lacks first: there is less of it.
    given = scene.parameters.given()
    kinds = [{**given, **changes} for changes in kinds_of_steps(
        method, present=present, may_touch=given.get('contact.mode', 'auto') == 'auto')]
    task = pickle.dumps((kinds, rotation, _LOWEST))
    # Those that have ended are taken note of, so that none of them stays behind.
    for key in [key for key, process in _processes.items() if process.poll() is not None]:
        del _processes[key]
    # Which terms there are makes a kind, and words; how large numbers are does not.
    kind = (rotation, *sorted(
        (name, value if isinstance(value, (str, bool)) else bool(np.any(value)))
        for name, value in given.items() if not name.startswith(_NO_KIND)))
    if kind in _processes:
        return _processes[kind]
    while len(_processes) >= _MOST:
        oldest = _processes.pop(next(iter(_processes)))
        oldest.kill()
        oldest.wait()
    process = _begin(task)
    if process is not None:
        _processes[kind] = process
    return process


def compile_elsewhere(scene: Scene) -> None:
    """
    Have another process compile what a scene needs, and wait for it.

    Where there is none nothing is done: then the caller compiles, and holds up other threads.
    """
    if not may_compile_elsewhere(scene):
        return
    process = _begin(pickle.dumps(([scene.parameters.given()], 'quaternion', 0)))
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
    """Count the time of the block as compiling: it waits for another process or thread."""
    try:
        compile_notice.begin(kept=True)
        yield
    finally:
        compile_notice.end()


def _begin(task: bytes) -> subprocess.Popen[bytes] | None:
    """Begin a process with its task; None where that is not possible: the run goes on."""
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
    Changes that give a scene as a run may come to it, in the order of what is needed first.

    `method`: that of steps in which something touches, and of those after it; `present`: the one
    until then. Where it is another one the first one's steps never touch anything.
    """
    kinds: list[dict[str, Any]] = [{}]
    if may_touch:
        kinds.append(touching(method))
        if method != present:
            # Shells are apart again.
            kinds.append({'solver.method': method})
    return kinds


def touching(method: str) -> dict[str, Any]:
    """Changes that give a scene as it is from the first contact on, by the `method` it has."""
    return {'contact.mode': 'always', 'solver.method': method}


class ContactKernels:
    """The kernels that one simulation may come to, made ready in a thread."""

    def __init__(
        self, process: 'subprocess.Popen[bytes] | None',
        begin: Callable[[], 'subprocess.Popen[bytes] | None'], make_ready: Callable[[], object],
        on_ready: Callable[[], object] = lambda: None,
    ) -> None:
        """
        Wait for the `process` that compiles them, if there is one, and call `make_ready`.

        That loads them. A process that was ended for another one is begun again, by `begin`.
        """
        self._process, self._begin = process, begin
        self._make_ready, self._on_ready = make_ready, on_ready
        self._began, self._is_hurried = time.monotonic(), False
        self._is_given_up = False
        self._thread = threading.Thread(target=self._work, name='kernels', daemon=True)
        self._thread.start()

    @property
    def are_ready(self) -> bool:
        """Whether nothing is done for them any more."""
        return not self._thread.is_alive()

    @property
    def seconds(self) -> float:
        """Wall time [s] since they were asked for."""
        return time.monotonic() - self._began

    def wait(self) -> None:
        """Wait until they are ready."""
        self.hurry()
        self._thread.join()

    def hurry(self) -> None:
        """
        Have the process work at normal priority: the run waits for it.

        Systems allow that to root, and where RLIMIT_NICE does; others leave it as it is.
        """
        self._is_hurried = True
        if self._process is not None and self._process.poll() is None:
            with suppress(OSError):
                os.setpriority(os.PRIO_PROCESS, self._process.pid, 0)

    def give_up(self) -> None:
        """Another simulation runs now: this process loads nothing more for this one."""
        self._is_given_up = True

    def _work(self) -> None:
        try:
            self._load()
        finally:
            self._on_ready()

    def _load(self) -> None:
        for _ in range(_TRIES):
            if self._process is not None:
                self._process.wait()
            if _ending.is_set() or self._is_given_up:
                return
            # Whatever else is wrong is said where it is needed.
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
        # It could not be done by another process, or not all of it.
        with suppress(Exception):
            self._make_ready()


def _environment() -> dict[str, str]:
    """Return an environment in which the process compiles for what this one does."""
    native = {} if target().level else {'ICOFABRIC_NATIVE': '1'}
    return {**os.environ, **native}


@atexit.register
def _end() -> None:
    _ending.set()
    end_compiling()
    for process in (*_processes.values(), *_awaited):
        process.kill()
        process.wait()
