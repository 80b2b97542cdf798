# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Neighbour list: pairs of bodies that can touch soon, from the positions of the bodies."""

from dataclasses import dataclass
from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import circumscribed_radius
from icofabric_sim.kernels.records import State
from icofabric_sim.simulation.contact.setup import ContactSetup
from icofabric_sim.simulation.model.layout import Layout
from icofabric_sim.terms.contacts.listing import list_pairs
from icofabric_sim.terms.contacts.record import Nearby
from icofabric_sim.terms.contacts.search import find_reach, refresh, survey
import numpy as np


def carriers_of(setup: ContactSetup, layout: Layout) -> np.ndarray | None:
    """Return the slots of the carriers of planes, -1 for planes at rest; None if all rest."""
    if not setup.moving:
        return None
    slots = np.full(len(setup.moving), -1, np.int32)
    slots[np.flatnonzero(setup.moving)] = layout.carriers
    return slots


_NO_PAIRS = np.zeros((0, 2), np.int32)


@dataclass(frozen=True)
class ListSettings:
    """Tunables of the neighbour list."""

    # Most bodies of a small fabric, which has a long list; long lists of larger fabrics would need
    # much memory.
    small_body_count: int = 20_000
    max_reach_ratio: float = 1.0  # longest reach over a of small fabrics, at least
    large_max_reach_ratio: float = 0.4  # longest reach over a of large fabrics
    skin_ratio: float = 4.0  # largest gap of listed bounding spheres over the longest reach


_SETTINGS = ListSettings()


class Near(NamedTuple):
    """Candidate pairs until any body has moved by `reach`."""

    reach: float  # [m]
    pairs: np.ndarray  # (p, 2) int32 bodies, the lower number first; -1 - k: plane k


class NeighbourList:
    """
    Pairs of bodies with close bounding spheres, updated after long displacements, and their axes.

    The result depends on the state alone: a cached separating axis of a pair is one of the axes of
    the search and only saves time.
    """

    def __init__(self, setup: ContactSetup, layout: Layout) -> None:
        """Start with an empty list."""
        a, count = setup.half_edge, layout.body_count
        self.is_small = count <= _SETTINGS.small_body_count
        # As woven, gaps are at least setup.gap: small fabrics use a reach of half this gap.
        self.most = max(_SETTINGS.max_reach_ratio * a, 0.5 * setup.gap) if (
            self.is_small) else _SETTINGS.large_max_reach_ratio * a
        self.skin = _SETTINGS.skin_ratio * self.most
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
            carriers=carriers_of(setup, layout),
        )
        self._is_made, self._way = False, 0.0
        self._listed = np.zeros((0, 2), np.int32)

    def survey(self, state: State, frame: np.ndarray) -> float:
        """
        Return the largest speed [m/s] of a point of a body relative to the mean velocity.

        The mean velocity is written to `frame`. The result is NaN if any value of the state is.
        The displacements of bodies are recorded.
        """
        speed, self._way = survey(self.nearby, state)
        frame[:] = self.nearby.velocity
        return float(speed)

    def find(self, state: State, least: float, most: float, *, few_axes: bool = False) -> Near:
        """
        Return pairs that can touch before a body of the surveyed state has moved by `least` [m].

        Without such a pair, the reach extends up to `most`, as far as no pair can touch.
        `few_axes` allows additional pairs, in a tenth of the time.
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
        """Return pairs that a few axes do not separate by twice `least` [m]."""
        while (count := int(list_pairs(
                self.nearby, position, least, self._listed)[0])) > len(self._listed):
            self._listed = np.zeros((count + count // 4, 2), np.int32)
        return self._listed[:count].copy()

    def _refresh(self, position: np.ndarray, most: float) -> None:
        """
        Search again for close bodies if further bodies may have come close.

        Bodies without a pair were 2 R + skin apart. They remain 2 R + 2 most apart while no body
        has moved by more than skin / 2 - most.
        """
        if self._is_made and 2.0 * (self._way + most) <= self.skin:
            return
        self.make_room(position)

    def make_room(self, position: np.ndarray) -> None:
        """Search for close bodies, and enlarge the list for all of them."""
        self._is_made = True
        while (found := refresh(
                self.nearby, position, self.skin)) > (room := len(self.nearby.gaps)):
            self._extend(found + found // 4 if self.is_small else found, room)

    def _extend(self, room: int, before: int) -> None:
        """Enlarge the list to `room` pairs; the first `before` pairs remain."""
        nearby = self.nearby
        pairs, codes = np.zeros((2, room, 2), np.int32), np.zeros((2, room), np.int32)
        pairs[:, :before], codes[:, :before] = nearby.pairs, nearby.codes
        self.nearby = nearby._replace(
            pairs=pairs, codes=codes, gaps=np.zeros(room), known=np.zeros(room, np.bool_))
