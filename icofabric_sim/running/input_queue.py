# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Wrenches and twists that wait for their stamp, and the count of those that never acted.

Who sent a wrench is not known and does not matter: of several senders on one channel, or on one
body, the wrench that acts last rules alone until another one acts, or until the hold time of the
channel has passed; a twist moves its drive until another one comes. Those of one stamp act in the
order in which they were received. When a sender is gone its last wrench stays, and what it had
sent ahead still acts; a `loads.NAME.hold` is the way to have a wrench end with its sender. Nothing
is kept for those who come later: whoever listens to a channel hears what is sent from then on.

What waits when the run is changed from outside:

- a pause: it waits on, and acts at its stamp, in the first step after the pause at the earliest;
- another weave: what still has its body or its channel waits on, the rest is dropped;
- a reset, or a checkpoint that is restored: all of it is dropped, as what acts is forgotten then;
- a failure, or the end of the run: all of it is dropped.

What was dropped is counted and said.
"""

from collections.abc import Callable
import heapq
import logging
import math
import time as wall

from icofabric_sim.messages import TwistStampedBytes, WrenchStampedBytes
from icofabric_sim.messages.schedule import NANOSECONDS, seconds
from icofabric_sim.running.run_records import WrenchInput
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.driving import PREFIX
from icofabric_sim.simulation.inputs import Key
from icofabric_sim.simulation.simulation import Simulation

_LOGGER = logging.getLogger('icofabric_sim')
# Wall time between two warnings of dropped wrenches [s].
_DROP_INTERVAL = 1.0
# Wrenches that wait at most: while time stands still those stamped ahead would fill the memory.
LARGEST_QUEUE = 100_000


class PendingInputs:
    """Queue of wrenches in the order in which they act."""

    def __init__(self) -> None:
        """Start empty."""
        self.dropped = 0
        self._queue: list[tuple[int, int, WrenchInput]] = []
        self._sequence = 0
        self._horizon_warned = False
        self._last_drop = -math.inf

    def __len__(self) -> int:
        """Count those that wait."""
        return len(self._queue)

    @property
    def next_time(self) -> int | None:
        """Time [ns] of the next one, None without any."""
        return self._queue[0][0] if self._queue else None

    def add(self, received: WrenchInput, now: int, horizon: float) -> None:
        """
        Queue a wrench received at `now` [ns]; a stamp more than `horizon` [s] ahead acts at once.
        """
        if len(self._queue) >= LARGEST_QUEUE:
            self.drop(received, f'{LARGEST_QUEUE:,} wrenches wait for their stamp already')
            return
        at = received.stamp
        if at > now + round(horizon * NANOSECONDS):
            if not self._horizon_warned:
                self._horizon_warned = True
                _LOGGER.warning(
                    'the stamp %.3f s on %s lies more than input_horizon = %g s ahead of '
                    "simulated time (%.3f s): the sender's clock is not simulated time. The "
                    'wrench acts at once; send stamp 0, or follow /clock (said once)',
                    seconds(at),
                    received.topic,
                    horizon,
                    seconds(now),
                )
            at = now
        heapq.heappush(self._queue, (max(at, now), self._sequence, received))
        self._sequence += 1

    def act(
        self, now: int, simulation: Simulation, record: Callable[[str, str, int, bytes], None]
    ) -> None:
        """
        Have those that are due by `now` [ns] act on `simulation`, which stands there.

        Each goes to `record` before it acts. One that the simulation fails on is out of the queue;
        the others stay.
        """
        while self._queue and self._queue[0][0] <= now:
            _, _, received = heapq.heappop(self._queue)
            key = received.key
            if not knows(simulation.scene, key):
                # Received after the weave changed, from one who does not know it yet.
                self.drop(received, 'the weave changed before it acted')
                continue
            if isinstance(key, str) and key.startswith(PREFIX):
                record(received.topic, TwistStampedBytes.TYPE, now, received.data)
                simulation.apply_twist(key.removeprefix(PREFIX), received.force, received.torque)
                continue
            record(received.topic, WrenchStampedBytes.TYPE, now, received.data)
            if isinstance(key, int):
                simulation.apply_body_wrench(key, received.force, received.torque)
            else:
                simulation.apply_wrench(key, received.force, received.torque)

    def drop(self, received: WrenchInput, reason: str) -> None:
        """Count one that cannot act; says so once a second of wall time."""
        self.dropped += 1
        if wall.monotonic() - self._last_drop >= _DROP_INTERVAL:
            self._last_drop = wall.monotonic()
            _LOGGER.warning('a wrench on %s was dropped: %s', received.topic, reason)

    def drop_all(self, reason: str) -> int:
        """Count those that wait and will not act any more; says once how many, and returns it."""
        return self._drop_where(lambda received: True, reason)

    def drop_unknown(self, scene: Scene, reason: str) -> int:
        """The same for those whose channel or body is not part of `scene`."""
        return self._drop_where(lambda received: not knows(scene, received.key), reason)

    def _drop_where(self, is_lost: Callable[[WrenchInput], bool], reason: str) -> int:
        lost = [entry for entry in self._queue if is_lost(entry[2])]
        count = len(lost)
        if not count:
            return 0
        topics = ', '.join(sorted({received.topic for _, _, received in lost}))
        first = seconds(min(lost)[0])
        # A sorted list is a heap.
        self._queue = sorted(entry for entry in self._queue if not is_lost(entry[2]))
        self.dropped += count
        _LOGGER.warning(
            '%d waiting wrench%s dropped (%s; the first for t = %.9g s): %s',
            count,
            ' was' if count == 1 else 'es were',
            topics,
            first,
            reason,
        )
        return count


def knows(scene: Scene, key: Key) -> bool:
    """Whether a scene has the channel or the body of a wrench, or the drive of a twist."""
    if isinstance(key, int):
        return key < scene.body_count
    return key in scene.loads or (
        key.startswith(PREFIX) and key.removeprefix(PREFIX) in scene.drives)


def describe_key(key: Key) -> str:
    """A channel or a body in words."""
    if isinstance(key, int):
        return f'body {key}'
    return key if key.startswith(PREFIX) else f'loads.{key}'
