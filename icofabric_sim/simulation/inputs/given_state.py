# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Validation of a state that a caller sets."""

from icofabric_sim import checks
from icofabric_sim.geometry.rotations import unit_quaternions
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.scene.rates import MAX_RATE_PER_S
from icofabric_sim.simulation.model.snapshot import Snapshot
import numpy as np

_WIDTHS = {'position': 3, 'orientation': 4, 'linear_velocity': 3, 'angular_velocity': 3}


def complete_state(
    now: Snapshot, given: dict[str, np.ndarray | None], half_edge: float
) -> InitialState:
    """
    Return the `given` arrays, with those of `now` in place of None, and unit quaternions.

    Raises TypeError or ValueError with the name of the array and the body. The same holds for a
    body that moves faster than time steps resolve for shells of a `half_edge` [m].
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
    for name, size, unit in (
            ('linear_velocity', half_edge, 'm/s'), ('angular_velocity', 1.0, 'rad/s')):
        fast = np.abs(values[name]).max(axis=1, initial=0.0) > MAX_RATE_PER_S * size
        if given[name] is not None and fast.any():
            body = int(np.argmax(fast))
            raise ValueError(
                f'{name} of body {body} is {checks.shown(values[name][body])} {unit}: time '
                f'steps resolve {MAX_RATE_PER_S * size:g} {unit} at most')
    values['orientation'] = unit_quaternions(values['orientation'])
    return InitialState(**values)
