# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Mechanisms and states of self-stress, counted from the geometry of the connectors alone.

The compatibility matrix A takes motions of the bodies to changes of the connectors' lengths. Its
null space are the motions that stretch nothing, that of its transpose the tensions that need no
load. Of f free freedoms and c connectors (Calladine 1978, Int. J. Solids Struct. 14, 161):
f - c = mechanisms - states of self-stress, because both counts use the one rank of A.
"""

from typing import NamedTuple

from icofabric_sim.statics.fabric import Configuration
import numpy as np

# Singular values below this part of the largest are zero.
_ZERO = 1e-9


class Counts(NamedTuple):
    """
    Freedoms, connectors, and what follows from the rank of the compatibility matrix.
    """

    freedoms: int
    connectors: int
    rank: int

    @property
    def mechanisms(self) -> int:
        """
        Motions that stretch no connector, rigid ones of the whole included.
        """
        return self.freedoms - self.rank

    @property
    def self_stresses(self) -> int:
        """
        Independent tensions that are in equilibrium without loads.
        """
        return self.connectors - self.rank


def compatibility_matrix(here: Configuration) -> np.ndarray:
    """
    Changes of length of connectors and anchors per motion of the free freedoms, dense.

    Scaled by the roots of masses and inertias: (c, f), [1/sqrt(kg)]. For connectors that have
    broken, or have no stiffness at this length, there is no row.
    """
    fabric, snapshot = here.fabric, here.snapshot
    scene, ends = fabric.scene, here.snapshot.connector_ends
    bodies = scene.connectors.bodies if len(ends) else np.zeros((0, 2), int)
    slope = fabric.laws.evaluate(snapshot.connector_length)[1]
    chosen = np.flatnonzero((slope != 0.0) & snapshot.intact)
    bodies, ends = bodies[chosen], ends[chosen]
    rows = np.zeros((len(chosen) + fabric.anchors.count, scene.body_count, 6))
    reach = ends[:, 1] - ends[:, 0]
    direction = reach / np.linalg.norm(reach, axis=1, keepdims=True)
    number = np.arange(len(chosen))
    for end, sign in ((0, -1.0), (1, 1.0)):
        arm = ends[:, end] - here.position[bodies[:, end]]
        np.add.at(rows, (number, bodies[:, end]), sign * np.hstack(
            [direction, np.cross(arm, direction)]))
    for row, (body, arm, direction) in enumerate(fabric.anchors.directions(
            here.position, here.axes)):
        rows[len(chosen) + row, body] = -np.hstack([direction, np.cross(arm, direction)])
    scaled = (rows / fabric.root).reshape(len(rows), 6 * scene.body_count)
    return np.ascontiguousarray(scaled[:, fabric.free.ravel()])


def count_mechanisms(matrix: np.ndarray) -> Counts:
    """
    Rank of a compatibility matrix (c, f) by its singular values.
    """
    if not min(matrix.shape):
        return Counts(matrix.shape[1], matrix.shape[0], 0)
    values = np.linalg.svd(matrix, compute_uv=False)
    return Counts(
        matrix.shape[1], matrix.shape[0],
        int(np.count_nonzero(values > _ZERO * max(float(values[0]), 1e-300))))
