# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Part of a rank in a Lanczos iteration for the largest frequency (model/lanczos.py).

Vectors are stored with the bodies. For a product, a rank receives the 6 components of bodies of
blocks across its border, and moves their attachment points itself.
"""

import math

from icofabric_sim.kernels.frequency_bound import bound_of_blocks
from icofabric_sim.kernels.hessian import multiply_blocks
from icofabric_sim.kernels.lanczos import note_products, shift, subtract
from icofabric_sim.kernels.records import Model, State, Work
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.devices.rank_kernels import (
    divide_vectors,
    move_blocks,
    put_vectors,
    take_vectors,
    VECTOR,
)
from icofabric_sim.simulation.devices.transport import Transport
from icofabric_sim.simulation.devices.window import Exchange
from icofabric_sim.simulation.model.layout import aligned_empty, aligned_zeros
import numpy as np


class PartIteration:
    """Vectors of the bodies of a part, and their products."""

    def __init__(
        self, transport: Transport, model: Model, exchange: Exchange, state: State, work: Work
    ) -> None:
        """Prepare for a `state` with known attachment points, including those of the border."""
        self._transport, self._model, self._exchange = transport, model, exchange
        self._state, self._work = state, work
        self._gives, self._needs = (
            [(rank, slots, aligned_empty((VECTOR, LANES * len(slots)))) for rank, slots in pairs]
            for pairs in (exchange.gives, exchange.needs))
        slot_count = state.position.shape[1]
        # Slots that vectors pass over are read, too: they must hold numbers.
        self._previous, self._current, self._product = (
            aligned_zeros((VECTOR, slot_count)) for _ in range(3))
        self._moved, self._turns = aligned_zeros(work.points.shape), aligned_zeros((3, slot_count))
        self._own = np.ascontiguousarray(model.blocks.slot[exchange.first:exchange.last])
        self._sums = np.zeros(-(-(exchange.last - exchange.first) // work.group))
        self._roots = math.sqrt(model.inverse_mass), math.sqrt(model.inverse_inertia)

    def make_ready(self) -> None:
        """Compile or load the kernels, by calls without bodies."""
        model, state, none = self._model, self._state, np.zeros(0, np.int32)
        vector, values, sums = self._current, aligned_empty((VECTOR, 0)), np.zeros(0)
        given = model, state, self._work.points, self._moved, self._turns, *self._roots
        bound_of_blocks(model, state, self._work, 0, 0)
        take_vectors(vector, none, values)
        put_vectors(vector, none, values)
        divide_vectors(vector, none, 1.0)
        move_blocks(*given, vector, none)
        multiply_blocks(*given, model.supports, vector, self._product, 0, 0)
        note_products(model.blocks, vector, vector, sums, 1, 0, 0, 0)
        subtract(model.blocks, 0.0, vector, 0.0, vector, vector, sums, 1, 0, 0, 0)
        shift(model.blocks, 1.0, vector, vector, vector, 0, 0)

    @property
    def start(self) -> np.ndarray:
        """Rows (6, s) of the start vector."""
        return self._current

    def bound(self) -> np.ndarray:
        """Return an upper bound of the largest squared frequency [1/s^2] of its bodies, (1,)."""
        exchange = self._exchange
        return np.array([bound_of_blocks(
            self._model, self._state, self._work, exchange.first, exchange.last)])

    def square(self) -> np.ndarray:
        """Return the squares of the present vector, by groups of blocks."""
        self._note_products(self._current)
        return self._sums

    def begin(self, length: float) -> None:
        """Divide the first vector by its `length`."""
        divide_vectors(self._current, self._own, length)

    def multiply(self) -> np.ndarray:
        """Return the products of the present vector and its image by the Hessian, by groups."""
        model, state, points, exchange = (
            self._model, self._state, self._work.points, self._exchange)
        transport, vector = self._transport, self._current
        requests = [transport.receive_poses(values, rank) for rank, _, values in self._needs]
        for rank, slots, values in self._gives:
            take_vectors(vector, slots, values)
            requests.append(transport.send_poses(values, rank))
        given = model, state, points, self._moved, self._turns, *self._roots
        move_blocks(*given, vector, self._own)
        transport.wait(requests)
        for _, slots, values in self._needs:
            put_vectors(vector, slots, values)
            move_blocks(*given, vector, slots)
        multiply_blocks(
            *given, model.supports, vector, self._product, exchange.first, exchange.last)
        self._note_products(self._product)
        return self._sums

    def subtract(self, alpha: float, beta: float) -> np.ndarray:
        """
        Subtract `alpha` times the present and `beta` times the last vector; return the squares.
        """
        exchange = self._exchange
        subtract(
            self._model.blocks, alpha, self._current, beta, self._previous, self._product,
            self._sums, self._work.group, 0, len(self._sums), exchange.last)
        return self._sums

    def shift(self, factor: float) -> None:
        """Scale the remainder by a factor, as the next vector."""
        exchange = self._exchange
        shift(
            self._model.blocks, factor, self._previous, self._current, self._product,
            exchange.first, exchange.last)

    def _note_products(self, other: np.ndarray) -> None:
        note_products(
            self._model.blocks, self._current, other, self._sums, self._work.group, 0,
            len(self._sums), self._exchange.last)
