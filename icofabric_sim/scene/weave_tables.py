# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Edges and the neighbours that they connect to: Tables 5-10 of the document.

Source: "A Mathematical Model of Icosahedral Materials". Tables 6-9 agree with Table 5 in every
entry, and Table 10 with a count of all slabs up to 7x7x7: all are correct as printed.
Edge codes are those of `icosahedron.NAMED_EDGES`: up, down, north, south, west, east = 0, ..., 5;
the opposite edge, to which an edge always connects, is `code ^ 1`.
"""

from typing import Final, NamedTuple, Sequence

from icofabric_sim.scene.weave_index import checked_size, checked_variant, Index, is_turned
import numpy as np

UP, DOWN, NORTH, SOUTH, WEST, EAST = range(6)

# Table 5: local edge, and centre of the remote icosahedron relative to the local one, in body axes
# and units of W. Each row of the document's table contains two of these rows.
TABLE_5: Final = (
    (UP, (1, 0, 1)), (UP, (-1, 0, 1)),
    (DOWN, (1, 0, -1)), (DOWN, (-1, 0, -1)),
    (NORTH, (1, 1, 0)), (NORTH, (1, -1, 0)),
    (SOUTH, (-1, 1, 0)), (SOUTH, (-1, -1, 0)),
    (WEST, (0, 1, 1)), (WEST, (0, 1, -1)),
    (EAST, (0, -1, 1)), (EAST, (0, -1, -1)))


class TableRow(NamedTuple):
    """Row of Tables 6-9; the remote indices are the local indices plus a step."""

    local_edge: int
    remote_edge: int
    displacement: tuple[int, int, int]  # remote minus local centre, fabric axes, units of W
    even_step: tuple[int, int, int]  # level plus column (6, 7) or row (8, 9) is even
    odd_step: tuple[int, int, int]  # level plus column or row is odd


_TABLE_6: Final = (
    TableRow(UP, DOWN, (1, 0, 1), (0, 0, 1), (1, 0, 1)),
    TableRow(UP, DOWN, (-1, 0, 1), (-1, 0, 1), (0, 0, 1)),
    TableRow(WEST, EAST, (0, 1, 1), (0, 1, 1), (0, 1, 1)),
    TableRow(EAST, WEST, (0, -1, 1), (0, -1, 1), (0, -1, 1)),
    TableRow(DOWN, UP, (1, 0, -1), (0, 0, -1), (1, 0, -1)),
    TableRow(DOWN, UP, (-1, 0, -1), (-1, 0, -1), (0, 0, -1)),
    TableRow(WEST, EAST, (0, 1, -1), (0, 1, -1), (0, 1, -1)),
    TableRow(EAST, WEST, (0, -1, -1), (0, -1, -1), (0, -1, -1)),
    TableRow(NORTH, SOUTH, (1, 1, 0), (0, 1, 0), (1, 1, 0)),
    TableRow(SOUTH, NORTH, (-1, 1, 0), (-1, 1, 0), (0, 1, 0)),
    TableRow(NORTH, SOUTH, (1, -1, 0), (0, -1, 0), (1, -1, 0)),
    TableRow(SOUTH, NORTH, (-1, -1, 0), (-1, -1, 0), (0, -1, 0)))

_TABLE_8: Final = (
    TableRow(UP, DOWN, (0, 1, 1), (0, 0, 1), (0, 1, 1)),
    TableRow(UP, DOWN, (0, -1, 1), (0, -1, 1), (0, 0, 1)),
    TableRow(EAST, WEST, (1, 0, 1), (1, 0, 1), (1, 0, 1)),
    TableRow(WEST, EAST, (-1, 0, 1), (-1, 0, 1), (-1, 0, 1)),
    TableRow(DOWN, UP, (0, 1, -1), (0, 0, -1), (0, 1, -1)),
    TableRow(DOWN, UP, (0, -1, -1), (0, -1, -1), (0, 0, -1)),
    TableRow(EAST, WEST, (1, 0, -1), (1, 0, -1), (1, 0, -1)),
    TableRow(WEST, EAST, (-1, 0, -1), (-1, 0, -1), (-1, 0, -1)),
    TableRow(NORTH, SOUTH, (1, 1, 0), (1, 0, 0), (1, 1, 0)),
    TableRow(SOUTH, NORTH, (1, -1, 0), (1, -1, 0), (1, 0, 0)),
    TableRow(NORTH, SOUTH, (-1, 1, 0), (-1, 0, 0), (-1, 1, 0)),
    TableRow(SOUTH, NORTH, (-1, -1, 0), (-1, -1, 0), (-1, 0, 0)))


def _exchanged(table: tuple[TableRow, ...]) -> tuple[TableRow, ...]:
    # The fabric of variant 1 (3) is that of variant 0 (2) with odd and even lines exchanged.
    return tuple(row._replace(even_step=row.odd_step, odd_step=row.even_step) for row in table)


# By variant: Tables 6, 7, 8 and 9.
INDEX_TABLES: Final = (_TABLE_6, _exchanged(_TABLE_6), _TABLE_8, _exchanged(_TABLE_8))


def neighbour_indices(variant: int, i: Index, j: Index, k: Index) -> np.ndarray:
    """
    Return the indices of the 12 icosahedra connected to (i, j, k), int64, (..., 12, 3).

    Rows follow `INDEX_TABLES[variant]` and include indices outside a slab.
    """
    table = INDEX_TABLES[checked_variant(variant)]
    local = np.stack(np.broadcast_arrays(
        *(np.asarray(index, np.int64) for index in (i, j, k))), axis=-1)
    line = local[..., 0] if is_turned(variant) else local[..., 1]
    odd = ((line + local[..., 2]) & 1).astype(bool)[..., None, None]
    steps = np.where(odd, [row.odd_step for row in table], [row.even_step for row in table])
    return local[..., None, :] + steps


def fabric_direction(variant: int, direction: Sequence[int]) -> tuple[int, int, int]:
    """
    Express a direction of the body axes in the axes of the fabric.

    The bodies of variants 2 and 3 are turned by 90 degrees about z: body x is fabric y.
    """
    x, y, z = direction
    return (-y, x, z) if is_turned(variant) else (x, y, z)


def connector_count(variant: int, size: Sequence[int]) -> int:
    """
    Count the connectors of a slab: one in each unit square of its grid.

    Equal to Table 10 (`table_10`) for every size, in a form symmetric in all directions.
    """
    checked_variant(variant)
    nx, ny, nz = checked_size(size)
    return (nx - 1) * (ny - 1) * nz + (nx - 1) * ny * (nz - 1) + nx * (ny - 1) * (nz - 1)


def table_10(variant: int, size: Sequence[int]) -> int:
    """Count the connectors of a slab by Table 10 as printed."""
    nx, ny, nz = checked_size(size)
    if is_turned(variant):
        nx, ny = ny, nx
    n = (nx - nx % 2) // 2
    return ((nz - 1) * ((ny - ny % 2) // 2 * (8 + 12 * (n - 1) + 6 * (nx % 2))
                        + 4 * (ny % 2) - 3 + (6 * (ny % 2) - 4) * (n - 1)
                        + (3 * (ny % 2) - 2) * (nx % 2))
            + (ny - 1) * (1 + 2 * (n - 1) + nx % 2))
