# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Executors: where the state of a run is between two calls, and what computes with all of it.

An `Executor` stands for this process: its arrays have the state, and its threads take the steps.
Ranks and a GPU (simulation/devices) are executors that hold the state themselves. Queries about
all bodies are answered by `Threads` or by ranks; the results are bit-identical.
"""

from icofabric_sim.kernels.records import Loads, Model, State, Work
from icofabric_sim.simulation.model.stability import Frequency
from icofabric_sim.terms.contacts.record import Watch
import numpy as np


class Executor:
    """Verbs of all executors; the defaults are those of this process."""

    is_remote = False  # True if ranks or a device have the state between two calls
    tries_steps = False  # True if it takes trial steps; False: the state is gathered for them
    rank_count = 1  # processes that share the steps
    halo_bytes = 0  # largest number of bytes that a process receives per force evaluation
    device = ''  # name of the device that computes the steps; empty for processes
    device_bytes = 0  # approximate memory of the run on the device, without its loads

    @property
    def has_saved(self) -> bool:
        """True if the state that was saved last is not in this process."""
        return False

    def gather(self) -> bool:
        """
        Gather the whole state in the arrays of this process, which may change it.

        Returns whether it was elsewhere until then.
        """
        return False

    def gather_saved(self) -> dict[str, np.ndarray]:
        """
        Gather the saved state, and the work that loads had done.

        Returns what had flowed by then [J], by name: `work` of the loads, and what meters showed.
        """
        return {}

    def save_run(self, saved: State) -> bool:
        """Save the state of the run if it is stored only there; return True if saved."""
        return False

    def put_begun(self, saved: State) -> bool:
        """Write the start of the run to `saved`; return False if a later state was here."""
        return False

    def bounds(self) -> np.ndarray | None:
        """
        Return largest and minus least velocities [m/s] and the largest coordinate [m], (7,).

        The result is None if the state is in the arrays of this process.
        """
        return None

    # Queries about all bodies.

    def can_sum(self, model: Model, loads: Loads, work: Work) -> bool:
        """Return True if the queries below need not gather the state."""
        return False

    def hold(
        self, model: Model, loads: Loads, state: State, work: Work, watch: Watch | None
    ) -> None:
        """Distribute the state of a run without contacts, for the queries below."""

    def refresh(self, time: float) -> None:
        """Compute the accelerations of the state at `time` [s]."""

    def fill_figures(self, time: float, numbers: np.ndarray) -> None:
        """Write the figures of a health check at `time` [s] to the `numbers` of a ledger."""

    def squares(self, fall: np.ndarray, sums: np.ndarray) -> None:
        """Write sums (2, g) of squared accelerations, as `note_squares` of group_sums.py."""

    def velocity_sums(self, sums: np.ndarray) -> None:
        """Write sums (3, g) of velocities [m/s], as `note_sums` of group_sums.py."""

    def fastest_square(self, velocity: np.ndarray) -> float:
        """Return the largest squared velocity relative to `velocity` (3,) [m^2/s^2]."""
        raise NotImplementedError

    def largest_frequency(self) -> Frequency | None:
        """Return the largest frequency of the fabric; None if it cannot be computed there."""
        return None

    # Trial steps of the held state, if `tries_steps`.

    def begin_trial(
        self, model: Model, loads: Loads, state: State, work: Work, watch: Watch | None
    ) -> None:
        """Start trial steps at the state of the run."""

    def branch_trial(self, model: Model) -> None:
        """Start trial steps of half the length at the state of the others."""

    def take_trial(self, which: str, origin: float, first: int, step: float, count: int) -> None:
        """Take steps of one of both sequences, `ahead` or `half`."""

    def trial_distance(self) -> tuple[float, float]:
        """
        Return the largest squared distance [m^2] and the largest squared quaternion difference.
        """
        raise NotImplementedError
