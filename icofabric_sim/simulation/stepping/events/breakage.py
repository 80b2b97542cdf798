# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Breakage of connectors that reach a limit of their length.

Kernels report steps in which a connector may have done so.
"""

from typing import Any

from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.breakage import doubt_of
from icofabric_sim.kernels.integrators import embedded
from icofabric_sim.kernels.records import Breakage as Limits
from icofabric_sim.kernels.records import State
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.model.link_places import link_places
from icofabric_sim.simulation.stepping.broken import connector_numbers
from icofabric_sim.simulation.stepping.event_location import first_limit
from icofabric_sim.simulation.stepping.pieces import Pieces
from icofabric_sim.simulation.stepping.step_in_progress import StepInProgress
from icofabric_sim.terms.shared import Connectors
from icofabric_sim.terms.wrapping.rates import measure_runs
import numpy as np


def why(scene: Scene) -> str:
    """Return why a scene needs steps that end where a connector breaks; empty if it does not."""
    if scene.connectors.limits is None:
        return ''
    return 'connectors that break need steps that end where one does'


def make(pieces: Pieces, step: StepInProgress) -> 'Breakage | None':
    """Return the locator; None if no connector can break."""
    return None if pieces.trajectory.packed.breakage is None else Breakage(pieces, step)


class Breakage:
    """Locator of the first connectors to break in the step in progress, which break at its end."""

    status = embedded.BREAKING

    def __init__(self, pieces: Pieces, step: StepInProgress) -> None:
        """Search the `step` in progress."""
        self._trajectory, self._step = pieces.trajectory, step
        self.is_due = False
        # Numbers of the connectors that were found.
        self._found = np.zeros(0, np.int64)
        packed = self._trajectory.packed
        assert packed.model.links is not None
        # Connector by its place in the rows of the limits.
        self._place = places = link_places(
            packed.layout, packed.model.links, self._connectors, packed.woven)
        self._numbers = np.zeros(self._limits.excess.shape, np.int32)
        self._numbers[places.link, places.slot] = np.arange(
            places.link.shape[1], dtype=np.int32)

    @property
    def _limits(self) -> Limits:
        limits = self._trajectory.work.breakage
        assert limits is not None
        return limits

    @property
    def _connectors(self) -> Connectors:
        connectors = self._trajectory.packed.connectors
        assert connectors is not None
        return connectors

    def find(self) -> float | None:
        """
        Return the fraction of the step in progress at which connectors first break, if any.

        All connectors that have reached their limit, or nearly, are included: see `TOGETHER`.
        """
        limits = self._limits
        link, slot = np.nonzero(limits.excess > 0.0)
        seen = np.unique(self._numbers[link, slot])
        link, slot = self._place.link[0, seen], self._place.slot[0, seen]
        step = self._step
        found = first_limit(
            lambda part: self._lengths(step.within(part), seen), limits.longest[link, slot],
            limits.shortest[link, slot], step.length, doubt_of(self._trajectory.model.wrapping))
        if found is None:
            return None
        part, reached = found
        self._found = seen[reached]
        return part

    def happen(self) -> None:
        """Break the located connectors; their energy is lost."""
        trajectory = self._trajectory
        before = self._stored_energy()
        trajectory.broken.add(self._found, self._step.end)
        trajectory.ledger.lost += before - self._stored_energy()

    def state_tree(self) -> dict[str, Any]:
        """Return the connectors that break at the end of the step in progress, as an entry."""
        return {'due': self._found.astype(float)} if self.is_due else {}

    def load_state(self, tree: StateTree) -> None:
        """Restore the connectors to break from a checkpoint."""
        self.is_due = 'due' in tree
        if self.is_due:
            self._found = connector_numbers(tree.array('due'), self._trajectory.packed)

    def _stored_energy(self) -> float:
        """Return the energy [J] in the connectors of the present state."""
        trajectory = self._trajectory
        numbers, model = trajectory.ledger.numbers.copy(), trajectory.model
        trajectory.place_points()
        monitor.examine(
            model, trajectory.loads, trajectory.state, trajectory.work, self._step.end, numbers)
        return float(numbers[monitor.STORED])

    def _lengths(self, state: State, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return lengths [m] of some connectors in a state, and their rates [m/s]."""
        model, work, connectors = self._trajectory.model, self._trajectory.work, self._connectors
        if model.wrapping is not None:
            length, rate = np.zeros((2, len(chosen)))
            measure_runs(
                model.wrapping, state, *self._place.slot[:, chosen],
                connectors.first_edge[chosen], connectors.second_edge[chosen],
                np.ones(len(chosen), np.uint8), length, rate)
            return length, rate
        self._trajectory.place_points(state)
        points = work.points.reshape(6, 3, -1)
        ends = []
        for edges, slot in zip(
                (connectors.first_edge, connectors.second_edge), self._place.slot):
            s = slot[chosen]
            x = points[edges[chosen], :, s].T
            (sx, sy, sz), (ox, oy, oz) = x - state.position[:, s], state.angular_velocity[:, s]
            turning = np.array([oy * sz - oz * sy, oz * sx - ox * sz, ox * sy - oy * sx])
            ends.append((x, state.linear_velocity[:, s] + turning))
        (x0, v0), (x1, v1) = ends
        u, v = x1 - x0, v1 - v0
        length = np.sqrt((u * u).sum(axis=0))
        return length, (u * v).sum(axis=0) / np.maximum(length, 1e-300)
