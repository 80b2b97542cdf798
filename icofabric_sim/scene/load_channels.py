# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Load channels of a scene, and the loads that the scene applies to them."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.scene.profiles import make_profile, Profile
import numpy as np


class LoadChannel(NamedTuple):
    """
    Load channel `loads.NAME`.

    `force` and `torque` act, times the profile, until a received wrench replaces them.
    """

    name: str
    bodies: np.ndarray  # int32 body numbers
    in_body_axes: bool
    point: np.ndarray  # (3,) [m], body axes, from the centre
    hold: float  # [s], 0: until replaced
    is_divided: bool  # the wrench is divided among the bodies
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
            is_divided=field('share') == 'total',
            force=np.array(field('force')),
            torque=np.array(field('torque')),
            profile=make_profile(parameters, f'loads.{name}'),
        )
    return loads
