# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Rate-limited warnings about invalid inputs: each kind is logged at once, repeats rarely."""

from collections.abc import Callable
import time

# Wall time between two lines of one kind [s]: initial and largest value.
MIN_INTERVAL_S, MAX_INTERVAL_S = 1.0, 60.0
MAX_LINE_LENGTH = 1000  # characters
# A line that summarises more than this number doubles the next interval.
_DOUBLING_COUNT = 10
# Number of kinds counted separately, limited so that invented kinds cannot fill the memory.
_MAX_KINDS = 1000


def shortened(text: str) -> str:
    """Return a line for a log or an answer; the middle of a long quoted text is omitted."""
    if len(text) <= MAX_LINE_LENGTH:
        return text
    half = MAX_LINE_LENGTH // 2
    return f'{text[:half]} [...{len(text) - 2 * half} characters...] {text[-half:]}'


class _Kind:
    """Counts of logged and suppressed warnings of one kind."""

    def __init__(self, now: float) -> None:
        self.next_time, self.interval, self.suppressed = now, MIN_INTERVAL_S, 0


class RateLimitedLog:
    """Rate-limited log lines; not thread-safe."""

    def __init__(self, write: Callable[[str], object]) -> None:
        """Write lines with `write`."""
        self._write = write
        self._kinds: dict[str, _Kind] = {}

    def log(self, kind: str, text: str) -> None:
        """Log `text`, or only count it if its `kind` was logged recently."""
        now = time.monotonic()
        if kind not in self._kinds and len(self._kinds) >= _MAX_KINDS:
            self._kinds.clear()
        entry = self._kinds.setdefault(kind, _Kind(now))
        if now < entry.next_time:
            entry.suppressed += 1
            return
        suppressed, entry.suppressed = entry.suppressed, 0
        entry.interval = (
            min(2.0 * entry.interval, MAX_INTERVAL_S) if suppressed > _DOUBLING_COUNT
            else MIN_INTERVAL_S)
        entry.next_time = now + entry.interval
        self._write(f'{text} ({suppressed} similar ones before)' if suppressed else text)
