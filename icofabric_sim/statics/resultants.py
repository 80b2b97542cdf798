# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Least resultants of forces and moments without overlap: the statics problem of the document.

The objective is half the sum of squares of the resultants on free bodies, torques over a, as in
the text after eq 48. Contact forces are not included: that shells must not overlap is a
constraint, enforced by a penalty on the energy of overlaps. The penalty grows until overlaps are
below 1e-6 a (`PenaltySettings`). Steps follow Levenberg and Marquardt: the derivative of the
resultants is minus the Hessian of the energy.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from icofabric_sim.statics.fabric import Configuration, StaticFabric
from icofabric_sim.statics.spectrum import row_sum, scaled_hessian
import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

LEAST_RESULTANTS = 'least resultants'


@dataclass(frozen=True)
class PenaltySettings:
    """Tunables of the search for least resultants with penalties on overlaps."""

    max_overlap_ratio: float = 1e-6  # largest overlap of a result over a
    penalty_factor: float = 10.0  # between successive penalties
    penalty_count: int = 14  # penalties grow until the overlap is small enough
    # First penalty, as a ratio to the squared stiffness of the fabric over that of contacts.
    first_penalty_ratio: float = 100.0
    # Gradient at which the search ends, as a ratio to the largest stiffness times the resultants;
    # and the same if round-off prevents further progress.
    gradient_ratio: float = 1e-10
    rounded_gradient_ratio: float = 1e-6
    max_step: float = 0.3  # largest motion of a body in a step over a, and in rad
    # Damping of Levenberg and Marquardt, relative to the diagonal: first, least and largest.
    first_damping: float = 1e-3
    min_damping: float = 1e-15
    max_damping: float = 1e15
    min_gain_ratio: float = 1e-4  # smallest accepted ratio of actual to expected decrease


_PENALTY = PenaltySettings()


class LeastResultants(NamedTuple):
    """Result of a search for least resultants."""

    here: Configuration  # of the fabric without contacts
    there: Configuration  # of the fabric with contacts
    converged: bool
    step_count: int
    reason: str


class _Point(NamedTuple):
    """Configuration without and with contacts, and its objective."""

    here: Configuration
    there: Configuration
    resultants: np.ndarray  # (f,) [N] on free degrees of freedom, torques over a
    value: float  # [N^2] with the penalty


def find_least_resultants(
    fabric: StaticFabric, touching: StaticFabric, start: Configuration,
    largest_step_count: int, report: Callable[[int, Configuration], None]
) -> LeastResultants:
    """
    Minimise the resultants of a `fabric` without contacts from a `start`.

    Parameters
    ----------
    fabric
        The fabric without contacts.
    touching
        The same fabric with contacts, if it has any.
    start
        Configuration of `fabric`.
    largest_step_count
        Steps after which the search gives up.
    report
        Called with the number of steps and the configuration after each step.

    Returns
    -------
    LeastResultants
        Configuration in which no motion lowers the objective.

    """
    search = _Search(fabric, touching)
    point, steps = search.point(start.position, start.orientation), 0
    contacts = touching.contacts
    if contacts is not None:
        contacts.smoothed = True
        stiffness = row_sum(search.hessian(point.here))
        search.penalty = _PENALTY.first_penalty_ratio * (
            stiffness**2 or contacts.stiffness**2) / contacts.stiffness
    depth = 0.0
    for _ in range(_PENALTY.penalty_count):
        point = search.point(point.here.position, point.here.orientation)
        point, taken, converged = search.descend(point, largest_step_count - steps, report, steps)
        steps += taken
        if point.there.contact_state is not None:
            depth = point.there.contact_state.depth
        if not converged:
            return LeastResultants(
                point.here, point.there, False, steps,
                f'the search took {steps:,} steps; allow more (--steps, largest_step_count)'
                if steps >= largest_step_count else
                'no step lowers the resultants, although they are not at a minimum: use a larger '
                'tolerance or another start')
        if depth <= _PENALTY.max_overlap_ratio * fabric.half_edge:
            return LeastResultants(point.here, point.there, True, steps, '')
        search.penalty *= _PENALTY.penalty_factor
    return LeastResultants(
        point.here, point.there, False, steps,
        f'shells still overlap by {depth / fabric.half_edge:.2g} a: there may be no '
        'configuration without overlap; move the supported or driven bodies')


class _Search:
    """Search that lowers the objective."""

    def __init__(self, fabric: StaticFabric, touching: StaticFabric) -> None:
        self._fabric, self._touching = fabric, touching
        self._free = fabric.free
        a = fabric.half_edge
        # From coordinates scaled by a to motions, and from masses to these coordinates.
        self._scale = np.broadcast_to(np.repeat([1.0, 1.0 / a], 3), self._free.shape)
        self._root = (np.broadcast_to(fabric.root, self._free.shape) * self._scale)[self._free]
        self.penalty = 0.0  # [N/m] of the energy of overlaps

    def point(self, position: np.ndarray, orientation: np.ndarray) -> _Point:
        """Evaluate the objective."""
        here = Configuration(self._fabric, position, orientation)
        there = Configuration(self._touching, position, orientation)
        resultants = (here.force * self._scale)[self._free]
        energy = 0.0 if there.contact_state is None else there.contact_state.energy
        return _Point(
            here, there, resultants,
            0.5 * float(resultants @ resultants) + self.penalty * energy)

    def hessian(self, here: Configuration) -> sparse.csr_matrix:
        """Return second derivatives of the energy by the scaled coordinates (f, f) [N/m]."""
        root = sparse.diags(self._root)
        return sparse.csr_matrix(root @ scaled_hessian(here) @ root)

    def descend(
        self, point: _Point, largest: int, report: Callable[[int, Configuration], None],
        before: int
    ) -> tuple[_Point, int, bool]:
        """Take up to `largest` steps; return the point, the steps, and if its gradient is 0."""
        damping, steps = _PENALTY.first_damping, 0
        while True:
            hessian = self.hessian(point.here)
            gradient = -(hessian @ point.resultants)
            matrix = hessian @ hessian
            touching = point.there.contact_state
            size = row_sum(hessian) * float(np.abs(point.resultants).max(initial=0.0))
            if touching is not None and touching.energy > 0.0:
                push = self.penalty * (touching.wrench * self._scale)[self._free]
                gradient = gradient - push
                matrix = matrix + self.penalty * (self.hessian(point.there) - hessian)
                size = max(size, float(np.abs(push).max()))
            slope = float(np.abs(gradient).max(initial=0.0))
            if slope <= _PENALTY.gradient_ratio * size:
                return point, steps, True
            if steps >= largest:
                return point, steps, False
            diagonal = np.abs(matrix.diagonal())
            floor = sparse.diags(np.maximum(diagonal, 1e-6 * diagonal.max()))
            taken = None
            while taken is None and damping <= _PENALTY.max_damping:
                motion = -splu(sparse.csc_matrix(matrix + damping * floor)).solve(gradient)
                taken = self._tried(point, motion, gradient, matrix)
                damping *= 4.0 if taken is None else 0.1
            if taken is None:
                return point, steps, slope <= _PENALTY.rounded_gradient_ratio * size
            damping = max(damping, _PENALTY.min_damping)
            point, steps = taken, steps + 1
            report(before + steps, point.here)

    def _tried(
        self, point: _Point, motion: np.ndarray, gradient: np.ndarray, matrix: sparse.csr_matrix
    ) -> _Point | None:
        """Return the point after a motion (f,) [m] in scaled coordinates, or None if not lower."""
        size = float(np.abs(motion).max(initial=0.0))
        if not np.isfinite(size):
            return None
        motion = motion * min(1.0, _PENALTY.max_step * self._fabric.half_edge / max(size, 1e-300))
        expected = -float(gradient @ motion + 0.5 * motion @ (matrix @ motion))
        if expected <= 0.0:
            return None
        moved = np.zeros(self._free.shape)
        moved[self._free] = motion
        there = point.here.moved(moved * self._scale)
        found = self.point(there.position, there.orientation)
        gain = point.value - found.value
        return found if gain >= _PENALTY.min_gain_ratio * expected else None
