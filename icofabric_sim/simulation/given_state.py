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
"""Judges a state that is given from outside."""

from icofabric_sim import checks
from icofabric_sim.geometry.rotations import unit_quaternions
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.simulation.model.snapshot import Snapshot
import numpy as np

_WIDTHS = {'position': 3, 'orientation': 4, 'linear_velocity': 3, 'angular_velocity': 3}


def complete_state(now: Snapshot, given: dict[str, np.ndarray | None]) -> InitialState:
    """
    Return the `given` parts, and those of `now` where None is given; quaternions of unit length.

    Raises TypeError or ValueError that names the part and the body.
    """
    count = len(now.position)
    values = {}
    for name, width in _WIDTHS.items():
        part = given[name]
        if part is None:
            values[name] = np.array(getattr(now, name))
            continue
        convert = checks.quaternions if name == 'orientation' else checks.array
        values[name] = convert(name, part, (count, width), row='body')
    values['orientation'] = unit_quaternions(values['orientation'])
    return InitialState(**values)
