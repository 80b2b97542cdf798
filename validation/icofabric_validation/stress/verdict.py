# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The classes of judged scenes, and what is noted of each."""

from enum import Enum
from typing import Final, NamedTuple


class Verdict(Enum):
    """What became of a scene; the value is how tables say it."""

    WITHIN = 'within the promise'
    CHAOTIC = 'chaotic, and said so'
    SAID = 'beyond, and said so'
    EXCUSED = 'beyond, and excused by error_estimate_lacks'
    BETWEEN = 'between'
    UNJUDGED = 'not judged'
    REFUSED = 'refused with the right name'
    STOPPED = 'stopped with the right reason'
    SLOW = 'too slow, with what limits it'
    WRONGLY_REFUSED = 'refused without the right name'
    WRONGLY_STOPPED = 'stopped for a wrong reason'
    SILENT = 'silently wrong'
    HANG = 'hang'
    CRASH = 'crash'
    OTHER_BITS = 'other bits'


# What must not happen.
FAULTS: Final = (
    Verdict.WRONGLY_REFUSED, Verdict.WRONGLY_STOPPED, Verdict.SILENT, Verdict.HANG, Verdict.CRASH,
    Verdict.OTHER_BITS)


class Finding(NamedTuple):
    """A judged scene; errors are the larger of position over a and angle in rad."""

    seed: int
    kind: int
    verdict: Verdict
    detail: str = ''  # sentence on why
    method: str = ''
    is_given: bool = False  # whether the scene gives the step
    bodies: int = 0
    steps: int = 0
    time: float = 0.0  # simulated time that was judged [s]
    added: float = 0.0  # errors added, growth apart
    promised: float = 0.0  # what may be added: tolerance and rounding
    estimate: float = 0.0  # the run's own error_estimate
    growth: float = 0.0  # of a small displacement over the run; 0: not measured
    compared: bool = False  # bit by bit, with two threads and from a checkpoint
    seconds: float = 0.0  # processor time of the judge, without that of the compiler
    windows: int = 0  # parts of the run beside which a tighter one went
    unjudged: int = 0  # of them: where the error is not known
    shared: bool = False  # whether both of the two threads had bodies

    @property
    def is_fault(self) -> bool:
        """Whether it is of a class that must not occur."""
        return self.verdict in FAULTS
