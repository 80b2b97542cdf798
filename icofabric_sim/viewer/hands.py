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
What a page can do to a fabric, and the pull of a mouse that is held.

Two do it: a run in this process (local.py), and a node elsewhere (ros/viewer.py).
"""

from collections.abc import Callable
from concurrent.futures import Future
import threading
import time
from typing import Any, Protocol

import numpy as np

# How often a pull is repeated while the mouse is held still [s].
_REPEAT = 0.1


class Hands(Protocol):
    """What can be done; each answer is a sentence, or an exception that says why not."""

    @property
    def is_replay(self) -> bool:
        """Whether a record is shown: then nothing can be pulled at."""

    def pull(self, body: int, point: tuple[float, float, float] | None) -> None:
        """Draw a body towards a point [m] of the world, or let it go."""

    def command(self, name: str, on: bool | None = None) -> 'Future[str]':
        """Call a service by its name, e.g. pause; `on` where it takes a flag."""

    def change(self, name: str, value: Any) -> 'Future[str]':
        """Set a parameter."""


class Grip:
    """The shell that each page holds: its point follows the mouse, and is sent again and again."""

    def __init__(
        self, pull: Callable[[int, tuple[float, float, float] | None], None],
        is_silent: Callable[[int], bool] = lambda page: False
    ) -> None:
        """Send by `pull`; `is_silent`: whether a page has stopped answering."""
        self._pull, self._is_silent = pull, is_silent
        self._lock = threading.Lock()
        self._held: dict[int, tuple[int, np.ndarray, np.ndarray]] = {}  # by page
        self._sent: dict[int, float] = {}  # of those that pull

    def take(
        self, page: int, body: int, centre: np.ndarray, grasp: np.ndarray, point: np.ndarray
    ) -> None:
        """
        Begin to hold a body at `grasp`, drawn towards `point`; world [m], centre at that time.
        """
        with self._lock:
            offset = np.asarray(centre, float) - np.asarray(grasp, float)
            self._held[page] = (body, offset, np.asarray(point, float) + offset)
        self._send(page)

    def move(self, page: int, point: np.ndarray) -> None:
        """Draw what this page holds towards a point [m]; the shell stays in the mouse's hand."""
        with self._lock:
            if page not in self._held:
                return
            body, offset, _ = self._held[page]
            self._held[page] = (body, offset, np.asarray(point, float) + offset)
        self._send(page)

    def let_go(self, page: int) -> None:
        """End it, also when the page closes."""
        with self._lock:
            held, sent = self._held.pop(page, None), self._sent.pop(page, None)
            if held is not None and sent is not None:
                self._pull(held[0], None)

    def repeat(self) -> None:
        """
        Send again what was not sent for a while, and end what silent pages hold; called often.

        A page whose mouse still holds the shell pulls again once that mouse moves.
        """
        now = time.monotonic()
        for page, sent in list(self._sent.items()):
            if self._is_silent(page):
                self._interrupt(page)
            elif now - sent > _REPEAT:
                self._send(page)

    def lines(self, poses: np.ndarray) -> np.ndarray:
        """From each held shell to where it is drawn, (m, 2, 3) [m]."""
        with self._lock:
            held = [self._held[page] for page in self._sent]
        ends = [
            (poses[body, :3], point) for body, _, point in held if body < len(poses)]
        return np.array(ends, float).reshape(-1, 2, 3)

    def _interrupt(self, page: int) -> None:
        """Let go of what a page pulls; the mouse there may still hold the shell."""
        with self._lock:
            if self._sent.pop(page, None) is not None:
                self._pull(self._held[page][0], None)

    def _send(self, page: int) -> None:
        # Under the lock: else an older point could go out after a newer one, or after the end.
        with self._lock:
            held = self._held.get(page)
            if held is not None:
                self._sent[page] = time.monotonic()
                x, y, z = held[2].tolist()
                self._pull(held[0], (x, y, z))
