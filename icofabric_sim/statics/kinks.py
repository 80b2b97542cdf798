# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Amplitude of a motion at which the first connector crosses its natural length."""

from icofabric_sim.statics.fabric import Configuration
from icofabric_sim.statics.wrapped import length_gradients
import numpy as np

# A change of length below this ratio to the motion is round-off.
_ROUNDING = 1e-9


def length_changes(here: Configuration, motions: np.ndarray) -> np.ndarray:
    """Return first-order changes of the connectors' lengths (m, c) by motions (m, n, 6)."""
    motions = np.asarray(motions)
    if not here.snapshot.connector_count:
        return np.zeros((len(motions), 0))
    bodies = here.fabric.scene.connectors.bodies
    changes = np.zeros((len(motions), len(bodies)))
    for of, wrench in zip(bodies.T, end_wrenches(here, slice(None))):
        # One motion at a time; all at once would double the memory of the shapes.
        for row, motion in zip(changes, motions):
            row += np.einsum('ci,ci->c', motion[of], wrench)
    return changes


def end_wrenches(here: Configuration, chosen: np.ndarray | slice) -> np.ndarray:
    """Return derivatives of the `chosen` connectors' lengths by motions of bodies, (2, c, 6)."""
    bodies = here.fabric.scene.connectors.bodies[chosen]
    return length_gradients(here.free_ends[chosen], here.position[bodies])


def anchor_changes(here: Configuration, motions: np.ndarray) -> np.ndarray:
    """Return first-order changes of the anchors' lengths (m, a) by motions (m, n, 6)."""
    columns = [
        -(motions[:, body, :3] @ along + motions[:, body, 3:] @ np.cross(arm, along))
        for body, arm, along in here.fabric.anchors.directions(here.position, here.axes)]
    return np.array(columns).reshape(-1, len(motions)).T


def amplitudes_to_kink(here: Configuration, motions: np.ndarray) -> np.ndarray:
    """
    Return the factors (m,) of motions (m, n, 6) at which the first connector changes side.

    To first order, in either direction. 0 if a connector at its kink changes its length; infinity
    if no connector with two stiffnesses changes its length.
    """
    counted = here.fabric.counted & here.fabric.laws.kinked
    size = np.abs(motions[..., :3]).max(axis=(1, 2), initial=0.0) + (
        here.fabric.half_edge * np.abs(motions[..., 3:]).max(axis=(1, 2), initial=0.0))
    found = np.full(len(motions), np.inf)
    anchors = here.anchor_state
    groups = [(here.stretched, counted, length_changes)]
    groups.append((anchors.here, anchors.jump != 0.0, anchor_changes))
    for state, chosen, changes_of in groups:
        if not chosen.any():
            continue
        change = np.abs(changes_of(here, motions)[:, chosen])
        change[change <= _ROUNDING * size[:, None]] = 0.0
        stretch = np.where(state.at_kink, 0.0, np.abs(state.stretch))[chosen]
        with np.errstate(divide='ignore', invalid='ignore'):
            factor = np.where(change > 0.0, stretch / change, np.inf)
        found = np.minimum(found, factor.min(axis=1, initial=np.inf))
    return found
