# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Data of a fabric from its topics: the published bytes, decoded when needed.

The module does not depend on the source (a graph, a run or a bag) or on the display.
"""

from collections import deque
import threading
from typing import NamedTuple

from icofabric_sim.messages import (
    decode_diagnostic_array,
    decode_float64_multi_array,
    decode_marker_array,
    decode_marker_points,
    decode_pose_array,
    decode_string,
    MarkerAction,
    MarkerPoints,
    topics,
)
from icofabric_sim.messages.markers import held_bodies
from icofabric_sim.messages.topics import Topic
from icofabric_sim.parameters.changes import rebuilds
from icofabric_sim.parameters.named_files import with_recorded_files
from icofabric_sim.parameters.sections import ParameterSet
from icofabric_sim.parameters.validation import make_parameters, Parameters
from icofabric_sim.scene.published import spread
from icofabric_sim.scene.scene import Scene
import numpy as np

# Topics shown on a page.
TOPICS = (
    topics.WEAVE, topics.POSES, topics.CONNECTORS, topics.MARKERS, topics.ENERGY, topics.BROKEN,
    topics.DIAGNOSTICS)
# Number of samples of each curve.
_SAMPLE_COUNT = 600
_REAL_TIME_FACTOR = 'real-time factor'
# Number of groups whose displacement is plotted; more lines would be indistinguishable.
_MAX_GROUPS = 3


class Fabric(NamedTuple):
    """Constant data of one weave."""

    parameters: Parameters
    scene: Scene
    held: np.ndarray  # (n,) bool: a support fixes the position

    @property
    def groups(self) -> dict[str, np.ndarray]:
        """Return the bodies of the first movable groups of the scene, by name."""
        moving = {name: bodies for name, bodies in self.scene.groups.items()
                  if not self.held[bodies].all() and self.seen[bodies].all()}
        return dict(list(moving.items())[:_MAX_GROUPS])

    @property
    def seen(self) -> np.ndarray:
        """Return whether the pose of each body is published, (n,) bool."""
        chosen = self.scene.published_bodies
        seen = np.full(self.scene.body_count, chosen is None)
        if chosen is not None:
            seen[chosen] = True
        return seen


class Curve(NamedTuple):
    """Sample of the plotted quantities."""

    time: float  # [s]
    kinetic: float  # [J]
    connectors: float
    balance_error: float
    real_time_factor: float
    displacement: float  # [m] largest from the start of the scene
    groups: tuple[float, ...] = ()  # [m] of the centroids of `Fabric.groups`


class Sight:
    """Latest data of all topics; `feed` and the other methods may run in different threads."""

    def __init__(self, name: str = '/icofabric') -> None:
        """Start without data of the fabric `name`; diagnostics are shared by all nodes."""
        self._name = name
        self._lock = threading.Lock()
        self.fabric: Fabric | None = None
        self.fabric_number = 0  # incremented with each weave
        self.pose_number = 0  # incremented with each message of poses
        self.news = threading.Event()  # set with each of these
        self._poses = b''
        self.lines: dict[int, np.ndarray] = {}  # ends (m, 2, 3) [m] by the id of the list
        self.line_number = 0
        self.markers: dict[tuple[str, int], MarkerPoints] = {}
        self.marker_number = 0
        self.broken = np.zeros(0, np.int64)
        self.status, self.message = 0, ''
        self.figures: dict[str, str] = {}
        self.energy: dict[str, float] = {}
        self.curves: deque[Curve] = deque(maxlen=_SAMPLE_COUNT)
        self.time = 0  # [ns]

    def feed(self, topic: Topic, data: bytes) -> None:
        """Accept a message; raise ValueError if it is malformed."""
        with self._lock:
            if topic is topics.POSES:
                # Decoded when drawn, because more messages arrive than are shown.
                self._poses, self.pose_number = data, self.pose_number + 1
                self.news.set()
            elif topic is topics.CONNECTORS:
                self._take_lines(decode_marker_points(data))
            elif topic is topics.MARKERS:
                self.markers = {
                    (item.namespace, item.marker_id): item for item in decode_marker_array(data)}
                self.marker_number += 1
            elif topic is topics.WEAVE:
                self._take_weave(decode_string(data))
            elif topic is topics.BROKEN:
                self.broken = decode_float64_multi_array(data).values[:, 0].astype(np.int64)
            elif topic is topics.ENERGY:
                found = decode_float64_multi_array(data)
                self.energy = dict(zip(found.labels[0].split(', '), found.values.tolist()))
            elif topic is topics.DIAGNOSTICS:
                self._take_report(data)

    def poses(self) -> np.ndarray:
        """
        Return the latest positions [m] and orientations x y z w, (n, 7); empty before the first.

        Bodies without published poses stay at their woven positions.
        """
        with self._lock:
            data, fabric = self._poses, self.fabric
        if not data:
            return np.zeros((0, 7))
        found = decode_pose_array(data)
        self.time = found.nanoseconds
        values = np.asarray(found.values)
        chosen = None if fabric is None else fabric.scene.published_bodies
        if fabric is None or chosen is None:
            return values
        if len(values) != len(chosen):
            return np.zeros((0, 7))  # from another weave
        rest = np.concatenate([fabric.scene.position, fabric.scene.orientation], axis=1)
        return spread(chosen, values, rest)

    def broken_ends(self, poses: np.ndarray) -> np.ndarray:
        """Return the ends of broken connectors for these poses, (m, 2, 3) [m]."""
        fabric, broken = self.fabric, self.broken
        if fabric is None or not len(broken) or len(poses) != fabric.scene.body_count:
            return np.zeros((0, 2, 3))
        connectors = fabric.scene.connectors
        # Negative numbers stand for anchors, which are in the markers.
        broken = broken[(broken >= 0) & (broken < fabric.scene.connector_count)]
        broken = broken[fabric.seen[connectors.bodies[broken]].all(axis=1)]
        bodies, arms = connectors.bodies[broken], connectors.points_body[broken]
        axis, real = poses[bodies, 3:6], poses[bodies, 6:]
        twice = 2.0 * np.cross(axis, arms)
        return np.asarray(
            poses[bodies, :3] + arms + real * twice + np.cross(axis, twice))

    def sample(self) -> None:
        """Append the present values to the curves."""
        poses, fabric = self.poses(), self.fabric
        if fabric is None or len(poses) != fabric.scene.body_count:
            return
        time = self.time * 1e-9
        if self.curves and time < self.curves[-1].time:
            self.curves.clear()
        if self.curves and time == self.curves[-1].time:
            return
        shift = poses[:, :3] - fabric.scene.position
        away = np.linalg.norm(shift, axis=1).max(initial=0.0)
        groups = tuple(
            float(np.linalg.norm(shift[bodies].mean(axis=0))) for bodies in fabric.groups.values())
        energy = self.energy
        kinetic, connectors, balance_error = (
            energy.get(name, np.nan) for name in ('kinetic', 'connectors', 'balance error'))
        self.curves.append(Curve(
            time, kinetic, connectors, balance_error,
            _number(self.figures.get(_REAL_TIME_FACTOR, '')),
            float(away), groups))

    @property
    def span(self) -> tuple[float, float] | None:
        """
        Return start and end of a recorded run [s], as its replay reports; None if it does not.
        """
        start, end = (_number(self.figures.get(name, '')) for name in ('start [s]', 'end [s]'))
        return (start, end) if start <= end else None

    def _take_lines(self, item: MarkerPoints) -> None:
        if item.namespace != 'connectors':
            return
        ends = item.points.reshape(-1, 2, 3)
        self.lines[item.marker_id] = (
            ends if item.action == MarkerAction.ADD else np.zeros((0, 2, 3)))
        self.line_number += 1

    def _take_weave(self, text: str) -> None:
        given = ParameterSet('/icofabric')
        given.add_file(text.encode(), 'its scene')
        parameters = with_recorded_files(make_parameters(given.parameters()), text)
        if self.fabric is not None and self.fabric.parameters == parameters:
            return
        if self.fabric is not None and not rebuilds(self.fabric.parameters, parameters):
            self.fabric = self.fabric._replace(parameters=parameters)
            return
        scene = Scene.from_parameters(parameters)
        self.fabric = Fabric(parameters, scene, held_bodies(scene))
        self.fabric_number += 1
        self.lines, self.markers = {}, {}
        self.curves.clear()

    def _take_report(self, data: bytes) -> None:
        for status in decode_diagnostic_array(data)[1]:
            if status.name != self._name:
                continue
            self.status, self.message = status.level, status.message
            self.figures = dict(status.values)


def _number(text: str) -> float:
    try:
        return float(text.split()[0])
    except (IndexError, ValueError):
        return float('nan')
