# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Small vibrations about a configuration: M u'' + H u = 0, with the analytic Hessian H.

Zero-energy motions are counted separately: rigid motions of the whole, and mechanisms.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
import math
from typing import Any

from icofabric_sim import checks
from icofabric_sim.checks import renamed_attributes
from icofabric_sim.scene.masses import require_isotropic, turned_axes
from icofabric_sim.scene.scene import require_scene, Scene
from icofabric_sim.simulation.model.as_table import AsTable
from icofabric_sim.simulation.model.body_force import as_body_force, BodyForce, Force
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.statics.fabric import check_snapshot, Configuration, StaticFabric
from icofabric_sim.statics.friction import FrictionPath
from icofabric_sim.statics.graded import (
    is_graded,
    ROUNDING_RATIO,
    solve_graded,
    without_slopes,
    ZERO_RATIO,
)
from icofabric_sim.statics.held import check_time, held_time
from icofabric_sim.statics.iteration import largest_square
from icofabric_sim.statics.kinks import amplitudes_to_kink
from icofabric_sim.statics.lowest import lowest_modes, NotFoundError
from icofabric_sim.statics.mechanisms import (
    compatibility_matrix,
    count_mechanisms,
    Counts,
)
from icofabric_sim.statics.one_thread import one_thread
from icofabric_sim.statics.sides import BRANCHES, check_branch, PULL, PUSH, SOFT, STIFF
from icofabric_sim.statics.spectrum import (
    count_below,
    count_by_elimination,
    count_signs,
    count_under,
    COUNTED,
    Curvature,
    curvature_of,
    DENSE,
    ends_of_spectrum,
    Factor,
    FACTORED,
    factorise,
    is_counted,
    judge_ends,
    LARGE_ZERO_RATIO,
    row_sum,
    scaled_hessian,
    zero_limit,
)
import numpy as np
from scipy import sparse

LOWEST, HIGHEST = 'lowest', 'highest'
# Change of length, as a ratio to the largest, above which a motion stretches connectors.
_STRETCHED_RATIO = 1e-3
# Degrees of freedom above which the lowest frequencies are first computed by iteration.
ITERATED = 8_000


@dataclass(frozen=True)
class ModesSettings:
    """Tunables of the iterations for some modes of a large fabric."""

    # Most products for the lowest frequencies, with and without the alternative of factors. At
    # 27,786 degrees of freedom six equal frequencies took 16 s by iteration and 163 s with
    # factors.
    max_trial_products: int = 5_000
    max_products: int = 40_000
    default_count: int = 20  # modes that are computed by default
    max_searches: int = 40  # most bisections for a shift above the lowest frequency


_MODES = ModesSettings()


@renamed_attributes(
    here='configuration', freedoms='degrees_of_freedom', zero_below='zero_frequency_limit',
    bounds_from='first_bounded_motion', hidden_count='unresolved_mode_count',
    stretching_mechanism_count='unresolved_mode_count')
@dataclass(frozen=True, repr=False)
class Spectrum(AsTable):
    """Frequencies and shapes of small vibrations, and zero-energy motions."""

    frequencies: np.ndarray  # (m,) [rad/s], rising; without zero-energy motions
    # (m, n, 6) displacements [m] and rotation vectors [rad], world frame, normalised to
    # u^T M u = 1 kg m^2
    shapes: np.ndarray
    # Number of zero-energy motions (null space of H), including rigid ones; -1: not counted.
    mechanism_count: int
    mechanisms: np.ndarray  # (z, n, 6) basis of them, as `shapes`; empty for large fabrics
    rigid_count: int  # rigid motions of the whole among them
    # (u,) [1/s] of motions that lower the energy; empty for large fabrics
    growth_rates: np.ndarray
    unstable_count: int  # number of motions that lower the energy; -1: not counted
    degrees_of_freedom: int  # free degrees of freedom
    # Counts from the compatibility matrix, which may differ from `mechanism_count`; None above
    # 400,000 degrees of freedom.
    counts: Counts | None
    snapshot: Snapshot  # positions and orientations of the configuration
    configuration: Configuration = field(repr=False)  # with its loads and contacts
    # Connectors, by number, and anchors, by name, at their natural length with k_e other than k_c.
    # There is no single tangent there, so all of the above is for the `branch`, 'push' (k_c) or
    # 'pull' (k_e in all of them); '' if nothing is at its kink.
    at_kink: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    anchors_at_kink: tuple[str, ...] = ()
    branch: str = ''
    # Both branches by name; empty if nothing is at its kink.
    branches: Mapping[str, 'Spectrum'] = field(default_factory=dict, repr=False)
    # (m, 2) [rad/s] bounds of the frequencies for every mixture of connectors in extension and
    # compression. Row k bounds motion k + first_bounded_motion, counted from the lowest:
    # motions that lower the energy (NaN), zero-energy motions (0), vibrations. None if nothing is
    # at its kink, or zero-energy motions were not counted.
    bounds: np.ndarray | None = None
    first_bounded_motion: int = 0
    # Pairs of shells, or shells and planes, at first touch: they count as open, but resist
    # compression.
    first_touches: int = 0
    # (m,) estimated relative round-off errors of the frequencies.
    relative_errors: np.ndarray = field(default_factory=lambda: np.zeros(0))
    zero_frequency_limit: float = 0.0  # [rad/s] smaller frequencies count as zero
    # Motions that stretch connectors but count as zero-energy motions, because their frequency is
    # below round-off.
    unresolved_mode_count: int = 0

    def __repr__(self) -> str:
        """Return a summary without arrays."""
        found = 'no frequencies' if not len(self.frequencies) else (
            f'{len(self.frequencies):,} frequencies, {self.frequencies[0]:.6g} to '
            f'{self.frequencies[-1]:.6g} rad/s')
        return f'<Spectrum: {found}, {self.mechanism_count:,} zero-energy motions>'

    def table(self) -> dict[str, list[Any]]:
        """Return the frequencies, a list for each column."""
        return {'mode': list(range(len(self.frequencies))),
                'rad_per_s': self.frequencies.tolist(),
                'hertz': (self.frequencies / (2.0 * math.pi)).tolist()}

    @cached_property
    def largest_frequency(self) -> float:
        """Largest frequency [rad/s] of all, by the iteration that chooses steps (lanczos.py)."""
        if self.configuration.fabric.scene.principal_inertia is None:
            return math.sqrt(largest_square(self.configuration))
        matrix = _scaled(self.configuration)
        if matrix.shape[0] > DENSE:
            return math.sqrt(float(_iterate(matrix, k=1, which='LA')[0][0]))
        return math.sqrt(float(np.linalg.eigvalsh(matrix.toarray())[-1])) if (
            matrix.shape[0]) else 0.0

    @cached_property
    def amplitudes(self) -> np.ndarray:
        """
        Amplitudes, as factors of the shapes, at which a connector reaches its kink, (m,).

        Its length then crosses the natural length, to first order. 0 if a connector at its kink
        changes its length; infinite if none has two stiffnesses.
        """
        return amplitudes_to_kink(self.configuration, self.shapes)

    @property
    def self_stress_count(self) -> int:
        """Number of independent tensions in equilibrium without loads; -1: not counted."""
        return -1 if self.counts is None else self.counts.self_stresses


@one_thread()
def solve_modes(
    scene: Scene, *, at: Snapshot | None = None, time: float | None = None,
    count: int | None = None, which: str = LOWEST, branch: str | None = None,
    body_force: BodyForce | Force | None = None
) -> Spectrum:
    """
    Find vibrations about the initial configuration of a scene, or about a snapshot.

    The Hessian includes dead loads at points off the centre, but not follower loads. With
    `contact.friction` loaded contacts stick: their friction springs resist small motions and have
    no force in the configuration.

    Parameters
    ----------
    scene
        Fabric, loads and supports.
    at
        Configuration (an equilibrium); connectors broken there are left out. None: the initial
        state of the scene.
    time
        Time [s] at which loads, drives and anchors are held; required if they change with time.
    count
        Number of frequencies; None: all up to 2,400 free degrees of freedom, 20 above.
    which
        'lowest' or 'highest' frequencies.
    branch
        Stiffness of connectors at their natural length in results that need a single one: 'push'
        (None) is k_c, 'pull' is k_e.
    body_force
        Function or `BodyForce`, as in `compile_scene` (see also `ico.surface_force`), evaluated at
        `time` and zero velocity. Derivatives are computed by finite differences.

    Returns
    -------
    Spectrum
        Frequencies [rad/s], shapes, and zero-energy motions.

    Raises
    ------
    ValueError
        If the body force has no potential or acts between bodies.

    """
    require_scene(scene)
    force = as_body_force(body_force)
    check_snapshot('at', at, scene)
    check_time(time)
    if count is not None:
        count = checks.count('count', count, 1)
    checks.choice('which', which, (LOWEST, HIGHEST))
    check_branch(branch)
    friction = FrictionPath.of(scene)
    fabric = StaticFabric(
        scene, held_time(scene, time),
        broken_since=None if at is None else at.broken_since,
        anchors_broken_since=None if at is None else at.anchors_broken_since, friction=friction,
        body_force=force)
    fabric.require_steady(time)
    here = fabric.start if at is None else fabric.configuration('at', at)
    if friction is not None and fabric.contacts is not None:
        fabric.friction = friction.sticking(fabric.contacts, here.position, here.axes)
    if fabric.own_force is not None and here.own_force_blocks is not None:
        fabric.own_force.require_symmetric(here.own_force_blocks)
    jumps = here.kink_jumps
    if not len(jumps):
        return _solve(here, count, which)
    branches = {side: replace(
        _solve(here.on(side), count, which), at_kink=here.at_kink,
        anchors_at_kink=here.anchors_at_kink, branch=side) for side in BRANCHES}
    if (jumps > 0.0).all():
        soft, stiff = branches[PUSH], branches[PULL]
    elif (jumps < 0.0).all():
        soft, stiff = branches[PULL], branches[PUSH]
    else:
        soft, stiff = (_solve(here.on(side), count, which) for side in (SOFT, STIFF))
    first, bounds = _bounds(soft, stiff, which)
    return replace(
        branches[branch or PUSH], branches=branches, bounds=bounds, first_bounded_motion=first)


def _solve(here: Configuration, count: int | None, which: str) -> Spectrum:
    if here.fabric.model.coulomb is not None and not is_counted(here):
        _require_isotropic(here, DENSE)
        return _without_matrix(here, count, which)
    matrix = _scaled(here)
    size = matrix.shape[0]
    if size <= DENSE:
        return _all_modes(here, *_all_values(here, matrix), count, which)
    if size > FACTORED:
        _require_isotropic(here, FACTORED)
    wanted = min(_MODES.default_count if count is None else count, size - 2)
    curvature = curvature_of(here, matrix)
    values, vectors = (_highest if which == HIGHEST else _lowest)(
        here, matrix, wanted, curvature)
    return _some_modes(here, values, vectors, curvature, size, row_sum(matrix))


def _require_isotropic(here: Configuration, most: int) -> None:
    """Refuse anisotropic inertia, which the kernels for `most` and more freedoms ignore."""
    scene = here.fabric.scene
    require_isotropic(
        scene.parameters, scene.principal_inertia,
        f'vibrations of more than {most:,} degrees of freedom')


def _scaled(here: Configuration) -> sparse.csr_matrix:
    """Return the mass-scaled Hessian, with anisotropic inertia if any."""
    matrix, unequal = scaled_hessian(here), _inertia_scaling(here)
    return matrix if unequal is None else sparse.csr_matrix(unequal @ matrix @ unequal)


def _inertia_scaling(here: Configuration) -> sparse.csr_matrix | None:
    """
    Return the scaling (f, f) of rotations relative to the smallest moment; None if isotropic.

    For each body R diag(I_k / Lambda)^(-1/2) R^T on world axes, for its free degrees of freedom
    (either all of its rotations are free or none).
    """
    fabric = here.fabric
    moments = fabric.scene.principal_inertia
    if moments is None:
        return None
    roots = np.sqrt(moments.min(axis=1, keepdims=True) / moments)
    blocks = np.tile(np.eye(6), (len(moments), 1, 1))
    axes = turned_axes(fabric.scene.principal_axes, here.axes)
    blocks[:, 3:, 3:] = np.einsum('bki,bk,bkj->bij', axes, roots, axes)
    free = fabric.free.ravel()
    return sparse.csr_matrix(sparse.block_diag(list(blocks), format='csr')[free][:, free])


def _some_modes(
    here: Configuration, values: np.ndarray, vectors: np.ndarray, curvature: Curvature, size: int,
    largest: float
) -> Spectrum:
    """Return the spectrum of some squared frequencies, with errors relative to the `largest`."""
    counts = count_by_elimination(here) if size <= COUNTED else None
    return Spectrum(
        frequencies=np.sqrt(values), shapes=_shapes(here, vectors),
        mechanism_count=curvature.zero,
        mechanisms=np.zeros((0, here.fabric.scene.body_count, 6)),
        rigid_count=rigid_count(here), growth_rates=np.zeros(0),
        unstable_count=curvature.negative, degrees_of_freedom=size,
        counts=counts, relative_errors=0.5 * ROUNDING_RATIO * largest / values,
        zero_frequency_limit=math.sqrt(LARGE_ZERO_RATIO * largest),
        unresolved_mode_count=0 if counts is None else max(
            0, curvature.zero - counts.mechanisms),
        snapshot=here.snapshot, configuration=here, first_touches=here.first_touches)


def _without_matrix(here: Configuration, count: int | None, which: str) -> Spectrum:
    """Return the spectrum of a fabric with a large dense Hessian, by products with it alone."""
    from scipy.sparse.linalg import LinearOperator

    free, root = here.fabric.free, here.fabric.root
    size = int(free.sum())
    wanted = min(_MODES.default_count if count is None else count, size - 2)
    lowest, largest = ends_of_spectrum(here)
    if which == HIGHEST:
        def times(vector: np.ndarray) -> np.ndarray:
            motion = np.zeros(free.shape)
            motion[free] = np.ravel(vector)
            return np.asarray((here.times(motion / root) / root)[free])

        values, vectors = _iterate(
            LinearOperator((size, size), matvec=times, dtype=float), k=wanted, which='LA')
    else:
        values, vectors = lowest_modes(
            here, wanted, LARGE_ZERO_RATIO * largest, None, _MODES.max_products)
    curvature = judge_ends(lowest, largest)
    return _some_modes(here, values, vectors, curvature, size, largest)


def _bounds(soft: Spectrum, stiff: Spectrum, which: str) -> tuple[int, np.ndarray | None]:
    """Return the first index among all motions, and bounds [rad/s] from there on, (m, 2)."""
    if min(soft.mechanism_count, stiff.mechanism_count) < 0:
        return 0, None
    quiet = [s.mechanism_count + s.unstable_count for s in (soft, stiff)]
    starts = quiet if which == LOWEST else [
        s.degrees_of_freedom - len(s.frequencies) for s in (soft, stiff)]
    # 'highest' may be fewer than all; below 'lowest' are the zero-energy motions.
    first = min(starts) if which == LOWEST else max(starts)
    last = min(start + len(s.frequencies) for start, s in zip(starts, (soft, stiff)))
    bounds = np.zeros((max(0, last - first), 2))
    for column, (start, s) in enumerate(zip(starts, (soft, stiff))):
        place = np.arange(first, first + len(bounds))
        above = place >= start
        bounds[above, column] = s.frequencies[place[above] - start]
        bounds[place < s.unstable_count, column] = np.nan
    return first, bounds


def _all_values(
    here: Configuration, matrix: sparse.csr_matrix
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Return all squared frequencies, vectors, errors and the zero limit, see `solve_graded`."""
    if not matrix.shape[0]:
        return np.zeros(0), np.zeros((0, 0)), np.zeros(0), 0.0
    if is_graded(here):
        return solve_graded(here, _scaled(without_slopes(here)), _inertia_scaling(here))
    values, vectors = np.linalg.eigh(matrix.toarray())
    size = float(np.abs(values).max(initial=0.0))
    zero = ZERO_RATIO * size
    return (np.where(np.abs(values) <= zero, 0.0, values), vectors,
            np.full(len(values), ROUNDING_RATIO * size), zero)


def _all_modes(
    here: Configuration, values: np.ndarray, vectors: np.ndarray, errors: np.ndarray,
    zero_limit_square: float, count: int | None, which: str
) -> Spectrum:
    changes = compatibility_matrix(here)
    counts = count_mechanisms(changes)
    curvature = count_signs(values, 0.0)
    zero = slice(curvature.negative, curvature.negative + curvature.zero)
    above = np.arange(zero.stop, len(values))
    if count is not None:
        above = above[:count] if which == LOWEST else above[-count:]
    return Spectrum(
        frequencies=np.sqrt(values[above]), shapes=_shapes(here, vectors[:, above]),
        mechanism_count=curvature.zero, mechanisms=_shapes(here, vectors[:, zero]),
        rigid_count=rigid_count(here), growth_rates=np.sqrt(-values[:zero.start]),
        unstable_count=curvature.negative, degrees_of_freedom=len(values), counts=counts,
        relative_errors=0.5 * errors[above] / values[above],
        zero_frequency_limit=math.sqrt(zero_limit_square),
        unresolved_mode_count=_count_hidden(changes, vectors[:, zero]),
        snapshot=here.snapshot, configuration=here,
        first_touches=here.first_touches)


def _count_hidden(changes: np.ndarray, motions: np.ndarray) -> int:
    """Count the zero-energy `motions` (f, z) that stretch connectors."""
    found = changes @ motions
    limit = _STRETCHED_RATIO * float(np.abs(changes).max(initial=0.0))
    if not np.abs(found).max(initial=0.0) > limit:
        return 0
    return int(np.count_nonzero(np.linalg.svd(found, compute_uv=False) > limit))


def _highest(
    here: Configuration, matrix: sparse.csr_matrix, count: int, curvature: Curvature
) -> tuple[np.ndarray, np.ndarray]:
    return _iterate(matrix, k=count, which='LA')


def _lowest(
    here: Configuration, matrix: sparse.csr_matrix, count: int, curvature: Curvature
) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest values above zero, near a shift that is found by counting."""
    from scipy.sparse.linalg import LinearOperator

    below = curvature.zero + curvature.negative
    size = matrix.shape[0]
    equal = here.fabric.scene.principal_inertia is None
    if equal and size > min(ITERATED, FACTORED):
        def between(value: float) -> int:
            return count_under(here, matrix, value) - below

        try:
            return lowest_modes(
                here, count, zero_limit(matrix), None if curvature.zero < 0 else between,
                _MODES.max_products if size > FACTORED else _MODES.max_trial_products)
        except NotFoundError:
            # Long thin fabrics have small factors.
            if size > FACTORED:
                raise
    if curvature.zero < 0:
        raise ValueError(
            'the zero-energy motions of this fabric could not be counted, so the lowest '
            "frequencies cannot be separated from them; which='highest' needs no count")
    low, high = zero_limit(matrix), row_sum(matrix)
    factor: Factor | None = None
    shift = low
    for _ in range(_MODES.max_searches):
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
    # Values on the other side of the shift may be closer to it.
    sought = 2 * count + 2
    while True:
        sought = min(sought, matrix.shape[0] - 2)
        values, vectors = _iterate(matrix, k=sought, sigma=shift, which='LM', OPinv=solve)
        order = np.argsort(values)
        order = order[values[order] > zero_limit(matrix)][:count]
        if len(order) == count or sought == matrix.shape[0] - 2:
            return values[order], vectors[:, order]
        sought *= 2


def _iterate(matrix: Any, **words: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return values and vectors by ARPACK; raise NotFoundError if it does not converge."""
    from scipy.sparse.linalg import ArpackError, eigsh

    try:
        values, vectors = eigsh(matrix, v0=_start_vector(matrix), **words)
    except ArpackError as error:
        raise NotFoundError(
            f'the frequencies of this fabric did not converge ({error}): they lie too close to '
            'zero or to each other; request fewer, or the other end of the spectrum (which)'
        ) from error
    return values, vectors


def _start_vector(matrix: Any) -> np.ndarray:
    """Return a fixed start vector, so that results are bit-identical."""
    return np.random.RandomState(1).standard_normal(matrix.shape[0])


def _shapes(here: Configuration, vectors: np.ndarray) -> np.ndarray:
    """Return motions of all bodies (m, n, 6) from mass-scaled free degrees of freedom (f, m)."""
    fabric, unequal = here.fabric, _inertia_scaling(here)
    if unequal is not None:
        vectors = unequal @ vectors
    shapes = np.zeros((vectors.shape[1], *fabric.free.shape))
    shapes[:, fabric.free] = vectors.T
    return shapes / fabric.root


def rigid_motions(here: Configuration) -> np.ndarray:
    """Return translations along and rotations about the world axes, (6, n, 6)."""
    arm = here.position - here.position.mean(axis=0)
    motions = np.zeros((6, len(arm), 6))
    for k in range(3):
        axis = np.eye(3)[k]
        motions[k, :, k] = 1.0
        motions[k + 3, :, :3] = np.cross(axis, arm)
        motions[k + 3, :, k + 3] = 1.0
    return motions


def rigid_count(here: Configuration) -> int:
    """Count the rigid motions of the whole that supports and anchors allow."""
    fabric = here.fabric
    motions = rigid_motions(here)
    motions[3:] /= fabric.half_edge
    held = (motions * fabric.root)[:, ~fabric.free]
    anchored = [
        motions[:, body, :3] @ direction + motions[:, body, 3:] @ np.cross(arm, direction)
        for body, arm, direction in fabric.anchors.directions(here.position, here.axes)]
    limits = np.hstack([held, np.array(anchored).reshape(-1, 6).T * float(
        fabric.root.flat[0])])
    blocks = here.own_force_blocks
    if blocks is not None and blocks.any():
        # Resistance of a body force, scaled to its largest derivative [N/m].
        push = np.einsum('bij,mbj->mbi', blocks, motions)
        push[..., 3:] /= fabric.half_edge
        limits = np.hstack([limits, float(fabric.root.flat[0]) / max(
            float(np.abs(push).max()), 1e-300) * push.reshape(6, -1)])
    if not limits.size:
        return 6
    values = np.linalg.svd(limits, compute_uv=False)
    return 6 - int(np.count_nonzero(values > 1e-9 * max(float(values[0]), 1e-300)))
