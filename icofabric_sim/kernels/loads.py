# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Kernels that call the functions of all loads of the registry, for one row of the loads.

The loops over rows are in their callers: a compiled function with a loop counts the references of
all its arrays at every call, which takes ten times as long as the computation itself.
"""

from icofabric_sim.kernels.composition import compose_loads
from icofabric_sim.kernels.records import Model, State
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import lane, LANES, load_at, splat, store_at
from icofabric_sim.terms.loads import Loads
import numpy as np

# No wrench. The profile of a wrench is reused while consecutive rows have the same wrench.
NONE = np.int64(-1)

# Before, at and after the end of a drift.
stop_row = compose_loads('stop_row', 'loads, state, m, s')
work_row = compose_loads(
    'work_row', 'loads, state, m, s, time, h, known, factors', 'known, factors')
place_row = compose_loads('place_row', 'loads, state, m, s, time')
# Before, at and after a kick.
resist_row = compose_loads('resist_row', 'model, loads, state, m, s, h, again, a', 'a')
velocities_before = compose_loads('velocities_before', 'loads, state, s', 'before')
kick_row = compose_loads(
    'kick_row', 'model, loads, state, m, s, time, h, known, factor', 'known, factor')
kick_row_again = compose_loads(
    'kick_row_again', 'model, loads, state, m, s, time, h, known, factor', 'known, factor')
bear_row = compose_loads('bear_row', 'loads, state, before, m, s')
# In a slope; paths come last because they bear all other forces.
add_row_slope = compose_loads(
    'add_row_slope',
    'model, loads, state, linear, angular, m, s, time, index, meter, known, factor',
    'known, factor')
resist_row_slope = compose_loads(
    'resist_row_slope', 'model, loads, state, linear, angular, m, s, index')
keep_row_turning = compose_loads('keep_row_turning', 'model, loads, angular, m, s')
# In a health check.
add_row_bound = compose_loads(
    'add_row_bound', 'model, loads, state, m, s, time, bound, energy', 'bound, energy')
driven_energy = compose_loads(
    'add_driven_energy', 'model, loads, state, first, last, total', 'total')


@compiled
def keep_work(loads: Loads, first: int, last: int) -> None:
    """Store the work so far, to restore if a step is rejected."""
    for m in range(loads.start[first], loads.start[last]):
        store_at(loads.earlier_work, LANES * m, load_at(loads.work, LANES * m))


@compiled
def energy_of_drives(model: Model, loads: Loads, state: State) -> float:
    """Return the kinetic energy [J] of the driven freedoms in all blocks."""
    return driven_energy(model, loads, state, 0, model.blocks.slot.shape[0], 0.0)


@compiled
def place_driven(model: Model, loads: Loads, state: State, time: float) -> None:
    """Place all driven bodies on their paths at `time` [s]."""
    for block in range(model.blocks.slot.shape[0]):
        s = model.blocks.slot[block]
        for m in range(loads.start[block], loads.start[block + 1]):
            place_row(loads, state, m, s, time)


@compiled
def look_at_anchors(
    model: Model, loads: Loads, state: State, time: float
) -> tuple[float, float]:
    """Return the largest bound of a body [1/s^2] and the energy [J] of all anchors."""
    largest, total = 0.0, 0.0
    for block in range(model.blocks.slot.shape[0]):
        s = model.blocks.slot[block]
        bound, energy = splat(0.0), splat(0.0)
        for m in range(loads.start[block], loads.start[block + 1]):
            bound, energy = add_row_bound(model, loads, state, m, s, time, bound, energy)
        for i in range(LANES):
            largest = max(largest, lane(bound, i))
            total += lane(energy, i)
    return largest, total
