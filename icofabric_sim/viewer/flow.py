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
How far each page has come: what a page cannot draw in time must not wait there, frame on frame.

A browser takes messages faster than it draws, and so keeps them; its socket never says so. So each
frame brings a mark along, which the page sends back with its camera once it has come to the frame:
an angle of view that differs by less than is seen. The frames of a page wait for its own marks.
viser keeps the newest of each message until all have it, so a slow page leaves out frames.
"""

import asyncio
from collections.abc import AsyncGenerator, Sequence
from importlib import import_module
import time
from typing import Any

# Frames that may be under way to a page, so that those that draw fast need not wait for marks.
_AHEAD = 3
# For how long a page that sends no mark back is waited for [s].
_PATIENCE = 3.0
# A page is silent that has left a mark unanswered for so long [s], or for so many times as long as
# its answers usually take, of which each counts as much in the mean; that is at most so long [s].
_SILENCE_S, _SILENCE_RATIO, _NEWEST_RATIO, _LONGEST_ANSWER_S = 0.5, 3.0, 0.3, 1.0
# Relative differences of the angle: viser passes over what is nearer than 1e-5.
_MARKS, _STEP = 4, 3e-5

# A page draws on and answers while the browser around it has stopped, which no mouse reaches then:
# so answers wait for a word of the browser, whose own process knows permissions.
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


class _Reader:
    """The marks of one page."""

    def __init__(self) -> None:
        self.sent = self.come = 0  # frames
        self.heard = self.asked = time.monotonic()
        self.answer_time = 0.0  # mean [s]
        self.news = asyncio.Event()

    @property
    def is_free(self) -> bool:
        return self.sent - self.come < _AHEAD

    def ask(self) -> int:
        """Count a frame, and return its mark."""
        if self.sent == self.come:
            self.asked = time.monotonic()
        self.sent += 1
        return self.sent % _MARKS

    def take(self, mark: int) -> None:
        """Note a mark; the last frame that was sent with this mark is reached."""
        frame = self.sent - (self.sent - mark) % _MARKS
        if frame > self.come:
            now = time.monotonic()
            taken = min(now - self.asked, _LONGEST_ANSWER_S)
            self.answer_time += _NEWEST_RATIO * (taken - self.answer_time)
            self.come, self.asked = frame, now
        self.news.set()

    def is_silent(self) -> bool:
        """Return whether the page has answered nothing, and sent nothing, for too long."""
        silence = time.monotonic() - max(self.asked, self.heard)
        return self.come < self.sent and silence > max(
            _SILENCE_S, _SILENCE_RATIO * self.answer_time)


class Flow:
    """The marks of all pages, each of which gets frames at its own rate."""

    def __init__(self, view: float) -> None:
        """Mark pages whose angle of view is `view` [rad]."""
        self._view = view
        self._readers: dict[int, _Reader] = {}
        messages = import_module('viser._messages')
        self._update, self._fov = messages.SceneNodeUpdateMessage, messages.SetCameraFovMessage
        self._script = messages.RunJavascriptMessage(_ASK_BROWSER)

    def pace(self, buffer: Any) -> None:
        """Have what the broadcast `buffer` of viser holds wait for each page by itself."""
        windows = buffer.window_generator
        buffer.window_generator = lambda number, **words: self._paced(
            number, windows(number, **words))

    def begin(self, page: Any) -> None:
        """Hear the marks of a client of viser that has come."""
        reader = self._readers[page.client_id] = _Reader()

        page._websock_connection.queue_message(self._script)

        @page.camera.on_update  # type: ignore[untyped-decorator]
        async def _(camera: Any) -> None:
            reader.heard = time.monotonic()
            mark = round((camera.fov / self._view - 1.0) / _STEP)
            if 0 <= mark < _MARKS:
                reader.take(mark)

    def end(self, number: int) -> None:
        """Wait for a page no longer."""
        self._readers.pop(number, None)

    def hear(self, number: int) -> None:
        """Note that a page has sent something."""
        if number in self._readers:
            self._readers[number].heard = time.monotonic()

    def is_silent(self, number: int) -> bool:
        """Return whether a page has stopped answering."""
        reader = self._readers.get(number)
        return reader is not None and reader.is_silent()

    def is_free(self) -> bool:
        """Return whether any page can take another frame, or none is there."""
        readers = list(self._readers.values())
        return not readers or any(reader.is_free for reader in readers)

    async def _paced(self, number: int, windows: Windows) -> Windows:
        """Yield the `windows` of messages for a page, a mark behind each frame."""
        try:
            async for window in windows:
                reader = self._readers.get(number)
                if reader is None or not any(isinstance(item, self._update) for item in window):
                    yield window
                    continue
                yield [*window, self._fov(self._view * (1.0 + _STEP * reader.ask()))]
                while not reader.is_free:
                    reader.news.clear()
                    try:
                        await asyncio.wait_for(reader.news.wait(), _PATIENCE)
                    except TimeoutError:
                        reader.come = reader.sent - _AHEAD + 1
        finally:
            await windows.aclose()
