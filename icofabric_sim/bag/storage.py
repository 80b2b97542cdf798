# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Elements of a bag: message types, QoS profiles, custom data."""
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

STORAGES = {'mcap': '.mcap', 'sqlite3': '.db3'}  # with file suffixes
COMPRESSIONS = ('none', 'zstd')

UNKNOWN_HASH = 'RIHS01_' + 64 * '0'

# Value that rosbag2 writes for an unset duration (rmw/time.h, RMW_DURATION_INFINITE).
_INFINITE_DURATION = QosTime(9223372036, 854775807)
# Keys in the custom data of one file of a split bag: its number, except for the first file; the
# number of messages of each latched topic that repeat earlier files, as JSON; and at its end the
# name of the next file.
FILE_INDEX, REPEATED, CONTINUED = 'part', 'repeated', 'continued_in'
# Key of the reason why the recording ended early.
STOPPED = 'recording_stopped'
# zstd level: positions hardly compress, so the fastest level is the best.
ZSTD_LEVEL = 1


class Definition(NamedTuple):
    """Message type as stored in a bag: text and hash (RIHS01, REP 2011)."""

    text: str
    digest: str

    @property
    def encoding(self) -> str:
        """Return the name that rosbag2 gives to the language of the text."""
        return 'ros2idl' if self.text.startswith(_IDL_START) else 'ros2msg'


class StoredTopic(NamedTuple):
    """Topic as stored in a file."""

    name: str
    type_name: str
    definition: str
    profiles: str  # of quality of service
    digest: str  # '' in files of older versions

    @property
    def qos(self) -> list[Qos]:
        """Return the parsed profiles."""
        return parse_qualities_of_service(self.profiles)


class TopicEntry(NamedTuple):
    """Topic of a bag being written."""

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
        """Return the nanoseconds between the first and the last message."""
        return max(0, self.last - self.first)


class StorageFile(Protocol):
    """
    File of a bag being written; all calls from the thread that created it, as SQLite requires.
    """

    path: Path
    tally: Tally  # messages that would be recovered if the process were killed now

    @property
    def size(self) -> int:
        """Return the size in bytes, including queued data if its size is known."""

    def add_topic(self, topic: TopicEntry) -> None:
        """Declare a topic before its first message."""

    def write(self, topic: str, nanoseconds: int, data: bytes) -> None:
        """Append a message."""

    def flush(self) -> None:
        """Pass all written data to the operating system."""

    def roll_back(self) -> None:
        """Drop the data written since the last successful flush."""

    def shorten(self) -> bool:
        """Drop enough of the last messages for `finish` to fit; return False if not possible."""

    def finish(self, metadata: str) -> None:
        """Finish the file with the metadata of its bag, and close it; call after `flush`."""

    def abandon(self) -> None:
        """Close a file that cannot be written any more."""


@functools.cache
def typestore() -> Typestore:
    """Return the message types of ROS 2 Jazzy, loaded on first use."""
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
    """Return the definition of a message type from the text stored in another bag."""
    store = Typestore()
    try:
        if text.startswith(_IDL_START):
            store.register(get_types_from_idl(text))
        else:
            store.register(get_types_from_msg(text, type_name))
        return Definition(text, store.hash_rihs01(type_name))
    except Exception:  # an unreadable definition must not make the messages unreadable
        return Definition(text, UNKNOWN_HASH)


def quality_of_service(*, latched: bool, depth: int) -> Qos:
    """Return the profile of a reliable topic as stored by rosbag2 for players."""
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=depth,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        deadline=_INFINITE_DURATION,
        lifespan=_INFINITE_DURATION,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=_INFINITE_DURATION,
        avoid_ros_namespace_conventions=False)


def qos_entries(profiles: Sequence[Qos]) -> list[dict[str, Any]]:
    """Return profiles as in version 9 of rosbag2's metadata: policies by name."""
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
    """Parse the stored profiles of a topic; return an empty list if they are unreadable."""
    try:
        return parse_qos(stored)
    except Exception:  # any error in foreign data; the messages matter more
        return []


def to_yaml(content: Any) -> str:
    """Return YAML that all readers of rosbag2 accept."""
    dumper = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)
    text: str = yaml.dump(
        content, Dumper=dumper, sort_keys=False, allow_unicode=True, default_flow_style=False)
    return text


def from_yaml(text: str | bytes) -> Any:
    """Parse YAML into plain objects only."""
    return yaml.load(text, Loader=getattr(yaml, 'CSafeLoader', yaml.SafeLoader))


def encode_custom(custom: dict[str, str]) -> bytes:
    """Return custom data as a JSON message."""
    return StringBytes(json.dumps(custom, ensure_ascii=False)).to_bytes()


def decode_custom(type_name: str, data: bytes) -> dict[str, str] | None:
    """Return the custom data in a message, or None for other messages."""
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
    Merge the custom data in the messages of one topic; later values take precedence.

    Custom data at the start of a further file repeat known values and add those of the file. The
    last file of a bag has no next one.
    """
    custom = dict(known or {})
    for type_name, data in messages:
        said = decode_custom(type_name, data) or {}
        if custom and FILE_INDEX in said:
            custom.pop(CONTINUED, None)
        else:
            custom.update(said)
    return custom
