# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The same bits for any number of threads, and a number that suits the machine and the fabric."""

import logging
import os
import pickle
import signal

from fabrics import changed, LOADED, make_scene, RANDOM, same_state, SUPPORTED
import icofabric_sim as ico
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.simulation.stepping import thread_team
import numpy as np
import pytest

EVERYTHING = {
    **SUPPORTED, **LOADED, 'groups': {**SUPPORTED['groups'], **LOADED['groups']}, **RANDOM}


@pytest.fixture
def forced(monkeypatch):
    """A way to set how many cores there seem to be, with a team for the smallest fabric."""
    monkeypatch.setattr(thread_team, 'BODIES_PER_THREAD', 1)

    def force(count):
        monkeypatch.setattr(thread_team, 'core_count', lambda: count)
    return force


def run(scene, form, time):
    simulation = ico.compile_scene(scene, rotation=form)
    for end in (0.3 * time, time):
        simulation.advance_to(end)
        if scene.loads and end < time:
            simulation.apply_wrench('follower', (0.5, -1.0, 0.25), (0.001, 0.0, 0.0))
    return simulation, simulation.snapshot()


@pytest.mark.parametrize('method, form', [
    *((method, 'quaternion') for method in (*ico.METHODS, 'auto')),
    ('auto', 'direction_cosines'), ('leapfrog', 'direction_cosines')])
@pytest.mark.parametrize('size, sections', [
    ((2, 2, 1), RANDOM), ((3, 3, 3), EVERYTHING), ((9, 5, 7), EVERYTHING)],
    ids=['two bodies', 'all terms', 'all terms, larger'])
def test_same_bits_for_any_number_of_threads(size, sections, method, form, forced):
    # A rough tolerance: more threads than cores wait for each other long.
    scene = make_scene(
        size, {'solver.method': method, 'solver.tolerance': 1e-3},
        **sections)
    time = 0.004 if scene.body_count > 100 else 0.012
    forced(1)
    single, expected = run(scene, form, time)
    assert single.status.thread_count == 1
    for count in (2, 5):
        forced(count)
        simulation, snapshot = run(scene, form, time)
        assert simulation.status.thread_count == min(count, scene.body_count)
        assert same_state(snapshot, expected)
        assert simulation.status.step == single.status.step
        assert simulation.status.step_count == single.status.step_count
        assert simulation.error_estimate == single.error_estimate
        assert simulation.balance == single.balance
        assert simulation.status.proximity == single.status.proximity
    assert np.abs(expected.position - scene.initial.position).max() > 0.1 * time


@pytest.mark.parametrize('size, kind', [((12, 12, 12), 'orthogonal'), ((9, 9, 9), 'bias')])
def test_same_bits_for_large_fabrics(size, kind, forced):
    # Several tiles of blocks for each thread, and borders where these are not whole rows.
    scene = make_scene(size, {'weave.kind': kind, 'contact.mode': 'never'}, **EVERYTHING)
    states = []
    for count in (1, 2, 3):
        forced(count)
        simulation = ico.compile_scene(scene)
        assert simulation.status.thread_count == count
        simulation.advance_to(0.004)
        states.append(simulation.snapshot())
    assert all(same_state(states[0], other) for other in states[1:])
    assert simulation.status.step_count > 3


def test_same_bits_of_the_pair_with_direction_cosines(forced):
    # Without other terms: each of their combinations is one more thing to compile.
    states = []
    for count in (1, 3):
        forced(count)
        simulation = ico.compile_scene(
            make_scene((3, 3, 3), {'solver.method': 'dop8'}, **RANDOM),
            rotation='direction_cosines')
        simulation.advance_to(0.012)
        states.append(simulation.snapshot())
    assert same_state(*states)


def test_number_of_threads_is_a_parameter():
    scene = make_scene((3, 3, 3), {'solver.threads': 1})
    assert ico.compile_scene(scene).status.thread_count == 1


@pytest.mark.parametrize('wanted, cores, bodies, size', [
    (0, 8, 100_000, 8), (0, 8, 3_500, 3), (0, 8, 63, 1), (3, 8, 100_000, 3), (2, 8, 1_999, 1),
    (8, 8, 10**6, 8), (0, 1, 10**6, 1)])
def test_size_of_a_crew(wanted, cores, bodies, size, monkeypatch, caplog):
    monkeypatch.setattr(thread_team, 'core_count', lambda: cores)
    monkeypatch.setattr(thread_team, 'BODIES_PER_THREAD', 1_000)
    assert thread_team.size_for(wanted, bodies) == size
    assert not caplog.records


def test_loose_shells_are_worth_more_threads_each(monkeypatch):
    monkeypatch.setattr(thread_team, 'core_count', lambda: 2)
    monkeypatch.setattr(thread_team, 'BODIES_PER_THREAD', 1_000)
    assert [thread_team.size_for(0, bodies, loose=True) for bodies in (999, 1_000)] == [1, 2]
    assert thread_team.size_for(0, 1_000) == 1


def test_more_threads_than_cores_are_clamped_with_a_warning(monkeypatch, caplog):
    monkeypatch.setattr(thread_team, 'core_count', lambda: 2)
    monkeypatch.setattr(thread_team, 'BODIES_PER_THREAD', 1)
    scene = make_scene((3, 3, 3), {'solver.threads': 64}, **RANDOM)
    with caplog.at_level(logging.WARNING):
        simulation = ico.compile_scene(scene)
    assert simulation.status.thread_count == 2
    assert [record.getMessage() for record in caplog.records] == [
        'solver.threads 64 is more than the 2 cores of this machine: 2 are used; the result does '
        'not depend on it']
    simulation.advance_to(0.01)
    alone = ico.compile_scene(changed(scene, {'solver.threads': 1}))
    alone.advance_to(0.01)
    assert same_state(simulation.snapshot(), alone.snapshot())


def test_a_forked_child_continues_to_the_same_bits(forced):
    forced(2)
    simulation = ico.compile_scene(make_scene((3, 3, 3), **RANDOM))
    simulation.advance_to(0.001)
    start, reader, writer = simulation.snapshot(), *os.pipe()
    child = os.fork()
    if not child:
        # Ends a child that waits for threads which are not there.
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(60)
        try:
            simulation.advance_to(0.01)
            os.write(writer, pickle.dumps(simulation.snapshot()))
        finally:
            os._exit(0)
    os.close(writer)
    simulation.advance_to(0.01)
    assert simulation.status.thread_count == 2
    with os.fdopen(reader, 'rb') as pipe:
        sent = pipe.read()
    assert os.waitpid(child, 0)[1] == 0
    assert same_state(pickle.loads(sent), simulation.snapshot())
    assert not np.array_equal(start.position, simulation.snapshot().position)


def test_an_error_in_one_thread_is_told(forced):
    forced(3)
    team = thread_team.ThreadTeam(0, pack_scene(make_scene((3, 3, 3))))

    def work(member):
        if member.member == 2:
            raise ZeroDivisionError
        return member.member

    with pytest.raises(ZeroDivisionError):
        team.run(work)
    assert team.run(lambda member: member.size) == 3


def test_steps_in_which_nothing_can_touch_are_as_long_for_two_threads():
    """The body that moves fastest and the one that spins fastest may be those of two threads."""
    scene = ico.Scene.from_parameters({
        'weave.kind': 'radial', 'weave.size': [3, 7, 4], 'weave.variant': 2, 'weave.radius': 15.2,
        'weave.connector_angle': 0.64, 'shell.edge_length': 0.4, 'shell.thickness': 0.18,
        'shell.density': 25.0, 'connector.stiffness': 2.2e8, 'connector.natural_length': 3.43,
        'contact.mode': 'always', 'contact.stiffness': 5.1e8, 'solver.method': 'dop8',
        'solver.tolerance': 0.3, 'solver.threads': 1, 'initial_random.velocity_sigma': 105.0,
        'initial_random.spin_sigma': 1500.0, 'initial_random.seed': 1508071426})
    one = ico.compile_scene(scene)
    with thread_team.teams_of(2):
        two = ico.compile_scene(scene)
    assert one.status.busy_thread_count == 1 and two.status.busy_thread_count == 2
    for _ in range(60):
        one.advance_steps(1)
        two.advance_steps(1)
        assert one.checkpoint().difference(two.checkpoint()) == ''
    assert one.status.step_count == 60 and one.error_estimate > 0.0
