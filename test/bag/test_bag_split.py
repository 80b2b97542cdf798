# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Bags of several files and compressed ones: as rosbag2 lays them out, and read by others too."""
from __future__ import annotations

import json
from pathlib import Path
import subprocess
import sys
import tracemalloc

from icofabric_sim import messages
from icofabric_sim.bag import BagError, BagReader, BagRecorder, recover_bag
from icofabric_sim.messages import ClockBytes, PoseArrayBytes, StringBytes
import numpy as np
import pytest
from rosbags.rosbag2 import Reader
import yaml

STORAGES = pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
COMPRESSIONS = pytest.mark.parametrize('compression', ['none', 'zstd'])
CUSTOM = {'scene': 'first', 'version': '1'}
Record = tuple[str, int, bytes]


def make_records(count: int = 60, bodies: int = 100) -> list[Record]:
    """Poses every 0.1 s, which zstd can compress, and two messages for each time."""
    poses = PoseArrayBytes('world', bodies)
    records: list[Record] = [('/weave', 0, StringBytes('size: [3, 3, 3]').to_bytes())]
    for index in range(count):
        poses.values[:] = index
        moment = index * 100_000_000
        records.append(('/clock', moment, ClockBytes().stamped(moment)))
        records.append(('/poses', moment, poses.stamped(moment)))
    return records


def record(path: Path, records: list[Record], **options: object) -> None:
    with BagRecorder(path, custom=CUSTOM, **options) as recorder:  # type: ignore[arg-type]
        recorder.add_topic('/weave', StringBytes.TYPE, latched=True)
        recorder.add_topic('/poses', PoseArrayBytes.TYPE)
        recorder.add_topic('/clock', ClockBytes.TYPE)
        for item in records:
            assert recorder.write(*item)
    assert recorder.error is None


def metadata_of(path: Path) -> dict:
    return yaml.safe_load((path / 'metadata.yaml').read_text())['rosbag2_bagfile_information']


def without_custom(reader: BagReader) -> list[Record]:
    return [item for item in reader.messages() if item[0] != '/icofabric/recording']


@STORAGES
@COMPRESSIONS
def test_split_by_time(tmp_path: Path, storage: str, compression: str) -> None:
    records = make_records()
    record(tmp_path / 'bag', records, storage=storage, compression=compression,
           split_duration=2.0)
    suffix = '.mcap' if storage == 'mcap' else '.db3'
    names = [f'bag_{number}{suffix}' for number in range(3)]
    assert sorted(item.name for item in (tmp_path / 'bag').iterdir()) == [*names, 'metadata.yaml']
    with BagReader(tmp_path / 'bag') as reader:
        assert without_custom(reader) == records
        assert reader.custom == CUSTOM
        for start, stop in ((0, 1), (2_000_000_000, 2_100_000_001), (3_950_000_000, 10**12)):
            assert [item for item in reader.messages(start=start, stop=stop)
                    if item[0] != '/icofabric/recording'] == [
                        item for item in records if start <= item[1] < stop]
    # Each by itself; a message more than 2 s after the first of its file is in the next one.
    begins = []
    for number, name in enumerate(names):
        with BagReader(tmp_path / 'bag' / name) as part:
            first, *rest = part.messages()
            said = json.loads(messages.decode_string(first[2]))
            assert first[0] == '/icofabric/recording' and rest[0][1] == first[1]
            follows = {} if number == 2 else {'continued_in': f'bag_{number + 1}{suffix}'}
            if follows:
                last = rest.pop()
                assert json.loads(messages.decode_string(last[2])) == follows
                assert last[:2] == ('/icofabric/recording', part.end_time)
            assert said == ({**CUSTOM, 'part': str(number), 'repeated': '{"/weave": 1}'}
                            if number else CUSTOM)
            assert part.custom == {**said, **follows}
            # The latched message is repeated, after the heading.
            repeated = [('/weave', first[1], records[0][2])] if number else []
            assert rest == [*repeated, *(
                item for item in records if part.start_time <= item[1] <= part.end_time)]
            assert set(part.topics) == {'/icofabric/recording', '/weave', '/poses', '/clock'}
            assert part.topics['/weave'].latched
            assert part.topics['/weave'].message_count == 1
            begins.append((part.start_time, part.end_time))
    assert begins == [(0, 2_000_000_000), (2_100_000_000, 4_100_000_000),
                      (4_200_000_000, 5_900_000_000)]


@STORAGES
@COMPRESSIONS
def test_metadata_and_readers_of_others(tmp_path: Path, storage: str, compression: str) -> None:
    records = make_records()
    record(tmp_path / 'bag', records, storage=storage, compression=compression,
           split_duration=2.0)
    information = metadata_of(tmp_path / 'bag')
    files = information['files']
    assert [item['path'] for item in files] == information['relative_file_paths']
    assert len(files) == 3
    count = len(records) + 7  # three headings, two ends, two repetitions
    assert information['message_count'] == count == sum(item['message_count'] for item in files)
    assert count == sum(
        item['message_count'] for item in information['topics_with_message_count'])
    for item in files:
        with BagReader(tmp_path / 'bag' / item['path']) as part:
            assert part.message_count == item['message_count']
            assert item['starting_time'] == {'nanoseconds_since_epoch': part.start_time}
            assert item['duration'] == {'nanoseconds': part.end_time - part.start_time}
    assert information['starting_time'] == {'nanoseconds_since_epoch': 0}
    assert information['duration'] == {'nanoseconds': 5_900_000_000}
    # rosbag2 wraps messages of SQLite only; chunks of MCAP are compressed within the file.
    wrapped = compression == 'zstd' and storage == 'sqlite3'
    assert information['compression_mode'] == ('MESSAGE' if wrapped else '')
    assert information['compression_format'] == ('zstd' if wrapped else '')
    with Reader(tmp_path / 'bag') as other:
        found = [(connection.topic, time, bytes(data))
                 for connection, time, data in other.messages()
                 if connection.topic != '/icofabric/recording']
        repeated = [('/weave', moment, records[0][2])
                    for moment in (2_100_000_000, 4_200_000_000)]
        assert sorted(found) == sorted([*records, *repeated])
        assert {item.topic: item.digest for item in other.connections}['/clock'] == (
            'RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564')


@COMPRESSIONS
def test_independent_mcap_reader_reads_each_file(tmp_path: Path, compression: str) -> None:
    from mcap.reader import make_reader
    from mcap.stream_reader import StreamReader
    records = make_records(bodies=2000)
    record(tmp_path / 'bag', records, compression=compression, split_size=2_000_000)
    found = []
    paths = sorted((tmp_path / 'bag').glob('*.mcap'))
    assert len(paths) >= (3 if compression == 'none' else 1)
    for path in paths:
        with path.open('rb') as file:
            # Checks the sums over chunks and over the summary.
            kinds = [type(item).__name__ for item in
                     StreamReader(file, validate_crcs=True, emit_chunks=True).records]
            assert kinds[0] == 'Header' and kinds[-1] == 'Footer'
            assert kinds.count('Chunk') == kinds.count('ChunkIndex') > 0
            file.seek(0)
            reader = make_reader(file, validate_crcs=True)
            summary = reader.get_summary()
            assert summary is not None
            assert {index.compression for index in summary.chunk_indexes} == {
                'zstd' if compression == 'zstd' else ''}
            for channel in summary.channels.values():
                assert set(channel.metadata) == {'offered_qos_profiles', 'topic_type_hash'}
                assert channel.metadata['topic_type_hash'].startswith('RIHS01_')
                assert yaml.safe_load(channel.metadata['offered_qos_profiles'])[0]['depth'] > 0
            # At the start, in case it is killed, and at the end with all that is known.
            stored = [yaml.safe_load(item.metadata['serialized_metadata'])
                      for item in reader.iter_metadata() if item.name == 'rosbag2']
            assert [item['message_count'] > 0 for item in stored] == [False, True]
            for _, channel, message in reader.iter_messages():
                if channel.topic != '/icofabric/recording':
                    found.append((channel.topic, message.log_time, message.data))
    repeated = [item for item in found if item[0] == '/weave'][1:]
    assert [data for *_, data in repeated] == (len(paths) - 1) * [records[0][2]]
    assert [item for item in found if item not in repeated] == records


@STORAGES
@COMPRESSIONS
def test_split_by_size(tmp_path: Path, storage: str, compression: str) -> None:
    generator = np.random.default_rng(5)
    # A third of each message can be compressed.
    records = [('/poses', moment, b'\0\1\0\0' + generator.bytes(20_000) + bytes(10_000))
               for moment in range(200)]
    limit = 400_000
    record(tmp_path / 'bag', records, storage=storage, split_size=limit, compression=compression,
           flush_interval=0.001)
    sizes = [(tmp_path / 'bag' / name).stat().st_size
             for name in metadata_of(tmp_path / 'bag')['relative_file_paths']]
    assert len(sizes) > 3
    # A file is a message larger at most, or a chunk, beside its definitions and index.
    chunk = 2**20 if compression == 'zstd' and storage == 'mcap' else 0
    assert all(limit <= size < limit + 100_000 + chunk for size in sizes[:-1])
    with BagReader(tmp_path / 'bag') as reader:
        assert without_custom(reader) == records


def test_sizes_that_rosbag2_refuses(tmp_path: Path) -> None:
    with pytest.raises(BagError, match='record.split_size: with sqlite3 .* at least 86016 bytes'):
        BagRecorder(tmp_path / 'bag', storage='sqlite3', split_size=2000)
    with pytest.raises(BagError, match="record.compression: 'lz4' is not one of none, zstd"):
        BagRecorder(tmp_path / 'bag', compression='lz4')
    for options in ({'split_size': -1}, {'split_duration': -1.0},
                    {'split_duration': float('nan')}):
        with pytest.raises(ValueError, match='must not be negative'):
            BagRecorder(tmp_path / 'bag', **options)
    assert not (tmp_path / 'bag').exists()


@STORAGES
def test_compression_makes_it_smaller(tmp_path: Path, storage: str) -> None:
    records = make_records(bodies=1000)
    sizes = {}
    for compression in ('none', 'zstd'):
        record(tmp_path / compression, records, storage=storage, compression=compression)
        sizes[compression] = sum(
            item.stat().st_size for item in (tmp_path / compression).iterdir())
    assert sizes['zstd'] < 0.2 * sizes['none']


def test_later_files_say_what_holds_there(tmp_path: Path) -> None:
    with BagRecorder(tmp_path / 'bag', custom=CUSTOM, split_duration=1.0) as recorder:
        recorder.add_topic('/clock', ClockBytes.TYPE)
        for second in range(8):
            if second == 3:
                recorder.set_heading('scene', 'second')
            if second == 6:
                recorder.set_custom('version', '2')
            recorder.write('/clock', second * 10**9, ClockBytes().stamped(0))
    scenes = []
    for number in range(4):
        with BagReader(tmp_path / 'bag' / f'bag_{number}.mcap') as part:
            scenes.append((part.custom['scene'], part.custom['version']))
    # What is set at 6 s is written at once, in the file of the last message before.
    assert scenes == [('first', '1'), ('first', '1'), ('second', '2'), ('second', '2')]
    # Of the whole bag, what holds at its start, and what was set later.
    whole = {'scene': 'first', 'version': '2'}
    with BagReader(tmp_path / 'bag') as reader:
        assert reader.custom == whole
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    assert recover_bag(tmp_path / 'bag', tmp_path / 'again').custom == whole


@STORAGES
def test_each_file_begins_with_the_latched_state(tmp_path: Path, storage: str) -> None:
    records = [('/bodies', 0, b'bodies'), ('/weave', 0, b'first'), ('/clock', 0, b'0'),
               ('/clock', 2, b'2'), ('/weave', 2, b'second'), ('/weave', 3, b'third'),
               ('/clock', 4, b'4'), ('/weave', 6, b'third'), ('/clock', 6, b'6')]
    with BagRecorder(
            tmp_path / 'bag', custom=CUSTOM, storage=storage, split_duration=1e-9) as recorder:
        recorder.add_topic('/bodies', StringBytes.TYPE, latched=True)
        recorder.add_topic('/weave', StringBytes.TYPE, latched=True, depth=2)
        recorder.add_topic('/clock', ClockBytes.TYPE)
        for item in records:
            assert recorder.write(*item)
    assert recorder.statistics.written == 1 + len(records)
    files = [tmp_path / 'bag' / name
             for name in metadata_of(tmp_path / 'bag')['relative_file_paths']]
    begins = []
    for file in files:
        with BagReader(file) as part:
            begins.append([data for _, time, data in part.messages(['/bodies', '/weave'])
                           if time == part.start_time])
    assert begins == [
        [b'bodies', b'first'], [b'bodies', b'first', b'second'],
        [b'bodies', b'second', b'third'], [b'bodies', b'second', b'third', b'third']]
    for path in (tmp_path / 'bag', recover_bag(tmp_path / 'bag', tmp_path / 'again').path):
        with BagReader(path) as reader:
            assert without_custom(reader) == records
            assert list(reader.messages(['/weave'], start=4)) == [records[7]]
            assert reader.topics['/weave'].message_count == 9
    # After a file that is lost the state is news.
    files[1].unlink()
    with BagReader(recover_bag(tmp_path / 'bag', tmp_path / 'lacking').path) as reader:
        assert list(reader.messages(['/weave'])) == [
            records[1], ('/weave', 4, b'second'), ('/weave', 4, b'third'), records[7]]


@STORAGES
def test_more_files_than_may_be_open(tmp_path: Path, storage: str) -> None:
    record(tmp_path / 'bag', make_records(200, bodies=3), storage=storage, split_duration=0.1)
    assert len(metadata_of(tmp_path / 'bag')['files']) == 100
    script = """
import resource, sys
from icofabric_sim.bag import BagReader
resource.setrlimit(resource.RLIMIT_NOFILE, (40, 40))
with BagReader(sys.argv[1]) as reader:
    one, other = reader.messages(['/clock']), reader.messages(['/poses'])
    pairs = [(a[1], b[1]) for a, b in zip(one, other)]
assert len(pairs) == 200 and all(a == b for a, b in pairs)
print(pairs[-1][0])
"""
    done = subprocess.run(
        [sys.executable, '-c', script, str(tmp_path / 'bag')], text=True, capture_output=True,
        timeout=120)
    assert done.stdout.strip() == '19900000000', done.stderr


@STORAGES
@COMPRESSIONS
def test_a_bag_is_read_in_bounded_memory(
    tmp_path: Path, storage: str, compression: str,
) -> None:
    record(tmp_path / 'bag', make_records(400, bodies=3000), storage=storage,
           compression=compression, split_duration=10.0)
    total = 400 * 3000 * 56
    tracemalloc.start()
    try:
        with BagReader(tmp_path / 'bag') as reader:
            read = sum(len(data) for _, _, data in reader.messages())
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert read > total
    assert peak < 0.2 * total


def test_files_of_others_may_overlap_in_time(tmp_path: Path) -> None:
    """A recorder of rosbag2 may give a message to the file before its time."""
    times = [[0, 1, 5, 3], [4, 6, 9], [9, 10]]
    with BagRecorder(tmp_path / 'bag', split_duration=1e-9) as recorder:
        recorder.add_topic('/clock', ClockBytes.TYPE)
        for number, moments in enumerate(times):
            for place, moment in enumerate(moments):
                data = b'\0\1\0\0' + bytes([number, place]) + bytes(6)
                recorder.write('/clock', moment, data)
    # Every message has its own file so far; three of them are made by hand.
    bags = []
    for number, moments in enumerate(times):
        with BagRecorder(tmp_path / f'bag_{number}') as recorder:
            recorder.add_topic('/clock', ClockBytes.TYPE)
            for place, moment in enumerate(moments):
                recorder.write(
                    '/clock', moment, b'\0\1\0\0' + bytes([number, place]) + bytes(6))
        bags.append(metadata_of(tmp_path / f'bag_{number}'))
    whole = tmp_path / 'whole'
    whole.mkdir()
    joined = dict(bags[0], relative_file_paths=[], files=[], message_count=9,
                  duration={'nanoseconds': 10})
    joined['topics_with_message_count'][0]['message_count'] = 9
    for number, stored in enumerate(bags):
        (name,) = stored['relative_file_paths']
        (tmp_path / f'bag_{number}' / name).rename(whole / name)
        joined['relative_file_paths'].append(name)
        joined['files'] += stored['files']
    (whole / 'metadata.yaml').write_text(yaml.safe_dump({'rosbag2_bagfile_information': joined}))
    with BagReader(whole) as reader:
        assert [(moment, data[4], data[5]) for _, moment, data in reader.messages()] == [
            (0, 0, 0), (1, 0, 1), (3, 0, 3), (4, 1, 0), (5, 0, 2), (6, 1, 1), (9, 1, 2),
            (9, 2, 0), (10, 2, 1)]
        assert [item[1] for item in reader.messages(start=4, stop=9)] == [4, 5, 6]


def test_bags_that_rosbag2_compressed_as_files(tmp_path: Path) -> None:
    from rosbags.rosbag2 import Writer
    from rosbags.rosbag2.enums import CompressionFormat, CompressionMode, StoragePlugin
    from rosbags.typesys import get_typestore, Stores
    store = get_typestore(Stores.ROS2_JAZZY)
    for plugin in StoragePlugin:
        for mode in (CompressionMode.FILE, CompressionMode.MESSAGE):
            path = tmp_path / f'{plugin.name}_{mode.name}'
            writer = Writer(path, version=8, storage_plugin=plugin)
            writer.set_compression(mode, CompressionFormat.ZSTD)
            with writer:
                clock = writer.add_connection('/clock', ClockBytes.TYPE, typestore=store)
                for moment in range(100):
                    writer.write(clock, moment, ClockBytes().stamped(moment))
            with BagReader(path) as reader:
                assert list(reader.messages(start=90)) == [
                    ('/clock', moment, ClockBytes().stamped(moment))
                    for moment in range(90, 100)]


def test_a_lacking_file_is_named(tmp_path: Path) -> None:
    record(tmp_path / 'bag', make_records(), split_duration=2.0)
    (tmp_path / 'bag' / 'bag_1.mcap').unlink()
    with pytest.raises(BagError, match='lacks its file bag_1.mcap; `icofabric recover'):
        BagReader(tmp_path / 'bag')
    report = recover_bag(tmp_path / 'bag', tmp_path / 'again')
    assert report.end_time == 5_900_000_000
    with BagReader(tmp_path / 'again') as reader:
        times = {item[1] for item in reader.messages(['/clock'])}
    assert {0, 2_000_000_000, 4_200_000_000} <= times and 3_000_000_000 not in times


@STORAGES
def test_splits_and_compression_survive_recovery(tmp_path: Path, storage: str) -> None:
    records = make_records(bodies=1000)
    record(tmp_path / 'bag', records, storage=storage, compression='zstd', split_duration=2.0)
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    report = recover_bag(tmp_path / 'bag', tmp_path / 'again')
    assert report.damage == '' and report.custom == CUSTOM
    with BagReader(tmp_path / 'again') as reader:
        assert without_custom(reader) == records
        assert reader.topics['/weave'].latched
    old, new = ([item.stat().st_size for item in sorted((tmp_path / name).iterdir())
                 if item.suffix != '.yaml'] for name in ('bag', 'again'))
    assert len(old) == len(new) == 3
    assert all(0.5 * before < after < 2 * before for before, after in zip(old, new))


def test_a_closed_reader_says_so(tmp_path: Path) -> None:
    record(tmp_path / 'bag', make_records(3))
    reader = BagReader(tmp_path / 'bag')
    reader.close()
    reader.close()
    with pytest.raises(BagError, match='has been closed'):
        list(reader.messages())
