# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Packing of the moments of connectors against bending and twisting."""

import math
from typing import NamedTuple

from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.kernels.records import Links, Moments
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.scene.attachments import woven_end_to_end
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.model.layout import aligned_empty, aligned_zeros, Layout
from icofabric_sim.terms.bending.record import Bending
from icofabric_sim.terms.shared import LINK_COUNT
from icofabric_sim.terms.twisting.record import Twisting
import numpy as np


class PackedMoments(NamedTuple):
    """
    Moments for the kernels of motion and for single connectors; None if there are no moments.
    """

    bending: Bending | None
    twisting: Twisting | None
    moments: Moments | None


def pack_moments(scene: Scene, layout: Layout, links: Links | None) -> PackedMoments:
    """Pack bending and twisting stiffnesses and the directions of connectors at woven bodies."""
    connectors = scene.woven
    kappa_b, kappa_t = connectors.bending_stiffness, connectors.twisting_stiffness
    if links is None or not (kappa_b.any() or kappa_t.any()):
        return PackedMoments(None, None, None)
    ends = [_links_of(scene, layout, links, end) for end in range(2)]
    spans = woven_end_to_end(
        scene.weave, scene.parameters['weave.azimuth'], connectors.attachment)
    spans /= np.linalg.norm(spans, axis=1, keepdims=True)
    bending = twisting = woven = each = None
    if scene.weave.kind == 'radial':
        each = scene.orientation
        woven = layout.spread(cosines_from_quaternions(each).reshape(-1, 9))
    moments = Moments(connectors.bodies, kappa_b, kappa_t, spans, each)
    if kappa_b.any():
        direction, directions = np.zeros((LINK_COUNT, 3)), None
        for sign, link in zip((1.0, -1.0), ends):
            # Where all bodies have the same orientation one connector stands for all.
            number, connector = np.unique(link, return_index=True)
            direction[number] = sign * spans[connector]
        if woven is not None:
            directions = np.vstack([
                _rows(scene, layout, ends, (spans[:, k], -spans[:, k])) for k in range(3)])
            directions = aligned_like(directions.reshape(3, LINK_COUNT, -1).transpose(1, 0, 2))
        bending = Bending(
            float(kappa_b.max()), direction, directions,
            _variety(scene, layout, ends, kappa_b), woven)
    if kappa_t.any():
        twisting = Twisting(
            float(kappa_t.max()), _variety(scene, layout, ends, kappa_t), woven)
    return PackedMoments(bending, twisting, moments)


def aligned_like(values: np.ndarray) -> np.ndarray:
    """Return a copy as rows (r, s) that start at a cache line."""
    rows = aligned_empty((math.prod(values.shape[:-1]), values.shape[-1]))
    rows[:] = values.reshape(rows.shape)
    return rows


def _links_of(scene: Scene, layout: Layout, links: Links, end: int) -> np.ndarray:
    """
    Return the link of each connector, (c,), at one end: the link whose place is the other end.
    """
    own, other = scene.woven.bodies[:, end], scene.woven.bodies[:, 1 - end]
    edge = scene.woven.edges.astype(np.int64)
    lane = layout.slot[own] % LANES
    place = 3 * layout.slot_count * edge[:, 1 - end] + layout.slot[other] - lane
    block, link = layout.block_of(own), 2 * edge[:, end]
    here = (links.place[block, link] == place) & (links.present[block, link] >> lane & 1 == 1)
    return np.where(here, link, link + 1)


def _variety(
    scene: Scene, layout: Layout, ends: list[np.ndarray], values: np.ndarray
) -> np.ndarray | None:
    """Return values of the connectors at each body, (12, s); None if all values are equal."""
    return None if len(values) == 1 else _rows(scene, layout, ends, (values, values))


def _rows(
    scene: Scene, layout: Layout, ends: list[np.ndarray], values: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Return values of the connectors seen from either end, (12, s)."""
    rows = aligned_zeros((LINK_COUNT, layout.slot_count))
    for end, link in enumerate(ends):
        rows[link, layout.slot[scene.woven.bodies[:, end]]] = values[end]
    return rows
