# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Locate the mechanisms (zero-energy motions) of a woven fabric.

The null space of the compatibility matrix has a projector P, whose trace is the number of
mechanisms. The trace of a body's block counts how many of its six degrees of freedom take part in
mechanisms, independent of the basis of the null space. Coordinates are scaled by the square roots
of masses and inertias, as for frequencies.
"""

from typing import NamedTuple

from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.scene.scene import require_scene, Scene
from icofabric_sim.statics.fabric import StaticFabric
from icofabric_sim.statics.mechanisms import compatibility_matrix, Counts
from icofabric_sim.statics.one_thread import one_thread
import numpy as np

# Most degrees of freedom of the dense decomposition: 10 s on one core.
_MAX_FREEDOMS = 3_000
# Singular values below this ratio to the largest count as zero (docs/statics.md).
_ZERO_RATIO = 1e-9
# Layers below the faces of a slab that are reported separately.
LAYERS = 4
CORNER, EDGE, FACE, WITHIN = PLACES = ('corner', 'edge', 'face', 'within')


class Floppy(NamedTuple):
    """Mechanism counts, and the share of each body in the mechanisms."""

    counts: Counts
    content: np.ndarray  # (n,) degrees of freedom, 0 to 6; their sum is the number of mechanisms
    rotation_content: np.ndarray  # (n,) the part of `content` in rotations
    place: np.ndarray  # (n,) number in PLACES; -1: the fabric is not an orthogonal slab
    depth: np.ndarray  # (n,) layers below the nearest face

    def by_place(self) -> dict[str, float]:
        """Return the mean content of the bodies by place and by layer; NaN without bodies."""
        found = {name: _mean(self.content[self.place == number])
                 for number, name in enumerate(PLACES)}
        whole = self.place[0] >= 0 if len(self.place) else False
        return found | {
            f'depth.{layer}': _mean(self.content[self.depth == layer]) if whole else np.nan
            for layer in range(LAYERS)}


def require_dense(scene: Scene) -> None:
    """Refuse fabrics that are too large for a dense decomposition or have no connectors."""
    freedoms = 6 * scene.body_count
    if freedoms > _MAX_FREEDOMS:
        raise ParameterError(
            'weave.size', f'weave.size: mechanisms are located for at most {_MAX_FREEDOMS:,} '
            f'degrees of freedom, but {scene.body_count:,} bodies have {freedoms:,}; use a '
            'smaller slab (`modes` counts the mechanisms of larger ones)')
    if not scene.connector_count:
        raise ParameterError(
            'weave.size', 'weave.size: the fabric has no connector, so all motions cost no energy')


@one_thread()
def find_floppy(scene: Scene) -> Floppy:
    """
    Locate the mechanisms of the woven fabric from its connectors and supports.

    Ignores contact, bending and twisting stiffness. Raises ParameterError above 3,000 degrees of
    freedom.
    """
    require_scene(scene)
    require_dense(scene)
    here = StaticFabric(scene, contact=False).start
    matrix = compatibility_matrix(here)
    connectors, freedoms = matrix.shape
    _, values, rows = np.linalg.svd(matrix, full_matrices=False)
    rank = int(np.count_nonzero(values > _ZERO_RATIO * max(float(values[0]), 1e-300)))
    stretched = np.zeros(6 * scene.body_count)
    free = here.fabric.free.ravel()
    stretched[free] = (rows[:rank] ** 2).sum(axis=0)
    share = np.where(free, 1.0 - stretched, 0.0).reshape(-1, 6)
    place, depth = _places(scene)
    return Floppy(
        Counts(freedoms, connectors, rank), share.sum(axis=1), share[:, 3:].sum(axis=1), place,
        depth)


def _places(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return the place (corner, edge, face, within) and depth of each body of a slab."""
    count = scene.body_count
    parameters = scene.parameters
    if parameters['weave.kind'] != 'orthogonal' or parameters['weave.region'] or (
            len(scene.weave.position) != count):
        return np.full(count, -1), np.full(count, -1)
    grid = np.asarray(scene.weave.grid)
    below = np.minimum(grid - grid.min(axis=0), grid.max(axis=0) - grid)
    outer = (below == 0).sum(axis=1)
    return np.array([3, 2, 1, 0])[outer], below.min(axis=1)


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else float('nan')
