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
"""Says what a user waits for, once it takes longer than a moment, and again while it goes on."""

from collections.abc import Callable
import threading
import time

# A wait below this needs no words [s].
_MOMENT = 1.0
# They are said again after each such time of waiting [s].
_AGAIN = 10.0
# After a pause as long as this, waiting begins anew [s].
_PAUSE = 10.0


class Patience:
    """A wait that comes in pieces."""

    def __init__(self, explain: Callable[[float], object]) -> None:
        """
        Call `explain` with the wait so far [s], in another thread, while it goes on.

        First once the pieces add up to more than a moment, then after every ten seconds of them.
        """
        self._explain = explain
        self._lock = threading.Lock()
        self._timer: threading.Timer | None = None
        self._waits = False
        self._due = _MOMENT
        self._waited, self._before = 0.0, 0.0
        self._began, self._ended = 0.0, time.monotonic()

    @property
    def seconds(self) -> float:
        """Length [s] of all waits so far."""
        # Read without the lock: a signal handler may ask.
        going_on = time.monotonic() - self._began if self._waits else 0.0
        return self._before + self._waited + going_on

    def begin(self) -> None:
        """Start timing a piece."""
        with self._lock:
            self._began = time.monotonic()
            if self._began - self._ended > _PAUSE:
                self._before += self._waited
                self._waited, self._due = 0.0, _MOMENT
            self._waits = True
            self._schedule(self._due - self._waited)

    def end(self) -> None:
        """End a piece."""
        with self._lock:
            if self._timer is not None:
                self._timer.cancel()
            self._ended = time.monotonic()
            self._waits = False
            self._waited += self._ended - self._began

    def _schedule(self, delay: float) -> None:
        self._timer = threading.Timer(max(delay, 0.0), self._tell)
        self._timer.daemon = True
        self._timer.start()

    def _tell(self) -> None:
        with self._lock:
            if not self._waits:
                return
            waited = self._waited + time.monotonic() - self._began
            self._due = max(self._due, waited) + _AGAIN
            self._schedule(self._due - waited)
        self._explain(waited)
