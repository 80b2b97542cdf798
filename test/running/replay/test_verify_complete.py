# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A record that lacks an output, or holds one too many, is not called identical."""

from collections import Counter
from collections.abc import Callable
import json
from pathlib import Path
from typing import Any

from driven_runs import Drive, lively_scene, MILLISECOND
from icofabric_sim.bag import BagReader, BagRecorder, recover_bag
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.commands.main import main
from icofabric_sim.messages import ClockBytes
from icofabric_sim.messages.topics import CLOCK, CONNECTORS, ENERGY, EVENTS, POSES
from icofabric_sim.running.recording import DROPPED, GIVEN
from icofabric_sim.running.replay.verify import Verification, verify_run
import pytest

Message = tuple[str, int, bytes]
NAMES = [topic.name.replace('~', '/icofabric') for topic in (POSES, CONNECTORS, ENERGY, CLOCK)]
END = 200 * MILLISECOND
# Rates, pauses, steps, resets, another weave, a body that is put elsewhere, a checkpoint.
SCRIPT = [
    (20, lambda drive: drive.pause_and_step()),
    (40, lambda drive: drive.change(publish_rate=90.0, marker_rate=30.0)),
    (60, lambda drive: drive.save()),
    (80, lambda drive: drive.reset()),
    (100, lambda drive: drive.change(connector__stiffness=700.0)),
    (130, lambda drive: drive.change(clock_rate=50.0)),
    (150, lambda drive: drive.pause_and_step()),
]


def verify(path: Path, **choices: Any) -> Verification:
    with RecordedRun(path) as run:
        return verify_run(run, **choices)


def contents(path: Path) -> tuple[dict[str, str], list[Message], dict[str, str]]:
    """Types of the topics, all messages but the custom data, and the custom data."""
    with BagReader(path) as reader:
        types = {name: topic.type_name for name, topic in reader.topics.items()}
        messages = [message for message in reader.messages()
                    if message[0] != '/icofabric/recording']
        return types, messages, reader.custom


def written(
    source: Path, path: Path, change: Callable[[list[Message]], list[Message]], *,
    without: tuple[str, ...] = (), **options: Any
) -> Path:
    """A bag of what `change` makes of the messages of another one."""
    types, messages, custom = contents(source)
    custom = {key: value for key, value in custom.items() if key not in without}
    with BagRecorder(path, custom=custom, **options) as recorder:
        for name, type_name in types.items():
            recorder.add_topic(name, type_name)
        for message in change(messages):
            recorder.write(*message)
    return path


@pytest.fixture(scope='module')
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run to which all was done that changes what is shown when."""
    path = tmp_path_factory.mktemp('driven') / 'bag'
    scene = lively_scene(duration=0.2, clock_rate=200.0, step_count=40)
    drive = Drive(path, scene, SCRIPT)
    drive.script.insert(3, (70, lambda drive: drive.runner.set_body_state(
        4, {'linear_velocity': [0.0, 0.1, 0.0]})))
    drive.run()
    return path


def without(number: int) -> Callable[[list[Message]], list[Message]]:
    return lambda messages: messages[:number] + messages[number + 1:]


def places(path: Path, name: str) -> list[int]:
    return [number for number, message in enumerate(contents(path)[1]) if message[0] == name]


def test_driven_run_holds_all_of_it(driven: Path) -> None:
    result = verify(driven)
    assert result.verdict == 'identical' and result.gaps == (), result.lines()
    assert result.repeated['steps'] == 2 and result.repeated['re-weaves'] == 1
    assert result.repeated['resets'] == result.repeated['states set'] == 1
    # In part, and from a checkpoint on.
    for choice in ({'stop': 55 * MILLISECOND}, {'start': 61 * MILLISECOND},
                   {'start': 61 * MILLISECOND, 'stop': 140 * MILLISECOND}):
        assert verify(driven, **choice).verdict == 'identical'


@pytest.mark.parametrize('name', NAMES)
def test_one_output_that_is_missing_is_named(driven: Path, tmp_path: Path, name: str) -> None:
    found = places(driven, name)
    messages = contents(driven)[1]
    # The first, the last, and one in the middle.
    for number in (found[0], found[len(found) // 2], found[-1]):
        copy = written(driven, tmp_path / f'{number}', without(number))
        result = verify(copy)
        assert result.verdict == 'incomplete' and not result.is_good, result.lines()
        [gap] = result.gaps
        assert (gap.topic, gap.messages, gap.nanoseconds) == (name, 1, messages[number][1])
        assert f'1 message of {name} (at t = ' in '\n'.join(result.lines())
    # As long as it was recorded whole, the bag need not even say how much it was given.
    number = found[len(found) // 2]
    copy = written(driven, tmp_path / 'untold', without(number), without=(GIVEN,))
    assert [gap.nanoseconds for gap in verify(copy).gaps] == [messages[number][1]]


@pytest.mark.parametrize('name', NAMES)
def test_a_whole_topic_that_is_missing_is_named(driven: Path, tmp_path: Path, name: str) -> None:
    copy = written(driven, tmp_path / 'copy', lambda messages: [
        message for message in messages if message[0] != name])
    result = verify(copy)
    assert [gap[:2] for gap in result.gaps] == [(name, len(places(driven, name)))]
    assert result.gaps[0].nanoseconds == 0 and result.verdict == 'incomplete'


@pytest.mark.parametrize('name', NAMES)
def test_an_output_that_was_never_sent_is_named(driven: Path, tmp_path: Path, name: str) -> None:
    found = places(driven, name)
    number = found[len(found) // 2]
    time = contents(driven)[1][number][1]
    copies = {
        'twice': lambda messages: messages[:number + 1] + messages[number:],
        'later': lambda messages: sorted(
            [*messages, (name, time + 12_345, messages[number][2])],
            key=lambda message: message[1])}
    for way, change in copies.items():
        result = verify(written(driven, tmp_path / way, change, without=(GIVEN,)))
        assert result.verdict == 'differs' and result.difference is not None
        assert result.difference.topic == name
        assert result.difference.nanoseconds == time + (12_345 if way == 'later' else 0)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_split_bags_of_both_storages(driven: Path, tmp_path: Path, storage: str) -> None:
    options = {'storage': storage, 'split_duration': 0.06}
    whole = written(driven, tmp_path / 'whole', lambda messages: messages, **options)
    assert len([*whole.glob('whole_*')]) > 2 and verify(whole).verdict == 'identical'
    number = places(driven, '/icofabric/energy')[7]
    [gap] = verify(written(driven, tmp_path / 'copy', without(number), **options)).gaps
    assert (gap.topic, gap.messages) == ('/icofabric/energy', 1)


def test_bag_that_ends_early_is_complete_to_its_end(driven: Path, tmp_path: Path) -> None:
    count = len(contents(driven)[1])
    for end in (count // 3, count // 2, count - 2):
        def begin(messages: list[Message], end: int = end) -> list[Message]:
            return messages[:end]

        copy = written(driven, tmp_path / f'{end}', begin, without=(GIVEN,))
        assert verify(copy).verdict == 'identical'
    # Of one that was closed, something is missing then.
    copy = written(driven, tmp_path / 'closed', lambda messages: messages[:count - 2])
    result = verify(copy)
    assert result.verdict == 'incomplete' and sum(gap.messages for gap in result.gaps) == 2


def test_killed_and_recovered_bag_is_complete_to_its_end(driven: Path, tmp_path: Path) -> None:
    whole = written(
        driven, tmp_path / 'whole', lambda messages: messages, without=(GIVEN,),
        flush_interval=1e-9)
    [file] = whole.glob('*.mcap')
    data = file.read_bytes()
    file.write_bytes(data[:len(data) * 2 // 3])
    (whole / 'metadata.yaml').unlink()
    recover_bag(whole, tmp_path / 'recovered')
    result = verify(tmp_path / 'recovered')
    assert result.verdict == 'identical' and 0 < result.end < END


def test_what_a_slow_disk_has_cost_is_no_gap(driven: Path, tmp_path: Path) -> None:
    topics, messages, custom = contents(driven)
    energies = places(driven, '/icofabric/energy')[3:6]
    given = json.loads(custom[GIVEN])
    given['/icofabric/energy'] -= 2

    def copy(name: str, lost: list[int]) -> Verification:
        path = tmp_path / name
        with BagRecorder(path, custom={
            **custom, DROPPED: json.dumps({'/icofabric/energy': 2}), GIVEN: json.dumps(given)
        }) as recorder:
            for number, message in enumerate(messages):
                recorder.add_topic(message[0], topics[message[0]])
                if number not in lost:
                    recorder.write(*message)
        return verify(path)

    result = copy('dropped', energies[:2])
    assert result.verdict == 'identical'
    assert 'not recorded' in '\n'.join(result.lines())
    assert '2 of /icofabric/energy: the disk was too slow' in '\n'.join(result.lines())
    result = copy('more', energies)
    assert [gap[:2] for gap in result.gaps] == [('/icofabric/energy', 1)]


def test_a_run_whose_disk_was_slow_for_a_while(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = BagRecorder.write

    def slow(self: Any, topic: str, time: int, data: bytes, *, essential: bool = False) -> bool:
        slow_now = 50 * MILLISECOND <= time < 70 * MILLISECOND and not essential
        return not slow_now and write(self, topic, time, data, essential=essential)

    monkeypatch.setattr(BagRecorder, 'write', slow)
    Drive(tmp_path / 'bag', lively_scene(duration=0.12, marker_rate=100.0), []).run()
    result = verify(tmp_path / 'bag')
    assert result.verdict == 'identical' and result.gaps == ()
    assert set(result.dropped) == set(NAMES) and result.dropped['/clock'] == 20
    # Also where the bag was killed afterwards: it was written before what followed the gap.
    with BagReader(tmp_path / 'bag') as reader:
        order = [(name, time) for name, time, data in reader.messages()
                 if name in NAMES or DROPPED.encode() in data]
    told = [number for number, (name, _) in enumerate(order) if name not in NAMES][-1]
    assert all(time < 50 * MILLISECOND for name, time in order[:told] if name in NAMES)
    assert order[told + 1][1] >= 70 * MILLISECOND


def test_events_that_are_missing_are_counted(driven: Path, tmp_path: Path) -> None:
    name = f'/icofabric{EVENTS.name[1:]}'
    # That a checkpoint was saved has no consequences.
    number = next(n for n in places(driven, name) if b'checkpoint_saved' in (
        contents(driven)[1][n][2]))
    result = verify(written(driven, tmp_path / 'copy', without(number)))
    assert [gap[:2] for gap in result.gaps] == [(name, 1)]


def test_the_verb_says_what_is_missing(
    driven: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    number = places(driven, '/icofabric/poses')[5]
    copy = written(driven, tmp_path / 'copy', without(number))
    assert main(['verify', str(copy)]) == 1
    shown = capsys.readouterr().out
    assert shown.splitlines()[-1].startswith('incomplete: 1 recorded message is missing')
    assert 'missing' in shown and '/icofabric/poses' in shown
    assert Counter(message[0] for message in contents(driven)[1])['/icofabric/poses'] > 10
    assert ClockBytes.TYPE == contents(driven)[0]['/clock']
