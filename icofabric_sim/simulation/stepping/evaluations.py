# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Counts of evaluations of the forces of the whole fabric.

Each belongs to the trajectory, or estimates errors and finds what is shown: then it changes no
step. What is shown depends on who asks, so it is no part of a checkpoint. What a call of kernels
evaluates again where the call before has ended counts once.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from icofabric_sim.simulation.checkpoints.state_tree import StateTree

_TRAJECTORY, _ESTIMATE, _SHOWN = range(3)


class Evaluations:
    """Numbers of force evaluations, by purpose."""

    def __init__(self) -> None:
        """Begin to count."""
        self._purpose = _TRAJECTORY
        self._counts = [0, 0, 0]

    @property
    def trajectory(self) -> int:
        """Evaluations that the trajectory itself took, those of refused steps included."""
        return self._counts[_TRAJECTORY]

    @property
    def outside(self) -> int:
        """All others: measurements of errors, judged steps, and states that were shown."""
        return self._counts[_ESTIMATE] + self._counts[_SHOWN]

    @property
    def shown(self) -> int:
        """Those of them for states that were shown."""
        return self._counts[_SHOWN]

    def add(self, count: int = 1) -> None:
        """Add `count` evaluations for the present purpose."""
        self._counts[self._purpose] += count

    @contextmanager
    def estimating(self) -> Iterator[None]:
        """Count for an estimate what is evaluated meanwhile, if nothing is being shown."""
        with self._counting_for(max(self._purpose, _ESTIMATE)):
            yield

    @contextmanager
    def showing(self) -> Iterator[None]:
        """Count for a state that is shown what is evaluated meanwhile."""
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
        """Count from zero again."""
        self._counts[:] = 0, 0, 0

    def continue_from(self, before: 'Evaluations') -> None:
        """Add the evaluations of a run that this one continues."""
        self._counts[:] = map(sum, zip(self._counts, before._counts))

    def restore_total(self, total: int) -> None:
        """Count as shown what of a `total` was rolled back since then."""
        self._counts[_SHOWN] += total - self.total

    @property
    def total(self) -> int:
        """All of them."""
        return sum(self._counts)

    def state_tree(self) -> dict[str, Any]:
        """Those that depend on the motion alone."""
        return {'trajectory': self._counts[_TRAJECTORY], 'estimate': self._counts[_ESTIMATE]}

    def load_state(self, tree: StateTree | None) -> None:
        """Count on from there; None: from zero, as earlier versions did not count."""
        self.forget()
        if tree is not None:
            self._counts[_TRAJECTORY] = tree.count('trajectory')
            self._counts[_ESTIMATE] = tree.count('estimate')
