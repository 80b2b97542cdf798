# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Actions of a page on a fabric, and the drag of a held mouse button.

They are implemented for a run in this process (local.py) and for a node (ros/viewer.py).
"""

from collections.abc import Callable
from concurrent.futures import Future
import threading
import time
from typing import Any, Protocol

import numpy as np

# Interval at which a drag is repeated while the mouse is held still [s].
_REPEAT_INTERVAL_S = 0.1


class Actions(Protocol):
    """
    Actions on a run; each answers with a sentence, or with an exception that gives the reason.
    """

    @property
    def is_replay(self) -> bool:
        """Return whether a recorded run is shown, whose shells cannot be dragged."""

    def pull(self, body: int, point: tuple[float, float, float] | None) -> None:
        """Drag a body towards a point [m] in the world frame, or release it with None."""

    def command(self, name: str, on: bool | None = None) -> 'Future[str]':
        """Call the service `name`, e.g. pause; `on` is the flag of a SetBool service."""

    def change(self, name: str, value: Any) -> 'Future[str]':
        """Set a parameter."""


class MouseDrags:
    """Shells held by the mice of all pages; the target points are sent repeatedly."""

    def __init__(
        self, pull: Callable[[int, tuple[float, float, float] | None], None],
        is_silent: Callable[[int], bool] = lambda page: False
    ) -> None:
        """Send through `pull`; `is_silent` tells whether a page has stopped answering."""
        self._pull, self._is_silent = pull, is_silent
        self._lock = threading.Lock()
        self._held: dict[int, tuple[int, np.ndarray, np.ndarray]] = {}  # by page
        self._sent: dict[int, float] = {}  # of pages whose drag is active

    def take(
        self, page: int, body: int, centre: np.ndarray, grasp: np.ndarray, point: np.ndarray
    ) -> None:
        """
        Start to drag a body at `grasp` towards `point`; world frame [m], body centre at that time.
        """
        with self._lock:
            offset = np.asarray(centre, float) - np.asarray(grasp, float)
            self._held[page] = (body, offset, np.asarray(point, float) + offset)
        self._send(page)

    def move(self, page: int, point: np.ndarray) -> None:
        """Move the target of a page's drag to a point [m]; the grasped point follows the mouse."""
        with self._lock:
            if page not in self._held:
                return
            body, offset, _ = self._held[page]
            self._held[page] = (body, offset, np.asarray(point, float) + offset)
        self._send(page)

    def release(self, page: int) -> None:
        """Release the shell, also when the page closes."""
        with self._lock:
            held, sent = self._held.pop(page, None), self._sent.pop(page, None)
            if held is not None and sent is not None:
                self._pull(held[0], None)

    def repeat(self) -> None:
        """
        Resend old targets and end the drags of silent pages; call often.

        A page whose mouse still holds the shell drags again once that mouse moves.
        """
        now = time.monotonic()
        for page, sent in list(self._sent.items()):
            if self._is_silent(page):
                self._interrupt(page)
            elif now - sent > _REPEAT_INTERVAL_S:
                self._send(page)

    def lines(self, poses: np.ndarray) -> np.ndarray:
        """Return lines from each dragged shell to its target, (m, 2, 3) [m]."""
        with self._lock:
            held = [self._held[page] for page in self._sent]
        ends = [
            (poses[body, :3], point) for body, _, point in held if body < len(poses)]
        return np.array(ends, float).reshape(-1, 2, 3)

    def _interrupt(self, page: int) -> None:
        """Release the shell of a silent page; its mouse may still hold it."""
        with self._lock:
            if self._sent.pop(page, None) is not None:
                self._pull(self._held[page][0], None)

    def _send(self, page: int) -> None:
        # Under the lock, so that an older point cannot be sent after a newer one, or after the
        # end.
        with self._lock:
            held = self._held.get(page)
            if held is not None:
                self._sent[page] = time.monotonic()
                x, y, z = held[2].tolist()
                self._pull(held[0], (x, y, z))
