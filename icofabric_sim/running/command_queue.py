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
"""Commands from any thread, done between two steps in the order in which they came."""

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
    """Commands that wait for the thread of the run; `post` and `wake` are for any thread."""

    def __init__(self) -> None:
        """Start empty."""
        self._commands: SimpleQueue[_Command] = SimpleQueue()
        self._wake = threading.Event()
        self.lag = 0.0  # longest time [s] that a command has waited, until it is set back

    def post(self, act: Callable[[], Any]) -> 'Future[Any]':
        """Have a command done between two steps; its result comes with the future."""
        answer: Future[Any] = Future()
        self._commands.put(_Command(act, answer, wall.monotonic()))
        self._wake.set()
        return answer

    def wake(self) -> None:
        """End the wait of the run."""
        self._wake.set()

    def begin_turn(self) -> None:
        """Forget what has woken the run; whatever comes from now on wakes it again."""
        self._wake.clear()

    def wait(self, longest: float) -> None:
        """Wait until something comes, or for so long [s]."""
        self._wake.wait(longest)

    def do_all(
        self, on_failure: Callable[[SimulationError], None], on_interrupt: Callable[[], None]
    ) -> None:
        """
        Do the commands that are there now; later ones wait, so that no sender can stop time.

        `on_failure` is called where the simulation fails in one, `on_interrupt` where it is broken
        off.
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
                    'simulated time waits for kernels: ask again'
                    if isinstance(stop, KernelsAwaited) else 'the run has ended'))
            except Exception as error:  # noqa: BLE001 - the caller gets it, the run goes on
                _LOGGER.error('%s', error)
                command.answer.set_exception(error)
