# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
What a run has of connectors that break: `~/broken`, markers, figures, bags and what reads them.
"""

import icofabric_sim as ico
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.bag.summary import summarise_bag
from icofabric_sim.commands.run_summary import run_summary
from icofabric_sim.messages import (
    decode_diagnostic_array,
    decode_float64_multi_array,
    decode_marker_points,
)
from icofabric_sim.messages.schedule import seconds
from icofabric_sim.messages.topics import BROKEN, CONNECTORS, POSES, Recorded
from icofabric_sim.parameters.example_scenes import example_scenes
from icofabric_sim.pictures.render import draw_sheet
from icofabric_sim.running.diagnostics import HealthReport
from icofabric_sim.running.replay.verify import verify_run
from icofabric_sim.running.run_monitor import RunMonitor
from icofabric_sim.running.runner import Runner
import numpy as np
import pytest
from recorded_runs import record_run
from runner_helpers import ListSink

SCENE = ico.load_scene(example_scenes()['torn_slab'])


def torn(**changes):
    """An example scene that breaks in two within 2 ms; outputs before, meanwhile and after."""
    return ico.Scene.from_parameters(SCENE.parameters.with_changes({
        'duration': 0.004, 'real_time_factor': 0.0, 'publish_rate': 3000.0,
        'marker_rate': 1000.0, **{name.replace('__', '.'): to for name, to in changes.items()}}))


@pytest.fixture(scope='module')
def played():
    """A run with all that it sent."""
    sink = ListSink(BROKEN, CONNECTORS, POSES)
    runner = Runner(ico.compile_scene(torn()), [sink])
    monitor = RunMonitor(runner.simulation)
    runner.run(until_finished=True)
    assert not runner.failure and runner.simulation.status.broken_count == 40
    monitor.look(runner.simulation.snapshot())
    return runner, sink, monitor


def rows(data):
    """Rows of a message on `~/broken`."""
    message = decode_float64_multi_array(data)
    assert list(message.labels) == ['break', 'connector, time of breakage']
    return np.array(message.values).reshape(-1, 2)


def test_breaks_are_told_once_in_order_of_time(played):
    runner, sink, _ = played
    told = sink.of(BROKEN)
    assert BROKEN.latched and BROKEN.recorded is Recorded.ALWAYS
    assert told[0][0] == 0 and len(rows(told[0][1])) == 0
    counts = [len(rows(data)) for _, data in told]
    assert counts[-1] == 40 and (np.diff(counts) > 0).all() and len(counts) > 3
    snapshot = runner.simulation.snapshot()
    last = rows(told[-1][1])
    for time, data in told:
        now = rows(data)
        # All that broke until then, which is the beginning of all.
        assert np.array_equal(now, last[:len(now)])
        assert (snapshot.break_time <= seconds(time)).sum() == len(now)
    assert (np.diff(last[:, 1]) >= 0.0).all()
    assert np.array_equal(snapshot.break_time[last[:, 0].astype(int)], last[:, 1])
    assert np.array_equal(np.sort(last[:, 0]), np.flatnonzero(~snapshot.intact))


def test_markers_leave_out_what_is_broken(played):
    runner, sink, _ = played
    shown = {}
    for time, data in sink.of(CONNECTORS):
        marker = decode_marker_points(data)
        shown.setdefault(time, {})[marker.marker_id] = np.array(marker.points).reshape(-1, 2, 3)
    drawn = {time: np.concatenate([*lists.values()]) for time, lists in shown.items()}
    simulation = ico.compile_scene(runner.simulation.scene)
    for time, ends in sorted(drawn.items()):
        simulation.advance_to(seconds(time))
        snapshot = simulation.snapshot()
        assert len(ends) == snapshot.intact.sum()
        wanted = snapshot.connector_ends[snapshot.intact]
        assert np.array_equal(np.sort(ends.ravel()), np.sort(wanted.ravel()))
    assert len(ends) == len(snapshot.intact) - 40


def test_a_reset_tells_that_all_are_whole():
    sink = ListSink(BROKEN)
    simulation = ico.compile_scene(torn(duration=0.0))
    simulation.advance_to(0.003)
    count = simulation.status.broken_count
    runner = Runner(simulation, [sink])
    done = runner.reset()
    done.add_done_callback(lambda _: runner.stop())
    runner.run()
    counts = [len(rows(data)) for _, data in sink.of(BROKEN)]
    assert 0 < count == counts[0] and counts[1] == 0


def test_figures_and_summaries_count_breaks(played):
    runner, _, monitor = played
    _, [status] = decode_diagnostic_array(HealthReport('/icofabric').bytes(runner.status()))
    assert dict(status.values)['breaks'] == '40'
    text = '\n'.join(text for _, text in run_summary(
        'torn', runner.simulation, monitor, runner.status(), 1.0, 0.0, errors=None, growth=None,
        bag=None, interrupted=False))
    assert '40 of 296 connectors, from t = 0.00' in text and 'J dissipated' in text
    # What is broken has no strain; the others have.
    assert 0.0 < monitor.stretch.value < 0.02


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """A recorded run."""
    path = tmp_path_factory.mktemp('torn') / 'bag'
    record_run(path, torn())
    return path


def test_a_recorded_run_verifies_with_its_breaks(bag):
    with RecordedRun(bag) as run:
        result = verify_run(run)
        told = run.breaks()
    assert result.verdict == 'identical', result.lines()
    assert len(told[0][1]) == 0 and len(told[-1][1]) == 40


def test_a_bag_says_and_shows_what_broke(bag, tmp_path):
    text = '\n'.join(summarise_bag(bag).lines())
    assert '40 connectors, from t = 0.00' in text
    draw_sheet(bag, tmp_path / 'sheet.png', moments=2, size=(320, 240))
    assert (tmp_path / 'sheet.png').stat().st_size > 1000
