# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Small vibrations about a configuration: M u'' + H u = 0, with the analytic Hessian H.

Motions that cost no energy are counted and kept apart: the rigid ones of the whole, and the
mechanisms within it.
"""

from dataclasses import dataclass, field
from functools import cached_property
import math

from icofabric_sim.scene import Scene
from icofabric_sim.snapshot import Snapshot
from icofabric_sim.statics.fabric import Configuration, StaticFabric
from icofabric_sim.statics.held import held_time
from icofabric_sim.statics.iteration import largest_square
from icofabric_sim.statics.lowest import lowest_modes, NotFoundError
from icofabric_sim.statics.mechanisms import (
    compatibility_matrix,
    count_by_elimination,
    count_mechanisms,
    Counts,
)
from icofabric_sim.statics.one_thread import one_thread
from icofabric_sim.statics.spectrum import (
    count_below,
    count_signs,
    count_under,
    COUNTED,
    Curvature,
    curvature_of,
    DENSE,
    Factor,
    FACTORED,
    factorise,
    row_sum,
    scaled_hessian,
    zero_limit,
)
import numpy as np
from scipy import sparse

LOWEST, HIGHEST = 'lowest', 'highest'
# Squared frequencies below this part of the largest are zero, where all are computed.
_ZERO = 1e-10
# Freedoms above which the lowest are first sought by iteration, and with how many products: at
# 27,786 freedoms six of one frequency took 16 s so, and 163 s with factors.
ITERATED, _FEW, _MOST = 8_000, 5_000, 40_000
# Modes that are sought in a large fabric where nobody says how many.
_SOME = 20
_SEARCHES = 40


@dataclass(frozen=True)
class Spectrum:
    """
    Frequencies and shapes of small vibrations, and the motions without any.
    """

    frequencies: np.ndarray  # (m,) [rad/s], rising; those of zero-energy motions are left out
    # (m, n, 6) displacements [m] and rotation vectors [rad], world frame; of kinetic energy 1/2 J
    # at 1 rad/s
    shapes: np.ndarray
    # Motions that cost no energy, the rigid ones included; -1: not counted.
    mechanism_count: int
    mechanisms: np.ndarray  # (z, n, 6) of them an orthonormal basis; empty for large fabrics
    rigid_count: int  # rigid motions of the whole among them
    # (u,) [1/s] of motions that lower the energy; empty for large fabrics
    growth_rates: np.ndarray
    unstable_count: int  # how many there are; -1: not counted
    freedoms: int
    # By the geometry of the connectors alone; None above 400,000 freedoms.
    counts: Counts | None
    snapshot: Snapshot  # the configuration
    here: Configuration = field(repr=False)  # the same with all that acts in it

    @cached_property
    def largest_frequency(self) -> float:
        """
        The largest of all [rad/s], by the iteration that chooses steps (lanczos.py).
        """
        return math.sqrt(largest_square(self.here))

    @property
    def self_stress_count(self) -> int:
        """
        Independent tensions that need no load; -1: not counted.
        """
        return -1 if self.counts is None else self.counts.self_stresses


@one_thread()
def solve_modes(
    scene: Scene, *, at: Snapshot | None = None, time: float | None = None,
    count: int | None = None, which: str = LOWEST
) -> Spectrum:
    """
    Vibrations about the initial configuration of a scene, or about a snapshot (an equilibrium).

    What is broken in the snapshot is left out. `count`: how many frequencies, the `which`:
    'lowest' or 'highest'; None: all of a fabric with up to 2,400 free freedoms, 20 of a larger
    one. Loads, drives and anchors are held at `time` [s]; dead loads with their point off the
    centre count, follower loads do not.
    """
    if which not in (LOWEST, HIGHEST):
        raise ValueError(f"which must be 'lowest' or 'highest', got {which!r}")
    if count is not None and count < 1:
        raise ValueError(f'count must be at least 1, got {count!r}')
    fabric = StaticFabric(
        scene, held_time(scene, time), broken_since=None if at is None else at.broken_since)
    here = fabric.start if at is None else fabric.configuration('at', at)
    matrix = scaled_hessian(here)
    size = matrix.shape[0]
    if size <= DENSE:
        return _all_modes(here, matrix.toarray(), count, which)
    wanted = min(_SOME if count is None else count, size - 2)
    curvature = curvature_of(here, matrix)
    values, vectors = (_highest if which == HIGHEST else _lowest)(
        here, matrix, wanted, curvature)
    return Spectrum(
        frequencies=np.sqrt(values), shapes=_shapes(here, vectors),
        mechanism_count=curvature.zero, mechanisms=np.zeros((0, scene.body_count, 6)),
        rigid_count=rigid_count(here), growth_rates=np.zeros(0),
        unstable_count=curvature.negative, freedoms=size,
        counts=count_by_elimination(here) if size <= COUNTED else None,
        snapshot=here.snapshot, here=here)


def _all_modes(
    here: Configuration, matrix: np.ndarray, count: int | None, which: str
) -> Spectrum:
    values, vectors = np.linalg.eigh(matrix) if len(matrix) else (np.zeros(0), matrix)
    curvature = count_signs(values, _ZERO)
    counts = count_mechanisms(compatibility_matrix(here))
    zero = slice(curvature.negative, curvature.negative + curvature.zero)
    above = np.arange(zero.stop, len(values))
    if count is not None:
        above = above[:count] if which == LOWEST else above[-count:]
    return Spectrum(
        frequencies=np.sqrt(values[above]), shapes=_shapes(here, vectors[:, above]),
        mechanism_count=curvature.zero, mechanisms=_shapes(here, vectors[:, zero]),
        rigid_count=rigid_count(here), growth_rates=np.sqrt(-values[:zero.start]),
        unstable_count=curvature.negative, freedoms=len(values), counts=counts,
        snapshot=here.snapshot, here=here)


def _highest(
    here: Configuration, matrix: sparse.csr_matrix, count: int, curvature: Curvature
) -> tuple[np.ndarray, np.ndarray]:
    from scipy.sparse.linalg import eigsh

    values, vectors = eigsh(matrix, k=count, which='LA', v0=_start(matrix))
    return values, vectors


def _lowest(
    here: Configuration, matrix: sparse.csr_matrix, count: int, curvature: Curvature
) -> tuple[np.ndarray, np.ndarray]:
    """
    Those above zero: beside a shift below which there are some of them, found by counting.
    """
    from scipy.sparse.linalg import eigsh, LinearOperator

    below = curvature.zero + curvature.negative
    size = matrix.shape[0]
    if size > min(ITERATED, FACTORED):
        def between(value: float) -> int:
            return count_under(here, matrix, value) - below

        try:
            return lowest_modes(
                here, count, zero_limit(matrix), None if curvature.zero < 0 else between,
                _MOST if size > FACTORED else _FEW)
        except NotFoundError:
            # Of long thin fabrics, whose factors are small.
            if size > FACTORED:
                raise
    if curvature.zero < 0:
        raise ValueError(
            'the zero-energy motions of this fabric could not be counted, and with them the '
            "lowest frequencies not be told apart; which='highest' needs no such count")
    low, high = zero_limit(matrix), row_sum(matrix)
    factor: Factor | None = None
    shift = low
    for _ in range(_SEARCHES):
        shift = math.sqrt(low * high)
        factor = factorise(here, matrix, shift)
        found = count_below(factor) - below
        if found < 1:
            low = shift
        elif found > count:
            high = shift
        else:
            break
    assert factor is not None
    solve = LinearOperator(matrix.shape, matvec=factor.solve, dtype=float)
    # Others may lie nearer to the shift, on its other side.
    sought = 2 * count + 2
    while True:
        sought = min(sought, matrix.shape[0] - 2)
        values, vectors = eigsh(
            matrix, k=sought, sigma=shift, which='LM', OPinv=solve, v0=_start(matrix))
        order = np.argsort(values)
        order = order[values[order] > zero_limit(matrix)][:count]
        if len(order) == count or sought == matrix.shape[0] - 2:
            return values[order], vectors[:, order]
        sought *= 2


def _start(matrix: sparse.csr_matrix) -> np.ndarray:
    """
    The same for every call: results are the same bits.
    """
    return np.random.RandomState(1).standard_normal(matrix.shape[0])


def _shapes(here: Configuration, vectors: np.ndarray) -> np.ndarray:
    """
    Motions of all bodies (m, n, 6) from columns of mass-scaled free freedoms (f, m).
    """
    fabric = here.fabric
    shapes = np.zeros((vectors.shape[1], *fabric.free.shape))
    shapes[:, fabric.free] = vectors.T
    return shapes / fabric.root


def rigid_motions(here: Configuration) -> np.ndarray:
    """
    Translations along and rotations about the axes of the world, (6, n, 6).
    """
    arm = here.position - here.position.mean(axis=0)
    motions = np.zeros((6, len(arm), 6))
    for k in range(3):
        axis = np.eye(3)[k]
        motions[k, :, k] = 1.0
        motions[k + 3, :, :3] = np.cross(axis, arm)
        motions[k + 3, :, k + 3] = 1.0
    return motions


def rigid_count(here: Configuration) -> int:
    """
    How many rigid motions of the whole supports and anchors allow.
    """
    fabric = here.fabric
    motions = rigid_motions(here)
    motions[3:] /= fabric.half_edge
    held = (motions * fabric.root)[:, ~fabric.free]
    anchored = [
        motions[:, body, :3] @ direction + motions[:, body, 3:] @ np.cross(arm, direction)
        for body, arm, direction in fabric.anchors.directions(here.position, here.axes)]
    limits = np.hstack([held, np.array(anchored).reshape(-1, 6).T * fabric.root[0]])
    if not limits.size:
        return 6
    values = np.linalg.svd(limits, compute_uv=False)
    return 6 - int(np.count_nonzero(values > 1e-9 * max(float(values[0]), 1e-300)))
