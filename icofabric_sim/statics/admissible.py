# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Limit analysis: contact forces within their friction cones that balance all loads.

The configuration and all forces except contact forces are given. Contact c has a normal force
N_c >= 0, a tangential force T_c and a moment M_c about the normal. With the radius r_c of the
contact patch, the friction law is

    sqrt(|T_c|^2 + (M_c / r_c)^2) <= mu N_c.

The ball is replaced by an inscribed polyhedron of 62 corners, so every solution is admissible. One
corner lies along the friction of elastic sticking; in other directions up to 7 % of the friction
remain unused. Linear programs (HiGHS: Q. Huangfu and J. A. J. Hall, Math. Prog. Comp. 10, 2018)
minimise the sum of unbalanced forces. If it vanishes, bisection finds the smallest coefficient mu'
for which the contacts hold, which maximises the smallest margin 1 - |T_c| / (mu N_c) (static
theorem: J. Heyman, Int. J. Solids Struct. 2, 249, 1966; R. K. Livesley, Int. J. Numer. Meth. Eng.
12, 1853, 1978).
"""

from dataclasses import dataclass
from typing import NamedTuple

from icofabric_sim.simulation.reports.load_cells import ContactForces
from icofabric_sim.statics.contact_points import ContactPoints
from icofabric_sim.statics.contacts import margin_of
from icofabric_sim.statics.fabric import Configuration
import numpy as np
from scipy import sparse

# Unit vectors: both poles, and 12 on each of five rings.
_RING = np.pi / 6.0 * np.arange(1, 6)
_ROUND = np.pi / 6.0 * np.arange(12)
_CORNERS = np.concatenate([[[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], np.stack([
    np.repeat(np.cos(_RING), 12), np.outer(np.sin(_RING), np.cos(_ROUND)).ravel(),
    np.outer(np.sin(_RING), np.sin(_ROUND)).ravel()], axis=1)])


@dataclass(frozen=True)
class ConeSettings:
    """Tunables of the linear programs for forces within friction cones."""

    balanced_ratio: float = 1e-7  # unbalanced force over the largest force that counts as zero
    # Upper bound of a normal force, as a ratio to the sum of all forces. Without this bound, a
    # body jammed between walls would need almost no friction at unlimited normal forces.
    max_normal_force_ratio: float = 100.0
    friction_accuracy_ratio: float = 1e-7  # relative accuracy of the coefficient of friction
    max_friction: float = 100.0  # largest coefficient of friction considered
    # Weight of the sum of normal forces, relative to that of unbalanced forces: it selects the
    # smallest normal forces among solutions that balance equally well.
    normal_force_weight: float = 1e-6


_CONES = ConeSettings()


class Admissible(NamedTuple):
    """Admissible contact forces of one configuration."""

    contacts: ContactForces  # with normal forces and margins
    unbalanced_wrench: np.ndarray  # (n, 6) unbalanced forces [N] and torques [N m] on free bodies
    is_balanced: bool
    # Smallest coefficient of friction with which the contacts hold; infinite: none does.
    friction_needed: float


def find_admissible(here: Configuration, coefficient: float) -> Admissible:
    """
    Find contact forces within the friction cones that balance all other forces.

    Parameters
    ----------
    here
        Configuration with contacts.
    coefficient
        Coefficient of friction mu of `contact.friction`.

    Returns
    -------
    Admissible
        Forces with the largest possible smallest margin; if none balance, those with the
        smallest unbalanced rest.

    """
    contacts = here.fabric.contacts
    assert contacts is not None
    met = contacts.contact_points(here.position, here.axes)
    problem = _Problem(here, met)
    left, forces = problem.solve(coefficient)
    if left > _CONES.balanced_ratio:
        needed = problem.least(coefficient, _CONES.max_friction)
        return problem.answer(forces, coefficient, needed, is_balanced=False)
    needed = problem.least(0.0, coefficient)
    # Slightly more than needed, so that round-off leaves no unbalanced force.
    left, tight = problem.solve(
        min(coefficient, needed * (1.0 + _CONES.friction_accuracy_ratio) + 1e-12))
    return problem.answer(
        tight if left <= _CONES.balanced_ratio else forces, coefficient, needed, is_balanced=True)


class _Problem:
    """Linear programs of normal forces and of friction along generators of the cones."""

    def __init__(self, here: Configuration, met: ContactPoints) -> None:
        self._here, self._met = here, met
        fabric = here.fabric
        count, self._bodies = len(met.pairs), fabric.scene.body_count
        elastic, rubbed = here.contact_state, here.friction
        self._others = here.force.copy()
        for part in (elastic, rubbed):
            if part is not None:
                self._others -= part.wrench
        self._rub, self._corners = self._generators()
        # Rows: free degrees of freedom, torques over a; all over the sum of the force magnitudes.
        scale = np.ones((self._bodies, 6))
        scale[:, 3:] /= fabric.half_edge
        self._free, self._scale = fabric.free.ravel(), scale.ravel()
        size = float(np.linalg.norm(self._others[:, :3], axis=1).sum())
        self._force = max(size, here.force_scale) or 1.0
        columns = np.concatenate([met.wrenches[:, None], self._rub], axis=1)  # (p, 63, 12)
        of = np.where(met.pairs < 0, self._bodies, met.pairs)  # planes: rows dropped below
        rows = 6 * np.repeat(of, 6, axis=1) + np.tile(np.arange(6), 2)
        width = columns.shape[1]
        matrix = sparse.csr_matrix((columns.ravel(), (
            np.broadcast_to(rows[:, None], columns.shape).ravel(),
            np.repeat(np.arange(count * width), 12))), shape=(
                6 * (self._bodies + 1), count * width))[:6 * self._bodies][self._free]
        self._matrix = sparse.diags(self._scale[self._free]) @ matrix
        self._width = width

    def _generators(self) -> tuple[np.ndarray, np.ndarray]:
        """
        Return wrenches (p, 62, 12) of 1 N of friction along the corners of each cone.

        Also returns the corners (p, 62, 3): two tangential directions, and the spin.
        """
        here, met = self._here, self._met
        normal, rubbed = met.normal, np.zeros((len(met.pairs), 4))
        if here.friction is not None:
            pairs = here.friction.pairs.tolist()
            known = {pair: row for row, pair in enumerate(map(tuple, pairs))}
            for row, pair in enumerate(map(tuple, met.pairs.tolist())):
                if pair in known:
                    rubbed[row] = -here.friction.stretch[known[pair]]
        along = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        plane = np.stack([along, np.cross(normal, along)], axis=1)  # (p, 2, 3)
        elastic = np.concatenate(
            [np.einsum('pki,pi->pk', plane, rubbed[:, :3]), rubbed[:, 3:]], axis=1)
        elastic[~elastic.any(axis=1), 0] = 1.0
        # Columns of Q: the elastic direction and two perpendicular to it.
        frame = np.linalg.qr(np.concatenate(
            [elastic[:, :, None], np.broadcast_to(np.eye(3), (len(normal), 3, 3))], axis=2))[0]
        corners = np.einsum('pij,kj->pki', frame, _CORNERS)
        first = here.position[met.pairs[:, 0]]
        second = here.position[np.maximum(met.pairs[:, 1], 0)]
        sides = np.einsum('pkj,pji->pki', corners[:, :, :2], plane)
        spun = (met.radius[:, None] * corners[:, :, 2])[:, :, None] * normal[:, None]
        return np.concatenate([
            sides, np.cross((met.point - first)[:, None], sides) + spun, -sides,
            -np.cross((met.point - second)[:, None], sides) - spun], axis=2), corners

    def solve(self, coefficient: float) -> tuple[float, np.ndarray]:
        """
        Minimise the unbalanced forces for a coefficient of friction.

        Returns their sum, as a ratio to the forces, and the normal and friction forces of each
        contact [N], (p, 63).
        """
        from scipy.optimize import linprog

        matrix, width = self._matrix, self._width
        rows, columns = matrix.shape
        wanted = -(self._others.ravel() * self._scale)[self._free] / self._force
        if not columns or not rows:
            return float(np.abs(wanted).sum()), np.zeros((columns // width, width))
        count = columns // width
        cone = sparse.csr_matrix(sparse.kron(
            sparse.identity(count), np.concatenate([[-coefficient], np.ones(width - 1)])[None]))
        cost = np.zeros(columns)
        cost[::width] = _CONES.normal_force_weight
        found = linprog(
            np.concatenate([cost, np.ones(2 * rows)]),
            A_ub=sparse.hstack([cone, sparse.csr_matrix((count, 2 * rows))]),
            b_ub=np.zeros(count),
            A_eq=sparse.hstack([matrix, sparse.identity(rows), -sparse.identity(rows)]),
            b_eq=wanted,
            bounds=[(0.0, _CONES.max_normal_force_ratio)] * columns + [(0.0, None)] * 2 * rows,
            method='highs', options={
                'primal_feasibility_tolerance': 1e-10, 'dual_feasibility_tolerance': 1e-10})
        if found.x is None:
            raise RuntimeError(f'HiGHS found no contact forces: {found.message}')
        left = float(found.x[columns:].sum())
        return left, self._force * found.x[:columns].reshape(count, width)

    def least(self, low: float, high: float) -> float:
        """Return the smallest coefficient in a range with which contacts hold, or infinity."""
        if self.solve(high)[0] > _CONES.balanced_ratio:
            return np.inf
        if self.solve(low)[0] <= _CONES.balanced_ratio:
            return low
        while high - low > _CONES.friction_accuracy_ratio * high:
            middle = 0.5 * (low + high)
            is_enough = self.solve(middle)[0] <= _CONES.balanced_ratio
            low, high = (low, middle) if is_enough else (middle, high)
        return high

    def answer(
        self, forces: np.ndarray, coefficient: float, needed: float, *, is_balanced: bool
    ) -> Admissible:
        """Return the result for the forces (p, 63) along normals and generators."""
        met, fabric = self._met, self._here.fabric
        assert fabric.contacts is not None
        push = forces[:, 0]
        rubbed = np.einsum('pk,pki->pi', forces[:, 1:], self._rub)
        wrenches = push[:, None] * met.wrenches + rubbed
        friction = np.linalg.norm(
            np.einsum('pk,pki->pi', forces[:, 1:], self._corners), axis=1)
        contacts = ContactForces(
            met.pairs.astype(np.int32), met.point, wrenches[:, :3], met.overlap,
            fabric.contacts.names, wrenches[:, :6], wrenches[:, 6:], push, friction,
            margin_of(push, friction, coefficient))
        left = self._others + contacts.resultants(self._bodies)
        return Admissible(contacts, np.where(fabric.free, left, 0.0), is_balanced, needed)
