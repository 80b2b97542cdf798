# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Disks that fail, vanish or hang: reported at once, the record is kept, no caller waits."""
from __future__ import annotations

from collections.abc import Iterator
import contextlib
import errno
import os
from pathlib import Path
import shutil
import sqlite3
import subprocess
import sys
import threading
import time

from icofabric_sim.bag import BagError, BagReader, BagRecorder, recover_bag
from icofabric_sim.bag.bag_file import BagFile
from icofabric_sim.bag.mcap_storage import McapFile
from icofabric_sim.bag.sqlite3_storage import Sqlite3File
from icofabric_sim.messages import ClockBytes, decode_string, StringBytes
import pytest

STORAGES = pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])


def wait_for_error(recorder: BagRecorder, count: int = 0) -> int:
    """Go on writing until the recorder has failed; return how many messages were handed over."""
    patience = time.monotonic() + 60
    while recorder.error is None:
        assert time.monotonic() < patience
        recorder.write('/text', count, StringBytes(str(count) * 1000).to_bytes())
        count += 1
        time.sleep(0.001)
    return count


def open_recorder(path: Path, **options: object) -> BagRecorder:
    recorder = BagRecorder(
        path, custom={'scene': 'small'}, flush_interval=0.02, **options)  # type: ignore[arg-type]
    recorder.add_topic('/text', StringBytes.TYPE)
    return recorder


def check_prefix(path: Path) -> int:
    """Check that a bag holds the first messages without a gap; return how many."""
    with BagReader(path) as reader:
        assert reader.custom['scene'] == 'small'
        found = list(reader.messages(['/text']))
    assert [decode_string(data) for *_, data in found] == [
        str(count) * 1000 for count in range(len(found))]
    return len(found)


@contextlib.contextmanager
def tiny_disk(folder: Path, size: int) -> Iterator[Path]:
    """Mount a disk of `size` [bytes]; skips where one may not mount."""
    folder.mkdir()
    done = subprocess.run(
        ['mount', '-t', 'tmpfs', '-o', f'size={size}', 'tmpfs', str(folder)],
        capture_output=True, check=False) if shutil.which('mount') else None
    if done is None or done.returncode:
        pytest.skip('mounting a tiny disk is not allowed here')
    try:
        yield folder
    finally:
        subprocess.run(['umount', str(folder)], check=True)


@STORAGES
def test_a_full_disk(tmp_path: Path, storage: str) -> None:
    told: list[BagError] = []
    with tiny_disk(tmp_path / 'disk', 2**20) as disk:
        recorder = open_recorder(disk / 'bag', storage=storage, on_error=told.append)
        handed = wait_for_error(recorder)
        recorder.close()
        assert told == [recorder.error]
        text = str(recorder.error)
        assert ('No space left on device' if storage == 'mcap' else 'disk is full') in text
        if 'icofabric recover' in text:
            # No room for the index either.
            recover_bag(disk / 'bag', tmp_path / 'whole')
        else:
            assert 'is a complete bag' in text
            shutil.copytree(disk / 'bag', tmp_path / 'whole')
    count = check_prefix(tmp_path / 'whole')
    assert 20 < count < handed
    statistics = recorder.statistics
    # Beside them the message of custom data.
    assert statistics.written == count + 1
    assert statistics.lost >= handed - count and statistics.queued == 0


@STORAGES
def test_a_disk_without_room_for_the_index(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, storage: str,
) -> None:
    recorder = open_recorder(tmp_path / 'bag', storage=storage)
    recorder.write('/text', 0, StringBytes('0' * 1000).to_bytes())
    patience = time.monotonic() + 60
    while b'0' * 1000 not in next((tmp_path / 'bag').glob('bag_0*')).read_bytes():
        assert time.monotonic() < patience
        time.sleep(0.01)

    def full(*_: object) -> None:
        if storage == 'mcap':
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        raise sqlite3.OperationalError('database or disk is full')

    monkeypatch.setattr(McapFile, '_write', full)
    monkeypatch.setattr(Sqlite3File, '_put_metadata', full)
    monkeypatch.setattr(Sqlite3File, 'flush', full)
    wait_for_error(recorder, 1)
    recorder.close()
    assert f'`icofabric recover {tmp_path / "bag"}` saves the data recorded' in str(recorder.error)
    monkeypatch.undo()
    with pytest.raises(BagError, match='was not finished'):
        BagReader(tmp_path / 'bag')
    recover_bag(tmp_path / 'bag', tmp_path / 'whole')
    assert check_prefix(tmp_path / 'whole') == 1


def test_a_disk_that_fills_between_two_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The files before are kept, and no piece of the next is left behind."""
    put = McapFile._write

    def full(file: McapFile, pieces: object) -> None:
        if file.path.name == 'bag_2.mcap':
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        put(file, pieces)  # type: ignore[arg-type]

    monkeypatch.setattr(McapFile, '_write', full)
    recorder = open_recorder(tmp_path / 'bag', split_size=50_000)
    wait_for_error(recorder)
    recorder.close()
    assert 'No space left on device' in str(recorder.error)
    assert 'is a complete bag' in str(recorder.error)
    assert sorted(item.name for item in (tmp_path / 'bag').iterdir()) == [
        'bag_0.mcap', 'bag_1.mcap', 'metadata.yaml']
    assert check_prefix(tmp_path / 'bag') > 20


@STORAGES
def test_a_bag_that_is_removed_while_it_is_recorded(tmp_path: Path, storage: str) -> None:
    """Linux takes what is written to a removed file without a word."""
    told: list[BagError] = []
    recorder = open_recorder(tmp_path / 'bag', storage=storage, on_error=told.append)
    recorder.write('/text', 0, b'\0\1\0\0\1\0\0\0\0')
    (tmp_path / 'bag').rename(tmp_path / 'elsewhere')
    shutil.rmtree(tmp_path / 'elsewhere', ignore_errors=True)
    wait_for_error(recorder, 1)
    recorder.close()
    assert told == [recorder.error]
    assert not (tmp_path / 'bag').exists()


def test_a_folder_that_nobody_may_write_to(tmp_path: Path) -> None:
    with tiny_disk(tmp_path / 'disk', 2**20) as disk:
        subprocess.run(['mount', '-o', 'remount,ro', str(disk)], check=True)
        with pytest.raises(BagError, match='record.path: cannot write a bag to .*: Read-only'):
            BagRecorder(disk / 'bag')


@STORAGES
def test_a_missing_folder_is_made(tmp_path: Path, storage: str) -> None:
    path = tmp_path / 'some' / 'where' / 'bag'
    with open_recorder(path, storage=storage) as recorder:
        recorder.write('/text', 0, StringBytes('0' * 1000).to_bytes())
    assert check_prefix(path) == 1


def test_a_disk_that_does_not_answer_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    answers, begin = threading.Event(), BagFile._open_next

    def slow(file: BagFile) -> None:
        assert answers.wait(60)
        begin(file)

    monkeypatch.setattr(BagFile, '_open_next', slow)
    recorder = open_recorder(tmp_path / 'bag', overflow='drop', patience=0.05)
    assert recorder.write('/text', 0, StringBytes('0' * 1000).to_bytes())
    assert recorder.close(0.05) is False
    assert recorder.close(0.05) is False
    answers.set()
    assert recorder.close() is True and recorder.close(0.0) is True
    assert recorder.error is None
    assert check_prefix(tmp_path / 'bag') == 1


def test_a_disk_that_answers_late_with_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    answers, told = threading.Event(), []

    def broken(_: BagFile) -> None:
        assert answers.wait(60)
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(BagFile, '_open_next', broken)
    recorder = open_recorder(
        tmp_path / 'bag', overflow='drop', patience=0.05, on_error=told.append)
    assert recorder.write('/text', 0, b'')
    answers.set()
    recorder.close()
    assert told == [recorder.error]
    assert 'record.path: cannot write a bag to' in str(recorder.error)
    assert 'Input/output error' in str(recorder.error)
    statistics = recorder.statistics
    assert (statistics.written, statistics.lost, statistics.queued) == (0, 2, 0)
    assert recorder.write('/text', 1, b'') is False
    assert not (tmp_path / 'bag').exists()


def test_slow_writes_do_not_hold_up_the_one_who_closes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
) -> None:
    allowed, write = threading.Event(), BagFile.write

    def slow(file: BagFile, topic: str, nanoseconds: int, data: bytes) -> None:
        assert allowed.wait(60)
        write(file, topic, nanoseconds, data)

    monkeypatch.setattr(BagFile, 'write', slow)
    recorder = BagRecorder(tmp_path / 'bag', overflow='drop')
    recorder.add_topic('/clock', ClockBytes.TYPE)
    for moment in range(100):
        recorder.write('/clock', moment, ClockBytes().stamped(moment))
    assert recorder.close(0.01) is False
    assert recorder.write('/clock', 100, b'') is False
    allowed.set()
    assert recorder.close() is True
    with BagReader(tmp_path / 'bag') as reader:
        assert reader.message_count == 100
    assert recorder.statistics.lost == 1


def test_a_program_that_ends_waits_for_a_bag_that_is_still_written(tmp_path: Path) -> None:
    script = """
import sys, time
from icofabric_sim.bag import BagRecorder
from icofabric_sim.bag.bag_file import BagFile
from icofabric_sim.messages import StringBytes
write = BagFile.write
def slow(*arguments):
    time.sleep(0.01)
    write(*arguments)
BagFile.write = slow
recorder = BagRecorder(sys.argv[1], overflow='drop', custom={'scene': 'small'})
recorder.add_topic('/text', StringBytes.TYPE)
for count in range(50):
    recorder.write('/text', count, StringBytes(str(count) * 1000).to_bytes())
assert not recorder.close(0.0)
"""
    subprocess.run([sys.executable, '-c', script, str(tmp_path / 'bag')], check=True, timeout=60)
    assert check_prefix(tmp_path / 'bag') == 50
