# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Terminal output of the verbs: progress with the remaining time, notes, errors."""

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, ExitStack
import logging
import math
import os
from pathlib import Path
import shutil
import sys
import time
from types import TracebackType
from typing import Self, TextIO

from icofabric_sim.process.compile_notice import compile_notice

# Wall time between two updates of the bar [s], and between two lines without a terminal.
_REDRAW_S, _LINE_INTERVAL_S = 0.1, 10.0
# The speed is averaged over about this time [s]: a stretching fabric needs shorter steps.
_WINDOW_S = 8.0
# The remaining time is shown after this time [s], and if the speeds of its two halves differ at
# most by this ratio.
_MIN_TIME_S, _MAX_SPEED_RATIO = 2.0, 2.0


# Set by --quiet.
_QUIET = 'ICOFABRIC_QUIET'


@contextmanager
def quiet(wanted: bool) -> Iterator[None]:
    """Suppress progress, also of processes started meanwhile; warnings stay."""
    before = os.environ.get(_QUIET)
    if wanted:
        os.environ[_QUIET] = '1'
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(_QUIET, None)
        else:
            os.environ[_QUIET] = before


def is_quiet() -> bool:
    """Return whether progress is suppressed."""
    return os.environ.get(_QUIET, '') not in ('', '0')


def say(text: str) -> None:
    """Print progress of the work on the error stream, unless suppressed."""
    if not is_quiet():
        print(text, file=sys.stderr, flush=True)


class InputError(Exception):
    """Invalid input: exit status 2."""


class CommandFailed(Exception):
    """A failed run, or a damaged or unfinished file: exit status 1."""


@contextmanager
def bad_input() -> Iterator[None]:
    """Convert ValueErrors of invalid user input into InputErrors."""
    try:
        yield
    except ValueError as error:
        raise InputError(str(error)) from error


def require_place(option: str, path: Path, *, is_folder: bool = False) -> Path:
    """Reject a path where no file or folder can be created, before the work starts."""
    folder = path.absolute() if is_folder else path.absolute().parent
    while not os.path.lexists(folder):
        folder = folder.parent
    if not folder.is_dir():
        raise InputError(f'{option} {path}: {folder} is not a folder; choose another place')
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f'{option} {path}: {folder} is not writable; choose another place')
    return path


class Progress:
    """Progress bar on a terminal, or occasional lines; the bar is erased at the end."""

    def __init__(
        self, total: float, unit: str, *, stream: TextIO | None = None, foreseen: bool = True
    ) -> None:
        """
        Count from 0 to `total` [unit].

        `foreseen`: predict the remaining time from the recent speed; otherwise show the elapsed
        time.
        """
        self.total, self.unit, self.foreseen = total, unit, foreseen
        self.stream = sys.stderr if stream is None else stream
        self.is_terminal = self.stream.isatty()
        self.quiet = is_quiet()
        self._start = self._last = time.monotonic()
        self._notices = ExitStack()
        self._marks: deque[tuple[float, float]] = deque([(_working_time(), 0.0)])
        self._shown = 0

    def update(self, done: float) -> None:
        """Show that `done` of the total is done, if an update is due."""
        now, worked = time.monotonic(), _working_time()
        if worked - self._marks[-1][0] >= _REDRAW_S:
            self._marks.append((worked, done))
            # The oldest mark is as old as the window.
            while len(self._marks) > 2 and worked - self._marks[1][0] >= _WINDOW_S:
                self._marks.popleft()
        if self.quiet or now - self._last < (_REDRAW_S if self.is_terminal else _LINE_INTERVAL_S):
            return
        self._last = now
        text = f'{done:.4g} of {self.total:.4g} {self.unit}'
        if self.foreseen:
            text += self._time_left(worked, done)
        else:
            text += f', after {duration_text(now - self._start)}'
        if not self.is_terminal:
            self._write(f'{text}\n')
            return
        columns = shutil.get_terminal_size().columns - 1
        length = max(0, min(40, columns - len(text) - 4))
        filled = round(length * min(done / self.total, 1.0))
        bar = f'[{"#" * filled}{"." * (length - filled)}] ' if length else ''
        line = (bar + text)[:columns]
        self._write('\r' + line.ljust(self._shown))
        self._shown = len(line)

    def note(self, text: str) -> None:
        """Print a line above the bar."""
        self.clear()
        self._write(f'{text}\n')

    def clear(self) -> None:
        """Erase the bar."""
        if self._shown:
            self._write('\r' + ' ' * self._shown + '\r')
            self._shown = 0

    def __enter__(self) -> Self:
        self._notices.enter_context(compile_notice.shown_by(self.note))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._notices.close()
        self.clear()

    def _time_left(self, worked: float, done: float) -> str:
        """Return the remaining time at the recent speed, '' if unknown."""
        since, before = self._marks[0]
        span = worked - since
        if span < _MIN_TIME_S:
            return ''
        middle, half = min(self._marks, key=lambda mark: abs(mark[0] - since - 0.5 * span))
        if not since < middle < worked:
            return ''
        early, late = (half - before) / (middle - since), (done - half) / (worked - middle)
        if not max(early, late) <= _MAX_SPEED_RATIO * min(early, late):
            return ''
        left = (self.total - done) * span / (done - before) if done > before else math.inf
        return f', about {duration_text(left)} left' if left < math.inf else ''

    def _write(self, text: str) -> None:
        self.stream.write(text)
        self.stream.flush()


def _working_time() -> float:
    """Return the wall time [s] without compilation, which does not predict the remaining time."""
    return time.monotonic() - compile_notice.seconds


class NoteHandler(logging.Handler):
    """Handler that shows warnings of the library above the bar."""

    def __init__(self, progress: Progress, name: str) -> None:
        """Start each line with the `name` of the command."""
        super().__init__(logging.WARNING)
        self._progress, self._name = progress, name

    def emit(self, record: logging.LogRecord) -> None:
        self._progress.note(f'{self._name}: {record.getMessage()}')


@contextmanager
def notes(progress: Progress, name: str) -> Iterator[None]:
    """Show the warnings of the library above the bar of `progress`."""
    logger = logging.getLogger('icofabric_sim')
    handler = NoteHandler(progress, name)
    propagated = logger.propagate
    logger.addHandler(handler)
    logger.propagate = False
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.propagate = propagated


def duration_text(seconds: float) -> str:
    """Return a wall time as text."""
    if seconds < 90.0:
        return f'{max(seconds, 1.0):.0f} s'
    if seconds < 5400.0:
        return f'{seconds / 60.0:.0f} min'
    return f'{seconds / 3600.0:.1f} h'
