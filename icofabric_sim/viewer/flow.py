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
How far pages have come: what a page cannot draw in time must not wait there, frame behind frame.

A browser takes messages faster than it draws, and so keeps them; its socket never says so. So each
frame brings a mark along, which the page sends back with its camera once it has come to it: an
angle of view that differs by less than is seen.
"""

import threading
import time
from typing import Any

# Frames that may be under way to a page, so that those that draw fast need not wait for marks.
_AHEAD = 3
# For how long a page that sends no mark back is waited for [s].
_PATIENCE = 3.0
# Relative differences of the angle: viser passes over what is nearer than 1e-5.
_MARKS, _STEP = 4, 3e-5


class Flow:
    """The marks of all pages; called from the thread of the page, marks come from others."""

    def __init__(self, view: float) -> None:
        """Mark pages whose angle of view is `view` [rad]."""
        self._view = view
        self._lock = threading.Lock()
        self._sent = 0
        self._behind: dict[int, tuple[int, float]] = {}  # last mark of a page, and since when

    def begin(self, page: Any) -> None:
        """Hear the marks of a client of viser that has come."""
        number = page.client_id
        with self._lock:
            self._behind[number] = (self._sent, time.monotonic())

        @page.camera.on_update  # type: ignore[untyped-decorator]
        async def _(camera: Any) -> None:
            mark = round((camera.fov / self._view - 1.0) / _STEP)
            with self._lock:
                if number in self._behind and 0 <= mark < _MARKS:
                    # The last one with this mark that was sent.
                    last = self._sent - (self._sent - mark) % _MARKS
                    if last > self._behind[number][0]:
                        self._behind[number] = (last, time.monotonic())

    def end(self, page: Any) -> None:
        """Wait for a client no longer."""
        with self._lock:
            self._behind.pop(page.client_id, None)

    def is_free(self) -> bool:
        """Whether another frame can be sent."""
        now = time.monotonic()
        with self._lock:
            return all(
                self._sent - last < _AHEAD or now - since > _PATIENCE
                for last, since in self._behind.values())

    def mark(self, pages: Any) -> None:
        """Send a mark behind what was sent; `pages` are clients of viser."""
        with self._lock:
            self._sent += 1
            now = time.monotonic()
            for number, (_, since) in self._behind.items():
                if now - since > _PATIENCE:
                    # What it lacks is not waited for again.
                    self._behind[number] = (self._sent - 1, now)
        for page in pages:
            page.camera.fov = self._view * (1.0 + _STEP * (self._sent % _MARKS))
