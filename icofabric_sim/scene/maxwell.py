# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Maxwell arms, which make connectors standard linear solids (terms/maxwell)."""

from collections.abc import Mapping
from typing import NamedTuple

from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.connector_laws import property_by_connector
from icofabric_sim.scene.rates import MAX_RATE_PER_S
import numpy as np


class MaxwellArms(NamedTuple):
    """Spring and dashpot in series, parallel to each connector; (c,), or (1,) if all are equal."""

    stiffness: np.ndarray  # k_1 [N/m]; 0: no arm
    time: np.ndarray  # relaxation time tau [s], in which the force of the arm decays to 1 / e

    @property
    def rate(self) -> np.ndarray:
        """1 / tau [1/s]; 0 without an arm."""
        stiffness, time = np.broadcast_arrays(self.stiffness, self.time)
        return np.divide(1.0, time, out=np.zeros(len(time)), where=stiffness > 0.0)


def make_arms(
    parameters: Parameters, members: Mapping[str, np.ndarray], count: int
) -> MaxwellArms | None:
    """Return the arms of `count` connectors, with groups as in `members`; None without arms."""
    for prefix in ('connector', *(f'connector_groups.{name}' for name in members)):
        stiffness, time = (_value_or_default(parameters, prefix, f'maxwell_{what}') for what in (
            'stiffness', 'time'))
        name = f'{prefix}.maxwell_time'
        if stiffness > 0.0 and not time > 0.0:
            raise ParameterError(
                name, f'{name} must be above 0 s where {prefix}.maxwell_stiffness is '
                f'{stiffness!r} N/m, got {time!r} s: give the time in which the force of the arm '
                'decays to 1 / e, or no maxwell_stiffness')
        if stiffness > 0.0 and not time * MAX_RATE_PER_S >= 1.0:
            raise ParameterError(
                name, f'{name} {time!r} s is shorter than steps can resolve, '
                f'{1.0 / MAX_RATE_PER_S:g} s; such an arm is a damper: give '
                f'{prefix}.damping {stiffness * time:.6g} N s/m instead')
    arms = MaxwellArms(*(
        property_by_connector(parameters, f'maxwell_{what}', members, count)
        for what in ('stiffness', 'time')))
    return arms if count and arms.stiffness.any() else None


def arm_parameter_name(parameters: Parameters) -> str:
    """Return the name of the first parameter that gives connectors arms, or ''."""
    for prefix in ('connector', *(
            f'connector_groups.{name}' for name in parameters.names('connector_groups'))):
        name = f'{prefix}.maxwell_stiffness'
        if parameters[name] > 0.0:
            return name
    return ''


def _value_or_default(parameters: Parameters, prefix: str, name: str) -> float:
    """Return the value given under `prefix`, or that of all connectors."""
    value = float(parameters[f'{prefix}.{name}'])
    return value if value >= 0.0 else float(parameters[f'connector.{name}'])
