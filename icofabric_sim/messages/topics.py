# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Topics of a running fabric, and their messages built from snapshots."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import Enum
from functools import cache, cached_property, partial
from typing import Any, NamedTuple

from icofabric_sim.messages import (
    ClockBytes,
    Float64MultiArrayBytes,
    MarkerAction,
    MarkerBytes,
    MarkerType,
    PoseArrayBytes,
    StringBytes,
    WrenchStampedBytes,
)
from icofabric_sim.messages.acting_markers import ActingMarkers
from icofabric_sim.messages.markers import (
    ConnectorMarkers,
    ShellMarkers,
    STRAIN_CLASSES,
    StrainClass,
)
from icofabric_sim.messages.transforms import TransformsBytes
from icofabric_sim.parameters.named_files import append_files
from icofabric_sim.parameters.text import dump_parameters
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.contact.broad_phase import Touching
from icofabric_sim.simulation.inputs.input_types import Wrench
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.reports.load_cells import ContactForces, Reactions
from icofabric_sim.simulation.simulation import Simulation
import numpy as np

__all__ = [
    'BODIES', 'BODY_SPIN', 'BROKEN', 'CHECKPOINT', 'CLOCK', 'CONNECTORS', 'CONTACTS',
    'DIAGNOSTICS', 'ENERGIES', 'ENERGY', 'EVENTS', 'full_name', 'ICOSAHEDRA', 'MARKERS', 'Outputs',
    'PERIODIC',
    'POSES', 'REACTIONS', 'Recorded', 'STATE', 'STRAIN_CLASSES', 'StrainClass', 'TENSIONS', 'TF',
    'Topic', 'TOPICS', 'VIEWS', 'WEAVE', 'wrench_topics']


class Recorded(Enum):
    """Condition under which bags have a topic."""

    NEVER = 0
    ALWAYS = 1
    IF_SENT = 2  # only some scenes have the topic
    IF_MEASURED = 3  # with `record.measured`


# Messages of a topic for the present state of a simulation at a time [ns].
Builder = Callable[['Outputs', Simulation, int], Iterable[bytes]]


class Topic(NamedTuple):
    """
    Published topic: one entry with type, QoS, rate and builder.

    A topic with a rate needs nothing else than its entry and a row in docs/ros.md: it is built
    only when due, and only if there is a subscriber or a bag. Other topics are sent by events.
    """

    name: str  # private (~/) name, or absolute
    type: str
    latched: bool = False  # transient local: late subscribers get the last message
    depth: int = 10
    recorded: Recorded = Recorded.NEVER
    rate: str = ''  # parameter with the rate [Hz] of simulated time; '': not periodic
    build: Builder | None = None  # for topics with a rate
    requires: str = ''  # parameter that must be set, otherwise the topic is not published
    loads_kernels: bool = False  # the builder uses kernels that a running simulation may lack
    compared: bool = True  # with a repeated run, when a bag that has the topic is verified


_ENTRIES: list[Topic] = []


def _publish(name: str, type_name: str, **options: Any) -> Topic:
    """Return a topic after adding it to those that a run publishes."""
    topic = Topic(name, type_name, **options)
    _ENTRIES.append(topic)
    return topic


POSES = _publish(
    '~/poses', PoseArrayBytes.TYPE, recorded=Recorded.ALWAYS, rate='publish_rate',
    build=lambda outputs, run, now: [outputs.poses(run.snapshot(), now)])
# Indices of the bodies in `~/poses` and `~/state` if publish.* selects bodies.
BODIES = _publish(
    '~/bodies', Float64MultiArrayBytes.TYPE, latched=True, depth=1, recorded=Recorded.IF_SENT)
CONNECTORS = _publish(
    '~/connectors', MarkerBytes.TYPE, depth=20, recorded=Recorded.ALWAYS, rate='marker_rate',
    build=lambda outputs, run, now: outputs.connectors(run.snapshot(), now))
# Large: 1,440 bytes for each body. Not recorded, because they follow from the poses.
ICOSAHEDRA = _publish(
    '~/icosahedra', MarkerBytes.TYPE, depth=8, rate='marker_rate', compared=False,
    build=lambda outputs, run, now: outputs.icosahedra(run.snapshot(), now))
# Not recorded, because they follow from other messages.
MARKERS = _publish(
    '~/markers', ActingMarkers.TYPE, depth=8, rate='marker_rate', compared=False,
    build=lambda outputs, run, now: [outputs.markers(
        run.snapshot(), now, run.status.active_loads, run.status.touching(),
        run.inputs.plane_displacements(run.time))])
STATE = _publish(
    '~/state', Float64MultiArrayBytes.TYPE, rate='publish_rate',
    build=lambda outputs, run, now: [outputs.state(run.snapshot())])
# Angular velocities in body axes (eq 18); `~/state` has them in world axes.
BODY_SPIN = _publish(
    '~/angular_velocity_body', Float64MultiArrayBytes.TYPE, rate='publish_rate',
    build=lambda outputs, run, now: [outputs.body_spin(run.snapshot())])
ENERGY = _publish(
    '~/energy', Float64MultiArrayBytes.TYPE, recorded=Recorded.ALWAYS, rate='publish_rate',
    build=lambda outputs, run, now: [outputs.energy(run.snapshot())])
# Quantities that a test rig would measure; they follow from the motion.
REACTIONS = _publish(
    '~/reactions', Float64MultiArrayBytes.TYPE, recorded=Recorded.IF_MEASURED,
    rate='publish_rate', loads_kernels=True,
    build=lambda outputs, run, now: [outputs.reactions(run.reactions())])
TENSIONS = _publish(
    '~/tensions', Float64MultiArrayBytes.TYPE, recorded=Recorded.IF_MEASURED,
    rate='publish_rate', build=lambda outputs, run, now: [outputs.tensions(run.tensions())])
CONTACTS = _publish(
    '~/contacts', Float64MultiArrayBytes.TYPE, recorded=Recorded.IF_MEASURED,
    rate='publish_rate', loads_kernels=True,
    build=lambda outputs, run, now: [outputs.contacts(run.contacts())])
# Frames of the bodies of tf.group for tf2.
TF = _publish(
    '/tf', TransformsBytes.TYPE, depth=100, recorded=Recorded.IF_SENT, rate='publish_rate',
    requires='tf.group', build=lambda outputs, run, now: [outputs.tf(run.snapshot(), now)])
# Broken connectors so far, in the order of breakage.
BROKEN = _publish(
    '~/broken', Float64MultiArrayBytes.TYPE, latched=True, depth=1, recorded=Recorded.ALWAYS,
    rate='publish_rate', build=lambda outputs, run, now: [outputs.broken(run.snapshot())])
WEAVE = _publish(
    '~/weave', StringBytes.TYPE, latched=True, depth=1, recorded=Recorded.ALWAYS)
CLOCK = _publish(
    '/clock', ClockBytes.TYPE, recorded=Recorded.ALWAYS, rate='clock_rate',
    requires='publish_clock', build=lambda outputs, run, now: [outputs.clock(now)])
DIAGNOSTICS = _publish(
    '/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', recorded=Recorded.ALWAYS)
# Operations on the run other than inputs (pause, steps, reset, ...), one JSON object each.
EVENTS = _publish('~/events', StringBytes.TYPE, depth=100, recorded=Recorded.ALWAYS)
# Checkpoints, from which a bag can be simulated again; too large to be published.
CHECKPOINT = Topic(
    '~/checkpoint', 'std_msgs/msg/UInt8MultiArray', depth=1, recorded=Recorded.ALWAYS)
# Topics sent at a rate, in the order in which messages of one time are sent: the clock first.
PERIODIC = tuple(sorted(
    (topic for topic in _ENTRIES if topic.rate), key=lambda topic: topic is not CLOCK))
# Topics drawn by viewer pages, sent by the wall clock at any speed of the run.
VIEWS = {
    topic: topic._replace(
        name=topic.name.replace('~/', '~/view/'), recorded=Recorded.NEVER, rate='')
    for topic in (POSES, CONNECTORS, MARKERS, ENERGY)}
TOPICS = (*_ENTRIES, *VIEWS.values())


def wrench_topics(scene: Scene) -> tuple[Topic, ...]:
    """
    Return `~/supports/NAME/wrench`, `~/drives/NAME/wrench` and `~/planes/NAME/wrench` of a scene.

    Not recorded, because `~/reactions` has the same numbers with the opposite sign.
    """
    return tuple(
        _wrench_topic(f'{family}/{name}') for family in ('~/supports', '~/drives', '~/planes')
        for name in scene.parameters.names(family.removeprefix('~/')))


@cache
def _wrench_topic(path: str) -> Topic:
    name = path.removeprefix('~/').replace('/', '.')
    return Topic(
        f'{path}/wrench', WrenchStampedBytes.TYPE, rate='publish_rate',
        build=partial(_build_wrench, name), loads_kernels=True, compared=False)


def _build_wrench(name: str, outputs: 'Outputs', run: Simulation, now: int) -> list[bytes]:
    """Return the wrench on a support, drive or plane, about the point of its reaction."""
    reactions, message = run.reactions(), WrenchStampedBytes(outputs.frame_id)
    number = reactions.names.index(name)
    message.force[:], message.torque[:] = -reactions.force[number], -reactions.torque[number]
    return [message.stamped(now)]


def full_name(name: str, node: str) -> str:
    """Return the full name of a private (~/) or absolute topic of a node."""
    return node + name[1:] if name.startswith('~') else name


# Label in `~/energy` [J], and name in a snapshot.
ENERGIES = {
    label: label.replace(' ', '_') for label in (
        'kinetic', 'connectors', 'gravity', 'contact', 'work in', 'dissipated', 'balance error',
        'field', 'lost at breaks')}


class Outputs:
    """Message builder of one scene: layouts are written once, numbers for every snapshot."""

    def __init__(self, scene: Scene) -> None:
        """Create the layouts; large messages are built in place on request."""
        self.scene = scene
        self.frame_id = scene.parameters['frame_id']
        chosen = scene.published_bodies
        # Published rows of arrays with a row for each body.
        self._rows = slice(None) if chosen is None else chosen
        count = scene.body_count if chosen is None else len(chosen)
        self._poses = PoseArrayBytes(self.frame_id, count)
        self._state = Float64MultiArrayBytes(
            ('body', 'position orientation_xyzw linear_velocity angular_velocity'), (count, 13))
        self._body_spin = Float64MultiArrayBytes(('body', 'angular_velocity_body'), (count, 3))
        self._energy = Float64MultiArrayBytes((', '.join(ENERGIES),), (len(ENERGIES),))
        self._connectors = ConnectorMarkers(scene)
        self._clock = ClockBytes()
        self._described: tuple[Parameters, bytes] | None = None

    @cached_property
    def _shells(self) -> ShellMarkers:
        return ShellMarkers(self.scene)

    @cached_property
    def _acting(self) -> ActingMarkers:
        return ActingMarkers(self.scene)

    def markers(
        self, snapshot: Snapshot, nanoseconds: int, acting: Mapping[str | int, Wrench],
        touching: Touching, displaced: np.ndarray | None = None
    ) -> bytes:
        """
        Return `~/markers`: `acting` wrenches, supports, planes, and `touching` contacts.

        `displaced` (k, 3) [m] are the displacements of planes; None: as at the start.
        """
        return self._acting.message(snapshot, nanoseconds, acting, touching, displaced)

    def poses(self, snapshot: Snapshot, nanoseconds: int) -> bytes:
        """Return `~/poses`: bodies in order, those of `publish.group`."""
        return self._poses.filled(nanoseconds, partial(
            _write_columns, [snapshot.position[self._rows], snapshot.orientation[self._rows]]))

    @cached_property
    def _frames(self) -> TransformsBytes:
        chosen = self.scene.framed_bodies
        assert chosen is not None
        return TransformsBytes(self.frame_id, [f'icosahedron_{number}' for number in chosen])

    def tf(self, snapshot: Snapshot, nanoseconds: int) -> bytes:
        """Return `/tf`: frames of the bodies of `tf.group`."""
        chosen = self.scene.framed_bodies
        return self._frames.filled(
            nanoseconds, snapshot.position[chosen], snapshot.orientation[chosen])

    def bodies(self) -> bytes | None:
        """
        Return `~/bodies`: (m,) indices of the bodies in `~/poses`; None if all are published.
        """
        chosen = self.scene.published_bodies
        if chosen is None:
            return None
        message = Float64MultiArrayBytes(('number of the body',), (len(chosen),))
        message.values[:] = chosen
        return message.to_bytes()

    def state(self, snapshot: Snapshot) -> bytes:
        """
        Return `~/state`: [n, 13] position, orientation x y z w, velocity, angular velocity; world.
        """
        return self._state.filled(partial(_write_columns, [
            snapshot.position[self._rows],
            snapshot.orientation[self._rows],
            snapshot.linear_velocity[self._rows],
            snapshot.angular_velocity[self._rows],
        ]))

    def body_spin(self, snapshot: Snapshot) -> bytes:
        """`~/angular_velocity_body`: [n, 3] angular velocity in the axes of each body."""
        return self._body_spin.filled(partial(
            _write_columns, [snapshot.angular_velocity_body[self._rows]]))

    def energy(self, snapshot: Snapshot) -> bytes:
        """Return `~/energy`: the energies [J] named in its label."""
        self._energy.values[:] = [snapshot.energy[name] for name in ENERGIES.values()]
        return self._energy.to_bytes()

    def reactions(self, reactions: Reactions) -> bytes:
        """
        Return `~/reactions`: [k, 9] force [N], torque [N m] about a point, that point [m], world.
        """
        message = Float64MultiArrayBytes(
            (', '.join(reactions.names), 'force torque point'), (len(reactions.names), 9))
        return message.filled(partial(
            _write_columns, [reactions.force, reactions.torque, reactions.point]))

    def tensions(self, tensions: np.ndarray) -> bytes:
        """Return `~/tensions`: [m, 2] connector and force [N] along it, of the published ones."""
        chosen = self.scene.published_connectors
        if chosen is None:
            chosen = np.arange(len(tensions))
        message = Float64MultiArrayBytes(('row', 'connector, tension'), (len(chosen), 2))
        return message.filled(partial(
            _write_columns, [chosen[:, None].astype(float), tensions[chosen, None]]))

    def contacts(self, contacts: ContactForces) -> bytes:
        """
        Return `~/contacts`: [m, 15] contacts in the world frame.

        Columns: first body, second body, point [m], force [N] on the first, overlap [m], torques
        [N m] on the first and on the second about their centres. A second body of -1 - k is plane
        k, whose names are the first label.
        """
        message = Float64MultiArrayBytes(
            (f'planes: {", ".join(contacts.planes)}',
             'first, second, point, force on first, overlap, torque on first, torque on second'),
            (len(contacts.bodies), 15))
        return message.filled(partial(_write_columns, [
            contacts.bodies.astype(float), contacts.point, contacts.force,
            contacts.overlap[:, None], contacts.wrench_on_first[:, 3:],
            contacts.wrench_on_second[:, 3:]]))

    def broken(self, snapshot: Snapshot) -> bytes:
        """
        Return `~/broken`: [m, 2] connector and time of breakage [s], in order of breakage.

        Connectors broken at the same time are in order of their numbers. -1 - k stands for anchor
        k.
        """
        gone = np.flatnonzero(~snapshot.intact)
        times = snapshot.break_time[gone]
        if snapshot.anchors_broken_since is not None:
            anchors = np.flatnonzero(~snapshot.anchor_intact)
            gone = np.concatenate([gone, -1 - anchors])
            times = np.concatenate([times, snapshot.anchors_broken_since[anchors]])
        order = np.argsort(times, kind='stable')
        message = Float64MultiArrayBytes(
            ('break', 'connector, time of breakage'), (len(gone), 2))
        return message.filled(partial(
            _write_columns, [gone[order, None].astype(float), times[order, None]]))

    def connectors(self, snapshot: Snapshot, nanoseconds: int) -> Iterator[bytes]:
        """
        Yield `~/connectors`: a line list for each strain class, or its removal if it is empty.

        Each message is built on demand.
        """
        return self._connectors.messages(snapshot, nanoseconds)

    def icosahedra(self, snapshot: Snapshot, nanoseconds: int) -> Iterator[bytes]:
        """
        Yield `~/icosahedra`: triangle lists of the shells by colour, several for many bodies.

        Each message is built on demand.
        """
        return self._shells.messages(snapshot, nanoseconds)

    def cleared(self, nanoseconds: int, topic: Topic = CONNECTORS) -> bytes:
        """
        Return `~/connectors` or `~/icosahedra` that removes all markers of an earlier weave.

        The message uses the namespace of the topic, because Foxglove removes only markers of the
        given namespace; RViz removes all markers of the topic.
        """
        namespace = topic.name.removeprefix('~/')
        marker = MarkerBytes(self.frame_id, namespace, 0, MarkerType.LINE_LIST)
        return marker.stamped(nanoseconds, action=MarkerAction.DELETEALL)

    def weave(self, parameters: Parameters) -> bytes:
        """
        Return `~/weave`: the `parameters` in force as a ROS parameter file, with named files.

        They equal those of the scene, except for changed output rates, duration etc.
        """
        if self._described is None or self._described[0] is not parameters:
            text = append_files(dump_parameters(parameters.complete()), self.scene.files)
            self._described = parameters, StringBytes(text).to_bytes()
        return self._described[1]

    def clock(self, nanoseconds: int) -> bytes:
        """Return `/clock`."""
        return self._clock.stamped(nanoseconds)


def _write_columns(parts: list[np.ndarray], values: np.ndarray) -> None:
    """Write arrays (n, k) into adjacent columns."""
    column = 0
    for part in parts:
        values[:, column:column + part.shape[1]] = part
        column += part.shape[1]
