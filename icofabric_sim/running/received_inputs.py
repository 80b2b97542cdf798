# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
Wrenches and twists from outside: judged, handed to the simulation with their stamp, recorded.

Who sent a wrench is not known and does not matter: of several senders on one channel, or on one
body, the wrench that acts last rules alone until another one acts, or until the hold time of the
channel has passed; a twist moves its drive until another one comes. Those of one stamp act in the
order in which they were received. When a sender is gone its last wrench stays, and what it had
sent ahead still acts; a `loads.NAME.hold` is the way to have a wrench end with its sender. Nothing
is kept for those who come later: whoever listens to a channel hears what is sent from then on.

What waits when the run is changed from outside:

- a pause: it waits on, and acts at its stamp, in the first step after the pause at the earliest;
- another weave: what still has its body or its channel waits on, the rest is dropped;
- loads that are cleared: wrenches are dropped, twists wait on;
- a reset, or a checkpoint that is restored: all of it is dropped, as what acts is forgotten then;
- a failure, or the end of the run: all of it is dropped.

What was dropped is counted and said.
"""

from collections.abc import Callable
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
from icofabric_sim.running.complaints import Complaints
from icofabric_sim.running.run_state import RunState
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.input_types import (
    BodyTarget,
    ChannelTarget,
    DriveTarget,
    load_order,
    Pull,
    PullTarget,
    require_target,
    Target,
    Twist,
    Value,
)
from icofabric_sim.simulation.simulation import Simulation
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')
# Inputs that wait at most: while time stands still those stamped ahead would fill the memory.
LARGEST_QUEUE = 100_000
# A wrench that moves a body by its own size, or turns it, at a larger rate [1/s] takes steps of
# less than a microsecond to follow: one such message would bring the simulation to a standstill.
_LARGEST_RATE = 1e6
# A pull ends so long after its last message: wall time [s].
PULL_SILENCE = 0.5
# So many first characters of a reason tell its kind.
_KIND_LENGTH = 16


class Message(NamedTuple):
    """A message as it goes into the record."""

    topic: str
    time: int  # [ns] at which it acts
    data: bytes


class ReceivedInputs:
    """The inputs of one run; all but `receive` in the thread of the run."""

    def __init__(
        self,
        run: RunState,
        put: Callable[[Callable[[], object]], object],
        record: Callable[[str, str, int, bytes], object],
        full_name: Callable[[str], str],
    ) -> None:
        """
        Receive for `run`; `put` brings a call into its thread.

        `record` takes topic, type, time [ns] and message as an input acts; `full_name` of a topic
        is what warnings say.
        """
        self._run, self._put, self._record, self._full_name = run, put, record, full_name
        self._complaints = Complaints(_LOGGER.warning)
        self._horizon_warned = False
        # Wall time [s] of the last message for each body that is pulled.
        self._pull_heard: dict[int, float] = {}
        self.dropped = 0  # inputs that were received and never act

    def __len__(self) -> int:
        """Count those that wait for their stamp."""
        return self._run.simulation.inputs.queue.message_count

    def receive(self, topic: str, data: bytes) -> None:
        """Take a message of an input topic ('~/...'), from any thread."""
        self._put(lambda: self.take(topic, data))

    def take(self, topic: str, data: bytes) -> None:
        """Judge a message; what it puts on its target acts at its stamp, or is dropped."""
        try:
            received = decode_input(topic, data)
            judge(self._run.simulation.scene, received)
        except ValueError as error:
            self._drop(topic, str(error))
            return
        self.act(received, data)

    def act(self, received: InputMessage, data: bytes) -> None:
        """Have a judged input act at its stamp, or at once; `data` goes into the record."""
        run, topic = self._run, topic_of(received.target)
        if run.failure:
            self._drop(topic, 'the simulation has stopped')
            return
        if len(self) >= LARGEST_QUEUE:
            self._drop(topic, f'{LARGEST_QUEUE:,} wrenches wait for their stamp already')
            return
        target, stamp = received.target, received.stamp
        if isinstance(target, PullTarget):
            # A hand acts when it moves, whatever its clock says.
            stamp = 0
            self._pull_heard[target.number] = time.monotonic()
        at, horizon = max(stamp, run.now), run.parameters['input_horizon']
        if at > run.now + round(horizon * NANOSECONDS):
            self._warn_of_horizon(topic, at, horizon)
            at = run.now
        run.simulation.inputs.queue.put(
            seconds(at), received.target, received.value, Message(topic, at, bytes(data)))
        if at == run.now and not run.is_held:
            run.simulation.advance_to(seconds(at))

    def end_silent_pulls(self) -> None:
        """Let go of the bodies whose pulls were not heard of for a while, as their hands would."""
        pulled = self._run.simulation.inputs.pulls.bodies
        if not pulled or self._run.failure:
            return
        now = time.monotonic()
        # A pull that came with a checkpoint has not been heard of at all.
        self._pull_heard = {body: self._pull_heard.get(body, now) for body in pulled}
        for body, heard in list(self._pull_heard.items()):
            if now - heard > PULL_SILENCE:
                self._let_go(body)

    def _let_go(self, body: int) -> None:
        message = PointStampedBytes(body_frame(body))
        message.point[:] = math.nan
        data = message.stamped(self._run.now)
        self.act(decode_input(PULL, data), data)

    def clear(self) -> int:
        """
        Put a zero wrench on all that a wrench acts on or may come to, and end all pulls.

        That is recorded as received. Those that wait for their stamp are dropped; returns how
        many. Drives go on.
        """
        dropped = self.drop_waiting(
            'all loads were cleared', lambda target: not isinstance(target, DriveTarget))
        run = self._run
        inputs, channels = run.simulation.inputs, run.simulation.scene.loads
        targets = {*inputs.acting(), *(
            ChannelTarget(name) for name, channel in channels.items()
            if channel.force.any() or channel.torque.any())}
        for target in sorted(targets, key=load_order):
            frame = body_frame(target.number) if isinstance(target, BodyTarget) else ''
            data = WrenchStampedBytes(frame).stamped(run.now)
            self.act(decode_input(topic_of(target), data), data)
        for body in inputs.pulls.bodies:
            self._let_go(body)
        return dropped

    def follow(self, simulation: Simulation) -> None:
        """Record what acts on `simulation` from now on."""
        simulation.inputs.on_message = self._acts

    def drop_waiting(
        self, reason: str, is_lost: Callable[[Target], bool] = lambda target: True
    ) -> int:
        """Drop those that wait, of lost targets only; logs once how many, and returns it."""
        lost = self._run.simulation.inputs.queue.drop_messages(is_lost)
        count = len(lost)
        if count:
            self.dropped += count
            topics = sorted({self._full_name(event.message.topic) for event in lost})
            _LOGGER.warning(
                '%d waiting wrench%s dropped (%s; the first for t = %.9g s): %s', count,
                ' was' if count == 1 else 'es were', ', '.join(topics), lost[0].time, reason)
        return count

    def _acts(self, message: Message) -> None:
        self._record(message.topic, input_type(message.topic), message.time, message.data)

    def _drop(self, topic: str, reason: str) -> None:
        self.dropped += 1
        what = {
            TwistStampedBytes.TYPE: 'twist', PointStampedBytes.TYPE: 'pull'}.get(
                input_type(topic), 'wrench')
        name = self._full_name(topic)
        self._complaints.add(
            f'{name} {reason[:_KIND_LENGTH]}', f'a {what} on {name} was dropped: {reason}')

    def _warn_of_horizon(self, topic: str, at: int, horizon: float) -> None:
        if self._horizon_warned:
            return
        self._horizon_warned = True
        _LOGGER.warning(
            'the stamp %.3f s on %s lies more than input_horizon = %g s ahead of simulated time '
            "(%.3f s): the sender's clock is not simulated time. The wrench acts at once; send "
            'stamp 0, or follow /clock (said once)',
            seconds(at), self._full_name(topic), horizon, seconds(self._run.now))


def judge(scene: Scene, received: InputMessage) -> None:
    """Refuse an input that `scene` cannot take; the ValueError says why."""
    target, value = received.target, received.value
    require_target(scene, target)
    _require_frame(scene, target, received.frame_id)
    if isinstance(value, Pull) and value.is_release:
        return
    if not all(math.isfinite(number) for part in value for number in part.tolist()):
        raise ValueError(f'it is not finite ({_amounts(value)})')
    if not _rate(scene, received) <= _LARGEST_RATE:
        if isinstance(target, (DriveTarget, PullTarget)):
            raise ValueError(f'it is too fast to follow ({_amounts(value)})')
        raise ValueError(
            f'it is too large to follow ({_amounts(value)} on bodies of '
            f'{_lightest(scene, target)[0]:.3g} kg)')


def _require_frame(scene: Scene, target: Target, frame_id: str) -> None:
    world, rule = scene.parameters['frame_id'], 'a drive moves in the world'
    if isinstance(target, ChannelTarget):
        in_body_axes = scene.loads[target.name].in_body_axes
        rule = f'{target}.frame is {"body" if in_body_axes else "world"}'
        world = ANY_BODY if in_body_axes else world
    elif not isinstance(target, DriveTarget):
        return  # the frame names the body, that of a wrench or of a pull
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
    """How fast [1/s] an input alone would move a body by its size, or turn it."""
    target = received.target
    if isinstance(target, PullTarget):
        return 0.0  # its force is capped
    straight, turning = (math.hypot(*part.tolist()) for part in received.value)
    size = scene.geometry.cube_width
    if isinstance(target, DriveTarget):
        return straight / size + turning
    if isinstance(target, ChannelTarget):
        channel = scene.loads[target.name]
        turning += math.hypot(*channel.point) * straight
        if channel.total:
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
