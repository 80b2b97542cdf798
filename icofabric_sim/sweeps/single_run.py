# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""One run of a study, in whatever process: from its order to its folder in the store."""

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
from icofabric_sim.sweeps.outcomes import carry_out, Column, Failed, Work
from icofabric_sim.sweeps.run_key import surroundings
from icofabric_sim.sweeps.store import Finished, Store

_LOGGER = logging.getLogger('icofabric_sim')
# Warnings of a run that are kept.
_WARNINGS = 20


class Order(NamedTuple):
    """Input of a worker for one run."""

    number: int
    key: str
    given: Mapping[str, Any]  # parameters
    files: Mapping[str, str]  # SHA-256 of the files that are read, by their names
    work: Work
    around: Mapping[str, str]  # see `surroundings`
    store: str
    identity: str = ''  # of the store; '': not compared
    retry: bool = False  # do again what has failed


class State(Enum):
    """Status of a run."""

    DONE = 'done'
    FAILED = 'failed'  # kept in the store, with the reason
    BUSY = 'busy'  # another study is at it
    LOST = 'lost'  # not kept: the machine is to blame, so the next study tries it again


class Outcome(NamedTuple):
    """Status and results of a run."""

    number: int
    key: str
    state: State
    columns: tuple[Column, ...] = ()
    reason: str = ''
    reused: bool = False


class WorkersDiffer(RuntimeError):
    """A worker has other source, libraries, kernels or another store than the study."""


def perform(order: Order, who: str = 'this process') -> Outcome:
    """
    Do a run, unless the store has it.

    Raises WorkersDiffer where this process, which messages call `who`, would give other results
    than the key stands for, or put them elsewhere.
    """
    require_same(order.around, surroundings(), who)
    store = Store(order.store)
    if not store.is_one(order.identity):
        raise store_unseen(who, store)
    try:
        with store.claim(order.key) as mine:
            there = store.read(order.key)
            if there is not None and not (order.retry and there.reason):
                return outcome_of(order.number, order.key, there, reused=True)
            if not mine:
                return Outcome(order.number, order.key, State.BUSY)
            if there is not None:
                store.forget(order.key)
            return _do(order, store)
    except Exception as error:  # noqa: BLE001 - a fault of one run; the others go on
        return lost(order, error)


def lost(order: Order, error: Exception) -> Outcome:
    """Return the outcome of a run that ended by an error unrelated to its physics."""
    if isinstance(error, MemoryError):
        reason = str(error) or 'there was not enough memory for it'
    elif isinstance(error, OSError):
        reason = f'{error.filename}: {error.strerror}' if error.filename else str(error)
    else:
        reason = f'{type(error).__name__}: {error}'
    return Outcome(order.number, order.key, State.LOST, reason=' '.join(reason.split()))


def store_unseen(who: str, store: Store) -> WorkersDiffer:
    """Return the error of a process whose path leads to another store, or None."""
    return WorkersDiffer(
        f'{who} does not see the store {store.path} of the study, or one that was made since '
        'under the same path; choose a folder on a file system that all workers share')


def outcome_of(number: int, key: str, found: Finished, *, reused: bool) -> Outcome:
    """Return the outcome of a run from its stored result."""
    return Outcome(
        number, key, State.FAILED if found.reason else State.DONE, found.columns, found.reason,
        reused)


def require_same(wanted: Mapping[str, str], found: Mapping[str, str], who: str) -> None:
    """Refuse other source, libraries or kernels; WorkersDiffer names what differs."""
    for name, said, way in (
            ('source', 'another source of icofabric_sim', 'install the same version there'),
            ('libraries', 'other versions of libraries', 'install the same there'),
            ('kernels', 'another target of kernels', 'set NUMBA_CPU_NAME to one level, such as '
             'x86-64-v3, and NUMBA_CPU_FEATURES to +avx2, for the study and all workers')):
        if wanted[name] != found[name]:
            raise WorkersDiffer(
                f'{who} has {said} than the study: {_short(found[name])}, not '
                f'{_short(wanted[name])}; {way}')


def _short(text: str) -> str:
    return text if len(text) < 120 else f'{text[:12]}...'


def _do(order: Order, store: Store) -> Outcome:
    began, compiled = time.monotonic(), compile_notice.seconds
    with store.place_for(order.key) as folder, _warnings() as warnings:
        (folder / 'scene.yaml').write_text(dump_parameters(order.given), 'utf-8')
        columns: tuple[Column, ...] = ()
        reason = ''
        try:
            parameters = replace(make_parameters(order.given), files={
                name: NamedFile(total, store.file(total)) for name, total in order.files.items()})
            scene = Scene.from_parameters(parameters)
            # The result of dense algebra depends on the number of its threads.
            with one_thread():
                columns = tuple(carry_out(order.work, scene, folder))
        except MemoryError:
            # Also a ParameterError where it is foreseen.
            raise
        except (Failed, SimulationError, ValueError, ArithmeticError) as error:
            reason = ' '.join(str(error).split()) or type(error).__name__
        compiling = compile_notice.seconds - compiled
        finished = Finished(columns, reason)
        store.finish(order.key, folder, finished, {
            'verbs': order.work.verbs, 'keep': [str(phrase) for phrase in order.work.keep],
            'files': dict(order.files), **order.around, 'processor': host_processor(),
            'seconds': round(time.monotonic() - began - compiling, 6),
            'compiling': round(compiling, 6), 'warnings': warnings})
    return outcome_of(order.number, order.key, finished, reused=False)


class _Kept(logging.Handler):
    """Keeps the warnings of one thread."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.said: list[str] = []
        self._thread = threading.get_ident()

    def emit(self, record: logging.LogRecord) -> None:
        if threading.get_ident() == self._thread and len(self.said) < _WARNINGS:
            self.said.append(record.getMessage())


@contextmanager
def _warnings() -> Iterator[list[str]]:
    kept = _Kept()
    _LOGGER.addHandler(kept)
    try:
        yield kept.said
    finally:
        _LOGGER.removeHandler(kept)
