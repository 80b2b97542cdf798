# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Counts of mechanisms of all slabs up to 6 x 6 x 6 by five methods, for all variants and angles.

The methods are: singular values of a dense compatibility matrix that is assembled here only from
the attachment points; singular values of the matrix of the package; all eigenvalues of the
Hessian; and pivots of the elimination, used for large fabrics, of the Hessian and of A^T A with
the compatibility matrix A. Wide gaps between the values that count as zero and all others show
that the threshold does not matter.

    .venv/bin/python -m icofabric_validation.benchmarks.mechanism_counts
"""

import argparse
from collections.abc import Iterator
from itertools import product
import time
from typing import NamedTuple

import icofabric_sim as ico
from icofabric_sim.scene.weave_geometry import MINIMUM_ANGLE
from icofabric_sim.statics.fabric import StaticFabric
from icofabric_sim.statics.mechanisms import compatibility_matrix, count_mechanisms
from icofabric_sim.statics.one_thread import one_thread
from icofabric_sim.statics.spectrum import (
    count_by_elimination,
    count_signs,
    count_under,
    Curvature,
    scaled_hessian,
    zero_limit,
)
from icofabric_validation.benchmarks.machine import machine_lines
import numpy as np

# From the smallest connector angle, -0.3649 rad (eq 54), with shells face to face, to nearly 45
# degrees: the dense half of the domain, level connectors, and the open half.
ANGLES = (MINIMUM_ANGLE, -0.25, -0.13, 0.0, 0.13, 0.3, 0.5, 0.66, 0.78)
# Largest singular value of a mechanism over the largest of all.
_MAX_ZERO_RATIO = 1e-9


class Found(NamedTuple):
    """Mechanisms of one slab."""

    freedoms: int
    connectors: int
    rank: int  # by singular values of the matrix assembled here
    by_matrix: int  # by singular values of the matrix of the package
    by_eigenvalues: Curvature
    by_pivots: Curvature
    by_elimination: int  # only from the geometry
    smallest: float  # nonzero singular value over the largest
    largest: float  # singular value of a mechanism over the largest

    @property
    def agree(self) -> bool:
        """True if all methods give the same count."""
        wanted = self.freedoms - self.rank
        return self.by_matrix == self.by_elimination == wanted and (
            self.by_eigenvalues == self.by_pivots == Curvature(wanted, 0))


def plain_matrix(scene: ico.Scene) -> np.ndarray:
    """Return changes of connector lengths by displacements over a and rotations, (c, 6 n)."""
    count = scene.body_count
    matrix = np.zeros((scene.connector_count, 6 * count))
    if not scene.connector_count:
        return matrix
    x, y, z, w = scene.orientation.T
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
    a = scene.geometry.half_edge
    for row, (pair, points) in enumerate(
            zip(scene.connectors.bodies, scene.connectors.points_body)):
        arms = [turn[:, :, body] @ point for body, point in zip(pair, points)]
        ends = [scene.position[body] + arm for body, arm in zip(pair, arms)]
        line = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        for body, arm, sign in zip(pair, arms, (-1.0, 1.0)):
            matrix[row, 6 * body:6 * body + 6] += sign * np.concatenate(
                [line, np.cross(arm, line) / a])
    return matrix


@one_thread()
def count(scene: ico.Scene) -> Found:
    """Count by all methods."""
    values = np.zeros(0)
    if scene.connector_count:
        values = np.linalg.svd(plain_matrix(scene), compute_uv=False)
        values = values / values[0]
    rank = int(np.count_nonzero(values > _MAX_ZERO_RATIO))
    here = StaticFabric(scene, contact=False).start
    matrix = scaled_hessian(here)
    pivots = Curvature(matrix.shape[0], 0)
    if matrix.nnz:
        limit = zero_limit(matrix)
        below, above = (count_under(here, matrix, s) for s in (-limit, limit))
        pivots = Curvature(above - below, below)
    return Found(
        6 * scene.body_count, scene.connector_count, rank,
        count_mechanisms(compatibility_matrix(here)).mechanisms,
        count_signs(np.linalg.eigvalsh(matrix.toarray()), 1e-10), pivots,
        -1 if (geometric := count_by_elimination(here)) is None else geometric.mechanisms,
        float(values[:rank].min(initial=1.0)), float(values[rank:].max(initial=0.0)))


def slabs(largest: int) -> Iterator[tuple[list[int], int, float]]:
    """Yield all sizes with all variants and angles."""
    for size in product(range(1, largest + 1), repeat=3):
        for variant, angle in product(range(4), ANGLES):
            yield list(size), variant, angle


def main() -> int:
    """Count and print; return 1 if two methods differ."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--largest', type=int, default=6, help='of all sizes (%(default)d)')
    arguments = parser.parse_args()
    print('\n'.join(machine_lines(('scipy',), threads='threads as chosen')))
    began, done, bad, stressed, skipped = time.perf_counter(), 0, 0, 0, 0
    smallest, largest, most = 1.0, 0.0, 0
    for size, variant, angle in slabs(arguments.largest):
        try:
            scene = ico.Scene.from_parameters({'weave': {
                'size': size, 'variant': variant, 'connector_angle': angle}})
        except ValueError:
            skipped += 1  # a slab without a body
            continue
        found = count(scene)
        done += 1
        stressed += found.connectors > found.rank
        most = max(most, found.freedoms)
        smallest, largest = min(smallest, found.smallest), max(largest, found.largest)
        if not found.agree:
            bad += 1
            print(f'differ: {size} variant {variant} angle {angle}: {found}')
        if size[1:] == [arguments.largest] * 2 and variant == 3 and angle == ANGLES[-1]:
            print(f'up to {size}: {done:,} slabs, {time.perf_counter() - began:.0f} s',
                  flush=True)
    print(f'{done:,} slabs of up to {most:,} freedoms, {skipped:,} without a body: {bad:,} '
          f'counted differently; {stressed:,} with states of self-stress')
    print(f'singular values over the largest: {smallest:.2g} and more count, {largest:.2g} and '
          'less are zero')
    return 1 if bad else 0


if __name__ == '__main__':
    raise SystemExit(main())
