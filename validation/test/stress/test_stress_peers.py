# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Random scenes in MuJoCo under the same judge, and that its scenes are ours."""

from importlib.util import find_spec

from icofabric_sim.commands.main import main
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.errors import SimulationError
from icofabric_sim.simulation.reports.divergence import distance_between
from icofabric_sim.simulation.simulation import compile_scene
from icofabric_validation.stress import peers
from icofabric_validation.stress.kinds import Kind, KINDS
from icofabric_validation.stress.peers import judge_peer, PEERS
from icofabric_validation.stress.scenes import draw_scene, StressScene
from icofabric_validation.stress.verdict import Verdict
import numpy as np
import pytest

needs_mujoco = pytest.mark.skipif(find_spec('mujoco') is None, reason='needs MuJoCo')
needs_lammps = pytest.mark.skipif(find_spec('lammps') is None, reason='needs LAMMPS')
each_peer = pytest.mark.parametrize('name', [
    pytest.param('mujoco', marks=needs_mujoco), pytest.param('lammps', marks=needs_lammps)])

WOVEN = {
    'weave.size': [3, 2, 2], 'weave.connector_angle': 0.3, 'contact.mode': 'never',
    'connector.natural_length': 0.03, 'initial_random.velocity_sigma': 0.1,
    'initial_random.spin_sigma': 6.0, 'initial_random.seed': 3, 'solver.method': 'dop8',
    'solver.threads': 1, 'solver.tolerance': 1e-8}


HELD = [
    {'gravity': [0.3, 0.1, -2.0], 'groups.top': 'z_max', 'supports.top.group': 'top',
     'supports.top.fix': fix}
    for fix in ('all', 'tx ty tz', 'rotation', 'tz', 'tx rotation')]
GROUPED = {'groups.top': 'z_max', 'connector_groups.soft.between': 'top all',
           'connector_groups.soft.stiffness': 100.0, 'connector_groups.soft.natural_length': 0.027}


def loaded(profile, **more):
    """Wrenches off the centres by one profile: fixed in the world, and turning with the bodies."""
    times = {'start': 0.003, 'duration': 0.0 if profile.startswith('table') else 0.008} | more
    force = {'force': [0.05, -0.1, 0.08], 'torque': [4e-4, 2e-4, -3e-4],
             'point': [0.004, 0.007, -0.003], 'profile': profile, **times}
    channels = {'world': {'group': 'top', 'share': 'total'}, 'body': {'group': 'all'}}
    return {'groups.top': 'z_max', **{
        f'loads.{frame}.{key}': value for frame, channel in channels.items()
        for key, value in (channel | force | {'frame': frame}).items()}}


LOADED = [
    pytest.param(loaded('steady', start=0.0, duration=0.0), id='always'),
    pytest.param(loaded('steady'), id='steady'), pytest.param(loaded('ramp'), id='ramp'),
    pytest.param(loaded('half_sine'), id='half_sine'),
    pytest.param(loaded('sine 90.0'), id='sine'), pytest.param(loaded('table'), id='table'),
    pytest.param(loaded('steady') | HELD[2] | {'groups.top': 'z_max'}, id='held')]


@pytest.fixture
def placed(tmp_path):
    """Puts the file of a table in its place."""
    (tmp_path / 'profile.csv').write_text('0.0,0.5\n0.004,1.0\n0.009,-0.7\n0.011,0.3\n')
    return lambda changes: {
        name: f'table {tmp_path / "profile.csv"}' if value == 'table' else value
        for name, value in changes.items()}


def follow(name, changes, radians):
    """Errors after 0.02 s, with steps of so many radians of the fastest vibration."""
    scene = Scene.from_parameters(WOVEN | changes)
    rate, errors = compile_scene(scene).status.largest_frequency, []
    for part in radians:
        run = PEERS[name].run(scene, part / rate, rate)
        run.advance_to(0.02)
        beside = compile_scene(scene)
        beside.advance_to(run.time)
        one, two = run.snapshot(), beside.snapshot()
        errors.append(distance_between(one, two, scene.geometry.half_edge))
        assert one.linear_velocity == pytest.approx(
            two.linear_velocity, abs=20.0 * errors[-1] * rate * scene.geometry.half_edge)
        assert one.angular_velocity == pytest.approx(
            two.angular_velocity, abs=20.0 * errors[-1] * rate)
    return errors


# Two programs of two makers: each is an oracle of the other.
@needs_mujoco
@pytest.mark.parametrize('changes', [
    {}, {'connector.damping': 0.01, 'gravity': [0.3, 0.1, -2.0]}, GROUPED,
    *({'connector.damping': 0.01, **held} for held in HELD)])
def test_the_same_motion_follows_in_mujoco_to_the_order_of_its_method(changes):
    errors = follow('mujoco', changes, (0.2, 0.1))
    assert 1e-7 < errors[1] < 1e-5 and 10.0 < errors[0] / errors[1] < 30.0, errors


@needs_lammps
@pytest.mark.parametrize('changes', [
    {}, {'gravity': [0.3, 0.1, -2.0]}, GROUPED, *HELD,
    {'connector.attachment.up': [0.0, 0.001, 0.0162]}])
def test_the_same_motion_follows_in_lammps_to_the_order_of_its_method(changes):
    errors = follow('lammps', changes, (0.02, 0.01))
    assert 1e-6 < errors[1] < 1e-3 and 3.5 < errors[0] / errors[1] < 4.5, errors


@needs_mujoco
@pytest.mark.parametrize('changes', LOADED)
def test_loads_of_all_profiles_act_in_mujoco_as_they_should(changes, placed):
    without = compile_scene(Scene.from_parameters(WOVEN))
    moved = compile_scene(Scene.from_parameters(WOVEN | placed(changes)))
    for run in (without, moved):
        run.advance_to(0.02)
    assert distance_between(
        without.snapshot(), moved.snapshot(), moved.scene.geometry.half_edge) > 0.05
    errors = follow('mujoco', placed(changes), (0.2, 0.1))
    assert 1e-7 < errors[1] < 3e-5 and 10.0 < errors[0] / errors[1] < 30.0, errors


@needs_lammps
@pytest.mark.parametrize('changes', LOADED)
def test_loads_of_all_profiles_act_in_lammps_as_they_should(changes, placed):
    errors = follow('lammps', placed(changes), (0.02, 0.01))
    assert 1e-6 < errors[1] < 1e-3 and 3.5 < errors[0] / errors[1] < 4.5, errors


@each_peer
def test_loads_are_judged_there_in_windows_that_begin_later(name, placed):
    scene = StressScene(0, KINDS.index(Kind('dop8')), {
        **WOVEN, **placed(loaded('half_sine', duration=0.004)), 'weave.size': [2, 2, 2],
        'solver.tolerance': 1e-2, 'duration': 0.02}, {})
    finding = judge_peer(name, scene)
    assert finding.verdict is Verdict.WITHIN and finding.compared, finding
    assert 0.0 < finding.added < finding.promised and finding.windows >= 3
    assert finding.unjudged == 0


@each_peer
def test_scenes_are_judged_there(name):
    scene = StressScene(0, KINDS.index(Kind('dop8')), {
        **WOVEN, 'weave.size': [2, 2, 2], 'solver.tolerance': 1e-2, 'duration': 0.02}, {})
    finding = judge_peer(name, scene)
    assert finding.verdict is Verdict.WITHIN and finding.compared, finding
    assert 0.0 < finding.added < finding.promised and finding.windows > 0 == finding.unjudged
    # It says nothing of what a given step errs by.
    scene.parameters.update({'solver.step': 2e-4, 'solver.tolerance': 1e-6})
    finding = judge_peer(name, scene)
    assert finding.verdict is Verdict.SILENT and finding.added > 3.0 * finding.promised, finding


@needs_mujoco
def test_a_step_beyond_its_limit_is_seen():
    scene = StressScene(0, KINDS.index(Kind('dop8')), {
        **WOVEN, 'weave.size': [2, 2, 2], 'duration': 1.0, 'solver.step': 1e-2}, {})
    finding = judge_peer('mujoco', scene, seconds=1.0)
    assert finding.verdict is Verdict.STOPPED and 'MuJoCo' in finding.detail, finding


@needs_lammps
def test_loose_bodies_fall_in_lammps_as_they_should():
    scene = Scene.from_parameters(WOVEN | {
        'weave.connected': False, 'gravity': [0.3, 0.1, -2.0], 'connector.natural_length': 0.0})
    own = compile_scene(scene)
    own.advance_to(0.02)
    assert np.abs(own.snapshot().position - scene.position).max() > 1e-3
    turned = []
    for step in (1e-3, 5e-4):
        run = PEERS['lammps'].run(scene, step, 1e3)
        run.advance_steps(round(0.02 / step))
        assert run.snapshot().position == pytest.approx(own.snapshot().position, abs=1e-14)
        turned.append(distance_between(
            run.snapshot(), own.snapshot(), scene.geometry.half_edge))
    # NO_SQUISH turns a free body to order 2, too.
    assert turned[0] < 1e-5 and 3.9 < turned[0] / turned[1] < 4.1


@needs_lammps
def test_what_goes_to_infinity_in_lammps_is_seen():
    # Steps far beyond the stability limit.
    run = PEERS['lammps'].run(Scene.from_parameters(WOVEN), 1e3, 1e3)
    with pytest.raises(SimulationError, match='LAMMPS at t = .* not finite'):
        run.advance_steps(2000)


@pytest.mark.parametrize('name', PEERS)
def test_only_what_both_can_express_is_drawn(name):
    peer = PEERS[name]
    some = [seed for seed in range(3000) if peer.can_express(seed)]
    assert len(some) > 20
    for seed in some:
        scene = draw_scene(seed)
        assert {*KINDS[scene.kind].terms} <= peer.terms
        assert not (scene.spoiled or scene.change)
    if name == 'lammps':
        assert not any('damping' in KINDS[draw_scene(seed).kind].terms for seed in some)


@pytest.mark.parametrize('name', PEERS)
def test_words_that_do_not_go_with_a_peer(name, capsys, monkeypatch):
    unknown = next(seed for seed in range(100) if not PEERS[name].can_express(seed))
    monkeypatch.setattr(peers, 'find_spec', lambda name: object())
    for words, said in ((['--seed', '3', '--shrink'], '--shrink'),
                        (['--seed', str(unknown)], 'cannot express')):
        assert main(['stress', '--peer', name, *words]) == 2
        assert said in capsys.readouterr().err
    monkeypatch.setattr(peers, 'find_spec', lambda name: None)
    assert main(['stress', '--peer', name]) == 2
    assert PEERS[name].install in capsys.readouterr().err
