# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""When simulated time counts as standing still: slow, and by steps much shorter than at first."""

import math
import time

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.running import stall
from icofabric_sim.running.stall import StallWatch
import pytest
from runner_helpers import Beside, ListSink, make_runner

USUAL, BODIES, PERIOD = 1e4, 1000, 1.0 / 30.0


def begun():
    watch = StallWatch()
    watch.begin(USUAL, BODIES, PERIOD)
    return watch


def words(watch, rate, *, until, stages=12, start=0.0):
    """What is said while so many evaluations a second are taken up to a time."""
    said, steps, chunk = [], 0, 1e-3
    for k in range(int((until - start) / chunk)):
        steps = round(k * chunk * rate / stages)
        said.append(watch.note(start + k * chunk, steps, stages, lambda: 'the drive'))
    return [text for text in said if text]


@pytest.mark.parametrize(('rate', 'bodies', 'stalls'), [
    (2e3 * USUAL, BODIES, True), (0.5e3 * USUAL, BODIES, False),
    # Often for this scene, but few for a computer.
    (2e3 * USUAL, 5, True), (0.5e6, 5, False)])
def test_many_evaluations_over_several_outputs_are_a_stall(rate, bodies, stalls):
    watch = StallWatch()
    watch.begin(USUAL if rate > 1e6 else 1.0, bodies, PERIOD)
    said = words(watch, rate, until=2.0)
    assert bool(said) == stalls
    if stalls:
        assert 'needs 2e+07 force evaluations' in said[0] and 'usually needs 1e+04' in said[0]
        assert 'that of the drive' in said[0] and 'Reset the run' in said[0]


def test_short_burst_of_evaluations_is_no_stall():
    watch = begun()
    steps = 0
    for k in range(100):
        steps += 20_000 if k % 20 == 0 else 1  # every fifth output
        assert not watch.note(k * PERIOD, steps, 12, str)


def test_clock_that_does_not_move_at_all_is_a_stall():
    watch = begun()
    assert any(watch.note(1.0, steps, 12, str) for steps in range(0, 200_000, 1000))


def test_wall_time_does_not_matter(monkeypatch):
    # However long everything takes: what is counted are evaluations.
    for name in ('time', 'monotonic', 'perf_counter'):
        monkeypatch.setattr(time, name, lambda: pytest.fail('a clock was read'))
    assert not words(begun(), 0.9e3 * USUAL, until=1.0)


def test_contacts_that_the_scene_makes_stiff_are_usual():
    scene = make_scene((1, 1, 1), {
        'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -0.05,
        'contact.mode': 'always', 'contact.stiffness': 1e9, 'solver.method': 'dop8',
        'gravity': [0.0, 0.0, -9.81]})
    status = ico.compile_scene(scene).status
    contacts = status.contact_evaluation_rate
    assert contacts > 12.0 * math.sqrt(1e9 / scene.shell.mass)
    assert contacts > 1e3 * status.usual_evaluation_rate
    for rate, stalls in ((5.0 * contacts, False), (20.0 * contacts, True)):
        watch = StallWatch()
        watch.begin(status.usual_evaluation_rate, 1, PERIOD, contacts)
        assert bool(words(watch, rate, until=0.5)) == stalls


def test_run_that_stalls_stops_and_goes_on_after_a_reset(monkeypatch):
    monkeypatch.setattr(stall, '_MAX_BODY_RATE', 0.0)
    runner = make_runner(ListSink(), duration=0.0, start_paused=True)
    assert runner._time.stall is None  # who runs it to its end is patient
    runner._time.stall = StallWatch()
    with Beside(runner) as beside:
        runner._time.stall.begin(0.0, 1, 1.0)
        future = runner.advance()
        with pytest.raises(RuntimeError, match='advanced by.*almost stopped'):
            future.result(60.0)
        assert 'almost stopped' in runner.failure
        runner.reset().result(60.0)
        assert not runner.failure
        runner.set_paused(False)
        before = runner.now
        beside.wait_for(lambda: runner.now > before + 10**7)
        assert not runner.failure
