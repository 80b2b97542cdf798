# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of a replay: level, message and values."""

from collections.abc import Mapping

from icofabric_sim.messages import (
    decode_diagnostic_array,
    DiagnosticArrayBytes,
    DiagnosticStatus,
    ERROR,
    OK,
    WARN,
)
from icofabric_sim.messages.schedule import seconds
from icofabric_sim.running.diagnostics import headline
from icofabric_sim.running.replay.player import ReplayStatus
from icofabric_sim.running.replay.source import ReplaySource

# A rate below this ratio of the requested one causes a warning.
_SLOW_RATIO = 0.9
_LEVELS = ('OK', 'WARN', 'ERROR', 'STALE')


class ReplayReport:
    """Formatter of /diagnostics of one replay."""

    def __init__(self, name: str, source: ReplaySource) -> None:
        """Report under the full node name `name`."""
        self.name = name
        self._source = source
        self._message = DiagnosticArrayBytes()

    def message(
        self, status: ReplayStatus, notes: Mapping[str, str] | None = None, warning: str = ''
    ) -> bytes:
        """Return the message for the present `status`, with further values in `notes`."""
        described = self.describe(status, notes or {}, warning)
        return self._message.stamped(status.time, [described])

    def describe(
        self, status: ReplayStatus, notes: Mapping[str, str], warning: str = ''
    ) -> DiagnosticStatus:
        """Return the diagnostics of `status`; `warning` is a further reason for WARN."""
        level, sentence = OK, 'playing a recorded run'
        if status.at_end:
            sentence = 'at the end of the recorded run'
        if status.paused:
            sentence = 'paused in a recorded run'
        moving = not (status.at_end or status.paused)
        if moving and 0.0 < status.rate < _SLOW_RATIO * status.target_rate:
            level = WARN
            sentence = (
                f'rate {status.rate:.3g}, below the requested {status.target_rate:.3g}: limited '
                'by reading the bag')
        if warning:
            level, sentence = WARN, warning
        if status.failure:
            level, sentence = ERROR, status.failure
        values = {
            'bag': str(self._source.path),
            'recorded fabric': self._source.fabric,
            'recorded time [s]': f'{seconds(status.time):.9f}',
            'start [s]': f'{seconds(status.start):.9f}',
            'end [s]': f'{seconds(status.end):.9f}',
            'rate': f'{status.rate:.4g}' if moving else '0',
            'target rate': f'{status.target_rate:g}',
            'loops': str(status.loops),
            'messages sent': str(status.sent),
            'reasons': sentence if level != OK else 'none',
            **self._recorded(status.recorded_report),
            **notes,
        }
        return DiagnosticStatus(
            level, self.name, headline([sentence]), 'icofabric_sim', values)

    def _recorded(self, data: bytes | None) -> Mapping[str, str]:
        """Return level and message that the fabric reported at that time."""
        try:
            statuses = decode_diagnostic_array(data)[1] if data is not None else []
        except ValueError:  # of another type, or malformed: only additional information
            return {}
        for entry in statuses:
            if entry.name == self._source.fabric:
                return {'recorded level': _LEVELS[min(entry.level, 3)],
                        'recorded message': entry.message}
        return {}
