# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The sparse matrix of an implicit step, for changes of velocities, and its factors.

A body and its neighbours lie on 13 points of a face-centred cubic lattice, and the number (x + 3 y
+ 4 z) mod 13 of a grid point is different for all of them. So 13 times 6 products with vectors
that are 1 at all bodies of one number give the whole matrix, of any fabric. Contacts are added
pair by pair.
"""

from typing import Any, NamedTuple

from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.kernels.integrators.diagonal import assemble, tangent_springs
from icofabric_sim.kernels.records import Model, State
from icofabric_sim.simulation.contact.pair_forces import PairForces
from icofabric_sim.simulation.model.layout import aligned_zeros
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.terms.shared import LINK_COUNT, Variety
import numpy as np

_COLOURS, _STEPS = 13, np.array([1, 3, 4])
# Cached sparsity patterns, each of other pairs in contact.
_CACHED_PATTERN_COUNT = 4


class VelocityMatrix:
    """
    The matrix 1 + M^-1/2 (g^2 H + g C) M^-1/2 of a fabric in a configuration.

    H is the second derivative of the energy, C the derivative of damping and drag forces by
    velocities. Rows and columns are the six degrees of freedom of each body, body by body. Rows of
    held degrees of freedom and of driven bodies are those of the unit matrix.
    """

    def __init__(self, packed: PackedScene, grid: np.ndarray, held: np.ndarray) -> None:
        """
        Find the connected bodies, with the `grid` (g, 3) of the woven bodies.

        `held` (n, 6) are supported degrees of freedom, and all those of driven bodies.
        """
        self._model, self._slot = packed.model, packed.layout.slot
        count = packed.layout.body_count
        self._colour = np.zeros(count, np.int64)
        self._colour[:len(grid)] = grid.astype(np.int64) @ _STEPS % _COLOURS
        partner = np.full((_COLOURS, count), -1, np.int64)
        if packed.connectors is not None:
            ends = packed.connectors.first, packed.connectors.second
            for own, other in (ends, ends[::-1]):
                partner[self._colour[other], own] = other
        partner[self._colour, np.arange(count)] = np.arange(count)
        # Blocks by rows of bodies, as block sparse rows have them.
        rows, colours = np.nonzero((partner >= 0).T)
        columns = partner[colours, rows]
        order = np.lexsort((columns, rows))
        self._rows, self._columns, colours = rows[order], columns[order], colours[order]
        self._pair = np.full((_COLOURS, count), -1, np.int64)
        self._pair[colours, self._rows] = np.arange(len(rows))
        self._joined = np.zeros((len(rows), 6, 6))
        self._free = np.where(held, 0.0, 1.0)
        # [1/kg] and [1/(kg m^2)] of each freedom.
        self._inverse = 1.0 / freedom_masses(packed)
        self._forces = None if packed.contact is None else PairForces(packed.contact)
        self._patterns: dict[bytes, _Pattern] = {}
        slots = packed.layout.slot_count

        def room(*shape: int) -> np.ndarray:
            array = aligned_zeros(shape)
            return array

        self._slopes, self._rest = room(LINK_COUNT, slots), room(LINK_COUNT, slots)
        self._moved, self._turns = room(18 * slots), room(3, slots)
        self._vector, self._product = room(6, slots), room(6, slots)

    def factors(
        self, model: Model, state: State, points: np.ndarray, g: float
    ) -> 'Factors | None':
        """
        Return the factors for a time `g` [s] in a configuration; None if the matrix is singular.

        `points` are the attachment points in this configuration.
        """
        from scipy.sparse.linalg import splu

        tangent_springs(
            model.links, model.damping, model, points, state.position.shape[1], g, self._slopes,
            self._rest)
        root_m, root_i = np.sqrt(model.inverse_mass), np.sqrt(model.inverse_inertia)
        assemble(
            self._tangent(model, g), state, points, self._moved, self._turns, root_m, root_i,
            self._colour, self._slot, self._pair, self._vector, self._product, self._joined)
        touching, pushed = self._touching(state)
        pattern = self._pattern(touching)
        blocks = np.zeros((len(pattern.rows), 6, 6))
        blocks[:len(self._joined)] = self._joined
        root = g * np.sqrt(self._inverse)
        for one, other in np.ndindex(2, 2) if len(touching) else ():
            part = pushed[:, 6 * one:6 * one + 6, 6 * other:6 * other + 6]
            np.add.at(
                blocks, pattern.touching[:, one, other],
                root[touching[:, one], :, None] * part * root[touching[:, other], None])
        blocks *= self._free[pattern.rows][:, :, None] * self._free[pattern.columns][:, None]
        own = blocks[pattern.own]
        own[:, range(6), range(6)] += 1.0
        if model.drag is not None:
            own[:, range(3), range(3)] += g * model.drag.linear * self._inverse[:, :3]
            own[:, range(3, 6), range(3, 6)] += g * model.drag.angular * self._inverse[:, 3:]
        blocks[pattern.own] = own
        matrix = pattern.matrix
        matrix.data[:] = blocks.ravel()[pattern.places]
        try:
            return Factors(splu(
                matrix, permc_spec='NATURAL', diag_pivot_thresh=0.0,
                options={'SymmetricMode': True}), pattern.order)
        except RuntimeError:
            return None

    def _touching(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Return pairs of bodies in contact (m, 2), and second derivatives (m, 12, 12)."""
        forces = self._forces
        if forces is None:
            return np.zeros((0, 2), np.int64), np.zeros((0, 12, 12))
        position = state.position[:, self._slot].T
        if state.orientation.ndim == 2:
            axes = cosines_from_quaternions(state.orientation[:, self._slot].T)
        else:
            axes = np.moveaxis(state.orientation[:, :, self._slot], 2, 0)
        touching, pushed = forces.blocks(
            forces.near(position), forces.near_planes(position), position, axes)
        # Factors must not depend on the order of the candidate pairs.
        order = np.lexsort((touching[:, 1], touching[:, 0]))
        return touching[order], pushed[order]

    def _pattern(self, touching: np.ndarray) -> '_Pattern':
        """Return the sparsity pattern of the matrix with contacts of pairs of bodies (m, 2)."""
        key = touching.tobytes()
        if key not in self._patterns:
            if len(self._patterns) >= _CACHED_PATTERN_COUNT:
                del self._patterns[next(iter(self._patterns))]
            self._patterns[key] = _pattern_of(
                self._rows, self._columns, touching, len(self._slot))
        return self._patterns[key]

    def _tangent(self, model: Model, g: float) -> Model:
        """
        Return the model with tangent springs of a stage, and moments scaled by the same factor.
        """
        part, links = g * g, model.links
        if links is not None:
            links = links._replace(
                variety=Variety(self._slopes, self._slopes, self._rest), laws=None)

        def weaker(moment: Any) -> Any:
            return None if moment is None else moment._replace(
                stiffness=part * moment.stiffness,
                variety=None if moment.variety is None else part * moment.variety)

        return model._replace(
            links=links, bending=weaker(model.bending), twisting=weaker(model.twisting))


class Factors:
    """Factors of a matrix, in an elimination order."""

    def __init__(self, factors: Any, order: np.ndarray) -> None:
        """Store factors of SciPy, whose row k is row order[k] of the matrix."""
        self._factors, self._order = factors, order

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Return the solution (m,) of the system for a vector (m,)."""
        result = np.empty_like(right)
        result[self._order] = self._factors.solve(right[self._order])
        return result


def freedom_masses(packed: PackedScene) -> np.ndarray:
    """Return the mass [kg] or inertia [kg m^2] of the six degrees of freedom of bodies, (n, 6)."""
    own = np.broadcast_to(
        np.column_stack([packed.masses.mass, packed.masses.inertia]),
        (packed.layout.body_count, 2))
    return np.repeat(own, 3, axis=1)


class _Pattern(NamedTuple):
    """Sparsity pattern of a matrix of blocks."""

    rows: np.ndarray  # (p,) bodies of its blocks
    columns: np.ndarray
    own: np.ndarray  # (n,) indices of the diagonal blocks
    touching: np.ndarray  # (m, 2, 2) indices of the blocks of each pair in contact
    order: np.ndarray  # (6 n,) of elimination
    matrix: Any  # in this order
    places: np.ndarray  # where its entries are among the numbers of the blocks


def _pattern_of(
    rows: np.ndarray, columns: np.ndarray, touching: np.ndarray, count: int
) -> _Pattern:
    """
    Return the pattern of blocks at `rows` and `columns`, and at contacts (m, 2) of `count` bodies.
    """
    first, second = np.repeat(touching, 2, axis=1), np.tile(touching, 2)
    wanted = (count * first + second).ravel()
    present = count * rows + columns
    further = np.setdiff1d(wanted, present)
    keys = np.concatenate([present, further])
    rows, columns = keys // count, keys % count
    order = np.argsort(keys)
    places = order[np.searchsorted(keys, wanted, sorter=order)].reshape(-1, 2, 2)
    elimination, (matrix, entries) = _elimination(rows, columns, count)
    return _Pattern(
        rows, columns, np.flatnonzero(rows == columns), places, elimination, matrix, entries)


def _elimination(
    rows: np.ndarray, columns: np.ndarray, count: int
) -> tuple[np.ndarray, tuple[Any, np.ndarray]]:
    """
    Return an elimination order by minimum degree, and the matrix in it with its sources.

    Blocks of six degrees of freedom are at `rows` and `columns` of bodies. Sources are indices
    into the blocks (p, 6, 6).
    """
    from scipy import sparse
    from scipy.sparse.linalg import splu

    # By bodies: the freedoms of a body have the same neighbours and stay together.
    graph = sparse.csc_matrix((np.ones(len(rows)), (rows, columns)), shape=(count, count))
    degree = sparse.diags(np.asarray(graph.sum(axis=1)).ravel() + 1.0)
    order = splu(
        sparse.csc_matrix(degree - 0.5 * graph), permc_spec='MMD_AT_PLUS_A',
        diag_pivot_thresh=0.0, options={'SymmetricMode': True}).perm_c
    place = np.empty(count, np.int64)
    place[np.argsort(order)] = np.arange(count)
    bodies = np.argsort(place)
    freedoms = (6 * bodies[:, None] + np.arange(6)).ravel()
    number = np.arange(36 * len(rows), dtype=np.float64).reshape(-1, 6, 6)
    own = np.arange(6)
    down = np.broadcast_to(6 * place[rows][:, None, None] + own[:, None], number.shape)
    along = np.broadcast_to(6 * place[columns][:, None, None] + own, number.shape)
    # 0 would be an entry like any other: numbers begin at 1.
    matrix = sparse.csc_matrix(
        (number.ravel() + 1.0, (down.ravel(), along.ravel())), shape=(6 * count, 6 * count))
    matrix.sort_indices()
    return freedoms, (matrix, matrix.data.astype(np.int64) - 1)
