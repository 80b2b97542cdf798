# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Says what a user waits for, once it takes longer than a moment.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import threading

# A wait below this needs no words [s].
_MOMENT = 1.0
COMPILING = (
    'compiling the kernels of this kind of scene; that takes up to half a minute once on a '
    'machine, later starts take them from disk'
)


@contextmanager
def explained_wait(say: Callable[[str], object], reason: str = COMPILING) -> Iterator[None]:
    """
    Have `say` told the `reason` if the body takes longer than a moment.
    """
    timer = threading.Timer(_MOMENT, say, [reason])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
