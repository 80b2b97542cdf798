# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What every contestant provides to a measurement, the package itself included."""

from abc import ABC, abstractmethod

from icofabric_validation.benchmarks.scenes import Motion


class Unusable(Exception):
    """The contestant refuses this setting, or its motion did not survive it."""


class Solver(ABC):
    """One method of one tool on one scene, from the initial state on; single thread."""

    label: str  # as printed
    tool: str  # 'icofabric_sim' or a key of PEERS
    order: int  # error goes down with this power of the step

    @abstractmethod
    def motion(self) -> Motion:
        """Where all bodies are now."""

    def close(self) -> None:
        """Give back what the tool holds."""
        return


class StepSolver(Solver):
    """Takes steps of a given length."""

    evaluations: int  # of all forces, for each step
    longest: float  # step [s] worth trying first

    @abstractmethod
    def start(self, step: float) -> None:
        """Go to the initial state, ready for steps of length `step` [s]; not timed."""

    @abstractmethod
    def advance(self, count: int) -> None:
        """Take `count` steps; timed."""


class ToleranceSolver(Solver):
    """Chooses its steps for a tolerance."""

    roughest = 0.1  # tolerance worth trying first

    @abstractmethod
    def start(self, tolerance: float, duration: float) -> None:
        """Go to the initial state, ready for a run of `duration` [s]; not timed."""

    @abstractmethod
    def finish(self) -> None:
        """Run to the end; timed."""
