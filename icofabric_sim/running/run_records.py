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
"""What a running simulation reports."""

import math
from typing import Any, NamedTuple

from icofabric_sim.simulation.inputs import Inputs
from icofabric_sim.simulation.simulation import Simulation
from icofabric_sim.simulation.stepping.methods import facts_of
import numpy as np


class Errors(NamedTuple):
    """Errors that the method adds: position over a, or orientation in rad, the larger."""

    rate: float  # lately, for each second
    estimate: float  # since the start, as if none of them had grown


class Status(NamedTuple):
    """What diagnostics and summaries report."""

    time: int  # [ns]
    paused: bool
    finished: bool
    failure: str  # '': none
    factor: float  # simulated over wall time, lately
    wanted_factor: float
    step: float  # [s]
    limit: float  # [s]
    step_count: int
    body_count: int
    connector_count: int
    loads_active: int
    dropped: int  # wrenches that came too late, or for what is gone
    proximity: str
    method: str
    tolerance: float  # [1/s]
    errors: Errors | None  # None: not measured; NaN: not estimated
    errors_lack: str  # what they may not cover
    balance_error: float  # present error of the energy balance, in parts of the largest energy
    balance_worst: float  # the largest so far
    energy_limit: float = math.inf  # what it may be before the run stops
    loads_waiting: int = 0  # wrenches whose stamp lies ahead
    contacts: int = 0  # pairs that touched at the last health check
    breaks: int = 0  # connectors that have broken
    obstruction: str = ''  # the first connector in its own shell
    obstructed: int = 0  # ends of connectors in their own shells
    cause: str = ''  # why the run is not faster
    limited_by: str = ''  # what limits the step, and since when; '': not known
    waits: str = ''  # what simulated time waits for; '': it does not
    evaluations: int = 0  # of the forces, by the trajectory
    estimations: int = 0  # of the forces, beside it
    shown: int = 0  # those of them for states that were shown
    lag: float = 0.0  # longest time that a request waited since the last report [s]


def figures(simulation: Simulation) -> dict[str, Any]:
    """What a status says of the simulation itself; cheap, and harmless beside a run."""
    status, balance = simulation.status, simulation.balance
    proximity = status.proximity
    return {
        'step': status.step,
        'limit': step_limit(simulation),
        'step_count': status.step_count,
        'evaluations': status.evaluation_count,
        'estimations': status.estimation_count,
        'shown': status.shown_count,
        'body_count': simulation.scene.body_count,
        'connector_count': simulation.scene.connector_count,
        'loads_active': len(status.active_loads),
        'breaks': status.broken_count,
        'obstruction': status.obstruction,
        'obstructed': status.obstructed_ends,
        'contacts': status.contact_count,
        'errors_lack': status.error_estimate_lacks,
        'proximity': '' if proximity is None else str(proximity),
        'method': status.method_name,
        'tolerance': simulation.scene.parameters['solver.tolerance'],
        'balance_error': balance.error / balance.scale if balance.scale > 0.0 else 0.0,
        'balance_worst': balance.worst,
        'energy_limit': simulation.scene.parameters['solver.energy_limit'],
    }


def step_limit(simulation: Simulation) -> float:
    """
    Longest step [s] that is stable now; infinite where its error limits each step.

    A frequency that contacts may reach some time limits no step that adapts.
    """
    given = simulation.scene.parameters['solver.step'] > 0.0
    if facts_of(simulation.status.method_name).adaptive and not given:
        return math.inf
    return simulation.status.stability_limit


def errors_of(simulation: Simulation) -> Errors:
    """What the method has added; in the thread that advances the simulation only."""
    return Errors(simulation.status.error_rate, simulation.error_estimate)


def begins_anew(simulation: Simulation) -> bool:
    """
    Whether a simulation stands where building its scene has put it: nothing was done to it yet.
    """
    if simulation.time != 0.0 or simulation.status.waiting_loads or simulation.status.broken_count:
        return False
    state, first = simulation.snapshot(), simulation.scene.initial
    acting, steady = simulation.inputs.acting(), Inputs(simulation.scene).acting()
    return acting.keys() == steady.keys() and all(
        wrench.same(steady[key]) for key, wrench in acting.items()
    ) and all(np.array_equal(getattr(state, name), getattr(first, name)) for name in first._fields)
