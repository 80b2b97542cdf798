# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Flow control for each page, so that frames do not queue up in a browser that draws slowly.

A browser accepts messages faster than it draws and queues them; its socket does not report the
backlog. Each frame therefore carries a mark: a change of the camera's angle of view that is too
small to see. The page returns the angle with its camera once it has drawn the frame. Frames of a
page wait for the page's own marks. viser keeps the newest message of each kind until every page
has it, so a slow page skips frames.
"""

import asyncio
from collections.abc import AsyncGenerator, Sequence
from importlib import import_module
import time
from typing import Any

# Frames in flight to a page, so that fast pages need not wait for marks.
_MAX_FRAMES_AHEAD = 3
# Longest wait for a page that returns no mark [s].
_MARK_WAIT_S = 3.0
# A page is silent if a mark is unanswered for the first time [s], or for this multiple of its mean
# answer time. The newest answer has this weight in the mean; the mean is limited to the last time
# [s].
_SILENCE_S, _SILENCE_RATIO, _NEWEST_RATIO, _LONGEST_ANSWER_S = 0.5, 3.0, 0.3, 1.0
# Relative steps of the angle; viser ignores changes below 1e-5.
_MARK_COUNT, _ANGLE_STEP_RATIO = 4, 3e-5

# A page still draws and answers while the browser's user interface is blocked, when no mouse event
# reaches the page. So each answer waits for a query of permissions, which the browser process
# answers.
_ASK_BROWSER = """(() => {
    const page = window.__viserMutable, send = page?.sendCamera;
    if (send && !send.asks && navigator.permissions) {
        page.sendCamera = () => {
            navigator.permissions.query({name: 'geolocation'}).then(send, send);
        };
        page.sendCamera.asks = true;
    }
})()"""

Windows = AsyncGenerator[Sequence[Any], None]


class _PageMarks:
    """Marks sent to and returned by one page."""

    def __init__(self) -> None:
        self.sent = self.come = 0  # frames
        self.heard = self.asked = time.monotonic()
        self.answer_time = 0.0  # mean [s]
        self.news = asyncio.Event()

    @property
    def is_free(self) -> bool:
        return self.sent - self.come < _MAX_FRAMES_AHEAD

    def ask(self) -> int:
        """Count a frame and return its mark."""
        if self.sent == self.come:
            self.asked = time.monotonic()
        self.sent += 1
        return self.sent % _MARK_COUNT

    def take(self, mark: int) -> None:
        """Record a returned mark: the page has drawn the last frame sent with this mark."""
        frame = self.sent - (self.sent - mark) % _MARK_COUNT
        if frame > self.come:
            now = time.monotonic()
            taken = min(now - self.asked, _LONGEST_ANSWER_S)
            self.answer_time += _NEWEST_RATIO * (taken - self.answer_time)
            self.come, self.asked = frame, now
        self.news.set()

    def is_silent(self) -> bool:
        """Return whether the page has neither answered nor sent anything for too long."""
        silence = time.monotonic() - max(self.asked, self.heard)
        return self.come < self.sent and silence > max(
            _SILENCE_S, _SILENCE_RATIO * self.answer_time)


class Flow:
    """Flow control of all pages; each page gets frames at its own rate."""

    def __init__(self, view: float) -> None:
        """Prepare for pages whose angle of view is `view` [rad]."""
        self._view = view
        self._readers: dict[int, _PageMarks] = {}
        messages = import_module('viser._messages')
        self._update, self._fov = messages.SceneNodeUpdateMessage, messages.SetCameraFovMessage
        self._script = messages.RunJavascriptMessage(_ASK_BROWSER)

    def pace(self, buffer: Any) -> None:
        """Let each page receive the broadcast `buffer` of viser at its own rate."""
        windows = buffer.window_generator
        buffer.window_generator = lambda number, **words: self._paced(
            number, windows(number, **words))

    def begin(self, page: Any) -> None:
        """Receive the marks of a new client of viser."""
        reader = self._readers[page.client_id] = _PageMarks()

        page._websock_connection.queue_message(self._script)

        @page.camera.on_update  # type: ignore[untyped-decorator]
        async def _(camera: Any) -> None:
            reader.heard = time.monotonic()
            mark = round((camera.fov / self._view - 1.0) / _ANGLE_STEP_RATIO)
            if 0 <= mark < _MARK_COUNT:
                reader.take(mark)

    def end(self, number: int) -> None:
        """Remove a page that has closed."""
        self._readers.pop(number, None)

    def hear(self, number: int) -> None:
        """Record that a page has sent a message."""
        if number in self._readers:
            self._readers[number].heard = time.monotonic()

    def is_silent(self, number: int) -> bool:
        """Return whether a page has stopped answering."""
        reader = self._readers.get(number)
        return reader is not None and reader.is_silent()

    def is_free(self) -> bool:
        """Return whether any page can take another frame, or no page is open."""
        readers = list(self._readers.values())
        return not readers or any(reader.is_free for reader in readers)

    async def _paced(self, number: int, windows: Windows) -> Windows:
        """Yield the `windows` of messages for a page, with a mark after each frame."""
        try:
            async for window in windows:
                reader = self._readers.get(number)
                if reader is None or not any(isinstance(item, self._update) for item in window):
                    yield window
                    continue
                yield [*window, self._fov(self._view * (1.0 + _ANGLE_STEP_RATIO * reader.ask()))]
                while not reader.is_free:
                    reader.news.clear()
                    try:
                        await asyncio.wait_for(reader.news.wait(), _MARK_WAIT_S)
                    except TimeoutError:
                        reader.come = reader.sent - _MAX_FRAMES_AHEAD + 1
        finally:
            await windows.aclose()
