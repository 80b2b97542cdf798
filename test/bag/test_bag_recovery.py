# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings that end badly: killed, interrupted, out of disk, cut short; and what is saved."""
from __future__ import annotations

from pathlib import Path
import resource
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from typing import Any

from icofabric_sim import messages
from icofabric_sim.bag import BagError, BagReader, BagRecorder, recover_bag, recovery
from icofabric_sim.bag.bag_file import BagFile
from icofabric_sim.bag.storage import definition, quality_of_service, TopicEntry
from icofabric_sim.messages import Float64MultiArrayBytes, StringBytes, WrenchStampedBytes
from mcap.writer import Writer
import pytest

STORAGES = pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
FILES = {'mcap': 'bag_0.mcap', 'sqlite3': 'bag_0.db3'}

# Writes small messages whose time is the wall time, so that a reader sees how late the last is.
WRITING = """
import sys, time
from icofabric_sim.bag import BagRecorder
from icofabric_sim.messages import ClockBytes, StringBytes
recorder = BagRecorder(sys.argv[1], storage=sys.argv[2], custom={'scene': 'small'})
recorder.add_topic('/clock', ClockBytes.TYPE)
recorder.add_topic('/weave', StringBytes.TYPE, latched=True)
clock, count = ClockBytes(), 0
print('writing', flush=True)
while True:
    recorder.write('/clock', time.monotonic_ns(), clock.stamped(count))
    count += 1
    time.sleep(0.005)
"""

# Writes until the limit on the size of a file stands for a full disk, and then goes on.
FILLING = """
import resource, sys, time
from icofabric_sim.bag import BagRecorder
from icofabric_sim.messages import StringBytes
resource.setrlimit(resource.RLIMIT_FSIZE, (3_000_000, 3_000_000))
told = []
recorder = BagRecorder(sys.argv[1], storage=sys.argv[2], custom={'scene': 'large'},
                       flush_interval=0.05, on_error=told.append)
recorder.add_topic('/text', StringBytes.TYPE, latched=False)
patience, count = time.monotonic() + 60, 0
while recorder.error is None and time.monotonic() < patience:
    recorder.write('/text', count, StringBytes(str(count) * 2000).to_bytes())
    count += 1
    time.sleep(0.001)
assert not any(recorder.write('/text', count, b'') for _ in range(50))
recorder.set_custom('after', 'the end')
recorder.close()
recorder.close()
assert told == [recorder.error] and recorder.statistics.lost >= 51
print(recorder.error)
"""


def start(script: str, path: Path, storage: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, '-c', script, str(path), storage], text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def finish(process: subprocess.Popen[str]) -> tuple[str, str]:
    try:
        return process.communicate(timeout=60)
    finally:
        process.kill()


def check_prefix(path: Path) -> tuple[int, int]:
    """
    Check that a recovered bag holds every message up to its last; return their count and it [ns].
    """
    with BagReader(path) as reader:
        assert reader.custom == {'scene': 'small'}
        first = next(reader.messages())
        assert first[0] == '/icofabric/recording'
        found = list(reader.messages(['/clock']))
        assert reader.topics['/clock'].type_hash == (
            'RIHS01_692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564')
    assert [messages.decode_clock(data) for *_, data in found] == list(range(len(found)))
    return len(found), found[-1][1]


@STORAGES
def test_killed_at_any_moment_all_but_the_last_second_is_saved(
    tmp_path: Path, storage: str,
) -> None:
    lives = [0.9, 1.07, 1.31, 1.76, 2.15]  # [s], not multiples of the flush interval
    children = [start(WRITING, tmp_path / str(index) / 'bag', storage)
                for index in range(len(lives))]
    born = []
    for child in children:
        assert child.stdout is not None and child.stdout.readline() == 'writing\n'
        born.append(time.monotonic())
    killed = []
    for child, moment, life in zip(children, born, lives):
        time.sleep(max(0.0, moment + life - time.monotonic()))
        child.kill()
        killed.append(time.monotonic_ns())
        finish(child)
    for index, moment in enumerate(killed):
        source, destination = tmp_path / str(index) / 'bag', tmp_path / str(index) / 'whole'
        with pytest.raises(BagError, match=f'was not finished.*icofabric recover {source}'):
            BagReader(source)
        report = recover_bag(source, destination)
        count, last = check_prefix(destination)
        assert count > 10
        assert last > moment - 1_000_000_000
        assert report.topics == {'/icofabric/recording': 1, '/clock': count, '/weave': 0}
        assert report.end_time == last and report.damage
        assert report.custom == {'scene': 'small'}


@STORAGES
@pytest.mark.parametrize('interruption', [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_program_that_closes_nothing_leaves_a_whole_bag(
    tmp_path: Path, storage: str, interruption: signal.Signals,
) -> None:
    # A node turns SIGTERM into an orderly end; the plainest way is an exception.
    script = WRITING.replace('import sys, time', """import signal, sys, time
signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
signal.signal(signal.SIGINT, signal.default_int_handler)""")
    child = start(script, tmp_path / 'bag', storage)
    assert child.stdout is not None and child.stdout.readline() == 'writing\n'
    time.sleep(0.2)
    child.send_signal(interruption)
    _, errors = finish(child)
    assert child.returncode == (0 if interruption == signal.SIGTERM else -signal.SIGINT)
    assert ('KeyboardInterrupt' in errors) == (interruption == signal.SIGINT)
    assert check_prefix(tmp_path / 'bag')[0] > 10


@STORAGES
def test_a_full_disk_is_told_once_and_what_was_written_is_saved(
    tmp_path: Path, storage: str,
) -> None:
    child = start(FILLING, tmp_path / 'bag', storage)
    output, errors = finish(child)
    assert child.returncode == 0, errors
    assert errors == ''
    assert f'recording to {tmp_path / "bag"} stopped: ' in output
    assert ('File too large' if storage == 'mcap' else 'disk') in output
    assert 'make room or choose another record.path; the data recorded before is a complete' in (
        output)
    with BagReader(tmp_path / 'bag') as reader:
        stopped = reader.custom['recording_stopped']
        assert reader.custom == {'scene': 'large', 'recording_stopped': stopped}
        assert f'stopped: {stopped}; make room' in output
        found = list(reader.messages(['/text']))
    assert sum(item.stat().st_size for item in (tmp_path / 'bag').iterdir()) > 2_000_000
    assert sorted(item.suffix for item in (tmp_path / 'bag').iterdir()) == sorted([
        '.yaml', '.mcap' if storage == 'mcap' else '.db3'])
    assert len(found) > 100
    for count, (_, nanoseconds, data) in enumerate(found):
        assert nanoseconds == count
        assert messages.decode_string(data) == str(count) * 2000


def test_where_the_end_finds_no_room_the_last_messages_give_way(tmp_path: Path) -> None:
    file = BagFile(tmp_path / 'bag', 'mcap', custom={'scene': 'large'})
    file.add_topic(TopicEntry(
        '/text', StringBytes.TYPE, definition(StringBytes.TYPE),
        [quality_of_service(latched=False, depth=1)]))
    for count in range(6):
        file.write('/text', count, StringBytes(str(count) * 500).to_bytes())
        file.flush()
    size = (tmp_path / 'bag' / FILES['mcap']).stat().st_size
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    # What is to follow the messages takes more than is left, and more than one of them.
    resource.setrlimit(resource.RLIMIT_FSIZE, (size + 10, limits[1]))
    try:
        assert file.salvage({'scene': 'large', 'recording_stopped': 'why'})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert (tmp_path / 'bag' / FILES['mcap']).stat().st_size <= size + 10
    with BagReader(tmp_path / 'bag') as reader:
        assert reader.custom['recording_stopped'] == 'why'
        found = [messages.decode_string(data) for *_, data in reader.messages()]
        counted = reader.topics['/text'].message_count
    assert found == [str(count) * 500 for count in range(len(found))]
    assert 1 <= len(found) == counted == file.message_count <= 4


def example_bag(
    path: Path, storage: str = 'mcap', *, chunks: int = 3, **options: Any,
) -> list:
    """Record a bag of some chunks, and return its messages."""
    records = [('/weave', 0, messages.StringBytes('size: [3, 3, 3]').to_bytes())]
    poses = messages.PoseArrayBytes('world', 6000)
    for index in range(4 * chunks):
        records.append(('/poses', index, poses.stamped(index)))
        records.append(('/clock', index, messages.ClockBytes().stamped(index)))
    with BagRecorder(path, storage=storage, custom={'version': '1'}, **options) as recorder:
        recorder.add_topic('/weave', messages.StringBytes.TYPE, latched=True)
        recorder.add_topic('/poses', messages.PoseArrayBytes.TYPE, depth=3)
        recorder.add_topic('/clock', messages.ClockBytes.TYPE)
        for item in records:
            recorder.write(*item)
    with BagReader(path) as reader:
        return list(reader.messages())


@STORAGES
def test_recovering_a_whole_bag_copies_it(
    tmp_path: Path, storage: str, monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(recovery, '_PROGRESS_INTERVAL', 1)
    records = example_bag(tmp_path / 'bag', storage)
    progress: list[float] = []
    report = recover_bag(tmp_path / 'bag', tmp_path / 'copy', on_progress=progress.append)
    assert report.damage == '' and report.message_count == len(records)
    assert (report.start_time, report.end_time) == (0, 11)
    assert progress == sorted(progress) and progress[-1] == 1.0
    assert any(0.2 < part < 0.9 for part in progress)
    with BagReader(tmp_path / 'bag') as source, BagReader(tmp_path / 'copy') as copy:
        assert list(copy.messages()) == records
        assert copy.topics == source.topics
        assert copy.topics['/poses'].depth == 3 and copy.topics['/weave'].latched
        assert copy.custom == source.custom == {'version': '1'}
    with pytest.raises(BagError, match='already exists and will not be overwritten'):
        recover_bag(tmp_path / 'bag', tmp_path / 'copy')
    with BagReader(tmp_path / 'copy') as copy:
        assert list(copy.messages()) == records


@STORAGES
@pytest.mark.parametrize('compression', ['none', 'zstd'])
def test_topics_without_messages_are_kept(
    tmp_path: Path, storage: str, compression: str,
) -> None:
    file = BagFile(tmp_path / 'bag', storage, compression=compression)
    silent = {'/pushes': (WrenchStampedBytes.TYPE, False, 100), '/broken': (
        Float64MultiArrayBytes.TYPE, True, 1)}
    for number in range(3):
        if number == 2:
            file.split()
        for name, (type_name, latched, depth) in {
                '/early': (StringBytes.TYPE, False, 10), **silent}.items():
            if number < 2:
                file.add_topic(TopicEntry(
                    f'{name}_{number}', type_name, definition(type_name),
                    [quality_of_service(latched=latched, depth=depth)]))
        file.write('/early_0', number, StringBytes('x').to_bytes())
        file.flush()
    shutil.copytree(tmp_path / 'bag', tmp_path / 'killed')
    file.close({})
    report = recover_bag(tmp_path / 'killed', tmp_path / 'again')
    assert report.damage
    with BagReader(tmp_path / 'bag') as closed, BagReader(tmp_path / 'again') as again:
        assert list(closed.topics.items()) == list(again.topics.items())
        assert [topic.message_count for topic in again.topics.values()] == [3, 0, 0, 0, 0, 0]
        assert {(topic.depth, topic.latched) for topic in again.topics.values()} == {
            (10, False), (100, False), (1, True)}
    assert report.topics == {name: topic.message_count for name, topic in again.topics.items()}


def test_a_message_that_is_cut_is_left_out(tmp_path: Path) -> None:
    """As other writers leave it, which write messages outside of chunks."""
    file = tmp_path / 'cut.mcap'
    writer = Writer(str(file), use_chunking=False)
    writer.start(profile='ros2', library='another')
    schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
    channel = writer.register_channel('/text', 'cdr', schema)
    data = [messages.StringBytes(text * 100).to_bytes() for text in 'abc']
    for time_, content in enumerate(data):
        writer.add_message(channel, time_, content, time_)
    writer.finish()
    whole = file.read_bytes()
    file.write_bytes(whole[:whole.index(data[-1]) + 50])
    report = recover_bag(file, tmp_path / 'bag')
    assert 'incomplete last record' in report.damage
    with BagReader(tmp_path / 'bag') as reader:
        assert list(reader.messages()) == [('/text', 0, data[0]), ('/text', 1, data[1])]


def test_cut_short_anywhere_the_start_is_saved(tmp_path: Path) -> None:
    records = example_bag(tmp_path / 'bag')
    file = tmp_path / 'bag' / 'bag_0.mcap'
    data = file.read_bytes()
    counts = []
    for index, size in enumerate(range(0, len(data), len(data) // 12)):
        for tail in (b'', bytes(5000), b'\xff' * 100, data[:3000]):
            cut = tmp_path / 'cut.mcap'
            cut.write_bytes(data[:size] + tail)
            destination = tmp_path / f'whole_{index}'
            with pytest.raises(BagError):
                BagReader(cut)
            try:
                report = recover_bag(cut, destination)
            except BagError as error:
                assert 'nothing can be recovered' in str(error)
                assert not destination.exists()
                counts.append(0)
                continue
            assert report.damage
            with BagReader(destination) as reader:
                found = list(reader.messages())
                assert reader.custom == {'version': '1'}
            assert found == records[:len(found)]
            counts.append(len(found))
            for item in destination.iterdir():
                item.unlink()
            destination.rmdir()
    # The four tails change nothing, and a longer file yields more.
    assert counts[::4] == counts[1::4] == counts[2::4] == counts[3::4]
    assert counts == sorted(counts)
    assert counts[0] == 0 and len(set(counts)) >= 3


def test_what_cannot_be_recovered(tmp_path: Path) -> None:
    with pytest.raises(BagError, match='does not exist'):
        recover_bag(tmp_path / 'nothing', tmp_path / 'whole')
    (tmp_path / 'empty').mkdir()
    with pytest.raises(BagError, match='contains no .mcap or .db3 file'):
        recover_bag(tmp_path / 'empty', tmp_path / 'whole')
    for name in ('noise.mcap', 'noise.db3', 'none.mcap', 'none.db3'):
        (tmp_path / name).write_bytes(b'noise' * 100 if 'noise' in name else b'')
        with pytest.raises(BagError, match='nothing can be recovered from .*ends early'):
            recover_bag(tmp_path / name, tmp_path / 'whole')
    example_bag(tmp_path / 'bag', chunks=1)
    with pytest.raises(BagError, match='cannot write'):
        recover_bag(tmp_path / 'bag', tmp_path / 'noise.mcap' / 'whole')
    assert not (tmp_path / 'whole').exists()


def test_a_damaged_chunk_is_left_out(tmp_path: Path) -> None:
    """The sum over each chunk shows it; what comes after it is still saved."""
    records = example_bag(tmp_path / 'bag', chunks=4)
    file = tmp_path / 'bag' / 'bag_0.mcap'
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)
    with BagReader(tmp_path / 'bag') as reader, pytest.raises(BagError, match='is damaged'):
        list(reader.messages())
    report = recover_bag(tmp_path / 'bag', tmp_path / 'whole')
    assert 'bag_0.mcap: the chunk at byte' in report.damage and 'skipped' in report.damage
    with BagReader(tmp_path / 'whole') as reader:
        found = list(reader.messages())
    kept = iter(records)
    assert all(any(item == other for other in kept) for item in found)  # in order
    assert found[-1] == records[-1] and 0.5 * len(records) < len(found) < len(records)


@pytest.mark.parametrize('compression', ['none', 'zstd'])
def test_a_broken_transaction_is_undone_in_a_copy(tmp_path: Path, compression: str) -> None:
    """As after a kill in the middle of writing: SQLite would roll it back in the source itself."""
    records = example_bag(tmp_path / 'bag', 'sqlite3', compression=compression)
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    killed = tmp_path / 'killed'
    killed.mkdir()
    database = sqlite3.connect(tmp_path / 'bag' / 'bag_0.db3', isolation_level=None)
    database.execute('PRAGMA cache_size = 2')  # so that pages reach the file before the commit
    database.execute('BEGIN')
    database.execute('DELETE FROM messages WHERE id > 5')
    database.executemany(
        'INSERT INTO messages (topic_id, timestamp, data) VALUES (1, 99, ?)',
        [(bytes(5000),)] * 50)
    for item in (tmp_path / 'bag').iterdir():
        shutil.copy(item, killed / item.name)
    database.close()
    before = {item.name: item.read_bytes() for item in killed.iterdir()}
    assert set(before) == {'bag_0.db3', 'bag_0.db3-journal'}
    with pytest.raises(BagError, match='was not finished'):
        BagReader(killed)
    with pytest.raises(BagError, match='was not finished'):
        BagReader(killed / 'bag_0.db3')
    recover_bag(killed, tmp_path / 'whole')
    with BagReader(tmp_path / 'whole') as reader:
        assert list(reader.messages()) == records
    assert {item.name: item.read_bytes() for item in killed.iterdir()} == before
    assert sorted(item.name for item in tmp_path.iterdir()) == ['bag', 'killed', 'whole']


def test_a_killed_bag_of_several_files(tmp_path: Path) -> None:
    """Those before the last are whole already."""
    records = example_bag(tmp_path / 'bag', chunks=6, split_size=2_000_000)
    files = sorted((tmp_path / 'bag').glob('*.mcap'))
    assert len(files) >= 3
    last = files[-1].read_bytes()
    files[-1].write_bytes(last[:len(last) // 2])
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    with pytest.raises(BagError, match='was not finished'):
        BagReader(tmp_path / 'bag')
    with BagReader(files[1]) as reader:
        assert reader.message_count > 0
    report = recover_bag(tmp_path / 'bag', tmp_path / 'whole')
    assert report.damage.startswith(f'{files[-1].name} ends early')
    assert report.custom == {'version': '1'}
    with BagReader(tmp_path / 'whole') as reader:
        found = list(reader.messages())
    assert found == records[:len(found)] and len(found) > 0.6 * len(records)


@STORAGES
def test_a_bag_that_lacks_only_its_metadata(tmp_path: Path, storage: str) -> None:
    records = example_bag(tmp_path / 'bag', storage)
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    report = recover_bag(tmp_path / 'bag', tmp_path / 'whole')
    assert report.damage == ''
    with BagReader(tmp_path / 'whole') as reader:
        assert list(reader.messages()) == records


def test_types_that_are_not_ours_are_kept(tmp_path: Path) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import get_types_from_msg, get_typestore, Stores
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(
        'std_msgs/Header header\nfloat64 gain\n', 'their_msgs/msg/Gain'))
    writer = Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP)
    writer.open()
    gain = writer.add_connection('/gain', 'their_msgs/msg/Gain', typestore=store)
    writer.write(gain, 5, b'\0\1\0\0' + bytes(24))
    writer.close()
    file = tmp_path / 'bag' / 'bag.mcap'
    file.write_bytes(file.read_bytes()[:-20])
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    recover_bag(tmp_path / 'bag', tmp_path / 'whole')
    with BagReader(tmp_path / 'whole') as reader:
        assert reader.topics['/gain'].type_hash == store.hash_rihs01('their_msgs/msg/Gain')
        assert list(reader.messages()) == [('/gain', 5, b'\0\1\0\0' + bytes(24))]
        assert reader.custom == {}
