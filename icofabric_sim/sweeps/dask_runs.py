# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Runs on Dask workers: a local cluster, or any scheduler by its address.

Dask carries requests and outcomes, and restarts runs of workers that died. Results are in the
store: a worker writes them before it returns the outcome.
"""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, ExitStack, suppress
from dataclasses import dataclass
from importlib import import_module
import json
import logging
import os
from pathlib import Path
import queue
import signal
import time
from typing import Any, Final
import uuid

from icofabric_sim.libraries import import_library
from icofabric_sim.sweeps.run_key import run_environment
from icofabric_sim.sweeps.single_run import (
    lost,
    Outcome,
    perform,
    require_same,
    RunRequest,
    State,
    store_unseen,
    WorkersDiffer,
)
from icofabric_sim.sweeps.store import Store

WORKERS_WITHIN: Final = 120.0  # wall time [s] to wait for a worker, at the start or after a loss


@dataclass(frozen=True)
class DaskSettings:
    """Tunables of runs on workers of a Dask scheduler."""

    # Requests at the scheduler per worker thread, and the minimum, so that workers stay busy.
    requests_per_thread: int = 8
    min_requests: int = 32
    poll_interval_s: float = 0.5  # wall time between polls of the scheduler
    retry_interval_s: float = 0.2  # wall time until a run of another process is queried again
    # Wall time within which a scheduler returns an outcome; its worker may have died since.
    answer_timeout_s: float = 5.0


_DASK = DaskSettings()
_CONNECT = '10s'


class SchedulerLost(RuntimeError):
    """The scheduler or all workers were lost, or no worker connected; finished runs are stored."""


class Pool:
    """Workers of one scheduler."""

    def __init__(self, client: Any, cluster: Any = None) -> None:
        """Wrap a Dask client, and the local `cluster` if its workers are to be restarted."""
        self._client, self._cluster = client, cluster

    def check(self, store: Path, within: float = WORKERS_WITHIN) -> None:
        """
        Wait for the first worker, and check that all workers reproduce the runs.

        Raise WorkersDiffer if they do not, or SchedulerLost if no worker connects.
        """
        with self._scheduler_needed():
            try:
                self._client.wait_for_workers(1, timeout=within)
            except TimeoutError as error:
                raise SchedulerLost(
                    f'no worker connected to the scheduler {self._address} within {within:g} s; '
                    f'start one: dask worker {self._address} --nthreads 1') from error
            answers: Mapping[str, Any] = self._client.run(
                _fingerprint, str(store), Store(store).identity, on_error='return')
        for address, answer in answers.items():
            if isinstance(answer, BaseException):
                raise WorkersDiffer(
                    f'the worker {address} cannot compute runs: {answer}; install icofabric_sim '
                    'there')
            environment, has_store = answer
            require_same(run_environment(), environment, f'the worker {address}')
            if not has_store:
                raise store_unseen(f'the worker {address}', Store(store))

    def perform(
        self, leaders: Sequence[RunRequest], followers: Mapping[int, Sequence[RunRequest]]
    ) -> Iterator[Outcome]:
        """
        Yield outcomes as runs finish.

        `leaders` are of different kernel variants; `followers[i]` need the kernels that leader i
        compiles, so they wait for leader i. All other leaders wait for the first one.
        """
        waiting: deque[RunRequest] = deque(leaders[:1])
        later: dict[str, list[RunRequest]] = {
            leader.key: list(followers.get(place, ())) for place, leader in enumerate(leaders)}
        if leaders:
            later[leaders[0].key] = [*leaders[1:], *later[leaders[0].key]]
        busy: deque[tuple[float, RunRequest]] = deque()
        finished: queue.SimpleQueue[Any] = queue.SimpleQueue()
        running: dict[Any, RunRequest] = {}
        max_running, polled, had_workers = _DASK.min_requests, 0.0, time.monotonic()
        try:
            while waiting or busy or running or any(later.values()):
                now = time.monotonic()
                if now - polled >= _DASK.poll_interval_s:
                    polled = now
                    threads = self._threads()
                    max_running = max(_DASK.min_requests, _DASK.requests_per_thread * threads)
                    # Between the death of a worker and the start of the next there may be none.
                    if threads:
                        had_workers = now
                    if self._cluster is not None:
                        # Workers that died while they started are not replaced otherwise.
                        self._cluster.scale(len(self._cluster.worker_spec))
                    if now - had_workers >= WORKERS_WITHIN:
                        raise SchedulerLost(
                            f'the scheduler {self._address} has had no workers for '
                            f'{now - had_workers:.0f} s; start one: dask worker {self._address} '
                            '--nthreads 1')
                while busy and busy[0][0] <= now:
                    waiting.append(busy.popleft()[1])
                while waiting and len(running) < max_running:
                    request = waiting.popleft()
                    with self._scheduler_needed():
                        future = self._client.submit(
                            _perform, request, pure=False,
                            key=f'icofabric-{request.key}-{uuid.uuid4().hex[:8]}')
                    running[future] = request
                    future.add_done_callback(finished.put)
                for future in _drain(finished, (
                        _DASK.poll_interval_s if running else _DASK.retry_interval_s)):
                    request = running.pop(future)
                    outcome = self._outcome(request, future)
                    if outcome.state is State.BUSY:
                        busy.append((time.monotonic() + _DASK.retry_interval_s, request))
                        continue
                    # Also if the leader failed: then one of its followers compiles.
                    waiting.extend(later.pop(request.key, ()))
                    yield outcome
        finally:
            with suppress(Exception):
                self._client.cancel(list(running), force=True)

    @property
    def _address(self) -> str:
        return str(self._client.scheduler.address)

    @property
    def _is_alive(self) -> bool:
        return self._client.status in ('running', 'newly-created')

    def _gone(self) -> SchedulerLost:
        return SchedulerLost(f'the connection to the scheduler {self._address} is lost')

    @contextmanager
    def _scheduler_needed(self) -> Iterator[None]:
        """Convert errors of Dask about a lost scheduler to SchedulerLost."""
        try:
            yield
        except SchedulerLost:
            raise
        # OSError: a broken connection; RuntimeError: a client that has closed itself.
        except (OSError, RuntimeError, CancelledError) as error:
            raise self._gone() from error

    def _threads(self) -> int:
        """Count the threads of all workers. Raise SchedulerLost without an answer."""
        if not self._is_alive:
            raise self._gone()
        with self._scheduler_needed():
            return sum(self._client.nthreads().values())

    def _outcome(self, request: RunRequest, future: Any) -> Outcome:
        """Return the outcome of a future. Raise if the scheduler is lost or a worker differs."""
        if future.status == 'cancelled' or not self._is_alive:
            raise self._gone()
        again = Outcome(request.number, request.key, State.BUSY)
        if future.status == 'lost':
            return again
        try:
            return future.result(timeout=_DASK.answer_timeout_s)  # type: ignore[no-any-return]
        except WorkersDiffer:
            raise
        except CancelledError as error:
            raise self._gone() from error
        except Exception as error:  # noqa: BLE001 - an error of one run; the others continue
            if not self._is_alive:
                raise self._gone() from error
            if isinstance(error, TimeoutError) and future.status != 'error':
                # The outcome was lost with its worker, unless the result is in the store.
                future.cancel()
                return again
            outcome = lost(request, error)
            if type(error).__name__ == 'KilledWorker':
                outcome = outcome._replace(reason=(
                    'every worker that tried this run died, e.g. for lack of memory or by a '
                    'crash'))
            return outcome


@contextmanager
def pool(*, workers: int, scheduler: str) -> Iterator[Pool]:
    """
    Yield the workers of a new local cluster or of a running scheduler.

    `scheduler`: an address (tcp://host:8786), or the scheduler file of Dask (.json). Raise
    ValueError if Dask is not installed or no scheduler answers at the address; SchedulerLost if
    the processes cannot be started.
    """
    distributed = import_library(
        'distributed', 'a sweep on several workers',
        without='with workers 0 (--workers 0) this process computes the runs one by one')
    dask = import_module('dask')
    with ExitStack() as stack:
        stack.enter_context(_quiet())
        stack.enter_context(dask.config.set({
            # A worker may not answer for minutes while it compiles or solves.
            'distributed.scheduler.worker-ttl': None,
            'distributed.comm.timeouts.connect': _CONNECT,
            'distributed.admin.tick.limit': '1h',
            'distributed.scheduler.events-cleanup-delay': '1m'}))
        cluster = None
        if not scheduler:
            client, cluster = _local_client(distributed, workers, stack)
        else:
            address = _address_of(scheduler)
            try:
                client = stack.enter_context(_closed_quietly(distributed.Client(
                    address, set_as_default=False, timeout=_CONNECT)))
            except (OSError, TimeoutError, ValueError) as error:
                raise ValueError(
                    f'no scheduler answers at {address}: {" ".join(str(error).split())}; '
                    'start one with dask scheduler, and give the printed address'
                ) from error
        yield Pool(client, cluster)


def _local_client(distributed: Any, workers: int, stack: ExitStack) -> tuple[Any, Any]:
    """Return a client, and the cluster that it started."""
    try:
        cluster = stack.enter_context(_closed_quietly(distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True,
            # Any free port: with the default port, the second of two sweeps would log a warning.
            dashboard_address='127.0.0.1:0', memory_limit=0, host='127.0.0.1',
            silence_logs=logging.CRITICAL)))
        client = stack.enter_context(_closed_quietly(
            distributed.Client(cluster, set_as_default=False)))
        client.run(_work_alone)
    except (RuntimeError, OSError, TimeoutError) as error:
        raise SchedulerLost(
            f'the workers could not be started ({" ".join(str(error).split())}): they import the '
            "program that starts them, so a script must call sweep inside if __name__ == "
            "'__main__':; with workers 0 (--workers 0) this process computes all runs") from error
    return client, cluster


def _address_of(scheduler: str) -> str:
    """Return a valid address, read from a scheduler file if given. Raise ValueError."""
    addressing = import_module('distributed.comm.addressing')
    get_backend = import_module('distributed.comm.registry').get_backend
    address, where = scheduler, 'scheduler'
    if scheduler.endswith('.json'):
        where = f'scheduler: {scheduler}'
        try:
            said = json.loads(Path(scheduler).expanduser().read_text('utf-8'))
        except FileNotFoundError:
            raise ValueError(f'scheduler: there is no file {scheduler}') from None
        except (OSError, ValueError) as error:
            raise ValueError(f'{where} cannot be read as JSON: {error}') from error
        found = said.get('address') if isinstance(said, Mapping) else None
        if not isinstance(found, str):
            raise ValueError(
                f'{where} contains no address; give the file written by dask scheduler '
                '--scheduler-file')
        address = found
    try:
        scheme, place = addressing.parse_address(address)
        get_backend(scheme)
        if scheme != 'inproc':
            addressing.parse_host_port(place)
    except ValueError as error:
        raise ValueError(
            f'{where}: {address!r} is not an address: {error}; write tcp://HOST:PORT') from error
    return address


@contextmanager
def _closed_quietly(thing: Any) -> Iterator[Any]:
    """Close a client or a cluster without a second error about a lost scheduler."""
    try:
        yield thing
    finally:
        with suppress(Exception):
            thing.close()


def _work_alone() -> None:
    """Ignore SIGINT in a worker of a local cluster; the process that started it handles SIGINT."""
    with suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _perform(request: RunRequest) -> Outcome:
    """Compute a run in a worker of one core: without compiling ahead, and without a log."""
    os.environ['ICOFABRIC_COMPILE_AHEAD'] = '0'
    logger = logging.getLogger('icofabric_sim')
    if not logger.handlers:
        logger.addHandler(logging.NullHandler())
    worker = import_module('distributed').get_worker()
    return perform(request, f'the worker {worker.address}')


def _fingerprint(store: str, identity: str) -> tuple[dict[str, str], bool]:
    return run_environment(), Store(store).is_one(identity)


def _drain(finished: 'queue.SimpleQueue[Any]', timeout_s: float) -> list[Any]:
    """Return all finished futures; wait at most `timeout_s` for the first."""
    found = []
    with suppress(queue.Empty):
        found.append(finished.get(timeout=timeout_s))
        while True:
            found.append(finished.get_nowait())
    return found


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the log of Dask, because the sweep reports lost workers."""
    loggers = [logging.getLogger(name) for name in ('distributed', 'tornado', 'asyncio')]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before):
            logger.setLevel(level)
