# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Step control that is one kernel for all scenes, called with the records of a scene."""

from typing import Any

from icofabric_sim.kernels.integrators.bodies import bodies_of, calls_of
from icofabric_sim.kernels.integrators.sweep import Splitting
from icofabric_sim.kernels.integrators.tableau import Pair
from icofabric_sim.kernels.records import Loads, Model, State, Team, Work


class SceneKernel:
    """A kernel for all scenes that takes steps by a method, called with the records of a scene."""

    def __init__(self, kernel: Any, method: Pair | Splitting) -> None:
        """Take the kernel, and the constants of the method."""
        self._kernel, self._method = kernel, method

    def __call__(
        self, model: Model, loads: Loads, state: State, saved: State, work: Work, team: Team,
        *arguments: Any
    ) -> tuple[int, int, int]:
        """
        Take steps of the bodies of a scene.

        `arguments` are those of the kernel after the constants, with the positions since the last
        search for contacts before the ledger.
        """
        *others, watch, ledger = arguments
        taken: tuple[int, int, int] = self._kernel(
            bodies_of(model, loads, state, saved, work, team, watch), self._method, *others,
            ledger)
        return taken

    def is_ready(
        self, model: Model, loads: Loads, state: State, saved: State, work: Work, team: Team,
        *arguments: Any
    ) -> bool:
        """Check that no kernel must be compiled for such arguments."""
        *others, watch, ledger = arguments
        calls = [call for call in calls_of(model, loads, state, work, team, watch) if call]
        return all(kernel.is_ready(*values) for kernel, *values in calls) and bool(
            self._kernel.is_ready(
                bodies_of(model, loads, state, saved, work, team, watch, is_called=False),
                self._method, *others, ledger))
