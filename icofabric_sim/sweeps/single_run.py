# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Computation of one run in the current process, and its storage."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from enum import Enum
import logging
import threading
import time
from typing import Any, NamedTuple

from icofabric_sim.kernels.runtime.target import host_processor
from icofabric_sim.parameters.named_files import NamedFile
from icofabric_sim.parameters.text import dump_parameters
from icofabric_sim.parameters.validation import make_parameters
from icofabric_sim.process.compile_notice import compile_notice
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.errors import SimulationError
from icofabric_sim.statics.one_thread import one_thread
from icofabric_sim.sweeps.outcomes import carry_out, Column, RunFailed, Work
from icofabric_sim.sweeps.run_key import run_environment
from icofabric_sim.sweeps.store import Finished, Store

_LOGGER = logging.getLogger('icofabric_sim')
_MAX_WARNINGS = 20  # stored with a run


class RunRequest(NamedTuple):
    """Input of a worker for one run."""

    number: int
    key: str
    given: Mapping[str, Any]  # parameters
    files: Mapping[str, str]  # SHA-256 of the files that the scene reads, by file name
    work: Work
    environment: Mapping[str, str]  # see `run_environment`
    store: str
    identity: str = ''  # of the store; '': not compared
    retry: bool = False  # repeat the run if it has failed


class State(Enum):
    """Status of a run."""

    DONE = 'done'
    FAILED = 'failed'  # kept in the store, with the reason
    BUSY = 'busy'  # another process computes it
    LOST = 'lost'  # failure of the machine, not of the run; not stored


class Outcome(NamedTuple):
    """Status and results of a run."""

    number: int
    key: str
    state: State
    columns: tuple[Column, ...] = ()
    reason: str = ''
    reused: bool = False


class WorkersDiffer(RuntimeError):
    """Source, libraries, kernel target or store of a worker differ from those of the sweep."""


def perform(request: RunRequest, who: str = 'this process') -> Outcome:
    """
    Compute a run unless the store has it.

    Raise WorkersDiffer if this process would not reproduce the run of this key, or has another
    store. `who` names the process in messages.
    """
    require_same(request.environment, run_environment(), who)
    store = Store(request.store)
    if not store.is_one(request.identity):
        raise store_unseen(who, store)
    try:
        with store.claim(request.key) as mine:
            there = store.read(request.key)
            if there is not None and not (request.retry and there.reason):
                return outcome_of(request.number, request.key, there, reused=True)
            if not mine:
                return Outcome(request.number, request.key, State.BUSY)
            if there is not None:
                store.forget(request.key)
            return _compute(request, store)
    except Exception as error:  # noqa: BLE001 - an error of one run; the others continue
        return lost(request, error)


def lost(request: RunRequest, error: Exception) -> Outcome:
    """Return the outcome of a run that ended by a failure of the machine."""
    if isinstance(error, MemoryError):
        reason = str(error) or 'there was not enough memory for it'
    elif isinstance(error, OSError):
        reason = f'{error.filename}: {error.strerror}' if error.filename else str(error)
    else:
        reason = f'{type(error).__name__}: {error}'
    return Outcome(request.number, request.key, State.LOST, reason=' '.join(reason.split()))


def store_unseen(who: str, store: Store) -> WorkersDiffer:
    """Return the error of a process that cannot access the store."""
    return WorkersDiffer(
        f'{who} cannot access the store {store.path} of this sweep (missing, or another folder at '
        'the same path); choose a folder on a file system that all workers share')


def outcome_of(number: int, key: str, found: Finished, *, reused: bool) -> Outcome:
    """Return the outcome of a run from its stored result."""
    return Outcome(
        number, key, State.FAILED if found.reason else State.DONE, found.columns, found.reason,
        reused)


def require_same(wanted: Mapping[str, str], found: Mapping[str, str], who: str) -> None:
    """Raise WorkersDiffer that names the difference in source, libraries or kernel target."""
    for name, said, way in (
            ('source', 'a different version of icofabric_sim', 'install the same version there'),
            ('libraries', 'other versions of libraries', 'install the same versions there'),
            ('kernels', 'kernels compiled for another processor', 'set NUMBA_CPU_NAME to one '
             'level, such as x86-64-v3, and NUMBA_CPU_FEATURES to +avx2, for the sweep and all '
             'workers')):
        if wanted[name] != found[name]:
            raise WorkersDiffer(
                f'{who} has {said}: {_short(found[name])} instead of '
                f'{_short(wanted[name])}; {way}')


def _short(text: str) -> str:
    return text if len(text) < 120 else f'{text[:12]}...'


def _compute(request: RunRequest, store: Store) -> Outcome:
    began, compiled = time.monotonic(), compile_notice.seconds
    with store.temporary_folder(request.key) as folder, _warnings() as warnings:
        (folder / 'scene.yaml').write_text(dump_parameters(request.given), 'utf-8')
        columns: tuple[Column, ...] = ()
        reason = ''
        try:
            parameters = replace(make_parameters(request.given), files={
                name: NamedFile(digest, store.file(digest))
                for name, digest in request.files.items()})
            scene = Scene.from_parameters(parameters)
            # Results of dense algebra depend on the number of threads.
            with one_thread():
                columns = tuple(carry_out(request.work, scene, folder))
        except MemoryError:
            # A ParameterError if the check of the scene foresees the lack of memory.
            raise
        except (RunFailed, SimulationError, ValueError, ArithmeticError) as error:
            reason = ' '.join(str(error).split()) or type(error).__name__
        compiling = compile_notice.seconds - compiled
        finished = Finished(columns, reason)
        store.finish(request.key, folder, finished, {
            'verbs': request.work.verbs, 'keep': [str(phrase) for phrase in request.work.keep],
            'files': dict(request.files), **request.environment, 'processor': host_processor(),
            'seconds': round(time.monotonic() - began - compiling, 6),
            'compiling': round(compiling, 6), 'warnings': warnings})
    return outcome_of(request.number, request.key, finished, reused=False)


class _Kept(logging.Handler):
    """Warnings of one thread."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.messages: list[str] = []
        self._thread = threading.get_ident()

    def emit(self, record: logging.LogRecord) -> None:
        if threading.get_ident() == self._thread and len(self.messages) < _MAX_WARNINGS:
            self.messages.append(record.getMessage())


@contextmanager
def _warnings() -> Iterator[list[str]]:
    kept = _Kept()
    _LOGGER.addHandler(kept)
    try:
        yield kept.messages
    finally:
        _LOGGER.removeHandler(kept)
