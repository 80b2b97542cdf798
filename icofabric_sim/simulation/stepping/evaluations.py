# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Numbers of force evaluations of the whole fabric.

An evaluation belongs to the trajectory, or changes no step: it estimates errors, or shows a state.
Shown states depend on the caller, so checkpoints exclude their count. An evaluation that kernels
repeat at the start of a call counts once.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from icofabric_sim.simulation.checkpoints.state_tree import StateTree

_TRAJECTORY, _ESTIMATE, _SHOWN = range(3)


class Evaluations:
    """Numbers of force evaluations, by purpose."""

    def __init__(self) -> None:
        """Start to count."""
        self._purpose = _TRAJECTORY
        self._counts = [0, 0, 0]

    @property
    def trajectory(self) -> int:
        """Evaluations of the trajectory, including those of rejected steps."""
        return self._counts[_TRAJECTORY]

    @property
    def outside(self) -> int:
        """All other evaluations: error measurements, checked steps, and shown states."""
        return self._counts[_ESTIMATE] + self._counts[_SHOWN]

    @property
    def shown(self) -> int:
        """Evaluations for shown states."""
        return self._counts[_SHOWN]

    def add(self, count: int = 1) -> None:
        """Add `count` evaluations for the present purpose."""
        self._counts[self._purpose] += count

    @contextmanager
    def estimating(self) -> Iterator[None]:
        """Count evaluations of the block as estimates, unless a state is being shown."""
        with self._counting_for(max(self._purpose, _ESTIMATE)):
            yield

    @contextmanager
    def showing(self) -> Iterator[None]:
        """Count evaluations of the block for a shown state."""
        with self._counting_for(_SHOWN):
            yield

    @contextmanager
    def _counting_for(self, purpose: int) -> Iterator[None]:
        before, self._purpose = self._purpose, purpose
        try:
            yield
        finally:
            self._purpose = before

    def forget(self) -> None:
        """Reset all counts."""
        self._counts[:] = 0, 0, 0

    def continue_from(self, before: 'Evaluations') -> None:
        """Add the evaluations of a run that this one continues."""
        self._counts[:] = map(sum, zip(self._counts, before._counts))

    def restore_total(self, total: int) -> None:
        """Count evaluations of a `total` that were rolled back since then as shown."""
        self._counts[_SHOWN] += total - self.total

    @property
    def total(self) -> int:
        """Number of all evaluations."""
        return sum(self._counts)

    def state_tree(self) -> dict[str, Any]:
        """Return the counts that depend on the motion alone."""
        return {'trajectory': self._counts[_TRAJECTORY], 'estimate': self._counts[_ESTIMATE]}

    def load_state(self, tree: StateTree | None) -> None:
        """Restore the counts; None, of earlier versions, stands for zero."""
        self.forget()
        if tree is not None:
            self._counts[_TRAJECTORY] = tree.count('trajectory')
            self._counts[_ESTIMATE] = tree.count('estimate')
