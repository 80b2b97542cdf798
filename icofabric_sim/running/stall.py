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
Notices that simulated time stands nearly still, because the motion has become too fast to follow.

For live runs only: there a clock that stands says nothing, and who waits for it waits for ever.
Evaluations of the forces are counted, not the time that they take: a busy machine ends no run.
"""

from collections.abc import Callable

# Evaluations for each simulated second, beside those that the scene's own terms ask for, and times
# the bodies of a fabric, so many at least. Above both it is a stall: some ten times as many are
# computed in a second.
_MOST_BESIDE_USUAL, _MOST_OF_BODIES, _FEWEST_BODIES = 1e3, 3e8, 32
# Contacts take a fifth of what is usual of them at most, in tests: so many times as many are a
# stall already. Of stiff ones 1,000 times as many would take a day.
_MOST_BESIDE_CONTACTS = 10.0
# They are counted over some outputs, but over this simulated time [s] at least and at most.
_OUTPUTS, _SHORTEST_WINDOW, _LONGEST_WINDOW = 3.0, 0.1, 1.0


class StallWatch:
    """Judges the progress of one run; in its thread."""

    def __init__(self) -> None:
        """Judge nothing before `begin`."""
        self._limit = self._window = 0.0
        self._usual = 0.0
        self._since, self._steps, self._evaluations = 0.0, -1, 0

    def begin(
        self, usual: float, bodies: int, output_period: float, contacts: float = 0.0
    ) -> None:
        """
        Judge a motion of so many `bodies`.

        Its scene asks for `usual` evaluations in a second, and for so many of `contacts` where
        shells touch; outputs are `output_period` [s] apart.
        """
        self._usual = max(usual, contacts)
        self._limit = max(
            _MOST_BESIDE_USUAL * usual, _MOST_BESIDE_CONTACTS * contacts,
            _MOST_OF_BODIES / max(bodies, _FEWEST_BODIES))
        self._window = min(max(_OUTPUTS * output_period, _SHORTEST_WINDOW), _LONGEST_WINDOW)
        self._steps = -1

    def note(self, time: float, steps: int, stages: int, fastest: Callable[[], str]) -> str:
        """
        Note a `time` [s] and the steps so far, lately of `stages`; returns why it stalls, or ''.

        `fastest` names what moves fastest.
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
                f'simulated time stands nearly still: the motion has become so fast that a second '
                f'of it takes {rate:.2g} evaluations of the forces, where this scene usually '
                f'takes {self._usual:.2g}; the fastest is that of {fastest()}. Reset the run and '
                'make that slower: a load, drive or pull is too strong for these shells, or '
                'something too stiff')
        if past >= self._window:
            self._since, self._evaluations = time, 0
        return ''
