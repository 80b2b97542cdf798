# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Everything that a simulation shows, as bits that tests compare."""

import inspect
from typing import Any

import icofabric_sim as ico
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.reports.status import SimulationStatus
import numpy as np


def bits(value: Any) -> Any:
    """Something that is equal where a value has the same bits."""
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str, value.tobytes()
    if isinstance(value, float):
        return value.hex()
    if isinstance(value, dict):
        return [(key, bits(item)) for key, item in value.items()]
    if isinstance(value, (tuple, list)):
        return [bits(item) for item in value]
    return value


def figures(simulation: ico.Simulation) -> dict[str, Any]:
    """All that a simulation shows, by name, as bits."""
    snapshot = simulation.snapshot()
    shown = {f'snapshot.{name}': getattr(snapshot, name) for name in dir(Snapshot)
             if not (name.startswith('_') or inspect.isfunction(getattr(Snapshot, name)))}
    shown.update({f'snapshot.{name}': value for name, value in vars(snapshot).items()
                  if name != 'packed'})
    shown.update({name: getattr(simulation.status, name) for name, member in inspect.getmembers(
        SimulationStatus) if isinstance(member, property) and not name.startswith('_')})
    # Evaluations for states that were shown count where they were shown.
    del shown['estimation_count'], shown['shown_count']
    shown['time'] = simulation.time
    found = {name: bits(value) for name, value in shown.items()}
    # What it is all about is among them.
    assert {'snapshot.energy', 'snapshot.ledger', 'snapshot.position', 'balance', 'error_rate',
            'error_estimate', 'contact_tests', 'active_loads', 'largest_frequency'} <= set(found)
    return found


def unlike(one: dict[str, Any], other: dict[str, Any]) -> list[str]:
    return [name for name in one if one[name] != other[name]]
