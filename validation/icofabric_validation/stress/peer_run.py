# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A run of a scene in another program: its steps, and the interface of the judge."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from typing import ClassVar

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.errors import Interrupted
from icofabric_validation.stress.peer_loads import PeerLoads
from icofabric_validation.stress.peer_state import State, Steps
import numpy as np


class PeerRun(ABC):
    """A run with fixed steps, from the start of a scene."""

    # Largest number of steps between two checks of the state.
    check_period_steps: ClassVar[int]

    def __init__(self, scene: Scene, step: float, rate: float) -> None:
        """Prepare steps of `step` [s]; the unit of time is 1 / `rate` of the fastest motion."""
        self.scene = scene
        self.should_stop: Callable[[], bool] | None = None
        self.step, self.step_count = step, 0
        self._length, self._rate = scene.geometry.half_edge, rate
        self._loads = PeerLoads(scene)
        self._steps = Steps(step, self._loads.ends)
        self._intact = np.ones(scene.connector_count, dtype=bool)

    @property
    def time(self) -> float:
        """Time [s] of the current state."""
        return self._steps.time(self.step_count)

    def advance_to(self, time: float) -> None:
        """Advance by whole steps until the first step that ends at or after `time` [s]."""
        while self.time < time:
            self.advance_steps(
                self._steps.count_until(self.step_count, time, self.check_period_steps))

    def advance_steps(self, count: int) -> None:
        """Advance by `count` steps; raise SimulationError or Interrupted."""
        if self.should_stop is not None and self.should_stop():
            raise Interrupted
        self._advance(self.step_count + count)

    def _advance(self, end: int) -> None:
        """Advance to the number `end` of steps, and check the state."""
        while self.step_count < end:
            self._advance_equal(self._steps.count_equal(self.step_count, end - self.step_count))

    @abstractmethod
    def _advance_equal(self, count: int) -> None:
        """Advance by equal steps in one interval, in which no load jumps."""

    @abstractmethod
    def snapshot(self) -> State:
        """Return the current state."""

    @abstractmethod
    def saved(self) -> np.ndarray:
        """Return the state of the program, for comparison bit by bit."""


def number_words(values: Iterable[float]) -> str:
    """Return numbers as words that keep every bit."""
    return ' '.join(repr(float(value)) for value in values)
