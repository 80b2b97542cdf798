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
How many steps one compiled call takes: nothing else is heard until it returns.

No bit of a run depends on it: a call goes on where the one before has ended.
"""

# Wall time of a call [s].
_CALL_TIME = 0.03
# Work of the first call, in bodies and connectors and evaluations: what one of them takes is not
# known yet, and may be a thousand times what it takes to compute a spring.
_FIRST_WORK = 100_000


class Portions:
    """Cuts steps into calls of a few hundredths of a second."""

    def __init__(self, work: int) -> None:
        """`work`: bodies and connectors in a step, for each evaluation of the forces."""
        self.count = max(1, _FIRST_WORK // max(work, 1))

    def note(self, steps: int, seconds: float) -> None:
        """Learn from a call that took so many `steps` in so many `seconds`."""
        each = seconds / max(steps, 1)
        # A clock that stands still has nothing to say.
        if each > 0.0:
            self.count = max(1, int(min(_CALL_TIME / each, 1e9)))
