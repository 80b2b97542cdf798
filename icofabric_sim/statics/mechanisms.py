# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Mechanisms and states of self-stress, counted from the geometry of the connectors alone.

The compatibility matrix A maps motions of the bodies to changes of the connectors' lengths. Its
null space contains the motions that stretch no connector, that of its transpose the tensions in
equilibrium without loads. For f free degrees of freedom and c connectors (Calladine 1978, Int. J.
Solids Struct. 14, 161): f - c = mechanisms - states of self-stress, because both counts follow
from the rank of A.
"""

from typing import NamedTuple

from icofabric_sim.statics.fabric import Configuration
from icofabric_sim.statics.wrapped import directions_of, length_gradients
import numpy as np
from scipy import sparse

# Singular values below this ratio to the largest are zero; those of woven slabs are 0 or above
# 0.09 (docs/statics.md).
_ZERO_RATIO = 1e-9


class Counts(NamedTuple):
    """Counts of a fabric that follow from the rank of the compatibility matrix."""

    degrees_of_freedom: int
    connectors: int
    rank: int

    @property
    def mechanisms(self) -> int:
        """Number of motions that stretch no connector, including rigid motions of the whole."""
        return self.degrees_of_freedom - self.rank

    @property
    def self_stresses(self) -> int:
        """Number of independent tensions in equilibrium without loads."""
        return self.connectors - self.rank


def sparse_compatibility(here: Configuration) -> sparse.csr_matrix:
    """
    Return changes of length of connectors and anchors by motions of free degrees of freedom.

    (c, f), scaled by the square roots of masses and inertias [1/sqrt(kg)]. Broken connectors and
    connectors without stiffness have no row; a hinge has three, one for each direction.
    """
    fabric = here.fabric
    scene, ends = fabric.scene, here.free_ends
    bodies = scene.connectors.bodies if len(ends) else np.zeros((0, 2), int)
    chosen = rows_of(here)
    bodies, ends = bodies[chosen], ends[chosen]
    direction, hinged = directions_of(ends), here.fabric.laws.natural_length[chosen] == 0.0
    direction[hinged] = np.tile(np.eye(3), (int(hinged.sum()) // 3, 1))
    anchors = fabric.anchors.directions(here.position, here.axes)
    # For each row the numbers of the bodies, and the derivatives of the length by their motions.
    joined = [*bodies.T, np.array([body for body, _, _ in anchors], int)]
    changes = [
        *length_gradients(ends, here.position[bodies], direction),
        np.array([-np.hstack([along, np.cross(arm, along)])
                  for _, arm, along in anchors]).reshape(-1, 6)]
    number = np.arange(len(chosen))
    rows = np.concatenate([number, number, len(chosen) + np.arange(len(anchors))])
    columns = 6 * np.concatenate(joined)[:, None] + np.arange(6)
    matrix = sparse.csr_matrix(
        ((np.concatenate(changes) / np.broadcast_to(
            fabric.root, (scene.body_count, 6))[np.concatenate(joined)]).ravel(),
         (np.repeat(rows, 6), columns.ravel())),
        shape=(len(chosen) + len(anchors), 6 * scene.body_count))
    return matrix[:, np.flatnonzero(fabric.free.ravel())]


def rows_of(here: Configuration) -> np.ndarray:
    """Return the numbers of the connectors in the rows of the compatibility matrix."""
    chosen = np.flatnonzero((here.slope != 0.0) & here.snapshot.intact)
    return np.repeat(chosen, np.where(here.fabric.laws.natural_length[chosen] == 0.0, 3, 1))


def compatibility_matrix(here: Configuration) -> np.ndarray:
    """Return the dense compatibility matrix; see `sparse_compatibility`."""
    return np.ascontiguousarray(sparse_compatibility(here).toarray())


def count_mechanisms(matrix: np.ndarray) -> Counts:
    """Return the counts of a compatibility matrix (c, f), from its singular values."""
    if not min(matrix.shape):
        return Counts(matrix.shape[1], matrix.shape[0], 0)
    values = np.linalg.svd(matrix, compute_uv=False)
    return Counts(
        matrix.shape[1], matrix.shape[0],
        int(np.count_nonzero(values > _ZERO_RATIO * max(float(values[0]), 1e-300))))
