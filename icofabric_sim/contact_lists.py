# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Which pairs can touch before long, from where the bodies are.
"""

from typing import NamedTuple

from icofabric_sim.contact_setup import ContactSetup
from icofabric_sim.icosahedron import circumscribed_radius
from icofabric_sim.kernels.contact_search import (
    find_close,
    find_reach,
    keep_codes,
    sort_cubes,
    survey,
)
from icofabric_sim.kernels.records import State
from icofabric_sim.layout import Layout
import numpy as np

# Spheres around bodies of a list are less than this apart, in parts of a.
SKIN = 1.6
_NO_PAIRS = np.zeros((0, 2), np.int32)


class Near(NamedTuple):
    """
    What can touch before any body has moved by `reach`.
    """

    reach: float  # [m]
    pairs: np.ndarray  # (p, 2) int32 bodies, the lower number first; -1 - k: plane k


class ContactLists:
    """
    Bodies whose spheres are close, found anew once they have moved far; and the axes of each pair.

    What is returned depends on the state alone: an axis kept for a pair is one of those that are
    searched, and only spares the search.
    """

    def __init__(self, setup: ContactSetup, layout: Layout) -> None:
        """
        Start without any.
        """
        self._setup, self._layout = setup, layout
        self._radius = circumscribed_radius(setup.half_edge)
        self._pairs, self._codes = np.zeros((0, 2), np.int32), np.zeros(0, np.int32)
        self._reference: np.ndarray | None = None
        self._way = 0.0

    def survey(self, state: State, frame: np.ndarray) -> float:
        """
        Largest speed of a point of a body [m/s] beside the mean velocity, which goes into `frame`.

        Not a number where any of the state is none. Notes how far bodies have moved.
        """
        reference = state.position if self._reference is None else self._reference
        speed, self._way = survey(
            *state, self._layout.slot, self._radius, self._setup.free, reference, frame)
        return float(speed)

    def find(self, state: State, least: float, most: float) -> Near:
        """
        Pairs that can touch before a body of a state surveyed has moved by `least` [m].

        Where there is none the reach is longer, up to `most`: as long as there is none.
        """
        setup, slots = self._setup, self._layout.slot
        self._refresh(state.position, most)
        gaps = np.empty(len(self._pairs))
        to_planes = np.empty((len(setup.planes), len(slots)))
        reach = find_reach(
            state.position, state.orientation, slots, setup.half_edge, self._radius, least, most,
            self._pairs, self._codes, gaps, setup.planes, to_planes)
        near = np.flatnonzero(gaps < 2.0 * reach)
        plane, body = np.nonzero(to_planes < reach)
        if not len(near) + len(plane):
            return Near(reach, _NO_PAIRS)
        pairs = np.empty((len(near) + len(plane), 2), np.int32)
        pairs[:len(near)] = self._pairs[near]
        order = np.lexsort((plane, body))
        pairs[len(near):, 0], pairs[len(near):, 1] = body[order], -1 - plane[order]
        return Near(reach, pairs)

    def _refresh(self, position: np.ndarray, most: float) -> None:
        """
        Look for close bodies again where others may have come close.

        Bodies that are in no pair were 2 R + SKIN apart, and are still 2 R + 2 most where none
        has moved by more than SKIN / 2 - most.
        """
        slots, skin = self._layout.slot, SKIN * self._setup.half_edge
        if self._reference is not None and 2.0 * (self._way + most) <= skin:
            return
        self._reference = position.copy()
        width = 2.0 * self._radius + skin
        count = len(slots)
        heads = np.empty(1 << max(count - 1, 1).bit_length() + 1, np.int32)
        cubes, following = np.empty((3, count), np.int64), np.empty(count, np.int32)
        sort_cubes(position, slots, width, cubes, heads, following)
        pairs = np.empty((8 * count, 2), np.int32)
        while (found := find_close(
                position, slots, width, cubes, heads, following, pairs)) > len(pairs):
            pairs = np.empty((found, 2), np.int32)
        pairs, codes = pairs[:found].copy(), np.empty(found, np.int32)
        keep_codes(self._pairs, self._codes, pairs, codes)
        self._pairs, self._codes = pairs, codes
