# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Which pairs can touch before long, from where the bodies are."""

from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import circumscribed_radius
from icofabric_sim.kernels.contact.listing import list_pairs
from icofabric_sim.kernels.contact.search import find_reach, refresh, survey
from icofabric_sim.kernels.records import Nearby, State
from icofabric_sim.simulation.contact.setup import ContactSetup
from icofabric_sim.simulation.model.layout import Layout
import numpy as np

# Fabrics of up to so many bodies have long lists; for larger ones these would take much memory.
SMALL = 20_000
# The longest reach, in parts of a: at least, for small fabrics, and for large ones.
_MOST, _MOST_LARGE = 1.0, 0.4
# How far spheres around bodies of a list are apart at most, in parts of the longest reach.
_SKIN = 4.0
_NO_PAIRS = np.zeros((0, 2), np.int32)


class Near(NamedTuple):
    """What can touch before any body has moved by `reach`."""

    reach: float  # [m]
    pairs: np.ndarray  # (p, 2) int32 bodies, the lower number first; -1 - k: plane k


class NeighbourList:
    """
    Bodies whose spheres are close, found again once they have moved far; and axes of each pair.

    What is returned depends on the state alone: an axis kept for a pair is one of those that are
    searched, and only spares the search.
    """

    def __init__(self, setup: ContactSetup, layout: Layout) -> None:
        """Start without any."""
        a, count = setup.half_edge, layout.body_count
        self.is_small = count <= SMALL
        # As woven nothing is closer than setup.gap: no reach beyond half of that is of use.
        self.most = max(_MOST * a, 0.5 * setup.gap) if self.is_small else _MOST_LARGE * a
        self.skin = _SKIN * self.most
        self.nearby = Nearby(
            slots=layout.slot,
            half_edge=a,
            radius=circumscribed_radius(setup.largest),
            free=setup.free,
            planes=setup.planes,
            counts=np.zeros(2, np.int64),
            pairs=np.zeros((2, 0, 2), np.int32),
            codes=np.zeros((2, 0), np.int32),
            gaps=np.zeros(0),
            known=np.zeros(0, np.bool_),
            to_planes=np.zeros((len(setup.planes), count)),
            axes=np.zeros((count, 9)),
            reference=np.zeros((count, 3)),
            velocity=np.zeros(3),
            heads=np.zeros(1 << max(count - 1, 1).bit_length() + 1, np.int32),
            cubes=np.zeros((3, count), np.int64),
            following=np.zeros(count, np.int32),
            half_edges=setup.half_edges,
        )
        self._is_made, self._way = False, 0.0
        self._listed = np.zeros((0, 2), np.int32)

    def survey(self, state: State, frame: np.ndarray) -> float:
        """
        Largest speed of a point of a body [m/s] beside the mean velocity, which goes into `frame`.

        NaN where any of the state is. Notes how far bodies have moved.
        """
        speed, self._way = survey(self.nearby, state)
        frame[:] = self.nearby.velocity
        return float(speed)

    def find(self, state: State, least: float, most: float, *, few_axes: bool = False) -> Near:
        """
        Pairs that can touch before a body of the state surveyed last has moved by `least` [m].

        Where there is none the reach is longer, up to `most`: as long as there is none.
        `few_axes`: more may be listed, in a tenth of the time.
        """
        self._refresh(state.position, most)
        nearby = self.nearby
        if few_axes:
            listed = self._list(state.position, least)
            if len(listed):
                return Near(least, listed)
        reach = max(find_reach(nearby, state.position, least, most), least)
        count, which = (int(number) for number in nearby.counts)
        near = np.flatnonzero(nearby.gaps[:count] < 2.0 * reach)
        plane, body = np.nonzero(nearby.to_planes < reach)
        if not len(near) + len(plane):
            return Near(reach, _NO_PAIRS)
        pairs = np.empty((len(near) + len(plane), 2), np.int32)
        pairs[:len(near)] = nearby.pairs[which, near]
        order = np.lexsort((plane, body))
        pairs[len(near):, 0], pairs[len(near):, 1] = body[order], -1 - plane[order]
        return Near(reach, pairs)

    def _list(self, position: np.ndarray, least: float) -> np.ndarray:
        """Pairs that few axes do not show to be apart by twice `least` [m]."""
        while (count := int(list_pairs(
                self.nearby, position, least, self._listed)[0])) > len(self._listed):
            self._listed = np.zeros((count + count // 4, 2), np.int32)
        return self._listed[:count].copy()

    def _refresh(self, position: np.ndarray, most: float) -> None:
        """
        Search for close bodies again where others may have come close.

        Bodies that are in no pair were 2 R + skin apart, and are still 2 R + 2 most where none
        has moved by more than skin / 2 - most.
        """
        if self._is_made and 2.0 * (self._way + most) <= self.skin:
            return
        self.make_room(position)

    def make_room(self, position: np.ndarray) -> None:
        """Find close bodies anew, with room for all of them."""
        self._is_made = True
        while (found := refresh(
                self.nearby, position, self.skin)) > (room := len(self.nearby.gaps)):
            self._extend(found + found // 4 if self.is_small else found, room)

    def _extend(self, room: int, before: int) -> None:
        """Room for more pairs; those of `before` stay."""
        nearby = self.nearby
        pairs, codes = np.zeros((2, room, 2), np.int32), np.zeros((2, room), np.int32)
        pairs[:, :before], codes[:, :before] = nearby.pairs, nearby.codes
        self.nearby = nearby._replace(
            pairs=pairs, codes=codes, gaps=np.zeros(room), known=np.zeros(room, np.bool_))
