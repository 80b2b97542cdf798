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
"""Between the executor's thread and others: work handed over, and answers that take a while."""

from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import Future
from functools import partial
import threading
from typing import Any

from rclpy.node import Node
from rclpy.task import Future as Promise

# Limit on pending requests.
MOST = 100


class Answers:
    """
    Requests that wait for another thread, without holding up other callbacks of the node.

    All methods but `hand_over` are for the executor's thread.
    """

    def __init__(self, node: Node, take_first: Callable[[], None] = lambda: None) -> None:
        """
        Serve `node`.

        Topics and services have no common order: `take_first` is called before anything begins,
        and has what arrived before act before.
        """
        self._context, self._take_first = node.context, take_first
        self._handed: deque[Callable[[], None]] = deque()
        # It ends the executor's wait for work that other threads hand over.
        self._guard = node.create_guard_condition(self._run_handed)
        self._waiting: set[Promise] = set()
        self._ended = ''

    def __len__(self) -> int:
        """Count the requests that wait."""
        return len(self._waiting)

    def hand_over(self, work: Callable[[], None]) -> None:
        """Have `work` done in the executor's thread, from any other."""
        self._handed.append(work)
        if self._context.ok():
            self._guard.trigger()

    async def of(self, begin: 'Callable[[], Future[Any]]', *, at_once: bool = False) -> Any:
        """
        Begin something and return its result, while other callbacks run.

        RuntimeError, and nothing begun, where too many wait already; but not for what is done
        `at_once`, and may end their waiting. RuntimeError too where the node ends before.
        """
        if len(self._waiting) >= MOST and not at_once:
            raise RuntimeError(f'not begun: {MOST} requests wait for their answer already')
        if self._ended:
            raise RuntimeError(self._ended)
        self._take_first()
        future = begin()
        if not future.done():
            promise = Promise()
            self._waiting.add(promise)
            future.add_done_callback(lambda _: self.hand_over(partial(promise.set_result, None)))
            try:
                await promise
            finally:
                self._waiting.discard(promise)
            if not future.done():
                raise RuntimeError(self._ended)
        return future.result()

    async def within(self, future: 'Future[Any]', limit: float) -> bool:
        """Whether the `future` is done within so long [s], while other callbacks run."""
        if future.done() or self._ended or len(self._waiting) >= MOST:
            return future.done()
        promise = Promise()

        def settle(_: Any = None) -> None:
            self.hand_over(lambda: None if promise.done() else promise.set_result(None))

        self._waiting.add(promise)
        timer = threading.Timer(limit, settle)
        timer.daemon = True
        timer.start()
        future.add_done_callback(settle)
        try:
            await promise
        finally:
            self._waiting.discard(promise)
            timer.cancel()
        return future.done()

    async def turn(self) -> None:
        """Let other callbacks run before what follows."""
        self.hand_over(lambda: None)
        await _Turn()

    def end(self, reason: str) -> None:
        """Answer all pending requests with the reason why no other answer will come."""
        self._ended = reason
        self._run_handed()
        for promise in [item for item in self._waiting if not item.done()]:
            promise.set_result(None)

    def _run_handed(self) -> None:
        while self._handed:
            self._handed.popleft()()


class _Turn:
    """Gives the executor's thread back once."""

    def __await__(self) -> Generator[None, None, None]:
        yield


def begin_aside(work: Callable[[], Any]) -> 'Future[Any]':
    """Begin `work` in a thread of its own; the result comes with the future."""
    future: Future[Any] = Future()

    def run() -> None:
        try:
            result = work()
        except Exception as error:  # noqa: BLE001 - passed on in the answer
            future.set_exception(error)
        else:
            future.set_result(result)

    threading.Thread(target=run, name='aside', daemon=True).start()
    return future
