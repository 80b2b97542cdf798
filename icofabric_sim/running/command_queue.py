# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Commands from any thread, executed in order between two steps."""

from collections.abc import Callable
from concurrent.futures import Future
import logging
from queue import SimpleQueue
import threading
import time as wall
from typing import Any, NamedTuple

from icofabric_sim.simulation.errors import Interrupted, KernelsAwaited, SimulationError

_LOGGER = logging.getLogger('icofabric_sim')


class _Command(NamedTuple):
    act: Callable[[], Any]
    answer: 'Future[Any]'
    posted: float  # [s] of wall time


class CommandQueue:
    """Commands for the run's thread; `post` and `wake` are thread-safe."""

    def __init__(self) -> None:
        """Create an empty queue."""
        self._commands: SimpleQueue[_Command] = SimpleQueue()
        self._wake = threading.Event()
        self.lag = 0.0  # longest waiting time of a command [s] since it was last reset

    def post(self, act: Callable[[], Any]) -> 'Future[Any]':
        """Execute a command between two steps; return the future of its result."""
        answer: Future[Any] = Future()
        self._commands.put(_Command(act, answer, wall.monotonic()))
        self._wake.set()
        return answer

    def wake(self) -> None:
        """End the wait of the run."""
        self._wake.set()

    def begin_turn(self) -> None:
        """Clear the wake-up flag; later commands wake the run again."""
        self._wake.clear()

    def wait(self, longest: float) -> None:
        """Wait for a command for at most `longest` [s]."""
        self._wake.wait(longest)

    def do_all(
        self, on_failure: Callable[[SimulationError], None], on_interrupt: Callable[[], None]
    ) -> None:
        """
        Execute the commands that are queued now; later ones wait, so that time continues.

        `on_failure` is called if the simulation fails in a command, `on_interrupt` if a command is
        interrupted.
        """
        for _ in range(self._commands.qsize()):
            command = self._commands.get_nowait()
            self.lag = max(self.lag, wall.monotonic() - command.posted)
            try:
                command.answer.set_result(command.act())
            except SimulationError as error:
                on_failure(error)
                command.answer.set_exception(error)
            except Interrupted as stop:
                on_interrupt()
                command.answer.set_exception(RuntimeError(
                    'simulated time is waiting for kernels: try again'
                    if isinstance(stop, KernelsAwaited) else 'the run has ended'))
            except Exception as error:  # passed to the caller; the run continues
                _LOGGER.error('%s', error)
                command.answer.set_exception(error)
