# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Judges a state that is given from outside.
"""

from icofabric_sim.initial import InitialState
from icofabric_sim.snapshot import Snapshot
import numpy as np

_WIDTHS = {'position': 3, 'orientation': 4, 'linear_velocity': 3, 'angular_velocity': 3}
# Quaternions this far from unit length are scaled, others refused.
_ALMOST_UNIT = 1e-3


def complete_state(now: Snapshot, given: dict[str, np.ndarray | None]) -> InitialState:
    """
    Return the `given` parts, and those of `now` where None is given; quaternions of unit length.

    Raises ValueError that names the part and the body.
    """
    count = len(now.position)
    values = {}
    for name, width in _WIDTHS.items():
        part = given[name]
        array = np.array(getattr(now, name) if part is None else part, dtype=float)
        if array.shape != (count, width):
            raise ValueError(f'{name} must have the shape ({count}, {width}), got {array.shape}')
        if not np.isfinite(array).all():
            body = int(np.flatnonzero(~np.isfinite(array).all(axis=1))[0])
            raise ValueError(f'{name} of body {body} is not finite: {array[body]}')
        values[name] = array
    orientation = values['orientation']
    length = np.linalg.norm(orientation, axis=1, keepdims=True)
    if not (abs(length - 1.0) <= _ALMOST_UNIT).all():
        body = int(np.argmax(abs(length - 1.0)))
        raise ValueError(
            f'orientation of body {body} is not a unit quaternion: {orientation[body]}')
    values['orientation'] = np.where(
        abs(length - 1.0) <= 4e-16, orientation, orientation / length)
    return InitialState(**values)
