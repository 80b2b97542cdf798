# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Recorded run of a fabric: scene, poses, markers, inputs and events."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
import json
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from icofabric_sim.bag import BagError, BagReader, BagTopic
from icofabric_sim.messages import (
    decode_float64_multi_array,
    decode_marker_points,
    decode_pose_array,
    decode_string,
    decode_wrench_stamped,
    MarkerAction,
    MarkerPoints,
    PoseArrayBytes,
    StringBytes,
    WrenchStampedBytes,
)
from icofabric_sim.messages.input_topics import target_of
from icofabric_sim.messages.schedule import seconds
from icofabric_sim.parameters.named_files import with_recorded_files
from icofabric_sim.parameters.sections import ParameterSet
from icofabric_sim.parameters.validation import make_parameters, Parameters
from icofabric_sim.process.closing import Closing
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.inputs.input_types import Target
import numpy as np

_Message = TypeVar('_Message')


class PoseFrame(NamedTuple):
    """Poses at one recorded time."""

    nanoseconds: int
    position: np.ndarray  # (n, 3) [m]
    orientation: np.ndarray  # (n, 4) x y z w

    @property
    def time(self) -> float:
        """Return the simulated time [s]."""
        return seconds(self.nanoseconds)


class RecordedInput(NamedTuple):
    """Wrench and the time at which it acted."""

    nanoseconds: int
    topic: str
    frame_id: str
    target: Target | None  # None: a topic unknown to this version
    force: np.ndarray  # (3,) [N]
    torque: np.ndarray  # (3,) [N m]

    @property
    def time(self) -> float:
        """Return the simulated time [s] at which the wrench acted."""
        return seconds(self.nanoseconds)

    @property
    def is_zero(self) -> bool:
        """Return whether the wrench clears its channel."""
        return not (self.force.any() or self.torque.any())


class RecordedEvent(NamedTuple):
    """Operation on the run other than an input, see `Broadcast.event`."""

    nanoseconds: int
    name: str
    facts: Mapping[str, Any]

    @property
    def time(self) -> float:
        """Return the simulated time [s] of the event."""
        return seconds(self.nanoseconds)


class RecordedRun(Closing):
    """Bag of one fabric, open until `close`."""

    def __init__(self, path: str | Path, node: str = '') -> None:
        """
        Open a bag folder or file; raise BagError if it is unreadable.

        `node` is the name of the fabric's node; '': the first one that recorded poses.
        """
        self._reader = BagReader(path)
        self.path = self._reader.path
        # Times of the first and last message [ns].
        self.start, self.end = self._reader.start_time, self._reader.end_time
        self.topics: dict[str, BagTopic] = self._reader.topics
        # All nodes that recorded poses.
        self.nodes = sorted(
            name.removesuffix('/poses')
            for name, topic in self.topics.items()
            if name.endswith('/poses') and topic.type_name == PoseArrayBytes.TYPE
        )
        self.node = node or (self.nodes[0] if self.nodes else '')
        if node and not any(name.startswith(f'{node}/') for name in self.topics):
            self.close()
            raise BagError(
                f'{self.path} contains no topics of {node!r}; its fabrics: '
                f'{", ".join(self.nodes) or "none"}'
            )
        # Custom data of the recorder; with several fabrics each has its own.
        self.custom = (
            self._reader.custom_on(f'{self.node}/recording') if len(self.nodes) > 1 else {}
        ) or self._reader.custom
        self._scenes: dict[int, Scene] = {}

    def pose_times(self) -> np.ndarray:
        """Return the times [ns] of all recorded poses in ascending order."""
        self._require_poses()
        times = (time for _, time, _ in self._reader.messages([f'{self.node}/poses']))
        return np.unique(np.fromiter(times, dtype=np.int64))

    def poses(self, times: Sequence[int] | np.ndarray | None = None) -> Iterator[PoseFrame]:
        """Yield the poses of the given recorded times [ns], by default all, in order of time."""
        self._require_poses()
        wanted = None if times is None else {int(time) for time in times}
        previous = -1
        for _, time, data in self._reader.messages([f'{self.node}/poses']):
            if time == previous or (wanted is not None and time not in wanted):
                continue
            previous = time
            values = np.array(self.decoded(decode_pose_array, data).values)
            yield PoseFrame(time, values[:, :3], values[:, 3:])

    def markers(self, time: int) -> list[MarkerPoints]:
        """Return the connector lists shown at `time` [ns]."""
        shown: dict[int, MarkerPoints] = {}
        for _, _, data in self._reader.messages([f'{self.node}/connectors'], stop=time + 1):
            marker = self.decoded(decode_marker_points, data)
            if marker.action == MarkerAction.DELETEALL:
                shown.clear()
            elif marker.action == MarkerAction.DELETE:
                shown.pop(marker.marker_id, None)
            else:
                shown[marker.marker_id] = marker
        return [shown[number] for number in sorted(shown)]

    def breaks(self) -> list[tuple[int, np.ndarray]]:
        """
        Return the time [ns] and the table (m, 2) of each breakage message.

        The table has a row for each connector broken so far: its number (-1 - k: anchor k) and the
        time of its break [s].
        """
        def pairs(data: bytes) -> np.ndarray:
            return np.array(decode_float64_multi_array(data).values).reshape(-1, 2)

        return [
            (time, self.decoded(pairs, data))
            for _, time, data in self._reader.messages([f'{self.node}/broken'])]

    def inputs(self) -> list[RecordedInput]:
        """Return all received wrenches (not the twists of drives) in the order of action."""
        names = [
            name
            for name, topic in self.topics.items()
            if topic.type_name == WrenchStampedBytes.TYPE and name.startswith(f'{self.node}/')
        ]
        result = []
        for name, time, data in self._reader.messages(names):
            wrench = self.decoded(decode_wrench_stamped, data)
            target = target_of(f'~{name.removeprefix(self.node)}', wrench.frame_id)
            result.append(RecordedInput(
                time, name, wrench.frame_id, target, np.array(wrench.first),
                np.array(wrench.second)))
        return result

    def events(self) -> Iterator[RecordedEvent]:
        """Yield the events of the run in order of time."""
        for _, time, data in self._reader.messages([f'{self.node}/events']):
            yield self.event(time, data)

    def event(self, time: int, data: bytes) -> RecordedEvent:
        """Return the event in a message of `time` [ns]."""
        try:
            facts = json.loads(self.decoded(decode_string, data))
            return RecordedEvent(time, str(facts.pop('event')), facts)
        except (ValueError, KeyError, AttributeError, TypeError) as error:
            raise BagError(
                f'{self.path} contains an invalid event at t = {seconds(time):.9g} s: {error!r}'
            ) from error

    def times_of(self, name: str) -> list[int]:
        """Return the times [ns] of all messages of the private topic `name` ('~/...')."""
        resolved = self.node + name.removeprefix('~')
        return [time for _, time, _ in self._reader.messages([resolved])]

    def messages(
        self, *, start: int | None = None, stop: int | None = None,
        names: Collection[str] | None = None,
    ) -> Iterator[tuple[str, int, bytes]]:
        """
        Yield (topic, time [ns], message) of this fabric, /clock, /diagnostics and /tf.

        Messages with start <= time < stop come in order of time, then of writing. Topics of the
        fabric are named '~/...'; `names` selects topics.
        """
        chosen = {name: f'~{name.removeprefix(self.node)}' for name in self.topics
                  if name.startswith(f'{self.node}/')}
        chosen.update({name: name for name in ('/clock', '/diagnostics', '/tf')})
        wanted = [name for name, own in chosen.items() if names is None or own in names]
        for name, time, data in self._reader.messages(wanted, start=start, stop=stop):
            yield chosen[name], time, data

    def scene_texts(self) -> list[tuple[int, str]]:
        """Return pairs of start time [ns] and parameter file of each scene; mostly one pair."""
        name = f'{self.node}/weave'
        texts = []
        if name in self.topics and self.topics[name].type_name == StringBytes.TYPE:
            texts = [
                (time, self.decoded(decode_string, data))
                for _, time, data in self._reader.messages([name])
            ]
        if not texts and self.custom.get('scene'):
            texts = [(self.start, self.custom['scene'])]
        return texts

    def scene_at(self, time: int) -> Scene:
        """Return the scene in force at `time` [ns]; raise BagError if the bag has none."""
        number, text = self._text_at(time)
        if number not in self._scenes:
            self._scenes[number] = self.build(self.parameters_of(text))
        return self._scenes[number]

    def parameters_at(self, time: int) -> Parameters:
        """Return the parameters in force at `time` [ns]; raise BagError if the bag has none."""
        return self.parameters_of(self._text_at(time)[1])

    def _text_at(self, time: int) -> tuple[int, str]:
        """Return number and text of the scene in force at `time` [ns]."""
        texts = self.scene_texts()
        if not texts:
            raise BagError(
                f'{self.path} does not contain its scene ({self.node}/weave); only runs that this '
                'simulator recorded can be read as fabrics'
            )
        before = [number for number, (start, _) in enumerate(texts) if start <= time]
        number = before[-1] if before else 0
        return number, texts[number][1]

    def parameters_of(self, text: str) -> Parameters:
        """Return the parameters of a parameter file; raise BagError if they are invalid."""
        parameters = ParameterSet('/icofabric')
        try:
            parameters.add_file(text.encode(), 'its scene')
            return with_recorded_files(make_parameters(parameters.parameters()), text)
        except ValueError as error:
            raise self._unknown_scene(error) from error

    def build(self, parameters: Parameters) -> Scene:
        """Return the scene of recorded parameters; raise BagError if it cannot be built."""
        try:
            return Scene.from_parameters(parameters)
        except ValueError as error:
            raise self._unknown_scene(error) from error

    def close(self) -> None:
        """Close the files."""
        self._reader.close()

    def _unknown_scene(self, error: ValueError) -> BagError:
        return BagError(f'{self.path} contains a scene that this version cannot build: {error}')

    def decoded(self, decode: Callable[[bytes], _Message], data: bytes) -> _Message:
        """Return a message decoded by `decode`; raise BagError if it is malformed."""
        try:
            return decode(data)
        except ValueError as error:
            raise BagError(f'{self.path} contains a malformed message: {error}') from error

    def _require_poses(self) -> None:
        if f'{self.node}/poses' not in self.topics:
            raise BagError(
                f'{self.path} contains no poses (a geometry_msgs/PoseArray on .../poses); its '
                f'topics: {", ".join(sorted(self.topics)) or "none"}'
            )


def active_inputs(inputs: Sequence[RecordedInput], time: int) -> list[RecordedInput]:
    """
    Return the active wrench of each channel at `time` [ns], without zero ones.

    Hold times are ignored.
    """
    # Wrenches on single bodies share a topic and differ in their frame.
    latest = {
        (entry.topic, entry.frame_id): entry for entry in inputs if entry.nanoseconds <= time}
    return [entry for entry in latest.values() if not entry.is_zero]
