# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Watches for shells that come so close that they must touch.

Until contact is built this is a warning, once.
"""

import logging
from typing import Any, NamedTuple

from icofabric_sim.layout import Layout
from icofabric_sim.memory import as_number, Memory
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')
# Bodies of which all pairs are looked at.
_FEW = 200


class Proximity(NamedTuple):
    """
    Two centres closer than twice the inscribed radius.
    """

    time: float  # [s]
    first: int
    second: int
    distance: float  # between the centres [m]
    limit: float  # twice the inscribed radius [m]

    def __str__(self) -> str:
        """
        Sentence for logs, summaries and bags.
        """
        return (
            f'bodies {self.first} and {self.second} came within {self.distance:.6g} m '
            f'at t = {self.time:.6g} s, closer than twice the inscribed radius '
            f'({self.limit:.6g} m): their shells overlap, and contact is '
            'not computed in this version'
        )


def closest_pair(position: np.ndarray) -> tuple[float, tuple[int, int]]:
    """
    Smallest distance [m] between two of the points (n, 3), and which two.
    """
    count = len(position)
    if count <= _FEW:
        shift = position[:, None] - position
        square = np.einsum('ijk,ijk->ij', shift, shift)
        square[np.arange(count), np.arange(count)] = np.inf
        body, nearest = divmod(int(np.argmin(square)), count)
        return float(np.sqrt(square[body, nearest])), (body, nearest)
    # Takes a quarter of a second to import, which the start of a small scene would feel.
    from scipy.spatial import cKDTree

    distance, neighbour = cKDTree(position).query(position, k=2)
    # The nearest point of a body is itself, unless centres coincide.
    body = int(np.argmin(distance[:, 1]))
    nearest = int(neighbour[body, 1] if neighbour[body, 0] == body else neighbour[body, 0])
    return float(distance[body, 1]), (min(body, nearest), max(body, nearest))


class ProximityWatch:
    """
    Looks for the closest pair only when bodies have moved far enough to matter.

    With a smallest distance d at the reference positions, no pair can come closer than the limit
    r before some body has moved by (d - r) / 2. The reach is half of that, so that motion between
    two looks at it has room.
    """

    def __init__(self, limit: float, layout: Layout) -> None:
        """
        Watch for centres closer than `limit` [m].
        """
        self.limit = limit
        self.reach = 0.0
        self.reference = np.zeros((3, layout.slot_count))
        self._layout = layout
        self.found: Proximity | None = None
        self._announced = False

    def look(self, time: float, position: np.ndarray) -> None:
        """
        Find the closest pair of `position` (3, s) at `time`, until one is too close.
        """
        np.copyto(self.reference, position)
        if self.found is not None or self._layout.body_count < 2:
            self.reach = np.inf
            return
        smallest, pair = closest_pair(self._layout.gather(position))
        if smallest < self.limit:
            self.found = Proximity(time, pair[0], pair[1], smallest, self.limit)
            self.reach = np.inf
            return
        self.reach = 0.25 * (smallest - self.limit)

    def forget(self) -> None:
        """
        Look as if nothing had come close yet.
        """
        self.found, self._announced = None, False

    def announce(self) -> None:
        """
        Warn of what was found, once.
        """
        if self.found is not None and not self._announced:
            self._announced = True
            _LOGGER.warning('%s', self.found)

    def rebase(self, time: float) -> None:
        """
        Begin at another `time` [s]: nothing has moved yet.
        """
        if self.found is not None:
            self.found = self.found._replace(time=time)

    def memory(self) -> dict[str, Any]:
        """
        Where bodies were looked at, and what was found and said.
        """
        memory: dict[str, Any] = {'reach': self.reach, 'announced': self._announced}
        if self.found is not None:
            memory['found'] = [*self.found]
        if self.reach < np.inf:
            memory['reference'] = self._layout.gather(self.reference)
        return memory

    def recall(self, memory: Memory) -> None:
        """
        Go on from there.
        """
        self.reach = memory.number('reach', 0.0, finite=False)
        self._announced = memory.flag('announced')
        self.found = self._judged(memory.entries('found')) if 'found' in memory else None
        self.reference[:] = 0.0
        if self.reach < np.inf:
            self.reference[:, self._layout.slot] = memory.array(
                'reference', (self._layout.body_count, 3)).T

    def _judged(self, entry: list[Any]) -> Proximity:
        """
        What was found, from a list of numbers.
        """
        if len(entry) == 5:
            time, first, second, distance, _ = entry
            bodies = range(self._layout.body_count)
            pair = all(type(body) is int and body in bodies for body in (first, second))
            if pair and None not in (as_number(time), as_number(distance)):
                return Proximity(float(time), first, second, float(distance), self.limit)
        raise ValueError('watch.found is no time, pair of bodies and distance')

    def take_over(self, found: Proximity | None) -> None:
        """
        Go on where another watch of the same motion stands, which has warned already.
        """
        if found is not None:
            self.found, self._announced = found, True
