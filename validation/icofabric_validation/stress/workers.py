# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Random scenes judged in other processes: a crash or a hang of one is seen from outside.

A process judges one scene after another and keeps its kernels; one that dies, or says nothing for
too long, is replaced.
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

# Wall time [s] without compiling after which a scene hangs, and of one compilation.
HANGS_AFTER: Final = 240.0
_COMPILES_FOR = 600.0
_BEAT = 0.5
# Wall time [s] for a process that has crashed to be gone.
_GOES_FOR = 60.0
# Kernels of a kind take about 80 MB; a process leaves after so many kinds.
_KINDS_EACH = 10
# PR_SET_PDEATHSIG of prctl(2).
_END_WITH_PARENT = 1

Judge = Callable[[StressScene], Finding]


class _Beat(NamedTuple):
    """What a process says while it works."""

    compiled: float  # wall time [s] of the compiler so far
    compiles: bool  # at present


class _Worker:
    """One process and the scene that it has."""

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
        self._beat: _Beat | None = None  # none before it is ready

    def begin(self, scene: StressScene) -> None:
        self.scene = scene
        self.kinds.add(scene.kind)
        self._began = time.monotonic()
        self._compiled = 0.0 if self._beat is None else self._beat.compiled
        with suppress(OSError):
            # One that has died is found by its end of the pipe.
            self.connection.send(scene)

    def answer(self) -> Finding | None:
        """What has come; None where it is not a finding. EOFError where the process is gone."""
        message = self.connection.recv()
        if isinstance(message, _Beat):
            if self._beat is None:
                self._began = time.monotonic()
            self._beat = message
            return None
        self.scene = None
        return message  # type: ignore[no-any-return]

    def hangs(self, limit: float) -> bool:
        if self.scene is None:
            return False
        taken = time.monotonic() - self._began
        if self._beat is None:
            return taken > _COMPILES_FOR
        taken -= self._beat.compiled - self._compiled
        return taken > limit + (_COMPILES_FOR if self._beat.compiles else 0.0)

    def end(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.join()
        self.connection.close()

    def how_it_ended(self) -> str:
        """Wait for a process that is going, and say how it went."""
        # Its end of the pipe is closed before the system has written all of its memory to a file.
        self._process.join(_GOES_FOR)
        code = self._process.exitcode
        self.end()
        if code is None:
            return f'the process closed its pipe, and went on for {_GOES_FOR:g} s'
        if code < 0:
            return f'the process was ended by {signal.Signals(-code).name}'
        return f'the process ended with {code}'


def judge_all(
    seeds: Iterable[int], *, processes: int, judge_one: Judge = judge,
    hangs_after: float = HANGS_AFTER
) -> Iterator[Finding]:
    """
    Judge the scenes of `seeds`, as they are done; scenes of one kind by one process after another.

    `judge_one` is called in the other processes, so it must be a function of a module.
    """
    scenes = (draw_scene(seed) for seed in sorted(seeds, key=lambda seed: (kind_of(seed), seed)))
    yield from judge_scenes(
        scenes, processes=processes, judge_one=judge_one, hangs_after=hangs_after)


def judge_scenes(
    scenes: Iterable[StressScene], *, processes: int, judge_one: Judge = judge,
    hangs_after: float = HANGS_AFTER
) -> Iterator[Finding]:
    """The same for scenes, in their order."""
    queues = _queues(scenes)
    workers: list[_Worker] = []
    try:
        while queues or any(worker.scene is not None for worker in workers):
            while queues and len(workers) < processes:
                workers.append(_Worker(judge_one))
            for worker in list(workers):
                if worker.scene is None and not _next(worker, queues):
                    worker.end()
                    workers.remove(worker)
            busy = {worker.connection: worker for worker in workers}
            ready = connection.wait(list(busy), _BEAT)
            for one in ready:
                assert isinstance(one, Connection)
                worker = busy[one]
                try:
                    finding = worker.answer()
                except (EOFError, OSError):
                    workers.remove(worker)
                    yield _ended(worker, Verdict.CRASH, worker.how_it_ended())
                else:
                    if finding is not None:
                        yield finding
            for worker in list(workers):
                if worker.hangs(hangs_after):
                    workers.remove(worker)
                    worker.end()
                    yield _ended(worker, Verdict.HANG, _hung(hangs_after))
    finally:
        for worker in workers:
            worker.end()


class Referee:
    """One process for scenes that follow from each other's findings."""

    def __init__(self, judge_one: Judge = judge, *, hangs_after: float = HANGS_AFTER) -> None:
        """Start a process when the first scene comes."""
        self._judge_one, self._hangs_after = judge_one, hangs_after
        self._worker: _Worker | None = None

    def judge(self, scene: StressScene) -> Finding:
        """The finding of one scene."""
        worker = self._worker = self._worker or _Worker(self._judge_one)
        worker.begin(scene)
        while True:
            if worker.connection.poll(_BEAT):
                try:
                    finding = worker.answer()
                except (EOFError, OSError):
                    self._worker = None
                    return _ended(worker, Verdict.CRASH, worker.how_it_ended())
                if finding is not None:
                    return finding
            if worker.hangs(self._hangs_after):
                self.close()
                return _ended(worker, Verdict.HANG, _hung(self._hangs_after))

    def close(self) -> None:
        """End the process."""
        if self._worker is not None:
            self._worker.end()
            self._worker = None


def _hung(limit: float) -> str:
    return f'no answer within {limit:g} s of wall time'


def _queues(scenes: Iterable[StressScene]) -> 'deque[deque[StressScene]]':
    """Scenes by kind, so that one process at a time compiles what a kind needs."""
    found: dict[int, deque[StressScene]] = {}
    for scene in scenes:
        found.setdefault(scene.kind, deque()).append(scene)
    return deque(found.values())


def _next(worker: _Worker, queues: 'deque[deque[StressScene]]') -> bool:
    """Give a worker a scene of a kind that it has, or of a new one; False: it has had enough."""
    for queue in queues:
        if queue[0].kind in worker.kinds:
            break
    else:
        if not queues or len(worker.kinds) >= _KINDS_EACH:
            return False
        queue = queues[0]
        # The last of its kinds go to this worker alone; others begin with another kind.
        queues.rotate(-1)
    worker.begin(queue.popleft())
    if not queue:
        queues.remove(queue)
    return True


def _ended(worker: _Worker, verdict: Verdict, detail: str) -> Finding:
    scene = worker.scene
    assert scene is not None
    return Finding(scene.seed, scene.kind, verdict, detail)


def _serve(connection: Connection, judge_one: Judge) -> None:
    """Answer scenes with findings until the other end is closed."""
    # An interrupt is for the process that began this one, which ends it; so does its death.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    ctypes.CDLL(None).prctl(_END_WITH_PARENT, signal.SIGTERM)
    # Compiled where it is needed.
    os.environ['ICOFABRIC_COMPILE_AHEAD'] = '0'
    lock = threading.Lock()

    def beat() -> None:
        with suppress(OSError):
            while True:
                with lock:
                    connection.send(_Beat(compile_notice.seconds, compile_notice.is_compiling))
                time.sleep(_BEAT)

    threading.Thread(target=beat, daemon=True).start()
    with suppress(EOFError, OSError):
        while True:
            finding = judge_one(connection.recv())
            with lock:
                connection.send(finding)
