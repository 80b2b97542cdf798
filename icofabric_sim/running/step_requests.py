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
"""Solver steps on request, while simulated time stands still otherwise."""

from collections import deque
from concurrent.futures import Future
import logging
from typing import Any

_LOGGER = logging.getLogger('icofabric_sim')


class StepRequest:
    """So many solver steps, taken in portions."""

    def __init__(self, count: int | None = None) -> None:
        """Ask for `count` steps; None: for the `step_count` that is in force when they begin."""
        self._wanted, self.count, self.taken = count, count or 0, 0
        self.future: Future[Any] = Future()

    def begin(self, step_count: int) -> None:
        """Take that many steps where the request says no number."""
        self.count = step_count if self._wanted is None else self._wanted

    @property
    def done(self) -> bool:
        """Whether all steps are taken."""
        return self.taken >= self.count


class StepRequests:
    """Requests one after the other; their answers say what ended them early."""

    def __init__(self) -> None:
        """Start without any."""
        self._queue: deque[StepRequest] = deque()

    def add(self, request: StepRequest) -> None:
        """Queue a request."""
        self._queue.append(request)

    @property
    def current(self) -> StepRequest | None:
        """The request whose steps are being taken."""
        return self._queue[0] if self._queue else None

    def finish(self, now: int) -> None:
        """Answer the current request with the time [ns] that its steps led to."""
        self._queue.popleft().future.set_result(now)

    def end(self, reason: str) -> None:
        """Take no more steps: all pending requests are answered with the reason."""
        while self._queue:
            request = self._queue.popleft()
            text = f'{request.taken} of {request.count} solver steps taken: {reason}'
            _LOGGER.warning('%s', text)
            request.future.set_exception(RuntimeError(text))
