# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Metadata of a bag: version 9 is written, as in Jazzy; older versions are read too."""
from __future__ import annotations

from collections.abc import Sequence
import os
from pathlib import Path, PurePath
from typing import Any, NamedTuple

from icofabric_sim.bag.folder import BagError
from icofabric_sim.bag.storage import (
    from_yaml,
    parse_qualities_of_service,
    qos_entries,
    STORAGES,
    Tally,
    to_yaml,
    TopicEntry,
)
from rosbags.interfaces import Qos

FILE_NAME = 'metadata.yaml'
_VERSION = 9
_ROOT = 'rosbag2_bagfile_information'


def distribution() -> str:
    """Return the name of the ROS distribution that is recorded in a bag."""
    return os.environ.get('ROS_DISTRO') or 'jazzy'


def describe_bag(
    storage: str, compression: str, files: Sequence[tuple[str, Tally]],
    topics: Sequence[TopicEntry], custom: dict[str, str],
) -> dict[str, Any]:
    """Return the metadata of a bag with `files`, names and contents in the order of recording."""
    total = Tally()
    for _, tally in files:
        total.merge(tally)
    # In rosbag2, compression means its own wrapping; MCAP chunks record their compression.
    wrapped = compression == 'zstd' and storage == 'sqlite3'
    return {
        'version': _VERSION,
        'storage_identifier': storage,
        'duration': {'nanoseconds': total.duration},
        'starting_time': {'nanoseconds_since_epoch': total.first},
        'message_count': total.message_count,
        'topics_with_message_count': [{
            'topic_metadata': {
                'name': topic.name,
                'type': topic.type_name,
                'serialization_format': 'cdr',
                'offered_qos_profiles': qos_entries(topic.qos),
                'type_description_hash': topic.definition.digest,
            },
            'message_count': total.counts.get(topic.name, 0),
        } for topic in topics],
        'compression_format': 'zstd' if wrapped else '',
        'compression_mode': 'MESSAGE' if wrapped else '',
        'relative_file_paths': [name for name, _ in files],
        'files': [{
            'path': name,
            'starting_time': {'nanoseconds_since_epoch': tally.first},
            'duration': {'nanoseconds': tally.duration},
            'message_count': tally.message_count,
        } for name, tally in files],
        'custom_data': custom or None,
        'ros_distro': distribution(),
    }


def write_metadata(folder: Path, described: dict[str, Any]) -> None:
    """Write the metadata into the folder of a bag atomically."""
    temporary = folder / f'{FILE_NAME}.tmp'
    temporary.write_text(to_yaml({_ROOT: described}), 'utf-8')
    temporary.replace(folder / FILE_NAME)


class MetadataTopic(NamedTuple):
    """Topic as described in the metadata."""

    name: str
    type_name: str
    message_count: int
    digest: str
    qos: list[Qos]


class MetadataFile(NamedTuple):
    """File of a bag, with the times of its first and last message [ns] if known."""

    path: Path
    first: int | None
    last: int | None


class Metadata(NamedTuple):
    """Contents of the metadata of a bag."""

    topics: list[MetadataTopic]
    files: list[MetadataFile]
    message_count: int
    first: int
    last: int
    compression_mode: str  # '', 'message' or 'file'
    custom: dict[str, str]


def read_metadata(folder: Path) -> Metadata:
    """Read the metadata of a bag; raise BagError if they are invalid."""
    path = folder / FILE_NAME
    try:
        root = from_yaml(path.read_bytes())
        return _parse(folder, root[_ROOT])
    except BagError:
        raise
    except OSError as error:
        raise BagError(f'cannot read {path}: {error.strerror}') from error
    except Exception as error:  # of YAML, or of a malformed tree
        raise BagError(f'cannot read {path} as the metadata of a bag: {error!r}') from error


def _parse(folder: Path, stored: dict[str, Any]) -> Metadata:
    version = int(stored['version'])
    if version > _VERSION:
        raise BagError(
            f'cannot read {folder}: its metadata version {version} is newer than the newest '
            f'supported version, {_VERSION}')
    if stored['storage_identifier'] not in STORAGES:
        raise BagError(
            f'cannot read {folder}: storage {stored["storage_identifier"]!r} is not one of '
            f'{", ".join(STORAGES)}')
    mode = str(stored.get('compression_mode') or '').lower()
    if mode == 'none':
        mode = ''
    if mode and stored.get('compression_format') != 'zstd':
        raise BagError(
            f'cannot read {folder}: compression {stored.get("compression_format")!r} is not zstd')
    topics = []
    for entry in stored['topics_with_message_count']:
        topic = entry['topic_metadata']
        if topic['serialization_format'] != 'cdr':
            raise BagError(f'cannot read {folder}: {topic["name"]} is '
                           f'{topic["serialization_format"]!r}, not cdr')
        topics.append(MetadataTopic(
            str(topic['name']), str(topic['type']), int(entry['message_count']),
            str(topic.get('type_description_hash') or ''),
            parse_qualities_of_service(topic.get('offered_qos_profiles'))))
    count = int(stored['message_count'])
    first = int(stored['starting_time']['nanoseconds_since_epoch'])
    custom = stored.get('custom_data') or {}
    return Metadata(
        topics, _files(folder, stored), count, first if count else 0,
        first + int(stored['duration']['nanoseconds']) if count else 0, mode,
        # The text of a nested tree could exceed the memory.
        {str(key): str(value) for key, value in custom.items()
         if isinstance(value, str | int | float)})


def _files(folder: Path, stored: dict[str, Any]) -> list[MetadataFile]:
    spans = {}
    for entry in stored.get('files') or []:
        if entry['message_count']:
            first = int(entry['starting_time']['nanoseconds_since_epoch'])
            last = first + int(entry['duration']['nanoseconds'])
            spans[PurePath(entry['path']).name] = first, last
    result = []
    for name in stored['relative_file_paths']:
        # Old versions repeat the folder name; no file may lie outside the folder.
        base = PurePath(name).name
        path = folder / base
        if not path.is_file():
            raise BagError(f'{folder} lacks its file {base}; `icofabric recover {folder}` makes a '
                           'complete bag of the others')
        result.append(MetadataFile(path, *spans.get(base, (None, None))))
    return result
