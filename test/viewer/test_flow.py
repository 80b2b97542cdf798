# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Each page gets no more frames than it comes to, and waits for no other."""

import asyncio
from types import SimpleNamespace

from icofabric_sim.viewer import flow
from icofabric_sim.viewer.flow import Flow
import pytest

messages = pytest.importorskip('viser._messages', reason='viser is not installed')

VIEW = 0.6
FRAME, WORDS = messages.SceneNodeUpdateMessage('/shells', {}), messages.SetCameraFovMessage(1.0)


class Buffer:
    """What all pages are sent: endless frames, each with the number of those before."""

    def __init__(self, *windows):
        self._windows = windows or None

    async def window_generator(self, number):
        for window in self._windows or iter(lambda: [FRAME], None):
            yield window


class Reader:
    """A page that is sent windows, and says when it has come to a frame."""

    def __init__(self, number, frames, buffer):
        self.client_id, self.camera, self.marks = number, self, []
        self._frames, self._buffer = frames, buffer

    @property
    def _websock_connection(self):
        return SimpleNamespace(queue_message=lambda message: None)

    def on_update(self, heard):
        self._heard = heard

    async def read(self, count):
        """Read up to so many windows, as soon as they come."""
        async for window in self._buffer.window_generator(self.client_id):
            self.marks += [item.fov for item in window if item not in (FRAME, WORDS)]
            count -= 1
            if not count:
                return

    async def come_to(self, frame):
        await self._heard(SimpleNamespace(fov=self.marks[frame]))


async def until_it_waits():
    for _ in range(50):
        await asyncio.sleep(0)


def test_pages_get_frames_at_their_own_rates():
    async def check():
        frames, buffer = Flow(VIEW), Buffer()
        frames.pace(buffer)
        assert frames.is_free()
        slow, fast = (Reader(number, frames, buffer) for number in range(2))
        for page in (slow, fast):
            frames.begin(page)
        tasks = [asyncio.ensure_future(page.read(1000)) for page in (slow, fast)]
        await until_it_waits()
        assert len(slow.marks) == len(fast.marks) == 3 and not frames.is_free()
        for number in range(20):
            await fast.come_to(number)
            assert frames.is_free()
            await until_it_waits()
            # Another camera of the page, as when it is turned, says the same again.
            await fast.come_to(number)
            await until_it_waits()
            assert len(fast.marks) == number + 4 and len(slow.marks) == 3
        await slow.come_to(2)
        await until_it_waits()
        assert len(slow.marks) == 6
        # Each mark is told from those before, and none is seen.
        assert len(set(fast.marks)) == 4 and VIEW <= max(fast.marks) < VIEW * 1.0002
        frames.end(1)
        assert not frames.is_free()
        for task in tasks:
            task.cancel()

    asyncio.run(check())


def test_a_page_that_says_nothing_gets_a_frame_now_and_then(monkeypatch):
    monkeypatch.setattr(flow, '_MARK_WAIT_S', 0.001)

    async def check():
        frames, buffer = Flow(VIEW), Buffer()
        frames.pace(buffer)
        page = Reader(0, frames, buffer)
        frames.begin(page)
        await asyncio.wait_for(page.read(10), 60.0)
        assert len(page.marks) == 10

    asyncio.run(check())


def test_what_is_no_frame_waits_for_none():
    async def check():
        frames, buffer = Flow(VIEW), Buffer(*[[WORDS]] * 9, [FRAME, WORDS])
        frames.pace(buffer)
        page = Reader(0, frames, buffer)
        frames.begin(page)
        await asyncio.wait_for(page.read(10), 60.0)
        assert len(page.marks) == 1

    asyncio.run(check())


def test_silence_ends_with_any_word(monkeypatch):
    now = SimpleNamespace(time=0.0)
    monkeypatch.setattr(flow.time, 'monotonic', lambda: now.time)
    monkeypatch.setattr(flow, '_SILENCE_S', 0.5)

    async def check():
        frames, buffer = Flow(VIEW), Buffer()
        frames.pace(buffer)
        page = Reader(0, frames, buffer)
        frames.begin(page)
        now.time = 9.0
        assert not frames.is_silent(0)  # it was sent nothing
        await page.read(2)
        now.time = 9.4
        assert not frames.is_silent(0)
        now.time = 9.6
        assert frames.is_silent(0)
        frames.hear(0)
        assert not frames.is_silent(0)
        now.time = 10.2
        assert frames.is_silent(0)
        await page.come_to(0)
        assert not frames.is_silent(0)
        now.time = 11.0  # its first answer took 1.2 s, of which 0.3 s count
        assert not frames.is_silent(0)
        now.time = 11.2
        assert frames.is_silent(0)
        await page.come_to(1)
        now.time = 99.0
        assert not frames.is_silent(0)  # it has answered all

    asyncio.run(check())
