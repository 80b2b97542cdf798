# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Markers of a fabric: connectors by strain class, and shells; few lists with stable ids.

The lists of one state are built one by one, on demand and directly into their messages, so that a
large fabric never needs memory for more than one list.
"""

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import FACES, vertices
from icofabric_sim.kernels.outlines import classify, fill_lines, fill_shells
from icofabric_sim.messages import MarkerAction, MarkerBytes, MarkerType
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.model.snapshot import Snapshot
import numpy as np

Color = tuple[float, float, float, float]


class StrainClass(NamedTuple):
    """Connectors of one colour, from a lower bound of the strain (l - D) / D."""

    above: float
    name: str
    color: Color


# A few lists instead of a colour for each point: 24 bytes per point instead of 40. Blue is
# compressed, red is stretched.
STRAIN_CLASSES = (
    StrainClass(-np.inf, 'compressed by more than 5 %', (0.13, 0.27, 0.80, 1.0)),
    StrainClass(-0.05, 'compressed by 0.5 % to 5 %', (0.40, 0.65, 0.95, 1.0)),
    StrainClass(-0.005, 'within 0.5 % of the natural length', (0.75, 0.75, 0.75, 1.0)),
    StrainClass(0.005, 'stretched by 0.5 % to 5 %', (0.98, 0.65, 0.35, 1.0)),
    StrainClass(0.05, 'stretched by more than 5 %', (0.85, 0.12, 0.10, 1.0)),
)
_ANCHOR_COLOR = (0.20, 0.65, 0.30, 1.0)
_BOUNDS = np.array([entry.above for entry in STRAIN_CLASSES[1:]])

# Connectors that enter their own shell, whatever their strain; the last list.
OBSTRUCTED = StrainClass(np.inf, 'in the shell it is attached to', (0.75, 0.10, 0.80, 1.0))
_NO_CLASS = 255  # class of broken connectors


class ShellClass(NamedTuple):
    """Shells of one colour."""

    name: str
    color: Color


SHELL_CLASSES = (
    ShellClass('free', (0.95, 0.88, 0.70, 1.0)),
    ShellClass('fixed by a support', (0.42, 0.47, 0.55, 1.0)),
)
# Shells are divided into groups of bodies, one list for each group and colour, to keep messages
# small: 1,440 bytes for each body. With very many bodies the groups become larger, not more.
_BODIES_PER_LIST, _MAX_LISTS = 20_000, 4


def held_bodies(scene: Scene) -> np.ndarray:
    """Return whether a support fixes the position of each body, (n,) bool."""
    if scene.supports is None:
        return np.zeros(scene.body_count, dtype=bool)
    return np.asarray(scene.supports.translation.all(axis=1))


def list_numbers(scene: Scene) -> set[int]:
    """Return the ids of the list markers of connectors and anchors, including empty lists."""
    numbers = {len(STRAIN_CLASSES)} if scene.anchors else set()
    if scene.connector_count:
        numbers.update((*range(len(STRAIN_CLASSES)), len(STRAIN_CLASSES) + 1))
    return numbers


class ConnectorMarkers:
    """
    Line lists of the connectors; the id of each is the number of its strain class.

    Anchors form one more list with its own colour and the next id. Connectors that enter their own
    shell form the last list. A connector wrapped over a shell has a line for each straight part.
    """

    def __init__(self, scene: Scene) -> None:
        """Build the constant parts."""
        width = 0.08 * scene.shell.half_edge
        self._lists = [
            MarkerBytes(
                scene.parameters['frame_id'], 'connectors', number, MarkerType.LINE_LIST,
                color=entry.color, scale=(width, 0.0, 0.0))
            for number, entry in (
                *enumerate(STRAIN_CLASSES), (len(STRAIN_CLASSES) + 1, OBSTRUCTED))
        ]
        self._anchors = MarkerBytes(
            scene.parameters['frame_id'], 'connectors', len(STRAIN_CLASSES),
            MarkerType.LINE_LIST, color=_ANCHOR_COLOR, scale=(width, 0.0, 0.0))

    def messages(self, snapshot: Snapshot, nanoseconds: int) -> Iterator[bytes]:
        """
        Yield one message for each class: its list, or its removal if the class is empty.

        Removals are repeated while a class is empty, so that the display does not depend on the
        messages that a viewer or a bag received before.
        """
        ends = snapshot.anchor_ends[snapshot.anchor_intact].reshape(-1, 3)
        if len(ends):
            yield self._anchors.filled(nanoseconds, len(ends), partial(np.copyto, src=ends))
        elif len(snapshot.anchor_ends):
            yield self._anchors.stamped(nanoseconds, action=MarkerAction.DELETE)
        connectors = snapshot.packed.connectors
        if connectors is None:
            return
        counts = np.zeros(len(self._lists), np.int64)
        classes = np.empty(snapshot.connector_count, np.uint8)
        classify(
            snapshot.connector_length, connectors.natural_length, _BOUNDS, classes, counts[:-1])
        wraps = snapshot.packed.model.wrapping is not None
        # Connectors wrapped over shells keep the colour of their strain.
        obstructed = snapshot.without_geodesic if wraps else snapshot.obstructed
        if obstructed.any() or snapshot.broken_since is not None:
            classes[obstructed > 0] = len(STRAIN_CLASSES)
            if snapshot.broken_since is not None:
                classes[~snapshot.intact] = _NO_CLASS
            counts[:] = [np.count_nonzero(classes == number) for number in range(len(counts))]
        if wraps and snapshot.obstructed.any():
            yield from self._bent_lists(snapshot, nanoseconds, classes)
            return
        for number, (marker, count) in enumerate(zip(self._lists, counts.tolist())):
            if count:
                yield marker.filled(nanoseconds, 2 * count, partial(
                    fill_lines, connectors, snapshot.position, snapshot.orientation, classes,
                    number))
            else:
                yield marker.stamped(nanoseconds, action=MarkerAction.DELETE)

    def _bent_lists(
        self, snapshot: Snapshot, nanoseconds: int, classes: np.ndarray
    ) -> Iterator[bytes]:
        """Yield the lists with all straight parts of wrapped connectors."""
        segments = snapshot.connector_segments
        of_class = classes[segments.of]
        for number, marker in enumerate(self._lists):
            points = segments.ends[of_class == number].reshape(-1, 3)
            if len(points):
                yield marker.filled(nanoseconds, len(points), partial(np.copyto, src=points))
            else:
                yield marker.stamped(nanoseconds, action=MarkerAction.DELETE)


class ShellMarkers:
    """Triangle lists of the shells: outer faces, counter-clockwise as seen from outside."""

    def __init__(self, scene: Scene) -> None:
        """Build the constant parts."""
        self._corners = FACES.ravel()
        edges = scene.body_half_edges
        alike = edges == scene.shell.half_edge
        held = held_bodies(scene)
        length = max(_BODIES_PER_LIST, -(-len(held) // _MAX_LISTS))
        self._lists: list[tuple[MarkerBytes, np.ndarray, np.ndarray]] = []

        def add(number: int, color: Color, bodies: np.ndarray, half_edge: float) -> None:
            self._lists.append((
                MarkerBytes(
                    scene.parameters['frame_id'], 'icosahedra', number, MarkerType.TRIANGLE_LIST,
                    color=color),
                bodies.astype(np.int32), vertices(half_edge)))

        number = 0
        for run, start in enumerate(range(0, len(held), length)):
            for kind, entry in enumerate(SHELL_CLASSES):
                number = run * len(SHELL_CLASSES) + kind
                here = slice(start, start + length)
                bodies = start + np.flatnonzero((held[here] == kind) & alike[here])
                if len(bodies):
                    add(number, entry.color, bodies, scene.shell.half_edge)
        for half_edge in np.unique(edges[~alike]).tolist():
            for kind, entry in enumerate(SHELL_CLASSES):
                bodies = np.flatnonzero((edges == half_edge) & (held == kind))
                if len(bodies):
                    number += 1
                    add(number, entry.color, bodies, half_edge)

    def messages(self, snapshot: Snapshot, nanoseconds: int) -> Iterator[bytes]:
        """Yield one list for each group of bodies and colour."""
        for marker, bodies, corners in self._lists:
            yield marker.filled(nanoseconds, len(self._corners) * len(bodies), partial(
                fill_shells, bodies, snapshot.position, snapshot.orientation, corners,
                self._corners))
