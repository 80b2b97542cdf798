# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Judges of random scenes in other processes, where a crash or a hang can be observed.

A process judges one scene after another and keeps its kernels. A process that dies or does not
receive in time is replaced.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
import ctypes
from multiprocessing import connection, get_context
from multiprocessing.connection import Connection
import os
import signal
import threading
import time
from typing import Final, NamedTuple

from icofabric_sim.process.compile_notice import compile_notice
from icofabric_validation.stress.judge import judge
from icofabric_validation.stress.scenes import draw_scene, kind_of, StressScene
from icofabric_validation.stress.verdict import Finding, Verdict

# Wall time [s] without compiling after which a scene hangs, and the limit of one compilation.
HANG_TIME_S: Final = 240.0
_MAX_COMPILE_TIME_S = 600.0
# Wall time [s] between reports of a process on its compiler.
_REPORT_PERIOD_S = 0.5
# Wall time [s] in which a crashed process must end.
_EXIT_TIME_S = 60.0
# Kernels of a kind take about 80 MB, so a process ends after this number of kinds.
_KINDS_PER_PROCESS = 10
# PR_SET_PDEATHSIG of prctl(2).
_END_WITH_PARENT = 1

Judge = Callable[[StressScene], Finding]


class _CompilerReport(NamedTuple):
    """A report of a process on its compiler."""

    compiled: float  # wall time [s] of the compiler so far
    compiles: bool  # now


class _Worker:
    """One process and its scene."""

    def __init__(self, judge_one: Judge) -> None:
        context = get_context('spawn')
        self.connection, theirs = context.Pipe()
        self._process = context.Process(
            target=_serve, args=(theirs, judge_one), name='judge', daemon=True)
        self._process.start()
        theirs.close()
        self.scene: StressScene | None = None
        self.kinds: set[int] = set()
        self._began = self._compiled = 0.0
        self._report: _CompilerReport | None = None  # None until the process is ready

    def begin(self, scene: StressScene) -> None:
        self.scene = scene
        self.kinds.add(scene.kind)
        self._began = time.monotonic()
        self._compiled = 0.0 if self._report is None else self._report.compiled
        with suppress(OSError):
            # The closed pipe of a dead process is found by `receive`.
            self.connection.send(scene)

    def receive(self) -> Finding | None:
        """Return a finding, or None for a report; raise EOFError if the process has ended."""
        message = self.connection.recv()
        if isinstance(message, _CompilerReport):
            if self._report is None:
                self._began = time.monotonic()
            self._report = message
            return None
        self.scene = None
        return message  # type: ignore[no-any-return]

    def hangs(self, limit: float) -> bool:
        if self.scene is None:
            return False
        taken = time.monotonic() - self._began
        if self._report is None:
            return taken > _MAX_COMPILE_TIME_S
        taken -= self._report.compiled - self._compiled
        return taken > limit + (_MAX_COMPILE_TIME_S if self._report.compiles else 0.0)

    def end(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.join()
        self.connection.close()

    def wait_for_exit(self) -> str:
        """Wait for a process that is ending, and return how it ended."""
        # The pipe closes before the system has written a core file.
        self._process.join(_EXIT_TIME_S)
        code = self._process.exitcode
        self.end()
        if code is None:
            return f'the process closed its pipe, and did not end within {_EXIT_TIME_S:g} s'
        if code < 0:
            return f'the process was ended by {signal.Signals(-code).name}'
        return f'the process ended with {code}'


def judge_all(
    seeds: Iterable[int], *, processes: int, judge_one: Judge = judge,
    hangs_after: float = HANG_TIME_S
) -> Iterator[Finding]:
    """
    Judge the scenes of `seeds`, and yield findings in order of completion.

    One process after another judges the scenes of a kind. Other processes call `judge_one`, which
    must therefore be a function of a module.
    """
    scenes = (draw_scene(seed) for seed in sorted(seeds, key=lambda seed: (kind_of(seed), seed)))
    yield from judge_scenes(
        scenes, processes=processes, judge_one=judge_one, hangs_after=hangs_after)


def judge_scenes(
    scenes: Iterable[StressScene], *, processes: int, judge_one: Judge = judge,
    hangs_after: float = HANG_TIME_S
) -> Iterator[Finding]:
    """Judge scenes, and yield findings in order of completion."""
    queues = _queues(scenes)
    workers: list[_Worker] = []
    try:
        while queues or any(worker.scene is not None for worker in workers):
            while queues and len(workers) < processes:
                workers.append(_Worker(judge_one))
            for worker in list(workers):
                if worker.scene is None and not _give_scene(worker, queues):
                    worker.end()
                    workers.remove(worker)
            busy = {worker.connection: worker for worker in workers}
            ready = connection.wait(list(busy), _REPORT_PERIOD_S)
            for one in ready:
                assert isinstance(one, Connection)
                worker = busy[one]
                try:
                    finding = worker.receive()
                except (EOFError, OSError):
                    workers.remove(worker)
                    yield _lost_finding(worker, Verdict.CRASH, worker.wait_for_exit())
                else:
                    if finding is not None:
                        yield finding
            for worker in list(workers):
                if worker.hangs(hangs_after):
                    workers.remove(worker)
                    worker.end()
                    yield _lost_finding(worker, Verdict.HANG, _hang_text(hangs_after))
    finally:
        for worker in workers:
            worker.end()


class Referee:
    """One process that judges scenes on request."""

    def __init__(self, judge_one: Judge = judge, *, hangs_after: float = HANG_TIME_S) -> None:
        """Prepare; the process starts with the first scene."""
        self._judge_one, self._hangs_after = judge_one, hangs_after
        self._worker: _Worker | None = None

    def judge(self, scene: StressScene) -> Finding:
        """Return the finding of one scene."""
        worker = self._worker = self._worker or _Worker(self._judge_one)
        worker.begin(scene)
        while True:
            if worker.connection.poll(_REPORT_PERIOD_S):
                try:
                    finding = worker.receive()
                except (EOFError, OSError):
                    self._worker = None
                    return _lost_finding(worker, Verdict.CRASH, worker.wait_for_exit())
                if finding is not None:
                    return finding
            if worker.hangs(self._hangs_after):
                self.close()
                return _lost_finding(worker, Verdict.HANG, _hang_text(self._hangs_after))

    def close(self) -> None:
        """End the process."""
        if self._worker is not None:
            self._worker.end()
            self._worker = None


def _hang_text(limit: float) -> str:
    return f'no receive within {limit:g} s of wall time'


def _queues(scenes: Iterable[StressScene]) -> 'deque[deque[StressScene]]':
    """Group scenes by kind, so that one process at a time compiles the kernels of a kind."""
    found: dict[int, deque[StressScene]] = {}
    for scene in scenes:
        found.setdefault(scene.kind, deque()).append(scene)
    return deque(found.values())


def _give_scene(worker: _Worker, queues: 'deque[deque[StressScene]]') -> bool:
    """Give a worker a scene of a known or a new kind; return False if it should end."""
    for queue in queues:
        if queue[0].kind in worker.kinds:
            break
    else:
        if not queues or len(worker.kinds) >= _KINDS_PER_PROCESS:
            return False
        queue = queues[0]
        # Other workers start with another kind.
        queues.rotate(-1)
    worker.begin(queue.popleft())
    if not queue:
        queues.remove(queue)
    return True


def _lost_finding(worker: _Worker, verdict: Verdict, detail: str) -> Finding:
    scene = worker.scene
    assert scene is not None
    return Finding(scene.seed, scene.kind, verdict, detail)


def _serve(connection: Connection, judge_one: Judge) -> None:
    """Answer scenes with findings until the other end is closed."""
    # The parent handles interrupts and ends this process; the death of the parent ends it too.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    ctypes.CDLL(None).prctl(_END_WITH_PARENT, signal.SIGTERM)
    # Kernels are compiled on demand.
    os.environ['ICOFABRIC_COMPILE_AHEAD'] = '0'
    lock = threading.Lock()

    def send_reports() -> None:
        with suppress(OSError):
            while True:
                with lock:
                    connection.send(_CompilerReport(
                        compile_notice.seconds, compile_notice.is_compiling))
                time.sleep(_REPORT_PERIOD_S)

    threading.Thread(target=send_reports, daemon=True).start()
    with suppress(EOFError, OSError):
        while True:
            finding = judge_one(connection.recv())
            with lock:
                connection.send(finding)
