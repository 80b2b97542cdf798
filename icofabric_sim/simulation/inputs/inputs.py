# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Inputs of a simulation: the active ones, and the queue of later ones (queue.py).

A received message is kept after it has acted until the run takes and records the message.
"""

from collections.abc import Callable, Mapping
import math
from typing import Any

from icofabric_sim.kernels.records import Loads
from icofabric_sim.scene.expression_times import critical_times
from icofabric_sim.scene.paths import Path
from icofabric_sim.scene.profiles import Piece, Profile, STEADY_PROFILE
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.checkpoints.state_tree import as_number, StateTree
from icofabric_sim.simulation.inputs.anchor_breaks import AnchorBreaks
from icofabric_sim.simulation.inputs.driving import Driving
from icofabric_sim.simulation.inputs.input_types import (
    BodyTarget,
    ChannelTarget,
    DriveTarget,
    has_target,
    load_order,
    LoadTarget,
    PathTarget,
    PlaneTarget,
    Pull,
    PullTarget,
    require_target,
    restored_target,
    stored_target,
    Target,
    Twist,
    Value,
    Wrench,
)
from icofabric_sim.simulation.inputs.pulls import Pulls
from icofabric_sim.simulation.inputs.queue import Event, InputQueue
from icofabric_sim.simulation.inputs.timetable import (
    AnchorPath,
    ExpressionTimes,
    FieldProfile,
    Follower,
    Timetable,
    TractionProfile,
)
from icofabric_sim.simulation.model.layout import Layout
from icofabric_sim.simulation.model.packing import AnchorPack, pack_loads, WrenchRow
from icofabric_sim.simulation.model.tractions import (
    BodyTraction,
    sum_faces,
    TractionPack,
    TractionRow,
)
import numpy as np

_ZERO_VECTOR = np.zeros(3)
# Steps end before and after a change of an expression, at this distance over the time.
CHANGE_GAP_RATIO = 1e-12
# Largest angle [rad] in a step of a sine within another function, which may act in short pulses.
_EXPRESSION_ANGLE = 0.3


class Inputs:
    """
    Active wrenches of channels and bodies, the motion of drives and planes, and later inputs.
    """

    def __init__(self, scene: Scene) -> None:
        """Start with the loads of the scene."""
        self.scene = scene
        self.active: dict[LoadTarget, Wrench] = {}
        self.expiry: dict[LoadTarget, float] = {}
        self.received: set[LoadTarget] = set()
        self.queue = InputQueue()
        self.pulls = Pulls(scene)
        # Messages that have acted, for a caller that records messages.
        self._acted: list[Any] = []
        # Wrenches of the loads that were packed last.
        self.packed: dict[LoadTarget, Wrench] = {}
        # Numbers of the profile segments of these loads.
        self._packed_pieces: dict[Follower, int] = {}
        self._channels = {
            ChannelTarget(name): channel for name, channel in scene.loads.items()}
        profiles: dict[Follower, Profile] = {
            target: channel.profile for target, channel in self._channels.items()}
        profiles |= {TractionProfile(name): part.profile for name, part in scene.tractions.items()}
        profiles |= {
            TractionProfile(load.expression.name): load.profile for load in scene.expression_loads}
        self._field = scene.electric.wrenches(scene.geometry.half_edge)
        if self._field:
            profiles[FieldProfile()] = scene.electric.profile
        paths: dict[Follower, Path] = {
            DriveTarget(name): drive.path for name, drive in scene.drives.items()}
        paths |= {PlaneTarget(name): path for name, path in scene.platens.items()}
        paths |= {AnchorPath(name): anchor.path for name, anchor in scene.anchors.items()}
        critical = [
            critical_times(load.expression, scene.initial.position[load.bodies])
            for load in scene.expression_loads]
        # Longest step [s] for sines within other functions of expressions.
        rate = max((each.rate for each in critical), default=0.0)
        self.expression_step = _EXPRESSION_ANGLE / rate if rate > 0.0 else math.inf
        # Steps end just after expressions change.
        marks: dict[Follower, Profile] = {
            ExpressionTimes(number): Profile(tuple(Piece(time, 1.0, peak=1.0) for time in (
                0.0, *((1.0 + CHANGE_GAP_RATIO) * each.times).tolist())))
            for number, each in enumerate(critical)}
        self.timetable = Timetable({**profiles, **marks, **paths})
        self._marks = [name for name, mark in marks.items() if len(mark.pieces) > 1]
        self.driving = Driving(scene.drives, scene.platens, scene.initial, self.timetable)
        # None if no anchor can break.
        self.anchor_breaks = AnchorBreaks(scene.anchors) if scene.anchors_break else None
        self._varying = any(not profile.is_plain for profile in profiles.values())
        self._sums: dict[str, BodyTraction] = {}
        self.reset(0.0)

    @property
    def message_count(self) -> int:
        """Number of received messages that wait for their time."""
        return self.queue.message_count

    @property
    def waiting_count(self) -> int:
        """Number of waiting inputs and ends of holds, without received messages."""
        return len(self.queue) - self.queue.message_count

    @property
    def pulled_bodies(self) -> list[int]:
        """Numbers of the bodies under drag forces."""
        return self.pulls.bodies

    def put(
        self, time: float, target: Target, value: Value | None, message: Any = None
    ) -> None:
        """
        Add a validated input that acts at `time` [s], once the simulation advances to this time.

        `message` is the received message; `take_acted` returns the message after it has acted.
        """
        self.queue.put(time, target, value, message)

    def drop_messages(self, is_lost: Callable[[Target], bool]) -> list[Event]:
        """Remove and return the waiting messages whose target is lost, in their order."""
        return self.queue.drop_messages(is_lost)

    def take_acted(self) -> list[Any]:
        """Return the messages that have acted since the last call, in their order."""
        acted, self._acted = self._acted, []
        return acted

    def reset(self, time: float) -> None:
        """Discard all received inputs; loads of the scene restart at `time` [s]."""
        self.queue.refill(())
        self.expiry.clear()
        self.received.clear()
        self.active.clear()
        self.pulls.clear()
        self.driving.taken.clear()
        if self.anchor_breaks is not None:
            self.anchor_breaks.mend()
        self._begin(time, time)

    def _begin(self, epoch: float, now: float) -> None:
        """Activate the loads of the scene on channels without a received wrench."""
        self.timetable.begin(epoch, now)
        for target in self._channels:
            self._follow(target)

    def _follow(self, target: ChannelTarget) -> bool:
        """Set or remove the load of the scene on a channel; return True if the wrench changes."""
        channel = self._channels[target]
        if target in self.received or not (channel.force.any() or channel.torque.any()):
            return False
        if self.timetable.piece(target).is_zero:
            self.active.pop(target, None)
        else:
            self.active[target] = Wrench(channel.force, channel.torque)
        return True

    def pulse_step(self) -> float:
        """Return the longest step [s] within the packed pulses; infinite without a limit."""
        return self.timetable.part_length(self._packed_pieces)

    def acting(self) -> dict[LoadTarget, Wrench]:
        """Return the active wrenches: channels by name, followed by bodies by number."""
        return {target: self.active[target] for target in sorted(self.active, key=load_order)}

    @property
    def limits_steps(self) -> bool:
        """True if expressions change at known times, or limit the length of steps."""
        return bool(self._marks) or self.expression_step < math.inf

    @property
    def next_expression_change(self) -> float:
        """Time [s] just after the next change of an expression; infinite without one."""
        return min((self.timetable.next_start(name) for name in self._marks), default=math.inf)

    @property
    def next_time(self) -> float:
        """Time [s] of the next change; infinite without one."""
        return min(self._next_change, self.pulls.due)

    @property
    def _next_change(self) -> float:
        return min(self.queue.next_time, self.timetable.next_time)

    @property
    def pulls_are_next(self) -> bool:
        """
        True if the next change is an update of drag forces, the last of simultaneous changes.
        """
        return self.pulls.due < self._next_change

    def apply_next(self) -> bool:
        """Apply the next change; return True if forces or motions change."""
        if self.timetable.next_time > self._next_change:
            return self._apply(self.queue.take())
        changes = [
            self._follow(begun) if isinstance(begun, ChannelTarget)
            else begun not in self.driving.taken for begun in self.timetable.turn()]
        return any(changes)

    def adopt(self, other: 'Inputs', now: float, *, anew: bool) -> None:
        """
        Adopt the inputs of an earlier scene at time `now` [s], as far as their targets exist.

        If `anew`, the loads of the scene restart now; else they continue.
        """

        def known(target: Target) -> bool:
            return has_target(self.scene, target)

        # Received wrenches remain, zero ones included; other loads are those of the scene.
        self.received = {target for target in other.received if known(target)}
        self.active.clear()
        self._begin(now if anew else other.timetable.epoch, now)
        self.driving.taken.clear()
        if not anew:
            self.driving.adopt(other.driving)
            self.pulls.adopt(other.pulls, now)
            if self.anchor_breaks is not None:
                self.anchor_breaks.adopt(other.anchor_breaks)
        for target in self.received:
            if target in other.active:
                self.active[target] = other.active[target]
            else:
                self.active.pop(target, None)
        self.expiry = {target: time for target, time in other.expiry.items() if known(target)}
        self.queue.refill(event for event in other.queue if known(event.target))

    def _apply(self, event: Event) -> bool:
        """Apply an event; return True if forces or motions change."""
        target, value = event.target, event.value
        if event.message is not None:
            self._acted.append(event.message)
        if isinstance(target, (DriveTarget, PlaneTarget)):
            assert isinstance(value, Twist)
            self.driving.take_over(target, event.time, value)
            return True
        if isinstance(target, PullTarget):
            assert isinstance(value, Pull)
            self.pulls.take(target, value, event.time)
            return False  # an update of the forces follows
        before = self.active.get(target, Wrench(_ZERO_VECTOR, _ZERO_VECTOR))
        if value is None:
            if self.expiry.get(target) != event.time:
                return False  # a later wrench extends the hold
            del self.expiry[target]
            self.active.pop(target, None)
            return not before.is_zero()
        assert isinstance(value, Wrench)
        hold = self._channels[target].hold if isinstance(target, ChannelTarget) else 0.0
        self.received.add(target)
        self.expiry.pop(target, None)
        if value.is_zero():
            self.active.pop(target, None)
        else:
            self.active[target] = value
            if hold > 0.0:
                self.expiry[target] = event.time + hold
                self.put(event.time + hold, target, None)
        return not value.same(before)

    def pack(self, layout: Layout, *, stages: int = 0) -> Loads:
        """Pack the present loads for the kernels."""
        self.packed = dict(self.active)
        self._packed_pieces = {
            name: number for name, number in self.timetable.numbers.items()
            if name not in self.received}
        self.driving.pack()
        self.pulls.repack()
        return self.pack_again(layout, stages=stages)

    def pack_again(self, layout: Layout, *, stages: int = 0) -> Loads:
        """
        Return the loads that were packed last.

        The order is: channels by name, single bodies by number, the electric field, drag forces,
        surface forces.
        """
        return pack_loads(
            self._own_rows(), layout, stages=stages, varying=self._varying,
            tractions=self._pack_tractions(dict(self._traction_pieces())),
            drives=self.driving.pack_again(), anchors=self._pack_anchors())

    def expression_profiles(self) -> np.ndarray:
        """
        Return the segments of profiles of loads by expressions when loads were packed last.

        (p, 6): start [s], value, slope [1/s], height, rate [rad/s], and start of the motion [s].
        """
        pieces = [self._piece(TractionProfile(load.expression.name))
                  for load in self.scene.expression_loads]
        return np.array([[*piece[:5], self.timetable.epoch] for piece in pieces]).reshape(-1, 6)

    def packed_rows(self) -> list[WrenchRow]:
        """Return the wrenches that were packed last, with surface forces for each face."""
        return self._own_rows() + [
            WrenchRow(*wrench[:-1], piece, wrench.normal)
            for name, piece in self._traction_pieces()
            for wrench in self.scene.tractions[name].wrenches]

    def _own_rows(self) -> list[WrenchRow]:
        rows = []
        for target in sorted(self.packed, key=load_order):
            piece = self._piece(target) if target in self._packed_pieces else (
                STEADY_PROFILE.pieces[0])
            rows.append(self._row(target, self.packed[target], piece))
        return rows + self._field_rows() + self.pulls.packed_rows()

    def _field_rows(self, piece: Piece | None = None) -> list[WrenchRow]:
        """
        Return the wrenches of the electric field with a segment of its profile, by default now.
        """
        if not self._field:
            return []
        piece = self._piece(FieldProfile()) if piece is None else piece
        return [] if piece.is_zero else [
            WrenchRow(wrench.bodies, False, wrench.force, _ZERO_VECTOR, wrench.point, piece)
            for wrench in self._field]

    def _traction_pieces(self) -> list[tuple[str, Piece]]:
        """
        Return the names of active surface forces, each with the present segment of its profile.
        """
        pieces = [(name, self._piece(TractionProfile(name))) for name in self.scene.tractions]
        return [(name, piece) for name, piece in pieces if not piece.is_zero]

    def _pack_tractions(self, pieces: Mapping[str, Piece]) -> TractionPack | None:
        if not self.scene.tractions:
            return None
        if not self._sums:
            self._sums = {
                name: sum_faces(part.wrenches) for name, part in self.scene.tractions.items()}
        return TractionPack(
            [TractionRow(self._sums[name], piece) for name, piece in pieces.items()],
            list(self._sums.values()))

    def pack_strongest(self, layout: Layout) -> Loads:
        """Pack all loads of the scene, each at its maximum, as if simultaneous."""
        rows = [
            self._row(target, Wrench(channel.force, channel.torque), channel.profile.strongest)
            for target, channel in self._channels.items()]
        rows += self._field_rows(self.scene.electric.profile.strongest)
        return pack_loads(
            rows, layout, varying=self._varying, tractions=self._pack_tractions({
                name: part.profile.strongest for name, part in self.scene.tractions.items()}))

    def _pack_anchors(self) -> AnchorPack | None:
        anchors = self.scene.anchors
        if not anchors:
            return None
        laws = np.array([(*anchor.law, anchor.damping) for anchor in anchors.values()])
        if self.anchor_breaks is not None:
            laws[self.anchor_breaks.broken] *= [0.0, 0.0, 1.0, 0.0]
        return AnchorPack(
            tuple(anchor.body for anchor in anchors.values()),
            tuple(anchor.arm for anchor in anchors.values()),
            tuple(self._piece(AnchorPath(name)) for name in anchors), laws,
            any(any(piece.wave) for anchor in anchors.values() for piece in anchor.path.pieces),
            self.scene.anchors_damped)

    def plane_displacements(self, time: float) -> np.ndarray:
        """Return the displacements (k, 3) [m] of all planes at a `time` [s] of their segments."""
        return np.array([
            self.driving.displacement(PlaneTarget(name), time) if name in self.scene.platens
            else _ZERO_VECTOR for name in self.scene.parameters.names('planes')]).reshape(-1, 3)

    def anchor_points(self, time: float) -> np.ndarray:
        """
        Return the points of the anchors, (a, 3) [m], at a `time` [s] of the present path segments.
        """
        pieces = [self.timetable.piece(AnchorPath(name)) for name in self.scene.anchors]
        return np.array([piece.at(time)[:3] for piece in pieces]).reshape(-1, 3)

    def _piece(self, name: Any) -> Any:
        """Return the segment of a profile when loads were packed last."""
        return self.timetable.piece(name, self._packed_pieces.get(name))

    def _row(self, target: LoadTarget, wrench: Wrench, piece: Piece) -> WrenchRow:
        if isinstance(target, BodyTarget):
            return WrenchRow(np.array([target.number], np.int32), True, *wrench, piece=piece)
        channel = self._channels[target]
        part = len(channel.bodies) if channel.is_divided else 1
        return WrenchRow(
            channel.bodies, channel.in_body_axes, wrench.force / part, wrench.torque / part,
            channel.point, piece)

    def state_tree(self) -> dict[str, Any]:
        """Return active, held and waiting inputs in a sorted order."""
        queue = [
            [event.time, event.rank, stored_target(event.target), *_numbers(event.value)]
            for event in self.queue
            if event.message is None and not isinstance(event.target, PullTarget)]
        some = {'pulls': self.pulls.state_tree()} if self.pulls else {}
        if self.anchor_breaks is not None and self.anchor_breaks.broken.any():
            some['broken_anchors'] = self.anchor_breaks.state_tree()
        return {
            **some,
            'active': _listing(self.active),
            'packed': _listing(self.packed),
            'expiry': [
                [stored_target(target), self.expiry[target]]
                for target in sorted(self.expiry, key=load_order)],
            'received': [
                stored_target(target) for target in sorted(self.received, key=load_order)],
            'queue': queue,
            'timetable': self.timetable.state_tree(),
            'driving': self.driving.state_tree(),
            'packed_pieces': self.timetable.listing(self._packed_pieces),
        }

    def load_state(self, tree: StateTree, now: float) -> None:
        """Restore the inputs from a checkpoint; no input may start before `now` [s]."""
        self.timetable.load_state(tree.part('timetable'), now)
        pieces = self.timetable.known_numbers(tree.entries('packed_pieces'))
        self.driving.load_state(tree.part('driving'))
        self.pulls.load_state(tree.part('pulls') if 'pulls' in tree else None, now)
        gone = tree.part('broken_anchors') if 'broken_anchors' in tree else None
        if self.anchor_breaks is not None:
            self.anchor_breaks.load_state(gone)
        elif gone is not None:
            raise ValueError('inputs hold broken anchors, and no anchor of this scene breaks')
        active, packed = (self._wrenches(tree.entries(name)) for name in ('active', 'packed'))
        expiry: dict[LoadTarget, float] = {}
        for entry in tree.entries('expiry'):
            stored, time = _fields(entry, 2)
            expiry[self._load_target(stored)] = _moment(time, now)
        received = {self._load_target(stored) for stored in tree.entries('received')}
        queue = []
        for number, entry in enumerate(tree.entries('queue')):
            time, rank, stored, first, second = _fields(entry, 5)
            target = self._known(stored)
            value = None if first is None and second is None else _value(target, first, second)
            if type(rank) is not int or rank != (0 if value is None else 1):
                raise ValueError(f'inputs.queue has an entry of rank {rank!r:.40}')
            queue.append(Event(_moment(time, now), rank, number, target, value))
        queue += [event for event in self.queue if event.message is not None]
        self.queue.refill(queue)
        self.active, self.packed, self.expiry = active, packed, expiry
        self._packed_pieces, self.received = pieces, received

    def _wrenches(self, entries: list[Any]) -> dict[LoadTarget, Wrench]:
        wrenches = {}
        for entry in entries:
            stored, force, torque = _fields(entry, 3)
            target = self._load_target(stored)
            wrench = _value(target, force, torque)
            assert isinstance(wrench, Wrench)
            wrenches[target] = wrench
        return wrenches

    def _known(self, stored: Any) -> LoadTarget | PathTarget:
        target = restored_target(stored)
        require_target(self.scene, target)
        return target

    def _load_target(self, stored: Any) -> LoadTarget:
        target = self._known(stored)
        if isinstance(target, (DriveTarget, PlaneTarget)):
            raise ValueError(f'inputs hold a wrench on {target}, which a twist moves')
        return target


def _listing(wrenches: Mapping[LoadTarget, Wrench]) -> list[Any]:
    return [
        [stored_target(target), *_numbers(wrenches[target])]
        for target in sorted(wrenches, key=load_order)]


def _numbers(value: Value | None) -> list[Any]:
    return [None, None] if value is None else [part.tolist() for part in value]


def _value(target: Target, first: Any, second: Any) -> Wrench | Twist:
    """Return the stored wrench or twist of a target; raise ValueError for invalid values."""
    try:
        if isinstance(target, (DriveTarget, PlaneTarget)):
            return Twist.checked(first, second)
        return Wrench.checked(first, second)
    except TypeError as error:
        raise ValueError(str(error)) from None


def _fields(entry: Any, count: int) -> list[Any]:
    if not isinstance(entry, list) or len(entry) != count:
        raise ValueError(f'inputs hold an entry that has not {count} fields')
    return entry


def _moment(time: Any, now: float) -> float:
    number = as_number(time)
    if number is None or not now <= number < math.inf:
        raise ValueError(f'inputs hold a time before {now!r} s, or none: {time!r:.40}')
    return number
