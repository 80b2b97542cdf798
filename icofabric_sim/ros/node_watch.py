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
Starts a node in a process of its own and judges, while others wait for it, whether it gets on.

What the node says is shown as it comes. A wait ends early only for a reason that is known: the
process has ended, it neither says nor computes anything, it is ready but out of reach.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import math
import os
from pathlib import Path
import subprocess
import sys
import threading
import time
from typing import IO

from icofabric_sim.kernels.runtime.compile_notice import COMPILING, STILL_COMPILING

# A node that neither says anything nor uses the processor for so long [s] is stuck.
SILENCE = 60.0
# One that is ready is found by others within a second or a few; on a busy machine later [s].
DISCOVERY = 60.0
# A wait is explained after so long [s], and again after each such time.
REPORT = 10.0
# Less of the processor [s] in SILENCE is what an idle process takes for its timers.
_IDLE = 0.5


class NodeStuck(Exception):
    """Waiting for a node has no prospect; the message says why."""


class NodeWatch:
    """A running node, and what is known of how far it is."""

    def __init__(
        self, command: Sequence[str], ready: str, *, out: IO[str] | None = None,
        clock: Callable[[], float] = time.monotonic,
        processor: Callable[[int], float] | None = None,
    ) -> None:
        """
        Start `command`; a line that holds `ready` says that its topics are there.

        `clock` [s] and `processor`, the time [s] that a process has used, are replaced by tests.
        """
        self._ready_word, self._out = ready, sys.stderr if out is None else out
        self._clock, self._used = clock, processor_time if processor is None else processor
        self._started = self._said_at = self._worked_at = self._told_at = clock()
        self._ready_at: float | None = None
        self._compiled_at, self._last_line = -math.inf, ''
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            encoding='utf-8', errors='replace', env={**os.environ, 'PYTHONUNBUFFERED': '1'})
        self._work_seen = self._used(self.process.pid)
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def has_ended(self) -> bool:
        """Whether the process is gone."""
        return self.process.poll() is not None

    @property
    def is_ready(self) -> bool:
        """Whether the node has said that its topics are there."""
        return self._ready_at is not None

    def wait(self) -> int:
        """Wait for the end of the process and of what it says; returns its exit status."""
        status = self.process.wait()
        self._reader.join()
        return status

    def judge(self, seen: Callable[[], str]) -> None:
        """
        Show now and then what is waited for; raise NodeStuck where that is for nothing.

        `seen` says what of the node this process sees over ROS 2; '': nothing.
        """
        now = self._clock()
        used = self._used(self.process.pid)
        if used - self._work_seen >= _IDLE:
            self._work_seen, self._worked_at = used, now
        ready_at = self._ready_at
        if ready_at is not None:
            if now - ready_at > DISCOVERY:
                raise NodeStuck(
                    f'fabric_node has been ready for {now - ready_at:.0f} s, but '
                    f'{seen() or "this process does not see it over ROS 2"} (ROS_DOMAIN_ID '
                    f'{os.environ.get("ROS_DOMAIN_ID", "0")}, '
                    f'{os.environ.get("RMW_IMPLEMENTATION") or "the default middleware"}): is a '
                    'firewall in the way of the loopback interface, or do the two use different '
                    'middleware?')
        elif now - max(self._said_at, self._worked_at) > SILENCE:
            raise NodeStuck(
                f'fabric_node runs, but for {now - self._said_at:.0f} s it has said nothing and '
                f'for {now - self._worked_at:.0f} s it has not used the processor: it is stuck'
                + (f'; its last line: {self._last_line}' if self._last_line else ''))
        if now - self._told_at >= REPORT:
            self._told_at = now
            print(f'   {now - self._started:.0f} s: {self._waited_for(now, seen)}',
                  file=self._out, flush=True)

    def _waited_for(self, now: float, seen: Callable[[], str]) -> str:
        used = self._used(self.process.pid)
        if self._ready_at is not None:
            what = seen() or 'it has not been found over ROS 2 yet'
            return f'waiting for the first pose; fabric_node is ready, {what}'
        effort = f'({used:.0f} s of the processor so far)'
        if now - self._compiled_at < 2.0 * REPORT:
            return f'waiting for fabric_node, which compiles its kernels {effort}'
        if now - self._worked_at < REPORT:
            return f'waiting for fabric_node, which is at work {effort}'
        return f'waiting for fabric_node, which has said nothing for {now - self._said_at:.0f} s'

    def _read(self) -> None:
        assert self.process.stdout is not None
        with self.process.stdout as lines:
            for line in lines:
                self._said_at, self._last_line = self._clock(), line.strip()
                if COMPILING in line or STILL_COMPILING in line:
                    self._compiled_at = self._clock()
                if self._ready_word in line and self._ready_at is None:
                    self._ready_at = self._clock()
                self._out.write(line)
                self._out.flush()


@contextmanager
def watched_node(command: Sequence[str], ready: str) -> Iterator[NodeWatch]:
    """A node that is asked to end where the wait for it does."""
    node = NodeWatch(command, ready)
    try:
        yield node
    finally:
        if not node.has_ended:
            node.process.terminate()
        node.wait()


def processor_time(pid: int) -> float:
    """Time [s] of the processor that a process has used; 0 where that cannot be known."""
    try:
        # The name, in brackets, may hold anything.
        fields = Path(f'/proc/{pid}/stat').read_text(encoding='utf-8').rpartition(')')[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
    except (OSError, IndexError, ValueError):
        return 0.0
