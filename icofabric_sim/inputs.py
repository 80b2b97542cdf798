# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
External wrenches in time: what acts now, and what is to come.
"""

import heapq
from typing import NamedTuple

from icofabric_sim.kernels.records import Loads
from icofabric_sim.layout import Layout
from icofabric_sim.model import pack_loads
from icofabric_sim.scene import Scene
import numpy as np

_ZERO = np.zeros(3)
Key = str | int  # a channel by name, or a body by number


class Wrench(NamedTuple):
    """
    A force and a torque on the axes of their channel.
    """

    force: np.ndarray  # (3,) [N]
    torque: np.ndarray  # (3,) [N m]

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
        Rows for the kernels: channels by name, then single bodies by number.
        """
        rows = []
        for key in sorted(self.active, key=lambda key: (isinstance(key, int), key)):
            wrench = self.active[key]
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
