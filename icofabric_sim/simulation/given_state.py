# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
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
