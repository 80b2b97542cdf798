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
"""What a bag is made of: message types, qualities of service, custom data, folders."""
from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
import functools
import json
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from icofabric_sim.messages import decode_string, StringBytes
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys import get_types_from_idl, get_types_from_msg, get_typestore, Stores
from rosbags.typesys.store import Typestore
import yaml

STORAGES = {'mcap': '.mcap', 'sqlite3': '.db3'}  # and how their files end
COMPRESSIONS = ('none', 'zstd')

UNKNOWN_HASH = 'RIHS01_' + 64 * '0'

# What rosbag2 writes for a duration that was never set (rmw/time.h, RMW_DURATION_INFINITE).
_NO_LIMIT = QosTime(9223372036, 854775807)
# Keys in the custom data of one file of a split bag: its number, but for the first; how many
# messages of each latched topic repeat what earlier files hold, as JSON; and at its end the name
# of the next file.
PART, REPEATED, CONTINUED = 'part', 'repeated', 'continued_in'
# Key under which a bag says why its recording ended early.
STOPPED = 'recording_stopped'
# Level of zstd: the positions of bodies hardly shrink, so the quickest is the best.
ZSTD_LEVEL = 1


class Definition(NamedTuple):
    """A message type as a bag stores it: its text, and its hash (RIHS01, REP 2011)."""

    text: str
    digest: str

    @property
    def encoding(self) -> str:
        """Name that rosbag2 gives to the language of the text."""
        return 'ros2idl' if self.text.startswith(_IDL_START) else 'ros2msg'


class TopicEntry(NamedTuple):
    """A topic of a bag that is being written."""

    name: str
    type_name: str
    definition: Definition
    qos: Sequence[Qos]


@dataclass
class Tally:
    """Number of messages of each topic, and the span of their times [ns]."""

    counts: dict[str, int] = field(default_factory=dict)
    first: int = 2**63 - 1
    last: int = 0

    def add(self, topic: str, nanoseconds: int) -> None:
        self.counts[topic] = self.counts.get(topic, 0) + 1
        self.first = min(self.first, nanoseconds)
        self.last = max(self.last, nanoseconds)

    def merge(self, other: Tally) -> None:
        for topic, count in other.counts.items():
            self.counts[topic] = self.counts.get(topic, 0) + count
        self.first = min(self.first, other.first)
        self.last = max(self.last, other.last)

    @property
    def message_count(self) -> int:
        return sum(self.counts.values())

    @property
    def duration(self) -> int:
        """Nanoseconds between the first and the last message."""
        return max(0, self.last - self.first)


class StorageFile(Protocol):
    """
    One file of a bag being written; all calls from the thread that made it, as SQLite demands.
    """

    path: Path
    tally: Tally  # of what would be recovered if the process were killed now

    @property
    def size(self) -> int:
        """Bytes so far, those that still wait included where it is known how many that will be."""

    def add_topic(self, topic: TopicEntry) -> None:
        """Make a topic known before its first message."""

    def write(self, topic: str, nanoseconds: int, data: bytes) -> None:
        """Append a message."""

    def flush(self) -> None:
        """Give everything written so far to the system."""

    def roll_back(self) -> None:
        """Drop what was written since the last flush that worked."""

    def shorten(self) -> bool:
        """Drop so many of the last messages that `finish` finds room; False: that cannot be."""

    def finish(self, metadata: str) -> None:
        """Make the file whole, with the metadata of its bag, and close it; after `flush`."""

    def abandon(self) -> None:
        """Let go of a file that cannot be written any more."""


@functools.cache
def typestore() -> Typestore:
    """Return the message types of ROS 2 Jazzy, loaded when first needed."""
    return get_typestore(Stores.ROS2_JAZZY)


@functools.cache
def definition(type_name: str) -> Definition:
    """Return the definition of a message type of ROS 2 Jazzy."""
    store = typestore()
    if type_name not in store.fielddefs:
        raise ValueError(f'{type_name!r} is not a message type of ROS 2 Jazzy')
    text, _ = store.generate_msgdef(type_name, ros_version=2)
    return Definition(text, store.hash_rihs01(type_name))


_IDL_START = '=' * 80 + '\nIDL: '


def foreign_definition(type_name: str, text: str) -> Definition:
    """Return the definition of any message type from the text that another bag holds of it."""
    store = Typestore()
    try:
        if text.startswith(_IDL_START):
            store.register(get_types_from_idl(text))
        else:
            store.register(get_types_from_msg(text, type_name))
        return Definition(text, store.hash_rihs01(type_name))
    except Exception:  # an unreadable definition must not cost the messages
        return Definition(text, UNKNOWN_HASH)


def quality_of_service(*, latched: bool, depth: int) -> Qos:
    """Return the profile of a reliable topic, as rosbag2 stores it for players to offer again."""
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=depth,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        deadline=_NO_LIMIT,
        lifespan=_NO_LIMIT,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=_NO_LIMIT,
        avoid_ros_namespace_conventions=False)


def qos_entries(profiles: Sequence[Qos]) -> list[dict[str, Any]]:
    """Lay out profiles as version 9 of rosbag2's metadata has them: policies by their names."""
    def time(value: QosTime) -> dict[str, int]:
        return {'sec': value.sec, 'nsec': value.nsec}

    return [{
        'history': item.history.name.lower(),
        'depth': item.depth,
        'reliability': item.reliability.name.lower(),
        'durability': item.durability.name.lower(),
        'deadline': time(item.deadline),
        'lifespan': time(item.lifespan),
        'liveliness': item.liveliness.name.lower(),
        'liveliness_lease_duration': time(item.liveliness_lease_duration),
        'avoid_ros_namespace_conventions': item.avoid_ros_namespace_conventions,
    } for item in profiles]


def parse_qualities_of_service(stored: Any) -> list[Qos]:
    """Read the profiles that a bag holds of a topic; none where they are unreadable."""
    try:
        return parse_qos(stored)
    except Exception:  # noqa: BLE001 - whatever a foreign writer left there, messages matter more
        return []


def to_yaml(content: Any) -> str:
    """Write YAML that every reader of rosbag2's own takes."""
    dumper = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)
    text: str = yaml.dump(
        content, Dumper=dumper, sort_keys=False, allow_unicode=True, default_flow_style=False)
    return text


def from_yaml(text: str | bytes) -> Any:
    """Read YAML; no object but plain ones is ever made of it."""
    return yaml.load(text, Loader=getattr(yaml, 'CSafeLoader', yaml.SafeLoader))


def encode_custom(custom: dict[str, str]) -> bytes:
    """Write custom data as a message of JSON."""
    return StringBytes(json.dumps(custom, ensure_ascii=False)).to_bytes()


def decode_custom(type_name: str, data: bytes) -> dict[str, str] | None:
    """Read custom data from a message; None where it is any other message."""
    if type_name != StringBytes.TYPE:
        return None
    try:
        custom = json.loads(decode_string(data))
    except (ValueError, RecursionError):
        return None
    if not isinstance(custom, dict) or not all(isinstance(item, str) for item in custom.values()):
        return None
    return custom


def merge_custom(
    messages: Iterable[tuple[str, bytes]], known: dict[str, str] | None = None,
) -> dict[str, str]:
    """
    Put together the custom data that messages of one topic hold, the later over the earlier.

    Those at the begin of a further file repeat what is known, and say what holds there. The last
    file of a bag has no next one.
    """
    custom = dict(known or {})
    for type_name, data in messages:
        said = decode_custom(type_name, data) or {}
        if custom and PART in said:
            custom.pop(CONTINUED, None)
        else:
            custom.update(said)
    return custom
