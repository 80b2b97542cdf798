# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A paused run is brought to rest under what acts on it, and a record repeats that."""
import json

import icofabric_sim as ico
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.messages import decode_string
from icofabric_sim.messages.topics import EVENTS, POSES
from icofabric_sim.running.recording import BagSink, summarise_run
from icofabric_sim.running.replay.verify import verify_run
from icofabric_sim.running.runner import Runner
from icofabric_sim.running.time_requests import AdvanceRequest
from icofabric_sim.statics import present as present_module
import numpy as np
import pytest
from runner_helpers import Beside, ListSink, push

LIMIT = 300.0
# The scene of others, so that its kernels are there.
CHANGES = {'start_paused': True, 'publish_rate': 1000.0}
FORCE = np.array([0.0, 0.1, 0.05])


def scene_of(**changes):
    return ico.load_scene('hanging_slab').with_changes({**CHANGES, **changes})


def runner_of(*sinks, **changes):
    return Runner(ico.compile_scene(scene_of(**changes)), list(sinks))


def events(sink):
    told = [json.loads(decode_string(data)) for _, data in sink.of(EVENTS)]
    return [facts for facts in told if facts['event'] == 'equilibrium']


def test_it_stays_where_forces_balance_also_those_that_were_received():
    sink = ListSink(EVENTS, POSES)
    runner = runner_of(sink)
    with Beside(runner):
        runner.advance(AdvanceRequest(5_000_000)).result(LIMIT)
        push(runner, 'tip', force=FORCE)
        runner.advance(AdvanceRequest(1_000_000)).result(LIMIT)
        moving = runner.simulation.snapshot()
        said = runner.solve_equilibrium().result(LIMIT)
        rest = runner.simulation.snapshot()
        runner.advance(AdvanceRequest(50_000_000)).result(LIMIT)
        later = runner.simulation.snapshot()
    assert 'equilibrium, stable' in said and 't = 0.006000000 s' in said
    edge = runner.simulation.scene.geometry.half_edge
    assert rest.time == moving.time and not rest.linear_velocity.any()
    assert abs(rest.position - moving.position).max() > 0.1 * edge
    # 0.05 s is some twenty periods of the fastest vibration.
    assert abs(later.position - rest.position).max() < 1e-7 * edge
    # What the wrench shifts: the scene alone rests elsewhere.
    alone = ico.solve_equilibrium(scene_of()).snapshot
    assert abs(rest.position - alone.position).max() > 1e-3 * edge
    [facts] = events(sink)
    assert facts['verdict'] == 'equilibrium, stable' and facts['position'] == (
        rest.position.tolist())
    assert len(sink.of(POSES)) > 6


def test_a_record_repeats_it(tmp_path):
    simulation = ico.compile_scene(scene_of(**{'record.path': str(tmp_path / 'bag')}))
    bag = BagSink(tmp_path / 'bag', simulation, live=False)
    runner = Runner(simulation, [bag])
    with Beside(runner):
        runner.advance(AdvanceRequest(3_000_000)).result(LIMIT)
        runner.solve_equilibrium().result(LIMIT)
        runner.advance(AdvanceRequest(3_000_000)).result(LIMIT)
    bag.close(summary=summarise_run(runner.status()))
    with RecordedRun(tmp_path / 'bag', '/icofabric') as run:
        found = verify_run(run)
    assert found.verdict == 'identical', found.lines()


def test_nothing_changes_where_it_cannot_be(monkeypatch):
    runner = runner_of()
    with Beside(runner):
        before = runner.simulation.snapshot()
        runner.set_paused(False).result(LIMIT)
        with pytest.raises(RuntimeError, match='pause it first'):
            runner.solve_equilibrium().result(LIMIT)
        runner.set_paused(True).result(LIMIT)
        before = runner.simulation.snapshot()
        # Too few steps to come to rest.
        monkeypatch.setattr(present_module, '_MAX_STEPS', 1)
        with pytest.raises(RuntimeError, match='not in equilibrium.*is unchanged'):
            runner.solve_equilibrium().result(LIMIT)
        assert runner.simulation.snapshot() is before


def test_what_is_changed_meanwhile_is_not_overwritten(monkeypatch):
    runner = runner_of()
    found, seek = [], present_module.solve_run_equilibrium

    def slow(present):
        result = seek(present)
        runner.set_body_state(50, {'linear_velocity': [0.0, 0.0, 0.1]}).result(LIMIT)
        found.append(result)
        return result

    monkeypatch.setattr(present_module, 'solve_run_equilibrium', slow)
    with Beside(runner):
        with pytest.raises(RuntimeError, match='have changed during the solve'):
            runner.solve_equilibrium().result(LIMIT)
        assert found and runner.simulation.snapshot().linear_velocity[50, 2] == 0.1


def test_a_fabric_with_friction_finds_its_rest():
    runner = runner_of(**{'contact.friction': 0.3})
    with Beside(runner):
        assert 'residual' in runner.solve_equilibrium().result(LIMIT)


def test_what_contacts_bear_is_told_and_recorded():
    sink, weight = ListSink(EVENTS), 9.81 * 3.0
    scene = ico.Scene.from_parameters({
        'weave.size': [1, 1, 1], 'contact.stiffness': 1e5, 'start_paused': True,
        'masses.it.group': 'it', 'masses.it.mass': 3.0, 'initial.it.group': 'it',
        'initial.it.displacement': [0.0, 0.0, 1e-4], 'gravity': [0.0, 0.0, -9.81],
        'supports.it.group': 'it', 'supports.it.fix': 'tx ty rotation', 'groups.it': 'all',
        'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -0.0161803398875})
    runner = Runner(ico.compile_scene(scene), [sink])
    with Beside(runner):
        said = runner.solve_equilibrium().result(LIMIT)
    assert '1 contact, largest force 29.4 N, on body 0, largest resultant ' in said
    [facts] = events(sink)
    assert facts['contacts']['second'] == ['planes.floor']
    rubs = Runner(ico.compile_scene(scene.with_changes({'contact.friction': 0.3})), [])
    with Beside(rubs):
        said = rubs.solve_equilibrium().result(LIMIT)
    assert 'smallest friction margin 1' in said
    assert facts['contacts']['force_z_n'] == pytest.approx([weight], rel=1e-6)


def test_least_resultants_are_put_and_told():
    """A shell in a floor is moved out of it, and its weight is what is left."""
    sink, mass = ListSink(EVENTS), 3.0
    scene = ico.Scene.from_parameters({
        'weave.size': [1, 1, 1], 'contact.stiffness': 1e5, 'start_paused': True,
        'masses.it.group': 'all', 'masses.it.mass': mass, 'gravity': [0.0, 0.0, -9.81],
        'loads.push.group': 'all', 'loads.push.frame': 'body',
        'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': -0.016})
    runner = Runner(ico.compile_scene(scene), [sink])
    with Beside(runner):
        assert 'contact' in runner.solve_equilibrium().result(LIMIT)
        runner.change(scene.parameters.with_changes(
            {'equilibrium.objective': 'resultants'})).result(LIMIT)
        said = runner.solve_equilibrium().result(LIMIT)
        assert said.startswith('least resultants, residual 1, the largest resultants left are '
                               f'{9.81 * mass:.3g} N on body 0 and ')
        rest = runner.simulation.snapshot()
        push(runner, 'push', force=FORCE)
        runner.advance(AdvanceRequest(1_000_000)).result(LIMIT)
        with pytest.raises(ValueError, match='needs forces with a potential: a received w'):
            runner.solve_equilibrium().result(LIMIT)
    assert rest.position[0, 2] > -0.016 + 0.0161803
    facts = events(sink)[-1]
    assert facts['unbalanced_wrench'][0] == pytest.approx(
        [0.0, 0.0, -9.81 * mass, 0.0, 0.0, 0.0], abs=1e-9)
