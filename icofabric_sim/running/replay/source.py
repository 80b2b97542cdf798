# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Data source of a player: the state of one recorded fabric at any time, and later messages.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from icofabric_sim.bag import BagError, BagReader
from icofabric_sim.messages import PoseArrayBytes
from icofabric_sim.messages import topics as outputs
from icofabric_sim.messages.input_topics import input_type
from icofabric_sim.messages.schedule import seconds
from icofabric_sim.messages.topics import Recorded, Topic
from icofabric_sim.process.closing import Closing

_POSES = outputs.POSES.name[1:]
# Events are never repeated at another time.
_EVENTS = (outputs.EVENTS.name[1:], outputs.CHECKPOINT.name[1:])
# Description of a bag; the node publishes no such topic.
_BAG_TOPIC = '/recording'
_WEAVE = outputs.WEAVE.name.removeprefix('~')
# Initial search interval for the last message of each topic [ns], doubled each time.
_INITIAL_SEARCH_NS = 50_000_000
_SMALLEST_DEPTH = 10


class Frame(NamedTuple):
    """All messages of one recorded time [ns], in the order of writing."""

    time: int
    messages: list[tuple[Topic, bytes]]


class ReplaySource(Closing):
    """
    rosbag2 bag, open until `close`; not thread-safe.

    Topics are named as private names: /icofabric/poses is ~/poses.
    """

    def __init__(self, path: str | Path, *, fabric: str = '', inputs: bool = False) -> None:
        """
        Open the bag; raise BagError if it is unreadable.

        `fabric` is the name of the recorded node, ValueError if unknown; '': the first one that
        recorded poses. With `inputs`, received wrenches and twists are played too.
        """
        self._reader = BagReader(path)
        self.path = self._reader.path
        # Times of the first and last message [ns].
        self.start, self.end = self._reader.start_time, self._reader.end_time
        self._unknown: set[str] = set()  # topics that the player cannot publish
        try:
            self.fabrics = self._find_fabrics()
            self.fabric = self._choose(fabric)
            self.topics = self._find_topics(inputs)
        except ValueError:
            self.close()
            raise
        self._lasting = {name for name, topic in self.topics.items() if self.lasts(topic)}

    @property
    def left_out(self) -> list[str]:
        """Return the topics of other nodes."""
        known = {outputs.CLOCK.name, outputs.DIAGNOSTICS.name, *self.topics, *self._unknown}
        return sorted(
            name for name in self._reader.topics
            if name not in known and self._owner(name) != self.fabric
            and not name.endswith(_BAG_TOPIC))

    @property
    def has_poses(self) -> bool:
        """Return whether there are poses to step through."""
        return f'{self.fabric}{_POSES}' in self.topics

    @property
    def lacks(self) -> str:
        """Return a sentence if the scene, which viewer pages need, is missing; otherwise ''."""
        stored = self._reader.topics.get(f'{self.fabric}{_WEAVE}')
        if stored is not None and stored.message_count:
            return ''
        return (f'{self.path} does not contain its scene ({self.fabric}{_WEAVE}), so viewers '
                'cannot draw the fabric; if it is a file of a split bag, use the folder')

    def state_at(self, time: int) -> Frame:
        """
        Return the state at `time` [ns]: of each topic the last messages at or before it.

        Messages of one topic and time belong together, as marker lists do. Inputs and events of
        exactly this time are included.
        """
        latest: dict[str, tuple[int, list[bytes]]] = {}
        missing = {name for name in self._lasting if self._reader.topics[name].message_count}
        stop, reach = time + 1, _INITIAL_SEARCH_NS
        while missing and stop > self.start:
            begin = max(stop - reach, self.start)
            found: dict[str, tuple[int, list[bytes]]] = {}
            for name, when, data in self._reader.messages(missing, start=begin, stop=stop):
                if name in found and found[name][0] == when:
                    found[name][1].append(data)
                else:
                    found[name] = when, [data]
            latest.update(found)
            missing -= found.keys()
            stop, reach = begin, 2 * reach
        # The scene precedes the messages that depend on it.
        order = sorted(latest, key=lambda name: (not self.topics[name].latched, name))
        state = [(self.topics[name], data) for name in order for data in latest[name][1]]
        happening = self.topics.keys() - self._lasting
        state += [(self.topics[name], data) for name, _, data in self._reader.messages(
            happening, start=time, stop=time + 1)]
        return Frame(time, state)

    def frames(self, start: int) -> Iterator[Frame]:
        """Yield the frames from `start` [ns] on, read on demand."""
        frame = Frame(start, [])
        for name, time, data in self._reader.messages(self.topics, start=start):
            if time != frame.time:
                if frame.messages:
                    yield frame
                frame = Frame(time, [])
            frame.messages.append((self.topics[name], data))
        if frame.messages:
            yield frame

    def leave_out(self, name: str) -> None:
        """Skip the topic recorded as `name`, which the player cannot publish."""
        del self.topics[name]
        self._unknown.add(name)
        self._lasting.discard(name)

    def lasts(self, topic: Topic) -> bool:
        """
        Return whether the last message of `topic` holds until the next; inputs and events do not.
        """
        return topic.name.removeprefix('~') not in _EVENTS and not input_type(topic.name)

    def close(self) -> None:
        """Close the files."""
        self._reader.close()

    def _find_fabrics(self) -> list[str]:
        return sorted(
            name.removesuffix(_POSES) for name, topic in self._reader.topics.items()
            if name.endswith(_POSES) and topic.type_name == PoseArrayBytes.TYPE)

    def _choose(self, fabric: str) -> str:
        names = sorted(self._reader.topics)
        if not fabric:
            if not self.fabrics:
                raise BagError(
                    f'{self.path} contains no poses (a geometry_msgs/PoseArray on .../poses) to '
                    'find the name of its fabric; name it with the parameter fabric. Topics: '
                    + (', '.join(names) or 'none'))
            return self.fabrics[0]
        if not any(name.startswith(f'{fabric}/') for name in names):
            known = ', '.join(self.fabrics) or 'none that recorded poses'
            raise ValueError(
                f'fabric: {self.path} contains no topics of {fabric!r}; fabrics in it: {known}')
        return fabric

    def _find_topics(self, inputs: bool) -> dict[str, Topic]:
        topics = {}
        for name, topic in self._reader.topics.items():
            if name == outputs.DIAGNOSTICS.name:
                topics[name] = outputs.DIAGNOSTICS
            # With several fabrics the owner of a frame is unknown.
            if (name == outputs.TF.name and topic.type_name == outputs.TF.type
                    and self.fabrics == [self.fabric]):
                topics[name] = outputs.TF
            # A node may have another node in the namespace of its name.
            if self._owner(name) != self.fabric:
                continue
            private = name.removeprefix(self.fabric)
            if private != _BAG_TOPIC and (inputs or not input_type(f'~{private}')):
                topics[name] = Topic(
                    f'~{private}', topic.type_name, topic.latched,
                    topic.depth or _SMALLEST_DEPTH, Recorded.ALWAYS)
        return topics

    def _owner(self, name: str) -> str:
        owners = [
            node for node in {*self.fabrics, self.fabric} if name.startswith(f'{node}/')]
        return max(owners, key=len, default='')


def describe_time(nanoseconds: int) -> str:
    """Return a recorded time as text."""
    return f't = {seconds(nanoseconds):.9f} s'
