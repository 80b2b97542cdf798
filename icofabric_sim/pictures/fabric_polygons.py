# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A fabric as flat, coloured polygons in drawing order, as a camera sees it.

Whatever is nearer to the eye is drawn later. Shells are convex and of one size and connectors are
cut into pieces, so the order of their middles is that of what hides what; of one shell only the
faces towards the viewer are drawn.
"""

from collections.abc import Sequence
import math
from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import circumscribed_radius, face_geometry, outer_triangles
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.messages.markers import held_bodies, SHELL_CLASSES
from icofabric_sim.pictures.camera import Area, Camera
from icofabric_sim.pictures.light import light_on, Lighting
from icofabric_sim.pictures.measures import connector_segments, Scale, values_of
from icofabric_sim.pictures.moment import Moment
from icofabric_sim.scene.scene import Scene
from icofabric_sim.scene.shell_gaps import find_contacts
import numpy as np

FREE_COLOR, HELD_COLOR = (np.array(entry.color[:3]) for entry in SHELL_CLASSES)
DRIVEN_COLOR = np.array([0.36, 0.55, 0.53])
PLAIN_CONNECTOR_COLOR = np.array([0.56, 0.57, 0.58])
BROKEN_COLOR = np.array([0.16, 0.15, 0.15])
ANCHOR_COLOR = np.array([0.13, 0.45, 0.30])
CONTACT_COLOR = np.array([0.80, 0.16, 0.55])
# Shells with edges of fewer pixels are drawn as discs, and of up to so many without bevels.
_DISC_PIXELS, _PLAIN_PIXELS = 1.2, 5.0
# The bevel along the edges of a face, as a part of its height, and how much brighter it is.
_BEVEL, _GLINT = 0.055, 1.10
# A connector is cut into pieces of about half an edge, at most so many.
_MOST_PIECES = 12
_DISC_CORNERS = 10
# Breadth [half edges] of a connector, and the strips that make it look round: their sides as
# parts of it, and their brightness.
_BREADTH = 0.16
_STRIPS = ((-0.5, 0.5, 0.66), (-0.38, 0.22, 0.98), (-0.22, -0.02, 1.16))
# What broken connectors leave at both ends, as a part of their length.
_STUB = 0.16


class Polygons(NamedTuple):
    """Quadrilaterals (a triangle repeats a corner) in drawing order."""

    corners: np.ndarray  # (m, k, 2) [pixels]
    colors: np.ndarray  # (m, 3)


class _Part(NamedTuple):
    corners: np.ndarray  # (m, k, 2) [pixels]
    colors: np.ndarray  # (m, 3)
    distance: np.ndarray  # (m,) [m] from the eye


_NOTHING = _Part(np.zeros((0, 4, 2)), np.zeros((0, 3)), np.zeros(0))


def shown_bodies(scene: Scene, bodies: np.ndarray | None) -> np.ndarray:
    """Which bodies are drawn, (n,) bool."""
    if bodies is None:
        return np.ones(scene.body_count, dtype=bool)
    shown = np.zeros(scene.body_count, dtype=bool)
    shown[bodies[bodies < scene.body_count]] = True
    return shown


def driven_bodies(scene: Scene) -> np.ndarray:
    """Return True for bodies that a drive moves, (n,)."""
    driven = np.zeros(scene.body_count, dtype=bool)
    for drive in scene.drives.values():
        driven[drive.bodies] = True
    return driven


def body_colors(scene: Scene) -> np.ndarray:
    """Colours (n, 3) of bodies that are free, held or driven."""
    colors = np.where(held_bodies(scene)[:, None], HELD_COLOR, FREE_COLOR)
    colors[driven_bodies(scene)] = DRIVEN_COLOR
    return np.asarray(colors)


def fabric_polygons(
    moment: Moment, camera: Camera, area: Area, *, scale: Scale | None = None, color: str = '',
    bodies: np.ndarray | None = None, marks: bool = True
) -> Polygons:
    """
    All that is to be drawn of a fabric in one state.

    `color` names the quantity that `scale` shows. Only the `bodies` of these numbers are drawn,
    with the connectors between them. `marks`: contacts are marked.
    """
    scene = moment.scene
    shown = shown_bodies(scene, bodies) & np.isfinite(moment.position).all(axis=1)
    lighting = Lighting.of(camera.axes)
    of_bodies = scale is not None and scale.quantity.of_bodies
    colors = body_colors(scene)
    values = np.zeros(0) if scale is None else values_of(color, moment)
    if scale is not None and of_bodies:
        colors = scale.colors(values)
    parts = [_shells(moment, colors, np.flatnonzero(shown & camera.is_before(moment.position)),
                     camera, area, lighting)]
    if scene.connector_count:
        chosen = shown[scene.connectors.bodies].all(axis=1)
        painted = scale.colors(values) if scale is not None and not of_bodies else np.tile(
            PLAIN_CONNECTOR_COLOR, (scene.connector_count, 1))
        parts += _connectors(moment, painted, chosen, camera, area)
    parts += _anchors(moment, shown, camera, area)
    if marks and scene.body_count <= 20_000:
        parts.append(_contacts(moment, shown, camera, area))
    return _ordered([part for part in parts if len(part.corners)])


def _ordered(parts: Sequence[_Part]) -> Polygons:
    if not parts:
        return Polygons(np.zeros((0, 4, 2)), np.zeros((0, 3)))
    most = max(part.corners.shape[1] for part in parts)
    corners = np.concatenate([
        np.concatenate([part.corners, np.repeat(
            part.corners[:, -1:], most - part.corners.shape[1], axis=1)], axis=1)
        for part in parts])
    order = np.argsort(-np.concatenate([part.distance for part in parts]), kind='stable')
    return Polygons(corners[order], np.concatenate([part.colors for part in parts])[order])


def _shells(
    moment: Moment, colors: np.ndarray, chosen: np.ndarray, camera: Camera, area: Area,
    lighting: Lighting
) -> _Part:
    half_edges = moment.scene.body_half_edges[chosen]
    position, distance = moment.position[chosen], camera.distances(moment.position[chosen])
    edge = 2.0 * moment.scene.shell.half_edge * camera.pixels_per_meter(area)
    if edge < _DISC_PIXELS or not len(chosen):
        return _discs(position, colors[chosen], distance, half_edges, camera, area, lighting)
    cosines = cosines_from_quaternions(moment.orientation[chosen])
    normals = np.einsum('fa,nai->nfi', face_geometry(1.0).normals, cosines)
    corners = np.einsum('n,fka,nai->nfki', half_edges, outer_triangles(1.0), cosines)
    corners += position[:, None, None]
    middle = corners.mean(axis=2)
    body, face = np.nonzero(np.einsum('nfi,nfi->nf', camera.eye - middle, normals) > 0.0)
    light = light_on(
        lighting, middle[body, face], normals[body, face], body, position, half_edges)
    faces = colors[chosen][body] * light
    seen = camera.project(corners[body, face], area)
    if edge < _PLAIN_PIXELS:
        return _Part(seen, faces, distance[body])
    # The rim of a face first, then the face within it.
    inner = seen + 3.0 * _BEVEL * (seen.mean(axis=1, keepdims=True) - seen)
    return _Part(
        np.stack([seen, inner], axis=1).reshape(-1, 3, 2),
        np.stack([_GLINT * faces + 0.02, faces], axis=1).reshape(-1, 3),
        np.repeat(distance[body], 2))


def _discs(
    position: np.ndarray, colors: np.ndarray, distance: np.ndarray, half_edges: np.ndarray,
    camera: Camera, area: Area, lighting: Lighting
) -> _Part:
    if not len(position):
        return _NOTHING
    angle = np.arange(_DISC_CORNERS) * (2.0 * math.pi / _DISC_CORNERS)
    rim = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    radius = 0.9 * circumscribed_radius(1.0) * half_edges * camera.focal(area) / distance
    normals = np.broadcast_to(
        (lighting.front + np.array([0.0, 0.0, 0.7])) / np.linalg.norm(
            lighting.front + np.array([0.0, 0.0, 0.7])), position.shape)
    light = light_on(
        lighting, position + half_edges[:, None] * normals, normals, np.arange(len(position)),
        position, half_edges)
    centre = camera.project(position, area)
    return _Part(centre[:, None] + radius[:, None, None] * rim, colors * light, distance)


def _connectors(
    moment: Moment, colors: np.ndarray, chosen: np.ndarray, camera: Camera, area: Area
) -> list[_Part]:
    scene = moment.scene
    ends, of = connector_segments(scene, moment.position, moment.orientation)
    chosen = chosen[of] & camera.is_before(ends).all(axis=1)
    broken = np.zeros(scene.connector_count, dtype=bool)
    if moment.broken is not None:
        broken[moment.broken] = True
    broken = broken[of]
    whole = chosen & ~broken
    parts = [_cables(ends[whole], colors[of[whole]], scene.shell.half_edge, camera, area)]
    torn = ends[chosen & broken]
    if len(torn):
        reach = np.minimum(_STUB, 1.5 * scene.shell.half_edge / np.maximum(
            np.linalg.norm(torn[:, 1] - torn[:, 0], axis=1), 1e-300))[:, None]
        stubs = np.concatenate([
            np.stack([torn[:, side], torn[:, side] + reach * (torn[:, 1 - side] - torn[:, side])],
                     axis=1) for side in (0, 1)])
        parts.append(_cables(
            stubs, np.tile(BROKEN_COLOR, (len(stubs), 1)), scene.shell.half_edge, camera, area))
        parts.append(_balls(
            stubs[:, 1], np.tile(BROKEN_COLOR, (len(stubs), 1)), 0.17 * scene.shell.half_edge,
            camera, area))
    return parts


def _cables(
    ends: np.ndarray, colors: np.ndarray, half_edge: float, camera: Camera, area: Area
) -> _Part:
    """Round bars between points (c, 2, 3), in pieces."""
    if not len(ends):
        return _NOTHING
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    pieces = int(np.clip(math.ceil(float(np.median(length)) / half_edge), 2, _MOST_PIECES))
    if len(ends) > 20_000:
        pieces = 1
    at = np.linspace(0.0, 1.0, pieces + 1)[:, None, None]
    points = (1.0 - at) * ends[:, 0] + at * ends[:, 1]  # (pieces + 1, c, 3)
    seen = camera.project(points, area)
    along = seen[-1] - seen[0]
    size = np.linalg.norm(along, axis=1, keepdims=True)
    along = np.divide(along, size, out=np.zeros_like(along), where=size > 0.0)
    # To the lamp's side: upwards, or to the left.
    side = np.stack([along[:, 1], -along[:, 0]], axis=1)
    side *= np.where(side @ np.array([0.6, 0.8]) > 0.0, -1.0, 1.0)[:, None]
    breadth = np.maximum(
        _BREADTH * half_edge * camera.focal(area) / camera.distances(points), 1.6)[..., None]
    middle = camera.distances(0.5 * (points[:-1] + points[1:]))
    strips = _STRIPS if float(breadth.mean()) > 4.0 else ((-0.5, 0.5, 0.86), (-0.5, 0.0, 1.0))
    corners, shades = [], []
    for low, high, bright in strips:
        # -0.5 is the side towards the lamp.
        one, other = (seen - part * breadth * side for part in (low, high))
        corners.append(np.stack([one[:-1], one[1:], other[1:], other[:-1]], axis=2))
        shades.append(bright * colors)
    stacked = np.stack(corners, axis=2)  # (pieces, c, strips, 4, 2)
    shade = np.broadcast_to(np.stack(shades, axis=1), (*stacked.shape[:3], 3))
    return _Part(
        stacked.reshape(-1, 4, 2), np.clip(shade.reshape(-1, 3), 0.0, 1.0),
        np.repeat(middle.reshape(-1), len(strips)))


def _balls(
    points: np.ndarray, colors: np.ndarray, radius: float, camera: Camera, area: Area, *,
    nearer: float = 0.0
) -> _Part:
    """Small discs around points (m, 3), drawn as if they were so much nearer [m]."""
    angle = np.arange(2 * _DISC_CORNERS) * (math.pi / _DISC_CORNERS)
    rim = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    distance = camera.distances(points)
    size = np.maximum(radius * camera.focal(area) / distance, 3.0)[:, None, None]
    return _Part(
        camera.project(points, area)[:, None] + size * rim, colors, distance - nearer)


def _anchors(moment: Moment, shown: np.ndarray, camera: Camera, area: Area) -> list[_Part]:
    """Anchors: a bar from the shell to a pin in the world."""
    anchors = list(moment.scene.anchors.values())
    if not anchors:
        return []
    body = np.array([anchor.body for anchor in anchors])
    arms = np.array([anchor.arm for anchor in anchors])
    cosines = cosines_from_quaternions(moment.orientation[body])
    starts = moment.position[body] + np.einsum('ai,aij->aj', arms, cosines)
    points = anchor_points(moment)
    chosen = shown[body] & camera.is_before(points) & camera.is_before(starts)
    if moment.torn_anchors is not None:
        chosen[moment.torn_anchors] = False
    half_edge = moment.scene.shell.half_edge
    colors = np.tile(ANCHOR_COLOR, (int(chosen.sum()), 1))
    ends = np.stack([starts, points], axis=1)[chosen]
    return [
        _cables(ends, colors, half_edge, camera, area),
        _balls(points[chosen], 0.75 * colors, 0.42 * half_edge, camera, area),
        _balls(points[chosen], 1.25 * colors, 0.26 * half_edge, camera, area, nearer=1e-6)]


def anchor_points(moment: Moment) -> np.ndarray:
    """World points (a, 3) [m] of the anchors of a moment."""
    if moment.anchor_points is not None:
        return moment.anchor_points
    time = 0.0 if math.isnan(moment.time) else moment.time
    return np.array([
        next(piece for piece in reversed(anchor.path.pieces)
             if piece.start <= time or piece is anchor.path.pieces[0]).at(time)[:3]
        for anchor in moment.scene.anchors.values()]).reshape(-1, 3)


def _contacts(moment: Moment, shown: np.ndarray, camera: Camera, area: Area) -> _Part:
    """Rings where shells overlap, before both of them."""
    contacts = find_contacts(
        moment.scene.body_half_edges, moment.position, moment.orientation)
    chosen = shown[contacts.bodies].all(axis=1) & camera.is_before(contacts.point)
    if not chosen.any():
        return _NOTHING
    half_edge = moment.scene.shell.half_edge
    points = contacts.point[chosen]
    nearest = camera.distances(moment.position[contacts.bodies[chosen]]).min(axis=1)
    before = camera.distances(points) - nearest + 1e-6
    outer = _balls(points, np.ones((len(points), 3)), 0.40 * half_edge, camera, area)
    inner = _balls(
        points, np.tile(CONTACT_COLOR, (len(points), 1)), 0.30 * half_edge, camera, area)
    # White first, so that the mark stands out from any shell.
    return _Part(
        np.stack([outer.corners, inner.corners], axis=1).reshape(-1, *outer.corners.shape[1:]),
        np.stack([outer.colors, inner.colors], axis=1).reshape(-1, 3),
        np.repeat(outer.distance - before, 2))
