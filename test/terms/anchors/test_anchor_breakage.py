# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Anchors that break where they reach a length, against closed forms."""

import math

from fabrics import changed, make_scene
import icofabric_sim as ico
from icofabric_sim.bag import BagError
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.commands.main import main
from icofabric_sim.messages import decode_marker_points
from icofabric_sim.messages.topics import Outputs
from icofabric_sim.parameters.text import dump_parameters
from icofabric_sim.pictures.render import RunMoments, RunPictures
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.inputs.anchor_breaks import AnchorBreaks
import numpy as np
import pytest

REST, STIFFNESS = 0.03, 50.0
# Above the middle of the body's upper edge, so that nothing turns.
UP = make_scene((1, 1, 1)).geometry.half_edge * (1.0 + math.sqrt(5.0)) / 2.0


def tied(changes=None):
    """One body on a rope of its natural length straight above it, which is pulled away."""
    return make_scene((1, 1, 1), {
        'anchors.tie.body': 0, 'anchors.tie.edge': 'up', 'anchors.tie.natural_length': REST,
        'anchors.tie.position': [0.0, 0.0, UP + REST], 'anchors.tie.stiffness': STIFFNESS,
        'anchors.tie.velocity': [0.0, 0.0, 0.3], 'solver.tolerance': 1e-9, **(changes or {})})


def stretch_at(scene, time):
    """Stretch of a spring whose other end begins to move: v / w sin(w t)."""
    rate = math.sqrt(STIFFNESS / scene.shell.mass)
    return 0.3 / rate * math.sin(rate * time), rate


@pytest.mark.parametrize('part', [0.3, 0.9, 0.99999])
@pytest.mark.parametrize('step', [0.0, 2e-3])
def test_a_pulled_anchor_breaks_at_the_moment_of_the_closed_form(part, step):
    free = tied()
    _, rate = stretch_at(free, 0.0)
    most = 0.3 / rate
    scene = tied({
        'anchors.tie.break_length_extension': REST + part * most, 'solver.step': step})
    run = ico.compile_scene(scene)
    assert run.status.method_name == 'dop8'
    moment = math.asin(part) / rate
    run.advance_to(0.5 * moment)
    assert run.snapshot().anchor_intact.all() and run.status.broken_count == 0
    run.advance_to(0.1)
    found = run.snapshot()
    # Where it only just reaches it the length hardly changes.
    doubt = 1e-9 if part < 0.99 else 1e-6
    assert found.anchors_broken_since == pytest.approx([moment], abs=doubt)
    assert run.status.broken_count == 1 and not found.anchor_intact.any()
    assert found.energy['lost_at_breaks'] == pytest.approx(
        0.5 * STIFFNESS * (part * most) ** 2, rel=1e-9)
    assert abs(found.energy['balance_error']) < 1e-9 * found.energy['lost_at_breaks']
    # Then it flies on as it was.
    speed = 0.3 * (1.0 - math.sqrt(1.0 - part**2))
    assert found.linear_velocity[0, 2] == pytest.approx(speed, rel=1e-6 if part < 0.99 else 1e-3)
    assert run.reactions().force[list(run.reactions().names).index('anchors.tie')] == (
        pytest.approx([0.0] * 3, abs=0.0))


def test_one_that_does_not_reach_its_limit_holds():
    scene = tied()
    _, rate = stretch_at(scene, 0.0)
    limited = changed(scene, {
        'anchors.tie.break_length_extension': REST + 1.00001 * 0.3 / rate,
        'solver.method': 'dop8'})
    whole = changed(scene, {'solver.method': 'dop8'})
    one, two = ico.compile_scene(limited), ico.compile_scene(whole)
    for run in (one, two):
        run.advance_to(0.3)
    assert one.snapshot().anchor_intact.all()
    # Looking for it changes no bit.
    assert np.array_equal(one.snapshot().position, two.snapshot().position)


def test_a_strut_that_is_pushed_together_breaks_at_its_shorter_length():
    scene = tied({'anchors.tie.velocity': [0.0, 0.0, -0.3],
                  'anchors.tie.break_length_compression': 0.9 * REST})
    _, rate = stretch_at(scene, 0.0)
    run = ico.compile_scene(scene)
    run.advance_to(0.1)
    assert run.snapshot().anchors_broken_since == pytest.approx(
        [math.asin(0.1 * REST * rate / 0.3) / rate], abs=1e-9)


def hung(changes=None):
    """A slab that hangs by four ropes, of which the weakest breaks under it, then others."""
    values = {
        'weave.connector_angle': 0.3, 'gravity': [0.0, 0.0, -9.81], 'contact.mode': 'never',
        'connector.damping': 0.05, 'solver.tolerance': 1e-6}
    scene = make_scene((4, 4, 1), values)
    corners = [
        int(np.argmax(scene.position[:, :2] @ [x, y])) for x in (-1, 1) for y in (-1, 1)]
    for number, body in enumerate(corners):
        name = f'anchors.rope{number}'
        values |= {
            f'{name}.body': body, f'{name}.edge': 'up', f'{name}.stiffness': 100.0,
            f'{name}.natural_length': 0.05, f'{name}.stiffness_compression': 0.0,
            f'{name}.position': (scene.position[body] + [0.0, 0.0, UP + 0.05]).tolist(),
            f'{name}.break_length_extension': 0.0505 + 0.0005 * number}
    return make_scene((4, 4, 1), {**values, **(changes or {})})


def same(one, two):
    return all(np.array_equal(getattr(one, name), getattr(two, name), equal_nan=True) for name in (
        'position', 'orientation', 'linear_velocity', 'angular_velocity', 'anchors_broken_since'))


def test_pieces_threads_and_checkpoints_change_no_bit():
    run = ico.compile_scene(hung())
    run.advance_to(0.2)
    end = run.snapshot()
    times = end.anchors_broken_since
    assert 2 <= np.isfinite(times).sum() and len(set(times[np.isfinite(times)].tolist())) > 1
    other = ico.compile_scene(hung({'solver.threads': 2}))
    first = np.nanmin(times)
    for time in sorted({*np.linspace(0.005, 0.2, 40).tolist(), first, first + 1e-4}):
        other.advance_to(time)
        if abs(time - first) < 1e-3:
            saved = Checkpoint.from_bytes(other.checkpoint().to_bytes())
            other = ico.compile_scene(hung())
            other.restore(saved)
    assert same(other.snapshot(), end)
    # A run of the same scene, restored to before, is whole again; so is one that is reset.
    run.reset_time()
    assert run.snapshot().anchor_intact.all()
    run.advance_to(0.2)
    assert same(run.snapshot(), end)


def test_a_changed_scene_keeps_what_is_broken_and_a_new_weave_does_not():
    run = ico.compile_scene(hung())
    run.advance_to(0.2)
    gone = ~run.snapshot().anchor_intact
    going = ico.compile_scene(hung({'connector.damping': 0.1}))
    going.continue_from(run, keep_motion=True)
    assert np.array_equal(~going.snapshot().anchor_intact, gone)
    going.advance_to(0.21)
    assert (~going.snapshot().anchor_intact)[gone].all()
    anew = ico.compile_scene(hung({'shell.density': 1000.0}))
    anew.continue_from(run, keep_motion=False)
    assert anew.snapshot().anchor_intact.all()


def test_a_companion_has_the_same_anchors_broken():
    run, other = ico.compile_scene(hung()), ico.compile_scene(hung())
    run.advance_to(0.05)
    other.copy_breaks(run)
    gone = ~run.snapshot().anchor_intact
    assert gone.any() and np.array_equal(~other.snapshot().anchor_intact, gone)
    # They do not pull it either.
    names = list(other.reactions().names)
    other.advance_to(0.001)
    pulls = [other.reactions().force[names.index(f'anchors.rope{k}')] for k in range(4)]
    assert [bool(np.any(pull)) for pull in pulls] == (~gone).tolist()
    assert other.snapshot().energy['lost_at_breaks'] == 0.0


def test_rest_leaves_broken_anchors_out():
    scene = hung({'anchors.rope0.break_length_extension': 0.0501, **{
        f'anchors.rope{number}.break_length_extension': 0.0 for number in (1, 2, 3)}})
    run = ico.compile_scene(scene)
    run.advance_to(0.1)
    torn = run.snapshot()
    assert (~torn.anchor_intact).tolist() == [True, False, False, False]
    found = ico.solve_equilibrium(scene, start=torn)
    whole = ico.solve_equilibrium(scene)
    assert found.converged and whole.converged
    weight = scene.body_count * scene.shell.mass * 9.81
    for result, expected in ((found, 3), (whole, 4)):
        ropes = [result.reactions.force[list(result.reactions.names).index(f'anchors.rope{k}')][2]
                 for k in range(4)]
        assert sum(ropes) == pytest.approx(weight, rel=1e-6)
        assert sum(force > 1e-6 for force in ropes) == expected
    assert np.array_equal(found.snapshot.anchor_intact, torn.anchor_intact)


def test_they_are_published_recorded_verified_and_drawn(tmp_path, capsys):
    scene = hung({'duration': 0.1})
    run = ico.compile_scene(scene)
    run.advance_to(0.1)
    gone = np.flatnonzero(~run.snapshot().anchor_intact)
    assert len(gone) >= 1
    path = tmp_path / 'scene.yaml'
    path.write_text(dump_parameters(dict(scene.parameters)), encoding='utf-8')
    assert main(['run', str(path), '--record', str(tmp_path / 'bag'), '--no-growth']) == 0
    said = capsys.readouterr().out
    assert f'anchors.rope{gone[0]} at t = ' in said and 'J dissipated' in said
    with RecordedRun(tmp_path / 'bag') as recorded:
        _, last = recorded.breaks()[-1]
        assert {*last[:, 0].tolist()} == {float(-1 - number) for number in gone}
        moment = [*RunPictures(recorded).moments()][-1]
    assert moment.torn_anchors.tolist() == sorted(gone.tolist()) and not len(moment.broken)
    assert main(['verify', str(tmp_path / 'bag')]) == 0
    assert 'identical' in capsys.readouterr().out
    assert main(['info', str(tmp_path / 'bag')]) == 0
    text = capsys.readouterr().out
    assert f'{len(gone)} anchors, from' in text
    assert main(['info', str(path)]) == 0
    assert 'breaks above 0.0505 m' in capsys.readouterr().out
    # The markers show those that hold.
    for snapshot, count in ((run.snapshot(), 4 - len(gone)),
                            (ico.compile_scene(scene).snapshot(), 4)):
        anchors = next(Outputs(scene).connectors(snapshot, 0))
        assert len(decode_marker_points(anchors).points) == 2 * count
    with RecordedRun(tmp_path / 'bag') as recorded:
        moments = RunMoments(recorded)
        moments._breaks = [(0, np.array([[-5.0, 0.0]]))]
        with pytest.raises(BagError, match='a broken anchor 4 .* has 4 anchors'):
            list(moments.at(recorded.pose_times()[:1]))


@pytest.mark.parametrize('changes, words', [
    ({'anchors.tie.break_length_extension': 0.02}, 'above the natural length'),
    ({'anchors.tie.break_length_compression': 0.04}, 'below the natural length'),
    ({'anchors.tie.break_length_extension': 0.04,
      'anchors.tie.position': [0.0, 0.0, UP + 0.05]}, 'would break at once'),
    ({'anchors.tie.break_length_compression': 0.02,
      'anchors.tie.position': [0.0, 0.0, UP + 0.01]}, 'would break at once'),
    ({'anchors.tie.break_length_extension': 0.04, 'solver.method': 'srkn6'}, 'anchors that break'),
    ({'anchors.tie.break_length_extension': math.nan}, 'finite')])
def test_what_makes_no_sense_is_refused_by_name(changes, words):
    name = 'solver.method' if 'solver.method' in changes else next(iter(changes))
    with pytest.raises(ico.ParameterError, match=words) as caught:
        ico.compile_scene(tied(changes))
    assert caught.value.name == name


def test_a_checkpoint_of_broken_anchors_is_judged():
    run = ico.compile_scene(hung())
    run.advance_to(0.2)
    tree = run.inputs.state_tree()['broken_anchors']
    assert tree['anchor'].tolist() == np.flatnonzero(~run.snapshot().anchor_intact).tolist()
    for wrong in ({'anchor': np.array([4.0])}, {'anchor': np.array([1.0, 0.0])},
                  {'time': np.array([np.nan])}, {'anchor': np.array([0.5])}):
        with pytest.raises(ValueError, match='broken'):
            AnchorBreaks(run.scene.anchors).load_state(StateTree({**tree, **wrong}))
    unlimited = ico.compile_scene(hung({
        f'anchors.rope{k}.break_length_extension': 0.0 for k in range(4)}))
    with pytest.raises(ValueError, match='no anchor of this scene breaks'):
        unlimited.inputs.load_state(StateTree(run.inputs.state_tree()), run.time)


def test_anchors_break_with_direction_cosines_too():
    ends = []
    for rotation in ('quaternion', 'direction_cosines'):
        run = ico.compile_scene(
            tied({'anchors.tie.break_length_extension': 1.01 * REST}), rotation=rotation)
        run.advance_to(0.1)
        ends.append(run.snapshot().anchors_broken_since)
    assert np.isfinite(ends[0]).all() and ends[1] == pytest.approx(ends[0], abs=1e-9)
