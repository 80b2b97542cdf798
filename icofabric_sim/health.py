# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Diagnostics of a run: level, sentence and figures.
"""

import math

from icofabric_sim.messages import DiagnosticArrayBytes, DiagnosticStatus, ERROR, OK, WARN
from icofabric_sim.run_records import Status
from icofabric_sim.schedule import seconds

# A pace below this part of the wanted one is worth a warning.
_SLOW = 0.9


def describe(
    status: Status, name: str, faults: dict[str, str], figures: dict[str, str]
) -> DiagnosticStatus:
    """
    Summary of `status` for /diagnostics.

    `faults` are reasons beside it (disk, rejected change), by their name.
    """
    level, sentence = OK, 'paused' if status.paused else 'running'
    if status.finished:
        sentence = 'finished'
    slow = 0.0 < status.factor < _SLOW * status.wanted_factor and not (
        status.paused or status.finished
    )
    if slow:
        level = WARN
        sentence = (
            f'slower than wanted: real-time factor {status.factor:.3g}, '
            'the computation takes that long'
        )
    if status.proximity:
        level, sentence = WARN, status.proximity
    for reason in faults.values():
        level, sentence = ERROR, reason
    if status.failure:
        level, sentence = ERROR, status.failure
    margin = status.limit / status.step if math.isfinite(status.limit) else math.inf
    values = {
        'simulated time [s]': f'{seconds(status.time):.9f}',
        'real-time factor': f'{status.factor:.4g}',
        'wanted real-time factor': f'{status.wanted_factor:g}',
        'step [s]': f'{status.step:.6g}',
        'stability limit [s]': f'{status.limit:.6g}',
        'stability margin': f'{margin:.4g}',
        'steps': str(status.step_count),
        'method': status.method,
        'tolerance': f'{status.tolerance:g}',
        'error per second': _error(status, 0),
        'error estimate': _error(status, 1),
        'energy balance error': f'{status.balance_error:.3g}',
        'largest energy balance error': f'{status.balance_worst:.3g}',
        'bodies': str(status.body_count),
        'connectors': str(status.connector_count),
        'loads active': str(status.loads_active),
        'proximity': status.proximity or 'none',
        **figures,
        **faults,
    }
    return DiagnosticStatus(level, name, sentence, 'icofabric_sim', values)


def _error(status: Status, place: int) -> str:
    if status.errors is None:
        return 'not measured: solver.step is given'
    return f'{status.errors[place]:.3g}'


class HealthReport:
    """
    Lays out /diagnostics for one node.
    """

    def __init__(self, name: str) -> None:
        """
        Report under the node's full `name`.
        """
        self.name = name
        self._message = DiagnosticArrayBytes()

    def bytes(
        self,
        status: Status,
        faults: dict[str, str] | None = None,
        figures: dict[str, str] | None = None,
    ) -> bytes:
        """
        Message for the present `status`.
        """
        return self._message.stamped(
            status.time, [describe(status, self.name, faults or {}, figures or {})]
        )
