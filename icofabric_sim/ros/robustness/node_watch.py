# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Start of a node in a separate process, and detection of a node that does not become ready.

The output of the node is shown as it arrives. A wait ends early only for a known reason: the
process has ended, it neither prints nor computes, or it is ready but unreachable.
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

from icofabric_sim.process.compile_notice import COMPILING, STILL_COMPILING

# A node that neither prints nor uses the processor for this time [s] is stuck.
MAX_SILENCE_S = 60.0
# Discovery of a ready node takes a second or a few, and longer on a busy machine [s].
DISCOVERY_S = 60.0
# A wait is explained after this time [s], and again after each such interval.
REPORT_INTERVAL_S = 10.0
# An idle process uses less processor time [s] than this in MAX_SILENCE_S, for its timers.
_IDLE_PROCESSOR_S = 0.5


class NodeStuck(Exception):
    """Error raised when waiting for a node is pointless; the message gives the reason."""


class NodeWatch:
    """Running node and its progress towards readiness."""

    def __init__(
        self, command: Sequence[str], ready: str, *, out: IO[str] | None = None,
        clock: Callable[[], float] = time.monotonic,
        processor: Callable[[int], float] | None = None,
    ) -> None:
        """
        Start `command`; an output line that contains `ready` means that the topics exist.

        `clock` [s] and `processor`, the processor time [s] used by a process, are replaced in
        tests.
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
        """Return whether the process has ended."""
        return self.process.poll() is not None

    @property
    def is_ready(self) -> bool:
        """Return whether the node has reported that its topics exist."""
        return self._ready_at is not None

    def wait(self) -> int:
        """Wait for the end of the process and of its output; return the exit status."""
        status = self.process.wait()
        self._reader.join()
        return status

    def judge(self, seen: Callable[[], str]) -> None:
        """
        Report from time to time why the caller waits; raise NodeStuck if waiting is pointless.

        `seen` describes the part of the node that this process has discovered, '' for none.
        """
        now = self._clock()
        used = self._used(self.process.pid)
        if used - self._work_seen >= _IDLE_PROCESSOR_S:
            self._work_seen, self._worked_at = used, now
        ready_at = self._ready_at
        if ready_at is not None:
            if now - ready_at > DISCOVERY_S:
                raise NodeStuck(
                    f'fabric_node has been ready for {now - ready_at:.0f} s, but '
                    f'{seen() or "this process has not discovered it over ROS 2"} (ROS_DOMAIN_ID '
                    f'{os.environ.get("ROS_DOMAIN_ID", "0")}, '
                    f'{os.environ.get("RMW_IMPLEMENTATION") or "the default middleware"}): does a '
                    'firewall block the loopback interface, or do the two use different '
                    'middleware?')
        elif now - max(self._said_at, self._worked_at) > MAX_SILENCE_S:
            raise NodeStuck(
                f'fabric_node runs, but for {now - self._said_at:.0f} s it printed nothing and '
                f'for {now - self._worked_at:.0f} s it has not used the processor: it is stuck'
                + (f'; its last line: {self._last_line}' if self._last_line else ''))
        if now - self._told_at >= REPORT_INTERVAL_S:
            self._told_at = now
            print(f'   {now - self._started:.0f} s: {self._describe_wait(now, seen)}',
                  file=self._out, flush=True)

    def _describe_wait(self, now: float, seen: Callable[[], str]) -> str:
        used = self._used(self.process.pid)
        if self._ready_at is not None:
            what = seen() or 'it is not discovered over ROS 2 yet'
            return f'waiting for the first pose; fabric_node is ready, {what}'
        effort = f'({used:.0f} s of processor time so far)'
        if now - self._compiled_at < 2.0 * REPORT_INTERVAL_S:
            return f'waiting for fabric_node, which is compiling its kernels {effort}'
        if now - self._worked_at < REPORT_INTERVAL_S:
            return f'waiting for fabric_node, which is busy {effort}'
        return f'waiting for fabric_node, silent for {now - self._said_at:.0f} s'

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
    """Run a node until the block ends, then stop it."""
    node = NodeWatch(command, ready)
    try:
        yield node
    finally:
        if not node.has_ended:
            node.process.terminate()
        node.wait()


def processor_time(pid: int) -> float:
    """Return the processor time [s] used by a process; 0 if it cannot be read."""
    try:
        # The process name, in brackets, may contain any character.
        fields = Path(f'/proc/{pid}/stat').read_text(encoding='utf-8').rpartition(')')[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')
    except (OSError, IndexError, ValueError):
        return 0.0
