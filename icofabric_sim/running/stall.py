# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Detection of a stall: simulated time almost stops because the motion has become too fast.

For live runs only: their subscribers would wait for the clock without knowing why.
Force evaluations are counted instead of time, so that a busy machine does not end a run.
"""

from collections.abc import Callable

# Limits of force evaluations per simulated second: _MAX_USUAL_RATIO times those that the scene's
# terms need, and _MAX_BODY_RATE over the body count, or over _MIN_BODIES if that is larger. A rate
# above both is a stall; about ten times as many can be computed in a second.
_MAX_USUAL_RATIO, _MAX_BODY_RATE, _MIN_BODIES = 1e3, 3e8, 32
# Contacts need at most a fifth of their estimate in tests, so this multiple is already a stall.
# 1,000 times the evaluations of stiff contacts would take a day.
_MAX_CONTACT_RATIO = 10.0
# Counting interval: a number of outputs, with shortest and longest simulated time [s].
_OUTPUTS, _MIN_WINDOW_S, _MAX_WINDOW_S = 3.0, 0.1, 1.0


class StallWatch:
    """Stall detector of one run; use in its thread."""

    def __init__(self) -> None:
        """Create an inactive detector."""
        self._limit = self._window = 0.0
        self._usual = 0.0
        self._since, self._steps, self._evaluations = 0.0, -1, 0

    def begin(
        self, usual: float, bodies: int, output_period: float, contacts: float = 0.0
    ) -> None:
        """
        Start for a motion of `bodies` bodies.

        The scene needs `usual` force evaluations per second, and `contacts` of these where shells
        are in contact; outputs are `output_period` [s] apart.
        """
        self._usual = max(usual, contacts)
        self._limit = max(
            _MAX_USUAL_RATIO * usual, _MAX_CONTACT_RATIO * contacts,
            _MAX_BODY_RATE / max(bodies, _MIN_BODIES))
        self._window = min(max(_OUTPUTS * output_period, _MIN_WINDOW_S), _MAX_WINDOW_S)
        self._steps = -1

    def note(self, time: float, steps: int, stages: int, fastest: Callable[[], str]) -> str:
        """
        Record the `time` [s], steps and stages of a step; return why the run stalls, or ''.

        `fastest` describes the fastest motion.
        """
        if not 0 <= self._steps <= steps or time < self._since:
            self._since, self._evaluations = time, 0
        else:
            self._evaluations += (steps - self._steps) * stages
        self._steps = steps
        past = time - self._since
        if self._evaluations > self._limit * max(past, self._window):
            rate = self._evaluations / past if past > 0.0 else float('inf')
            self._since, self._evaluations = time, 0
            return (
                f'simulated time has almost stopped: one second of this motion needs {rate:.2g} '
                f'force evaluations, where this scene usually needs {self._usual:.2g}; the '
                f'fastest motion is that of {fastest()}. Reset the run and slow it down: a load, '
                'drive or pull is too strong for these shells, or a stiffness is too large')
        if past >= self._window:
            self._since, self._evaluations = time, 0
        return ''
