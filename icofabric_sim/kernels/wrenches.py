# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
The list of all terms that act on a fabric; a term that is None is not compiled.
"""

from icofabric_sim.kernels.compiled import compiled
from icofabric_sim.kernels.connectors import add_connectors
from icofabric_sim.kernels.loads import add_loads
from icofabric_sim.kernels.records import Loads, Model, State, Work


@compiled
def compute_wrenches(model: Model, loads: Loads | None, state: State, work: Work) -> None:
    """
    Resultant force and torque of every body (right-hand sides of eq 45) into `work`.

    Gravity apart: it is an acceleration, and the kick adds it without a detour over the mass.
    """
    work.force[:] = 0.0
    work.torque[:] = 0.0
    add_connectors(
        model.connectors, state.position, state.orientation, work.arms, work.force, work.torque
    )
    add_loads(loads, state.orientation, work.force, work.torque)
