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
"""State of a run in another program, in our units and frames, and its steps."""

import math
from typing import NamedTuple

import numpy as np


class State(NamedTuple):
    """Where all bodies are, and how they move; world frame, SI units."""

    position: np.ndarray  # (n, 3) [m]
    orientation: np.ndarray  # (n, 4) x y z w, body to world
    linear_velocity: np.ndarray  # (n, 3) [m/s]
    angular_velocity: np.ndarray  # (n, 3) [rad/s]
    intact: np.ndarray  # (c,) bool: nothing breaks


def steps_until(now: float, time: float, step: float, most: int) -> int:
    """Count steps of `step` [s] to a later `time` [s] or beyond it: one at least, or `most`."""
    return int(min(max(math.ceil((time - now) / step), 1), most))
