# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Anchors: connectors from a point of a body to a fixed or moving point of the world.

Anchors use k_e, k_c and the natural length D of `connector.*` by default. They do not resist
bending, and have their own damping and break limits.
"""

from collections.abc import Mapping
import math
from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import NAMED_EDGES
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.attachments import attachment_points
from icofabric_sim.scene.breakage import BREAK_LENGTH_NAMES
from icofabric_sim.scene.connector_laws import spring_law
from icofabric_sim.scene.drives import Drive, make_path
from icofabric_sim.scene.paths import Path, PathPiece, require_followed
from icofabric_sim.scene.tables import read_numeric_table
from icofabric_sim.scene.weave_geometry import WeaveGeometry
import numpy as np

_ZERO6 = (0.0,) * 6


class AnchorLimits(NamedTuple):
    """Lengths at which an anchor breaks."""

    longest: float = math.inf  # L_e [m], infinite: never in extension
    shortest: float = 0.0  # L_c [m], 0: never in compression

    @property
    def breaks(self) -> bool:
        """True if the anchor can break."""
        return self != (math.inf, 0.0)


class Anchor(NamedTuple):
    """One anchor, `anchors.NAME`."""

    body: int
    arm: np.ndarray  # (3,) [m] from the centre to its end, body axes
    path: Path  # of the world point; only the first three coordinates are used
    law: tuple[float, float, float]  # k_e [N/m], k_c [N/m], D [m]
    limits: AnchorLimits = AnchorLimits()
    damping: float = 0.0  # c [N s/m]


def make_anchors(
    parameters: Parameters, body_count: int, drives: Mapping[str, Drive],
    geometry: WeaveGeometry, half_edges: np.ndarray | None = None
) -> dict[str, Anchor]:
    """
    Return all `anchors.NAME`; raise ParameterError if one is invalid.

    `half_edges` (n,) [m] are those of all bodies, if they differ.
    """
    anchors = {}
    midpoints = dict(zip(NAMED_EDGES, attachment_points(parameters, geometry.half_edge)))
    for name in parameters.names('anchors'):
        key, body = f'anchors.{name}.body', parameters[f'anchors.{name}.body']
        if not 0 <= body < body_count:
            raise ParameterError(
                key, f'{key}: there is no body {body}; bodies are numbered 0 to {body_count - 1}')
        for other, drive in drives.items():
            if body in drive.bodies:
                raise ParameterError(
                    key, f'{key}: body {body} is moved by drives.{other}, so no anchor can pull '
                    'it; leave the anchor out, or take the body out of the group')
        arm = np.array(parameters[f'anchors.{name}.point'])
        if not arm.any():
            arm = midpoints.get(parameters[f'anchors.{name}.edge'], arm) * (
                1.0 if half_edges is None else half_edges[body] / geometry.half_edge)
        anchors[name] = Anchor(
            body, arm, make_anchor_path(parameters, name),
            law := spring_law(parameters, f'anchors.{name}', geometry.connector_length),
            make_break_lengths(parameters, f'anchors.{name}', law[2]),
            parameters[f'anchors.{name}.damping'])
    return anchors


def refuse_broken_anchors(
    anchors: Mapping[str, Anchor], position: np.ndarray, orientation: np.ndarray
) -> None:
    """
    Refuse anchors that would break at the start.

    `position` (n, 3) [m] and `orientation` (n, 4) are the initial state of the bodies.
    """
    for name, anchor in anchors.items():
        if not anchor.limits.breaks:
            continue
        axes = cosines_from_quaternions(orientation[anchor.body][None])[0]
        end = position[anchor.body] + anchor.arm @ axes
        length = float(np.linalg.norm(end - anchor.path.pieces[0].at(0.0)[:3]))
        if length >= anchor.limits.longest:
            word, limit, way = BREAK_LENGTH_NAMES[0], anchor.limits.longest, 'raise'
        elif length <= anchor.limits.shortest:
            word, limit, way = BREAK_LENGTH_NAMES[1], anchor.limits.shortest, 'lower'
        else:
            continue
        key = f'anchors.{name}.{word}'
        raise ParameterError(
            key, f'{key} {limit!r} m: the anchor is {length:.6g} m long at the start and would '
            f'break at once; {way} it, or move anchors.{name}.position')


def make_break_lengths(parameters: Parameters, prefix: str, rest: float) -> AnchorLimits:
    """Return the break limits of `PREFIX.*`, a spring with the natural length `rest` [m]."""
    longest, shortest = (parameters[f'{prefix}.{name}'] for name in BREAK_LENGTH_NAMES)
    for name, limit, wrong, side, way in (
            (BREAK_LENGTH_NAMES[0], longest, 0.0 < longest <= rest, 'above', 'raise'),
            (BREAK_LENGTH_NAMES[1], shortest, shortest >= rest, 'below', 'lower')):
        if wrong:
            raise ParameterError(
                f'{prefix}.{name}',
                f'{prefix}.{name} {limit!r} m must be {side} the natural length, {rest!r} m: it '
                f'is a length from end to end, not a change of length; {way} it, or set 0 for '
                'never')
    return AnchorLimits(longest or math.inf, shortest)


def make_anchor_path(parameters: Parameters, name: str) -> Path:
    """
    Return the path of the world point: fixed, of constant velocity, through a table, or a motion.
    """
    prefix = f'anchors.{name}'
    position, velocity = parameters[f'{prefix}.position'], parameters[f'{prefix}.velocity']
    file, motion = parameters[f'{prefix}.file'].strip(), parameters[f'{prefix}.motion']
    for field in ('velocity',) if motion else (
            'linear', 'frequency', 'start', 'duration', 'phase'):
        value = parameters[f'{prefix}.{field}']
        if any(np.atleast_1d(value)):
            raise ParameterError(
                f'{prefix}.{field}', f'{prefix}.{field} {value!r} has no effect: ' + (
                    f'{prefix}.motion {motion} moves the point; give {prefix}.linear' if motion
                    else f'set {prefix}.motion to ramp or sine'))
    if motion:
        shift = np.append(position, np.zeros(3))
        return Path(tuple(
            piece._replace(cubic=(tuple((shift + piece.cubic[0]).tolist()), *piece.cubic[1:]))
            for piece in make_path(parameters, prefix, turns=False).pieces))
    if not file:
        return Path((PathPiece(0.0, (_six(position), _six(velocity), _ZERO6, _ZERO6)),))
    key = f'{prefix}.file'
    if any(velocity):
        raise ParameterError(
            key, f'{key}: {prefix}.velocity moves the point already; give one of them')
    # A slow import, needed only by scenes with tables.
    from scipy.interpolate import CubicSpline

    table = read_numeric_table(key, file, {4: 'time [s] and displacement x, y, z [m]'})
    places = np.array(position) + table[:, 1:]
    with np.errstate(over='ignore', invalid='ignore'):
        spline = CubicSpline(table[:, 0], places, bc_type='clamped')
    if not np.isfinite(spline.c).all():
        raise ParameterError(key, f'{key}: {file} has displacements too large for a smooth path')
    require_followed(key, file, spline, parameters)
    pieces = [
        PathPiece(time, tuple(_six(row) for row in spline.c[::-1, k].tolist()))
        for k, time in enumerate(table[:-1, 0].tolist())]
    pieces.append(
        PathPiece(float(table[-1, 0]), (_six(places[-1].tolist()), _ZERO6, _ZERO6, _ZERO6)))
    if pieces[0].start > 0.0:
        pieces.insert(0, PathPiece(0.0, (_six(places[0].tolist()), _ZERO6, _ZERO6, _ZERO6)))
    return Path(tuple(pieces))


def _six(values: list[float]) -> tuple[float, ...]:
    return (*values, 0.0, 0.0, 0.0)
