# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Bags written and read back: by us, by independent readers, and against the rules of rosbag2."""
from __future__ import annotations

from collections.abc import Iterator
import contextlib
import json
import os
from pathlib import Path
import sys
import threading
import time

from icofabric_sim import messages
from icofabric_sim.bag import BagError, BagReader, BagRecorder, next_free_path, recover_bag
from icofabric_sim.bag.bag_file import BagFile
from icofabric_sim.bag.mcap_storage import McapFile
import numpy as np
import pytest
import yaml

STORAGES = pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
TOPICS = {
    '/icofabric/poses': messages.PoseArrayBytes.TYPE,
    '/icofabric/connectors': messages.MarkerBytes.TYPE,
    '/icofabric/state': messages.Float64MultiArrayBytes.TYPE,
    '/icofabric/wrench': messages.WrenchStampedBytes.TYPE,
    '/icofabric/weave': messages.StringBytes.TYPE,
    '/clock': messages.ClockBytes.TYPE,
    '/diagnostics': messages.DiagnosticArrayBytes.TYPE,
}
CUSTOM = {'scene': 'weave:\n  size: [3, 3, 3]\n# ümläut\n', 'version': '0.1.0'}
Record = tuple[str, int, bytes]


def example_messages(count: int = 40) -> list[Record]:
    generator = np.random.default_rng(1)
    poses = messages.PoseArrayBytes('world', 27)
    marker = messages.MarkerBytes('world', 'strain', 0, messages.MarkerType.LINE_LIST)
    state = messages.Float64MultiArrayBytes(['body', 'x y z'], [27, 13])
    wrench = messages.WrenchStampedBytes('icosahedron_3')
    clock, health = messages.ClockBytes(), messages.DiagnosticArrayBytes()
    records = [('/icofabric/weave', 0, messages.StringBytes(CUSTOM['scene']).to_bytes())]
    for index in range(count):
        nanoseconds = round(index * 1e9 / 60)
        poses.values[:] = generator.normal(size=(27, 7))
        marker.point_count = 2 * (index % 5)
        marker.points[:] = generator.normal(size=(marker.point_count, 3))
        state.values[:] = generator.normal(size=(27, 13))
        wrench.force[:] = generator.normal(size=3)
        status = [messages.DiagnosticStatus(messages.OK, '/icofabric', f'step {index}')]
        records += [
            ('/clock', nanoseconds, clock.stamped(nanoseconds)),
            ('/icofabric/wrench', nanoseconds, wrench.stamped(nanoseconds)),
            ('/icofabric/poses', nanoseconds, poses.stamped(nanoseconds)),
            ('/icofabric/connectors', nanoseconds, marker.stamped(nanoseconds)),
            ('/icofabric/state', nanoseconds, state.to_bytes()),
            ('/diagnostics', nanoseconds, health.stamped(nanoseconds, status))]
    return records


def record(path: Path, records: list[Record], **options: object) -> BagRecorder:
    recorder = BagRecorder(path, **options)  # type: ignore[arg-type]
    with recorder:
        for topic, type_name in TOPICS.items():
            recorder.add_topic(topic, type_name, latched=topic.endswith('weave'))
        for topic, nanoseconds, data in records:
            assert recorder.write(topic, nanoseconds, data)
    return recorder


@STORAGES
def test_round_trip(tmp_path: Path, storage: str) -> None:
    records = example_messages()
    recorder = record(tmp_path / 'runs' / 'bag', records, storage=storage, custom=CUSTOM)
    assert recorder.error is None
    statistics = recorder.statistics
    assert statistics.written == len(records) + 1
    assert statistics[2:] == (0, 0, 0, 0, 0.0)
    with BagReader(tmp_path / 'runs' / 'bag') as reader:
        custom, *found = reader.messages()
        assert custom[:2] == ('/icofabric/recording', 0)
        assert json.loads(messages.decode_string(custom[2])) == CUSTOM
        assert found == records
        assert reader.custom == CUSTOM
        assert reader.message_count == len(records) + 1
        assert (reader.start_time, reader.end_time) == (0, records[-1][1])
        for topic, type_name in TOPICS.items():
            entry = reader.topics[topic]
            assert entry.type_name == type_name
            assert entry.message_count == sum(item[0] == topic for item in records) > 0
            assert (entry.latched, entry.depth) == ((True, 1) if 'weave' in topic else (False, 10))
        assert list(reader.messages(['/clock', '/none'])) == [
            item for item in records if item[0] == '/clock']
        assert list(reader.messages(['/none'])) == []
        start, stop = records[60][1], records[90][1]
        assert start < stop
        assert list(reader.messages(start=start, stop=stop)) == [
            item for item in records if start <= item[1] < stop]


@STORAGES
def test_bare_storage_file_is_read(tmp_path: Path, storage: str) -> None:
    records = example_messages(5)
    record(tmp_path / 'bag', records, storage=storage, custom=CUSTOM)
    file = tmp_path / 'bag' / ('bag_0.mcap' if storage == 'mcap' else 'bag_0.db3')
    with BagReader(file) as reader:
        assert reader.custom == CUSTOM
        assert list(reader.messages())[1:] == records


@STORAGES
def test_messages_of_one_time_keep_their_order(tmp_path: Path, storage: str) -> None:
    generator = np.random.default_rng(3)
    names = list(TOPICS)
    times = np.sort(generator.integers(0, 40, 3000))
    # More than one chunk of MCAP (1 MiB), so that ties across chunks occur too.
    records = [
        (names[generator.integers(len(names))], int(moment),
         b'\0\1\0\0' + index.to_bytes(4, 'little') + bytes(1000))
        for index, moment in enumerate(times)]
    record(tmp_path / 'bag', records, storage=storage)
    with BagReader(tmp_path / 'bag') as reader:
        assert list(reader.messages()) == records
        assert list(reader.messages(names[:3])) == [
            item for item in records if item[0] in names[:3]]


@STORAGES
def test_messages_written_out_of_order_are_read_in_order_of_time(
    tmp_path: Path, storage: str,
) -> None:
    records = example_messages(10)
    record(tmp_path / 'bag', records[::-1], storage=storage)
    with BagReader(tmp_path / 'bag') as reader:
        found = list(reader.messages())
    assert [item[1] for item in found] == sorted(item[1] for item in records)
    assert sorted(found) == sorted(records)


def test_independent_mcap_reader_decodes_everything(tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory
    records = example_messages()
    record(tmp_path / 'bag', records, custom=CUSTOM)
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == 'ros2'
        decoded = list(reader.iter_decoded_messages())
        channels = reader.get_summary().channels.values()
    assert len(decoded) == len(records) + 1
    for (topic, nanoseconds, data), (schema, channel, message, ros) in zip(records, decoded[1:]):
        assert (channel.topic, schema.name, message.log_time) == (
            topic, TOPICS[topic], nanoseconds)
        assert (channel.message_encoding, schema.encoding) == ('cdr', 'ros2msg')
        assert message.data == data
        if topic == '/icofabric/poses':
            first = ros.poses[0]
            assert [first.position.x, first.orientation.w] == pytest.approx(
                messages.decode_pose_array(data).values[0, [0, 6]], abs=0)
        elif topic == '/icofabric/connectors':
            assert len(ros.points) == len(messages.decode_marker_points(data).points)
        elif topic == '/diagnostics':
            assert ros.status[0].message.startswith('step')
    profiles = {
        channel.topic: yaml.safe_load(channel.metadata['offered_qos_profiles'])[0]
        for channel in channels}
    assert profiles['/icofabric/weave']['durability'] == 'transient_local'
    assert profiles['/icofabric/poses']['durability'] == 'volatile'
    assert {profile['reliability'] for profile in profiles.values()} == {'reliable'}


@STORAGES
def test_metadata_is_what_rosbag2_expects(tmp_path: Path, storage: str) -> None:
    records = example_messages()
    record(tmp_path / 'bag', records, storage=storage, custom=CUSTOM)
    metadata = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text('utf-8'))
    information = metadata['rosbag2_bagfile_information']
    # The keys of version 9, which Jazzy writes (rosbag2_storage, metadata_io).
    assert set(information) == {
        'version', 'storage_identifier', 'duration', 'starting_time', 'message_count',
        'topics_with_message_count', 'compression_format', 'compression_mode',
        'relative_file_paths', 'files', 'custom_data', 'ros_distro'}
    assert information['version'] == 9
    assert information['storage_identifier'] == storage
    assert information['message_count'] == len(records) + 1
    assert information['starting_time'] == {'nanoseconds_since_epoch': 0}
    assert information['duration'] == {'nanoseconds': records[-1][1]}
    assert information['custom_data'] == CUSTOM
    (file,) = information['relative_file_paths']
    assert (tmp_path / 'bag' / file).is_file()
    for topic in information['topics_with_message_count']:
        entry = topic['topic_metadata']
        assert set(entry) == {
            'name', 'type', 'serialization_format', 'offered_qos_profiles',
            'type_description_hash'}
        (profile,) = entry['offered_qos_profiles']
        assert set(profile) == {
            'history', 'depth', 'reliability', 'durability', 'deadline', 'lifespan',
            'liveliness', 'liveliness_lease_duration', 'avoid_ros_namespace_conventions'}
        assert profile['deadline'] == {'sec': 9223372036, 'nsec': 854775807}


def test_type_hashes_are_those_of_the_installed_messages(tmp_path: Path) -> None:
    places = [Path(item) for item in os.environ.get('AMENT_PREFIX_PATH', '').split(':') if item]
    places.append(Path(sys.prefix))
    if not any((place / 'share/geometry_msgs/msg/PoseArray.json').is_file() for place in places):
        pytest.skip('no ROS message packages with type descriptions are installed here')
    record(tmp_path / 'bag', [])
    with BagReader(tmp_path / 'bag') as reader:
        found = {topic.type_name: topic.type_hash for topic in reader.topics.values()}
    assert set(found) == set(TOPICS.values())
    for type_name, digest in found.items():
        file = next(path for place in places
                    if (path := place / 'share' / f'{type_name}.json').is_file())
        hashes = {item['type_name']: item['hash_string']
                  for item in json.loads(file.read_text())['type_hashes']}
        assert digest == hashes[type_name]


@STORAGES
def test_an_empty_bag_is_whole(tmp_path: Path, storage: str) -> None:
    record(tmp_path / 'bag', [], storage=storage)
    with BagReader(tmp_path / 'bag') as reader:
        assert (reader.message_count, reader.start_time, reader.end_time) == (0, 0, 0)
        assert list(reader.messages()) == [] and reader.custom == {}
        assert len(reader.topics) == len(TOPICS)


def test_custom_data_set_later(tmp_path: Path) -> None:
    with BagRecorder(tmp_path / 'bag', custom=CUSTOM, start=5_000) as recorder:
        recorder.add_topic('/clock', messages.ClockBytes.TYPE)
        recorder.write('/clock', 7_000, messages.ClockBytes().stamped(7_000))
        recorder.set_custom('verdict', 'whole')
        recorder.set_custom('version', '0.2.0')
        with pytest.raises(TypeError, match='custom data must be text'):
            recorder.set_custom('count', 3)  # type: ignore[arg-type]
    expected = {**CUSTOM, 'verdict': 'whole', 'version': '0.2.0'}
    for path in (tmp_path / 'bag', tmp_path / 'bag' / 'bag_0.mcap'):
        with BagReader(path) as reader:
            assert reader.custom == expected
            assert [item[1] for item in reader.messages()] == [5_000, 7_000, 7_000, 7_000]


def test_refused_places(tmp_path: Path) -> None:
    (tmp_path / 'folder').mkdir()
    (tmp_path / 'file').write_text('mine')
    (tmp_path / 'link').symlink_to(tmp_path / 'nowhere')
    for name in ('folder', 'file', 'link'):
        with pytest.raises(BagError, match=f'record.path: .*{name} already exists and will not'):
            BagRecorder(tmp_path / name)
    assert (tmp_path / 'file').read_text() == 'mine'
    with pytest.raises(BagError, match='record.path: cannot write a bag to .*Not a directory'):
        BagRecorder(tmp_path / 'file' / 'bag')
    with pytest.raises(BagError, match='record.path: cannot write a bag to'):
        BagRecorder('/proc/icofabric/bag')  # not even root may
    with pytest.raises(BagError, match='record.path: .*too long'):
        BagRecorder(tmp_path / ('a' * 300))
    for path in ('', 'a\0b'):
        with pytest.raises(BagError, match='record.path: .* is not the name of a folder'):
            BagRecorder(path)
    with pytest.raises(BagError, match="record.storage: 'rosbag' is not one of mcap, sqlite3"):
        BagRecorder(tmp_path / 'bag', storage='rosbag')
    assert sorted(item.name for item in tmp_path.iterdir()) == ['file', 'folder', 'link']


def test_next_free_path(tmp_path: Path) -> None:
    assert next_free_path(tmp_path / 'bag') == tmp_path / 'bag'
    for name in ('bag', 'bag_1', 'bag_3'):
        (tmp_path / name).mkdir()
    (tmp_path / 'bag_2').symlink_to(tmp_path / 'nowhere')
    assert next_free_path(tmp_path / 'bag') == tmp_path / 'bag_4'
    assert next_free_path(str(tmp_path / 'bag_3')) == tmp_path / 'bag_3_1'


def test_wrong_calls(tmp_path: Path) -> None:
    with BagRecorder(tmp_path / 'bag') as recorder:
        with pytest.raises(ValueError, match='/clock must be added before'):
            recorder.write('/clock', 0, b'')
        recorder.add_topic('/clock', messages.ClockBytes.TYPE)
        recorder.add_topic('/clock', messages.ClockBytes.TYPE)
        with pytest.raises(ValueError, match='cannot also be std_msgs/msg/String'):
            recorder.add_topic('/clock', messages.StringBytes.TYPE)
        with pytest.raises(ValueError, match='not a message type'):
            recorder.add_topic('/other', 'std_msgs/msg/Strin')
        with pytest.raises(ValueError, match='depth of /other must be positive'):
            recorder.add_topic('/other', messages.StringBytes.TYPE, depth=0)
        for nanoseconds in (-1, 2**63):
            with pytest.raises(ValueError, match='must lie in 0 to 2'):
                recorder.write('/clock', nanoseconds, b'')
        with pytest.raises(TypeError, match='must be bytes, got bytearray'):
            recorder.write('/clock', 0, bytearray(12))  # type: ignore[arg-type]
        assert recorder.write('/clock', np.int64(1), messages.ClockBytes().stamped(1))
    with BagReader(tmp_path / 'bag') as reader:
        assert reader.message_count == 1
    for options in ({'overflow': 'lose'}, {'queue_bytes': 0}, {'flush_interval': float('nan')}):
        with pytest.raises(ValueError, match='must be'):
            BagRecorder(tmp_path / 'other', **options)
    assert not (tmp_path / 'other').exists()


@STORAGES
def test_an_exception_closes_the_bag_whole(tmp_path: Path, storage: str) -> None:
    records = example_messages(5)
    with pytest.raises(KeyboardInterrupt), BagRecorder(
            tmp_path / 'bag', storage=storage) as recorder:
        for topic, type_name in TOPICS.items():
            recorder.add_topic(topic, type_name)
        for item in records:
            recorder.write(*item)
        raise KeyboardInterrupt
    with BagReader(tmp_path / 'bag') as reader:
        assert list(reader.messages()) == records


def test_after_the_end(tmp_path: Path) -> None:
    recorder = record(tmp_path / 'bag', example_messages(2))
    recorder.close()
    assert recorder.write('/clock', 0, b'') is False
    recorder.add_topic('/later', messages.ClockBytes.TYPE)
    recorder.set_custom('too', 'late')
    assert recorder.statistics.lost == 2 and recorder.error is None


@contextlib.contextmanager
def held_disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """Make every write of a bag wait until the event is set."""
    allowed, write = threading.Event(), BagFile.write

    def slow(file: BagFile, topic: str, nanoseconds: int, data: bytes) -> None:
        assert allowed.wait(60)
        write(file, topic, nanoseconds, data)

    monkeypatch.setattr(BagFile, 'write', slow)
    try:
        yield allowed
    finally:
        allowed.set()


def test_drop_refuses_counts_and_keeps_what_is_essential(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    with held_disk(monkeypatch) as allowed:
        recorder = BagRecorder(tmp_path / 'bag', overflow='drop', queue_bytes=10_000)
        recorder.add_topic('/poses', messages.PoseArrayBytes.TYPE)
        recorder.add_topic('/wrench', messages.WrenchStampedBytes.TYPE)
        kept = [recorder.write('/poses', index, bytes(1000)) for index in range(15)]
        assert kept == [True] * 10 + [False] * 5
        assert all(recorder.write('/wrench', index, bytes(1000), essential=True)
                   for index in range(10))
        statistics = recorder.statistics
        assert (statistics.dropped, statistics.lost, statistics.written) == (5, 0, 0)
        assert (statistics.queued, statistics.queued_bytes) == (20, 20_000)
        assert statistics.lag > 0.0
        assert recorder.error is None
        allowed.set()
        recorder.close()
    with BagReader(tmp_path / 'bag') as reader:
        assert reader.topics['/poses'].message_count == 10
        assert [item[1] for item in reader.messages(['/wrench'])] == list(range(10))
    assert recorder.statistics.lag == 0.0


def test_drop_never_waits_not_even_for_what_is_essential(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A bag without an input could not be repeated; so it ends before, and is whole."""
    errors: list[BagError] = []
    with held_disk(monkeypatch) as allowed:
        recorder = BagRecorder(
            tmp_path / 'bag', overflow='drop', queue_bytes=10_000, on_error=errors.append)
        recorder.add_topic('/wrench', messages.WrenchStampedBytes.TYPE)
        kept = [recorder.write('/wrench', index, bytes(1000), essential=True)
                for index in range(25)]
        assert kept == [True] * 20 + [False] * 5
        assert errors == [recorder.error]
        assert 'the disk is too slow, the queue is full and /wrench' in str(recorder.error)
        allowed.set()
        recorder.close()
    statistics = recorder.statistics
    # One may have been in the writer's hands.
    assert statistics.written in (0, 1) and statistics.lost == 25 - statistics.written
    assert (statistics.queued, statistics.queued_bytes) == (0, 0)
    with BagReader(tmp_path / 'bag') as reader:
        assert [item[1] for item in reader.messages()] == list(range(statistics.written))


def test_wait_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with held_disk(monkeypatch) as allowed:
        recorder = BagRecorder(tmp_path / 'bag', overflow='wait', queue_bytes=10_000)
        recorder.add_topic('/poses', messages.PoseArrayBytes.TYPE)
        # One message larger than the queue passes, when nothing waits before it.
        assert recorder.write('/poses', 0, bytes(50_000))
        accepted: list[bool] = []
        writer = threading.Thread(target=lambda: accepted.extend(
            recorder.write('/poses', index, bytes(3000)) for index in range(1, 200)))
        writer.start()
        writer.join(0.1)
        assert writer.is_alive() and recorder.statistics.queued == 1
        allowed.set()
        writer.join(60)
        recorder.close()
    assert accepted == [True] * 199 and recorder.statistics.dropped == 0
    with BagReader(tmp_path / 'bag') as reader:
        assert [item[1] for item in reader.messages()] == list(range(200))


def test_a_waiting_writer_is_released_by_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    errors: list[BagError] = []
    with held_disk(monkeypatch) as allowed:
        recorder = BagRecorder(tmp_path / 'bag', queue_bytes=1000, on_error=errors.append)
        recorder.add_topic('/poses', messages.PoseArrayBytes.TYPE)
        recorder.write('/poses', 0, bytes(900))
        results: list[bool] = []
        writer = threading.Thread(
            target=lambda: results.append(recorder.write('/poses', 1, bytes(900))))
        writer.start()
        writer.join(0.1)
        assert writer.is_alive()

        def full(*_: object) -> None:
            raise OSError(28, 'No space left on device')

        monkeypatch.setattr(McapFile, 'write', full)
        allowed.set()
        writer.join(60)
        recorder.close()
    assert results == [False] and recorder.statistics.lost == 2
    assert errors == [recorder.error]
    assert 'stopped: No space left on device; make room' in str(recorder.error)


def test_many_threads_write_each_in_its_order(tmp_path: Path) -> None:
    with BagRecorder(tmp_path / 'bag', queue_bytes=5000) as recorder:
        def fill(topic: str) -> None:
            recorder.add_topic(topic, messages.ClockBytes.TYPE)
            for index in range(500):
                recorder.write(topic, 7, b'\0\1\0\0' + index.to_bytes(8, 'little'))

        threads = [threading.Thread(target=fill, args=(f'/t{index}',)) for index in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    with BagReader(tmp_path / 'bag') as reader:
        for topic in ('/t0', '/t1', '/t2', '/t3'):
            found = [int.from_bytes(data[4:], 'little') for *_, data in reader.messages([topic])]
            assert found == list(range(500))


@STORAGES
def test_a_single_message_reaches_the_file_without_another(tmp_path: Path, storage: str) -> None:
    text = 'only this one message ' * 500
    recorder = BagRecorder(tmp_path / 'bag', storage=storage, flush_interval=0.05)
    assert recorder.survives_kill == (storage == 'mcap')
    recorder.add_topic('/text', messages.StringBytes.TYPE)
    recorder.write('/text', 0, messages.StringBytes(text).to_bytes())
    (file,) = (item for item in recorder.path.iterdir() if item.suffix in ('.mcap', '.db3'))
    patience = time.monotonic() + 60
    while text[:2000].encode() not in file.read_bytes() and time.monotonic() < patience:
        time.sleep(0.02)
    assert text[:2000].encode() in file.read_bytes()
    assert not (recorder.path / 'metadata.yaml').exists()
    recorder.close()


def test_unreadable_bags_are_refused_with_the_reason(tmp_path: Path) -> None:
    def refusal(path: Path) -> str:
        with pytest.raises(BagError) as caught:
            BagReader(path)
        return str(caught.value)

    assert 'does not exist' in refusal(tmp_path / 'nothing')
    (tmp_path / 'empty').mkdir()
    assert 'is not a bag: it must be a folder' in refusal(tmp_path / 'empty')
    (tmp_path / 'notes.txt').write_text('hello')
    assert 'is not a bag: it must be a folder' in refusal(tmp_path / 'notes.txt')
    for name, kind in (('a.mcap', 'MCAP'), ('a.db3', 'SQLite')):
        (tmp_path / name).write_bytes(b'something else entirely')
        assert f'it has no {kind} header' in refusal(tmp_path / name)
    record(tmp_path / 'bag', example_messages(3))
    metadata = tmp_path / 'bag' / 'metadata.yaml'
    text = metadata.read_text()
    metadata.write_text(text.replace('version: 9', 'version: 10'))
    assert 'cannot read' in refusal(tmp_path / 'bag') and '10' in refusal(tmp_path / 'bag')
    metadata.write_text('[')
    assert 'cannot read' in refusal(tmp_path / 'bag')
    metadata.write_text('- 1')
    assert 'cannot read' in refusal(tmp_path / 'bag')
    metadata.unlink()
    assert 'was not finished' in refusal(tmp_path / 'bag')
    assert f'`icofabric recover {tmp_path / "bag"}`' in refusal(tmp_path / 'bag')


def test_a_damaged_chunk_is_a_clear_error(tmp_path: Path) -> None:
    record(tmp_path / 'bag', example_messages(3))
    file = tmp_path / 'bag' / 'bag_0.mcap'
    data = bytearray(file.read_bytes())
    place = data.index(messages.PoseArrayBytes.TYPE.encode())  # in the first schema of the chunk
    data[place - 14:place - 6] = b'\xff' * 8
    file.write_bytes(data)
    with BagReader(tmp_path / 'bag') as reader, pytest.raises(BagError, match='is damaged'):
        list(reader.messages())


def test_hostile_metadata_are_refused_or_harmless(tmp_path: Path) -> None:
    record(tmp_path / 'bag', example_messages(2), custom=CUSTOM)
    file = tmp_path / 'bag' / 'metadata.yaml'
    whole = yaml.safe_load(file.read_text('utf-8'))

    def read(**changes: object) -> BagReader:
        file.write_text(yaml.safe_dump({'rosbag2_bagfile_information': {
            **whole['rosbag2_bagfile_information'], **changes}}))
        return BagReader(tmp_path / 'bag')

    for changes in (
        {'version': 'nine'}, {'message_count': []}, {'starting_time': 3}, {'duration': {}},
        {'topics_with_message_count': [1]}, {'topics_with_message_count': {'a': 'b'}},
        {'relative_file_paths': 7}, {'relative_file_paths': ['/etc/passwd']},
        {'relative_file_paths': ['../bag/metadata']}, {'files': [{'path': 3}]},
        {'storage_identifier': []}, {'compression_mode': 'message', 'compression_format': 'xz'},
        {'custom_data': [1, 2]},
    ):
        with pytest.raises(BagError):
            read(**changes).close()
    # A tree that is larger than any memory once it is written out.
    text = 'a0: &a0 [x, x]\n' + ''.join(
        f'a{k + 1}: &a{k + 1} [*a{k}, *a{k}]\n' for k in range(60))
    bomb = yaml.safe_load(text)
    with read(custom_data={'scene': 'mine', 'bomb': bomb['a60']}) as reader:
        assert reader.custom == {'scene': 'mine'}
        assert len(list(reader.messages())) == 14
    for content in (
        '!!python/object/apply:os.system ["touch stolen"]', 'a: [', '', '- 1', '\0', 60 * '[',
    ):
        file.write_text(content)
        with pytest.raises(BagError, match='cannot read .*metadata.yaml'):
            BagReader(tmp_path / 'bag')


def test_random_damage_is_an_error_and_nothing_else(tmp_path: Path) -> None:
    generator = np.random.default_rng(11)
    for storage, name in (('mcap', 'bag_0.mcap'), ('sqlite3', 'bag_0.db3')):
        path = tmp_path / storage / 'bag'
        record(path, example_messages(5), storage=storage, custom=CUSTOM)
        whole = (path / name).read_bytes()
        refused = 0
        for number in range(30):
            data = bytearray(whole)
            for place in generator.integers(0, len(data), 1 + number % 5):
                data[place] = generator.integers(256)
            target = tmp_path / name
            target.write_bytes(data)
            try:
                with BagReader(target) as reader:
                    for _ in reader.messages():
                        pass
                    assert isinstance(reader.custom, dict)
            except BagError:
                refused += 1
            destination = tmp_path / f'{storage}_{number}'
            with contextlib.suppress(BagError):
                recover_bag(target, destination)
        assert refused > 0
