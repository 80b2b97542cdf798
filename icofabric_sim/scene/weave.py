# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Woven fabrics: positions and orientations of the icosahedra, and their connectors.

Source: "A Mathematical Model of Icosahedral Materials", "Weaves". Rows, columns and levels run
along the fabric's axes, which are rotated relative to the world axes in the bias orientation.
"""

from dataclasses import dataclass
import logging
import math
from typing import Final, get_args, Literal, NamedTuple, Sequence

from icofabric_sim.scene.region import NAME as REGION
from icofabric_sim.scene.region import Region, sides_text
from icofabric_sim.scene.weave_connect import connect_grid, Connections, Fastest
from icofabric_sim.scene.weave_geometry import (
    checked_box,
    MAX_POSITIONS,
    ROUNDING_RATIO,
    size_for_box,
    WeaveGeometry,
)
from icofabric_sim.scene.weave_index import checked_size, checked_variant, is_turned, slab_count
from icofabric_sim.scene.weave_lattice import (
    part_bounds,
    part_grid,
    slab_grid,
    turned_box_grid,
    turned_points,
)
from icofabric_sim.scene.weave_tables import connector_count as table_count
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')

Kind = Literal['orthogonal', 'bias']
Boundary = Literal['upright', 'fabric']

# Bodies and connectors are numbered with 32 bits.
MAX_COUNT: Final = 2**31 - 1
# Peak memory with all connectors listed. Per body: grid 12, position 24 and temporary arrays, more
# while a part is cut out of a turned fabric. Per connector: numbers 8 and codes 2. Measured and
# estimated bytes per body: 102 and 107 for a slab of 8,001,504 bodies (38 without a list), 105 and
# 110 for a turned box of 4e6 bodies.
_BYTES_PER_BODY, _BYTES_PER_CUT_BODY, _BYTES_PER_CONNECTOR = 48, 110, 10
# An estimate builds at most this many grid positions along each side.
_SAMPLE_POSITIONS: Final = 32.0

# Half the angle between the fabric's (1, 1, 1) and the vertical, arccos(1/sqrt(3)) = 54.736 deg.
_BIAS_HALF_ANGLE: Final = 0.5 * math.acos(1.0 / math.sqrt(3.0))


@dataclass(frozen=True, eq=False)
class Weave:
    """Woven fabric at rest; arrays are shared and must not be changed."""

    kind: Literal['orthogonal', 'bias', 'radial']
    variant: int
    size: tuple[int, int, int]  # Nx, Ny, Nz grid positions
    geometry: WeaveGeometry
    grid: np.ndarray  # (N, 3) int32, grid point of each body along the fabric's own axes
    position: np.ndarray  # (N, 3) [m], world
    # Unit quaternion x, y, z, w, body to world: (4,) of all bodies; radial weave: (N, 4)
    orientation: np.ndarray
    connections: Connections  # connectors, computed when first used

    @property
    def body_count(self) -> int:
        return len(self.position)

    @property
    def connector_bodies(self) -> np.ndarray:
        """Bodies of the connectors, (C, 2) int32, the lower one first."""
        return self.connections.whole.bodies

    @property
    def connector_edges(self) -> np.ndarray:
        """Edges that the connectors join, (C, 2) int8, see `icosahedron.NAMED_EDGES`."""
        return self.connections.whole.edges

    @property
    def connector_count(self) -> int:
        return self.connections.count


class WeaveEstimate(NamedTuple):
    """Size of a weave and memory to build it."""

    bodies: int
    connectors: int
    memory: int  # [bytes], highest while building


def fabric_orientation(kind: Kind, azimuth: float = 0.0) -> np.ndarray:
    """
    Return the unit quaternion x, y, z, w that rotates the fabric's axes to the world.

    Bias: the smallest rotation that takes (1, 1, 1) to the vertical, then `azimuth` [rad] about
    the vertical. A face of each icosahedron then points up, and the three axes of the grid make
    54.736 degrees with the vertical, as the document requires; it leaves the azimuth open.
    """
    if kind != 'bias':
        return np.array([0.0, 0.0, 0.0, 1.0])
    if not math.isfinite(azimuth):
        raise ValueError(f'weave.azimuth is {azimuth!r} rad: it must be finite')
    # About (1, -1, 0), which is perpendicular to both.
    tilt = math.sqrt(0.5) * math.sin(_BIAS_HALF_ANGLE)
    turn = np.array([0.0, 0.0, math.sin(0.5 * azimuth), math.cos(0.5 * azimuth)])
    return _product(turn, np.array([tilt, -tilt, 0.0, math.cos(_BIAS_HALF_ANGLE)]))


def body_orientation(kind: Kind, variant: int, azimuth: float = 0.0) -> np.ndarray:
    """
    Return the unit quaternion x, y, z, w, body to world, that all bodies of a weave share.

    In variants 2 and 3 the bodies are first turned by 90 degrees about the fabric's z axis. For
    the orthogonal orientation the result is q_0 of eq 25.
    """
    fabric = fabric_orientation(kind, azimuth)
    if not is_turned(variant):
        return fabric
    return _product(fabric, np.array([0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)]))


def build_weave(
        kind: Kind, variant: int, size: Sequence[int], geometry: WeaveGeometry, *,
        box: Sequence[float] | None = None, azimuth: float = 0.0,
        boundary: Boundary = 'upright', region: Region | None = None, connected: bool = True
        ) -> Weave:
    """
    Weave a fabric of `size` grid positions, or the largest that fits `box` [m].

    - Orthogonal: a slab along the world axes with its corner grid point at the origin.
    - Bias, boundary 'fabric': the same slab turned about the origin.
    - Bias, boundary 'upright': the bodies of a turned fabric whose centres lie in the box that the
      cells of the orthogonal slab fill, from -W/2 to (N - 1/2) W (with `box`: from -W/2 on, and as
      large as the box). At its centre is the grid point that would be the corner
      of a slab: a shell in variants 0 and 2, a gap in 1 and 3.

    `azimuth` and `boundary` apply to bias only. A `region`, centred on those cells, keeps only the
    bodies whose centres lie inside, in grid order: by z, then y, then x.
    """
    kind, variant, boundary = _checked_choices(kind, variant, boundary)
    size, extent = _resolved_size(kind, boundary, size, geometry, box)
    rotation = rotation_matrix(fabric_orientation(kind, azimuth))
    upright = kind == 'bias' and boundary == 'upright'
    low, high = _bounds(size, rotation, geometry, region)
    _refuse_unnumbered(size, low, high)
    origin, whole = np.zeros(3), None
    if upright:
        half = _half_extent(extent, geometry, region)
        grid = turned_box_grid(variant, rotation, half)
        origin = 0.5 * (extent - 1.0) * geometry.pitch
        if region is not None:
            whole = len(grid) if np.array_equal(half, 0.5 * extent) else None
            grid = grid[region.contains(geometry.pitch * turned_points(rotation, grid))]
    elif region is not None:
        middle, whole = 0.5 * (np.array(size) - 1.0), slab_count(variant, size)
        grid = part_grid(variant, low, high, lambda points: region.contains(
            geometry.pitch * turned_points(rotation, points - middle)))
    else:
        grid = slab_grid(variant, size)
    _refuse_empty(len(grid), kind, variant, size, region)
    if region is not None and len(grid) == whole:
        _LOGGER.warning(
            '%s keeps all %d bodies: its size is %s m, that of the fabric %s m; a mesh is in m',
            REGION, whole, sides_text(2.0 * region.half_extent),
            sides_text(extent * geometry.pitch))
    cut = upright or region is not None
    fastest: Fastest = 'y' if is_turned(variant) and not cut else 'x'
    connections = Connections(
        grid if connected else grid[:0], variant, fastest=fastest,
        count=None if cut or not connected else table_count(variant, size))
    position = turned_points(rotation, grid) if kind == 'bias' else grid.astype(np.float64)
    position *= geometry.pitch
    position += origin
    return Weave(
        kind, variant, size, geometry, grid, position, body_orientation(kind, variant, azimuth),
        connections)


def estimate_weave(
        kind: Kind, variant: int, size: Sequence[int], geometry: WeaveGeometry, *,
        box: Sequence[float] | None = None, azimuth: float = 0.0,
        boundary: Boundary = 'upright', region: Region | None = None, connected: bool = True
        ) -> WeaveEstimate:
    """
    Estimate bodies, connectors and memory of `build_weave`, and raise the same errors.

    Takes milliseconds and little memory for any size. The counts are exact with two exceptions.
    For an upright bias weave with a side of more than 32 positions they follow from the volume.
    For a weave cut to a region they are those of the bounding box, an upper bound.
    """
    kind, variant, boundary = _checked_choices(kind, variant, boundary)
    size, extent = _resolved_size(kind, boundary, size, geometry, box)
    rotation = rotation_matrix(fabric_orientation(kind, azimuth))
    low, high = _bounds(size, rotation, geometry, region)
    _refuse_unnumbered(size, low, high)
    bodies, connectors = slab_count(variant, size), table_count(variant, size)
    if kind == 'bias' and boundary == 'upright':
        extent = 2.0 * _half_extent(extent, geometry, region)
        # The central part of the box. If it is empty, so is the box, unless the box is very thin.
        part = np.minimum(extent, _SAMPLE_POSITIONS)
        grid = turned_box_grid(variant, rotation, 0.5 * part)
        bodies, connectors = len(grid), len(connect_grid(grid, variant).bodies)
        if bool(np.any(part < extent)) and (bodies or float(extent.min()) < 1.0):
            # Half the grid points, and 12 connectors with two ends each at every body.
            bodies = math.ceil(0.5 * math.prod(extent.tolist()))
            connectors = 6 * bodies
    elif region is not None:
        bodies = -(-math.prod((high - low + 1).tolist()) // 2)
        connectors = 6 * bodies
    _refuse_empty(bodies, kind, variant, size, region)
    if not connected:
        connectors = 0
    memory = _BYTES_PER_BODY * bodies + _BYTES_PER_CONNECTOR * connectors
    if kind == 'bias' and boundary == 'upright':
        memory = max(memory, _BYTES_PER_CUT_BODY * bodies)
    return WeaveEstimate(bodies, connectors, memory)


def rotation_matrix(orientation: np.ndarray) -> np.ndarray:
    """Return the rotation matrix (3, 3) of a unit quaternion x, y, z, w."""
    x, y, z, w = (float(value) for value in orientation)
    return np.array([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)]])


def _resolved_size(
        kind: Kind, boundary: Boundary, size: Sequence[int], geometry: WeaveGeometry,
        box: Sequence[float] | None) -> tuple[tuple[int, int, int], np.ndarray]:
    # Size in grid positions, and extent of the region in units of the pitch.
    if box is None:
        size = checked_size(size)
        return size, np.array(size, np.float64)
    if kind == 'bias' and boundary == 'upright':
        # Centres fill the box, so the box may be narrower than an icosahedron.
        extent = np.minimum(checked_box(box) / geometry.pitch, MAX_POSITIONS)
        nx, ny, nz = (max(1, math.floor(n * (1.0 + ROUNDING_RATIO))) for n in extent)
        return (nx, ny, nz), extent
    size = size_for_box(box, geometry)
    return size, np.array(size, np.float64)


def _bounds(
        size: tuple[int, int, int], rotation: np.ndarray, geometry: WeaveGeometry,
        region: Region | None) -> tuple[np.ndarray, np.ndarray]:
    # First and last grid positions of a slab that can be in the region.
    if region is None:
        return np.zeros(3, np.int64), np.array(size, np.int64) - 1
    return part_bounds(size, np.abs(rotation.T) @ (region.half_extent / geometry.pitch))


def _half_extent(
        extent: np.ndarray, geometry: WeaveGeometry, region: Region | None) -> np.ndarray:
    # Half sides of the upright box of a bias fabric, which has the centre of the region.
    if region is None:
        return 0.5 * extent
    return np.minimum(0.5 * extent, region.half_extent / geometry.pitch)


def _refuse_unnumbered(
        size: tuple[int, int, int], low: np.ndarray, high: np.ndarray) -> None:
    # Variant 0 has the most bodies. For an upright bias box the count is approximate, which is
    # sufficient because the limit is far beyond any memory.
    part = [max(1, int(count)) for count in high - low + 1]
    bodies, connectors = slab_count(0, part), table_count(0, part)
    if max(*size, bodies, connectors) > MAX_COUNT:
        raise ValueError(
            f'weave.size is {list(size)}: this gives about {bodies} bodies and {connectors} '
            f'connectors, but positions, bodies and connectors are numbered up to {MAX_COUNT}')


def _refuse_empty(
        bodies: int, kind: Kind, variant: int, size: tuple[int, int, int],
        region: Region | None) -> None:
    if bodies == 0 and region is not None:
        raise ValueError(
            f'{REGION} contains no centre of a weave of kind {kind}, variant {variant} and size '
            f'{list(size)}; give a larger region or another variant')
    if bodies == 0:
        raise ValueError(
            f'weave.size is {list(size)}: a weave of kind {kind}, variant {variant}, has no '
            'icosahedron; give a larger weave.size (or weave.box) or another variant')


def _checked_choices(kind: str, variant: int, boundary: str) -> tuple[Kind, int, Boundary]:
    if kind not in get_args(Kind):
        raise ValueError(
            f'weave.kind is {kind!r}: it must be one of {", ".join(get_args(Kind))}')
    if boundary not in get_args(Boundary):
        raise ValueError(
            f'weave.boundary is {boundary!r}: it must be one of {", ".join(get_args(Boundary))}')
    return kind, checked_variant(variant), boundary  # type: ignore[return-value]


def _product(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    # Quaternion product: rotation by `second`, then by `first`.
    x1, y1, z1, w1 = first
    x2, y2, z2, w2 = second
    return np.array([
        w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
        w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
        w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
        w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2])
