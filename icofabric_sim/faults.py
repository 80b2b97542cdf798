# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Where a run goes wrong: the body and the connector to name when it stops.
"""

from icofabric_sim.kernels.records import State
from icofabric_sim.model import PackedScene
from icofabric_sim.snapshot import Snapshot
from icofabric_sim.stability import Frequency
import numpy as np


def too_fast(time: float) -> str:
    """
    Say that no step can follow the motion at `time` [s].
    """
    return (
        f'the motion at t = {time:.9g} s is too fast for any step; look for a huge stiffness, '
        'load, spin or stretch')


def unsafe_step(step: float, limit: float, frequency: Frequency, time: float) -> str:
    """
    Say that a fixed step has become longer than the stability limit [s].
    """
    bodies = ', '.join(str(body) for body in frequency.bodies)
    return (
        f'solver.step {step!r} s has become unsafe at t = {time:.9g} s: the fabric has '
        f'stretched or turned so that bodies {bodies} move at up to {frequency.rate:.6g} '
        f'rad/s, and the stability limit is now {limit:.6g} s; start again with a '
        'smaller step, or with 0 to have it chosen')


def find_fault(packed: PackedScene, state: State) -> str:
    """
    Name the body that is not finite or else the fastest, and its most strained connector.
    """
    position, orientation, velocity, spin = packed.layout.unpack(state)
    with np.errstate(all='ignore'):
        speed = (velocity**2).sum(axis=1) / packed.model.inverse_mass
        speed += (spin**2).sum(axis=1) / packed.model.inverse_inertia
        speed += 0.0 * (position.sum(axis=1) + orientation.sum(axis=1))
        speed[~np.isfinite(speed)] = np.inf
        body = int(np.argmax(speed))
        name = f'body {body}'
        connectors = packed.connectors
        if connectors is None:
            return name
        length = Snapshot(
            0.0, position, orientation, velocity, spin, len(connectors.first), packed, {}
        ).connector_length
        mine = np.flatnonzero((connectors.first == body) | (connectors.second == body))
        if not len(mine):
            return name
        strain = np.abs(length - connectors.natural_length)[mine]
        strain[~np.isfinite(strain)] = np.inf
        return f'{name}, at connector {int(mine[np.argmax(strain)])}'
