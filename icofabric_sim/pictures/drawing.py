# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Pictures of a fabric: single frames, and sheets of several moments side by side; no display needed.

All pictures made by one `Renderer` share view, scale and colours. Positions and orientations come
from snapshots or from bags. Polygons are painted several times as large as they are shown, and
the picture is made smaller: that smooths their edges.
"""

from collections.abc import Iterable, Sequence
from functools import lru_cache
import math
from pathlib import Path
from typing import Any

from icofabric_sim.geometry.icosahedron import circumscribed_radius, face_geometry, FACES, vertices
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.libraries import require_library
from icofabric_sim.messages.markers import held_bodies
from icofabric_sim.pictures.camera import Area, Camera, fit_camera, near_ones, View
from icofabric_sim.pictures.fabric_polygons import (
    ANCHOR_COLOR,
    anchor_points,
    BROKEN_COLOR,
    CONTACT_COLOR,
    driven_bodies,
    DRIVEN_COLOR,
    fabric_polygons,
    FREE_COLOR,
    HELD_COLOR,
    shown_bodies,
)
from icofabric_sim.pictures.light import Lighting
from icofabric_sim.pictures.measures import connector_segments, Scale
from icofabric_sim.pictures.moment import Moment, Push
from icofabric_sim.pictures.scenery import Ground, grounds, moved_plate, place_plate, plates
from icofabric_sim.scene.scene import Scene
from icofabric_sim.scene.shell_gaps import find_contacts
import numpy as np

DEFAULT_SIZE = (1280, 960)
TEXT_COLOR = (64, 68, 74)
_FAINT_COLOR = (120, 125, 132)
_FORCE_COLOR, _CONTACT_FORCE_COLOR = (190, 30, 40), (0, 130, 105)
# Top and bottom of the backdrop, floors and walls, and the lines on them.
_SKY, _EARTH = np.array([1.0, 1.0, 1.0]), np.array([0.945, 0.952, 0.962])
_GROUND, _LINE = (226, 228, 231), (208, 211, 215)
_PLATE_COLOR = np.array([0.60, 0.63, 0.67])
_SHADE = 0.40  # what a shadow takes from the ground
_VEIL = 0.30  # of what stands before the fabric
# Pixels of the painted polygons for each one of the picture.
SMOOTH = 3
# Parts of the height of a picture: heading, legend, and a line of text.
_HEADING, _FOOTING, _TEXT = 0.055, 0.085, 0.021
# Directions in which a moment's bodies reach farthest are what the camera is fitted to.
_DIRECTIONS = np.array([
    [x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z], float)
_ARROW, _CONTACT_ARROW = 4.5, 1.5  # edges


class Framing:
    """Region that pictures must show, collected from all states to be drawn."""

    def __init__(
        self, view: View | None = None, *, bodies: np.ndarray | None = None,
        follow: np.ndarray | None = None
    ) -> None:
        """
        See a fabric from one side.

        Only the `bodies` of these numbers are drawn; the camera moves with the middle of those of
        `follow`. Bodies that were lost far away are not waited for.
        """
        self.view = View() if view is None else view
        self.bodies, self.follow = bodies, follow
        self._points: list[np.ndarray] = []
        self.radius = 0.0

    def add(self, moment: Moment) -> None:
        """Add a state to the region."""
        scene = moment.scene
        places = moment.position[shown_bodies(scene, self.bodies)]
        kept = places[near_ones(places, _reach(scene.position))]
        if not len(kept):
            return
        if self.bodies is None:
            kept = np.concatenate([
                kept, *([anchor_points(moment)] if scene.anchors else ()),
                *(moved_plate(plate, moment)[0] for plate in plates(scene)),
                *(_arrow_ends(moment, push) for push in moment.pushes)])
        kept = kept - self.target_of(moment)
        self._points.append(kept[np.unique(np.argmax(kept @ _DIRECTIONS.T, axis=0))])
        self.radius = max(self.radius, 1.15 * circumscribed_radius(
            float(scene.body_half_edges.max(initial=scene.shell.half_edge))))

    def target_of(self, moment: Moment) -> np.ndarray:
        """Return the point that the camera follows (3,) [m]; 0 if it follows none."""
        if self.follow is None:
            return np.zeros(3)
        chosen = self.follow[self.follow < len(moment.position)]
        if not len(chosen):
            return np.zeros(3)
        return np.asarray(moment.position[chosen].mean(axis=0))

    @property
    def points(self) -> np.ndarray:
        """Points (m, 3) [m] around which balls of `radius` are shown, about what is followed."""
        if not self._points:
            return np.zeros((1, 3))
        return np.concatenate(self._points)

    def camera(self, area: Area) -> Camera:
        """Return the camera for an area of this shape, centred on the followed bodies if any."""
        target = None if self.follow is None else np.zeros(3)
        return fit_camera(self.view, self.points, max(self.radius, 1e-9), area, target=target)


def _is_outward(moment: Moment, push: Push) -> bool:
    """Return True if a force points away from the centre of the fabric."""
    return float(push.force @ (push.point - moment.position.mean(axis=0))) > 0.0


def _arrow_ends(moment: Moment, push: Push) -> np.ndarray:
    """Tail and tip (2, 3) [m] of the arrow of a force: outside of the fabric, if that can be."""
    edge = moment.scene.shell.edge_length
    along = push.force / np.linalg.norm(push.force)
    away = 1.2 * edge if _is_outward(moment, push) else -(_ARROW + 1.2) * edge
    tail = push.point + away * along
    return np.array([tail, tail + _ARROW * edge * along])


def _arrow_outline(
    tail: np.ndarray, tip: np.ndarray, breadth: float, head: float, extra: float = 0.0
) -> np.ndarray:
    """Corners (7, 2) [pixels] of an arrow with half the width `breadth`, `extra` around it."""
    unit = (tip - tail) / max(float(np.linalg.norm(tip - tail)), 1.0)
    side, neck = np.array([-unit[1], unit[0]]), tip - head * unit
    return np.array([
        tail - extra * unit + (breadth + extra) * side,
        neck + (breadth + extra) * side,
        neck + (2.4 * breadth + 1.6 * extra) * side - 0.4 * extra * unit,
        tip + 1.8 * extra * unit,
        neck - (2.4 * breadth + 1.6 * extra) * side - 0.4 * extra * unit,
        neck - (breadth + extra) * side,
        tail - extra * unit - (breadth + extra) * side])


def _reach(position: np.ndarray) -> float:
    return float(np.linalg.norm(position.max(axis=0) - position.min(axis=0)))


def frame_moments(
    moments: Iterable[Moment], view: View | None = None, *, bodies: np.ndarray | None = None,
    follow: np.ndarray | None = None
) -> Framing:
    """Return the framing of all moments; raise ValueError if a position is not finite."""
    framing = Framing(view, bodies=bodies, follow=follow)
    for moment in moments:
        framing.add(moment)
    return framing


class Renderer:
    """Draws moments of one run from one side and at one scale."""

    def __init__(
        self, framing: Framing, *, title: str = '', size: tuple[int, int] = DEFAULT_SIZE,
        color: str = '', scale: Scale | None = None, smooth: int = SMOOTH
    ) -> None:
        """
        Show what the framing holds in pictures of `size` pixels.

        `color` is a name of `measures.QUANTITIES`, and `scale` its scale. A sheet is as wide, and
        as high as its rows need but no higher.
        """
        require_library('matplotlib', 'a picture')
        self.framing, self.title, self.size = framing, title, size
        self.color, self.scale, self._smooth = color, scale, smooth
        self._backdrops: dict[Any, Any] = {}
        # In a small picture text stays legible.
        self._text = max(round(_TEXT * min(size[1], 0.75 * size[0])), 10)
        self._legend: dict[str, np.ndarray] = {}

    def frame(self, moment: Moment, path: str | Path) -> None:
        """Draw one moment to a PNG file."""
        self.picture(moment).save(path, format='PNG')

    def picture(self, moment: Moment, *, legend: Iterable[Moment] | None = None) -> Any:
        """
        One moment as a picture of PIL.

        Its legend explains what is seen in it, or in the moments `legend`: those of a film.
        """
        from PIL import ImageDraw

        width, height = self.size
        top, bottom = self._strips()
        area = Area(0.02 * width, top, 0.96 * width, height - top - bottom)
        camera = self.framing.camera(area)
        image = self._paint(moment, camera, self.size, area)
        draw = ImageDraw.Draw(image)
        size = self._text
        if self.title:
            draw.text((0.02 * width, 0.5 * top), self.title, fill=TEXT_COLOR,
                      font=_font(round(1.15 * size)), anchor='lm')
        draw.text((0.98 * width, 0.5 * top), _caption(moment), fill=TEXT_COLOR, font=_font(size),
                  anchor='rm')
        for one in [moment] if legend is None else legend:
            self._note_legend(one)
        self._footing(image, camera, area)
        return image

    def sheet(self, moments: Sequence[Moment], path: str | Path) -> None:
        """Draw moments side by side to a PNG file."""
        from PIL import Image, ImageDraw

        if not moments:
            raise ValueError('there is nothing to draw: give at least one moment')
        if len(moments) == 1:
            self.frame(moments[0], path)
            return
        top, bottom = self._strips()
        top = top if self.title else 0.3 * top
        caption = round(1.9 * self._text)
        columns, rows, panel = self._arrange(len(moments), top, bottom, caption)
        width, height = self.size[0], round(top + bottom + rows * panel[1])
        image = Image.fromarray(_gradient((width, height)))
        draw = ImageDraw.Draw(image)
        area = Area(0.02 * panel[0], caption, 0.96 * panel[0], panel[1] - caption)
        camera = self.framing.camera(area)
        for number, moment in enumerate(moments):
            row, column = divmod(number, columns)
            left, upper = round(column * panel[0]), round(top + row * panel[1])
            size = (round(panel[0]), round(panel[1]))
            backdrop = image.crop((left, upper, left + size[0], upper + size[1]))
            image.paste(self._paint(moment, camera, size, area, backdrop), (left, upper))
            draw.text((left + 0.5 * panel[0], upper + 0.5 * caption), _caption(moment),
                      fill=TEXT_COLOR, font=_font(self._text), anchor='mm')
            self._note_legend(moment)
        if self.title:
            draw.text((0.02 * width, 0.5 * top), self.title, fill=TEXT_COLOR,
                      font=_font(round(1.15 * self._text)), anchor='lm')
        self._footing(image, camera, area)
        image.save(path, format='PNG')

    def _strips(self) -> tuple[float, float]:
        """Heights [pixels] of the heading and of the legend."""
        return (max(_HEADING * self.size[1], 2.4 * self._text),
                max(_FOOTING * self.size[1], 3.6 * self._text))

    def _arrange(
        self, count: int, top: float, bottom: float, caption: float
    ) -> tuple[int, int, tuple[float, float]]:
        """
        Columns and rows that show `count` panels at the largest scale, and the size of a panel.
        """
        wide, high = self.size[0], self.size[1] - top - bottom
        seen = self.framing.points @ self.framing.view.axes.T
        extent = seen.max(axis=0) - seen.min(axis=0) + 2.0 * self.framing.radius

        def scale(columns: int) -> float:
            rows = math.ceil(count / columns)
            return float(min(
                0.96 * wide / columns / extent[0], max(high / rows - caption, 1.0) / extent[1]))

        columns = max(range(1, count + 1), key=lambda columns: (scale(columns), -columns))
        rows = math.ceil(count / columns)
        least = max(1.12 * scale(columns) * extent[1] + caption, 8.0 * self._text)
        return columns, rows, (wide / columns, min(least, high / rows))

    def _paint(
        self, moment: Moment, camera: Camera, size: tuple[int, int], area: Area,
        backdrop: Any = None
    ) -> Any:
        """Return the image of the fabric and its surroundings, without text."""
        from PIL import Image, ImageDraw

        smooth, scene = self._smooth, moment.scene
        camera = camera.moved_to(camera.target + self.framing.target_of(moment))
        lighting = Lighting.of(camera.axes)
        shown = shown_bodies(scene, self.framing.bodies)
        around = grounds(
            scene, camera, camera.target, max(_reach(self.framing.points), self.framing.radius),
            moment.time)
        image = self._backdrop(scene, camera, size, area, around, backdrop)
        for ground in around:
            if ground.faces_viewer:
                image = _shadowed(image, moment, shown, ground, camera, area, lighting)
        canvas = image.resize(
            (size[0] * smooth, size[1] * smooth), resample=Image.Resampling.NEAREST)
        fine = area.times(smooth)
        draw = ImageDraw.Draw(canvas)
        placed = [] if self.framing.bodies is not None else [
            (plate, place_plate(plate, moment, camera)) for plate in plates(scene)]
        for plate, place in placed:
            if not place.before:
                _draw_plate(draw, plate.held, place, camera, fine, lighting)
        shapes = fabric_polygons(
            moment, camera, fine, scale=self.scale, color=self.color, bodies=self.framing.bodies)
        _fill(draw, shapes.corners, shapes.colors)
        for plate, place in placed:
            if place.before:
                veil = canvas.copy()
                _draw_plate(ImageDraw.Draw(veil), plate.held, place, camera, fine, lighting)
                canvas = Image.blend(canvas, veil, _VEIL)
        draw = ImageDraw.Draw(canvas)
        for ground in around:
            if not ground.faces_viewer:
                rim = camera.project(ground.rim, fine)
                draw.line([*map(tuple, rim.tolist()), tuple(rim[0].tolist())], fill=_LINE,
                          width=2 * smooth)
        self._contact_arrows(draw, moment, camera, fine)
        labels = [self._arrow(draw, moment, push, camera, fine) for push in moment.pushes]
        image = canvas.reduce(smooth)
        draw = ImageDraw.Draw(image)
        for spot, text, anchor in labels:
            draw.text(spot, text, fill=_FORCE_COLOR, font=_font(self._text), anchor=anchor,
                      stroke_width=max(self._text // 6, 1), stroke_fill=(255, 255, 255))
        return image

    def _backdrop(
        self, scene: Scene, camera: Camera, size: tuple[int, int], area: Area,
        around: list[Ground], backdrop: Any
    ) -> Any:
        """Draw the static parts: the backdrop and the planes that face the viewer."""
        from PIL import Image, ImageDraw, ImageFilter

        key = (
            camera.target.tobytes(), camera.distance, size, id(scene),
            tuple(ground.offset for ground in around))
        if backdrop is None and key in self._backdrops:
            return self._backdrops[key]
        image = Image.fromarray(_gradient(size)) if backdrop is None else backdrop
        for ground in around:
            if not ground.faces_viewer:
                continue
            floor = Image.new('RGB', (2 * size[0], 2 * size[1]), _GROUND)
            draw, fine = ImageDraw.Draw(floor), area.times(2)
            for line in ground.lines:
                ends = _clipped(line, camera)
                if ends is not None:
                    draw.line([tuple(end) for end in camera.project(ends, fine).tolist()],
                              fill=_LINE, width=3)
            mask = Image.new('L', (size[0] // 4 + 1, size[1] // 4 + 1), 0)
            middle = ground.rim.mean(axis=0)
            pen = ImageDraw.Draw(mask)
            for part in np.linspace(1.0, 0.45, 12):
                rim = middle + part * (ground.rim - middle)
                rim = rim[camera.is_before(rim)]
                if len(rim) > 2:
                    points = camera.project(rim, area.times(0.25))
                    pen.polygon(_flat(points), fill=round(255 * (1.0 - part) / 0.55))
            mask = mask.filter(ImageFilter.GaussianBlur(0.012 * size[0])).resize(
                size, resample=Image.Resampling.BILINEAR)
            image = Image.composite(floor.reduce(2), image, mask)
        if backdrop is None:
            self._backdrops = {key: image}
        return image

    def _contact_arrows(self, draw: Any, moment: Moment, camera: Camera, area: Area) -> None:
        """Draw the forces of contacts on shells as arrows."""
        arrows = moment.contact_forces
        if arrows is None or not len(arrows):
            return
        sizes = np.linalg.norm(arrows[:, 1], axis=1)
        edge = moment.scene.shell.edge_length
        tips = arrows[:, 0] + arrows[:, 1] * (_CONTACT_ARROW * edge / sizes.max())
        breadth = max(0.06 * edge * camera.pixels_per_meter(area), 1.5)
        for number in np.argsort(sizes):
            tail, tip = camera.project(np.array([arrows[number, 0], tips[number]]), area)
            length = float(np.linalg.norm(tip - tail))
            if length > breadth:
                draw.polygon(
                    _flat(_arrow_outline(tail, tip, breadth, min(4.0 * breadth, 0.6 * length))),
                    fill=_CONTACT_FORCE_COLOR, outline=(255, 255, 255))

    def _arrow(
        self, draw: Any, moment: Moment, push: Any, camera: Camera, area: Area
    ) -> tuple[tuple[float, float], str, str]:
        """Draw a force; returns where its label stands [pixels], the label, and its anchor."""
        edge = moment.scene.shell.edge_length
        size = float(np.linalg.norm(push.force))
        outward = _is_outward(moment, push)
        ends = camera.project(_arrow_ends(moment, push), area)
        shaft = ends[1] - ends[0]
        length = max(float(np.linalg.norm(shaft)), 1.0)
        unit = shaft / length
        breadth = max(0.16 * edge * camera.pixels_per_meter(area), 3.0)
        head = min(5.0 * breadth, 0.6 * length)
        for extra, color in ((0.55 * breadth, (255, 255, 255)), (0.0, _FORCE_COLOR)):
            draw.polygon(
                _flat(_arrow_outline(ends[0], ends[1], breadth, head, extra)), fill=color)
        away = unit if outward else -unit
        place = (ends[1 if outward else 0] / self._smooth) + 0.7 * self._text * away
        anchor = ('lm' if away[0] > 0.0 else 'rm') if abs(away[0]) > 0.5 else (
            'mt' if away[1] > 0.0 else 'mb')
        return (float(place[0]), float(place[1])), f'{push.name} {size:.3g} N', anchor

    def _note_legend(self, moment: Moment) -> None:
        """Note what a moment shows that a legend must explain."""
        scene, legend = moment.scene, self._legend
        held, driven = held_bodies(scene), driven_bodies(scene)
        shown = shown_bodies(scene, self.framing.bodies)
        by_color = self.scale is not None and self.scale.quantity.of_bodies
        if not by_color:
            if (shown & ~held & ~driven).any():
                legend['free shell'] = FREE_COLOR
            if (shown & held).any():
                legend['held'] = HELD_COLOR
            if (shown & driven).any():
                legend['driven'] = DRIVEN_COLOR
        if scene.anchors:
            legend['anchor'] = ANCHOR_COLOR
        if moment.broken is not None and len(moment.broken):
            legend['broken connector'] = BROKEN_COLOR
        if moment.contact_forces is not None and len(moment.contact_forces):
            legend['force of a contact'] = np.array(_CONTACT_FORCE_COLOR) / 255.0
        if 'contact' not in legend and scene.body_count <= 20_000 and len(
                find_contacts(
                    scene.body_half_edges, moment.position, moment.orientation).bodies):
            legend['contact'] = CONTACT_COLOR

    def _footing(self, image: Any, camera: Camera, area: Area) -> None:
        """Scale bar, axes, what colours mean."""
        from PIL import ImageDraw

        draw, size = ImageDraw.Draw(image), self._text
        width, height = image.size
        middle = height - 0.5 * self._strips()[1]
        font, small = _font(size), _font(round(0.92 * size))
        left = 0.02 * width + 1.6 * size
        for name, direction in sorted(
                zip('xyz', camera.axes.T), key=lambda item: float(item[1][2])):
            tip = 1.5 * size * direction[:2] * np.array([1.0, -1.0])
            base = np.array([left, middle + 0.5 * size])
            draw.line([tuple(base.tolist()), tuple((base + tip).tolist())], fill=_FAINT_COLOR,
                      width=max(size // 9, 1))
            draw.text(tuple((base + 1.35 * tip).tolist()), name, fill=_FAINT_COLOR, font=small,
                      anchor='mm')
        left += 3.4 * size
        scale = camera.pixels_per_meter(area)
        wanted = min(0.14 * width, 12.0 * size) / scale
        power = 10.0 ** math.floor(math.log10(wanted))
        length = power * max(part for part in (1.0, 2.0, 5.0) if part * power <= wanted)
        right = left + length * scale
        tick, line = 0.3 * size, max(size // 8, 1)
        draw.line([(left, middle), (right, middle)], fill=TEXT_COLOR, width=line)
        for end in (left, right):
            draw.line([(end, middle - tick), (end, middle + tick)], fill=TEXT_COLOR, width=line)
        draw.text((0.5 * (left + right), middle - 0.35 * size), f'{length:g} m', fill=TEXT_COLOR,
                  font=small, anchor='mb')
        left = max(right, left + 3.0 * size) + 2.0 * size
        end = self._colour_bar(draw, width, middle) if self.scale is not None else 0.98 * width
        reaches = {label: 2.8 * size + font.getlength(label) for label in self._legend}
        # What does not fit into one row goes into two.
        rows = [middle] if left + sum(reaches.values()) <= end else [
            middle - 0.85 * size, middle + 0.85 * size]
        place, height = left, rows.pop(0)
        for label, color in self._legend.items():
            if place + reaches[label] > end:
                if not rows:
                    break
                place, height = left, rows.pop(0)
            self._explain(draw, label, color, (place, height))
            place += reaches[label]

    def _explain(
        self, draw: Any, label: str, color: np.ndarray, spot: tuple[float, float]
    ) -> None:
        """Draw an item of the legend: a mark and its name."""
        size, (left, middle) = self._text, spot
        tone = tuple(round(255 * float(part)) for part in np.clip(color, 0.0, 1.0))
        if label in ('anchor', 'broken connector'):
            draw.line([(left - 0.4 * size, middle), (left + 0.7 * size, middle)], fill=tone,
                      width=max(size // 4, 2))
        elif label == 'contact':
            draw.ellipse([left - 0.35 * size, middle - 0.35 * size, left + 0.35 * size,
                          middle + 0.35 * size], fill=tone)
        else:
            angles = np.arange(6) * (math.pi / 3.0) + math.pi / 6.0
            draw.polygon(_flat(np.stack(
                [left + 0.6 * size * np.cos(angles), middle + 0.6 * size * np.sin(angles)],
                axis=1)), fill=tone, outline=_FAINT_COLOR)
        draw.text((left + 1.1 * size, middle), label, fill=TEXT_COLOR, font=_font(size),
                  anchor='lm')

    def _colour_bar(self, draw: Any, width: int, middle: float) -> float:
        """Draw the scale of colours at the right; returns where it begins [pixels]."""
        assert self.scale is not None
        size, scale = self._text, self.scale
        length = min(0.26 * width, 22.0 * size)
        left, right = 0.98 * width - length - size, 0.98 * width - size
        top, bottom = middle - 0.75 * size, middle - 0.15 * size
        values = np.linspace(scale.least, scale.largest, round(right - left) + 1)
        for number, color in enumerate(scale.colors(values)):
            column = round(left) + number
            draw.line([(column, top), (column, bottom)],
                      fill=tuple(np.rint(255 * color).astype(int)))
        small = _font(round(0.9 * size))
        ticks = [scale.least, 0.0, scale.largest] if scale.quantity.signed else [
            0.0, 0.5 * scale.largest, scale.largest]
        for value in ticks:
            part = (value - scale.least) / (scale.largest - scale.least)
            x = left + part * (right - left)
            draw.line([(x, bottom), (x, bottom + 0.25 * size)], fill=TEXT_COLOR)
            draw.text((x, bottom + 0.35 * size), scale.text(value), fill=TEXT_COLOR, font=small,
                      anchor='mt')
        label = f'{scale.quantity.label} [{scale.quantity.unit}]'
        draw.text((0.5 * (left + right), top - 0.3 * size), label, fill=TEXT_COLOR, font=small,
                  anchor='mb')
        return left - 2.0 * size


def _caption(moment: Moment) -> str:
    when = '' if math.isnan(moment.time) else f't = {moment.time:.3f} s'
    return '    '.join(part for part in (moment.note, when) if part)


@lru_cache(maxsize=16)
def _font(size: int) -> Any:
    """Return the font of matplotlib's figures, which matplotlib includes."""
    from matplotlib import get_data_path
    from PIL import ImageFont
    return ImageFont.truetype(str(Path(get_data_path()) / 'fonts/ttf/DejaVuSans.ttf'), size)


def _gradient(size: tuple[int, int]) -> np.ndarray:
    """Return a plain background, (height, width, 3) uint8."""
    part = np.linspace(0.0, 1.0, size[1])[:, None] ** 1.5
    rows = np.rint(255.0 * ((1.0 - part) * _SKY + part * _EARTH)).astype(np.uint8)
    return np.ascontiguousarray(np.broadcast_to(rows[:, None], (size[1], size[0], 3)))


def _flat(points: np.ndarray) -> list[float]:
    return list(np.asarray(points).reshape(-1).tolist())


def _fill(draw: Any, corners: np.ndarray, colors: np.ndarray) -> None:
    """Fill polygons (m, k, 2) in their order."""
    tones = np.rint(255.0 * np.clip(colors, 0.0, 1.0)).astype(int).tolist()
    flat = (corners + 0.5).reshape(len(corners), -1).tolist()
    for points, tone in zip(flat, tones):
        draw.polygon(points, fill=tuple(tone))


def _draw_plate(
    draw: Any, held: bool, place: Any, camera: Camera, area: Area, lighting: Lighting
) -> None:
    base = _PLATE_COLOR if held else 0.55 * _PLATE_COLOR + 0.45 * DRIVEN_COLOR
    for face, normal in zip(place.faces, place.normals):
        if not camera.is_before(face).all():
            continue
        bright = 0.72 + 0.14 * float(normal[2]) + 0.26 * max(float(normal @ lighting.lamp), 0.0)
        points = camera.project(face, area)
        color = np.clip(base * bright, 0.0, 1.0)
        draw.polygon(_flat(points), fill=tuple(np.rint(255 * color).astype(int)),
                     outline=tuple(np.rint(255 * 0.86 * color).astype(int)), width=2)


def _clipped(line: np.ndarray, camera: Camera) -> np.ndarray | None:
    """Return the part of a line (2, 3) in front of the camera."""
    depth = camera.distance - camera.seen(line)[:, 2]
    least = 0.08 * camera.distance
    if (depth <= least).all():
        return None
    if (depth > least).all():
        return line
    part = (least - depth[0]) / (depth[1] - depth[0])
    cut = line[0] + part * (line[1] - line[0])
    return np.array([line[0], cut] if depth[0] > least else [cut, line[1]])


def _shadowed(
    image: Any, moment: Moment, shown: np.ndarray, ground: Ground, camera: Camera, area: Area,
    lighting: Lighting
) -> Any:
    """Return the picture with shadows on a plane, which are sharper near the plane."""
    from PIL import Image, ImageChops, ImageDraw, ImageFilter

    scene = moment.scene
    half_edge = scene.shell.half_edge
    chosen = np.flatnonzero(shown & np.isfinite(moment.position).all(axis=1))
    if len(chosen) > 20_000:
        return image
    cosines = cosines_from_quaternions(moment.orientation[chosen])
    corners = moment.position[chosen, None] + np.einsum(
        'n,va,nai->nvi', scene.body_half_edges[chosen], vertices(1.0), cosines)
    cast = ground.shadows(corners, lighting)
    lit = np.einsum('fa,nai->nfi', face_geometry(half_edge).normals, cosines) @ lighting.lamp > 0.0
    height = moment.position[chosen] @ ground.normal - ground.offset
    pixel = camera.pixels_per_meter(area) * half_edge
    total = None
    levels = [(-math.inf, 5.0 * half_edge, 0.35), (5.0 * half_edge, 16.0 * half_edge, 1.0),
              (16.0 * half_edge, math.inf, 2.2)]
    bars = np.zeros((0, 2, 3))
    if scene.connector_count:
        whole = shown[scene.connectors.bodies].all(axis=1)
        if moment.broken is not None:
            whole[moment.broken] = False
        segments = connector_segments(scene, moment.position, moment.orientation)
        bars = segments.ends[whole[segments.of]]
    over = bars.mean(axis=1) @ ground.normal - ground.offset
    thick = max(round(0.2 * pixel), 1)
    for low, high, soft in levels:
        mask = Image.new('L', image.size, 0)
        draw = ImageDraw.Draw(mask)
        level = (height >= low) & (height < high)
        body, face = np.nonzero(lit & level[:, None])
        triangles = cast[body[:, None], FACES[face]]
        triangles = triangles[np.isfinite(triangles).all(axis=(1, 2))]
        triangles = triangles[camera.is_before(triangles).all(axis=1)]
        lines = ground.shadows(bars[(over >= low) & (over < high)], lighting)
        lines = lines[np.isfinite(lines).all(axis=(1, 2))]
        lines = lines[camera.is_before(lines).all(axis=1)]
        if not (len(triangles) or len(lines)):
            continue
        for points in camera.project(triangles, area).reshape(-1, 6).tolist():
            draw.polygon(points, fill=255)
        for points in camera.project(lines, area).reshape(-1, 4).tolist():
            draw.line(points, fill=190, width=thick)
        # Far above the ground a shadow is wide and weak.
        mask = mask.filter(ImageFilter.GaussianBlur(float(max(soft * pixel, 0.6))))
        total = mask if total is None else ImageChops.lighter(total, mask)
    if total is None:
        return image
    dark = Image.new('RGB', image.size, (58, 64, 78))
    return Image.composite(dark, image, total.point(lambda value: value * _SHADE))
