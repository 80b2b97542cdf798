# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""States seen from other frames: turned, mirrored, shifted, carried along."""

from typing import NamedTuple

from icofabric_sim.scene.initial import InitialState
from icofabric_sim.simulation.reports.divergence import distance_between
import numpy as np
from scipy.spatial.transform import Rotation

EPS = 2.0**-52


class Frame(NamedTuple):
    """Where a body is at x it is seen at turn x + shift + boost t; `turn` may be a mirror."""

    turn: np.ndarray = np.eye(3)  # (3, 3) orthogonal
    shift: np.ndarray = np.zeros(3)  # [m]
    boost: np.ndarray = np.zeros(3)  # [m/s]

    def state(self, state, time=0.0):
        """
        Return what is seen of a state, or a snapshot, at a time.

        A mirror makes a body a mirrored one. The shell is its own image in the planes between its
        axes, so it is seen as a shell that is turned: diag(-1, 1, 1) takes it to itself.
        """
        hand = np.sign(np.linalg.det(self.turn))
        own = np.diag([hand, 1.0, 1.0])
        axes = self.turn @ Rotation.from_quat(state.orientation).as_matrix() @ own
        return InitialState(
            state.position @ self.turn.T + self.shift + self.boost * time,
            Rotation.from_matrix(axes).as_quat(),
            state.linear_velocity @ self.turn.T + self.boost,
            hand * state.angular_velocity @ self.turn.T)


def copied(state):
    """The state of a snapshot."""
    return InitialState(
        *(np.array(getattr(state, name)) for name in InitialState._fields))


def displaced(state, distance, seed=5):
    """A state with all centres displaced at random, the farthest by `distance` [m]."""
    shift = np.random.default_rng(seed).standard_normal(state.position.shape)
    shift *= distance / np.linalg.norm(shift, axis=1).max()
    return copied(state)._replace(position=state.position + shift)


def rounding(simulation, growth, *places):
    """
    Bound of how far rounding may move the bodies of a run, over a.

    A unit in the last place of the farthest coordinate in each step, all to one side, each grown
    as small displacements grow.
    """
    farthest = max(np.abs(place).max() for place in places)
    a = simulation.scene.geometry.half_edge
    return EPS * max(farthest / a, 1.0) * simulation.status.step_count * max(growth, 1.0)


def apart(one, other, simulation):
    """Largest distance of centres over a, or angle."""
    return distance_between(one, other, simulation.scene.geometry.half_edge)
