# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Charged bodies that pass each other faster than steps resolve.

Their forces grow with one over the squared distance, without a limit if shells do not keep them
apart. A step whose length follows the connectors does not resolve them.
"""

from typing import NamedTuple

from icofabric_sim.kernels.records import State
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.model.snapshot import Snapshot
import numpy as np


class Meeting(NamedTuple):
    """Two charged bodies that were close to each other between two states."""

    bodies: tuple[int, int]
    distance: float  # of their centres at the nearest [m]
    duration: float  # in which they cross that distance [s]

    def __str__(self) -> str:
        """Return a sentence on the bodies and their distance."""
        first, second = self.bodies
        return (
            f'bodies {first} and {second}, whose charges act on each other (charge.mutual), pass '
            f'each other at about {self.distance:.3g} m within {self.duration:.3g} s')


def meeting_between(
    packed: PackedScene, before: State, after: State, interval: float, step: float
) -> Meeting | None:
    """
    Return the charged bodies with the shortest encounter, less than a `step` [s], if any.

    `before` and `after` are states an `interval` [s] apart. Bodies are assumed to move along
    straight lines from the first state and to the second.
    """
    coulomb = packed.model.coulomb
    if coulomb is None:
        return None
    charged = np.flatnonzero(np.isin(packed.layout.slot, coulomb.slots))
    found: Meeting | None = None
    for state, direction in ((before, 1.0), (after, -1.0)):
        snapshot = Snapshot(0.0, *packed.layout.unpack(state), 0, packed, {}, None)
        place = snapshot.position[charged]
        velocity = direction * snapshot.linear_velocity[charged]
        for one in range(len(charged) - 1):
            apart, rate = place[one + 1:] - place[one], velocity[one + 1:] - velocity[one]
            square = (rate * rate).sum(axis=1)
            with np.errstate(all='ignore'):
                nearest = np.clip(-(apart * rate).sum(axis=1) / square, 0.0, interval)
                distance = np.linalg.norm(apart + nearest[:, None] * rate, axis=1)
                duration = distance / np.sqrt(square)
            duration[~np.isfinite(duration)] = np.inf
            other = int(duration.argmin())
            if duration[other] < (step if found is None else found.duration):
                found = Meeting(
                    (int(charged[one]), int(charged[one + 1 + other])), float(distance[other]),
                    float(duration[other]))
    return found
