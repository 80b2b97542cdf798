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
"""A page gets no more frames than it comes to."""

import asyncio
from types import SimpleNamespace

from icofabric_sim.viewer import flow
from icofabric_sim.viewer.flow import Flow
import pytest

VIEW = 0.6


class Camera:
    """That of a client of viser, which takes no angle that is as good as its own."""

    def __init__(self):
        self.taken, self.heard = [], None
        self._fov = 1.3

    def on_update(self, heard):
        self.heard = heard

    @property
    def fov(self):
        return self._fov

    @fov.setter
    def fov(self, value):
        if abs(value - self._fov) > 1e-8 + 1e-5 * abs(value):
            self._fov = value
            self.taken.append(value)

    def come_to(self, frame):
        """Say that this frame is reached, as the page does."""
        asyncio.run(self.heard(SimpleNamespace(fov=self.taken[frame])))


@pytest.fixture
def clock(monkeypatch):
    now = SimpleNamespace(time=0.0)
    monkeypatch.setattr(flow.time, 'monotonic', lambda: now.time)
    return now


@pytest.fixture
def page():
    return SimpleNamespace(client_id=3, camera=Camera())


def test_a_page_that_does_not_draw_gets_few_frames(clock, page):
    frames = Flow(VIEW)
    frames.begin(page)
    for _ in range(3):
        assert frames.is_free()
        frames.mark([page])
    assert not frames.is_free()
    page.camera.come_to(0)
    assert frames.is_free()
    frames.mark([page])
    assert not frames.is_free()
    page.camera.come_to(3)
    # Another camera of the page, as when it is turned, says the same again.
    page.camera.come_to(3)
    for _ in range(3):
        assert frames.is_free()
        frames.mark([page])
    assert not frames.is_free()
    # Every mark was told from those before, and none is seen.
    assert len(page.camera.taken) == 7
    assert max(page.camera.taken) < VIEW * 1.0002


def test_a_page_that_says_nothing_does_not_stop_the_others(clock, page):
    frames = Flow(VIEW)
    frames.begin(page)
    for _ in range(3):
        frames.mark([page])
    assert not frames.is_free()
    clock.time += 3.1
    assert frames.is_free()
    frames.mark([page])
    frames.end(page)
    for _ in range(9):
        assert frames.is_free()
        frames.mark([])
