# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Recorded runs read back: poses, markers and inputs against a direct simulation, and their summary.
"""

from pathlib import Path
import re

from driven_runs import Drive, lively_scene
from icofabric_sim.bag import BagError, BagRecorder, recover_bag
from icofabric_sim.bag.event_text import describe_event, digest_events, event_rows
from icofabric_sim.bag.recorded_run import active_inputs, RecordedEvent, RecordedRun
from icofabric_sim.bag.summary import span_text, summarise_bag
from icofabric_sim.commands.main import main
from icofabric_sim.messages import ClockBytes, PoseArrayBytes, StringBytes
from icofabric_sim.messages.schedule import seconds
from icofabric_sim.messages.topics import STRAIN_CLASSES
from icofabric_sim.simulation.simulation import compile_scene
import numpy as np
import pytest
from recorded_runs import DURATION, FORCE, PUSH_END, PUSH_START, record_push, swing_scene


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('bags') / 'swing'
    record_push(path, swing_scene())
    return path


def test_poses_with_inputs_are_those_of_a_direct_run(bag: Path) -> None:
    scene = swing_scene()
    simulation, untouched = compile_scene(scene), compile_scene(scene)
    simulation.apply_wrench('tip', FORCE, time=seconds(PUSH_START))
    simulation.apply_body_wrench(3, (0.1, 0.0, 0.0), time=seconds(PUSH_START))
    simulation.apply_wrench('tip', time=seconds(PUSH_END))
    with RecordedRun(bag) as run:
        times = run.pose_times()
        assert times[0] == 0 and times[-1] == round(DURATION * 1e9)
        for frame in run.poses():
            simulation.advance_to(frame.time)
            state = simulation.snapshot()
            np.testing.assert_array_equal(frame.position, state.position)
            np.testing.assert_array_equal(frame.orientation, state.orientation)
    untouched.advance_to(DURATION)
    assert np.abs(untouched.snapshot().position - state.position).max() > 1e-3


def test_chosen_poses_and_their_order(bag: Path) -> None:
    with RecordedRun(bag) as run:
        times = run.pose_times()
        assert (np.diff(times) > 0).all()
        chosen = [frame.nanoseconds for frame in run.poses([times[7], times[2], 5])]
        assert chosen == [times[2], times[7]]


def test_scene_is_the_one_that_was_recorded(bag: Path) -> None:
    with RecordedRun(bag) as run:
        scene = run.scene_at(run.start)
        assert scene is run.scene_at(run.end)
    expected = swing_scene()
    assert dict(scene.parameters) == dict(expected.parameters)
    np.testing.assert_array_equal(scene.connectors.bodies, expected.connectors.bodies)


def test_markers_are_the_connectors_of_that_time(bag: Path) -> None:
    simulation = compile_scene(swing_scene())
    # Steps end where the loads change.
    simulation.apply_wrench('tip', FORCE, time=seconds(PUSH_START))
    simulation.apply_body_wrench(3, (0.1, 0.0, 0.0), time=seconds(PUSH_START))
    simulation.advance_to(0.1)
    ends, obstructed = simulation.snapshot().connector_ends, simulation.snapshot().obstructed > 0
    strain = simulation.snapshot().connector_length / (
        simulation.scene.connectors.natural_length) - 1.0
    with RecordedRun(bag) as run:
        for time in (100_000_000, 150_000_000):
            markers = run.markers(time)
            points = np.vstack([marker.points.reshape(-1, 2, 3) for marker in markers])
            assert sorted(map(tuple, points.reshape(-1, 6))) == sorted(
                map(tuple, ends.reshape(-1, 6)))
            bounds = [*(entry.above for entry in STRAIN_CLASSES), np.inf]
            for marker in markers:
                if marker.marker_id < len(STRAIN_CLASSES):
                    inside = (strain > bounds[marker.marker_id]) & (
                        strain <= bounds[marker.marker_id + 1]) & ~obstructed
                else:
                    inside = obstructed
                assert len(marker.points) == 2 * inside.sum() > 0
        assert sum(len(marker.points) for marker in run.markers(0)) == 2 * len(ends)


def test_inputs_with_the_times_at_which_they_acted(bag: Path) -> None:
    with RecordedRun(bag) as run:
        inputs = run.inputs()
    assert [(entry.nanoseconds, entry.topic) for entry in inputs] == [
        (PUSH_START, '/icofabric/loads/tip'), (PUSH_START, '/icofabric/wrench'),
        (PUSH_END, '/icofabric/loads/tip')]
    np.testing.assert_array_equal(inputs[0].force, FORCE)
    assert inputs[1].frame_id == 'icosahedron_3'
    assert not inputs[0].is_zero and inputs[2].is_zero
    assert active_inputs(inputs, PUSH_START - 1) == []
    assert len(active_inputs(inputs, PUSH_START)) == 2
    assert active_inputs(inputs, PUSH_END) == [inputs[1]]


def test_summary_says_what_happened(bag: Path) -> None:
    summary = summarise_bag(bag)
    assert summary.first is not None and summary.last is not None
    distance, body = summary.largest_displacement
    moved = np.linalg.norm(summary.last.position - summary.first.position, axis=1)
    assert distance == moved.max() > 0.0 and moved[body] == distance
    text = '\n'.join(summary.lines())
    for words in (
        '14 bodies, 36 connectors', '/icofabric/poses: 19 messages, 60 Hz', '0 s to 0.3 s',
        't = 0.1 s  /icofabric/loads/tip: force [0, 0.75, 0] N', '(icosahedron_3)',
        't = 0.2 s  /icofabric/loads/tip: cleared', 'numba', 'closed properly', '1 thread',
        '/icofabric/energy: 19 messages', 'solver.tolerance is 1e-06',
        'are close to each other, and driven',
        f'error estimate {float(summary.custom["error_estimate"]):.2g} in total',
        f'largest energy error {float(summary.custom["balance_worst"]):.1e} of',
    ):
        assert words in text, words
    assert re.search('^method +dop8', text, re.MULTILINE)
    # Nobody measured it.
    assert not re.search('^growth', text, re.MULTILINE)


@pytest.mark.parametrize('custom, words', [
    ({'growth': '3e+30', 'meaningful_until': '0.25'},
     'grew 3e+30 times; the trajectory is meaningful until t = 0.25 s'),
    ({'growth': '12.0', 'growth_is_at_least': 'true', 'meaningful_until': 'inf'},
     'grew at least 12 times; the trajectory is meaningful to the end'),
    ({'growth': 'inf', 'meaningful_until': '0.5'}, 'grew more than 1e308 times'),
    ({'tolerance': '0.0001'}, 'not measured; solver.tolerance is 0.0001 per second'),
    ({'tolerance': 'no number', 'growth': 'nor this'}, 'nan'),
    ({'balance_worst': '0.002', 'threads': '2', 'processor': 'x'}, '2 threads'),
])
def test_figures_of_the_accuracy(tmp_path: Path, custom: dict[str, str], words: str) -> None:
    with BagRecorder(tmp_path / 'bag', custom=custom | {'method': 'srkn6'}) as recorder:
        recorder.add_topic('/clock', ClockBytes.TYPE)
        recorder.write('/clock', 0, ClockBytes().stamped(0))
    assert words in '\n'.join(summarise_bag(tmp_path / 'bag').lines())


def test_failure_and_overlap_of_the_run_are_in_the_summary(tmp_path: Path) -> None:
    custom = {'failure': 'solver.step has become unsafe', 'proximity': 'bodies 1 and 2 came close'}
    with BagRecorder(tmp_path / 'bag', custom=custom) as recorder:
        recorder.add_topic('/clock', ClockBytes.TYPE)
        recorder.write('/clock', 0, ClockBytes().stamped(0))
    summary = summarise_bag(tmp_path / 'bag')
    assert summary.failure == custom['failure'] and summary.overlap_text == custom['proximity']
    assert summary.first is None and summary.largest_displacement == (0.0, -1)
    assert all(value in '\n'.join(summary.lines()) for value in custom.values())


def test_what_was_done_to_the_run_is_in_the_summary(tmp_path: Path) -> None:
    Drive(tmp_path / 'bag', lively_scene(step_count=5), [
        (20, lambda drive: drive.pause_and_step()),
        (40, lambda drive: drive.save()),
        (60, lambda drive: drive.change(connector__stiffness=300.0)),
        (80, lambda drive: drive.push(13, (0.1, 0.0, 0.0))),
        (90, lambda drive: drive.change(weave__size=[2, 2, 2])),
        (99, lambda drive: drive.reset()),
    ]).run()
    text = '\n'.join(summarise_bag(tmp_path / 'bag').lines())
    for words in (
        '2 fabric changes, 1 reset, 4 pauses, 1 call of ~/step, 1 checkpoint saved',
        '5 solver steps taken', 't = 0.06 s  rebuilt with: connector.stiffness',
        't = 0.09 s  re-woven with: weave.size; wrenches ended: body 13',
        f'a checkpoint was saved to {tmp_path}', 'checkpoints  t = 0.04 s (in the bag)',
    ):
        assert words in text, words


def test_events_of_another_version_are_told_as_far_as_they_are_known() -> None:
    def told(name: str, **facts: object) -> str:
        return describe_event(RecordedEvent(10**9, name, facts))

    assert told('new_thing', speed=3) == 'new_thing'
    assert told('reset', time_reset=True, dropped=3) == (
        'reset to the initial state and to time 0 (3 waiting wrenches dropped)')
    assert told('reweave', changed=['a', 'b', 'c', 'd', 'e', 'f'], lost=3) == (
        'rebuilt with: a, b, c, d and 2 more')
    assert 'None' in told('failed') and 'x.checkpoint' in told(
        'checkpoint_restored', path='x.checkpoint', of=0.5)
    assert told('state_set', body=3) == 'body 3 was set to a new state'
    assert [told('record', on=on) for on in (True, False)] == ['recording on', 'recording off']
    rows = event_rows(digest_events(RecordedEvent(k, 'step', {}) for k in range(1000)))
    assert rows[0] == ('events', '1,000 calls of ~/step') and len(rows) < 20
    assert rows[-1] == ('', '... and 988 more')


def test_event_that_is_none_is_a_bag_error(tmp_path: Path) -> None:
    for number, text in enumerate(('[1]', 'not json', '{"speed": 3}')):
        with BagRecorder(tmp_path / str(number)) as recorder:
            recorder.add_topic('/icofabric/poses', PoseArrayBytes.TYPE)
            recorder.add_topic('/icofabric/events', StringBytes.TYPE)
            recorder.write('/icofabric/poses', 5, PoseArrayBytes('world', 1).stamped(5))
            recorder.write('/icofabric/events', 5, StringBytes(text).to_bytes())
        with RecordedRun(tmp_path / str(number)) as run:
            with pytest.raises(BagError, match='an invalid event at t = 5e-09 s'):
                list(run.events())


def test_damaged_bag_is_refused_and_its_recovered_copy_is_not(bag: Path, tmp_path: Path) -> None:
    whole = next(bag.glob('*.mcap'))
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(whole.read_bytes()[:-2500])
    with pytest.raises(BagError, match='icofabric recover'):
        summarise_bag(cut)
    recover_bag(cut, tmp_path / 'saved')
    assert '14 bodies' in '\n'.join(summarise_bag(tmp_path / 'saved').lines())


def test_bag_without_the_last_word_of_its_recorder(tmp_path: Path) -> None:
    with BagRecorder(tmp_path / 'bag', custom={'version': '0.1.0'}) as recorder:
        recorder.add_topic('/clock', ClockBytes.TYPE)
        recorder.write('/clock', 0, ClockBytes().stamped(0))
    text = '\n'.join(summarise_bag(tmp_path / 'bag').lines())
    assert 'the recorder was killed' in text and 'closed properly' not in text


def test_bag_of_something_else_is_told_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    with BagRecorder(tmp_path / 'clock') as recorder:
        recorder.add_topic('/clock', ClockBytes.TYPE)
        recorder.write('/clock', 5, ClockBytes().stamped(5))
    assert 'no data of this simulator' in '\n'.join(summarise_bag(tmp_path / 'clock').lines())
    with RecordedRun(tmp_path / 'clock') as run, pytest.raises(BagError, match='no poses'):
        run.pose_times()
    poses = PoseArrayBytes('world', 2)
    with BagRecorder(tmp_path / 'poses') as recorder:
        recorder.add_topic('/robot/poses', PoseArrayBytes.TYPE)
        recorder.write('/robot/poses', 5, poses.stamped(5))
    with RecordedRun(tmp_path / 'poses') as run:
        assert len(run.pose_times()) == 1
        with pytest.raises(BagError, match='does not contain its scene'):
            run.scene_at(5)
    assert main(['view', str(tmp_path / 'poses')]) == 2
    assert 'does not contain its scene (/robot/weave)' in capsys.readouterr().err


def test_scene_that_cannot_be_built_is_named(tmp_path: Path) -> None:
    text = '/**: {ros__parameters: {weave: {size: [0, 1, 1]}}}'
    with BagRecorder(tmp_path / 'bag') as recorder:
        recorder.add_topic('/icofabric/poses', PoseArrayBytes.TYPE)
        recorder.add_topic('/icofabric/weave', StringBytes.TYPE)
        recorder.write('/icofabric/weave', 0, StringBytes(text).to_bytes())
        recorder.write('/icofabric/poses', 0, PoseArrayBytes('world', 1).stamped(0))
    with RecordedRun(tmp_path / 'bag') as run, pytest.raises(BagError, match='weave.size'):
        run.scene_at(0)


def test_malformed_message_is_a_bag_error(tmp_path: Path) -> None:
    with BagRecorder(tmp_path / 'bag') as recorder:
        recorder.add_topic('/icofabric/poses', PoseArrayBytes.TYPE)
        recorder.write('/icofabric/poses', 0, PoseArrayBytes('world', 3).stamped(0)[:-9])
    with RecordedRun(tmp_path / 'bag') as run, pytest.raises(BagError, match='malformed'):
        list(run.poses())


def test_span_of_a_bag_of_another_tool_is_told_from_its_start():
    assert span_text(0, 1_500_000_000) == '0 s to 1.5 s of simulated time'
    start = 1_795_870_000 * 10**9
    assert span_text(start, start + 12_300_000_000) == '12.3 s from 2026-11-28 12:46:40 UTC'
