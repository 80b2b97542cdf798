# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
Contact forces within their friction cones that balance all loads: a limit analysis.

The configuration and all that acts there but contacts is given. Contact c pushes with N_c >= 0 and
rubs with T_c along the surface and a moment M_c about the normal, and by the friction law

    sqrt(|T_c|^2 + (M_c / r_c)^2) <= mu N_c,

r_c the radius of the patch. The ball is replaced by a polyhedron of 62 corners within it, one of
them along the friction of elastic sticking, so what is found is admissible; in other directions up
to 7 % of friction are not used. Linear
programs (HiGHS: Q. Huangfu and J. A. J. Hall, Math. Prog. Comp. 10, 2018) find the least sum of
forces that is left over and, where nothing is, the least coefficient mu' with which the contacts
hold, by bisection: so the smallest margin 1 - |T_c| / (mu N_c) is as large as it can be (the
static theorem: J. Heyman, Int. J. Solids Struct. 2, 249, 1966; R. K. Livesley, Int. J. Numer.
Meth. Eng. 12, 1853, 1978).
"""

from typing import NamedTuple

from icofabric_sim.simulation.load_cells import ContactForces
from icofabric_sim.statics.contacts import margin_of
from icofabric_sim.statics.fabric import Configuration
from icofabric_sim.statics.meetings import Meetings
import numpy as np
from scipy import sparse

# Unit vectors: both poles, and 12 on each of five rings.
_RING = np.pi / 6.0 * np.arange(1, 6)
_ROUND = np.pi / 6.0 * np.arange(12)
_CORNERS = np.concatenate([[[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], np.stack([
    np.repeat(np.cos(_RING), 12), np.outer(np.sin(_RING), np.cos(_ROUND)).ravel(),
    np.outer(np.sin(_RING), np.sin(_ROUND)).ravel()], axis=1)])
# What is left over counts as nothing below this ratio to the largest force.
_HELD_RATIO = 1e-7
# No contact pushes with more than this ratio to the sum of all forces: what is jammed between two
# walls would need next to no friction with pushes without end.
_LARGEST_PUSH_RATIO = 100.0
# The coefficient is found to this ratio; larger ones than this are not sought.
_MU_RATIO, _LARGEST_MU = 1e-7, 100.0
# Weight of what is left over beside the sum of the pushes, which are as small as they can be.
_PUSH_WEIGHT = 1e-6


class Admissible(NamedTuple):
    """Contact forces of one configuration."""

    contacts: ContactForces  # with pushes and margins
    leftover: np.ndarray  # (n, 6) forces [N] and torques [N m] on free bodies
    is_balanced: bool  # whether next to nothing is left over
    # The least coefficient of friction with which the contacts hold; infinite: none does.
    friction_needed: float


def find_admissible(here: Configuration, coefficient: float) -> Admissible:
    """
    Find contact forces within the friction cones that balance all else in a configuration.

    Parameters
    ----------
    here
        The configuration, with contacts.
    coefficient
        mu of `contact.friction`.

    Returns
    -------
    Admissible
        Those with the largest smallest margin; where none balances, those that leave the least.

    """
    contacts = here.fabric.contacts
    assert contacts is not None
    met = contacts.meetings(here.position, here.axes)
    problem = _Problem(here, met)
    left, forces = problem.solve(coefficient)
    if left > _HELD_RATIO:
        return problem.answer(
            forces, coefficient, problem.least(coefficient, _LARGEST_MU), is_balanced=False)
    needed = problem.least(0.0, coefficient)
    # A little more than needed: rounding of the last program is not to leave anything over.
    left, tight = problem.solve(min(coefficient, needed * (1.0 + _MU_RATIO) + 1e-12))
    return problem.answer(
        tight if left <= _HELD_RATIO else forces, coefficient, needed, is_balanced=True)


class _Problem:
    """Linear programs of the pushes and of friction along generators of the cones."""

    def __init__(self, here: Configuration, met: Meetings) -> None:
        self._here, self._met = here, met
        fabric = here.fabric
        count, self._bodies = len(met.pairs), fabric.scene.body_count
        elastic, rubbed = here.touching, here.rubbing
        self._others = here.force.copy()
        for part in (elastic, rubbed):
            if part is not None:
                self._others -= part.wrench
        self._rub, self._corners = self._generators()
        # Rows: free freedoms, torques over a; all over the sum of the sizes of the forces.
        scale = np.ones((self._bodies, 6))
        scale[:, 3:] /= fabric.half_edge
        self._free, self._scale = fabric.free.ravel(), scale.ravel()
        size = float(np.linalg.norm(self._others[:, :3], axis=1).sum())
        self._force = max(size, here.force_scale) or 1.0
        columns = np.concatenate([met.wrenches[:, None], self._rub], axis=1)  # (p, 63, 12)
        of = np.where(met.pairs < 0, self._bodies, met.pairs)  # planes: rows that do not count
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
        Find wrenches (p, 62, 12) of 1 N of friction along the corners of each cone.

        And these corners (p, 62, 3): two directions along the surface, and the spin.
        """
        here, met = self._here, self._met
        normal, rubbed = met.normal, np.zeros((len(met.pairs), 4))
        if here.rubbing is not None:
            known = {pair: row for row, pair in enumerate(map(tuple, here.rubbing.pairs.tolist()))}
            for row, pair in enumerate(map(tuple, met.pairs.tolist())):
                if pair in known:
                    rubbed[row] = -here.rubbing.stretch[known[pair]]
        along = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        plane = np.stack([along, np.cross(normal, along)], axis=1)  # (p, 2, 3)
        elastic = np.concatenate(
            [np.einsum('pki,pi->pk', plane, rubbed[:, :3]), rubbed[:, 3:]], axis=1)
        elastic[~elastic.any(axis=1), 0] = 1.0
        # Columns of Q: the elastic direction and two across it.
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
        Find forces that leave as little as possible, with a coefficient of friction.

        Returns the sum of what is left over, as a ratio to the forces, and pushes and friction of
        each contact [N], (p, 63).
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
        cost[::width] = _PUSH_WEIGHT
        found = linprog(
            np.concatenate([cost, np.ones(2 * rows)]),
            A_ub=sparse.hstack([cone, sparse.csr_matrix((count, 2 * rows))]),
            b_ub=np.zeros(count),
            A_eq=sparse.hstack([matrix, sparse.identity(rows), -sparse.identity(rows)]),
            b_eq=wanted, bounds=[(0.0, _LARGEST_PUSH_RATIO)] * columns + [(0.0, None)] * 2 * rows,
            method='highs', options={
                'primal_feasibility_tolerance': 1e-10, 'dual_feasibility_tolerance': 1e-10})
        if found.x is None:
            raise RuntimeError(f'HiGHS found no contact forces: {found.message}')
        left = float(found.x[columns:].sum())
        return left, self._force * found.x[:columns].reshape(count, width)

    def least(self, low: float, high: float) -> float:
        """Find the least coefficient between two with which contacts hold; infinite: none."""
        if self.solve(high)[0] > _HELD_RATIO:
            return np.inf
        if self.solve(low)[0] <= _HELD_RATIO:
            return low
        while high - low > _MU_RATIO * high:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if self.solve(middle)[0] <= _HELD_RATIO else (middle, high)
        return high

    def answer(
        self, forces: np.ndarray, coefficient: float, needed: float, *, is_balanced: bool
    ) -> Admissible:
        """Put together what the forces (p, 63) do."""
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
