# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Pending service requests, and work passed from other threads to the executor's thread."""

from collections import deque
from collections.abc import Callable, Generator
from concurrent.futures import Future
from functools import partial
import threading
from typing import Any

from rclpy.node import Node
from rclpy.task import Future as Promise

# Limit on pending requests.
MAX_PENDING_REQUESTS = 100


class Answers:
    """
    Pending service requests that do not block other callbacks of the node.

    Call all methods except `hand_over` from the executor's thread.
    """

    def __init__(self, node: Node, take_first: Callable[[], None] = lambda: None) -> None:
        """
        Serve `node`.

        ROS does not order messages of topics against service requests. `take_first` is therefore
        called before a request starts, so that inputs that arrived earlier act first.
        """
        self._context, self._take_first = node.context, take_first
        self._handed: deque[Callable[[], None]] = deque()
        # Wakes the executor when another thread hands over work.
        self._guard = node.create_guard_condition(self._run_handed)
        self._waiting: set[Promise] = set()
        self._ended = ''

    def __len__(self) -> int:
        """Count the pending requests."""
        return len(self._waiting)

    def hand_over(self, work: Callable[[], None]) -> None:
        """Run `work` in the executor's thread; callable from any thread."""
        self._handed.append(work)
        if self._context.ok():
            self._guard.trigger()

    async def of(self, begin: 'Callable[[], Future[Any]]', *, at_once: bool = False) -> Any:
        """
        Start an operation and return its result while other callbacks run.

        Raises RuntimeError, and starts nothing, if too many requests are pending. Operations that
        run `at_once`, and may release pending ones, are exempt. Also raises RuntimeError if the
        node ends first.
        """
        if len(self._waiting) >= MAX_PENDING_REQUESTS and not at_once:
            raise RuntimeError(f'not started: {MAX_PENDING_REQUESTS} requests are pending already')
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
        """Return whether `future` completes within `limit` [s], while other callbacks run."""
        if future.done() or self._ended or len(self._waiting) >= MAX_PENDING_REQUESTS:
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
        """Let other callbacks run before the caller continues."""
        self.hand_over(lambda: None)
        await _YieldOnce()

    def end(self, reason: str) -> None:
        """Answer all pending requests with the reason why they will get no result."""
        self._ended = reason
        self._run_handed()
        for promise in [item for item in self._waiting if not item.done()]:
            promise.set_result(None)

    def _run_handed(self) -> None:
        while self._handed:
            self._handed.popleft()()


class _YieldOnce:
    """Awaitable that yields the executor's thread once."""

    def __await__(self) -> Generator[None, None, None]:
        yield


def begin_aside(work: Callable[[], Any]) -> 'Future[Any]':
    """Start `work` in a new thread and return the future of its result."""
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
