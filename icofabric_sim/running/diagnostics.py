# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Diagnostics of a run: level, message and values.

A message has at most 80 characters; the value `reasons` has the full text.

ERROR means that something was lost or failed: the simulation has stopped, a change could not be
built, or recording has ended. WARN means that the run continues with a deficiency: too slow,
unphysical contact overlap, near a limit, or messages dropped since the last report.
"""

from collections.abc import Mapping, Sequence
import math
import re

from icofabric_sim.messages import DiagnosticArrayBytes, DiagnosticStatus, ERROR, OK, WARN
from icofabric_sim.messages.schedule import seconds
from icofabric_sim.running.run_records import Status

# A real-time factor below this ratio of the target causes a warning,
_SLOW_RATIO = 0.9
# so does an energy-balance error above this ratio of the limit,
_BALANCE_WARNING_RATIO = 0.5
# and a recorder lag above this time [s].
_MAX_LAG_S = 1.0

_MAX_MESSAGE_LENGTH = 80  # characters

# Values that count dropped messages, with their descriptions.
WRENCHES_DROPPED = 'wrenches dropped'
RECORDER_DROPPED = 'recorder dropped'
RECORDER_LAG = 'recorder lag [s]'
NOT_TAKEN = 'messages not taken in time'
_DROPPED = {
    WRENCHES_DROPPED: 'wrenches were dropped (the log says which and why)',
    RECORDER_DROPPED: 'messages were not recorded: the disk is too slow',
    NOT_TAKEN: 'messages were overwritten before all subscribers received them',
}


# Remedies by the limit of the step.
_REMEDIES = {
    'solver.step, which': 'a longer solver.step, or 0',
    'accuracy (': 'a larger solver.tolerance',
    'contacts (': 'softer contact (a smaller contact.stiffness)',
    'the connectors (': 'softer connectors (connector.stiffness)',
    'spinning bodies': 'drag.angular',
}


def describe(
    status: Status,
    name: str,
    faults: Mapping[str, str],
    figures: Mapping[str, str],
    *,
    before: Mapping[str, str] | None = None,
    notes: Mapping[str, str] | None = None,
) -> DiagnosticStatus:
    """
    Return the diagnostics of `status`.

    `faults` are further reasons for ERROR (disk, rejected change) and `notes` reasons for WARN
    (another publisher of /clock), by name; `before` are the values of the last report.
    """
    errors = [status.failure] if status.failure else []
    errors += faults.values()
    warnings = [*_warnings(status, figures, before or {}), *(notes or {}).values()]
    level, sentences = OK, ['paused' if status.paused else 'running']
    if status.finished:
        sentences = ['finished']
    if warnings:
        level, sentences = WARN, warnings
    if errors:
        level, sentences = ERROR, errors
    values = {
        'simulated time [s]': f'{seconds(status.time):.9f}',
        'real-time factor': f'{status.factor:.4g}',
        'target real-time factor': f'{status.target_factor:g}',
        'use of wall time': status.cause or 'not measured',
        'step [s]': f'{status.step:.6g}',
        'step limited by': status.limited_by or 'not known yet',
        'stability limit [s]': f'{status.limit:.6g}',
        'stability margin': f'{_margin(status):.4g}',
        'steps': str(status.step_count),
        'evaluations of the forces': str(status.evaluations),
        'evaluations beside the trajectory': str(status.estimations),
        'method': status.method,
        'tolerance': f'{status.tolerance:g}',
        'error per second': _error(status, 0),
        'error estimate': _error(status, 1),
        'error estimate lacks': status.errors_lack or 'nothing',
        'energy balance error': f'{status.balance_error:.3g}',
        'largest energy balance error': f'{status.balance_worst:.3g}',
        'bodies': str(status.body_count),
        'connectors': str(status.connector_count),
        'contacts': str(status.contacts),
        'breaks': str(status.breaks),
        'connector ends in their shells': str(status.obstructed),
        'obstruction': status.obstruction or 'none',
        'loads active': str(status.loads_active),
        'loads waiting': str(status.loads_waiting),
        'queue lag [s]': f'{status.lag:.3f}',
        'proximity': status.proximity or 'none',
        'reasons': '; '.join(sentences) if level != OK else 'none',
        **figures,
        **faults,
        **(notes or {}),
    }
    return DiagnosticStatus(level, name, headline(sentences), 'icofabric_sim', values)


def describe_start(name: str, compiling: float) -> DiagnosticStatus:
    """
    Return the status of a node that has no run yet.

    `compiling`: time [s] spent compiling so far, 0 if nothing is being compiled.
    """
    spent = f'for {compiling:.0f} s so far'
    values = {'simulated time [s]': f'{0.0:.9f}', 'compiling': spent if compiling else 'no'}
    if not compiling:
        return DiagnosticStatus(OK, name, 'starting', 'icofabric_sim', values)
    return DiagnosticStatus(
        WARN, name, f'compiling the kernels of the scene, {spent}', 'icofabric_sim', values)


def headline(sentences: Sequence[str]) -> str:
    """Return the sentences, or their first clauses, in at most 80 characters."""
    clauses = [re.split('[:;] ', sentence, maxsplit=1)[0] for sentence in sentences]
    for text in ('; '.join(sentences), '; '.join(clauses)):
        if len(text) <= _MAX_MESSAGE_LENGTH:
            return text
    more = f' (and {len(clauses) - 1} more)' if len(clauses) > 1 else ''
    room = _MAX_MESSAGE_LENGTH - len(more)
    first = clauses[0]
    return (first if len(first) <= room else f'{first[:room - 4]} ...') + more


def _warnings(
    status: Status, figures: Mapping[str, str], before: Mapping[str, str]
) -> list[str]:
    found = []
    stands = status.paused or status.finished
    if status.waits:
        found.append(f'simulated time is waiting: {status.waits}')
    elif 0.0 < status.factor < _SLOW_RATIO * status.target_factor and not stands:
        found.append(
            f'below the target real-time factor ({status.factor:.3g} of '
            f'{status.target_factor:g}): {status.cause}' + (
                f'; steps of {status.step:.3g} s are limited by {status.limited_by}'
                if status.limited_by else '') + f'; remedies: {remedies(status)}')
    if status.proximity:
        found.append(status.proximity)
    if status.obstructed:
        found.append(
            f'{status.obstructed:,} connector ends were in their own shells at the last '
            'health check')
    if status.balance_error > _BALANCE_WARNING_RATIO * status.energy_limit:
        found.append(
            f'the energy balance error is {status.balance_error:.3g}; the run stops at '
            f'solver.energy_limit = {status.energy_limit:g}')
    if _margin(status) < 1.0:
        found.append(
            f'the step {status.step:.6g} s is beyond the stability limit {status.limit:.6g} s')
    for figure, words in _DROPPED.items():
        count = int(figures.get(figure, 0)) - int(before.get(figure, 0))
        if count > 0:
            found.append(f'{count} {words}')
    lag = float(figures.get(RECORDER_LAG, 0.0))
    if lag > _MAX_LAG_S:
        found.append(f'the recorder lags by {lag:.1f} s')
    return found


def remedies(status: Status) -> str:
    """Return parameters that would speed up a slow run, the most effective first."""
    found = [words for sign, words in _REMEDIES.items() if sign in status.limited_by]
    return ', '.join([*found, 'fewer bodies (weave.size)', 'a smaller real_time_factor'])


def _margin(status: Status) -> float:
    return status.limit / status.step if math.isfinite(status.limit) else math.inf


def _error(status: Status, place: int) -> str:
    if status.errors is None:
        return 'not measured'
    if math.isnan(status.errors[place]):
        return 'not estimated'
    return f'{status.errors[place]:.3g}'


class HealthReport:
    """Formatter of /diagnostics for one node."""

    def __init__(self, name: str) -> None:
        """Report under the full node name `name`."""
        self.name = name
        self._message = DiagnosticArrayBytes()
        self._before: Mapping[str, str] = {}

    def start_bytes(self, compiling: float) -> bytes:
        """Return the message of a node that has no run yet, see `describe_start`."""
        return self._message.stamped(0, [describe_start(self.name, compiling)])

    def bytes(
        self,
        status: Status,
        faults: Mapping[str, str] | None = None,
        figures: Mapping[str, str] | None = None,
        notes: Mapping[str, str] | None = None,
    ) -> bytes:
        """Return the message for the present `status`."""
        described = describe(
            status, self.name, faults or {}, figures or {}, before=self._before, notes=notes)
        self._before = figures or {}
        return self._message.stamped(status.time, [described])
