# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Status of a running simulation."""

import math
from typing import Any, NamedTuple

from icofabric_sim.simulation.inputs.inputs import Inputs
from icofabric_sim.simulation.simulation import Simulation
from icofabric_sim.simulation.stepping.methods import facts_of
import numpy as np


class Errors(NamedTuple):
    """Errors of the integrator: the larger of position over half edge a and orientation [rad]."""

    rate: float  # at present, per second
    estimate: float  # since the start, without amplification


class Status(NamedTuple):
    """Status for diagnostics and summaries."""

    time: int  # [ns]
    paused: bool
    finished: bool
    failure: str  # '': none
    factor: float  # recent ratio of simulated to wall time
    target_factor: float
    step: float  # [s]
    limit: float  # stability limit of the step [s]
    step_count: int
    body_count: int
    connector_count: int
    loads_active: int
    dropped: int  # received inputs that never acted
    proximity: str
    method: str
    tolerance: float  # [1/s]
    errors: Errors | None  # None: not measured; NaN: not estimated
    errors_lack: str  # contributions that the estimate lacks
    balance_error: float  # present relative error of the energy balance
    balance_worst: float  # largest so far
    energy_limit: float = math.inf  # value that stops the run
    loads_waiting: int = 0  # wrenches with future stamps
    contacts: int = 0  # pairs in contact at the last health check
    breaks: int = 0  # broken connectors
    obstruction: str = ''  # first connector in its own shell
    obstructed: int = 0  # connector ends in their own shells
    cause: str = ''  # why the run is not faster
    limited_by: str = ''  # limit of the step, with its start time; '': unknown
    waits: str = ''  # reason why simulated time waits; '': it does not
    evaluations: int = 0  # force evaluations of the trajectory
    estimations: int = 0  # other force evaluations
    shown: int = 0  # those of `estimations` for states between steps
    lag: float = 0.0  # longest waiting time of a request since the last report [s]


def figures(simulation: Simulation) -> dict[str, Any]:
    """
    Return the status values of a simulation; cheap, and safe in another thread than the run's.
    """
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
    Return the longest stable step [s] at present, infinite if the error limits each step.

    Frequencies that contacts may reach later do not limit adaptive steps.
    """
    given = simulation.scene.parameters['solver.step'] > 0.0
    if facts_of(simulation.status.method_name).adaptive and not given:
        return math.inf
    return simulation.status.stability_limit


def errors_of(simulation: Simulation) -> Errors:
    """Return the errors of the integrator; call in the thread that advances the simulation."""
    return Errors(simulation.status.error_rate, simulation.error_estimate)


def is_initial(simulation: Simulation) -> bool:
    """Return whether a simulation is in its initial state and has not been changed."""
    if simulation.time != 0.0 or simulation.status.waiting_loads or simulation.status.broken_count:
        return False
    state, first = simulation.snapshot(), simulation.scene.initial
    acting, steady = simulation.inputs.acting(), Inputs(simulation.scene).acting()
    return acting.keys() == steady.keys() and all(
        wrench.same(steady[key]) for key, wrench in acting.items()
    ) and all(np.array_equal(getattr(state, name), getattr(first, name)) for name in first._fields)
