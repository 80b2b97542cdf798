# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A rank other than the first, which holds windows and executes orders until the run ends."""

import socket
from typing import Any

from icofabric_sim.kernels.integrators.tableau import Pair
from icofabric_sim.scene.available_memory import available_memory
from icofabric_sim.simulation.devices.held_pair import HeldPair
from icofabric_sim.simulation.devices.held_part import HeldPart
from icofabric_sim.simulation.devices.transport import Transport


class Server:
    """Execution of the orders of the first rank."""

    def __init__(self, transport: Transport) -> None:
        """Start without windows."""
        self._transport = transport
        self._held: dict[int, HeldPart | HeldPair] = {}

    def serve(self) -> int:
        """
        Execute orders until the end; return the exit status of the first rank.

        Raises RankError if a rank has failed.
        """
        while True:
            name, *rest = self._transport.next_order()
            if name == 'end':
                return int(rest[0])
            if name == 'room':
                # On which machine this is, and how many bytes are left there.
                self._transport.answer((socket.gethostname(), available_memory()))
                continue
            number, *words = rest
            if name == 'window':
                window, what = words
                kind: Any = HeldPair if isinstance(what, Pair) else HeldPart
                self._held[number] = kind(self._transport, window, what)
            elif name == 'forget':
                self._held.pop(number, None)
            else:
                self._do(name, number, *words)

    def _do(self, name: str, number: int, *words: Any) -> None:
        """Execute an order for one fabric."""
        getattr(self._held[number], name)(*words)
