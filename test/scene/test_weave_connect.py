# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Connectors by brute force: the oracle knows icosahedra and distances, no table."""

from functools import lru_cache
import itertools
import math

from icofabric_sim.geometry.icosahedron import (
    NAMED_EDGE_DIRECTIONS,
    NAMED_EDGE_VERTICES,
    NAMED_EDGES,
    vertices,
)
from icofabric_sim.scene import weave_connect
from icofabric_sim.scene.weave_connect import connect_grid
from icofabric_sim.scene.weave_geometry import geometry_from_angle
from icofabric_sim.scene.weave_index import centre_rule, slab_count
from icofabric_sim.scene.weave_lattice import slab_grid
from icofabric_sim.scene.weave_tables import (
    connector_count,
    DOWN,
    EAST,
    fabric_direction,
    INDEX_TABLES,
    neighbour_indices,
    NORTH,
    SOUTH,
    TABLE_5,
    table_10,
    UP,
    WEST,
)
import numpy as np
import pytest

SIZES = list(itertools.product(range(1, 8), repeat=3))
VARIANTS = (0, 1, 2, 3)
DIAGONALS = [d for d in itertools.product((-1, 0, 1), repeat=3) if np.abs(d).sum() == 2]
# The 90 degrees about z by which the bodies of variants 2 and 3 are turned, body to fabric.
QUARTER_TURN = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])


@lru_cache(maxsize=None)
def edges_between(turned):
    """
    Find for each diagonal the pair of edges that a connector joins, from the icosahedron itself.

    It is the only pair of named edges at distance L whose connector is perpendicular to both.
    """
    geometry = geometry_from_angle(1.0, 0.2)
    turn = QUARTER_TURN if turned else np.eye(3)
    corners = vertices(1.0)[NAMED_EDGE_VERTICES] @ turn.T
    middle = corners.mean(axis=1)
    along = corners[:, 1] - corners[:, 0]
    found = {}
    for diagonal in DIAGONALS:
        pairs = []
        for local, remote in itertools.product(range(6), repeat=2):
            connector = geometry.pitch * np.array(diagonal) + middle[remote] - middle[local]
            right = abs(connector @ along[local]) + abs(connector @ along[remote]) < 1e-12
            if right and math.isclose(np.linalg.norm(connector), geometry.connector_length):
                pairs.append((local, remote))
        assert len(pairs) == 1
        found[diagonal] = pairs[0]
    return found


def brute_force(points, turned):
    """Connect a list of grid points, in its order, one body and one diagonal at a time."""
    number = {point: index for index, point in enumerate(points)}
    rows = []
    for (x, y, z), body in number.items():
        for (dx, dy, dz), (local, remote) in edges_between(turned).items():
            other = number.get((x + dx, y + dy, z + dz), -1)
            if other > body:
                rows.append((body, local, other, remote))
    return sorted(rows)


def as_rows(connectors):
    bodies, edges = connectors
    assert bodies.dtype == np.int32 and edges.dtype == np.int8
    return list(zip(bodies[:, 0].tolist(), edges[:, 0].tolist(),
                    bodies[:, 1].tolist(), edges[:, 1].tolist()))


def as_points(grid):
    return [tuple(point) for point in grid.tolist()]


def test_edge_names():
    assert [NAMED_EDGES[code] for code in (UP, DOWN, NORTH, SOUTH, WEST, EAST)] == [
        'up', 'down', 'north', 'south', 'west', 'east']
    codes = np.arange(6)
    assert np.array_equal(NAMED_EDGE_DIRECTIONS[codes ^ 1], -NAMED_EDGE_DIRECTIONS)


def test_table_5_follows_from_the_icosahedron():
    assert sorted(direction for _, direction in TABLE_5) == sorted(DIAGONALS)
    for variant in VARIANTS:
        found = edges_between(variant >= 2)
        for edge, direction in TABLE_5:
            assert found[fabric_direction(variant, direction)] == (edge, edge ^ 1)


@pytest.mark.parametrize('variant', VARIANTS)
def test_tables_6_to_9(variant):
    # The index maps lead to the centre at the printed displacement, from any indices, and its
    # edges are those of Table 5.
    table = INDEX_TABLES[variant]
    reach = np.arange(-3, 4)
    i, j, k = (index.ravel() for index in np.meshgrid(reach, reach, reach, indexing='ij'))
    here = centre_rule(variant, i, j, k)
    remote = neighbour_indices(variant, i, j, k)
    assert remote.shape == (343, 12, 3)
    there = centre_rule(variant, remote[..., 0], remote[..., 1], remote[..., 2])
    displacement = np.array([row.displacement for row in table])
    assert np.array_equal(there - here[:, None], np.broadcast_to(displacement, there.shape))
    assert sorted(row.displacement for row in table) == sorted(DIAGONALS)
    for row in table:
        pair = edges_between(variant >= 2)[row.displacement]
        assert (row.local_edge, row.remote_edge) == pair


@pytest.mark.parametrize('variant', VARIANTS)
def test_all_slabs(variant):
    # The builder equals brute force, each unit square holds exactly one connector, Table 10.
    total = 0
    for size in SIZES:
        points = as_points(slab_grid(variant, size))
        assert len(points) == slab_count(variant, size)
        connectors = connect_grid(
            slab_grid(variant, size), variant, fastest='y' if variant >= 2 else 'x')
        rows = as_rows(connectors)
        assert rows == brute_force(points, variant >= 2)
        assert len(rows) == connector_count(variant, size) == table_10(variant, size)
        total += len(rows)
        if not rows:
            continue
        ends = np.array(points)[connectors.bodies]
        squares = np.concatenate((ends.min(axis=1), ends.max(axis=1)), axis=1)
        assert len(np.unique(squares, axis=0)) == len(rows)
        assert np.all(np.sort(squares[:, 3:] - squares[:, :3], axis=1) == [0, 1, 1])
        # At most 12 at a body and 2 at an edge; all 12 inside.
        body_edge = 6 * connectors.bodies.astype(np.int64) + connectors.edges
        assert np.bincount(body_edge.ravel()).max() <= 2
        at_body = np.bincount(connectors.bodies.ravel(), minlength=len(points))
        inside = np.all((np.array(points) > 0) & (np.array(points) < np.array(size) - 1), axis=1)
        assert at_body.max() <= 12
        assert np.all(at_body[inside] == 12)
    assert total == 3 * 21 * 21 * 28


def test_connector_count_of_large_slabs():
    # Closed forms agree where 32 bits would not do.
    for size in ((10**6, 10**6 + 1, 10**6 + 2), (1, 10**9, 1), (2**31, 3, 2)):
        for variant in VARIANTS:
            assert connector_count(variant, size) == table_10(variant, size)
    assert connector_count(0, (10**6,) * 3) > 2**61


@pytest.mark.parametrize('variant', VARIANTS)
@pytest.mark.parametrize('fastest', ['x', 'y'])
def test_cut_fabrics(variant, fastest):
    # Any set of points of one parity, anywhere: random holes, and a ball.
    generator = np.random.default_rng(variant)
    reach = np.arange(-6, 7)
    grid = np.stack(np.meshgrid(reach, reach, reach, indexing='ij'), axis=-1).reshape(-1, 3)
    grid = grid[grid.sum(axis=1) % 2 == variant % 2] + [-40, 7, 1000001]
    order = (grid[:, 0], grid[:, 1]) if fastest == 'x' else (grid[:, 1], grid[:, 0])
    grid = grid[np.lexsort((*order, grid[:, 2]))]
    ball = np.linalg.norm(grid - [-40, 7, 1000001], axis=1) < 5.2
    sparse = ball & (generator.random(len(grid)) < 0.1)
    for kept in (generator.random(len(grid)) < 0.6, ball, sparse):
        cut = grid[kept].astype(np.int32)
        rows = as_rows(connect_grid(cut, variant, fastest=fastest))
        assert rows
        assert rows == brute_force(as_points(cut), variant >= 2)


def test_far_apart_points_need_no_large_table():
    grid = np.array([[-10**6, 0, -10**6], [0, 0, 0], [1, 0, 1], [10**6, 10**6, 10**6]])
    assert as_rows(connect_grid(grid, 0)) == [(1, UP, 2, DOWN)]
    # A variant turned by 90 degrees connects this diagonal by other edges.
    assert as_rows(connect_grid(grid, 2)) == [(1, EAST, 2, WEST)]
    assert len(connect_grid(grid[:0], 0).bodies) == 0
    assert len(connect_grid(grid[1:2], 0).bodies) == 0


@pytest.mark.parametrize('variant', [0, 3])
@pytest.mark.parametrize('size', [(6, 5, 4), (1, 40, 1), (23, 2, 3)])
def test_pieces_are_those_of_the_whole(size, variant, monkeypatch):
    grid, fastest = slab_grid(variant, size), 'y' if variant == 3 else 'x'
    whole = connect_grid(grid, variant, fastest=fastest)
    monkeypatch.setattr(weave_connect, '_BATCH_BODIES', 7)
    monkeypatch.setattr(weave_connect, '_MAX_STORED_BODIES', 0)
    found = weave_connect.Connections(grid, variant, fastest=fastest)
    assert found.count == len(whole.bodies) == connector_count(variant, size)
    numbers, parts = [], []
    for number, part in found.pieces():
        numbers.append(np.arange(number.start, number.stop))
        parts.append(part)
    if parts:
        assert np.array_equal(np.concatenate(numbers), np.arange(found.count))
        assert np.array_equal(np.vstack([part.bodies for part in parts]), whole.bodies)
        assert np.array_equal(np.vstack([part.edges for part in parts]), whole.edges)
        assert len(parts) > 3
    assert np.array_equal(found.whole.bodies, whole.bodies)
    assert (found.count > 0) == (min(size) > 1)


def test_wrong_points_are_refused():
    good = np.array([[0, 0, 0], [2, 0, 0], [1, 1, 0]])
    connect_grid(good, 0)
    with pytest.raises(ValueError, match='all even or all odd'):
        connect_grid(good + [[0, 0, 0], [0, 0, 0], [1, 0, 0]], 0)
    for wrong in (good[::-1], good[[0, 0, 1]]):
        with pytest.raises(ValueError, match='in order, x fastest'):
            connect_grid(wrong, 0)
    with pytest.raises(ValueError, match='in order, y fastest'):
        connect_grid(good, 0, fastest='y')
    with pytest.raises(ValueError, match='too far apart'):
        connect_grid(np.array([[0, 0, 0], [2**31, 2**31, 2**31]], np.int64), 0)
