# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
External wrenches in time: what acts now, and what is to come.
"""

from collections.abc import Mapping, Sequence
import heapq
import math
from typing import Any, NamedTuple, Self

from icofabric_sim.kernels.records import Loads
from icofabric_sim.layout import Layout
from icofabric_sim.memory import as_number, Memory
from icofabric_sim.model import pack_loads
from icofabric_sim.scene import Scene
import numpy as np

_ZERO = np.zeros(3)
Key = str | int  # a channel by name, or a body by number
Vector = Sequence[float] | np.ndarray


class Wrench(NamedTuple):
    """
    A force and a torque on the axes of their channel.
    """

    force: np.ndarray  # (3,) [N]
    torque: np.ndarray  # (3,) [N m]

    @classmethod
    def checked(cls, force: Vector, torque: Vector) -> Self:
        """
        Make a wrench of numbers from outside; ValueError says what is wrong with them.
        """
        return cls(_vector('force', force), _vector('torque', torque))

    def is_zero(self) -> bool:
        """
        Whether it does nothing.
        """
        return not (self.force.any() or self.torque.any())

    def same(self, other: 'Wrench') -> bool:
        """
        Whether both have the same values.
        """
        return bool((self.force == other.force).all() and (self.torque == other.torque).all())


class Event(NamedTuple):
    """
    A wrench that begins, or (`wrench` None) the end of its hold time.
    """

    time: float
    rank: int  # at one time, holds end before wrenches begin
    sequence: int
    key: Key
    wrench: Wrench | None


class Inputs:
    """
    Active wrenches of all channels and bodies, and the queue of events.
    """

    def __init__(self, scene: Scene) -> None:
        """
        Start with the scene's own steady loads.
        """
        self.scene = scene
        self.active: dict[Key, Wrench] = {}
        self.expiry: dict[Key, float] = {}
        self.received: set[Key] = set()
        self.queue: list[Event] = []
        # What the loads are made of that were packed last.
        self.packed: dict[Key, Wrench] = {}
        self._sequence = 0
        self.reset()

    def reset(self) -> None:
        """
        Forget all that was received.
        """
        self.queue.clear()
        self.expiry.clear()
        self.received.clear()
        self.active = {
            name: Wrench(channel.force, channel.torque)
            for name, channel in self.scene.loads.items()
            if channel.force.any() or channel.torque.any()
        }

    def require_channel(self, name: str) -> None:
        """
        Refuse a load channel that the scene lacks.
        """
        if name not in self.scene.loads:
            known = ', '.join(self.scene.loads) or 'none'
            raise ValueError(
                f'there is no load channel {name!r}; known: {known}. Define it with '
                f'loads.{name}.group'
            )

    def require_body(self, body: int) -> None:
        """
        Refuse a body that the scene lacks.
        """
        if not 0 <= body < self.scene.body_count:
            raise ValueError(
                f'there is no body {body}; bodies are 0 to {self.scene.body_count - 1}'
            )

    def adopt(self, other: 'Inputs') -> None:
        """
        Take over what still makes sense from the inputs of an earlier scene.
        """

        def known(key: Key) -> bool:
            return key < self.scene.body_count if isinstance(key, int) else key in self.scene.loads

        # What was received goes on, also that it was cleared; other steady loads are the scene's.
        self.received = {key for key in other.received if known(key)}
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
        """
        Put an event into the queue; events of one time act in the order they came.
        """
        rank = 0 if wrench is None else 1
        heapq.heappush(self.queue, Event(time, rank, self._sequence, key, wrench))
        self._sequence += 1

    def apply(self, event: Event) -> bool:
        """
        Let an event act; returns whether anything changed for the bodies.
        """
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
        """
        Rows for the kernels of what acts now.
        """
        self.packed = dict(self.active)
        return self.pack_again(layout, stages=stages)

    def pack_again(self, layout: Layout, *, stages: int = 0) -> Loads:
        """
        The rows that were packed last: channels by name, then single bodies by number.
        """
        rows = []
        for key in _in_order(self.packed):
            wrench = self.packed[key]
            if isinstance(key, int):
                rows.append((np.array([key], np.int32), True, wrench.force, wrench.torque, _ZERO))
                continue
            channel = self.scene.loads[key]
            part = len(channel.bodies) if channel.total else 1
            rows.append(
                (
                    channel.bodies,
                    channel.in_body_axes,
                    wrench.force / part,
                    wrench.torque / part,
                    channel.point,
                )
            )
        return pack_loads(rows, layout, stages=stages)

    def take(self) -> Event:
        """
        Remove and return the next event.
        """
        return heapq.heappop(self.queue)

    def memory(self) -> dict[str, Any]:
        """
        What acts, what acts still, and what is to come, in an order of its own.
        """
        queue = [
            [event.time, event.rank, event.key, *_numbers(event.wrench)]
            for event in sorted(self.queue, key=lambda event: event[:3])]
        return {
            'active': _listing(self.active),
            'packed': _listing(self.packed),
            'expiry': [[key, self.expiry[key]] for key in _in_order(self.expiry)],
            'received': _in_order(dict.fromkeys(self.received)),
            'queue': queue,
        }

    def recall(self, memory: Memory, now: float) -> None:
        """
        Go on from there; nothing is to come before `now` [s].
        """
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
        self.received, self.queue, self._sequence = received, queue, len(queue)

    @property
    def concern_bodies(self) -> bool:
        """
        Whether any of them is for a single body.
        """
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
        elif isinstance(key, str):
            self.require_channel(key)
        else:
            raise ValueError('inputs hold a wrench on neither a channel nor a body')
        return key


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


def _vector(name: str, value: Vector) -> np.ndarray:
    try:
        vector = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f'{name} must be three finite numbers, got {value!r:.200}')
    return vector
