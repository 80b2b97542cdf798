# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Comparison of recorded outputs with a second simulation: bit by bit, or within error bounds."""

from collections.abc import Callable
import math
from typing import Any, NamedTuple

from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.checks import counted
from icofabric_sim.messages import (
    decode_clock,
    decode_float64_multi_array,
    decode_marker_points,
    decode_pose_array,
    decode_uint8_multi_array,
    MarkerAction,
    topics,
)
from icofabric_sim.messages.topics import Outputs, Topic
from icofabric_sim.running.replay.resimulation import Act
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.reports.divergence import Companion, MEANINGFUL
from icofabric_sim.simulation.simulation import Simulation
import numpy as np

_POSE = (
    *(f'position {axis} [m]' for axis in 'xyz'), *(f'orientation {axis}' for axis in 'xyzw'))
_SPIN = tuple(f'angular velocity {axis} [rad/s]' for axis in 'xyz')
_STATE = *_POSE, *(f'velocity {axis} [m/s]' for axis in 'xyz'), *_SPIN
_TORQUES = tuple(
    f'torque on {which} {axis} [N m]' for which in ('first', 'second') for axis in 'xyz')


class _Layout(NamedTuple):
    """Rows of numbers in a message, to describe a difference."""

    columns: tuple[str, ...]
    what: str = 'row'
    of_bodies: bool = False  # a row for each published body
    decode: Callable[[bytes], Any] = decode_float64_multi_array


# Messages of other topics are only said to differ.
_LAYOUTS = {
    topics.POSES: _Layout(_POSE, 'body', True, decode_pose_array),
    topics.STATE: _Layout(_STATE, 'body', True),
    topics.BODY_SPIN: _Layout(_SPIN, 'body', True),
    topics.ENERGY: _Layout(tuple(f'{label} energy [J]' for label in topics.ENERGIES), 'body'),
    topics.BROKEN: _Layout(('connector', 'time of breakage [s]'), 'break'),
    topics.REACTIONS: _Layout(tuple(
        f'{what} {axis}' for what in ('force [N]', 'torque [N m]', 'point [m]')
        for axis in 'xyz')),
    topics.TENSIONS: _Layout(('connector', 'tension [N]')),
    topics.CONTACTS: _Layout((
        'first body', 'second body', *(f'point {axis} [m]' for axis in 'xyz'),
        *(f'force {axis} [N]' for axis in 'xyz'), 'overlap [m]', *_TORQUES)),
}
# Factor on the error bound for consistent runs: growth is measured for one displacement, and a run
# may exceed its requested error several times.
_BOUND_FACTOR = 10.0
# Effect of round-off on equal values, over a.
_ROUND_OFF = 1e-11


class ExactComparison:
    """Comparison of outputs that must be bit-identical."""

    def __init__(self, run: RecordedRun, simulation: Callable[[], Simulation]) -> None:
        """Compare outputs of `run` with the present state of the result of `simulation`."""
        self._run, self._simulation = run, simulation
        self._outputs: Outputs | None = None
        self._lists: tuple[Snapshot | None, int, dict[int, bytes]] = None, 0, {}
        self._several = len(run.nodes) > 1

    def acted(self, act: Act) -> None:
        """Do nothing: inputs are already in the simulation."""

    def jumped(self, goes_on: bool) -> None:
        """Create new message layouts, because the bodies may differ."""
        self._outputs = None

    def difference(self, topic: Topic, time: int, data: bytes) -> str | None:
        """Describe the difference from `data` at `time` [ns], '' if equal; None: not compared."""
        simulation = self._simulation()
        if self._outputs is None or self._outputs.scene is not simulation.scene:
            self._outputs = Outputs(simulation.scene)
        decoded = self._run.decoded
        if topic is topics.CLOCK:
            # With several fabrics any of them may have published it.
            return None if self._several else _scalar(decoded(decode_clock, data), time)
        if topic is topics.CHECKPOINT:
            stored = decoded(decode_uint8_multi_array, data)
            try:
                recorded = Checkpoint.from_bytes(stored)
            except ValueError as error:
                return str(error)
            return recorded.difference(simulation.checkpoint())
        if topic is topics.CONNECTORS:
            return self._connectors(simulation, time, data)
        if topic is topics.BODIES:
            return _whole(data, self._outputs.bodies(), 'numbers of bodies')
        scene = simulation.scene
        if topic is topics.TF and (self._several or scene.framed_bodies is None):
            # With several fabrics all of them publish frames there.
            return None
        if topic.build is None:
            raise ValueError(f'no comparison for {topic.name}')
        [again] = topic.build(self._outputs, simulation, time)
        layout = _LAYOUTS.get(topic)
        if layout is None:
            return _whole(data, again, 'frames' if topic is topics.TF else 'values')
        return _values(
            data, again, lambda message: decoded(layout.decode, message), layout.columns,
            what=layout.what, numbers=scene.published_bodies if layout.of_bodies else None)

    def _connectors(self, simulation: Simulation, time: int, data: bytes) -> str:
        recorded = self._run.decoded(decode_marker_points, data)
        if recorded.action == MarkerAction.DELETEALL:
            assert self._outputs is not None
            again = self._outputs.cleared(time)
        else:
            lists = self._connector_lists(simulation, time)
            if recorded.marker_id not in lists:
                return f'list {recorded.marker_id} is in the bag, not in the simulation'
            again = lists[recorded.marker_id]
            is_empty = decode_marker_points(again).action == MarkerAction.DELETE
            if recorded.action == MarkerAction.DELETE and not is_empty:
                return f'list {recorded.marker_id} is empty in the bag, not in the simulation'
            if recorded.action != MarkerAction.DELETE and is_empty:
                return f'list {recorded.marker_id} is empty in the simulation, not in the bag'
        return _values(
            data, again, lambda message: self._run.decoded(decode_marker_points, message),
            ('x [m]', 'y [m]', 'z [m]'), what='point')

    def _connector_lists(self, simulation: Simulation, time: int) -> dict[int, bytes]:
        """Return all lists of one snapshot, or their removals, by id."""
        snapshot = simulation.snapshot()
        if self._lists[0] is not snapshot or self._lists[1] != time:
            assert self._outputs is not None
            self._lists = snapshot, time, {
                decode_marker_points(message).marker_id: message
                for message in self._outputs.connectors(snapshot, time)}
        return self._lists[2]


class CloseComparison:
    """
    Comparison of poses within the tolerance, amplified by error growth.

    For another processor, other libraries or another version, where round-off differs.
    """

    def __init__(self, run: RecordedRun, simulation: Callable[[], Simulation]) -> None:
        """Compare poses of `run` with the present state of the result of `simulation`."""
        self._run, self._simulation = run, simulation
        self._companion: Companion | None = None
        self._since, self._before = 0.0, 0.0
        # Largest distance and its bound: over a, or [rad].
        self.largest, self.bound_there = 0.0, 0.0
        self.meaningless_since: int | None = None  # [ns]

    def acted(self, act: Act) -> None:
        """Apply an input to the disturbed run too."""
        if self._companion is not None:
            self._companion.look()
            self._companion.act(act)

    def jumped(self, goes_on: bool) -> None:
        """Disturb the new simulation; if its state `goes_on`, earlier errors keep growing."""
        self._before = self._bound() if goes_on and self._companion is not None else 0.0
        self._companion = None
        self._since = self._simulation().time

    def difference(self, topic: Topic, time: int, data: bytes) -> str | None:
        """
        Describe the difference from `data` at `time` [ns] if it is too large; None: not compared.
        """
        if topic is not topics.POSES:
            return None
        simulation = self._simulation()
        if self._companion is None:
            self._companion = Companion(simulation)
        self._companion.look()
        bound = self._before if simulation.time <= self._since else self._bound()
        bound = _BOUND_FACTOR * bound + _ROUND_OFF
        if not bound < MEANINGFUL:
            if self.meaningless_since is None:
                self.meaningless_since = time
            return None
        self.meaningless_since = None
        recorded = self._run.decoded(decode_pose_array, data).values
        state, half_edge = simulation.snapshot(), simulation.scene.geometry.half_edge
        chosen = simulation.scene.published_bodies
        rows = np.arange(len(state.position)) if chosen is None else chosen
        if recorded.shape != (len(rows), 7):
            return _counts(len(recorded), len(rows), 'body')
        orientation = state.orientation[rows]
        shift = np.linalg.norm(recorded[:, :3] - state.position[rows], axis=1) / half_edge
        # Both signs of a quaternion are the same orientation.
        turn = 2.0 * np.minimum(
            np.linalg.norm(recorded[:, 3:] - orientation, axis=1),
            np.linalg.norm(recorded[:, 3:] + orientation, axis=1))
        distance = np.maximum(shift, turn)
        worst = int(np.argmax(np.where(np.isfinite(distance), distance, np.inf)))
        if not distance[worst] <= bound:
            row = int(np.flatnonzero(~(distance <= bound))[0])
            return (
                f'body {rows[row]}: {shift[row] * half_edge:.3g} m and {turn[row]:.3g} rad apart, '
                f'tolerance and growth explain {bound * half_edge:.3g} m and {bound:.3g} '
                'rad')
        if distance[worst] >= self.largest:
            self.largest, self.bound_there = float(distance[worst]), bound
        return ''

    def _bound(self) -> float:
        """Return the bound of the distance of two runs, over a or [rad]."""
        assert self._companion is not None
        simulation, growth = self._companion.simulation, self._companion.result()
        if growth.ended or growth.at_least:
            return math.inf
        tolerance = simulation.scene.parameters['solver.tolerance']
        added = 2.0 * tolerance * (float(growth.time[-1]) - self._since)
        return (self._before + added) * growth.largest


def _scalar(recorded: int, simulated: int) -> str:
    return '' if recorded == simulated else f'{recorded} ns in the bag, {simulated} ns simulated'


def _whole(recorded: bytes, simulated: bytes | None, what: str) -> str:
    return '' if recorded == simulated else f'its {what} differ from the second simulation'


def _counts(recorded: int, simulated: int, what: str) -> str:
    return (
        f'{counted(recorded, what)} in the bag, {counted(simulated, what)} in the second '
        'simulation')


def _values(
    recorded: bytes, simulated: bytes, decode: Callable[[bytes], Any], columns: tuple[str, ...],
    *, what: str = 'body', numbers: np.ndarray | None = None,
) -> str:
    """
    Describe the first number that differs in two messages of one type; '' if equal.

    `numbers` of the rows; None: from 0.
    """
    if recorded == simulated:
        return ''
    one, two = decode(recorded), decode(simulated)
    first, second = (
        np.array(message.points if hasattr(message, 'points') else message.values)
        for message in (one, two))
    if first.shape != second.shape:
        return _counts(len(first), len(second), what)
    places = np.argwhere(first.view(np.int64) != second.view(np.int64))
    if not len(places):
        return f'its header differs: {_head(one)} in the bag, {_head(two)} simulated again'
    place = tuple(int(index) for index in places[0])
    row = place[0] if numbers is None else numbers[place[0]]
    name = f'{what} {row}: ' if len(place) > 1 else ''
    value, other = float(first[place]), float(second[place])
    return (
        f'{name}{columns[place[-1]]} {value!r} in the bag, {other!r} simulated again (difference '
        f'{value - other:.3g})')


def _head(message: Any) -> str:
    """Return everything except the numbers."""
    fields = message._asdict()
    return ', '.join(
        f'{name} {fields[name]!r}' for name in fields if name not in ('values', 'points'))
