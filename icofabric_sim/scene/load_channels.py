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
"""Wrench channels of a scene, and the loads that the scene applies to them."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.scene.profiles import make_profile, Profile
import numpy as np


class LoadChannel(NamedTuple):
    """
    Wrench channel `loads.NAME`.

    `force` and `torque` act, times the profile, until a received wrench replaces them.
    """

    name: str
    bodies: np.ndarray  # int32 body numbers
    in_body_axes: bool
    point: np.ndarray  # (3,) [m], body axes, from the centre
    hold: float  # [s], 0: until replaced
    total: bool  # the wrench is divided among the bodies
    force: np.ndarray  # (3,) [N]
    torque: np.ndarray  # (3,) [N m]
    profile: Profile


def make_channels(
    parameters: Parameters, groups: Mapping[str, np.ndarray]
) -> dict[str, LoadChannel]:
    """Return all `loads.NAME`."""
    loads = {}
    for name in parameters.names('loads'):

        def field(key: str, name: str = name) -> Any:
            return parameters[f'loads.{name}.{key}']

        loads[name] = LoadChannel(
            name=name,
            bodies=groups[field('group')],
            in_body_axes=field('frame') == 'body',
            point=np.array(field('point')),
            hold=field('hold'),
            total=field('share') == 'total',
            force=np.array(field('force')),
            torque=np.array(field('torque')),
            profile=make_profile(parameters, f'loads.{name}'),
        )
    return loads
