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
Runs handed to the workers of Dask: a local cluster, or any scheduler by its address.

Dask carries orders and outcomes, and begins a run again whose worker died. It keeps nothing: a
worker writes what it has found to the store before it answers.
"""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, ExitStack, suppress
from importlib import import_module
import logging
import os
from pathlib import Path
import queue
import signal
import time
from typing import Any, Final
import uuid

from icofabric_sim.studies.sweep.run_key import surroundings
from icofabric_sim.studies.sweep.single_run import (
    Order,
    Outcome,
    perform,
    require_same,
    State,
    WorkersDiffer,
)

# Orders at the scheduler for each thread of a worker, and at least.
_AHEAD, _LEAST_AHEAD = 8, 32
# Wall time [s] between looks at the scheduler; until the first worker has to be there; before a
# run that another study is at is asked for again.
_LOOK, _BUSY = 0.5, 0.2
WORKERS_WITHIN: Final = 120.0
_CONNECT = '10s'
NEEDS_DASK = (
    "several workers need Dask: pip install 'icofabric_sim[sweep]', or pip install distributed; "
    'with workers 0 (--workers 0) all runs are done in this process, one after the other')


class SchedulerLost(RuntimeError):
    """The scheduler is gone; what is finished is in the store."""




class Pool:
    """Workers of one scheduler."""

    def __init__(self, client: Any, *, is_local: bool) -> None:
        """Wrap a client of Dask."""
        self._client, self._is_local = client, is_local

    def check(self, store: Path, within: float = WORKERS_WITHIN) -> None:
        """
        Wait for the first worker, and refuse workers that would give other results.

        Raises WorkersDiffer, or SchedulerLost where none comes.
        """
        try:
            self._client.wait_for_workers(1, timeout=within)
        except TimeoutError as error:
            raise SchedulerLost(
                f'no worker came to the scheduler {self._address} within {within:g} s; start '
                f'some: dask worker {self._address} --nthreads 1') from error
        token = store / f'.seen.{uuid.uuid4().hex}'
        token.touch()
        try:
            answers: Mapping[str, Any] = self._client.run(
                _about, str(token), on_error='return')
        finally:
            token.unlink(missing_ok=True)
        for address, answer in answers.items():
            if isinstance(answer, BaseException):
                raise WorkersDiffer(
                    f'the worker {address} cannot do runs: {answer}; install icofabric_sim there')
            around, sees_store = answer
            require_same(surroundings(), around, f'the worker {address}')
            if not sees_store:
                raise WorkersDiffer(
                    f'the worker {address} does not see the store {store}; choose a folder on a '
                    'file system that all workers share')

    def perform(
        self, leaders: Sequence[Order], followers: Mapping[int, Sequence[Order]],
        started: Any = None
    ) -> Iterator[Outcome]:
        """
        Yield outcomes as they come.

        `leaders` are of different kinds of scenes; `followers[i]` need the kernels that leader i
        compiles, so they wait for it. The very first leader runs alone.
        """
        waiting: deque[Order] = deque(leaders[:1])
        later: dict[str, list[Order]] = {
            leader.key: list(followers.get(place, ())) for place, leader in enumerate(leaders)}
        if leaders:
            later[leaders[0].key] = [*leaders[1:], *later[leaders[0].key]]
        busy: deque[tuple[float, Order]] = deque()
        came: queue.SimpleQueue[Any] = queue.SimpleQueue()
        running: dict[Any, Order] = {}
        ahead, looked = _LEAST_AHEAD, 0.0
        try:
            while waiting or busy or running or any(later.values()):
                now = time.monotonic()
                if now - looked >= _LOOK:
                    looked = now
                    self._require_alive()
                    ahead = max(_LEAST_AHEAD, _AHEAD * sum(self._client.nthreads().values()))
                while busy and busy[0][0] <= now:
                    waiting.append(busy.popleft()[1])
                while waiting and len(running) < ahead:
                    order = waiting.popleft()
                    future = self._client.submit(
                        _perform, order, pure=False,
                        key=f'icofabric-{order.key}-{uuid.uuid4().hex[:8]}')
                    running[future] = order
                    future.add_done_callback(came.put)
                for future in _drain(came, _LOOK if running else _BUSY):
                    order = running.pop(future)
                    outcome = self._outcome(order, future)
                    if outcome.state is State.BUSY:
                        busy.append((time.monotonic() + _BUSY, order))
                        continue
                    # Also where the leader failed: one of the others compiles then.
                    waiting.extend(later.pop(order.key, ()))
                    yield outcome
        finally:
            with suppress(Exception):
                self._client.cancel(list(running), force=True)

    @property
    def _address(self) -> str:
        return str(self._client.scheduler.address)

    def _require_alive(self) -> None:
        if self._client.status not in ('running', 'newly-created'):
            raise SchedulerLost(f'the scheduler {self._address} is gone')

    def _outcome(self, order: Order, future: Any) -> Outcome:
        """What a future holds; what a worker cannot be blamed for is raised."""
        if future.status in ('cancelled', 'lost'):
            raise SchedulerLost(f'the scheduler {self._address} is gone')
        try:
            return future.result()  # type: ignore[no-any-return]
        except WorkersDiffer:
            raise
        except CancelledError as error:
            raise SchedulerLost(f'the scheduler {self._address} is gone') from error
        except Exception as error:  # noqa: BLE001 - a fault of one run; the others go on
            reason = f'{type(error).__name__}: {error}'
            if type(error).__name__ == 'KilledWorker':
                reason = (
                    'its workers died, one after the other: of too little memory, or by a fault '
                    'that takes the process along')
        return Outcome(order.number, order.key, State.LOST, reason=' '.join(reason.split()))


@contextmanager
def pool(*, workers: int, scheduler: str) -> Iterator[Pool]:
    """
    A local cluster of so many processes, or the workers of a scheduler.

    `scheduler`: an address (tcp://host:8786), or the scheduler file of Dask (.json). ValueError
    where Dask is not installed, or nobody answers there.
    """
    try:
        dask, distributed = import_module('dask'), import_module('distributed')
    except ImportError as error:
        raise ValueError(NEEDS_DASK) from error
    with ExitStack() as stack:
        stack.enter_context(_quiet())
        stack.enter_context(dask.config.set({
            # A worker that compiles, or solves, may be silent for minutes.
            'distributed.scheduler.worker-ttl': None,
            'distributed.comm.timeouts.connect': _CONNECT,
            'distributed.admin.tick.limit': '1h',
            'distributed.scheduler.events-cleanup-delay': '1m'}))
        if not scheduler:
            cluster = stack.enter_context(_local_cluster(distributed, workers))
            client = stack.enter_context(distributed.Client(cluster, set_as_default=False))
            client.run(_work_alone)
        else:
            is_file = scheduler.endswith('.json')
            if is_file and not Path(scheduler).is_file():
                raise ValueError(f'scheduler: there is no file {scheduler}')
            try:
                client = stack.enter_context(distributed.Client(
                    None if is_file else scheduler, set_as_default=False, timeout=_CONNECT,
                    scheduler_file=scheduler if is_file else None))
            except (OSError, TimeoutError, ValueError) as error:
                raise ValueError(
                    f'scheduler: nobody answers at {scheduler}: {error}; start one with dask '
                    'scheduler, and give the address that it prints') from error
        yield Pool(client, is_local=not scheduler)


def _local_cluster(distributed: Any, workers: int) -> Any:
    try:
        return distributed.LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True,
            # Any free port: on the default one the second of two studies would be warned.
            dashboard_address='127.0.0.1:0', memory_limit=0, host='127.0.0.1',
            silence_logs=logging.CRITICAL)
    except RuntimeError as error:
        raise RuntimeError(
            f'the workers could not be started ({error}): they import the program that starts '
            "them, so a script calls sweep below if __name__ == '__main__': only; with workers=0 "
            'it does all runs itself') from error


def _work_alone() -> None:
    """In a worker of a local cluster: an interrupt is for the process that began it."""
    with suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _perform(order: Order) -> Outcome:
    """In a worker: it has one core, so nothing is compiled beside a run, and it is quiet."""
    os.environ['ICOFABRIC_COMPILE_AHEAD'] = '0'
    logger = logging.getLogger('icofabric_sim')
    if not logger.handlers:
        logger.addHandler(logging.NullHandler())
    return perform(order)


def _about(token: str) -> tuple[dict[str, str], bool]:
    return surroundings(), Path(token).exists()


def _drain(came: 'queue.SimpleQueue[Any]', patience: float) -> list[Any]:
    """All that has come, or nothing after a while."""
    found = []
    with suppress(queue.Empty):
        found.append(came.get(timeout=patience))
        while True:
            found.append(came.get_nowait())
    return found


@contextmanager
def _quiet() -> Iterator[None]:
    """What Dask logs about workers that come and go is said by the study itself."""
    loggers = [logging.getLogger(name) for name in ('distributed', 'tornado', 'asyncio')]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before):
            logger.setLevel(level)
