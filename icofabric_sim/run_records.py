# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
What goes into a running simulation, and what it reports.
"""

from typing import Any, NamedTuple

from icofabric_sim.inputs import Key
from icofabric_sim.simulation import Simulation


class WrenchInput(NamedTuple):
    """
    A wrench as it was received.
    """

    topic: str
    key: Key  # load channel or body
    stamp: int  # [ns] of simulated time, 0: at once
    force: Any
    torque: Any
    data: bytes  # the message, for the bag


class Errors(NamedTuple):
    """
    Errors that the method adds: position over a, or orientation in rad, the larger.
    """

    rate: float  # lately, for each second
    estimate: float  # since the start, as if none of them had grown


class Status(NamedTuple):
    """
    What diagnostics and summaries report.
    """

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
    errors: Errors | None  # None: not measured
    balance_error: float  # present error of the energy balance, in parts of the largest energy
    balance_worst: float  # the largest so far


def figures(simulation: Simulation) -> dict[str, Any]:
    """
    What a status says of the simulation itself; cheap, and harmless beside a run.
    """
    proximity, balance = simulation.proximity, simulation.balance
    return {
        'step': simulation.step,
        'limit': simulation.stability_limit,
        'step_count': simulation.step_count,
        'body_count': simulation.scene.body_count,
        'connector_count': simulation.scene.connector_count,
        'loads_active': len(simulation.active_loads),
        'proximity': '' if proximity is None else str(proximity),
        'method': simulation.method_name,
        'tolerance': simulation.scene.parameters['solver.tolerance'],
        'balance_error': balance.error / balance.scale if balance.scale > 0.0 else 0.0,
        'balance_worst': balance.worst,
    }


def cheap_errors(simulation: Simulation) -> Errors | None:
    """
    The errors of a chosen step, which are known; those of a given one take time to measure.

    In the thread that advances the simulation only.
    """
    if simulation.scene.parameters['solver.step'] > 0.0:
        return None
    return Errors(simulation.error_rate, simulation.error_estimate)
