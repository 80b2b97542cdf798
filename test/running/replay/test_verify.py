# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Records simulated again: identical however they were driven, and whatever was changed is found.
"""

from collections.abc import Callable, Iterator
import json
from pathlib import Path
from typing import Any

from driven_runs import Drive, in_order, lively_scene, MILLISECOND, random_pushes
from icofabric_sim.bag import BagReader, BagRecorder, recover_bag
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.bag.summary import summarise_bag
from icofabric_sim.commands.main import main
from icofabric_sim.messages import (
    ClockBytes,
    decode_float64_multi_array,
    decode_marker_points,
    decode_pose_array,
    PoseArrayBytes,
    StringBytes,
)
from icofabric_sim.messages.schedule import seconds
from icofabric_sim.messages.topics import CHECKPOINT
from icofabric_sim.running.replay.resimulation import NotRepeatable, resimulate_to
from icofabric_sim.running.replay.source import ReplaySource
from icofabric_sim.running.replay.verify import Verification, verify_run
from icofabric_sim.simulation.simulation import compile_scene
import numpy as np
import pytest
from recorded_runs import DURATION, PUSH_START, record_push, swing_scene
from runner_helpers import Beside

Message = tuple[str, int, bytes]
SCRIPT = [
    (50, lambda drive: drive.pause_and_step()),
    (80, lambda drive: drive.change(connector__stiffness=700.0)),
    (100, lambda drive: drive.save()),
    (120, lambda drive: drive.change(duration=0.5, publish_rate=100.0)),
    (140, lambda drive: drive.reset()),
    (170, lambda drive: drive.change(gravity=[0.0, 0.0, -5.0])),
    (190, lambda drive: drive.change(gravity=[0.0, 0.0, -9.81])),
    (200, lambda drive: drive.restore()),
    # Back at 100 ms, in the next bag.
    (130, lambda drive: drive.pause_and_step()),
    (230, lambda drive: drive.record(False)),
    (250, lambda drive: drive.record(True)),
    (270, lambda drive: drive.record(True)),
    (300, lambda drive: drive.change(weave__size=[4, 3, 3])),
    (340, lambda drive: drive.change(supports__wall__fix='tx ty tz')),
]


def verify(path: Path, **choices: Any) -> Verification:
    with RecordedRun(path) as run:
        return verify_run(run, **choices)


def script_with_pushes(seed: int) -> list[tuple[int, Any]]:
    """The script, whose times jump back once, with wrenches at random moments in between."""
    return [
        *in_order(SCRIPT[:8], random_pushes(seed, 25, 195)),
        *in_order(SCRIPT[8:], random_pushes(seed + 100, 25, 480))]


@pytest.mark.parametrize('seed', range(4))
@pytest.mark.parametrize('method', ['auto', 'dop8'])
def test_run_driven_at_random_is_identical(tmp_path: Path, seed: int, method: str) -> None:
    scene = lively_scene(step_count=5, **{'solver.method': method})
    Drive(tmp_path / 'bag', scene, script_with_pushes(seed)).run()
    results = [verify(tmp_path / name) for name in ('bag', 'bag_1', 'bag_2', 'bag_3')]
    for result in results:
        assert result.verdict == 'identical' and not result.difference, result.lines()
        assert result.compared['~/poses'] > 1 and result.compared['~/energy'] > 1
        assert result.compared['~/connectors'] > 1
    first, second, third, last = (result.repeated for result in results)
    assert first['re-weaves'] == 3 and first['resets'] == 1 and first['inputs'] > 5
    assert 'begun at a checkpoint' not in first and results[0].compared[CHECKPOINT.name] == 1
    # Restored, switched on, switched over.
    assert all(counts['begun at a checkpoint'] == 1 for counts in (second, third, last))
    assert [result.start // MILLISECOND for result in results] == [0, 100, 250, 270]
    assert last['re-weaves'] == 2 and results[-1].body_count > results[0].body_count
    assert sum(counts['inputs'] for counts in (second, third, last)) > 10


@pytest.mark.parametrize('changes', [{'publish.stride': 3}, {'publish.group': 'wall'}])
def test_bags_of_some_bodies_that_begin_during_a_run_are_identical(
        tmp_path: Path, changes: dict[str, Any]) -> None:
    """The published bodies are in the bag before the checkpoint at which it begins."""
    Drive(tmp_path / 'bag', lively_scene(step_count=5, **changes), script_with_pushes(1)).run()
    results = [verify(tmp_path / name) for name in ('bag', 'bag_1', 'bag_2', 'bag_3')]
    for result, begun in zip(results, (0, 1, 1, 1)):
        assert result.verdict == 'identical' and not result.difference, result.lines()
        assert result.compared['~/poses'] > 1 and result.compared['~/bodies'] > 0
        assert result.repeated['begun at a checkpoint'] == begun


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_storages_compression_and_several_files(tmp_path: Path, storage: str) -> None:
    scene = lively_scene(**{
        'record.compression': 'zstd', 'record.split_duration': 0.1, 'record.storage': storage})
    Drive(tmp_path / 'bag', scene, in_order(random_pushes(1, 20, 380), SCRIPT[:3])).run()
    assert len(list((tmp_path / 'bag').glob('bag_*'))) > 2
    result = verify(tmp_path / 'bag')
    assert result.verdict == 'identical' and result.repeated['inputs'] > 5
    assert result.end == 400 * MILLISECOND


def test_any_number_of_threads_gives_the_same_bits(tmp_path: Path) -> None:
    scene = swing_scene(**{
        'weave.size': [16, 16, 16], 'contact.mode': 'never', 'duration': 0.02, 'solver.threads': 1,
        'initial_random.velocity_sigma': 0.2, 'clock_rate': 1000.0, 'publish_rate': 200.0})
    Drive(tmp_path / 'bag', scene, [
        (4, lambda drive: drive.push('tip', (0.0, 30.0, 0.0))),
        (6, lambda drive: drive.push(7, (1.0, 0.0, 0.0), after=1.7e-3)),
        (9, lambda drive: drive.change(connector__stiffness=400.0)),
        (12, lambda drive: drive.record(True)),
    ]).run()
    for name in ('bag', 'bag_1'):
        results = [verify(tmp_path / name, threads=threads) for threads in (1, 2)]
        assert [result.verdict for result in results] == ['identical'] * 2
        assert results[0].body_count > 2000
        assert results[0].compared == results[1].compared


def test_reset_of_time_begins_a_bag_of_its_own(tmp_path: Path) -> None:
    scene = lively_scene(reset_time=True, duration=0.2)
    Drive(tmp_path / 'bag', scene, [
        *in_order(random_pushes(5, 10, 140), [
            (80, lambda drive: drive.change(duration=0.3)),
            (120, lambda drive: drive.change(connector__stiffness=300.0))]),
        (150, lambda drive: drive.reset()),
        *random_pushes(6, 1, 140),
    ]).run()
    for name, re_weaves in (('bag', 1), ('bag_1', 0)):
        result = verify(tmp_path / name)
        assert result.verdict == 'identical' and result.start == 0
        assert result.repeated['re-weaves'] == re_weaves
        assert not result.repeated['begun at a checkpoint']


def unstable_scene(**changes: Any) -> Any:
    """A slab whose fixed step becomes unsafe once it stretches."""
    plain = lively_scene(**{
        'initial_random.velocity_sigma': 2.0, 'solver.method': 'srkn4', **changes})
    limit = compile_scene(plain).status.stability_limit
    return lively_scene(**{
        'initial_random.velocity_sigma': 2.0, 'solver.method': 'srkn4',
        'solver.step': float(np.nextafter(limit, 0.0)), **changes})


def test_run_that_failed_fails_again(tmp_path: Path) -> None:
    drive = Drive(tmp_path / 'bag', unstable_scene(), random_pushes(3, 3, 1)).run()
    assert 'solver.step' in drive.runner.failure
    result = verify(tmp_path / 'bag')
    assert result.verdict == 'identical' and result.repeated['failures'] == 1
    assert result.end == drive.runner.now and drive.runner.failure in '\n'.join(result.lines())


@pytest.mark.parametrize('remedy', ['reset', 'change', 'weave'])
def test_run_that_goes_on_after_a_failure(tmp_path: Path, remedy: str) -> None:
    drive = Drive(tmp_path / 'bag', unstable_scene(duration=0.0), [])
    runner = drive.runner
    with Beside(runner) as beside:
        beside.wait_for(lambda: runner.failure)
        failed = runner.now
        if remedy == 'reset':
            assert runner.reset().result(60.0) == failed
            drive.change(solver__step=0.0)
        elif remedy == 'change':
            drive.change(solver__step=0.0)
        else:
            drive.change(weave__size=[3, 3, 4], solver__step=0.0)
        beside.wait_for(
            lambda: runner.now > failed + 20 * MILLISECOND and not drive._building)
    drive.close()
    assert not runner.failure
    result = verify(tmp_path / 'bag')
    assert result.verdict == 'identical', result.lines()
    # Of a reset, it may fail again before the change comes.
    assert result.repeated['failures'] >= 1 and result.repeated['re-weaves'] == 1
    assert result.repeated['resets'] == (remedy == 'reset')
    assert result.end > failed


def test_paused_failure_while_steps_are_taken(tmp_path: Path) -> None:
    drive = Drive(
        tmp_path / 'bag', unstable_scene(duration=0.0, start_paused=True, step_count=10**5), [])
    with Beside(drive.runner):
        with pytest.raises(RuntimeError, match='solver.step'):
            drive.runner.take_steps().result(60.0)
    drive.close()
    result = verify(tmp_path / 'bag')
    assert result.verdict == 'identical' and result.repeated['failures'] == 1
    assert result.compared['~/poses'] == 2 and result.end > 0


# What was changed is found.

@pytest.fixture(scope='module')
def pushed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A slab whose tip is pushed from 0.1 to 0.2 s."""
    path = tmp_path_factory.mktemp('pushed') / 'bag'
    record_push(path, swing_scene())
    return path


def changed_copy(
    source: Path, path: Path, change: Callable[[Message], Message | None], **custom: str
) -> Path:
    """Copy a bag, each message as `change` returns it; None leaves it out."""
    with BagReader(source) as reader, BagRecorder(
        path, custom={**reader.custom, **custom}
    ) as recorder:
        for name, topic in reader.topics.items():
            recorder.add_topic(name, topic.type_name, latched=topic.latched)
        for message in reader.messages():
            kept = None if message[0] == '/icofabric/recording' else change(message)
            if kept is not None:
                recorder.write(*kept)
    return path


def with_pose(message: Message, time: int, body: int, column: int, change: Any) -> Message:
    """The poses of `time` with one number changed."""
    name, when, data = message
    if name != '/icofabric/poses' or when != time:
        return message
    before = decode_pose_array(data)
    poses = PoseArrayBytes(before.frame_id, len(before.values))
    poses.values[:] = before.values
    poses.values[body, column] = change(poses.values[body, column])
    return name, when, poses.stamped(when)


def test_untouched_copy_is_identical(pushed: Path, tmp_path: Path) -> None:
    copy = changed_copy(pushed, tmp_path / 'copy', lambda message: message)
    assert verify(pushed).verdict == verify(copy).verdict == 'identical'
    assert verify(copy).compared == verify(pushed).compared
    assert verify(copy).repeated['inputs'] == 3


def test_one_bit_of_one_pose_is_found(pushed: Path, tmp_path: Path) -> None:
    times = pose_times(pushed)
    copy = changed_copy(pushed, tmp_path / 'copy', lambda message: with_pose(
        message, times[7], 5, 2, lambda value: np.nextafter(value, 1.0)))
    result = verify(copy)
    assert result.verdict == 'differs' and result.difference is not None
    assert result.difference[::2] == (times[7], '/icofabric/poses')
    assert result.difference.step > 0
    assert result.difference.text.startswith('body 5: position z [m] ')
    with RecordedRun(pushed) as run:
        [frame] = run.poses([times[7]])
    assert f'{frame.position[5, 2]!r} simulated again' in result.lines()[-1].replace(
        repr(float(frame.position[5, 2])), repr(frame.position[5, 2]))
    assert f't = {seconds(times[7]):.9f} s' in result.lines()[-1]


def pose_times(path: Path) -> list[int]:
    with RecordedRun(path) as run:
        return run.pose_times().tolist()


def test_missing_input_is_found_when_it_should_have_acted(pushed: Path, tmp_path: Path) -> None:
    copy = changed_copy(
        pushed, tmp_path / 'copy',
        lambda message: None if is_push(message) else message)
    result = verify(copy)
    assert result.difference is not None
    after = min(time for time in pose_times(pushed) if time > PUSH_START)
    assert result.difference.nanoseconds == after and result.repeated['inputs'] == 1
    assert result.difference.text.startswith('body ')


def is_push(message: Message) -> bool:
    return message[:2] == ('/icofabric/loads/tip', PUSH_START)


def test_other_time_of_an_input_is_found(pushed: Path, tmp_path: Path) -> None:
    def later(message: Message) -> Message:
        name, time, data = message
        return (name, time + 1, data) if is_push(message) else message

    with BagReader(pushed) as reader:
        messages = [later(message) for message in reader.messages()]
        messages.sort(key=lambda message: message[1])
        topics, custom = reader.topics, reader.custom
    with BagRecorder(tmp_path / 'copy', custom=custom) as recorder:
        for name, topic in topics.items():
            recorder.add_topic(name, topic.type_name)
        for message in messages:
            if message[0] != '/icofabric/recording':
                recorder.write(*message)
    result = verify(tmp_path / 'copy')
    assert result.difference is not None
    assert result.difference.nanoseconds == min(
        time for time in pose_times(pushed) if time > PUSH_START)


def test_other_stiffness_is_found(pushed: Path, tmp_path: Path) -> None:
    def stiffer(message: Message) -> Message:
        name, time, data = message
        if name != '/icofabric/weave':
            return message
        with RecordedRun(pushed) as run:
            [(_, text)] = run.scene_texts()
        assert 'stiffness: 500.0' in text
        return name, time, StringBytes(
            text.replace('stiffness: 500.0', 'stiffness: 500.00000000000006', 1)).to_bytes()

    result = verify(changed_copy(pushed, tmp_path / 'copy', stiffer))
    assert result.difference is not None
    assert 0 <= result.difference.nanoseconds <= pose_times(pushed)[1]


@pytest.mark.parametrize(('topic', 'words'), [
    ('/clock', '1 ns'), ('/icofabric/energy', 'kinetic energy [J]'),
    ('/icofabric/connectors', 'point 0: x [m]')])
def test_every_output_is_looked_at(pushed: Path, tmp_path: Path, topic: str, words: str) -> None:
    found = []

    def changed(message: Message) -> Message:
        name, time, data = message
        if name != topic or time == 0 or found or is_marker_without_points(message):
            return message
        found.append(time)
        if topic == '/clock':
            return name, time, ClockBytes().stamped(time + 1)
        place = data.index(first_number(topic, data))
        return name, time, data[:place] + bytes([data[place] ^ 1]) + data[place + 1:]

    result = verify(changed_copy(pushed, tmp_path / 'copy', changed))
    assert result.difference is not None and result.difference.topic == topic
    assert [result.difference.nanoseconds] == found
    assert words in result.difference.text or topic == '/clock'


def is_marker_without_points(message: Message) -> bool:
    return message[0] == '/icofabric/connectors' and not len(
        decode_marker_points(message[2]).points)


def first_number(topic: str, data: bytes) -> bytes:
    values = decode_float64_multi_array(data).values if topic.endswith('energy') else (
        decode_marker_points(data).points)
    return np.float64(values.ravel()[0]).tobytes()


@pytest.mark.parametrize('event', ['reset', 'failed'])
def test_event_that_never_was_is_found(pushed: Path, tmp_path: Path, event: str) -> None:
    at = 150 * MILLISECOND
    facts = {'reset': {'time_reset': False}, 'failed': {'reason': 'none', 'target': at}}[event]
    told = []

    def invented(message: Message) -> Message:
        if message[1] < at or told:
            return message
        told.append(message)
        return '/icofabric/events', message[1], StringBytes(
            json.dumps({'event': event, **facts})).to_bytes()

    result = verify(changed_copy(pushed, tmp_path / 'copy', invented))
    assert result.difference is not None and result.difference.nanoseconds >= at
    assert ('the simulation continues' in result.difference.text) == (event == 'failed')


# Elsewhere.

def shaken(pushed: Path, path: Path, size: float, **custom: str) -> Path:
    """A copy by another processor, whose poses differ by noise of `size` [m]."""
    generator = np.random.default_rng(2)

    def noisy(message: Message) -> Message:
        name, time, data = message
        if name != '/icofabric/poses':
            return message
        before = decode_pose_array(data)
        poses = PoseArrayBytes(before.frame_id, len(before.values))
        poses.values[:] = before.values
        if time:
            poses.values[:, :3] += size * generator.uniform(-1.0, 1.0, (len(before.values), 3))
        return name, time, poses.stamped(time)

    return changed_copy(pushed, path, noisy, **{'processor': 'abacus', **custom})


def test_other_machine_is_compared_within_tolerance_and_growth(
    pushed: Path, tmp_path: Path
) -> None:
    near = verify(shaken(pushed, tmp_path / 'near', 1e-12))
    assert near.verdict == 'consistent' and near.compared['~/poses'] > 5
    assert set(near.compared) == {'~/poses'} and 'abacus' in '\n'.join(near.lines())
    assert 'largest difference' in near.note
    far = verify(shaken(pushed, tmp_path / 'far', 1e-4, version='0.0.1'))
    assert far.verdict == 'differs' and far.difference is not None
    assert far.difference.nanoseconds == pose_times(pushed)[1]
    assert 'tolerance and growth explain' in far.difference.text
    assert any('0.0.1' in part for part in far.elsewhere)


def test_other_machine_and_a_wrong_run(pushed: Path, tmp_path: Path) -> None:
    copy = changed_copy(
        pushed, tmp_path / 'copy',
        lambda message: None if is_push(message) else message,
        processor='abacus')
    result = verify(copy)
    assert result.verdict == 'differs' and result.difference is not None
    assert PUSH_START < result.difference.nanoseconds < PUSH_START + 50 * MILLISECOND


def test_chaotic_run_elsewhere_says_how_far_it_means_something(tmp_path: Path) -> None:
    scene = lively_scene(**{
        'initial_random.velocity_sigma': 1.0, 'initial_random.spin_sigma': 60.0,
        'duration': 1.5, 'clock_rate': 60.0, 'solver.tolerance': 1e-5})
    Drive(tmp_path / 'bag', scene, random_pushes(3, 4, 900)).run()
    copy = changed_copy(
        tmp_path / 'bag', tmp_path / 'copy', lambda message: message, processor='abacus')
    result = verify(copy)
    assert result.verdict == 'consistent' and result.left_out['~/poses'] > 5
    assert 'poses are meaningless' in result.note and result.compared['~/poses'] > 5


# Anywhere in between.

def test_state_at_any_recorded_moment(pushed: Path, tmp_path: Path) -> None:
    times = pose_times(pushed)
    for time in (times[0], times[9], times[-1]):
        with RecordedRun(pushed) as run:
            simulation = resimulate_to(run, time)
            [frame] = run.poses([time])
        assert simulation.time == seconds(time)
        assert simulation.snapshot().position.tobytes() == frame.position.tobytes()


def test_state_in_between_goes_on_to_the_same_bits(tmp_path: Path) -> None:
    scene = lively_scene()
    Drive(tmp_path / 'bag', scene, in_order(random_pushes(8, 20, 180), [
        (60, lambda drive: drive.change(connector__stiffness=700.0)),
        (100, lambda drive: drive.save())])).run()
    with RecordedRun(tmp_path / 'bag') as run:
        saved = run.times_of(CHECKPOINT.name)
        assert len(saved) == 1
        whole, again = [resimulate_to(run, time) for time in (saved[0] - 1, 287_654_321)]
        [frame] = run.poses([400 * MILLISECOND])
    assert again.time == 0.287654321 and whole.time < again.time
    again.advance_to(0.4)
    assert again.snapshot().position.tobytes() == frame.position.tobytes()


def test_start_at_a_checkpoint_and_stop_before_the_end(tmp_path: Path) -> None:
    Drive(tmp_path / 'bag', lively_scene(), in_order(random_pushes(9, 20, 380), [
        (100, lambda drive: drive.save()), (200, lambda drive: drive.save())])).run()
    whole = verify(tmp_path / 'bag')
    late = verify(tmp_path / 'bag', start=250 * MILLISECOND)
    middle = verify(tmp_path / 'bag', start=150 * MILLISECOND, stop=300 * MILLISECOND)
    assert [result.verdict for result in (whole, late, middle)] == ['identical'] * 3
    assert whole.start == 0 < middle.start < late.start < 250 * MILLISECOND
    assert middle.start >= 100 * MILLISECOND and middle.end == 300 * MILLISECOND
    assert 0 < middle.compared['~/poses'] < whole.compared['~/poses']
    assert late.repeated['begun at a checkpoint'] == 1


def test_recovered_bag_verifies_to_its_end(tmp_path: Path) -> None:
    Drive(tmp_path / 'bag', lively_scene(), random_pushes(4, 20, 380)).run()
    [whole] = (tmp_path / 'bag').glob('*.mcap')
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(whole.read_bytes()[:-4000])
    recover_bag(cut, tmp_path / 'saved')
    result = verify(tmp_path / 'saved')
    assert result.verdict == 'identical' and result.compared['~/poses'] > 5


def test_scene_with_a_given_inner_edge_is_read_back(tmp_path: Path) -> None:
    scene = swing_scene(**{'shell.inner_edge_length': 0.017, 'duration': 0.05})
    Drive(tmp_path / 'bag', scene, []).run()
    assert verify(tmp_path / 'bag').verdict == 'identical'


# The command.

def test_command_says_identical(pushed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['verify', str(pushed), '--threads', '2']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1].startswith('identical: ') and '19 poses' in lines[-1]
    assert f't = 0 s to {DURATION:g} s' in lines[-1]
    text = '\n'.join(lines)
    assert '3 inputs' in text and '14 bodies' in text and 'bit by bit' in text


def test_command_says_what_differs_and_goes_on_with_the_next(
    pushed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    times = pose_times(pushed)
    copy = changed_copy(pushed, tmp_path / 'copy', lambda message: with_pose(
        message, times[3], 4, 5, lambda value: -value))
    assert main(['verify', str(copy), str(pushed)]) == 1
    out = capsys.readouterr().out
    assert f'differs at t = {seconds(times[3]):.9f} s (step ' in out
    assert '/icofabric/poses: body 4: orientation z ' in out and 'identical: ' in out


def bags_that_are_none(folder: Path, pushed: Path) -> Iterator[tuple[list[str], str]]:
    """Arguments, and words of the refusal."""
    yield [str(folder / 'nowhere')], 'does not exist'
    (folder / 'empty').mkdir()
    yield [str(folder / 'empty')], 'not a bag'
    (folder / 'note.txt').write_text('hello')
    yield [str(folder / 'note.txt')], 'not a bag'
    with BagRecorder(folder / 'clock') as recorder:
        recorder.add_topic('/clock', ClockBytes.TYPE)
        recorder.write('/clock', 5, ClockBytes().stamped(5))
    yield [str(folder / 'clock')], 'was not recorded by this simulator'
    changed_copy(
        pushed, folder / 'bare',
        lambda message: None if message[0].endswith('/weave') else message)
    yield [str(folder / 'bare')], 'does not begin with its scene'
    changed_copy(pushed, folder / 'twist', lambda message: message)
    yield [str(pushed), '--node', '/other'], 'unknown fabric; '
    yield [str(pushed), '--start', '5'], '--start 5 s lies after the end'
    yield [str(pushed), '--start', '-1'], '--start must be'
    yield [str(pushed), '--start', '0.2', '--stop', '0.1'], '--stop 0.1 s lies before'
    yield [str(pushed), '--threads', '-1'], '--threads must be'


def test_command_refuses_what_nobody_can_verify(
    pushed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    count = 0
    for arguments, words in bags_that_are_none(tmp_path, pushed):
        assert main(['verify', *arguments]) == 2, arguments
        captured = capsys.readouterr()
        assert words in captured.err and captured.err.startswith('icofabric verify: ')
        count += 1
    assert count == 10


def test_checkpoint_of_another_version_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as context:
        context.setattr('icofabric_sim.simulation.checkpoints.checkpoint.__version__', '0.0.7')
        Drive(tmp_path / 'bag', lively_scene(), [(50, lambda drive: drive.record(True))]).run()
    assert main(['verify', str(tmp_path / 'bag')]) == 0
    assert main(['verify', str(tmp_path / 'bag_1')]) == 2
    assert '0.0.7' in capsys.readouterr().err


def test_damaged_bag_is_the_fault_of_the_file(pushed: Path, tmp_path: Path) -> None:
    [whole] = pushed.glob('*.mcap')
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(whole.read_bytes()[:-2500])
    assert main(['verify', str(cut)]) == 1


def test_interrupt_ends_it(pushed: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from icofabric_sim.running.replay import verify as module

    def interrupted(*arguments: Any, **choices: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(module, 'verify_run', interrupted)
    assert main(['verify', str(pushed)]) == 130


def test_several_fabrics_in_one_bag(pushed: Path, tmp_path: Path) -> None:
    with BagReader(pushed) as reader:
        messages, topics, custom = list(reader.messages()), reader.topics, reader.custom
    with BagRecorder(tmp_path / 'two', custom=custom) as recorder:
        names = [name for name in topics if name.startswith('/icofabric/')]
        for name in topics:
            recorder.add_topic(name, topics[name].type_name)
        for name in names:
            recorder.add_topic(f'/b{name}', topics[name].type_name)
        for name, time, data in messages:
            if name != '/icofabric/recording':
                recorder.write(name, time, data)
            if name in names:
                recorder.write(f'/b{name}', time, data)
    with RecordedRun(tmp_path / 'two') as run:
        assert run.nodes == ['/b/icofabric', '/icofabric']
    assert main(['verify', str(tmp_path / 'two')]) == 0
    with RecordedRun(tmp_path / 'two', '/icofabric') as run:
        result = verify_run(run)
        assert len(run.inputs()) == 3
    assert result.node == '/icofabric' and result.verdict == 'identical'
    # Nobody knows whose clock it was.
    assert result.left_out['/clock'] > 0


def test_files_of_a_split_bag_are_read_by_themselves(tmp_path: Path, capsys: Any) -> None:
    path = tmp_path / 'bag'
    record_push(path, swing_scene(**{
        'record.split_duration': 0.12, 'groups.top': 'z_max', 'publish.group': 'top'}))
    files = sorted(path.glob('*.mcap'))
    assert len(files) == 3 and verify(path).verdict == 'identical'
    result = verify(files[0])
    assert result.verdict == 'identical' and result.compared['~/poses'] > 5
    for number, file in enumerate(files):
        summary = summarise_bag(file)
        last = number == 2
        assert summary.rows()[-1] == ('end', 'closed properly' + (
            '' if last else f'; the run continues in bag_{number + 1}.mcap'))
        assert ('file' in dict(summary.rows())) == (number > 0)
        assert summary.scene is not None and summary.last is not None
        with ReplaySource(file) as source:
            assert source.lacks == ''
            sent = [topic.name for topic, _ in source.state_at(source.start).messages]
            assert {'~/weave', '~/bodies', '~/broken'} <= set(sent)
        if number:
            with pytest.raises(NotRepeatable, match=f'file {number} of a split bag.*the folder'):
                verify(file)
    assert main(['info', str(files[1])]) == 0 and 'was killed' not in capsys.readouterr().out
    # A checkpoint is enough to begin at.
    drive = Drive(tmp_path / 'driven', swing_scene(**{'record.split_duration': 0.12}), [
        (150, lambda drive: drive.save())]).run()
    with RecordedRun(drive.bag.path / 'driven_1.mcap') as run:
        [time] = run.times_of(CHECKPOINT.name)
        result = verify_run(run, start=time)
    assert result.verdict == 'identical' and result.start == time
    assert result.compared['~/poses'] > 3
