# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Connector length, connector angle and pitch of a weave.

Source: "A Mathematical Model of Icosahedral Materials", eqs 50-54 and Figure 5. With
W = L cos(theta) = w + L sin(theta), eq 51 becomes L^2 = W^2 + (W - w)^2. Hence
W = (w + sqrt(2 L^2 - w^2)) / 2, which is free of cancellation in the whole domain, and
L = w / (cos(theta) - sin(theta)) = w / (sqrt(2) sin(pi/4 - theta)).
"""

import math
from typing import Final, NamedTuple, Sequence

from icofabric_sim.geometry.icosahedron import TAU
import numpy as np

# Eq 54: at this angle the connector lies in a face of both its icosahedra.
MINIMUM_ANGLE: Final = -math.atan((TAU - 1.0) / TAU)
# The length tends to infinity as the angle tends to this limit, which is excluded.
LIMIT_ANGLE: Final = math.pi / 4.0
# L_min / w; the document prints 0.774596669.
MINIMUM_LENGTH_RATIO: Final = math.sqrt(3.0 / 5.0)
# Relative tolerance of given limits, angles and boxes; it accepts limits with the nine or ten
# digits of the document.
ROUNDING_RATIO: Final = 1e-9
# Most grid positions along one side of a box: far beyond any memory, but a valid integer.
MAX_POSITIONS: Final = 2.0**62


class WeaveGeometry(NamedTuple):
    """
    Lengths and angle of the unit cell of a weave.

    Invariants: w = 2 tau a, W = L cos(theta) = w + L sin(theta).
    """

    half_edge: float  # a [m]
    cube_width: float  # w [m], eq 50: the cube that circumscribes the icosahedron
    connector_length: float  # L [m]
    connector_angle: float  # theta [rad]; positive: the connector lies outside the cubes
    pitch: float  # W [m]: distance of neighbouring grid planes


def cube_width(half_edge: float) -> float:
    """Return the width w = 2 tau a [m] of the circumscribing cube (eq 50)."""
    a = float(half_edge)
    if not (a > 0.0 and math.isfinite(a)):
        raise ValueError(
            f'shell.edge_length is {2.0 * a!r} m: it must be positive and finite')
    return 2.0 * TAU * a


def geometry_from_length(half_edge: float, length: float) -> WeaveGeometry:
    """
    Return the weave geometry for a connector length [m] (eq 52, well-conditioned form).

    Raises `ValueError` unless L_min = sqrt(3/5) w <= length < infinity.
    """
    w = cube_width(half_edge)
    shortest = MINIMUM_LENGTH_RATIO * w
    L = float(length)
    if not (L >= shortest * (1.0 - ROUNDING_RATIO) and math.isfinite(L)):
        raise ValueError(
            f'weave.connector_length is {L!r} m: it must be at least sqrt(3/5) w = {shortest!r} m '
            f'(eq 54) and finite, where w = {w:.9g} m belongs to shell.edge_length = '
            f'{2.0 * half_edge:.9g} m; give a longer connector or a smaller shell')
    # In units of w and factored, to avoid cancellation and overflow.
    r = L / w
    root = math.sqrt(math.sqrt(2.0) * r - 1.0) * math.sqrt(math.sqrt(2.0) * r + 1.0)
    rise = (r - 1.0) * ((r + 1.0) / (1.0 + root))  # L sin(theta) / w
    run = 0.5 * (1.0 + root)  # L cos(theta) / w
    return _checked(WeaveGeometry(float(half_edge), w, L, math.atan2(rise, run), run * w))


def geometry_from_angle(half_edge: float, angle: float) -> WeaveGeometry:
    """
    Return the weave geometry for a connector angle [rad] to the grid axis (eq 53).

    Raises `ValueError` unless theta_min <= angle < pi/4 (eq 54).
    """
    w = cube_width(half_edge)
    theta = float(angle)
    if not MINIMUM_ANGLE * (1.0 + ROUNDING_RATIO) <= theta < LIMIT_ANGLE:
        hint = ''
        if abs(theta) > 1.0 and MINIMUM_ANGLE <= math.radians(theta) < LIMIT_ANGLE:
            hint = f'; angles are radians, {theta:.6g} degrees are {math.radians(theta):.9g} rad'
        raise ValueError(
            f'weave.connector_angle is {theta!r} rad: it must be at least {MINIMUM_ANGLE!r} rad '
            f'(-20.905 degrees) and less than pi/4 = {LIMIT_ANGLE:.9g} rad (eq 54){hint}')
    # Avoids the cancellation of cos - sin near pi/4.
    L = w / (math.sqrt(2.0) * math.sin(LIMIT_ANGLE - theta))
    return _checked(WeaveGeometry(float(half_edge), w, L, theta, L * math.cos(theta)))


def slab_depth(size: Sequence[int], geometry: WeaveGeometry) -> np.ndarray:
    """
    Return the outer dimensions D_x, D_y, D_z [m] of a slab, over the circumscribing cubes.

    They are along the axes of the primary frame, not of the body frame as printed in the document:
    body x is primary y in variants 2 and 3.
    """
    return geometry.cube_width + (np.asarray(size, np.float64) - 1.0) * geometry.pitch


def size_for_box(box: Sequence[float], geometry: WeaveGeometry) -> tuple[int, int, int]:
    """
    Return the largest N_x, N_y, N_z whose slab depth does not exceed the box [m].

    The document prints "the largest integer smaller than", which would give 4 for a box that fits
    5 exactly. This function allows equality up to round-off.
    """
    extent = checked_box(box)
    w = geometry.cube_width
    if not bool(np.all(extent * (1.0 + ROUNDING_RATIO) >= w)):
        raise ValueError(
            f'weave.box is {extent.tolist()} m: no icosahedron fits; each side must be at least '
            f'w = {w:.9g} m, the width of an icosahedron')
    count = np.floor(1.0 + (extent * (1.0 + ROUNDING_RATIO) - w) / geometry.pitch)
    nx, ny, nz = (int(value) for value in np.minimum(count, MAX_POSITIONS))
    return nx, ny, nz


def checked_box(box: Sequence[float]) -> np.ndarray:
    """Return the box as an array of three lengths [m], all positive and finite."""
    extent = np.asarray(box, np.float64)
    if not (extent.shape == (3,) and bool(np.all((extent > 0.0) & np.isfinite(extent)))):
        raise ValueError(
            f'weave.box is {extent.tolist()} m: it must be three positive, finite lengths, or '
            'all zero to use weave.size')
    return extent


def _checked(geometry: WeaveGeometry) -> WeaveGeometry:
    if not all(math.isfinite(value) for value in geometry):
        raise ValueError(
            f'weave.connector_length is {geometry.connector_length!r} m with shell.edge_length = '
            f'{2.0 * geometry.half_edge!r} m: the pitch of the weave is not finite')
    return geometry
