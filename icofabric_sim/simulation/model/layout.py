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
Where bodies lie in the arrays of kernels: the slots, and the blocks that are computed together.

In a weave the connectors of an edge lead in the same directions at every body. So where a step
to the next grid point is everywhere the same number of slots, the neighbours of neighbouring
bodies are neighbours too, and kernels can work on whole vectors without gathering.
"""

from dataclasses import dataclass, replace
from itertools import permutations
import math
from typing import NamedTuple

from icofabric_sim.geometry.rotations import (
    cosines_from_quaternions,
    quaternions_from_cosines,
    unit_quaternions,
)
from icofabric_sim.kernels.figures import figures_room, group_size
from icofabric_sim.kernels.law_tables import PIECE
from icofabric_sim.kernels.records import (
    Blocks,
    EDGE_COUNT,
    Kinks,
    LawTables,
    LINK_COUNT,
    Links,
    LINKS_PER_EDGE,
    Meter,
    State,
    Trail,
    Variety,
    Work,
)
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.scene.connector_laws import ConnectorLaws, ConnectorTables, NO_TABLES
from icofabric_sim.scene.initial import InitialState
import numpy as np

# Connectors that are entered at once: bounds the temporary arrays.
_PIECE = 1 << 18
_LINE = 64  # bytes
# Of a Runge-Kutta step and its dense output.
_SLOPE_COUNT = 16
_MOST_THREADS = 1024
# Blocks in which the roughness of the motion is judged; of larger fabrics a part.
_SAMPLES = 4096
# Slots for each body with which the first layout is taken.
_GOOD = 1.3
# Blocks more that shorter ways between neighbours are worth.
_CLOSER = 1.05


class _Places(NamedTuple):
    """A layout of the bodies of a weave."""

    slot: np.ndarray  # (n,) int64, from 0
    order: np.ndarray  # (n,) int64: grows along the fabric, equal for bodies computed close by
    row: np.ndarray  # (n,) int64, across the fabric: of one layer, what is side by side


def has_jumps(links: Links | None) -> bool:
    """Whether the slope of some tension jumps (eq 2), and none follows a table."""
    return links is not None and links.tables is None and links.variety is not None and not (
        np.array_equal(links.variety.extension, links.variety.compression))


def kinks_room(
    links: Links | None, slots: int, blocks: int, *, turns: int = 4
) -> Kinks | None:
    """
    Room for steps in which slopes jump; None where none does, or laws are by table.

    `turns`: numbers of an orientation.
    """
    if links is None or links.variety is None or not has_jumps(links):
        return None
    variety = links.variety

    def room(*shape: int) -> np.ndarray:
        return aligned_zeros(shape)

    return Kinks(
        extension=variety.extension, compression=variety.compression,
        natural_length=variety.natural_length, slope=room(12, slots), forces=room(48, slots),
        start=room(36, slots), active=np.zeros((blocks, 12), np.uint8),
        before=room(6, slots), rates=room(18 * slots), seconds=room(18 * slots),
        found=np.zeros(8 * _MOST_THREADS), ranges=np.zeros(8 * _MOST_THREADS),
        uniform=_uniform_law(links.variety), alike=np.zeros(2), margin=np.zeros(2),
        kept_position=room(3, slots), kept_orientation=room(turns, slots))


def _uniform_law(variety: Variety) -> np.ndarray:
    """k_e, k_c [N/m] and natural length [m] of all connectors; zeros where they differ."""
    laws = np.stack([rows.ravel() for rows in variety])
    # Zeros where there is no connector.
    laws = laws[:, laws.any(axis=0)]
    same = laws.shape[1] and np.array_equal(laws.min(axis=1), laws.max(axis=1))
    return laws[:, 0].copy() if same else np.zeros(3)


@dataclass(frozen=True)
class Layout:
    """Slots of the bodies, and which are computed together."""

    slot: np.ndarray  # (n,) int32, of each body
    slot_count: int  # length of the arrays
    blocks: Blocks
    cosines: bool  # orientations as direction cosines instead of quaternions
    rows: np.ndarray  # (2, b) int32, first and last row across the fabric of each block

    @property
    def body_count(self) -> int:
        """Count the bodies."""
        return len(self.slot)

    def block_of(self, bodies: np.ndarray) -> np.ndarray:
        """Index of the block of each body."""
        number = np.zeros(self.slot_count // LANES, np.int32)
        number[self.blocks.slot // LANES] = np.arange(len(self.blocks.slot), dtype=np.int32)
        return number[self.slot[bodies] // LANES]

    def spread(self, values: np.ndarray, *, empty: float = 0.0) -> np.ndarray:
        """
        Values of the bodies, (n, ...), as an array (..., s) with `empty` where there is no body.
        """
        spread = aligned_empty((*values.shape[1:], self.slot_count))
        spread[:] = empty
        spread[..., self.slot] = np.moveaxis(values, 0, -1)
        return spread

    def gather(self, values: np.ndarray) -> np.ndarray:
        """Values of the bodies, (n, ...), from an array (..., s)."""
        return np.ascontiguousarray(np.moveaxis(values[..., self.slot], -1, 0))

    def pack(self, initial: InitialState) -> State:
        """State for kernels from one of bodies; direction cosines from quaternions (eq 20)."""
        orientation = initial.orientation
        if self.cosines:
            orientation = cosines_from_quaternions(orientation)
        state = State(
            self.spread(initial.position),
            self.spread(orientation),
            self.spread(initial.linear_velocity),
            self.spread(initial.angular_velocity),
        )
        empty = np.ones(self.slot_count, dtype=bool)
        empty[self.slot] = False
        # A unit orientation, so that slots without a body compute with ordinary numbers.
        if self.cosines:
            state.orientation[..., empty] = np.eye(3)[:, :, None]
        else:
            state.orientation[3, empty] = 1.0
        return state

    def unpack(self, state: State) -> InitialState:
        """State of the bodies, with quaternions, from one of kernels."""
        orientation = self.gather(state.orientation)
        if self.cosines:
            orientation = quaternions_from_cosines(orientation)
        # Methods keep unit length to their own accuracy only.
        orientation = unit_quaternions(orientation)
        return InitialState(
            self.gather(state.position),
            orientation,
            self.gather(state.linear_velocity),
            self.gather(state.angular_velocity),
        )

    def room(
        self, links: Links | None, state: State | None = None, *, differences: int = 0,
        damped: bool = False, metered: bool = False
    ) -> Work:
        """
        Arrays for what follows from a state; with `state` also for Runge-Kutta methods.

        `differences`: order of the differences by which the roughness of the motion is judged.
        `damped`: with velocities of the attachment points; `metered`: with what is spent.
        """
        points = aligned_zeros((18 * self.slot_count if links is not None else 0,))
        acceleration = aligned_zeros((6, self.slot_count))
        trail = None
        if state is not None:
            slopes = aligned_zeros((_SLOPE_COUNT, self.slope_rows(state), self.slot_count))
            stage, start = self.like(state), self.like(state)
            for target in (stage, start):
                copy_state(state, target)
            trail = Trail(slopes, stage, start, *np.zeros((4, _MOST_THREADS)))
        rows = 12 if self.cosines else 7
        samples = min(len(self.blocks.slot), _SAMPLES) if differences else 0
        difference = aligned_empty((rows, LANES * samples))
        weights = np.array([
            (-1.0) ** k * math.comb(differences, k) for k in range(differences + 1)])
        speeds = aligned_zeros(points.shape if damped else (0,))
        spent = self.meter() if metered else None
        group = group_size(len(self.blocks.slot))
        return Work(
            points, acceleration, trail, None, difference, weights,
            figures_room(len(self.blocks.slot), group), group, speeds, spent, None, None)

    def kinks(self, links: Links | None) -> Kinks | None:
        """Room for steps in which slopes jump; None where none does, or laws are by table."""
        return kinks_room(
            links, self.slot_count, len(self.blocks.slot), turns=9 if self.cosines else 4)

    def meter(self) -> Meter:
        """Nothing has flowed yet."""
        return Meter(
            aligned_zeros((_SLOPE_COUNT, self.slot_count)), aligned_zeros((2, self.slot_count)))

    def like(self, state: State) -> State:
        """Room for another state."""
        return state._replace(**{
            name: aligned_empty(array.shape) for name, array in state._asdict().items()
            if array is not None})

    def slope_rows(self, state: State) -> int:
        """Count the rows of a slope of a `state`, see kernels/rhs.py."""
        return (18 if self.cosines else 13) + (0 if state.rest is None else LINK_COUNT)


def copy_state(source: State, target: State) -> None:
    """Copy a state into the room of another one."""
    for here, there in zip(source.rows(), target.rows()):
        np.copyto(there, here)


def copied_state(state: State) -> State:
    """Return a copy of a state."""
    return state._replace(**{
        name: array.copy() for name, array in state._asdict().items() if array is not None})


def aligned_empty(shape: tuple[int, ...]) -> np.ndarray:
    """Array of doubles that begins with a cache line, so that no block straddles two."""
    count = math.prod(shape)
    return _aligned(np.empty(count + _LINE // 8), shape)


def aligned_zeros(shape: tuple[int, ...]) -> np.ndarray:
    """The same of zeros; pages that are never written to take no memory."""
    count = math.prod(shape)
    return _aligned(np.zeros(count + _LINE // 8), shape)


def _aligned(room: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    start = -room.ctypes.data % _LINE // 8
    return room[start:start + math.prod(shape)].reshape(shape)


def make_layout(grid: np.ndarray, body_count: int, *, cosines: bool = False) -> Layout:
    """Lay out the bodies of a weave, at grid points (n, 3), and after them loose bodies."""
    parts = []
    if len(grid):
        parts.append(_best_places(grid.astype(np.int64)))
    loose = body_count - len(grid)
    if loose:
        number = np.arange(loose, dtype=np.int64)
        parts.append(_Places(number, number, np.zeros_like(number)))
    slots, orders = [], []
    # One block of room on either side: a vector may begin before the first body or end after the
    # last.
    next_slot, next_order = LANES, 0
    for part in parts:
        slots.append(part.slot + next_slot)
        orders.append(part.order + next_order)
        next_slot = _rounded_up(int(slots[-1].max()) + 1)
        next_order = int(orders[-1].max()) + 1
    slot = np.concatenate(slots) if slots else np.zeros(0, np.int64)
    order = np.concatenate(orders) if orders else np.zeros(0, np.int64)
    first, members = np.unique(slot - slot % LANES, return_inverse=True)
    # The block's place in the order is that of its first body.
    rank = np.full(len(first), np.iinfo(np.int64).max)
    np.minimum.at(rank, members, order)
    rows = np.zeros((2, len(first)), np.int32)
    if parts:
        row = np.concatenate([part.row for part in parts])
        rows[0] = row.max(initial=0)
        np.minimum.at(rows[0], members, row)
        np.maximum.at(rows[1], members, row)
    alive = np.zeros(len(first), np.uint8)
    np.bitwise_or.at(alive, members, (1 << (slot % LANES)).astype(np.uint8))
    by_order = np.lexsort((first, rank))
    slot_count = next_slot + LANES
    # Rows a whole number of pages apart would share few places of the cache.
    slot_count += LANES * (1 - slot_count // LANES % 2)
    return Layout(
        slot=slot.astype(np.int32),
        slot_count=slot_count,
        blocks=Blocks(first[by_order].astype(np.int32), alive[by_order], 0),
        cosines=cosines,
        rows=rows[:, by_order],
    )


def make_links(
    layout: Layout, grid: np.ndarray, bodies: np.ndarray, edges: np.ndarray, *,
    laws: ConnectorLaws, half_width: float, attachment: np.ndarray | None = None,
    tables: ConnectorTables = NO_TABLES
) -> tuple[Layout, Links]:
    """
    Tables of connectors, (c, 2) bodies and edge codes, by block; and the layout with their reach.

    Raises ValueError where connectors do not have the same direction at all bodies of a block.
    """
    # Where nothing is connected: the block's own edge across, which can be read.
    across = np.repeat(np.arange(EDGE_COUNT) ^ 1, LINKS_PER_EDGE)
    place = (layout.blocks.slot[:, None] + 3 * layout.slot_count * across).astype(np.int32)
    present = np.zeros(place.shape, np.uint8)
    block = layout.block_of(np.arange(layout.body_count, dtype=np.int32))
    if 18 * layout.slot_count > np.iinfo(np.int32).max:
        raise ValueError('too many bodies to number their attachment points with 32 bits')
    # Two connectors leave each edge, to either side of it; their direction says which is which.
    pieces = [
        (bodies[start:start + _PIECE, [end, 1 - end]], edges[start:start + _PIECE, [end, 1 - end]])
        for start in range(0, len(bodies), _PIECE) for end in range(2)]
    directions: list[set[int]] = [set() for _ in range(EDGE_COUNT)]
    for pair, codes in pieces:
        key = np.unique(codes[:, 0].astype(np.int64) * 100 + _direction(grid, pair))
        for edge, direction in zip((key + 50) // 100, (key + 50) % 100 - 50):
            directions[edge].add(int(direction))
    if max(map(len, directions)) > LINKS_PER_EDGE:
        raise ValueError(f'more than {LINKS_PER_EDGE} directions of connectors at one edge')
    side = np.zeros((EDGE_COUNT, 100), np.int8)
    for edge, seen in enumerate(directions):
        for number, direction in enumerate(sorted(seen)):
            side[edge, direction + 50] = number
    reach, start = 0, 0
    variety = None if laws.plain and not tables.tables else _no_laws(layout)
    packed, first_rows = _pack_tables(layout, tables)
    for number, (pair, codes) in enumerate(pieces):
        own, other = block[pair[:, 0]], block[pair[:, 1]]
        edge = codes[:, 0].astype(np.int64)
        link = LINKS_PER_EDGE * edge + side[edge, _direction(grid, pair) + 50]
        lane = layout.slot[pair[:, 0]] % LANES
        at = 3 * layout.slot_count * codes[:, 1].astype(np.int64)
        at += layout.slot[pair[:, 1]] - lane
        place[own, link] = at
        if not np.array_equal(place[own, link], at):
            raise ValueError('connectors of one block lead to places that are not side by side')
        np.bitwise_or.at(present, (own, link), (1 << lane).astype(np.uint8))
        reach = max(reach, int(np.abs(own - other).max()))
        if variety is not None:
            for rows, values in zip(variety, laws):
                rows[link, layout.slot[pair[:, 0]]] = values[start:start + len(pair)] if len(
                    values) > 1 else values
        if packed is not None:
            packed.first[link, layout.slot[pair[:, 0]]] = first_rows[
                tables.of[start:start + len(pair)]]
        # Each piece comes twice, seen from either end.
        start += len(pair) * (number % 2)
    links = Links(
        place, present, float(max(laws.extension.max(), laws.compression.max())),
        float(laws.natural_length.max()), half_width, attachment, variety,
        packed)
    blocks = layout.blocks._replace(reach=reach)
    return replace(layout, blocks=blocks), links


def _no_laws(layout: Layout) -> Variety:
    """Room for the laws of the connectors at each body; ordinary numbers where there is none."""
    rows = [aligned_zeros((LINK_COUNT, layout.slot_count)) for _ in range(3)]
    return Variety(*rows)


def _pack_tables(layout: Layout, tables: ConnectorTables) -> tuple[LawTables | None, np.ndarray]:
    """All tables in one, no connector with any; and the first rows of each, the last one -1."""
    if not tables.tables:
        return None, np.full(1, -1.0)
    counts = np.array([len(table.rows) for table in tables.tables])
    last = np.cumsum(counts) - 1
    rows = np.hstack([
        np.vstack([table.rows for table in tables.tables]), np.repeat(last, counts)[:, None]])
    first = aligned_empty((LINK_COUNT, layout.slot_count))
    first[:] = -1.0
    # No length lies above infinity: each connector looks its first piece up.
    pieces = aligned_empty((PIECE * LINK_COUNT * layout.slot_count,))
    pieces[:] = np.inf
    return LawTables(first, rows, pieces), np.append(last - counts + 1.0, -1.0)


def _direction(grid: np.ndarray, pair: np.ndarray) -> np.ndarray:
    """A number for the direction of each connector, between -13 and 13."""
    return (grid[pair[:, 1]] - grid[pair[:, 0]]) @ np.array([9, 3, 1], grid.dtype)


def _best_places(grid: np.ndarray) -> _Places:
    """
    The layout with the fewest blocks: rows end to end, or each in blocks of its own.

    Rows end to end suit slabs, whose rows are all alike. In fabrics cut along other directions
    rows begin and end anywhere, and so would the neighbours of a block.
    """
    candidates = []
    if _is_compact(grid):
        woven, flat = _woven_places(grid), _flat_places(grid)
        # Neighbours lie closer together in the first.
        best = woven if _block_count(woven) <= _CLOSER * _block_count(flat) else flat
        if _block_count(best) * LANES <= _GOOD * len(grid):
            return best
        candidates = [woven, flat]
    candidates += [_row_places(grid, axis) for axis in range(3)]
    return min(candidates, key=_block_count)


def _block_count(places: _Places) -> int:
    return int(np.count_nonzero(np.bincount(places.slot // LANES)))


def _is_compact(grid: np.ndarray) -> bool:
    """Whether the grid points fill at least a third of the box around them."""
    extent = np.ptp(grid, axis=0) + 1
    return bool(np.prod(extent.astype(float)) <= 6.0 * len(grid) + 1000.0)


def _subgrid(grid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number 0-3 of the cubic grid of each point, and its cell in that grid (n, 3)."""
    cell = grid - grid.min(axis=0)
    return (cell[:, 0] & 1) + 2 * (cell[:, 1] & 1), cell >> 1


def _woven_places(grid: np.ndarray) -> _Places:
    # The points of a weave are every second one of a grid, x + y + z of one parity. With rows and
    # layers of odd length these are every second number too, and half of it is the slot.
    cell = grid - grid.min(axis=0)
    extent = cell.max(axis=0) + 1

    def length(order: tuple[int, ...]) -> tuple[int, int]:
        fast, middle, slow = order
        layer = int((extent[fast] | 1) * (extent[middle] | 1))
        return layer * int(extent[slow]), layer  # short layers keep neighbours close

    fast, middle, slow = min(permutations(range(3)), key=length)
    row = int(extent[fast]) | 1
    layer = row * (int(extent[middle]) | 1)
    slot = (cell[:, slow] * layer + cell[:, middle] * row + cell[:, fast]) >> 1
    return _Places(slot, slot, cell[:, middle])


def _flat_places(grid: np.ndarray) -> _Places:
    # Or as four interleaved cubic grids, which suits fabrics of an even number of rows. All grids
    # have cells for the whole box, so that a step to a neighbour is the same number of slots
    # everywhere.
    number, cell = _subgrid(grid)
    extent = cell.max(axis=0) + 1
    fast, middle = (0, 1) if extent[0] >= extent[1] else (1, 0)
    flat = (cell[:, 2] * extent[middle] + cell[:, middle]) * extent[fast] + cell[:, fast]
    # z's parity follows from x's and y's within one weave.
    room = _rounded_up(int(flat.max()) + 1)
    return _Places(number * room + flat, flat, cell[:, middle])


def _row_places(grid: np.ndarray, axis: int) -> _Places:
    # Rows along an axis, each beginning with a block of its own; gaps within a row stay empty.
    number, cell = _subgrid(grid)
    others = [k for k in range(3) if k != axis]
    spread = cell.max(axis=0) + 1
    row = (cell[:, others[1]] * spread[others[0]] + cell[:, others[0]]) * 4 + number
    rows, member = np.unique(row, return_inverse=True)
    first = np.full(len(rows), np.iinfo(np.int64).max)
    np.minimum.at(first, member, cell[:, axis])
    last = np.full(len(rows), -1)
    np.maximum.at(last, member, cell[:, axis])
    blocks = (last - first + LANES) // LANES
    start = np.concatenate([[0], np.cumsum(blocks)[:-1]]) * LANES
    slot = start[member] + cell[:, axis] - first[member]
    return _Places(slot, slot, cell[:, others[0]])


def _rounded_up(count: int) -> int:
    return -(-count // LANES) * LANES
