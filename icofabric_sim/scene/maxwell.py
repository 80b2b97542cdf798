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
"""Maxwell arms of connectors: what makes a standard linear solid of them (kernels/maxwell.py)."""

from collections.abc import Mapping
from typing import NamedTuple

from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.connector_laws import spread_over
from icofabric_sim.scene.rates import LARGEST_RATE
import numpy as np


class MaxwellArms(NamedTuple):
    """A spring and a dashpot in series beside each connector; (c,), or (1,) if all are alike."""

    stiffness: np.ndarray  # k_1 [N/m]; 0: no arm
    time: np.ndarray  # tau [s], after which the arm alone has lost all of its pull but 1 / e

    @property
    def rate(self) -> np.ndarray:
        """1 / tau [1/s]; 0 without an arm."""
        stiffness, time = np.broadcast_arrays(self.stiffness, self.time)
        return np.divide(1.0, time, out=np.zeros(len(time)), where=stiffness > 0.0)


def make_arms(
    parameters: Parameters, members: Mapping[str, np.ndarray], count: int
) -> MaxwellArms | None:
    """Arms of `count` connectors, with those of the groups in `members`; None without any."""
    for prefix in ('connector', *(f'connector_groups.{name}' for name in members)):
        stiffness, time = (_said(parameters, prefix, f'maxwell_{what}') for what in (
            'stiffness', 'time'))
        name = f'{prefix}.maxwell_time'
        if stiffness > 0.0 and not time > 0.0:
            raise ParameterError(
                name, f'{name} must be above 0 s where {prefix}.maxwell_stiffness is '
                f'{stiffness!r} N/m, got {time!r} s: give the time after which the arm has lost '
                'all of its pull but 1 / e, or no maxwell_stiffness')
        if stiffness > 0.0 and not time * LARGEST_RATE >= 1.0:
            raise ParameterError(
                name, f'{name} {time!r} s is shorter than steps can follow, '
                f'{1.0 / LARGEST_RATE:g} s; so quick an arm is a damper: give '
                f'{prefix}.damping {stiffness * time:.6g} N s/m instead')
    arms = MaxwellArms(*(
        spread_over(parameters, f'maxwell_{what}', members, count)
        for what in ('stiffness', 'time')))
    return arms if count and arms.stiffness.any() else None


def has_arms(parameters: Parameters) -> str:
    """Name of the first parameter that gives connectors arms; '': none does."""
    for prefix in ('connector', *(
            f'connector_groups.{name}' for name in parameters.names('connector_groups'))):
        name = f'{prefix}.maxwell_stiffness'
        if parameters[name] > 0.0:
            return name
    return ''


def _said(parameters: Parameters, prefix: str, name: str) -> float:
    """What `prefix` says, or what holds for all."""
    value = float(parameters[f'{prefix}.{name}'])
    return value if value >= 0.0 else float(parameters[f'connector.{name}'])
