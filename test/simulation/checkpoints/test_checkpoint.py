# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A run that is restored from a checkpoint goes on to the bits of the run that never stopped."""

import hashlib
import logging
import subprocess
import sys

from fabrics import (
    changed,
    FORMS,
    LOADED,
    make_scene,
    RANDOM,
    same_state,
    STATE,
    SUPPORTED,
    warnings_said,
)
import icofabric_sim as ico
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.errors import Interrupted
from icofabric_sim.simulation.stepping import thread_team
import numpy as np
import pytest

EVERYTHING = {
    **SUPPORTED, **LOADED, 'groups': {**SUPPORTED['groups'], **LOADED['groups']}, **RANDOM}
# A pull that folds the fabric up: where it becomes rough the run goes back to shorter steps.
FOLDED = {
    'contact.mode': 'never', 'solver.tolerance': 1e-4, 'weave.variant': 1,
    'groups.pushed': 'x_max', 'loads.l.group': 'pushed', 'loads.l.frame': 'body',
    'loads.l.force': [-2.0, -0.5, -0.3], 'loads.l.point': [0.01, -0.022, 0.002]}


def everything(size=(3, 3, 3), **changes):
    return make_scene(size, {
        'solver.tolerance': 1e-4, 'solver.energy_limit': 1e3, 'loads.follower.hold': 0.003,
        **{name.replace('__', '.'): value for name, value in changes.items()}}, **EVERYTHING)


def restored(checkpoint, scene, form='quaternion', **choices):
    """Another simulation, which has done something else before, from the bytes of a checkpoint."""
    simulation = ico.compile_scene(scene, rotation=form, **choices)
    simulation.advance_to(0.0007)
    simulation.restore(Checkpoint.from_bytes(checkpoint.to_bytes()))
    return simulation


def assert_same(one, other):
    """Both are at one state, show the same of it, and know the same of what was and what comes."""
    a, b = one.snapshot(), other.snapshot()
    assert a.time == b.time and same_state(a, b)
    assert a.energy == b.energy
    for name in ('step', 'step_count', 'next_step_time', 'balance', 'proximity', 'error_rate',
                 'error_estimate', 'largest_frequency', 'waiting_loads'):
        assert getattr(one.status, name) == getattr(other.status, name), name
    assert one.status.active_loads.keys() == other.status.active_loads.keys()
    assert one.checkpoint().difference(other.checkpoint()) == ''


@pytest.mark.parametrize('form', FORMS)
@pytest.mark.parametrize('step', [0.0, 1.7e-4])
@pytest.mark.parametrize('method', ico.METHODS)
def test_goes_on_to_the_same_bits(method, step, form):
    scene = everything(
        solver__method=method, solver__step=step,
        solver__tolerance=1e-2 if method == 'leapfrog' else 1e-4)
    generator = np.random.default_rng(5)
    wrenches = [(float(generator.uniform(0.0, 0.03)), *generator.standard_normal((2, 3)))
                for _ in range(9)]

    def start():
        simulation = ico.compile_scene(scene, rotation=form)
        for time, force, torque in wrenches:
            simulation.apply_wrench('follower', force, 0.003 * torque, time=time)
        return simulation

    plain, watched = start(), start()
    checkpoints = []
    # Also at a time at which a wrench has just begun and another is about to.
    for time in sorted([0.0, wrenches[4][0], *generator.uniform(0.0, 0.03, 5)]):
        watched.advance_to(time)
        checkpoints.append(watched.checkpoint())
    for simulation in (plain, watched):
        simulation.advance_to(0.04)
    # Nothing notices that checkpoints are taken.
    assert_same(plain, watched)
    for checkpoint in checkpoints:
        again = restored(checkpoint, scene, form)
        assert again.time == checkpoint.time
        assert again.checkpoint().difference(checkpoint) == ''
        again.advance_to(0.04)
        assert_same(plain, again)
        # Slots without a body too.
        for one, other in zip(*(
                simulation._driver.trajectory.state.rows() for simulation in (plain, again))):
            for slot in plain.packed.layout.blocks.slot:
                assert np.array_equal(one[..., slot:slot + LANES], other[..., slot:slot + LANES])
    assert np.abs(plain.snapshot().position - scene.initial.position).max() > 5e-3
    assert len({checkpoint.to_bytes() for checkpoint in checkpoints}) == len(checkpoints)


@pytest.mark.parametrize('seed', range(24))
def test_random_runs_with_everything_that_can_be_done_to_them(seed):
    generator = np.random.default_rng(seed)
    method = [*ico.METHODS, 'auto'][seed % 6]
    form = FORMS[generator.integers(2)]
    scene = everything(
        [(3, 3, 3), (4, 3, 2), (2, 2, 2)][generator.integers(3)], solver__method=method,
        solver__step=[0.0, 2e-4][generator.integers(2)],
        solver__tolerance=1e-2 if method == 'leapfrog' else 10.0 ** -generator.integers(4, 7))
    one = ico.compile_scene(scene, rotation=form)
    runs, end = [one], 0.0
    for number in range(12):
        deed = generator.integers(7)
        end = one.time + generator.uniform(0.0, 0.005)
        force, torque = generator.standard_normal((2, 3)) * [[1.0], [0.003]]
        speed, count = generator.standard_normal(3), int(generator.integers(1, 9))
        if generator.random() < 0.5:
            one.snapshot()  # only of one of them: no one notices
        for run in runs:
            if deed == 0:
                run.apply_wrench('steady', force)
            elif deed == 1:
                run.apply_wrench('follower', force, torque, time=end + 0.001)
            elif deed == 2:
                run.apply_body_wrench(1, force, torque, time=end)
            elif deed == 3:
                run.set_state(linear_velocity=np.tile(speed, (scene.body_count, 1)))
            elif deed == 4:
                run.advance_steps(count)
            elif deed == 5 and number > 8:
                run.reset()
            if deed < 4:
                run.advance_to(end)
        if number in (3, 7):
            runs = [one, restored(
                one.checkpoint(), changed(scene, {'publish_rate': 7.0}), form)]
        for run in runs[1:]:
            assert one.checkpoint().difference(run.checkpoint()) == ''
    for run in runs:
        run.advance_to(end + 0.01)
    for run in runs[1:]:
        assert_same(one, run)
    assert one.status.step_count > 10


def test_what_is_remembered_covers_every_kind():
    # The tests above are only worth something if they met these.
    scene, seen = everything(), set()
    for method in ('srkn4', 'dop8'):
        run = ico.compile_scene(
            changed(scene, {'solver.method': method, 'contact.mode': 'auto'}))
        for time in np.random.default_rng(0).uniform(0.0, 3e-3, 15).cumsum():
            run.advance_to(float(time))
            seen |= set(run.checkpoint().arrays)
    assert {'stepper.window', 'stepper.acceleration', 'stepper.slopes', 'stepper.start.position',
            'stepper.control', 'stepper.loads.power', 'stepper.watch.reference',
            'stepper.saved.position'} <= seen


@pytest.mark.parametrize('method, step', [('auto', 0.0), ('dop8', 0.0), ('leapfrog', 1.7e-5)])
def test_state_and_checkpoint_do_not_depend_on_who_looked_before(method, step):
    scene = everything(solver__method=method, solver__step=step)
    whole, pieces = ico.compile_scene(scene), ico.compile_scene(scene)
    for each in (whole, pieces):
        each.apply_wrench('steady', (0.0, 0.3, 0.0), time=0.00123)
    for time in np.random.default_rng(3).uniform(0.0, 2e-4, 200).cumsum():
        pieces.advance_to(float(time))
        pieces.snapshot()
        # Of one that went there at once.
        checkpoint = pieces.checkpoint()
        whole.advance_to(float(time))
    alone = ico.compile_scene(scene)
    alone.apply_wrench('steady', (0.0, 0.3, 0.0), time=0.00123)
    alone.advance_to(pieces.time)
    assert alone.checkpoint().to_bytes() == checkpoint.to_bytes()
    assert whole.checkpoint().to_bytes() == checkpoint.to_bytes()


def test_goes_back_for_rougher_motion_as_the_run_it_is_of():
    scene = make_scene((2, 4, 2), {**FOLDED, 'solver.method': 'srkn6', 'solver.tolerance': 1e-5})
    whole, pieces = ico.compile_scene(scene), ico.compile_scene(scene)
    end = 0.1
    whole.advance_to(end)
    assert np.isfinite(whole._driver.errors.returned_to)  # it did go back
    for time in np.sort(np.random.default_rng(1).uniform(0.0, end, 60)):
        pieces.advance_to(time)
        after = ico.compile_scene(scene)
        after.restore(pieces.checkpoint())
        pieces = after
    pieces.advance_to(end)
    assert_same(whole, pieces)
    assert np.isfinite(pieces._driver.errors.returned_to)


def test_one_requested_step_is_one_step_also_after_a_reset_of_a_run_that_went_back():
    simulation = ico.compile_scene(
        make_scene((2, 4, 2), {**FOLDED, 'solver.method': 'srkn6', 'solver.tolerance': 1e-5}))
    first = simulation.advance_steps(1), simulation.time, simulation.status.step_count
    simulation.advance_to(0.1)
    assert np.isfinite(simulation._driver.errors.returned_to)
    simulation.reset_time()
    again = simulation.advance_steps(1), simulation.time, simulation.status.step_count
    assert again == first == (1, simulation.status.step, 1)


FRESH = """
import hashlib, sys
import icofabric_sim as ico
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint

checkpoint = Checkpoint.load(sys.argv[1])
scene = ico.Scene.from_parameters(checkpoint.parameters())
simulation = ico.compile_scene(scene)
simulation.restore(checkpoint)
simulation.advance_to(0.03)
simulation.checkpoint().save(sys.argv[2])
print(hashlib.sha256(simulation.snapshot().orientation.tobytes()).hexdigest())
"""


@pytest.mark.parametrize('method', ['auto', 'dop8'])
def test_in_another_process(method, tmp_path):
    plain = ico.compile_scene(everything(solver__method=method))
    plain.apply_wrench('steady', (0.3, 0.0, 0.2), time=0.012)
    plain.apply_wrench('follower', (0.0, 0.4, 0.2), time=0.009)
    plain.advance_to(0.0101)
    plain.checkpoint().save(tmp_path / 'there')
    plain.advance_to(0.03)
    result = subprocess.run(
        [sys.executable, '-c', FRESH, str(tmp_path / 'there'), str(tmp_path / 'back')],
        capture_output=True, text=True, check=True, timeout=300)
    snapshot = plain.snapshot()
    assert result.stdout.split() == [hashlib.sha256(snapshot.orientation.tobytes()).hexdigest()]
    assert Checkpoint.load(tmp_path / 'back').to_bytes() == plain.checkpoint().to_bytes()
    assert np.abs(snapshot.position - plain.scene.initial.position).max() > 5e-3


@pytest.mark.parametrize('method', ['auto', 'leapfrog', 'dop8'])
def test_with_another_number_of_threads(method, monkeypatch):
    monkeypatch.setattr(thread_team, 'BODIES_PER_THREAD', 1)
    monkeypatch.setattr(thread_team, 'core_count', lambda: 3)
    scene = everything((5, 4, 3), solver__method=method, solver__tolerance=1e-2)
    single = ico.compile_scene(changed(scene, {'solver.threads': 1}))
    single.advance_to(0.0043)
    for threads in (2, 3):
        other = restored(single.checkpoint(), changed(scene, {'solver.threads': threads}))
        assert (single.status.thread_count, other.status.thread_count) == (1, threads)
        single.advance_to(single.time + 0.003)
        other.advance_to(single.time)
        assert_same(single, other)


@pytest.mark.parametrize('method', ['auto', 'dop8'])
@pytest.mark.parametrize('deed', [
    'set_state', 'reset', 'reset_time', 'continue_from', 'weave anew', 'wrench',
    'wrench on a body', 'interrupt'])
def test_right_after_something_was_done_to_the_run(deed, method):
    scene = everything(solver__method=method)
    run = ico.compile_scene(scene)
    run.apply_wrench('follower', (0.5, 0.0, 0.0), time=0.004)
    run.advance_to(0.0123)
    if deed == 'set_state':
        run.set_state(angular_velocity=-run.snapshot().angular_velocity)
    elif deed == 'reset':
        run.reset()
    elif deed == 'reset_time':
        run.reset_time()
    elif deed in ('continue_from', 'weave anew'):
        before = run
        before.apply_wrench('steady', (0.0, 0.0, 0.7))
        before.apply_wrench('follower', (0.0, 0.9, 0.7), time=0.02)
        run = ico.compile_scene(changed(scene, {'gravity': [0.0, 0.0, -3.0]}))
        run.warm_up()
        run.continue_from(before, keep_motion=deed == 'continue_from')
    elif deed == 'wrench':
        run.apply_wrench('steady', (0.0, 0.0, 0.7))
    elif deed == 'wrench on a body':
        run.apply_body_wrench(2, (0.0, 0.0, 0.7), time=0.02)
    else:
        run.should_stop = lambda: True
        with pytest.raises(Interrupted):
            run.advance_to(0.02)
        run.should_stop = None
    checkpoint = run.checkpoint()
    again = restored(checkpoint, run.scene)
    assert_same(run, again)
    for each in (run, again):
        # Another one at the same time, and one later.
        each.apply_wrench('steady', (0.0, 0.3, 0.0))
        each.apply_wrench('steady', (0.1, 0.3, 0.0), time=run.time + 0.005)
    end = run.time + 0.02
    for each in (run, again):
        each.advance_to(end)
    assert_same(run, again)
    assert run.status.step_count > 10 and 'steady' in run.status.active_loads


def test_failed_run_stays_failed_until_it_is_given_another_state():
    rough = {'solver.method': 'leapfrog', 'solver.energy_limit': 1e3,
             'initial_random.velocity_sigma': 8.0}
    limit = ico.compile_scene(make_scene(**RANDOM)).status.largest_frequency
    scene = make_scene(changes={**rough, 'solver.step': 1.8 / limit}, **RANDOM)
    run = ico.compile_scene(scene)
    with pytest.raises(ico.SimulationError) as caught:
        run.advance_to(10.0)
    again = restored(run.checkpoint(), scene)
    assert_same(run, again)
    for each in (run, again):
        with pytest.raises(ico.SimulationError) as once_more:
            each.advance_to(10.0)
        assert str(once_more.value) == str(caught.value)
        each.reset()
        each.advance_to(each.time + 3 * each.status.step)
    assert_same(run, again)


@pytest.mark.parametrize('method', ['auto', 'dop8'])
def test_run_that_no_step_can_follow_is_remembered_as_such(method):
    scene = everything(solver__method=method)
    run = ico.compile_scene(scene)
    run.advance_to(0.01)
    run.apply_wrench('steady', (1e308, 1e308, 1e308))
    with pytest.raises(ico.SimulationError, match='load'):
        run.advance_to(0.1)
    again = ico.compile_scene(scene)
    again.restore(run.checkpoint())
    assert run.checkpoint().difference(again.checkpoint()) == ''
    with pytest.raises(ico.SimulationError, match='load'):
        again.advance_to(0.1)
    # From such a state another checkpoint is restored, or refused without a trace.
    good = ico.compile_scene(scene).checkpoint()
    good.arrays['stepper.state.position'] = np.zeros(3)
    with pytest.raises(ValueError, match='state.position must have the shape'):
        again.restore(good)
    assert run.checkpoint().difference(again.checkpoint()) == ''


def test_a_question_about_the_error_leaves_no_trace():
    scene = everything(solver__step=1e-4)
    asked, quiet = ico.compile_scene(scene), ico.compile_scene(scene)
    for each in (asked, quiet):
        each.advance_to(0.0123)
    assert asked.status.error_rate > 0.0
    assert asked.checkpoint().to_bytes() == quiet.checkpoint().to_bytes()
    # And it is evaluated again where the state has changed since.
    rate = asked.status.error_rate
    asked.set_state(linear_velocity=20.0 * asked.snapshot().linear_velocity)
    assert asked.status.error_rate != rate


def test_goes_on_where_proximity_was_told_without_telling_it_again(caplog):
    scene = make_scene((3, 3, 3), {
        'initial_random.velocity_sigma': 0.5, 'initial_random.spin_sigma': 50.0,
        'contact.mode': 'auto', 'contact.stiffness': 2e4})
    run = ico.compile_scene(scene)
    run.advance_to(0.005)
    before = run.checkpoint()
    with caplog.at_level(logging.WARNING):
        run.advance_to(0.2)
        assert run.status.proximity is not None and len(warnings_said(caplog)) == 1
        after = ico.compile_scene(scene)
        after.restore(run.checkpoint())
        after.advance_to(0.3)
        assert after.status.proximity == run.status.proximity and len(warnings_said(caplog)) == 1
        after.restore(before)
        assert after.status.proximity is None
        after.advance_to(0.2)
    assert after.status.proximity == run.status.proximity and len(warnings_said(caplog)) == 2
    assert_same(run, after)


def test_checkpoint_is_not_touched_by_the_run_that_goes_on_or_comes_back():
    run = ico.compile_scene(everything())
    run.advance_to(0.01)
    checkpoint = run.checkpoint()
    kept = checkpoint.to_bytes()
    run.advance_to(0.02)
    run.restore(checkpoint)
    run.advance_to(0.03)
    assert checkpoint.to_bytes() == kept
    other = ico.compile_scene(everything())
    other.restore(checkpoint)
    other.advance_to(0.03)
    assert_same(run, other)


# In plain Python and with fewer lanes, as on a processor without AVX-512.
OTHER_PROCESSOR = """
import logging, sys
import numpy as np
import icofabric_sim as ico
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.kernels.runtime.lanes import LANES

logging.basicConfig(stream=sys.stdout, format='%(message)s')
checkpoint = Checkpoint.load(sys.argv[1])
simulation = ico.compile_scene(ico.Scene.from_parameters(checkpoint.parameters()))
simulation.restore(checkpoint)
print('lanes', LANES)
simulation.advance_to(float(sys.argv[2]))
np.save(sys.argv[3], simulation.snapshot().position)
"""


@pytest.mark.parametrize('method', ['srkn4', 'dop8'])
def test_on_another_processor_the_motion_is_the_same_and_bits_are_not_promised(method, tmp_path):
    plain = ico.compile_scene(make_scene(
        (2, 2, 1), {'solver.method': method, 'solver.tolerance': 1e-3}, **RANDOM))
    plain.advance_steps(7)
    end = plain.status.next_step_time + 0.3 * plain.status.step
    plain.advance_to(plain.time + 0.4 * plain.status.step)
    checkpoint = plain.checkpoint()
    assert method == 'dop8' or 'stepper.window' in checkpoint.arrays
    checkpoint.save(tmp_path / 'saved')
    plain.advance_to(end)
    result = subprocess.run(
        [sys.executable, '-c', OTHER_PROCESSOR, str(tmp_path / 'saved'), repr(end),
         str(tmp_path / 'position.npy')],
        capture_output=True, text=True, check=True, timeout=300,
        env={'NUMBA_DISABLE_JIT': '1', 'NUMBA_CPU_NAME': 'generic', 'NUMBA_CPU_FEATURES': '',
             'PYTHONPATH': ':'.join(sys.path)})
    lines = result.stdout.splitlines()
    assert 'was made on another machine' in lines[0] and 'generic here' in lines[0]
    if LANES != 4:
        assert f'lanes {LANES} in it, 4 here' in lines[0] and lines[1] == 'lanes 4'
    np.testing.assert_allclose(
        np.load(tmp_path / 'position.npy'), plain.snapshot().position, rtol=0, atol=1e-13)


@pytest.mark.parametrize('changes, words', [
    ({'connector.stiffness': 400.0}, 'connector.stiffness is 500.0 in it and 400.0 here'),
    ({'gravity': [0.0, 0.0, -1.0]},
     r'gravity is \[1.0, -2.0, -9.81\] in it and \[0.0, 0.0, -1.0\] here'),
    ({'weave.size': [3, 3, 2], 'shell.thickness': 0.001},
     r'shell.thickness is 0.002 in it and 0.001 here; weave.size is \[3, 3, 3\] in it and'),
    ({'solver.tolerance': 1e-5}, 'solver.tolerance is 0.0001 in it and 1e-05 here'),
    ({'solver.step': 1e-4}, 'solver.step is 0.0 in it and 0.0001 here'),
    ({'solver.method': 'dop8'}, "solver.method is 'auto' in it and 'dop8' here"),
    ({'loads.more.group': 'all'}, 'loads.more.force is not set in it'),
    ({f'groups.g{k}': 'all' for k in range(9)}, 'and 4 more'),
    ({'initial_random.seed': 2}, 'initial_random.seed is 1 in it and 2 here'),
])
def test_checkpoint_of_another_scene_is_refused_with_the_difference(changes, words):
    scene = everything()
    run, other = ico.compile_scene(scene), ico.compile_scene(changed(scene, changes))
    run.advance_to(0.01)
    other.advance_to(0.004)
    untouched = other.checkpoint().to_bytes()
    with pytest.raises(ValueError, match=f'checkpoint cannot be restored here: .*{words}'):
        other.restore(run.checkpoint())
    assert other.checkpoint().to_bytes() == untouched
    assert run.checkpoint().difference(other.checkpoint()) != ''


def test_other_versions_forms_and_shells_are_refused():
    scene = everything()
    run = ico.compile_scene(scene)
    checkpoint = run.checkpoint()
    with pytest.raises(
        ValueError, match="rotation is 'quaternion' in it and 'direction_cosines' here"
    ):
        ico.compile_scene(scene, rotation='direction_cosines').restore(checkpoint)
    checkpoint.header['version'] = '0.0.9'
    with pytest.raises(
        ValueError, match=rf"version is '0.0.9' in it and '{ico.__version__}' here"
    ):
        run.restore(checkpoint)
    checkpoint = run.checkpoint()
    checkpoint.header['method'] = 'srkn8'
    own = run.status.method_name
    with pytest.raises(ValueError, match=f"method is 'srkn8' in it and '{own}' here"):
        run.restore(checkpoint)
    shell = ico.Shell.from_thickness(0.02, 0.002, 1300.0)
    heavier = ico.compile_scene(ico.Scene.from_parameters(scene.parameters, shell=shell))
    with pytest.raises(ValueError, match='mass is .* kg in it and .* kg here'):
        heavier.restore(run.checkpoint())


def test_what_the_motion_does_not_depend_on_may_differ():
    scene = everything()
    run = ico.compile_scene(scene)
    run.advance_to(0.01)
    other = restored(run.checkpoint(), changed(scene, {
        'publish_rate': 7.0, 'marker_rate': 3.0, 'clock_rate': 9.0, 'real_time_factor': 0.0,
        'duration': 5.0, 'step_count': 4, 'input_horizon': 2.0, 'reset_time': True,
        'start_paused': True, 'frame_id': 'map', 'publish_clock': False, 'record.path': 'bag',
        'record.storage': 'sqlite3', 'solver.threads': 1}))
    assert run.checkpoint().difference(other.checkpoint()) == ''


def test_another_processor_or_library_is_accepted_with_a_warning(caplog):
    run = ico.compile_scene(everything())
    run.advance_to(0.01)
    checkpoint = run.checkpoint()
    checkpoint.header['processor'] = 'znver9'
    checkpoint.header['libraries'] = {**checkpoint.header['libraries'], 'numba': '9.9'}
    with caplog.at_level(logging.WARNING):
        run.restore(run.checkpoint())
        assert not caplog.records
        run.restore(checkpoint)
    assert 'last bits of this run may differ' in caplog.text
    assert 'processor znver9 in it' in caplog.text and 'numba 9.9 in it' in caplog.text
    assert 'numpy' not in caplog.text


def test_differences_are_told_in_words():
    run = ico.compile_scene(everything(solver__method='srkn6'))
    run.advance_to(0.01)
    first = run.checkpoint()

    def told(name, change):
        second = Checkpoint.from_bytes(first.to_bytes())
        array = second.arrays[name].copy()
        change(array)
        second.arrays[name] = array
        return first.difference(second)

    def nudge(array):
        array[3, 1] = np.nextafter(array[3, 1], 9.0)

    assert told('stepper.state.position', nudge).startswith('position of body 3 is ')
    assert told('stepper.acceleration', nudge).startswith('acceleration of body 3 is ')

    def sign(array):
        array[:] = np.where(array == 0.0, -array, array)

    # A support holds it: its velocity is zero, and a zero with the other sign is another.
    assert 'is 0.0 in the first and -0.0 in the second' in told(
        'stepper.state.linear_velocity', sign)
    run.apply_wrench('steady', (0.0, 0.0, 1.0), time=0.02)
    assert 'inputs.queue is' in first.difference(run.checkpoint())
    run.advance_to(0.011)
    assert first.difference(run.checkpoint()).startswith(
        'time is 0.01 in the first and 0.011 in the second')
    assert first.difference(Checkpoint.from_bytes(first.to_bytes())) == ''


def test_parameters_are_those_of_the_scene():
    scene = make_scene((2, 2, 2), {'shell.inner_edge_length': 0.015, 'groups.g': 'ids 0 1'})
    parameters = ico.compile_scene(scene).checkpoint().parameters()
    assert dict(parameters) == dict(scene.parameters)
    assert ico.Scene.from_parameters(parameters).body_count == scene.body_count


@pytest.mark.parametrize('kind', [bytes, bytearray, memoryview])
def test_bytes_of_any_kind_are_read(kind):
    data = ico.compile_scene(make_scene((2, 2, 2))).checkpoint().to_bytes()
    assert Checkpoint.from_bytes(kind(data)).to_bytes() == data


def test_adaptive_steps_that_were_given_up_are_not_gone_back_to():
    scene = everything(solver__method='dop8')
    run = ico.compile_scene(scene)
    for time in np.arange(1, 60) * 7e-4:
        run.advance_to(time)
        run.apply_wrench('steady', (0.0, 0.1 * time, 0.0))
        run._event_loop.settle_inputs()  # as when time goes on
        assert run._driver.trajectory.saved_time <= time
        assert run._driver.trajectory.control.length == 0.0
    # What is kept is the state of its time: a run from there comes by.
    saved = run.checkpoint().arrays['stepper.saved.position']
    again = ico.compile_scene(scene)
    for time in np.arange(1, 60) * 7e-4:
        if time > run._driver.trajectory.saved_time:
            break
        again.advance_to(time)
        again.apply_wrench('steady', (0.0, 0.1 * time, 0.0))
    again.advance_to(run._driver.trajectory.saved_time)
    # Where an input is settled a step ends; before that the state shown lies within one.
    assert np.abs(again.snapshot().position - saved).max() < 1e-9
    assert all(np.isfinite(getattr(again.snapshot(), name)).all() for name in STATE)
