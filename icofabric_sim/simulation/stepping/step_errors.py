# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Errors of steps of one length: in free motion, and during contacts."""

import logging
import math
from typing import Any

from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.stepping.accuracy_probe import AccuracyProbe
from icofabric_sim.simulation.stepping.touching_errors import TouchingErrors

_LOGGER = logging.getLogger('icofabric_sim')

# Largest ratio of the sum to the true error: above it, the error certainly exceeds the tolerance.
_CERTAIN_RATIO = 3.0


class StepErrors:
    """Sum of both errors."""

    def __init__(
        self, probe: AccuracyProbe, touching: TouchingErrors | None, *, is_estimated: bool
    ) -> None:
        """
        Combine both measurements; `touching` is None without contacts or with adaptive steps.

        Unless `is_estimated`, measurements choose steps but are no estimate.
        """
        self.probe, self.touching, self.is_estimated = probe, touching, is_estimated
        # Time [s] of the saved state that the run went back to last, as its error was too large.
        self.returned_to = -math.inf
        self._is_reported = False

    def report_excess(self, time: float) -> None:
        """Warn once if errors in contacts until `time` [s] exceed the tolerance."""
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
        """
        Return the errors from the start to a present `time` [s], without amplification or decay.
        """
        touching = 0.0 if self.touching is None else self.touching.estimate(time)
        return self.probe.estimate(time) + touching

    def begin(self, time: float) -> None:
        """
        Start an interval of steps that is measured as a whole at `time` [s], the saved state.
        """
        if self.touching is not None:
            self.touching.begin(time)

    def spoil(self) -> None:
        """Exclude the current interval from the error estimate: its step size changed."""
        if self.touching is not None:
            self.touching.spoil()

    def close_stretch(self, time: float) -> None:
        """
        Measure the interval up to the health check at `time` [s], before the step size changes.
        """
        if self.touching is not None:
            self.touching.close(time, self.probe.steady_rate)

    def jump(self, time: float) -> None:
        """Count the errors until `time` [s], where the state jumps."""
        self.probe.close(time)
        if self.touching is not None:
            self.touching.settle(self.touching.estimate(time))
        self.returned_to = -math.inf

    def restart_touching(self, time: float) -> None:
        """Restart the measurement of contacts at `time` [s], the saved state after a jump."""
        if self.touching is not None:
            self.touching.restart()
            self.touching.begin(time)

    def forget(self) -> None:
        """Reset the sum of errors."""
        self.settle(0.0)
        self.probe.forget()

    def settle(self, total: float) -> None:
        """Set the `total` of errors at the present time."""
        self.probe.settle(total)
        if self.touching is not None:
            self.touching.settle(0.0)

    def rebase(self, time: float) -> None:
        """Move an unstarted motion to another `time` [s]."""
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
        """Restore the measurements from a checkpoint."""
        self.returned_to = tree.number('returned_to', finite=False)
        self.probe.load_state(tree.part('accuracy'))
        if self.touching is not None:
            self.touching.load_state(tree.part('touching'))
