# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Received wrenches and twists: validated, passed to the simulation with their stamps, recorded.

The sender of a wrench is not identified. Among several senders on one channel, or on one body, the
wrench that acted last holds until another one acts or the hold time of the channel has passed. A
twist moves its drive or plane until another one arrives. Inputs with equal stamps act in the order
of arrival. After a sender has ended, its last wrench stays and its future wrenches still act; use
`loads.NAME.hold` to end a wrench with its sender. Inputs are not stored for late subscribers.

Effect of a change of the run on waiting inputs:

- pause: they keep waiting, and act at their stamps, after the pause at the earliest;
- another weave: inputs whose body or channel still exists keep waiting, others are dropped;
- cleared loads: wrenches are dropped, twists keep waiting;
- reset, or restored checkpoint: all are dropped, and active inputs are forgotten;
- failure, or end of the run: all are dropped.

Dropped inputs are counted and logged.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import logging
import math
import time
from typing import NamedTuple

from icofabric_sim.messages import PointStampedBytes, TwistStampedBytes, WrenchStampedBytes
from icofabric_sim.messages.frames import ANY_BODY, body_frame, shown_frame
from icofabric_sim.messages.input_topics import (
    decode_input,
    input_type,
    InputMessage,
    PULL,
    topic_of,
)
from icofabric_sim.messages.schedule import NANOSECONDS, seconds
from icofabric_sim.running.rate_limited_log import RateLimitedLog
from icofabric_sim.running.run_state import RunState
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.inputs.input_types import (
    BodyTarget,
    ChannelTarget,
    DriveTarget,
    load_order,
    PlaneTarget,
    Pull,
    PullTarget,
    require_target,
    Target,
    Twist,
    Value,
)
from icofabric_sim.simulation.inputs.inputs import Inputs
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')
# Largest number of waiting inputs: while time stands still, future stamps would fill the memory.
MAX_WAITING_INPUTS = 100_000
# A wrench that moves a body by its size, or rotates it, at a larger rate [1/s] requires steps of
# less than a microsecond: one such message would stall the simulation.
_MAX_RATE = 1e6
# A drag ends this wall time [s] after its last message.
PULL_SILENCE = 0.5
# Number of first characters that identify the kind of a reason.
_KIND_LENGTH = 16


class Message(NamedTuple):
    """Message to be recorded."""

    topic: str
    time: int  # [ns] at which it acts
    data: bytes


class ReceivedInputs:
    """Inputs of one run; all methods except `receive` run in the thread of the run."""

    def __init__(
        self,
        run: RunState,
        put: Callable[[Callable[[], object]], object],
        record: Callable[[str, str, int, bytes], object],
        full_name: Callable[[str], str],
    ) -> None:
        """
        Receive for `run`; `put` executes a call in the thread of the run.

        `record` takes topic, type, time [ns] and message after an input has acted; `full_name`
        returns the topic name for warnings.
        """
        self._run, self._put, self._record, self._full_name = run, put, record, full_name
        self._warnings = RateLimitedLog(_LOGGER.warning)
        self._horizon_warned = False
        # Wall time [s] of the last message for each dragged body.
        self._pull_heard: dict[int, float] = {}
        self.acted = 0  # received inputs that have acted
        self.dropped = 0  # received inputs that never act

    def __len__(self) -> int:
        """Count the inputs that wait for their stamp."""
        return self._inputs.message_count

    @property
    def _inputs(self) -> Inputs:
        """Return the inputs of the present simulation."""
        return self._run.simulation.inputs

    def receive(self, topic: str, data: bytes) -> None:
        """Accept a message of an input topic ('~/...') from any thread."""
        self._put(lambda: self.take(topic, data))

    def take(self, topic: str, data: bytes) -> None:
        """Validate a message; its input acts at its stamp, or is dropped."""
        try:
            received = decode_input(topic, data)
            judge(self._run.simulation.scene, received)
        except ValueError as error:
            self._drop(topic, str(error))
            return
        self.act(received, data)

    def act(self, received: InputMessage, data: bytes) -> None:
        """Apply a validated input at its stamp, or at once; `data` is recorded."""
        run, topic = self._run, topic_of(received.target)
        if run.failure:
            self._drop(topic, 'the simulation has stopped')
            return
        if len(self) >= MAX_WAITING_INPUTS:
            self._drop(
                topic, f'{MAX_WAITING_INPUTS:,} inputs are already waiting for their stamps')
            return
        target, stamp = received.target, received.stamp
        if isinstance(target, PullTarget):
            # A drag acts when it arrives, whatever its stamp.
            stamp = 0
            self._pull_heard[target.number] = time.monotonic()
        at, horizon = max(stamp, run.now), run.parameters['input_horizon']
        if at > run.now + round(horizon * NANOSECONDS):
            self._warn_of_horizon(topic, at, horizon)
            at = run.now
        self._inputs.put(
            seconds(at), received.target, received.value, Message(topic, at, bytes(data)))
        if at == run.now and not run.is_held:
            with self.recorded():
                run.simulation.advance_to(seconds(at))

    def end_silent_pulls(self) -> None:
        """Release dragged bodies without recent messages."""
        pulled = self._inputs.pulled_bodies
        if not pulled or self._run.failure:
            return
        now = time.monotonic()
        # A drag restored with a checkpoint has had no message.
        self._pull_heard = {body: self._pull_heard.get(body, now) for body in pulled}
        for body, heard in list(self._pull_heard.items()):
            if now - heard > PULL_SILENCE:
                self._release(body)

    def _release(self, body: int) -> None:
        message = PointStampedBytes(body_frame(body))
        message.point[:] = math.nan
        data = message.stamped(self._run.now)
        self.act(decode_input(PULL, data), data)

    def clear(self) -> int:
        """
        Apply a zero wrench on every body and channel with wrenches, and end all drags.

        The zero wrenches are recorded as if received. Waiting wrenches are dropped; their number
        is returned. Drives and planes continue.
        """
        dropped = self.drop_waiting(
            'all loads were cleared',
            lambda target: not isinstance(target, (DriveTarget, PlaneTarget)))
        run = self._run
        channels = run.simulation.scene.loads
        targets = {*self._inputs.acting(), *(
            ChannelTarget(name) for name, channel in channels.items()
            if channel.force.any() or channel.torque.any())}
        for target in sorted(targets, key=load_order):
            frame = body_frame(target.number) if isinstance(target, BodyTarget) else ''
            data = WrenchStampedBytes(frame).stamped(run.now)
            self.act(decode_input(topic_of(target), data), data)
        for body in self._inputs.pulled_bodies:
            self._release(body)
        return dropped

    @contextmanager
    def recorded(self) -> Iterator[None]:
        """Record the inputs that act in this block, at its end and also after an error."""
        try:
            yield
        finally:
            self.record_acted()

    def record_acted(self) -> None:
        """Record the inputs that have acted since the last call, in their order."""
        for message in self._inputs.take_acted():
            self.acted += 1
            self._record(message.topic, input_type(message.topic), message.time, message.data)

    def drop_waiting(
        self, reason: str, is_lost: Callable[[Target], bool] = lambda target: True
    ) -> int:
        """Drop waiting inputs, or only those of lost targets; log and return their number."""
        lost = self._inputs.drop_messages(is_lost)
        count = len(lost)
        if count:
            self.dropped += count
            topics = sorted({self._full_name(event.message.topic) for event in lost})
            _LOGGER.warning(
                '%d waiting input%s dropped (%s; the first for t = %.9g s): %s', count,
                ' was' if count == 1 else 's were', ', '.join(topics), lost[0].time, reason)
        return count

    def _drop(self, topic: str, reason: str) -> None:
        self.dropped += 1
        what = {
            TwistStampedBytes.TYPE: 'twist', PointStampedBytes.TYPE: 'pull'}.get(
                input_type(topic), 'wrench')
        name = self._full_name(topic)
        self._warnings.log(
            f'{name} {reason[:_KIND_LENGTH]}', f'a {what} on {name} was dropped: {reason}')

    def _warn_of_horizon(self, topic: str, at: int, horizon: float) -> None:
        if self._horizon_warned:
            return
        self._horizon_warned = True
        _LOGGER.warning(
            'the stamp %.3f s on %s is more than input_horizon = %g s ahead of simulated time '
            "(%.3f s): the sender's clock is not simulated time. The wrench acts at once; send "
            'stamp 0, or follow /clock (logged once)',
            seconds(at), self._full_name(topic), horizon, seconds(self._run.now))


def judge(scene: Scene, received: InputMessage) -> None:
    """Raise ValueError if `scene` cannot accept an input."""
    target, value = received.target, received.value
    require_target(scene, target)
    _require_frame(scene, target, received.frame_id)
    if isinstance(value, Pull) and value.is_release:
        return
    if not all(math.isfinite(number) for part in value for number in part.tolist()):
        raise ValueError(f'not finite ({_amounts(value)})')
    if isinstance(target, PlaneTarget) and isinstance(value, Twist) and value.angular.any():
        raise ValueError(f'a plane does not rotate ({_amounts(value)}): send angular 0')
    if not _rate(scene, received) <= _MAX_RATE:
        if isinstance(target, (DriveTarget, PlaneTarget, PullTarget)):
            raise ValueError(f'too fast to integrate ({_amounts(value)})')
        raise ValueError(
            f'too large to integrate ({_amounts(value)} on bodies of '
            f'{_lightest(scene, target)[0]:.3g} kg)')


def _require_frame(scene: Scene, target: Target, frame_id: str) -> None:
    world, rule = scene.parameters['frame_id'], 'a drive moves in the world frame'
    if isinstance(target, ChannelTarget):
        in_body_axes = scene.loads[target.name].in_body_axes
        rule = f'{target}.frame is {"body" if in_body_axes else "world"}'
        world = ANY_BODY if in_body_axes else world
    elif isinstance(target, PlaneTarget):
        rule = 'a plane moves in the world frame'
    elif not isinstance(target, DriveTarget):
        return  # the frame names the body of a wrench or of a drag
    if frame_id not in ('', world):
        raise ValueError(
            f"its header.frame_id is {shown_frame(frame_id)}; {rule}, so it must be '' or "
            f'{world!r}')


def _amounts(value: Value) -> str:
    units: tuple[str, ...] = ('m/s', 'rad/s') if isinstance(value, Twist) else ('N', 'N m')
    if isinstance(value, Pull):
        units = ('m',)
    return ', '.join(
        f'{name} {part.tolist()} {unit}'
        for name, part, unit in zip(value._fields, value, units))


def _rate(scene: Scene, received: InputMessage) -> float:
    """
    Return the rate [1/s] at which an input alone would move a body by its size, or rotate it.
    """
    target = received.target
    if isinstance(target, PullTarget):
        return 0.0  # its force is limited
    straight, turning = (math.hypot(*part.tolist()) for part in received.value)
    size = scene.geometry.cube_width
    if isinstance(target, (DriveTarget, PlaneTarget)):
        return straight / size + turning
    if isinstance(target, ChannelTarget):
        channel = scene.loads[target.name]
        turning += math.hypot(*channel.point) * straight
        if channel.is_divided:
            straight, turning = straight / len(channel.bodies), turning / len(channel.bodies)
    mass, inertia = _lightest(scene, target)
    return math.sqrt(straight / (mass * size) + turning / inertia)


def _lightest(scene: Scene, target: BodyTarget | ChannelTarget) -> tuple[float, float]:
    """Return the smallest mass [kg] and inertia [kg m^2] of the bodies that a wrench acts on."""
    bodies = (
        scene.loads[target.name].bodies if isinstance(target, ChannelTarget) else [target.number])
    mass, inertia = (np.broadcast_to(values, scene.body_count)[bodies].min() for values in (
        scene.masses.mass, scene.masses.inertia))
    return float(mass), float(inertia)
