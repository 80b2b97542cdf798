# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Lanczos iteration with vectors on all ranks and the matrix on the first rank."""

import math
from typing import Any

from icofabric_sim.kernels.lanczos import added_up
from icofabric_sim.simulation.devices.part_steps import Arrays, PartSteps
from icofabric_sim.simulation.devices.sharing import Sharing
from icofabric_sim.simulation.model.lanczos import start_rows, Tridiagonal
import numpy as np


class SharedIteration:
    """Steps of `Lanczos` that all ranks take; created on the first rank."""

    def __init__(self, sharing: Sharing, own: PartSteps, run: Arrays, most: int) -> None:
        """Begin at the state of a run that the ranks hold, for at most `most` steps."""
        self._sharing, self.matrix = sharing, Tridiagonal.of(most)
        layout, transport = sharing.packed.layout, sharing.transport
        sharing.order('begin_iteration')
        self._own = own.iteration(run)
        for k, row in enumerate(start_rows(layout, sharing.packed.model.supports)):
            requests: list[Any] = []
            for rank in sharing.others:
                requests += sharing.rows[rank].send(transport, [row[None]], rank)
            sharing.rows[0].copy(row[None], self._own.start[k:k + 1])
            transport.wait(requests)
        # Upper bound of the largest eigenvalue [1/s^2].
        self.bound = float(sharing.largest_of(self._own.bound())[0])
        self._sums = np.zeros(sharing.group_count)
        self._length = math.sqrt(self._added_up(self._own.square()))

    @property
    def is_held(self) -> bool:
        """True if no body can move."""
        return not self._length > 0.0

    def go_on(self, count: int) -> None:
        """Take `count` more steps, or those that are left."""
        matrix = self.matrix
        last = min(matrix.done + count, len(matrix.diagonal))
        if matrix.done == 0:
            self._do('begin', self._length)
        for step in range(matrix.done, last):
            alpha = self._sum('multiply')
            beta = float(matrix.off[step - 1]) if step > 0 else 0.0
            matrix.diagonal[step] = alpha
            matrix.off[step] = math.sqrt(self._sum('subtract', alpha, beta))
            if not matrix.off[step] > 0.0:
                # Everything is found.
                break
            self._do('shift', 1.0 / float(matrix.off[step]))
        matrix.done = last

    def end(self) -> None:
        """Discard the vectors."""
        self._sharing.order('end_iteration')

    def _do(self, name: str, *numbers: float) -> Any:
        self._sharing.order('iterate', name, *numbers)
        return getattr(self._own, name)(*numbers)

    def _sum(self, name: str, *numbers: float) -> float:
        return self._added_up(self._do(name, *numbers))

    def _added_up(self, own: np.ndarray) -> float:
        self._sharing.gather_sums(own, self._sums)
        return float(added_up(self._sums))
