# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
External wrenches on bodies.
"""

from icofabric_sim.kernels.compiled import compiled
from icofabric_sim.kernels.records import Loads
from icofabric_sim.kernels.rotations import to_world
import numpy as np


@compiled
def add_loads(
    loads: Loads | None, orientation: np.ndarray, force: np.ndarray, torque: np.ndarray
) -> None:
    """
    Add every wrench; the force acts at its point, the torque adds to the moment of the force.
    """
    if loads is None:
        return
    for m in range(loads.body.shape[0]):
        b = loads.body[m]
        fx, fy, fz = loads.force[m, 0], loads.force[m, 1], loads.force[m, 2]
        tx, ty, tz = loads.torque[m, 0], loads.torque[m, 1], loads.torque[m, 2]
        if loads.in_body_axes[m]:
            fx, fy, fz = to_world(orientation, b, fx, fy, fz)
            tx, ty, tz = to_world(orientation, b, tx, ty, tz)
        px, py, pz = to_world(
            orientation, b, loads.point[m, 0], loads.point[m, 1], loads.point[m, 2]
        )
        force[b, 0] += fx
        force[b, 1] += fy
        force[b, 2] += fz
        torque[b, 0] += tx + py * fz - pz * fy
        torque[b, 1] += ty + pz * fx - px * fz
        torque[b, 2] += tz + px * fy - py * fx
