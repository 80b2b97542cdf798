# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""External wrenches in time: what acts now, and what is to come."""

from collections.abc import Mapping
import heapq
import math
from typing import Any

from icofabric_sim.kernels.records import Loads
from icofabric_sim.scene.anchors import AnchorPack
from icofabric_sim.scene.profiles import Piece, STEADY
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.driving import Driving, PREFIX
from icofabric_sim.simulation.model.layout import Layout
from icofabric_sim.simulation.model.packing import pack_loads, WrenchRow
from icofabric_sim.simulation.state_tree import as_number, Memory
from icofabric_sim.simulation.timetable import Timetable
from icofabric_sim.simulation.wrench import Event, Key, Vector, Wrench
import numpy as np

__all__ = ['Event', 'Inputs', 'Key', 'Vector', 'Wrench']

_ZERO = np.zeros(3)


class Inputs:
    """Active wrenches of all channels and bodies, and the queue of events."""

    def __init__(self, scene: Scene) -> None:
        """Start with the scene's own loads."""
        self.scene = scene
        self.active: dict[Key, Wrench] = {}
        self.expiry: dict[Key, float] = {}
        self.received: set[Key] = set()
        self.queue: list[Event] = []
        # What the loads are made of that were packed last.
        self.packed: dict[Key, Wrench] = {}
        # Which pieces of the profiles they followed.
        self._packed_pieces: dict[str, int] = {}
        self._sequence = 0
        profiles = {
            **{name: channel.profile for name, channel in scene.loads.items()},
            **{_traction(name): part.profile for name, part in scene.tractions.items()}}
        paths = {PREFIX + name: drive.path for name, drive in scene.drives.items()}
        paths |= {_anchor(name): anchor.path for name, anchor in scene.anchors.items()}
        self.timetable = Timetable({**profiles, **paths})
        self.driving = Driving(scene.drives, scene.initial, self.timetable)
        self._varying = any(not profile.is_plain for profile in profiles.values()) or any(
            wrench.normal.any() for part in scene.tractions.values() for wrench in part.wrenches)
        self.reset(0.0)

    def reset(self, time: float) -> None:
        """Forget all that was received; what the scene does itself begins anew at `time` [s]."""
        self.queue.clear()
        self.expiry.clear()
        self.received.clear()
        self.active.clear()
        self.driving.taken.clear()
        self._begin(time, time)

    def _begin(self, epoch: float, now: float) -> None:
        """Let the scene's own loads act where nothing was received in their place."""
        self.timetable.begin(epoch, now)
        for name in self.scene.loads:
            self._follow(name)

    def _follow(self, name: str) -> bool:
        """Put the scene's own load on a channel, or take it off; whether that changes anything."""
        channel = self.scene.loads[name]
        if name in self.received or not (channel.force.any() or channel.torque.any()):
            return False
        if self.timetable.piece(name).is_zero:
            self.active.pop(name, None)
        else:
            self.active[name] = Wrench(channel.force, channel.torque)
        return True

    def acting(self) -> dict[Key, Wrench]:
        """Return what acts now: channels by name, then bodies by number."""
        return {key: self.active[key] for key in _in_order(self.active)}

    @property
    def next_time(self) -> float:
        """Time [s] at which something changes next; infinite where nothing will."""
        due = self.queue[0].time if self.queue else math.inf
        return min(due, self.timetable.next_time)

    def apply_next(self) -> bool:
        """Let that happen; returns whether anything changed for the bodies."""
        if self.timetable.next_time > self.next_time:
            return self.apply(self.take())
        changes = [
            self._follow(name) if name in self.scene.loads else name not in self.driving.taken
            for name in self.timetable.turn()]
        return any(changes)

    def require_channel(self, name: str) -> None:
        """Refuse a load channel that the scene lacks."""
        if name not in self.scene.loads:
            known = ', '.join(self.scene.loads) or 'none'
            raise ValueError(
                f'there is no load channel {name!r}; known: {known}. Define it with '
                f'loads.{name}.group'
            )

    def require_body(self, body: int) -> None:
        """Refuse a body that the scene lacks."""
        if not 0 <= body < self.scene.body_count:
            raise ValueError(
                f'there is no body {body}; bodies are 0 to {self.scene.body_count - 1}'
            )

    def adopt(self, other: 'Inputs', now: float, *, anew: bool) -> None:
        """
        Take over what still makes sense from the inputs of an earlier scene, at time `now` [s].

        `anew`: what the scene does itself begins now; else it goes on.
        """

        def known(key: Key) -> bool:
            if isinstance(key, int):
                return key < self.scene.body_count
            return key in self.scene.loads or self.driving.knows(key)

        # What was received goes on, also that it was cleared; other loads are the scene's.
        self.received = {key for key in other.received if known(key)}
        self.active.clear()
        self._begin(now if anew else other.timetable.epoch, now)
        self.driving.taken.clear()
        if not anew:
            self.driving.adopt(other.driving)
        for key in self.received:
            if key in other.active:
                self.active[key] = other.active[key]
            else:
                self.active.pop(key, None)
        self.expiry = {key: time for key, time in other.expiry.items() if known(key)}
        self.queue = [event for event in other.queue if known(event.key)]
        heapq.heapify(self.queue)
        self._sequence = other._sequence

    def schedule(self, time: float, key: Key, wrench: Wrench | None) -> None:
        """Put an event into the queue; events of one time act in the order they came."""
        rank = 0 if wrench is None else 1
        heapq.heappush(self.queue, Event(time, rank, self._sequence, key, wrench))
        self._sequence += 1

    def apply(self, event: Event) -> bool:
        """Let an event act; returns whether anything changed for the bodies."""
        if event.wrench is not None and self.driving.knows(event.key):
            self.driving.take_over(str(event.key), event.time, *event.wrench)
            return True
        before = self.active.get(event.key, Wrench(_ZERO, _ZERO))
        if event.wrench is None:
            if self.expiry.get(event.key) != event.time:
                return False  # held on by a later wrench
            del self.expiry[event.key]
            self.active.pop(event.key, None)
            return not before.is_zero()
        hold = self.scene.loads[event.key].hold if isinstance(event.key, str) else 0.0
        self.received.add(event.key)
        self.expiry.pop(event.key, None)
        if event.wrench.is_zero():
            self.active.pop(event.key, None)
        else:
            self.active[event.key] = event.wrench
            if hold > 0.0:
                self.expiry[event.key] = event.time + hold
                self.schedule(event.time + hold, event.key, None)
        return not event.wrench.same(before)

    def pack(self, layout: Layout, *, stages: int = 0) -> Loads:
        """Rows for the kernels of what acts now."""
        self.packed = dict(self.active)
        self._packed_pieces = {
            name: number for name, number in self.timetable.numbers.items()
            if name not in self.received}
        self.driving.pack()
        return self.pack_again(layout, stages=stages)

    def pack_again(self, layout: Layout, *, stages: int = 0) -> Loads:
        """The rows that were packed last: channels by name, single bodies by number, tractions."""
        return pack_loads(
            self.packed_rows(), layout, stages=stages, varying=self._varying,
            drives=self.driving.pack_again(), anchors=self._pack_anchors())

    def packed_rows(self) -> list[WrenchRow]:
        """The wrenches that were packed last."""
        rows = []
        for key in _in_order(self.packed):
            piece = self._piece(key) if key in self._packed_pieces else STEADY.pieces[0]
            rows.append(self._row(key, self.packed[key], piece))
        for name, part in self.scene.tractions.items():
            piece = self._piece(_traction(name))
            if not piece.is_zero:
                rows += [WrenchRow(*wrench[:-1], piece, wrench.normal) for wrench in part.wrenches]
        return rows

    def pack_strongest(self, layout: Layout) -> Loads:
        """Rows of all that the scene does itself, each at its strongest, as if at one time."""
        rows = [
            self._row(name, Wrench(channel.force, channel.torque), channel.profile.strongest)
            for name, channel in self.scene.loads.items()]
        for part in self.scene.tractions.values():
            strongest = part.profile.strongest
            rows += [WrenchRow(*wrench[:-1], strongest, wrench.normal) for wrench in part.wrenches]
        return pack_loads(rows, layout, varying=self._varying)

    def _pack_anchors(self) -> AnchorPack | None:
        anchors, laws = self.scene.anchors, self.scene.anchor_law
        if not anchors:
            return None
        return AnchorPack(
            tuple(anchor.body for anchor in anchors.values()),
            tuple(anchor.arm for anchor in anchors.values()),
            tuple(self._piece(_anchor(name)) for name in anchors), laws)

    def anchor_points(self, time: float) -> np.ndarray:
        """
        Where the points of the anchors are at a `time` [s] of the present pieces, (a, 3) [m].
        """
        pieces = [self.timetable.piece(_anchor(name)) for name in self.scene.anchors]
        return np.array([piece.at(time)[:3] for piece in pieces]).reshape(-1, 3)

    def _piece(self, name: Any) -> Any:
        """The piece of a profile that ruled when the loads were packed last."""
        return self.timetable.piece(name, self._packed_pieces.get(name))

    def _row(self, key: Key, wrench: Wrench, piece: Piece) -> WrenchRow:
        if isinstance(key, int):
            return WrenchRow(np.array([key], np.int32), True, *wrench, piece=piece)
        channel = self.scene.loads[key]
        part = len(channel.bodies) if channel.total else 1
        return WrenchRow(
            channel.bodies, channel.in_body_axes, wrench.force / part, wrench.torque / part,
            channel.point, piece)

    def take(self) -> Event:
        """Remove and return the next event."""
        return heapq.heappop(self.queue)

    def memory(self) -> dict[str, Any]:
        """What acts, what acts still, and what is to come, in an order of its own."""
        queue = [
            [event.time, event.rank, event.key, *_numbers(event.wrench)]
            for event in sorted(self.queue, key=lambda event: event[:3])]
        return {
            'active': _listing(self.active),
            'packed': _listing(self.packed),
            'expiry': [[key, self.expiry[key]] for key in _in_order(self.expiry)],
            'received': _in_order(dict.fromkeys(self.received)),
            'queue': queue,
            'timetable': self.timetable.memory(),
            'driving': self.driving.memory(),
            'packed_pieces': [list(item) for item in sorted(self._packed_pieces.items())],
        }

    def recall(self, memory: Memory, now: float) -> None:
        """Go on from there; nothing is to come before `now` [s]."""
        self.timetable.recall(memory.part('timetable'), now)
        pieces = self.timetable.known_numbers(memory.entries('packed_pieces'))
        self.driving.recall(memory.part('driving'))
        active, packed = (self._wrenches(memory.entries(name)) for name in ('active', 'packed'))
        expiry: dict[Key, float] = {}
        for entry in memory.entries('expiry'):
            key, time = _fields(entry, 2)
            expiry[self._known(key)] = _moment(time, now)
        received = {self._known(key) for key in memory.entries('received')}
        queue = []
        for number, entry in enumerate(memory.entries('queue')):
            time, rank, key, force, torque = _fields(entry, 5)
            wrench = None if force is None and torque is None else Wrench.checked(force, torque)
            if type(rank) is not int or rank != (0 if wrench is None else 1):
                raise ValueError(f'inputs.queue has an entry of rank {rank!r:.40}')
            queue.append(Event(_moment(time, now), rank, number, self._known(key), wrench))
        heapq.heapify(queue)
        self.active, self.packed, self.expiry = active, packed, expiry
        self._packed_pieces = pieces
        self.received, self.queue, self._sequence = received, queue, len(queue)

    @property
    def concern_bodies(self) -> bool:
        """Whether any of them is for a single body."""
        keys = (*self.active, *self.packed, *self.received, *(event.key for event in self.queue))
        return any(isinstance(key, int) for key in keys)

    def _wrenches(self, entries: list[Any]) -> dict[Key, Wrench]:
        wrenches = {}
        for entry in entries:
            key, force, torque = _fields(entry, 3)
            wrenches[self._known(key)] = Wrench.checked(force, torque)
        return wrenches

    def _known(self, key: Any) -> Key:
        if type(key) is int:
            self.require_body(key)
        elif isinstance(key, str) and self.driving.knows(key):
            pass
        elif isinstance(key, str):
            self.require_channel(key)
        else:
            raise ValueError('inputs hold a wrench on neither a channel nor a body')
        return key


def _traction(name: str) -> str:
    """What a traction is called among the profiles: no channel has a dot in its name."""
    return f'tractions.{name}'


def _anchor(name: str) -> str:
    return f'anchors.{name}'


def _in_order(keys: Mapping[Key, Any]) -> list[Key]:
    return sorted(keys, key=lambda key: (isinstance(key, int), key))


def _listing(wrenches: Mapping[Key, Wrench]) -> list[Any]:
    return [[key, *_numbers(wrenches[key])] for key in _in_order(wrenches)]


def _numbers(wrench: Wrench | None) -> list[Any]:
    return [None, None] if wrench is None else [part.tolist() for part in wrench]


def _fields(entry: Any, count: int) -> list[Any]:
    if not isinstance(entry, list) or len(entry) != count:
        raise ValueError(f'inputs hold an entry that has not {count} fields')
    return entry


def _moment(time: Any, now: float) -> float:
    number = as_number(time)
    if number is None or not now <= number < math.inf:
        raise ValueError(f'inputs hold a time before {now!r} s, or none: {time!r:.40}')
    return number
