# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
One bag being written: the only place that knows how rosbags does it.

A bag written through `with rosbags.rosbag2.Writer(...)` is thrown away by any exception, and one
that is killed loses what the writer still held. So it is opened and closed by hand here, and
`BagFile.flush` brings what was written to the file, which rosbags itself does only after 1 MiB.
"""
from __future__ import annotations

from collections.abc import Sequence
import contextlib
import functools
import json
import os
from pathlib import Path
from typing import NamedTuple

from icofabric_sim.messages import decode_string, StringBytes
from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.metadata import parse_qos
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer
from rosbags.typesys import get_types_from_idl, get_types_from_msg, get_typestore, Stores
from rosbags.typesys.store import Typestore

STORAGES = {'mcap': StoragePlugin.MCAP, 'sqlite3': StoragePlugin.SQLITE3}

UNKNOWN_HASH = 'RIHS01_' + 64 * '0'

# What rosbag2 writes for a duration that was never set (rmw/time.h, RMW_DURATION_INFINITE).
_NO_LIMIT = QosTime(9223372036, 854775807)


class BagError(ValueError):
    """
    A bag that cannot be written or read; the text says why, and the way out.
    """


class Definition(NamedTuple):
    """
    A message type as a bag stores it: its text, and its hash (RIHS01, REP 2011).
    """

    text: str
    digest: str


@functools.cache
def typestore() -> Typestore:
    """
    Return the message types of ROS 2 Jazzy, loaded when first needed.
    """
    return get_typestore(Stores.ROS2_JAZZY)


@functools.cache
def definition(type_name: str) -> Definition:
    """
    Return the definition of a message type of ROS 2 Jazzy.
    """
    store = typestore()
    if type_name not in store.fielddefs:
        raise ValueError(f'{type_name!r} is not a message type of ROS 2 Jazzy')
    text, _ = store.generate_msgdef(type_name, ros_version=2)
    return Definition(text, store.hash_rihs01(type_name))


def foreign_definition(type_name: str, text: str) -> Definition:
    """
    Return the definition of any message type from the text that another bag holds of it.
    """
    store = Typestore()
    try:
        if text.startswith('=' * 80 + '\nIDL: '):
            store.register(get_types_from_idl(text))
        else:
            store.register(get_types_from_msg(text, type_name))
        return Definition(text, store.hash_rihs01(type_name))
    except Exception:  # an unreadable definition must not cost the messages
        return Definition(text, UNKNOWN_HASH)


def quality_of_service(*, latched: bool, depth: int) -> Qos:
    """
    Return the profile of a reliable topic, as rosbag2 stores it for players to offer again.
    """
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


def parse_qualities_of_service(text: str) -> list[Qos]:
    """
    Read the profiles that a storage file holds of a topic; none where they are unreadable.
    """
    try:
        return parse_qos(text)
    except Exception:  # noqa: BLE001 - whatever a foreign writer left there, messages matter more
        return []


def encode_custom(custom: dict[str, str]) -> bytes:
    """
    Write custom data as a message of JSON.
    """
    return StringBytes(json.dumps(custom, ensure_ascii=False)).to_bytes()


def decode_custom(type_name: str, data: bytes) -> dict[str, str] | None:
    """
    Read custom data from a message; None where it is any other message.
    """
    if type_name != StringBytes.TYPE:
        return None
    try:
        custom = json.loads(decode_string(data))
    except ValueError:
        return None
    if not isinstance(custom, dict) or not all(isinstance(item, str) for item in custom.values()):
        return None
    return custom


def absolute_path(path: str | Path) -> Path:
    """
    Return the path of a bag, wherever the process goes afterwards.
    """
    if not str(path) or '\0' in str(path):
        raise BagError(f'record.path: {str(path)!r} names no folder for the bag')
    return Path(path).expanduser().absolute()


def next_free_path(path: str | Path) -> Path:
    """
    Return the first of PATH, PATH_1, PATH_2 ... that does not exist.
    """
    first = absolute_path(path)
    candidate, number = first, 0
    while os.path.lexists(candidate):
        number += 1
        candidate = first.with_name(f'{first.name}_{number}')
    return candidate


class BagFile:
    """
    One new bag; every call must come from the thread that made it, as SQLite demands.
    """

    def __init__(self, path: Path, storage: str) -> None:
        """
        Make the folder and open the bag in it; refuse to touch what exists.
        """
        if storage not in STORAGES:
            raise BagError(f'record.storage: {storage!r} is not one of {", ".join(STORAGES)}')
        if os.path.lexists(path):
            raise BagError(
                f'record.path: {path} exists and is never overwritten; '
                'choose another folder or remove it')
        self._topics: dict[str, Connection] = {}
        try:
            self._writer = Writer(path, version=9, storage_plugin=STORAGES[storage])
            self._writer.open()
        except Exception as error:  # of the system, of SQLite, of rosbags
            with contextlib.suppress(OSError):
                path.rmdir()  # an empty folder would only be in the way next time
            text = error.strerror if isinstance(error, OSError) else str(error)
            raise BagError(
                f'record.path: cannot write a bag to {path}: {text}; '
                'choose a folder where you may write') from error

    @property
    def survives_kill(self) -> bool:
        """
        Whether what was flushed can be recovered when the process is killed.
        """
        storage = self._writer.storage
        return isinstance(storage, McapWriter) and all(
            hasattr(storage, name) for name in ('chunk', 'close_chunk', 'bio'))

    def add_topic(
        self, topic: str, type_name: str, described: Definition, qos: Sequence[Qos],
    ) -> None:
        self._topics[topic] = self._writer.add_connection(
            topic, type_name, msgdef=described.text, rihs01=described.digest,
            offered_qos_profiles=qos)

    def write(self, topic: str, nanoseconds: int, data: bytes) -> None:
        self._writer.write(self._topics[topic], nanoseconds, data)

    def flush(self) -> None:
        """
        Bring everything written so far to the file.

        rosbags offers no such call, so this reaches into its storage classes; written for 0.11.9,
        which the requirements pin. Should another version name its parts differently, bags are
        written as before, only not flushed, and `survives_kill` says so. A chunk without messages
        is kept back: it would carry the times of none.
        """
        storage = self._writer.storage
        if isinstance(storage, McapWriter):
            if self.survives_kill:
                if storage.chunk.msgs:
                    storage.close_chunk()
                storage.bio.flush()
        elif isinstance(storage, Sqlite3Writer) and hasattr(storage, 'conn'):
            # A full disk then costs the last moments, not the whole bag.
            storage.conn.commit()

    def close(self, custom: dict[str, str]) -> None:
        """
        Finish the bag, with its metadata.
        """
        for key, value in custom.items():
            self._writer.set_custom_data(key, value)
        self._writer.close()

    def abandon(self) -> None:
        """
        Let go of a bag that cannot be written any more.
        """
        with contextlib.suppress(Exception):
            self._writer.abort()
