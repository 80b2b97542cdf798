# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Number of steps of one kernel call, during which a run cannot be interrupted.

Results do not depend on this number: a call continues where the last one ended.
"""

# Wall time of a call [s].
_CALL_TIME = 0.03
# Work of the first call, in bodies and connectors and evaluations: what one of them takes is not
# known yet, and may be a thousand times what it takes to compute a spring.
_FIRST_WORK = 100_000


class Portions:
    """Division of steps into calls of a few hundredths of a second."""

    def __init__(self, work: int) -> None:
        """Start with `work`, bodies and connectors of a step times its force evaluations."""
        self.count = max(1, _FIRST_WORK // max(work, 1))

    def note(self, steps: int, seconds: float) -> None:
        """Adapt to a call that took `steps` steps in `seconds`."""
        each = seconds / max(steps, 1)
        # A clock that stands still has nothing to say.
        if each > 0.0:
            self.count = max(1, int(min(_CALL_TIME / each, 1e9)))
