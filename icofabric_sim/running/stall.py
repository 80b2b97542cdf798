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

It goes by wall time, so it is for live runs only: there a clock that stands says nothing, and who
waits for it waits for ever. A large fabric that is slow from the start is no stall.
"""

# Computing time [s] after which it is judged.
_WINDOW = 4.0
# Simulated over computing time below which it is a stall, if also the step is so much shorter than
# the first one: by a contact that begins it becomes a hundred times shorter.
_SLOWEST, _SHORTEST = 1e-2, 1e-3


class StallWatch:
    """Judges the progress of one run; in its thread."""

    def __init__(self) -> None:
        """Judge nothing before `begin`."""
        self._usual = 0.0
        self._computed, self._simulated = 0.0, 0.0

    def begin(self, step: float) -> None:
        """Judge a motion whose steps have the length `step` [s] at first."""
        self._usual = step
        self._computed = self._simulated = 0.0

    def note(self, simulated: float, computed: float, step: float) -> str:
        """
        Note that `simulated` [s] took `computed` [s]; returns why it is a stall, or ''.
        """
        self._simulated += simulated
        self._computed += computed
        if self._computed < _WINDOW:
            return ''
        speed = self._simulated / self._computed
        self._computed = self._simulated = 0.0
        if not (speed < _SLOWEST and step < _SHORTEST * self._usual):
            return ''
        return (
            f'simulated time stands nearly still (at {speed:.2g} of computing time): the motion '
            f'has become so fast that steps of {step:.3g} s follow it, {self._usual / step:,.0f} '
            'times shorter than at first. A load or a drive is too strong for these shells: reset '
            'the run and send a smaller one')
