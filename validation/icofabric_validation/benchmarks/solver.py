# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Interface of the contestants, with that of the package."""

from abc import ABC, abstractmethod

from icofabric_validation.benchmarks.scenes import Motion


class Unusable(Exception):
    """The contestant refuses a setting, or its motion diverges."""


class Solver(ABC):
    """One method of one tool on one scene, from the initial state, with one thread."""

    label: str  # as printed
    tool: str  # 'icofabric_sim' or a key of PEERS
    order: int  # power of the step in the error

    @abstractmethod
    def motion(self) -> Motion:
        """Return positions and axes of all bodies."""

    def close(self) -> None:
        """Release resources of the tool."""
        return


class StepSolver(Solver):
    """A solver with steps of a given length."""

    evaluations: int  # of all forces per step
    longest: float  # first step to try [s]

    @abstractmethod
    def start(self, step: float) -> None:
        """Restore the initial state for steps of length `step` [s]; not timed."""

    @abstractmethod
    def advance(self, count: int) -> None:
        """Advance by `count` steps; timed."""


class ToleranceSolver(Solver):
    """A solver that chooses steps for a tolerance."""

    roughest = 0.1  # first tolerance to try

    @abstractmethod
    def start(self, tolerance: float, duration: float) -> None:
        """Restore the initial state for a run of `duration` [s]; not timed."""

    @abstractmethod
    def finish(self) -> None:
        """Run to the end; timed."""
