# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Says what a user waits for, once it takes longer than a moment.
"""

from collections.abc import Callable
import threading
import time

# A wait below this needs no words [s].
_MOMENT = 1.0
# After a pause as long as this, waiting begins anew [s].
_PAUSE = 10.0


class Patience:
    """
    A wait that comes in pieces.
    """

    def __init__(self, explain: Callable[[], object]) -> None:
        """
        Call `explain`, in another thread, once the pieces add up to more than a moment.
        """
        self._explain = explain
        self._timer: threading.Timer | None = None
        self._explained = False
        self._waited = 0.0
        self._began, self._ended = 0.0, time.monotonic()

    def begin(self) -> None:
        """
        Somebody waits from now on.
        """
        self._began = time.monotonic()
        if self._began - self._ended > _PAUSE:
            self._waited, self._explained = 0.0, False
        if not self._explained:
            self._timer = threading.Timer(max(_MOMENT - self._waited, 0.0), self._tell)
            self._timer.daemon = True
            self._timer.start()

    def end(self) -> None:
        """
        Nobody waits any more.
        """
        if self._timer is not None:
            self._timer.cancel()
        self._ended = time.monotonic()
        self._waited += self._ended - self._began

    def _tell(self) -> None:
        self._explained = True
        self._explain()
