# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The classes of judged scenes, and the record of one."""

from enum import Enum
from typing import Final, NamedTuple


class Verdict(Enum):
    """The class of a judged scene; the value is its text in tables."""

    WITHIN = 'within tolerance'
    CHAOTIC = 'chaotic, as reported'
    REPORTED = 'error too large, as reported'
    EXCUSED = 'error too large, excused by error_estimate_lacks'
    BETWEEN = 'up to 3 times the tolerance'
    UNJUDGED = 'not judged'
    REFUSED = 'refused with the right name'
    STOPPED = 'stopped with the right reason'
    SLOW = 'too slow, with the cause'
    WRONGLY_REFUSED = 'refused without the right name'
    WRONGLY_STOPPED = 'stopped for a wrong reason'
    SILENT = 'silently wrong'
    HANG = 'hang'
    CRASH = 'crash'
    NOT_BIT_IDENTICAL = 'not bit-identical'


# Classes that must not occur.
FAULTS: Final = (
    Verdict.WRONGLY_REFUSED, Verdict.WRONGLY_STOPPED, Verdict.SILENT, Verdict.HANG, Verdict.CRASH,
    Verdict.NOT_BIT_IDENTICAL)


class Finding(NamedTuple):
    """A judged scene; errors are the larger of position over a and angle in rad."""

    seed: int
    kind: int
    verdict: Verdict
    detail: str = ''  # reason of the class, in words
    method: str = ''
    is_given: bool = False  # whether the scene gives the step
    bodies: int = 0
    steps: int = 0
    time: float = 0.0  # simulated time that was judged [s]
    added: float = 0.0  # errors added, without their growth
    promised: float = 0.0  # allowed error: tolerance and round-off
    estimate: float = 0.0  # the run's own error_estimate
    growth: float = 0.0  # of a small displacement over the run; 0: not measured
    compared: bool = False  # bit by bit, with two threads and from a checkpoint
    seconds: float = 0.0  # processor time of the judge, without that of the compiler
    windows: int = 0  # intervals that were compared with a reference run
    unjudged: int = 0  # windows whose error is unknown
    shared: bool = False  # whether both threads had bodies

    @property
    def is_fault(self) -> bool:
        """True if the class must not occur."""
        return self.verdict in FAULTS
