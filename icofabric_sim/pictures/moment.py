# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A state that is to be drawn, and what acts at that time."""

from typing import NamedTuple

from icofabric_sim.scene.scene import Scene
import numpy as np


class Push(NamedTuple):
    """A force on a group of bodies, for an arrow."""

    name: str
    point: np.ndarray  # (3,) [m] where it acts, world frame
    force: np.ndarray  # (3,) [N] in all, world frame


class Moment(NamedTuple):
    """A state to be drawn."""

    time: float  # [s]; NaN: of no time
    position: np.ndarray  # (n, 3) [m]
    orientation: np.ndarray  # (n, 4) x y z w
    scene: Scene
    note: str = ''  # for the caption
    broken: np.ndarray | None = None  # numbers of broken connectors
    velocity: np.ndarray | None = None  # (n, 3) [m/s]
    pushes: tuple[Push, ...] = ()
    anchor_points: np.ndarray | None = None  # (a, 3) [m] of the world; None: those at time 0
    torn_anchors: np.ndarray | None = None  # numbers of broken anchors
    # (k, 2, 3) points [m] and forces [N] that contacts exert on shells
    contact_forces: np.ndarray | None = None
    known: np.ndarray | None = None  # (n,) bool: whose pose it is; others are as woven; None: all
