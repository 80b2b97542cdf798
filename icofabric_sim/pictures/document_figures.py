# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The figures of the document, from the functions and tables that the program computes with.

Source: "A Mathematical Model of Icosahedral Materials", Figures 1 to 7; two of them have the
number 3, which are 3a and 3b here (C16), and `edges` is the diagram that it wishes for before
Table 5. Solids are drawn in parallel projection, from the farthest to the nearest.
"""

from collections.abc import Callable, Sequence
import math
from pathlib import Path
from typing import Any, NamedTuple

from icofabric_sim.geometry.icosahedron import (
    EDGES,
    face_geometry,
    FACES,
    NAMED_EDGE_VERTICES,
    NAMED_EDGES,
    TAU,
    vertices,
)
from icofabric_sim.geometry.rotations import cosines_from_quaternions, rotate_quaternions
from icofabric_sim.libraries import require_library
from icofabric_sim.pictures.citation import cite
from icofabric_sim.pictures.figure_style import save_figure
from icofabric_sim.pictures.weave_diagram import connector_stubs, length_figure, PAIR_COLORS
from icofabric_sim.scene.scene import Scene
from icofabric_sim.scene.weave_tables import TABLE_5
import numpy as np

CONNECTOR_ANGLE = 0.25  # [rad] of the weaves that are drawn
SHELL_COLOR, EDGE_COLOR = '#e8dcc0', '#7a6f58'
CONNECTOR_COLOR, MARK_COLOR, GAP_COLOR = '#0072b2', '#d55e00', '0.85'
# Segments of a line, and cells along a side of a patch, each drawn by its own depth.
_SEGMENT_COUNT, _CELL_COUNT = 8, 10
_SURFACE_COLOR = '#8a5f00'
_LIGHT = np.array([0.35, -0.45, 0.82])
# Position of the body of Figure 2 in units of a, and the rotation vector of its orientation [rad].
_BODY_POSITION, _BODY_ROTATION = np.array([1.0, 6.2, 2.4]), np.array([0.64, 0.52, 0.05])
# b/a and lambda1 of the surface in between in Figure 3b, and the number of its face.
_INNER_RATIO, _MIDDLE_RATIO, _FRUSTUM_FACE = 0.5, 0.78, 2


class Camera:
    """Parallel projection from a direction, given by two angles [degrees]."""

    def __init__(self, azimuth: float, elevation: float) -> None:
        turn, rise = math.radians(azimuth), math.radians(elevation)
        self.toward = np.array([
            math.cos(rise) * math.cos(turn), math.cos(rise) * math.sin(turn), math.sin(rise)])
        right = np.array([-math.sin(turn), math.cos(turn), 0.0])
        self.plane = np.stack([right, np.cross(self.toward, right)])

    def flat(self, points: np.ndarray) -> np.ndarray:
        """Return places (..., 2) on the picture."""
        return np.asarray(points @ self.plane.T)


class Drawing:
    """Solids and lines, drawn from the farthest to the nearest."""

    def __init__(self, axes: Any, camera: Camera, head: float = 0.08) -> None:
        """Begin a drawing; `head` is half the width of the heads of arrows."""
        self.axes, self.camera, self._head = axes, camera, head
        self._artists: list[tuple[float, Any]] = []
        self._seen: list[np.ndarray] = []

    def shell(self, centre: np.ndarray, corners: np.ndarray, color: str,
              alpha: float = 1.0) -> None:
        """Add the faces of an icosahedron that the viewer sees."""
        from matplotlib.colors import to_rgb
        faces = corners[FACES]
        normals = faces.mean(axis=1) - centre
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        front = normals @ self.camera.toward > 0.0
        shade = 0.66 + 0.34 * np.clip(normals[front] @ _LIGHT, 0.0, 1.0)
        self._polygons(centre, faces[front], shade[:, None] * np.array(to_rgb(color)), alpha)

    def polygon(self, corners: np.ndarray, color: str, alpha: float) -> None:
        """Add a plane polygon as a whole."""
        self._polygons(corners.mean(axis=0), corners[None], color, alpha)

    def rectangle(self, corners: np.ndarray, color: str) -> None:
        """Add a rectangle in cells, so that rectangles can cross each other."""
        origin = corners[0]
        steps = (corners[[1, 3]] - origin) / _CELL_COUNT
        cell = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        for place in np.ndindex(_CELL_COUNT, _CELL_COUNT):
            part = origin + (cell + place) @ steps
            self._polygons(part.mean(axis=0), part[None], color, 1.0, edge=color)

    def line(self, ends: np.ndarray, color: str, width: float, style: Any = '-') -> None:
        """Add a line in segments, so that near ones cover far ones along the line."""
        from matplotlib.collections import LineCollection
        self._seen.append(self.camera.flat(ends))
        stops = ends[0] + np.linspace(0.0, 1.0, _SEGMENT_COUNT + 1)[:, None] * (ends[1] - ends[0])
        # Dashes need the whole line.
        segments = zip(stops[:-1], stops[1:]) if style == '-' else [ends]
        for segment in segments:
            self._add(np.mean(segment, axis=0), LineCollection(
                [self.camera.flat(np.array(segment))], colors=color, lw=width, linestyles=[style],
                capstyle='round' if style == '-' else 'butt'))

    def arrow(self, start: np.ndarray, end: np.ndarray, color: str, width: float = 1.8) -> None:
        """Add a vector; the size of the head is the same for all."""
        from matplotlib.collections import PolyCollection
        flat = self.camera.flat(np.array([start, end]))
        along = (flat[1] - flat[0]) / np.linalg.norm(flat[1] - flat[0])
        across = np.array([-along[1], along[0]])
        base, side = flat[1] - 2.6 * self._head * along, self._head * across
        shown = 1.0 - 2.4 * self._head / np.linalg.norm(flat[1] - flat[0])
        self.line(np.array([start, start + shown * (end - start)]), color, width)
        self._add(end, PolyCollection(
            [np.array([flat[1], base + side, base - side])], facecolors=color,
            edgecolors='none'))

    def text(self, place: np.ndarray, words: str, color: str, size: float = 9.0,
             weight: str = 'normal') -> None:
        """Add words in front of everything."""
        self._seen.append(self.camera.flat(place)[None])
        self.axes.text(
            *self.camera.flat(place), words, color=color, fontsize=size, fontweight=weight,
            ha='center', va='center', zorder=10_000,
            bbox={'facecolor': 'white', 'alpha': 0.75, 'edgecolor': 'none', 'pad': 0.6})

    def finish(self, title: str) -> None:
        """Put all that was added on the picture."""
        for order, (_, artist) in enumerate(sorted(self._artists, key=lambda each: each[0])):
            artist.set_zorder(order)
            self.axes.add_collection(artist, autolim=False)
        self.axes.update_datalim(np.concatenate(self._seen))
        self.axes.autoscale_view()
        self.axes.set_aspect('equal')
        self.axes.set_axis_off()
        self.axes.set_title(title, fontsize=11)

    def _polygons(self, place: np.ndarray, polygons: np.ndarray, colors: Any, alpha: float,
                  edge: str = EDGE_COLOR) -> None:
        from matplotlib.collections import PolyCollection
        self._seen.append(self.camera.flat(polygons.reshape(-1, 3)))
        outlines: Any = self.camera.flat(polygons)
        self._add(place, PolyCollection(
            outlines, facecolors=colors, edgecolors=edge, lw=0.6, alpha=alpha))

    def _add(self, place: np.ndarray, artist: Any) -> None:
        self._artists.append((float(place @ self.camera.toward), artist))


def woven(**changes: Any) -> Scene:
    """Return a fabric without loads; `kind`, `size`, `variant` of its weave."""
    return Scene.from_parameters({
        'weave.connector_angle': CONNECTOR_ANGLE,
        **{f'weave.{name}': value for name, value in changes.items()}})


def corners_of(scene: Scene, body: int) -> np.ndarray:
    """Return world positions (12, 3) of the vertices of a shell [m]."""
    axes = cosines_from_quaternions(scene.orientation[body:body + 1])[0]
    return scene.position[body] + vertices(scene.shell.half_edge) @ axes


def ends_of(scene: Scene) -> np.ndarray:
    """Return world positions (c, 2, 3) of the ends of the connectors [m]."""
    axes = cosines_from_quaternions(scene.orientation)[scene.connectors.bodies]
    points = scene.connectors.points_body
    return scene.position[scene.connectors.bodies] + np.einsum('csi,csij->csj', points, axes)


def draw_edges(axes: Any, variant: int, title: str) -> None:
    """One shell in the axes of the world: named edges, connector ends 1 to 12, body axes."""
    scene = woven(size=[2, 2, 2], variant=variant)
    turn = cosines_from_quaternions(scene.orientation[:1])[0]  # rows: body axes in the world
    drawing = Drawing(axes, Camera(30.0, 24.0))
    corners = vertices(1.0) @ turn
    drawing.shell(np.zeros(3), corners, '#f1ead9', 0.72)
    for letter, axis in zip('xyz', turn):
        drawing.line(np.array([1.62 * axis, 3.5 * axis]), '0.45', 1.0)
        drawing.text(3.72 * axis, f'body {letter}', '0.35')
    for edge, name in enumerate(NAMED_EDGES):
        color = PAIR_COLORS[edge // 2]
        ends = vertices(1.0)[NAMED_EDGE_VERTICES[edge]] @ turn
        # In front of the faces that meet there.
        drawing.line(1.01 * ends, color, 5.0)
        # Beside the end of the edge that is farther from the middle of the picture.
        outer = ends[np.argmax(np.linalg.norm(drawing.camera.flat(ends), axis=1))]
        drawing.text(1.3 * outer, name, color, 10.0, 'bold')
    for number, ((edge, _), stub) in enumerate(
            zip(TABLE_5, connector_stubs(1.0, CONNECTOR_ANGLE)), 1):
        near, far = stub @ turn
        end = near + 0.62 * (far - near)
        drawing.line(np.array([1.01 * near, end]), PAIR_COLORS[edge // 2], 2.2)
        drawing.text(end + 0.13 * (far - near), str(number), PAIR_COLORS[edge // 2], 10.0)
    drawing.finish(title)
    axes.set(xlim=(-4.3, 4.3), ylim=(-4.3, 4.3))


def draw_neighbours(axes: Any, kind: str, title: str) -> None:
    """One shell and the twelve that connect to it."""
    scene = woven(kind=kind, size=[5, 5, 5])
    bodies = scene.connectors.bodies
    full = np.flatnonzero(np.bincount(bodies.ravel(), minlength=scene.body_count) == 12)
    middle = scene.position.mean(axis=0)
    body = int(full[np.argmin(np.linalg.norm(scene.position[full] - middle, axis=1))])
    own = np.flatnonzero((bodies == body).any(axis=1))
    drawing = Drawing(axes, Camera(-68.0, 24.0))
    for other in np.unique(bodies[own]).tolist():
        drawing.shell(scene.position[other], corners_of(scene, other),
                      *(('#e9c46a', 0.8) if other == body else (SHELL_COLOR, 0.5)))
    ends = ends_of(scene)
    for number in own.tolist():
        edge = int(scene.connectors.edges[number][int(bodies[number, 1] == body)])
        drawing.line(ends[number], PAIR_COLORS[edge // 2], 2.2)
    drawing.finish(title)


def draw_fabric(axes: Any, scene: Scene, camera: Camera, title: str) -> None:
    """Draw the shells and connectors of a fabric."""
    drawing = Drawing(axes, camera)
    for body in range(scene.body_count):
        drawing.shell(scene.position[body], corners_of(scene, body), SHELL_COLOR)
    for ends in ends_of(scene):
        drawing.line(ends, CONNECTOR_COLOR, 1.8)
    drawing.finish(title)


def draw_frames(axes: Any, title: str) -> None:
    """Draw Figure 2: primary frame, centre-of-mass frame and body frame (eqs 6 and 16)."""
    drawing = Drawing(axes, Camera(20.0, 18.0))
    centre, primary, body = _BODY_POSITION, np.eye(3), body_axes()
    corners = centre + vertices(1.0) @ body
    point = corners[np.argmax(corners @ (drawing.camera.plane[1] - drawing.camera.plane[0]))]
    drawing.shell(centre, corners, SHELL_COLOR, 0.6)
    for origin, frame, color, name, length in (
            (np.zeros(3), primary, '0.15', r'\hat{e}^0', 2.2),
            (centre, primary, PAIR_COLORS[0], 'x^{cm}', 2.9),
            (centre, body, PAIR_COLORS[1], r'\hat{e}', 2.9)):
        for number, axis in enumerate(frame, 1):
            drawing.arrow(origin, origin + length * axis, color)
            drawing.text(origin + (length + 0.35) * axis, f'${name}_{number}$', color, 12.0)
    for start, end, words in (
            (np.zeros(3), centre, r'$\mathbf{R}$'), (np.zeros(3), point, r'$\mathbf{r}$'),
            (centre, point, r"$\mathbf{r}'$")):
        drawing.arrow(start, end, PAIR_COLORS[2], 1.4)
        drawing.text(0.5 * (start + end), words, PAIR_COLORS[2], 12.0)
    drawing.finish(title)
    axes.set_position((0.02, 0.2, 0.96, 0.73))
    for place, (words, color) in enumerate((
            ('primary frame, at rest', '0.15'),
            ('centre-of-mass frame, parallel to it: x_cm = x_0 - R', PAIR_COLORS[0]),
            ('body frame, turns with the body', PAIR_COLORS[1]),
            ("a point of the body: r = R + r'", PAIR_COLORS[2]))):
        axes.figure.text(0.03, 0.16 - 0.045 * place, words, color=color, fontsize=9)


def draw_rectangles(axes: Any, title: str) -> None:
    """Draw Figure 3a: three perpendicular rectangles of sides 2a and w = 2 tau a (eq 50)."""
    drawing = Drawing(axes, Camera(28.0, 22.0))
    corners = vertices(1.0)
    for corners_of_one, color in zip(golden_rectangles(), ('#9ecae9', '#f5b58a', '#93d8bd')):
        drawing.rectangle(corners_of_one, color)
    front = FACES[corners[FACES].mean(axis=1) @ drawing.camera.toward > 0.0]
    seen = np.sort(np.concatenate([front[:, [0, 1]], front[:, [1, 2]], front[:, [2, 0]]]), axis=1)
    # In front of the rectangles that end there.
    lift = 0.01 * drawing.camera.toward
    for edge in EDGES:
        is_seen = (seen == edge).all(axis=1).any()
        drawing.line(corners[edge] + lift, EDGE_COLOR, 1.4 if is_seen else 0.7,
                     '-' if is_seen else (0, (3, 3)))
    for letter, axis in zip('xyz', np.eye(3)):
        drawing.arrow(TAU * axis, 2.5 * axis, '0.3')
        drawing.text(2.7 * axis, f'body {letter}', '0.3')
    for one, color in zip(golden_rectangles(), PAIR_COLORS):
        drawing.text(1.12 * one[:2].mean(axis=0), '2a', color, 10.0)
        # Along the long side, nearer to its near end.
        near, far = sorted(one[1:3], key=lambda end: float(-end @ drawing.camera.toward))
        drawing.text(1.1 * (0.65 * near + 0.35 * far), r'$2 \tau a$', color, 11.0)
    drawing.finish(title)


def draw_frustum(axes: Any, title: str) -> None:
    """Draw Figure 3b: the frustum of a face and its coordinates lambda (eqs 28 to 34)."""
    w1, w2, w3 = face_geometry(1.0).frames[_FRUSTUM_FACE - 1].T
    drawing = Drawing(axes, Camera(-6.0, 7.0), 0.03)
    outer, middle, inner = (
        frustum_section(ratio) for ratio in (1.0, _MIDDLE_RATIO, _INNER_RATIO))
    origin = np.zeros(3)
    for i in range(3):
        drawing.polygon(
            np.array([outer[i - 1], outer[i], inner[i], inner[i - 1]]), SHELL_COLOR, 0.4)
        drawing.line(np.array([origin, inner[i]]), '0.5', 0.9, (0, (4, 3)))
    for section, color, words in (
            (inner, PAIR_COLORS[2], r'$\lambda_1 = b/a$'),
            (middle, _SURFACE_COLOR, r'$\lambda_1$'), (outer, PAIR_COLORS[0], r'$\lambda_1 = 1$')):
        drawing.polygon(section, color, 0.3)
        drawing.text(np.array([0.1, 0.3, 0.6]) @ section, words, color, 11.0)
    for start, along, words in (
            (origin, w1, r'$\mathbf{w}_1 = \mathbf{v}_1$'), (w1, w2, r'$\mathbf{w}_2$'),
            (w1, w3, r'$\mathbf{w}_3$')):
        drawing.arrow(start, start + along, '0.15')
        drawing.text(1.06 * (start + 0.4 * along), words, '0.15', 12.0)
    for corner, words in zip(outer, (r'$\mathbf{v}_1$', r'$\mathbf{v}_2$', r'$\mathbf{v}_3$')):
        drawing.text(1.09 * corner, words, '0.15', 12.0)
    for end, words in (
            (middle[1], r'$\lambda_2$: 0 to $\lambda_1$'),
            (middle[2], r'$\lambda_3$: 0 to $\lambda_1 - \lambda_2$')):
        drawing.arrow(middle[0], end, _SURFACE_COLOR, 1.2)
        drawing.text(middle[0] + 0.45 * (end - middle[0]), words, _SURFACE_COLOR)
    drawing.text(-0.08 * w1, 'O', '0.15', 11.0)
    drawing.finish(title)


def body_axes() -> np.ndarray:
    """Return the axes of the body of Figure 2 as rows, in components of the primary frame."""
    turned = rotate_quaternions(_BODY_ROTATION[None], np.array([[0.0, 0.0, 0.0, 1.0]]))
    return cosines_from_quaternions(turned)[0]


def golden_rectangles() -> np.ndarray:
    """
    Return the corners (3, 4, 3) of the rectangles of opposite named edges, in units of a.

    The first two corners are the ends of an edge, of length 2a.
    """
    ends = vertices(1.0)[NAMED_EDGE_VERTICES].reshape(3, 2, 2, 3)
    return np.concatenate([ends[:, 0], ends[:, 1, ::-1]], axis=1)


def frustum_section(ratio: float) -> np.ndarray:
    """Return the corners (3, 3) at lambda1 = ratio of the frustum of Figure 3b (eq 31)."""
    frame = face_geometry(1.0).frames[_FRUSTUM_FACE - 1]
    return ratio * np.array([[1, 0, 0], [1, 1, 0], [1, 0, 1]]) @ frame.T


def new_figure(width: float, height: float) -> Any:
    """Return an empty figure of a size [inches]."""
    from matplotlib.figure import Figure
    return Figure(figsize=(width, height), dpi=90, facecolor='white')


class DocumentFigure(NamedTuple):
    """A figure of the document, and the function that draws the figure under a heading."""

    number: str
    title: str
    equations: Sequence[int]
    errata: Sequence[str]
    make: Callable[[str], Any]

    @property
    def caption(self) -> str:
        """Number and title with equations and errata."""
        return self.heading + (f' ({self.sources})' if self.sources else '')

    @property
    def heading(self) -> str:
        """Number and title."""
        return f'{self.number}: {self.title}'

    @property
    def sources(self) -> str:
        """Equations and errata that the figure belongs to."""
        return cite(self.equations, self.errata)


def draw_figure(name: str, path: Path) -> None:
    """Draw the figure FIGURES[name] to a PNG or SVG file, as its name ends; no display needed."""
    require_library('matplotlib', 'a picture')
    from matplotlib import rc_context
    figure = FIGURES[name]
    # Text stays text, and the same figure gives the same file.
    with rc_context({'svg.fonttype': 'none', 'svg.hashsalt': 'icofabric_sim'}):
        drawn = figure.make(figure.heading)
        if figure.sources:
            drawn.text(0.99, 0.01, figure.sources, ha='right', fontsize=8, color='0.35')
        save_figure(drawn, path)


def _on_one_plot(draw: Callable[..., None], *arguments: Any) -> Callable[[str], Any]:
    """Return a function that makes a figure with one plot and a title."""
    def make(title: str) -> Any:
        figure = new_figure(6.4, 5.4)
        draw(figure.add_axes((0.02, 0.05, 0.96, 0.87)), *arguments, title)
        return figure
    return make


def _draw_woven(axes: Any, size: Sequence[int], camera: Camera, title: str) -> None:
    draw_fabric(axes, woven(size=size), camera, title)


FIGURES = {
    '1': DocumentFigure(
        'Figure 1', 'an icosahedral fabric', (), (),
        _on_one_plot(_draw_woven, [4, 3, 4], Camera(-68.0, 14.0))),
    '2': DocumentFigure(
        'Figure 2', 'three coordinate frames', (6, 16), ('C1', 'C16'), _on_one_plot(draw_frames)),
    '3a': DocumentFigure(
        'Figure 3', 'golden rectangles in an icosahedron', (50,), ('C16',),
        _on_one_plot(draw_rectangles)),
    '3b': DocumentFigure(
        'Figure 3', 'frustum of a face', range(28, 35), ('C2', 'C5', 'C16'),
        _on_one_plot(draw_frustum)),
    '4': DocumentFigure(
        'Figure 4', 'an icosahedron and its 12 neighbours, orthogonal orientation', (50, 51), (),
        _on_one_plot(draw_neighbours, 'orthogonal')),
    'edges': DocumentFigure(
        'Table 5', 'six edges and twelve connectors, variants 0 and 1', (51,), (),
        _on_one_plot(draw_edges, 0)),
    '5': DocumentFigure(
        'Figure 5', 'connector length over connector angle', range(51, 55), (),
        length_figure),
    '6': DocumentFigure(
        'Figure 6', 'a slab of 3 x 3 x 3, variant 0', (56, 57, 58), (),
        _on_one_plot(_draw_woven, [3, 3, 3], Camera(-35.0, 20.0))),
    '7': DocumentFigure(
        'Figure 7', 'an icosahedron and its 12 neighbours, bias orientation', (50, 51), (),
        _on_one_plot(draw_neighbours, 'bias'))}
