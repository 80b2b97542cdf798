# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Notices about waiting: first after a second, then at intervals while the wait continues."""

from collections.abc import Callable
import threading
import time

# A shorter wait [s] needs no notice.
_FIRST_NOTICE_S = 1.0
# Notices are repeated after each such time [s] of waiting.
_NOTICE_INTERVAL_S = 10.0
# After a pause as long as this [s], the wait counts as a new one.
_MAX_PAUSE_S = 10.0


class WaitNotice:
    """Timer of a wait that consists of several intervals."""

    def __init__(self, explain: Callable[[float], object]) -> None:
        """
        Call `explain` with the wait so far [s], in another thread, during the wait.

        The first call comes when the intervals add up to a second, further calls after every ten
        seconds.
        """
        self._explain = explain
        self._lock = threading.Lock()
        self._timer: threading.Timer | None = None
        self._waits = False
        self._due_s = _FIRST_NOTICE_S
        self._waited_s, self._earlier_waits_s = 0.0, 0.0
        self._begin_s, self._end_s = 0.0, time.monotonic()

    @property
    def seconds(self) -> float:
        """Length [s] of all waits so far."""
        # Read without the lock, because a signal handler may call this.
        current = time.monotonic() - self._begin_s if self._waits else 0.0
        return self._earlier_waits_s + self._waited_s + current

    def begin(self) -> None:
        """Start timing an interval."""
        with self._lock:
            self._begin_s = time.monotonic()
            if self._begin_s - self._end_s > _MAX_PAUSE_S:
                self._earlier_waits_s += self._waited_s
                self._waited_s, self._due_s = 0.0, _FIRST_NOTICE_S
            self._waits = True
            self._schedule(self._due_s - self._waited_s)

    def end(self) -> None:
        """End an interval."""
        with self._lock:
            if self._timer is not None:
                self._timer.cancel()
            self._end_s = time.monotonic()
            self._waits = False
            self._waited_s += self._end_s - self._begin_s

    def _schedule(self, delay_s: float) -> None:
        self._timer = threading.Timer(max(delay_s, 0.0), self._notify)
        self._timer.daemon = True
        self._timer.start()

    def _notify(self) -> None:
        with self._lock:
            if not self._waits:
                return
            waited_s = self._waited_s + time.monotonic() - self._begin_s
            self._due_s = max(self._due_s, waited_s) + _NOTICE_INTERVAL_S
            self._schedule(self._due_s - waited_s)
        self._explain(waited_s)
