# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Packing of the Maxwell arms of connectors and of the rest lengths of their springs."""

from icofabric_sim.kernels.obstruction import find_obstructed
from icofabric_sim.kernels.outlines import fill_lengths
from icofabric_sim.kernels.records import Links, Model
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.scene.scene import SceneConnectors
from icofabric_sim.simulation.model.damping import at_links
from icofabric_sim.simulation.model.layout import Layout
from icofabric_sim.terms.maxwell.record import Maxwell
from icofabric_sim.terms.shared import Connectors
from icofabric_sim.terms.wrapping.lengths import measure_wrapped
import numpy as np


def pack_arms(
    connectors: SceneConnectors, layout: Layout, links: Links
) -> Maxwell | None:
    """Return the arms of connectors for kernels; None without any."""
    arms = connectors.arms
    if arms is None:
        return None
    stiffness, rate = arms.stiffness, arms.rate
    most = float(stiffness.max()), float(rate.max())
    if len(stiffness) == len(rate) == 1:
        return Maxwell(*most, None, None)
    return Maxwell(*most, *(
        at_links(np.broadcast_to(values, len(connectors)), layout, links, connectors)
        for values in (stiffness, rate)))


def lengths_of(connectors: Connectors, model: Model, state: InitialState) -> np.ndarray:
    """
    Return the lengths [m] of the connectors, (c,), along the geodesic if wrapped over a shell.
    """
    length = np.empty(len(connectors.first))
    # Read-only, the type for which the kernel is compiled.
    rows = [np.ascontiguousarray(values).view() for values in (state.position, state.orientation)]
    for values in rows:
        values.flags.writeable = False
    fill_lengths(connectors, *rows, length)
    if model.wrapping is not None:
        found, lost = np.zeros((2, len(length)), np.uint8)
        find_obstructed(connectors, model.shells, *rows, found)
        columns = [np.ascontiguousarray(values.T) for values in rows]
        measure_wrapped(model.wrapping, connectors, *columns, found, length, lost)
    return length


def carried_lengths(
    before: Connectors, rest: np.ndarray, held: np.ndarray, after: Connectors, length: np.ndarray
) -> np.ndarray:
    """
    Return rest lengths [m] of the arms of `after` that join the same edges as `before`.

    `rest` (c,) are the rest lengths before the change, of connectors with an arm where `held`
    (c,). The springs of all other connectors are relaxed at their present `length`.
    """
    keys = [np.column_stack([
        connectors.first, connectors.second, connectors.first_edge, connectors.second_edge])
        for connectors in (before, after)]
    if np.array_equal(keys[0], keys[1]):
        return np.where(held, rest, length)
    known = {tuple(key): own for key, own in zip(keys[0][held].tolist(), rest[held])}
    return np.array([
        known.get(tuple(key), own) for key, own in zip(keys[1].tolist(), length.tolist())])
