# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Wrenches that wait for their stamp, and the count of those that never acted.
"""

from collections.abc import Callable
import heapq
import logging
import math
import time as wall

from icofabric_sim.messages import WrenchStampedBytes
from icofabric_sim.run_records import WrenchInput
from icofabric_sim.schedule import NANOSECONDS, seconds
from icofabric_sim.simulation import Simulation

_LOGGER = logging.getLogger('icofabric_sim')
# Wall time between two warnings of dropped wrenches [s].
_DROP_INTERVAL = 1.0


class PendingInputs:
    """
    Queue of wrenches in the order in which they act.
    """

    def __init__(self) -> None:
        """
        Start empty.
        """
        self.dropped = 0
        self._queue: list[tuple[int, int, WrenchInput]] = []
        self._sequence = 0
        self._horizon_warned = False
        self._last_drop = -math.inf

    @property
    def next_time(self) -> int | None:
        """
        Time [ns] of the next one, None without any.
        """
        return self._queue[0][0] if self._queue else None

    def add(self, received: WrenchInput, now: int, horizon: float) -> None:
        """
        Queue a wrench received at `now` [ns]; a stamp more than `horizon` [s] ahead acts at once.
        """
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
            key, scene = received.key, simulation.scene
            if not (key < scene.body_count if isinstance(key, int) else key in scene.loads):
                self.drop(received, 'the weave changed before it acted')
                continue
            record(received.topic, WrenchStampedBytes.TYPE, now, received.data)
            if isinstance(key, int):
                simulation.apply_body_wrench(key, received.force, received.torque)
            else:
                simulation.apply_wrench(key, received.force, received.torque)

    def drop(self, received: WrenchInput, reason: str) -> None:
        """
        Count one that cannot act; says so once a second of wall time.
        """
        self.dropped += 1
        if wall.monotonic() - self._last_drop >= _DROP_INTERVAL:
            self._last_drop = wall.monotonic()
            _LOGGER.warning('a wrench on %s was dropped: %s', received.topic, reason)

    def drop_all(self, reason: str) -> None:
        """
        Count those that wait and will not act any more; says once how many.
        """
        count = len(self._queue)
        if not count:
            return
        topics = ', '.join(sorted({received.topic for _, _, received in self._queue}))
        first = seconds(self._queue[0][0])
        self._queue.clear()
        self.dropped += count
        _LOGGER.warning(
            '%d waiting wrench%s dropped (%s; the first for t = %.9g s): %s',
            count,
            ' was' if count == 1 else 'es were',
            topics,
            first,
            reason,
        )
