# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Queries about the whole state of a run on ranks; see whole_state.py."""

from icofabric_sim.kernels.records import Loads, Model, State, Watch, Work
from icofabric_sim.simulation.devices.leader import SharedSteps
from icofabric_sim.simulation.devices.shared_iteration import SharedIteration
from icofabric_sim.simulation.model.stability import (
    converge,
    Frequency,
    has_bounded_terms,
    is_springy,
    most_steps,
)
import numpy as np


class SharedState:
    """Queries about the state on ranks; created on the first rank."""

    def __init__(self, steps: SharedSteps) -> None:
        """Query the ranks that take the `steps`."""
        self._steps, self._sharing = steps, steps.holder
        self._is_ready = False  # what iterations need

    def save(self, saved: State) -> bool:
        """Save the state of the run on the ranks; return False if it is here."""
        if not self._steps.is_apart:
            return False
        with self._steps.together():
            return self._steps.save_run(saved)

    def put_begun(self, saved: State) -> bool:
        """Write the start of the run to `saved`; return False if a later state was here."""
        begun = self._sharing.begun
        if begun is None:
            return False
        begun.put(room=saved)
        return True

    def bounds(self) -> np.ndarray | None:
        """
        Return largest and minus least velocities [m/s] and the largest coordinate [m], (7,).

        The result is None if the state is in the arrays of this process.
        """
        if self._steps.unpacked is not None:
            return self._steps.unpacked.bounds()
        if not self._steps.is_apart:
            return None
        with self._steps.together():
            self._sharing.order('bounds')
            return self._sharing.largest_of(self._steps.own_bounds())

    def hold(
        self, model: Model, loads: Loads, state: State, work: Work, watch: Watch | None
    ) -> None:
        """Distribute the state of a run without contacts."""
        with self._steps.together():
            self._steps.hold(model, loads, state, work, watch)

    def refresh(self, time: float) -> None:
        """Compute the accelerations of the state at `time` [s]."""
        with self._steps.together():
            self._steps.refresh(time)

    def examine(self, time: float, ledger: np.ndarray) -> None:
        """Write the figures of a health check at `time` [s] to `ledger`."""
        with self._steps.together():
            self._steps.fill_figures(time, ledger)

    def squares(self, fall: np.ndarray, sums: np.ndarray) -> None:
        """Write sums (2, g) of squared accelerations, as `note_squares` of group_sums.py."""
        own, run = self._steps.held
        with self._steps.together():
            self._sharing.order('squares', fall)
            self._sharing.gather_sums(own.squares(run.work, fall), sums)

    def velocity_sums(self, sums: np.ndarray) -> None:
        """Write sums (3, g) of velocities [m/s], as `note_sums` of group_sums.py."""
        own, run = self._steps.held
        with self._steps.together():
            self._sharing.order('velocity_sums')
            self._sharing.gather_sums(own.velocity_sums(run), sums)

    def fastest_square(self, velocity: np.ndarray) -> float:
        """Return the largest squared velocity relative to `velocity` (3,) [m^2/s^2]."""
        with self._steps.together():
            self._sharing.order('fastest_square', velocity)
            return float(self._sharing.largest_of(self._steps.own_fastest_square(velocity))[0])

    def largest(self) -> Frequency | None:
        """
        Return the largest frequency of the fabric, as `largest_frequency` of model/stability.py.

        The result is None if a term requires sums in a single process.
        """
        packed = self._sharing.packed
        model, count = packed.model, packed.layout.body_count
        if has_bounded_terms(model):
            return None
        if not is_springy(model):
            return Frequency(0.0, (), 0)
        own, arrays = self._steps.held
        if not self._is_ready:
            # By then all ranks find it.
            own.make_iteration_ready(arrays)
            self._is_ready = True
        with self._steps.together():
            run = SharedIteration(self._sharing, own, arrays, most_steps(count))
            try:
                if run.is_held:
                    return Frequency(0.0, (), 0)
                if not np.isfinite(run.bound):
                    # Numbers too large to multiply: nothing is safe.
                    return Frequency(np.inf, (), 0)
                found = converge(run, run.bound, count)
                return Frequency(
                    float(np.sqrt(max(found.value, 0.0))), (), run.matrix.done)
            finally:
                run.end()
