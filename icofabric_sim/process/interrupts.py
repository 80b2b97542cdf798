# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Interrupts by Ctrl-C at safe moments.

`DeferredInterrupt` keeps an interrupt from falling between a change of the state and the note of
its time. `exit_request` ends long work without such a moment when the process is to end anyway.
"""

import math
import signal
import threading
import time
from types import FrameType, TracebackType

# Work that is complete within this time [s] after the request is not broken off.
_GRACE_S = 0.5


class ExitRequest:
    """
    Request to end the process, checked between the parts of long work.

    Work that is broken off leaves no state to continue from; recorded data stay.
    """

    def __init__(self) -> None:
        """Start without a request."""
        self._deadline_s = math.inf

    def request(self) -> None:
        """Request the end of the process; safe to call in a signal handler."""
        self._deadline_s = min(self._deadline_s, time.monotonic() + _GRACE_S)

    def withdraw(self) -> None:
        """Withdraw the request."""
        self._deadline_s = math.inf

    def check(self) -> None:
        """Raise KeyboardInterrupt in the main thread once the time of grace has passed."""
        if self._deadline_s < math.inf and time.monotonic() > self._deadline_s and (
                threading.current_thread() is threading.main_thread()):
            raise KeyboardInterrupt


# Of this process.
exit_request = ExitRequest()


class DeferredInterrupt:
    """
    Context in which Ctrl-C is noted, and raised at `check` or when the outermost `with` ends.

    It acts only in the main thread and only if Python's own handler is installed: a program that
    handles the signal itself continues to do so.
    """

    def __init__(self) -> None:
        """Start with no interrupt deferred."""
        self._depth = 0
        self._installed = False
        self._noted = False

    def __enter__(self) -> None:
        """Defer interrupts from now on."""
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
        """Restore the signal handler, and raise a noted interrupt."""
        self._depth -= 1
        if self._depth == 0 and self._installed:
            signal.signal(signal.SIGINT, signal.default_int_handler)
            if error is None:
                self.check()

    def check(self) -> None:
        """Raise KeyboardInterrupt if one was noted: the state is consistent at this point."""
        if self._noted:
            self._noted = False
            raise KeyboardInterrupt

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._noted = True
