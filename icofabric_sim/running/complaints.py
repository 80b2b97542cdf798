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
"""Complaints about what others send: each kind is heard at once, and a flood of it rarely."""

from collections.abc import Callable
import time

# Wall time between two lines of one kind [s]: at first, and at most.
FIRST_INTERVAL, LONGEST_INTERVAL = 1.0, 60.0
LONGEST_LINE = 1000  # characters
# A line that stands for more than this many makes the next one wait twice as long.
_FEW = 10
# Kinds that are counted separately: a limit, so that invented ones cannot fill the memory.
_MOST_KINDS = 1000


def shortened(text: str) -> str:
    """A line for a log or an answer, which quotes a received text, without its middle if long."""
    if len(text) <= LONGEST_LINE:
        return text
    half = LONGEST_LINE // 2
    return f'{text[:half]} [...{len(text) - 2 * half} characters...] {text[-half:]}'


class _Kind:
    """What was said of one kind, and what was not."""

    def __init__(self, now: float) -> None:
        self.next_time, self.interval, self.unsaid = now, FIRST_INTERVAL, 0


class Complaints:
    """Lines for a log; not for use by several threads at once."""

    def __init__(self, say: Callable[[str], object]) -> None:
        """`say` writes a line."""
        self._say = say
        self._kinds: dict[str, _Kind] = {}

    def add(self, kind: str, text: str) -> None:
        """Complain with `text`, unless its `kind` was heard of lately; then it is counted only."""
        now = time.monotonic()
        if kind not in self._kinds and len(self._kinds) >= _MOST_KINDS:
            self._kinds.clear()
        entry = self._kinds.setdefault(kind, _Kind(now))
        if now < entry.next_time:
            entry.unsaid += 1
            return
        unsaid, entry.unsaid = entry.unsaid, 0
        entry.interval = min(
            2.0 * entry.interval, LONGEST_INTERVAL) if unsaid > _FEW else FIRST_INTERVAL
        entry.next_time = now + entry.interval
        self._say(f'{text} ({unsaid} more like it before)' if unsaid else text)
