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
Keeps Ctrl-C from falling between a change of the state and the note of its time.

And ends long work that has no such moment soon, where the process is to end anyway.
"""

import math
import signal
import threading
import time
from types import FrameType, TracebackType

# Work that comes to a good end within this time [s] is not broken off.
_GRACE = 0.5


class Leaving:
    """
    The wish that the process ends: heard between the parts of long work, after a moment.

    What is broken off leaves no state to go on from, only what has been recorded.
    """

    def __init__(self) -> None:
        """Start without a deadline."""
        self._deadline = math.inf

    def request(self) -> None:
        """Wish it; may be called by a signal handler."""
        self._deadline = min(self._deadline, time.monotonic() + _GRACE)

    def withdraw(self) -> None:
        """The process goes on after all."""
        self._deadline = math.inf

    def check(self) -> None:
        """Raise KeyboardInterrupt in the main thread once the moment has passed."""
        if self._deadline < math.inf and time.monotonic() > self._deadline and (
                threading.current_thread() is threading.main_thread()):
            raise KeyboardInterrupt


# Of this process.
leaving = Leaving()


class DeferredInterrupt:
    """
    Inside, Ctrl-C is only noted; it is raised at `check`, or when the outermost `with` ends.

    Only in the main thread and only where Python's own handler is in place: a program that
    handles the signal itself keeps doing so.
    """

    def __init__(self) -> None:
        """Nothing is deferred yet."""
        self._depth = 0
        self._installed = False
        self._noted = False

    def __enter__(self) -> None:
        """Defer from here on."""
        if self._depth == 0:
            self._noted = False
            self._installed = (
                threading.current_thread() is threading.main_thread()
                and signal.getsignal(signal.SIGINT) is signal.default_int_handler
            )
            if self._installed:
                signal.signal(signal.SIGINT, self._note)
        self._depth += 1

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Give the signal back, and raise what was noted."""
        self._depth -= 1
        if self._depth == 0 and self._installed:
            signal.signal(signal.SIGINT, signal.default_int_handler)
            if error is None:
                self.check()

    def check(self) -> None:
        """Raise KeyboardInterrupt if one was noted: the state is consistent here."""
        if self._noted:
            self._noted = False
            raise KeyboardInterrupt

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._noted = True
