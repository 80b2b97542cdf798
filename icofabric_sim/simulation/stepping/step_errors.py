# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What steps of one length have added to the error: in free motion, and while shells touch."""

import logging
import math
from typing import Any

from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.stepping.accuracy_probe import AccuracyProbe
from icofabric_sim.simulation.stepping.touching_errors import TouchingErrors

_LOGGER = logging.getLogger('icofabric_sim')

# The sum is within so many times of what was added: above it more was, for certain.
_CERTAIN_RATIO = 3.0


class StepErrors:
    """Sums what both measure."""

    def __init__(
        self, probe: AccuracyProbe, touching: TouchingErrors | None, *, is_estimated: bool
    ) -> None:
        """
        `touching`: None where nothing can touch, or steps are adaptive.

        Not `is_estimated`: what is measured chooses steps, and is no estimate.
        """
        self.probe, self.touching, self.is_estimated = probe, touching, is_estimated
        # Time [s] of the saved state that the run went back to last, as its error was too large.
        self.returned_to = -math.inf
        self._is_reported = False

    def report_excess(self, time: float) -> None:
        """Warn once where contacts added more by `time` [s] than the tolerance allows."""
        if self.touching is None or self._is_reported:
            return
        allowed = self.probe.tolerance * time
        if allowed > 0.0 and self.touching.total > _CERTAIN_RATIO * allowed:
            self._is_reported = True
            _LOGGER.warning(
                'steps in which forces begin, end or jump (contacts, connectors around shells, or '
                'slack ones) have added errors of %.2g by t = %.6g s, where solver.tolerance %g '
                '1/s allows %.2g: these steps are not shortened there; solver.method dop8 or '
                'auto does so, without solver.step', self.touching.total, time,
                self.probe.tolerance, allowed)

    def estimate(self, time: float) -> float:
        """Errors added from the start to a present `time` [s], as if none had grown or faded."""
        touching = 0.0 if self.touching is None else self.touching.estimate(time)
        return self.probe.estimate(time) + touching

    def begin(self, time: float) -> None:
        """Begin a stretch of steps that is judged as a whole at `time` [s], where one is saved."""
        if self.touching is not None:
            self.touching.begin(time)

    def spoil(self) -> None:
        """Something else than steps of one length is part of this stretch."""
        if self.touching is not None:
            self.touching.spoil()

    def close_stretch(self, time: float) -> None:
        """Judge the stretch up to the health check of `time` [s]: steps get another length."""
        if self.touching is not None:
            self.touching.close(time, self.probe.steady_rate)

    def jump(self, time: float) -> None:
        """Count what was added until `time` [s], where the state jumps."""
        self.probe.close(time)
        if self.touching is not None:
            self.touching.settle(self.touching.estimate(time))
        self.returned_to = -math.inf

    def restart_touching(self, time: float) -> None:
        """Judge what touches from `time` [s] on, where the state has jumped to and is saved."""
        if self.touching is not None:
            self.touching.restart()
            self.touching.begin(time)

    def forget(self) -> None:
        """Count from zero again."""
        self.settle(0.0)
        self.probe.forget()

    def settle(self, total: float) -> None:
        """Set the `total` of errors at the present time."""
        self.probe.settle(total)
        if self.touching is not None:
            self.touching.settle(0.0)

    def rebase(self, time: float) -> None:
        """Begin at another `time` [s]: nothing has moved yet."""
        self.probe.rebase(time)
        self.begin(time)

    def state_tree(self) -> dict[str, Any]:
        """Return measured values and the times of the next measurements, as entries."""
        tree: dict[str, Any] = {
            'returned_to': self.returned_to, 'accuracy': self.probe.state_tree()}
        if self.touching is not None:
            tree['touching'] = self.touching.state_tree()
        return tree

    def load_state(self, tree: StateTree) -> None:
        """Go on from there."""
        self.returned_to = tree.number('returned_to', finite=False)
        self.probe.load_state(tree.part('accuracy'))
        if self.touching is not None:
            self.touching.load_state(tree.part('touching'))
