# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
What the verbs say while they work: progress with an honest time left, notes, errors.
"""

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
import logging
import shutil
import sys
import time
from types import TracebackType
from typing import Self, TextIO

# Wall time between two pictures of the bar [s], and between two lines where there is no terminal.
_REDRAW, _LINE_INTERVAL = 0.1, 10.0
# The speed is that of about the last while [s]: a fabric that stretches needs shorter steps.
_WINDOW = 8.0


class InputError(Exception):
    """
    Input that cannot be taken: exit status 2.
    """


class FileSaysNo(Exception):
    """
    A file that is what was asked for, but damaged or unfinished: exit status 1.
    """


@contextmanager
def bad_input() -> Iterator[None]:
    """
    Turn the ValueErrors of building what the user described into InputErrors.
    """
    try:
        yield
    except ValueError as error:
        raise InputError(str(error)) from error


class Progress:
    """
    A bar on a terminal, a line now and then elsewhere; nothing is left of the bar at the end.
    """

    def __init__(self, total: float, unit: str, *, stream: TextIO | None = None) -> None:
        """
        Go from 0 to `total` [unit].
        """
        self.total, self.unit = total, unit
        self.stream = sys.stderr if stream is None else stream
        self.is_terminal = self.stream.isatty()
        self._start = time.monotonic()
        self._last = self._start
        self._marks: deque[tuple[float, float]] = deque([(self._start, 0.0)])
        self._shown = 0

    def update(self, done: float) -> None:
        """
        Show that `done` of the total is done, if it is time for it.
        """
        now = time.monotonic()
        if now - self._marks[-1][0] >= _REDRAW:
            self._marks.append((now, done))
            while now - self._marks[0][0] > _WINDOW and len(self._marks) > 2:
                self._marks.popleft()
        if now - self._last < (_REDRAW if self.is_terminal else _LINE_INTERVAL):
            return
        self._last = now
        text = f'{done:.4g} of {self.total:.4g} {self.unit}{self._time_left(now, done)}'
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
        """
        Say something above the bar.
        """
        self.clear()
        self._write(f'{text}\n')

    def clear(self) -> None:
        """
        Wipe the bar away.
        """
        if self._shown:
            self._write('\r' + ' ' * self._shown + '\r')
            self._shown = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.clear()

    def _time_left(self, now: float, done: float) -> str:
        since, before = self._marks[0]
        if now - self._start < 1.0 or not done > before:
            return ''
        left = (self.total - done) * (now - since) / (done - before)
        return f', about {duration_text(left)} left'

    def _write(self, text: str) -> None:
        self.stream.write(text)
        self.stream.flush()


class NoteHandler(logging.Handler):
    """
    Warnings of the library, shown above the bar.
    """

    def __init__(self, progress: Progress, name: str) -> None:
        """
        Begin each with the `name` of the command.
        """
        super().__init__(logging.WARNING)
        self._progress, self._name = progress, name

    def emit(self, record: logging.LogRecord) -> None:
        self._progress.note(f'{self._name}: {record.getMessage()}')


@contextmanager
def notes(progress: Progress, name: str) -> Iterator[None]:
    """
    Show the warnings of the library above the bar of `progress`.
    """
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
    """
    A wall time as people say it.
    """
    if seconds < 90.0:
        return f'{max(seconds, 1.0):.0f} s'
    if seconds < 5400.0:
        return f'{seconds / 60.0:.0f} min'
    return f'{seconds / 3600.0:.1f} h'
