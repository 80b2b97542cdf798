# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""diagnostic_msgs/DiagnosticArray message: status of named components."""
from __future__ import annotations

from collections.abc import Iterable, Mapping
import struct
from typing import ClassVar, NamedTuple, SupportsIndex

from icofabric_sim import checks
from icofabric_sim.messages.cdr import CdrBuilder, split_nanoseconds

# Levels of diagnostic_msgs/DiagnosticStatus.
OK, WARN, ERROR, STALE = range(4)


class DiagnosticStatus(NamedTuple):
    """Status of one component: level OK, WARN, ERROR or STALE, a sentence, and values as text."""

    level: int
    name: str
    message: str
    hardware_id: str = ''
    values: Mapping[str, str] = {}


class DiagnosticArrayBytes:
    """diagnostic_msgs/DiagnosticArray message; small and always different, so built on request."""

    TYPE: ClassVar[str] = 'diagnostic_msgs/msg/DiagnosticArray'

    def __init__(self, frame_id: str = '') -> None:
        layout = CdrBuilder()
        layout.header(frame_id)
        self._head = bytes(layout.data)

    def stamped(self, nanoseconds: SupportsIndex, statuses: Iterable[DiagnosticStatus]) -> bytes:
        """Return the message with this stamp, integer nanoseconds of simulated time."""
        layout = CdrBuilder()
        layout.data[:] = self._head
        struct.pack_into('<II', layout.data, 4, *split_nanoseconds(nanoseconds))
        statuses = checks.items('statuses', statuses, 'DiagnosticStatus')
        layout.numbers('I', len(statuses))
        for status in statuses:
            checks.instance('each of statuses', status, DiagnosticStatus)
            layout.numbers('B', checks.count('level of a status', status.level, OK, STALE))
            for name in ('name', 'message', 'hardware_id'):
                layout.string(getattr(status, name), f'{name} of a status')
            layout.numbers('I', len(checks.mapping('values of a status', status.values)))
            for key, value in status.values.items():
                layout.string(key, 'a name in values of a status')
                layout.string(value, f'{key} of values of a status')
        return bytes(layout.data)
