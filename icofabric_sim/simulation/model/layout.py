# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Layout of bodies in the arrays of kernels: slots, and blocks of slots that are computed together.

In a weave, the connectors of an edge lead in the same directions at every body. If a step to the
next grid point is the same number of slots everywhere, the neighbours of adjacent bodies are
adjacent, too. Kernels can then use whole vectors without gathering.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import permutations
import math
from typing import Any, NamedTuple

from icofabric_sim.geometry.rotations import (
    cosines_from_quaternions,
    quaternions_from_cosines,
    unit_quaternions,
)
from icofabric_sim.kernels.figures import figures_room, group_size
from icofabric_sim.kernels.integrators.tableau import SLOPE_COUNT
from icofabric_sim.kernels.records import Blocks, Links, State, Trail, Work
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.scene.connector_laws import (
    ConnectorCurves,
    ConnectorLaws,
    NAMED_LAWS,
    NO_CURVES,
)
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.scene.weave_connect import Connections
from icofabric_sim.terms.laws import Laws
from icofabric_sim.terms.links.kinks import Kinks
from icofabric_sim.terms.meters import Meter
from icofabric_sim.terms.shared import EDGE_COUNT, LINK_COUNT, LINKS_PER_EDGE, Variety
from icofabric_sim.terms.tables.law import HEAD_SIZE, ROW_SIZE
from icofabric_sim.terms.tables.record import Tables
import numpy as np

# Bodies or connectors of a batch: bounds the temporary arrays.
_BATCH_SIZE = 1 << 18
_CACHE_LINE_BYTES = 64
_MAX_THREADS = 1024


@dataclass(frozen=True)
class LayoutSettings:
    """Tunables of layouts and of the arrays for kernels."""

    roughness_blocks: int = 4096  # most blocks that sample the roughness of the motion
    accepted_slots_per_body: float = 1.3  # the first layout with fewer slots is used
    # Ratio of the numbers of blocks up to which the layout with closer neighbours is preferred.
    closer_block_ratio: float = 1.05
    # Bins of a table: its closest points determine the number, but at least and, of short
    # tables, at most these counts.
    min_bins: int = 64
    max_bins: int = 4096


_SETTINGS = LayoutSettings()


class _Places(NamedTuple):
    """Slots and order of the bodies of a weave; int32."""

    slot: np.ndarray  # (n,) from 0
    order: np.ndarray  # (n,) order along the fabric, equal for bodies computed together
    row: np.ndarray  # (n,) row across the fabric, of bodies side by side in a layer


def has_jumps(links: Links | None) -> bool:
    """Return True if a tension has a slope that jumps (eq 2) and no law is tabulated."""
    return not has_tables(links) and links is not None and links.variety is not None and not (
        np.array_equal(links.variety.extension, links.variety.compression))


def has_tables(links: Links | None) -> bool:
    """Return True if a law is tabulated, so that its slope has corners."""
    return links is not None and links.laws is not None and links.laws.tables is not None


def kinks_room(
    links: Links | None, slots: int, blocks: int, *, turns: int = 4
) -> Kinks | None:
    """
    Allocate arrays for steps across jumps of slopes; None without jumps or with tabulated laws.

    `turns` is the number of values of an orientation.
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
        found=np.zeros(8 * _MAX_THREADS), ranges=np.zeros(8 * _MAX_THREADS),
        uniform=_uniform_law(links.variety), alike=np.zeros(2), margin=np.zeros(3),
        kept_position=room(3, slots), kept_orientation=room(turns, slots))


def _uniform_law(variety: Variety) -> np.ndarray:
    """Return k_e, k_c [N/m] and natural length [m] if all connectors share them; else zeros."""
    laws = np.stack([rows.ravel() for rows in variety])
    # Zeros where there is no connector.
    laws = laws[:, laws.any(axis=0)]
    same = laws.shape[1] and np.array_equal(laws.min(axis=1), laws.max(axis=1))
    return laws[:, 0].copy() if same else np.zeros(3)


@dataclass(frozen=True)
class Layout:
    """Slots of the bodies, and the blocks of slots that are computed together."""

    slot: np.ndarray  # (n,) int32, of each body
    slot_count: int  # length of the arrays
    blocks: Blocks
    cosines: bool  # orientations as direction cosines instead of quaternions
    rows: np.ndarray  # (2, b) int32, first and last row across the fabric of each block
    carriers: np.ndarray  # (p,) int32 slots of carriers of planes, see terms/platens

    @property
    def body_count(self) -> int:
        """Number of bodies."""
        return len(self.slot)

    def block_of(self, bodies: np.ndarray) -> np.ndarray:
        """Return the index of the block of each body."""
        return self.block_at(self.slot[bodies])

    def block_at(self, slots: np.ndarray) -> np.ndarray:
        """Return the index of the block of each slot."""
        number = np.zeros(self.slot_count // LANES, np.int32)
        number[self.blocks.slot // LANES] = np.arange(len(self.blocks.slot), dtype=np.int32)
        return number[slots // LANES]

    @property
    def moving_slots(self) -> np.ndarray:
        """Slots of bodies, then carriers of planes."""
        return np.concatenate([self.slot, self.carriers]) if len(self.carriers) else self.slot

    @property
    def carried(self) -> np.ndarray | None:
        """Lanes of carriers by slots over LANES, uint8; None without carriers."""
        if not len(self.carriers):
            return None
        lanes = np.zeros(self.slot_count // LANES, np.uint8)
        np.bitwise_or.at(
            lanes, self.carriers // LANES, (1 << self.carriers % LANES).astype(np.uint8))
        return lanes

    def spread(self, values: np.ndarray, *, empty: float = 0.0) -> np.ndarray:
        """
        Return values of the bodies, (n, ...), as an array (..., s), `empty` where no body is.
        """
        spread = aligned_empty((*values.shape[1:], self.slot_count))
        spread[:] = empty
        spread[..., self.slot] = np.moveaxis(values, 0, -1)
        return spread

    def gather(self, values: np.ndarray) -> np.ndarray:
        """Return values of the bodies, (n, ...), from an array (..., s)."""
        return np.ascontiguousarray(np.moveaxis(values[..., self.slot], -1, 0))

    def gather_moving(self, values: np.ndarray) -> np.ndarray:
        """Return values of bodies, then carriers of planes, as `gather`."""
        return np.ascontiguousarray(np.moveaxis(values[..., self.moving_slots], -1, 0))

    def pack(self, initial: InitialState) -> State:
        """Return the state for kernels from that of the bodies; direction cosines follow eq 20."""
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
        """Return the state of the bodies, with quaternions, from that of kernels."""
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
        Allocate the work arrays of a state; with `state` also those of Runge-Kutta methods.

        `differences` is the order of the differences that measure the roughness of the motion.
        `damped` adds velocities of the attachment points, `metered` the dissipated energy.
        """
        points = aligned_zeros((18 * self.slot_count if links is not None else 0,))
        acceleration = aligned_zeros((6, self.slot_count))
        trail = None
        if state is not None:
            slopes = aligned_zeros((SLOPE_COUNT, self.slope_rows(state), self.slot_count))
            stage, start = self.like(state), self.like(state)
            for target in (stage, start):
                copy_state(state, target)
            trail = Trail(slopes, stage, start, *np.zeros((4, _MAX_THREADS)))
        rows = 12 if self.cosines else 7
        samples = min(len(self.blocks.slot), _SETTINGS.roughness_blocks) if differences else 0
        difference = aligned_empty((rows, LANES * samples))
        weights = np.array([
            (-1.0) ** k * math.comb(differences, k) for k in range(differences + 1)])
        speeds = aligned_zeros(points.shape if damped else (0,))
        spent = self.meter() if metered else None
        group = group_size(len(self.blocks.slot))
        return Work(
            points, acceleration, difference, weights,
            figures_room(len(self.blocks.slot), group), group, speeds, spent, given=None,
            trail=trail, breakage=None, external=None)

    def kinks(self, links: Links | None) -> Kinks | None:
        """Allocate arrays for steps across jumps of slopes, as `kinks_room`."""
        return kinks_room(
            links, self.slot_count, len(self.blocks.slot), turns=9 if self.cosines else 4)

    def meter(self) -> Meter:
        """Return a meter of dissipated energy that reads zero."""
        return Meter(
            aligned_zeros((SLOPE_COUNT, self.slot_count)), aligned_zeros((2, self.slot_count)))

    def like(self, state: State) -> State:
        """Allocate another state of the same shapes."""
        return state._replace(**{
            name: aligned_empty(array.shape) for name, array in state._asdict().items()
            if array is not None})

    def slope_rows(self, state: State) -> int:
        """Return the number of rows of a slope of `state`, see kernels/rhs.py."""
        return (18 if self.cosines else 13) + (0 if state.rest is None else LINK_COUNT)


def copy_state(source: State, target: State) -> None:
    """Copy the arrays of a state into those of another state."""
    for here, there in zip(source.rows(), target.rows()):
        np.copyto(there, here)


def copied_state(state: State) -> State:
    """Return a copy of a state."""
    return state._replace(**{
        name: array.copy() for name, array in state._asdict().items() if array is not None})


def aligned_empty(shape: tuple[int, ...]) -> np.ndarray:
    """
    Return an array of doubles that starts at a cache line, so that no block straddles two lines.
    """
    count = math.prod(shape)
    return _aligned(np.empty(count + _CACHE_LINE_BYTES // 8), shape)


def aligned_zeros(shape: tuple[int, ...]) -> np.ndarray:
    """Return zeros that start at a cache line; pages that are never written to use no memory."""
    count = math.prod(shape)
    return _aligned(np.zeros(count + _CACHE_LINE_BYTES // 8), shape)


def _aligned(room: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    start = -room.ctypes.data % _CACHE_LINE_BYTES // 8
    return room[start:start + math.prod(shape)].reshape(shape)


def make_layout(
    grid: np.ndarray, body_count: int, *, cosines: bool = False, carriers: int = 0
) -> Layout:
    """
    Lay out the bodies of a weave at grid points (n, 3), followed by loose bodies.

    The last blocks are those of `carriers` of planes.
    """
    parts = []
    if len(grid):
        parts.append(_best_places(grid))
    loose = body_count - len(grid)
    if loose:
        number = np.arange(loose, dtype=np.int32)
        parts.append(_Places(number, number, np.zeros_like(number)))
    # One block of room on either side: a vector may begin before the first body or end after the
    # last.
    next_slot, next_order, slots, orders, rows = LANES, 0, [], [], []
    for slot, order, row in parts:
        slots.append(slot + np.int32(next_slot))
        orders.append(order + np.int32(next_order))
        rows.append(row)
        next_slot = _rounded_up(int(slots[-1].max()) + 1)
        next_order = int(orders[-1].max()) + 1
    slot, order, row = (_joined(arrays) for arrays in (slots, orders, rows))
    used = np.zeros(next_slot // LANES, bool)
    for piece in pieces(body_count):
        used[slot[piece] // LANES] = True
    first = LANES * np.flatnonzero(used)
    # The block of each run of slots.
    number = np.cumsum(used, dtype=np.int32) - np.int32(1)
    # The block's place in the order is that of its first body.
    rank = np.full(len(first), np.iinfo(np.int64).max)
    across = np.zeros((2, len(first)), np.int32)
    across[0] = row.max(initial=0)
    alive = np.zeros(len(first), np.uint8)
    for piece in pieces(body_count):
        members = number[slot[piece] // LANES]
        np.minimum.at(rank, members, order[piece])
        np.minimum.at(across[0], members, row[piece])
        np.maximum.at(across[1], members, row[piece])
        np.bitwise_or.at(alive, members, (1 << (slot[piece] % LANES)).astype(np.uint8))
    by_order = np.lexsort((first, rank))
    carrying = next_slot + np.arange(carriers, dtype=np.int32)
    carrier_blocks = np.unique(carrying // LANES * LANES)
    slot_count = next_slot + LANES * len(carrier_blocks) + LANES
    # Rows a whole number of pages apart would share few places of the cache.
    slot_count += LANES * (1 - slot_count // LANES % 2)
    return Layout(
        slot=slot,
        slot_count=slot_count,
        blocks=Blocks(
            np.append(first[by_order], carrier_blocks).astype(np.int32),
            np.append(alive[by_order], np.zeros_like(carrier_blocks, np.uint8)), 0),
        cosines=cosines,
        rows=np.pad(across[:, by_order], ((0, 0), (0, len(carrier_blocks)))),
        carriers=carrying.astype(np.int32),
    )


def _joined(arrays: list[np.ndarray]) -> np.ndarray:
    if len(arrays) == 1:
        return arrays[0]
    return np.concatenate([np.zeros(0, np.int32), *arrays])


def pieces(count: int) -> Iterator[slice]:
    """Yield slices of bodies or connectors that keep temporary arrays small."""
    for start in range(0, count, _BATCH_SIZE):
        yield slice(start, start + _BATCH_SIZE)


def make_links(
    layout: Layout, grid: np.ndarray, connections: Connections, *, laws: ConnectorLaws,
    half_width: float, attachment: np.ndarray | None = None, curves: ConnectorCurves = NO_CURVES
) -> tuple[Layout, Links]:
    """
    Return the layout with the reach of its links, and the tables of connectors by block.

    Raises ValueError if connectors of a block differ in direction.
    """
    # Unused links: the opposite edge of the block, which can be read.
    across = np.repeat(np.arange(EDGE_COUNT) ^ 1, LINKS_PER_EDGE)
    place = (layout.blocks.slot[:, None] + 3 * layout.slot_count * across).astype(np.int32)
    present = np.zeros(place.shape, np.uint8)
    block = layout.block_of(np.arange(layout.body_count, dtype=np.int32))
    if 18 * layout.slot_count > np.iinfo(np.int32).max:
        raise ValueError('too many bodies to number their attachment points with 32 bits')
    side, reach = _sides(grid, connections), 0
    variety = None if laws.is_single_linear_spring and not curves.curves else _no_laws(layout)
    records, by_connector = _empty_laws(layout, curves)
    for piece, pair, codes in _from_either_end(connections):
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
                rows[link, layout.slot[pair[:, 0]]] = values[piece] if len(values) > 1 else values
        for rows, of_connector in by_connector:
            rows[link, layout.slot[pair[:, 0]]] = of_connector[piece]
    links = Links(
        place, present, float(max(laws.extension.max(), laws.compression.max())),
        float(laws.natural_length.max()), half_width, attachment, variety,
        Laws(**records) if records else None)
    blocks = layout.blocks._replace(reach=reach)
    return replace(layout, blocks=blocks), links


def _sides(grid: np.ndarray, connections: Connections) -> np.ndarray:
    """
    Return which of the two connectors of an edge leads in a direction, (6, 100).

    Indices are the edge, and the direction plus 50. Two connectors leave each edge, one to either
    side; the direction distinguishes them.
    """
    directions: list[set[int]] = [set() for _ in range(EDGE_COUNT)]
    for _, pair, codes in _from_either_end(connections):
        key = np.bincount(codes[:, 0].astype(np.int64) * 100 + _direction(grid, pair) + 50)
        for edge, direction in zip(*divmod(np.flatnonzero(key), 100)):
            directions[edge].add(int(direction))
        if min(map(len, directions)) == LINKS_PER_EDGE:
            # No weave has more directions.
            break
    if max(map(len, directions)) > LINKS_PER_EDGE:
        raise ValueError(f'more than {LINKS_PER_EDGE} directions of connectors at one edge')
    side = np.zeros((EDGE_COUNT, 100), np.int8)
    for row, seen in zip(side, directions):
        row[sorted(seen)] = np.arange(len(seen))
    return side


def _from_either_end(
    connections: Connections
) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
    """
    Yield batches of connectors, (m, 2) bodies and edges, seen from the first and the second end.
    """
    for piece, (bodies, edges) in connections.pieces():
        for ends in ([0, 1], [1, 0]):
            yield piece, bodies[:, ends], edges[:, ends]


def _no_laws(layout: Layout) -> Variety:
    """Allocate the laws of the connectors at each body, with finite values at unused links."""
    rows = [aligned_zeros((LINK_COUNT, layout.slot_count)) for _ in range(3)]
    return Variety(*rows)


def _empty_laws(
    layout: Layout, curves: ConnectorCurves
) -> tuple[dict[str, Any], list[tuple[np.ndarray, np.ndarray]]]:
    """
    Allocate the records of laws that replace springs.

    The second result has pairs of rows (12, s) and the values of each connector (c,) for them.
    """
    records: dict[str, Any] = {}
    by_connector = []
    if curves.tables:
        number = aligned_empty((LINK_COUNT, layout.slot_count))
        number[:] = -1.0
        records['tables'] = _pack_tables(curves, number)
        by_connector.append((number, curves.table_of))
    for name in {curve.law for curve in curves.curves} & {*NAMED_LAWS}:
        values = NAMED_LAWS[name].module('curve').rows([
            curve if curve.law == name else None for curve in curves.curves])
        rows = {field: aligned_zeros((LINK_COUNT, layout.slot_count)) for field in values}
        records[name] = NAMED_LAWS[name].record(**rows)
        by_connector += [
            (rows[field], np.append(of_curve, 0.0)[curves.of])
            for field, of_curve in values.items()]
    return records, by_connector


def _pack_tables(curves: ConnectorCurves, number: np.ndarray) -> Tables:
    """Join all tables of laws; `number` (12, s) is that of the table of each connector."""
    heads = np.zeros((len(curves.tables), HEAD_SIZE))
    bins, row_count, bin_count = [], 0, 0
    for head, table in zip(heads, curves.tables):
        length = table.rows[1:, 0]
        extent = length[-1] - length[0]
        # Bounds a bin apart at least, and never at the side of one.
        count = np.ceil(1.01 * extent / np.diff(length).min())
        most = max(_SETTINGS.max_bins, 4 * len(length))
        width = extent / np.clip(count, _SETTINGS.min_bins, most)
        head[:2] = length[0] - 0.5 * width, 1.0 / width
        head[3:6] = bin_count, row_count, row_count + len(length)
        # As kernels do; the last bin holds all longer lengths.
        place = np.floor(bin_count + (length - head[0]) * head[1]).astype(np.int64) - bin_count
        head[2] = place[-1] + 1
        own = np.arange(place[-1] + 2)
        below = np.searchsorted(place, own)  # bounds in lower bins
        inside = np.searchsorted(place, own, side='right') - below
        single = (inside < 2) & (own > place[0]) & (own < place[-1])
        bound = np.where(inside == 1, length[np.minimum(below, len(length) - 1)], np.inf)
        bins.append(np.column_stack([np.where(single, bound, -1.0), row_count + below]))
        row_count, bin_count = row_count + len(table.rows), bin_count + len(own)
    # Lanes without a connector read one row more beyond the last table.
    rows = np.zeros((row_count + 1, ROW_SIZE))
    rows[:-1, :7] = np.vstack([table.rows for table in curves.tables])
    return Tables(
        number, rows.ravel(), heads.ravel(), np.vstack(bins).ravel(),
        len(heads) == 1 and not curves.of.any(), np.full(number.size >> 2, -1, np.int32),
        np.zeros(1))


def _direction(grid: np.ndarray, pair: np.ndarray) -> np.ndarray:
    """Return the direction of each connector as a number between -13 and 13."""
    step = grid[pair[:, 1]] - grid[pair[:, 0]]
    return 9 * step[:, 0] + 3 * step[:, 1] + step[:, 2]


def _best_places(grid: np.ndarray) -> _Places:
    """
    Return the layout with the fewest blocks, with rows end to end or in separate blocks.

    Rows end to end suit slabs, whose rows are all equally long. In fabrics cut along other
    directions the ends of rows are irregular, and so would be the neighbours of a block.
    """
    candidates = []
    if _is_compact(grid):
        woven = _woven_places(grid)
        count, flat = _block_count(woven), _flat_places(grid)
        # Neighbours lie closer together in the woven layout.
        best = woven if count <= _SETTINGS.closer_block_ratio * _block_count(flat) else flat
        if _block_count(best) * LANES <= _SETTINGS.accepted_slots_per_body * len(grid):
            return best
        candidates = [woven, flat]
    candidates += [_row_places(grid, axis) for axis in range(3)]
    return min(candidates, key=_block_count)


def _block_count(places: _Places) -> int:
    used = np.zeros(int(places.slot.max()) // LANES + 1, bool)
    for piece in pieces(len(places.slot)):
        used[places.slot[piece] // LANES] = True
    return int(np.count_nonzero(used))


def _is_compact(grid: np.ndarray) -> bool:
    """Return True if the grid points fill at least a third of their bounding box."""
    extent = np.ptp(grid, axis=0).astype(float) + 1.0
    return bool(np.prod(extent) <= 6.0 * len(grid) + 1000.0)


def _placed(
    grid: np.ndarray, place: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
) -> _Places:
    """Return the places of all bodies, computed by `place` for batches (m, 3) int64 from 0 on."""
    lowest, arrays = grid.min(axis=0).astype(np.int64), np.empty((3, len(grid)), np.int32)
    for piece in pieces(len(grid)):
        for target, values in zip(arrays, place(grid[piece] - lowest)):
            target[piece] = _narrow(values)
    return _Places(*arrays)


def _extent(grid: np.ndarray) -> np.ndarray:
    return np.ptp(grid, axis=0).astype(np.int64) + 1


def _subgrid(cell: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the number 0-3 of the cubic grid of each point, and its cell in that grid (n, 3)."""
    return (cell[:, 0] & 1) + 2 * (cell[:, 1] & 1), cell >> 1


def _woven_places(grid: np.ndarray) -> _Places:
    # The points of a weave are every second one of a grid, x + y + z of one parity. With rows and
    # layers of odd length these are every second number too, and half of it is the slot.
    extent = _extent(grid)

    def length(order: tuple[int, ...]) -> tuple[int, int]:
        fast, middle, slow = order
        layer = int((extent[fast] | 1) * (extent[middle] | 1))
        return layer * int(extent[slow]), layer  # short layers keep neighbours close

    fast, middle, slow = min(permutations(range(3)), key=length)
    row = int(extent[fast]) | 1
    layer = row * (int(extent[middle]) | 1)

    def place(cell: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        slot = (cell[:, slow] * layer + cell[:, middle] * row + cell[:, fast]) >> 1
        return slot, slot, cell[:, middle]

    return _placed(grid, place)


def _flat_places(grid: np.ndarray) -> _Places:
    # Or as four interleaved cubic grids, which suits fabrics of an even number of rows. All grids
    # have cells for the whole box, so that a step to a neighbour is the same number of slots
    # everywhere.
    extent = (_extent(grid) + 1) >> 1
    fast, middle = (0, 1) if extent[0] >= extent[1] else (1, 0)

    def flat_of(cell: np.ndarray) -> np.ndarray:
        return (cell[:, 2] * extent[middle] + cell[:, middle]) * extent[fast] + cell[:, fast]

    # z's parity follows from x's and y's within one weave.
    lowest = grid.min(axis=0).astype(np.int64)
    room = _rounded_up(1 + max(
        int(flat_of(_subgrid(grid[piece] - lowest)[1]).max()) for piece in pieces(len(grid))))

    def place(cell: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        number, inner = _subgrid(cell)
        flat = flat_of(inner)
        return number * room + flat, flat, inner[:, middle]

    return _placed(grid, place)


def _row_places(grid: np.ndarray, axis: int) -> _Places:
    # Rows along an axis, each beginning with a block of its own; gaps within a row stay empty.
    number, cell = _subgrid(grid.astype(np.int64) - grid.min(axis=0))
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
    slot = _narrow(start[member] + cell[:, axis] - first[member])
    return _Places(slot, slot, _narrow(cell[:, others[0]]))


def _narrow(values: np.ndarray) -> np.ndarray:
    if values.max() > np.iinfo(np.int32).max:
        raise ValueError('too many bodies to number their slots with 32 bits')
    return values.astype(np.int32)


def _rounded_up(count: int) -> int:
    return -(-count // LANES) * LANES
