# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Parameter studies in one process: plans, keys, the store, tables, the verb."""

import csv
from dataclasses import replace
import hashlib
import json
import math
import shutil
import signal
import sys
import types

import icofabric_sim as ico
from icofabric_sim.commands import sweep as sweep_command
from icofabric_sim.commands.main import main
from icofabric_sim.parameters.validation import make_parameters, ParameterError
from icofabric_sim.scene import scene as scenes
from icofabric_sim.sweeps import dask_runs, run_key, single_run
from icofabric_sim.sweeps import sweep as sweeps
from icofabric_sim.sweeps.dask_runs import Pool
from icofabric_sim.sweeps.outcomes import carry_out, Column, make_work, RunFailed
from icofabric_sim.sweeps.plan import make_plan
from icofabric_sim.sweeps.run_key import key_of
from icofabric_sim.sweeps.single_run import perform, State
from icofabric_sim.sweeps.store import Finished, Store
from icofabric_sim.sweeps.sweep import Executor, Study
import numpy as np
from package_imports import PACKAGE, ROOMS
import pytest

# Kernel variants that tests of verbs compile, too.
WOVEN = {'weave.size': [3, 3, 3], 'connector.stiffness': 500.0,
         'connector.bending_stiffness': 0.02, 'weave.connector_angle': 0.3}
SWING = {
    'weave.size': [3, 3, 3], 'weave.connector_angle': 0.3, 'gravity': [0.0, 0.0, -9.81],
    'groups.wall': 'x_min', 'groups.tip': 'x_max', 'supports.wall.group': 'wall',
    'loads.tip.group': 'tip', 'loads.tip.share': 'total', 'duration': 0.05}
BASE = make_parameters(WOVEN)
AROUND = {'source': 's', 'libraries': 'l', 'kernels': 'k'}


@pytest.fixture(scope='module')
def woven():
    return ico.Scene.from_parameters(WOVEN)


@pytest.fixture(scope='module')
def swing():
    return ico.Scene.from_parameters(SWING)


# Plans.

def test_a_grid_goes_through_all_values_the_last_name_fastest():
    plan = make_plan(BASE, vary={
        'connector.stiffness': [300, 500.0], 'weave.connector_angle': '0.1..0.3/3'})
    assert plan.names == ('connector.stiffness', 'weave.connector_angle')
    assert [point[0] for point in plan.points] == [300.0] * 3 + [500.0] * 3
    assert all(type(point[0]) is float for point in plan.points)
    assert [point[1] for point in plan.points[:3]] == pytest.approx([0.1, 0.2, 0.3], abs=1e-15)
    assert plan.parameters(5)['connector.stiffness'] == 500.0
    assert plan.parameters(5)['solver.threads'] == 1


def test_ranges_hit_their_ends_and_divide_logarithms_and_integers():
    plan = make_plan(BASE, vary={
        'connector.stiffness': {'from': 1e-3, 'to': 1e3, 'count': 7, 'log': True}})
    values = [value for value, in plan.points]
    assert values[0] == 1e-3 and values[-1] == 1e3
    assert values == pytest.approx([10.0**k for k in range(-3, 4)], rel=1e-12)
    sizes = make_plan(BASE, vary={'weave.size[2]': '3..7/3'})
    assert [sizes.parameters(number)['weave.size'] for number in range(3)] == [
        [3, 3, 3], [3, 3, 5], [3, 3, 7]]


def test_cases_go_together_and_cross_with_the_grid():
    plan = make_plan(
        BASE, vary={'weave.variant': [0, 1]},
        cases=[{'connector.stiffness': 300.0}, {'connector.damping': 0.1}])
    assert plan.names == ('connector.stiffness', 'connector.damping', 'weave.variant')
    assert plan.points == (
        (300.0, None, 0), (300.0, None, 1), (None, 0.1, 0), (None, 0.1, 1))
    assert plan.parameters(3)['connector.stiffness'] == 500.0


@pytest.mark.parametrize('method', ['sobol', 'halton', 'latin', 'random'])
def test_samples_are_seeded_spread_and_within_their_ranges(method):
    vary = {'connector.stiffness': '1..1000 log', 'weave.connector_angle': '0.1..0.7',
            'weave.variant': '0..3'}

    def points(count, seed):
        return make_plan(BASE, vary=vary, sample={
            'method': method, 'count': count, 'seed': seed}).points

    found = points(50, 3)
    assert found == points(50, 3) and found != points(50, 4) and len(found) == 50
    stiffness, angle, variant = (np.array(column) for column in zip(*found))
    assert 0.35 < (stiffness < math.sqrt(1000.0)).mean() < 0.65
    assert angle.min() >= 0.1 and angle.max() <= 0.7 and np.ptp(angle) > 0.4
    assert {*variant.tolist()} == {0, 1, 2, 3}
    if method != 'latin':
        assert points(20, 3) == found[:20]


@pytest.mark.parametrize('words, said', [
    ({'vary': {'conector.stiffness': [1.0]}}, 'did you mean connector.stiffness'),
    ({'vary': {'connector.stiffness': [-1.0]}}, 'connector.stiffness must be at least 0'),
    ({'vary': {'connector.stiffness': []}}, 'connector.stiffness must be a list of values'),
    ({'vary': {'connector.stiffness': 5.0}}, 'connector.stiffness must be a list of values'),
    ({'vary': {'connector.stiffness': '5..1/3'}}, 'the lower end must be below'),
    ({'vary': {'connector.stiffness': '0..1/3log'}}, 'must start above 0'),
    ({'vary': {'connector.stiffness': '0..1/1'}}, 'count of a range must be from 2'),
    ({'vary': {'connector.stiffness': {'from': 1, 'to': 2, 'step': 1}}}, 'unknown key step'),
    ({'vary': {'connector.stiffness': {'from': 1, 'to': 'x'}}}, 'to must be a number'),
    ({'vary': {'connector.stiffness': '1..2'}}, 'range without a count'),
    ({'vary': {'gravity': '1..2/3'}}, r'such as gravity\[0\]'),
    ({'vary': {'gravity[3]': [1.0]}}, 'gravity has 3 elements'),
    ({'vary': {'gravity[0]': [1.0], 'gravity': [[0.0, 0.0, 0.0]]}}, 'cannot both vary'),
    ({'vary': {'weave.size[0]': '3..6/3'}}, 'not all integers'),
    ({'vary': {'solver.threads': [1, 2]}}, 'solver.threads cannot vary'),
    ({'vary': {'weave.variant': '0..3', 'connector.stiffness': '1..9/2000000'}}, 'from 2 to'),
    ({'vary': {'connector.stiffness': '1..9/9999', 'connector.damping': '1..9/9999'}},
     '99,980,001 runs'),
    ({'vary': {'connector.stiffness': [1.0]}, 'sample': {'count': 3}}, 'needs at least one range'),
    ({'vary': {'connector.stiffness': '1..2'}, 'sample': {'method': 'x', 'count': 3}},
     'sample: method must be one of sobol'),
    ({'vary': {'connector.stiffness': '1..2'}, 'sample': {}}, 'the number of points, is missing'),
    ({'vary': {'connector.stiffness': '1..2'}, 'sample': {'count': 0}}, 'sample: count'),
    ({'cases': []}, 'at least one dictionary'),
    ({'cases': [{}]}, 'case 0 must be a dictionary'),
    ({'cases': [{'connector.damping': -1.0}]}, 'connector.damping must be at least 0'),
    ({'cases': [{'connector.damping': 1.0}], 'vary': {'connector.damping': [1.0]}},
     'connector.damping is also in vary')])
def test_a_plan_that_makes_no_sense_is_refused_by_name(words, said):
    with pytest.raises(ValueError, match=said):
        make_plan(BASE, **words)


@pytest.mark.parametrize('words, said', [
    ({'verbs': 'fly'}, 'verbs must be one of run'),
    ({'verbs': []}, 'at least one of run'),
    ({'keep': 'moduli'}, 'moduli needs the verb elasticity'),
    ({'keep': 'momentum'}, 'is not known; choose from: energies'),
    ({'keep': 'displacement'}, 'must be: displacement GROUP'),
    ({'verbs': 'statics', 'keep': 'displacement tip'}, 'no such group; groups: all'),
    ({'verbs': 'modes', 'keep': 'frequencies 0'}, 'a count from 1 to 1000'),
    ({'verbs': 'curve', 'keep': 'curve pull -1'}, 'curve: STRAIN must be'),
    ({'verbs': 'curve', 'keep': 'curve bend 0.1'}, 'curve: KIND must be one of pull'),
    ({'verbs': 'curve', 'keep': 'curve pull 0.1 2 xz'}, 'AXIS must be one of x, y, z, got'),
    ({'verbs': 'curve', 'keep': 'curve shear 0.1 2 xx'}, 'AXIS must be one of x, y, z, xy, xz'),
    ({'verbs': 'curve', 'keep': 'curve pull 0.1 0'}, 'POINTS must be an integer'),
    ({'verbs': 'curve', 'keep': 'strength bend 0.1'}, 'strength: KIND must be one of pull'),
    ({'verbs': 'curve', 'keep': 'cycle push 1.5'}, 'cycle: STRAIN must be'),
    ({'verbs': 'curve', 'keep': 'independent pull 0.1'}, 'connector.bending_stiffness'),
    ({'verbs': 'bands', 'keep': 'gap 0'}, 'gap takes a count from 1 to 100'),
    ({'verbs': 'mechanisms', 'keep': 'gap'}, 'gap needs the verb bands'),
    ({'verbs': 'elasticity', 'keep': 'moduli tight'}, 'moduli takes relaxed or nothing'),
    ({'verbs': 'elasticity', 'keep': ['moduli', 'moduli relaxed']}, 'give relaxed in all'),
    ({'verbs': 'bands', 'keep': 'gap 3 tight'}, 'gap takes a count and relaxed'),
    ({}, 'duration must be above 0'),
    ({'verbs': 'elasticity', 'vary': {'weave.kind': ['bias', 'radial']}},
     r"run 1 \(weave.kind 'radial'\): weave.kind radial is not periodic"),
    ({'verbs': 'statics', 'vary': {
        'connector.obstruction': ['wrap'], 'connector.attachment_scale': [0.9]}},
     'attachment_scale'),
    ({'verbs': 'bands', 'vary': {'connector.stiffness_compression': [5.0]}}, 'no bands')])
def test_work_that_a_scene_cannot_give_is_refused_before_anything_starts(
        woven, tmp_path, words, said):
    with pytest.raises(ValueError, match=said):
        ico.sweep(woven, **{'vary': {'connector.stiffness': [300.0]}, **words},
                  store=tmp_path / 'store', workers=0)
    assert not (tmp_path / 'store').exists()


# Keys.

def test_a_key_depends_on_all_that_a_result_depends_on(tmp_path):
    work = make_work('elasticity')

    def key(changes=(), files=(), work=work, **environment):
        parameters = make_plan(make_parameters({**WOVEN, **dict(changes)})).parameters(0)
        return key_of(parameters, dict(files), work, {**AROUND, **environment})

    same = {key(), key({'solver.threads': 2}), key({'real_time_factor': 3.0}),
            key({'record.path': 'x'}), key({'weave.variant': 0})}
    assert len(same) == 1
    other = {key({'connector.stiffness': math.nextafter(500.0, 501.0)}), key(files={'f': '1'}),
             key(files={'f': '2'}), key(work=make_work('bands')), key(source='t'),
             key(work=make_work(['elasticity', 'bands'])), key(libraries='m'), key(kernels='n')}
    assert len(other | same) == 9


def test_a_key_covers_the_source_of_every_room_up_to_sweeps():
    covered = {*run_key._ROOMS, *(name.removesuffix('.py') for name in run_key._MODULES)}
    # Libraries are named by their versions; the runtime is a folder of the kernels.
    assert covered == {*ROOMS[:ROOMS.index('sweeps') + 1]} - {'libraries', 'runtime'}
    assert run_key._PACKAGE == PACKAGE
    assert all((PACKAGE / name).exists() for name in (*run_key._ROOMS, *run_key._MODULES))


def test_a_changed_file_is_another_run(tmp_path):
    law = tmp_path / 'law.csv'

    def study():
        return Study.from_parameters(
            make_parameters({**WOVEN, 'connector.law': str(law)}),
            {'weave.variant': [0, 1]}, verbs='elasticity', store=tmp_path / 'store')

    law.write_text('0.001,-1\n0.02,0\n0.04,5\n')
    first, again = study(), study()
    law.write_text('0.001,-1\n0.02,0\n0.04,6\n')
    second = study()
    assert first.requests == again.requests
    assert {one.key for one in first.requests}.isdisjoint(one.key for one in second.requests)
    # The worker reads what the plan has read, whatever is on disk by then.
    outcomes = list(first.outcomes(Executor(0, '')))
    assert [one.state for one in outcomes] == [State.DONE] * 2, outcomes
    assert {one.reused for one in second.outcomes(Executor(0, ''))} == {False}


# The store.

def test_a_run_is_there_whole_or_not_at_all(tmp_path):
    store, key = Store(tmp_path / 'store'), 'a' * 32
    store.prepare()
    found = Finished((Column('x', 'm', 0.1 + 0.2), Column('y', '', math.nan),
                      Column('z', '', 'words'), Column('n', '', 3)), '')
    with store.temporary_folder(key) as folder:
        (folder / 'half').write_text('x')
        assert store.read(key) is None and store.keys() == set()
    assert not list((store.path / '.work').iterdir())
    for _ in range(2):
        # The second one finds that another was quicker.
        with store.temporary_folder(key) as folder:
            store.finish(key, folder, found, {})
    assert store.keys() == {key}
    there = store.read(key)
    assert there.columns[0] == found.columns[0] and there.columns[2:] == found.columns[2:]
    assert math.isnan(there.columns[1].value) and there.reason == ''
    (store.folder(key) / 'result.json').write_text('{"colu')
    assert store.read(key) is None
    with store.temporary_folder(key) as folder:
        store.finish(key, folder, found, {})
    assert store.read(key) is not None
    store.forget(key)
    assert store.keys() == set()


def test_one_process_at_a_time_does_a_run(tmp_path):
    store, key = Store(tmp_path), 'b' * 32
    store.prepare()
    with store.claim(key) as mine:
        with store.claim(key) as other:
            assert mine and not other
    with store.claim(key) as mine:
        assert mine
    assert not list((tmp_path / '.locks').iterdir())


def test_what_a_killed_worker_left_is_thrown_away(tmp_path):
    import socket
    store = Store(tmp_path)
    store.prepare()
    gone = tmp_path / '.work' / f'{"c" * 32}@{socket.gethostname()}@999999999@x'
    elsewhere = tmp_path / '.work' / f'{"c" * 32}@another-machine@1@x'
    gone.mkdir()
    elsewhere.mkdir()
    with store.temporary_folder('d' * 32) as alive:
        store.prepare()
        assert alive.exists() and elsewhere.exists() and not gone.exists()


def test_a_store_keeps_the_files_that_their_names_promise(tmp_path):
    store, content = Store(tmp_path / 'store'), b'0.001,-1\n0.02,0\n'
    total = hashlib.sha256(content).hexdigest()
    store.prepare()
    store.keep_file(total, content)
    assert store.file(total) == content
    (store.path / '.files' / total).write_bytes(content[:5])
    with pytest.raises(OSError, match='is damaged'):
        store.file(total)
    store.keep_file(total, content)
    assert store.file(total) == content and len(list((store.path / '.files').iterdir())) == 1


def test_a_damaged_file_spoils_no_run(tmp_path):
    law = tmp_path / 'law.csv'
    law.write_text('0.001,-1\n0.02,0\n0.04,5\n')
    study = Study.from_parameters(
        make_parameters({**WOVEN, 'connector.law': str(law)}), verbs='elasticity',
        store=tmp_path / 'store')
    study.store.prepare()
    [total] = study.requests[0].files.values()
    (study.store.path / '.files' / total).write_text('0.001,-1\n0.02,0\n0.04,9\n')
    outcome = perform(study.requests[0])
    assert outcome.state is State.LOST and 'is damaged' in outcome.reason
    assert study.finished() == {}


def test_results_go_to_the_store_of_the_study_alone(woven, tmp_path):
    study = Study(woven, {'connector.stiffness': [300.0]}, verbs='elasticity',
                  store=tmp_path / 'store')
    [request] = study.requests
    nowhere = tmp_path / 'nowhere' / 'deep'
    with pytest.raises(single_run.WorkersDiffer, match='the worker x cannot access the store'):
        perform(request._replace(store=str(nowhere)), 'the worker x')
    assert not nowhere.parent.exists()
    study.store.prepare()
    identity = study.store.identity
    study.store.prepare()
    assert identity and study.store.identity == identity
    other = Store(tmp_path / 'other')
    other.prepare()
    with pytest.raises(single_run.WorkersDiffer, match='choose a folder'):
        perform(request._replace(store=str(other.path), identity=identity))
    assert other.keys() == set()
    assert perform(request._replace(identity=identity)).state is State.DONE


# Runs.

def test_a_table_has_what_python_finds_and_a_second_study_takes_it_from_the_store(
        woven, tmp_path, monkeypatch):
    vary = {'weave.connector_angle': [0.2, 0.4], 'connector.stiffness': [300.0, 500.0]}
    heard = []
    table = ico.sweep(
        woven, vary, verbs='elasticity', store=tmp_path / 'store', workers=0,
        progress=lambda *numbers: heard.append(numbers))
    assert heard == [(1, 4), (2, 4), (3, 4), (4, 4)] and len(table) == 4 and not table.failed
    for row in range(4):
        scene = woven.with_changes({name: float(table[name][row]) for name in vary})
        found = ico.homogenise(scene)
        assert table['elasticity.stiffness.yz.yz'][row] == pytest.approx(
            found.stiffness[3, 3], rel=1e-12)
        assert table['elasticity.density'][row] == found.density
        assert table['elasticity.young.xyz.tension'][row] == pytest.approx(
            float(found.young_modulus(np.ones(3))), rel=1e-9)
    assert table.units['elasticity.density'] == 'kg/m^3'
    monkeypatch.setattr(single_run, 'carry_out', None)
    again = ico.sweep(
        woven, {**vary, 'connector.stiffness': [500.0, 300.0]}, verbs='elasticity',
        store=tmp_path / 'store', workers=0)
    assert all(outcome.reused for outcome in again.outcomes)
    assert again['elasticity.density'].tolist() == table['elasticity.density'].tolist()


def test_a_run_gives_the_bits_of_a_simulation_and_a_bag_that_verifies(swing, tmp_path, capsys):
    table = ico.sweep(
        swing, {'connector.stiffness': [500.0, 600.0]}, verbs=['run', 'statics', 'modes'],
        keep=['energies', 'displacement tip', 'bag', 'reaction wall', 'frequencies 2', 'extremes',
              'tension'],
        store=tmp_path / 'store', workers=0)
    assert not table.failed, table.failed
    simulation = ico.compile_scene(swing.with_changes({'connector.stiffness': 600.0}))
    simulation.advance_to(0.05)
    snapshot = simulation.snapshot()
    assert table['run.energy.kinetic'][1] == snapshot.energy['kinetic']
    tip = swing.groups['tip']
    moved = (snapshot.position[tip] - swing.position[tip]).mean(axis=0)
    assert [table[f'run.displacement.tip.{axis}'][1] for axis in 'xyz'] == moved.tolist()
    assert table['run.largest_displacement'][1] >= table['run.displacement.tip.largest'][1] > 0.0
    assert table['run.stretch'][1] > 0.0 > table['run.compression'][1]
    assert table['statics.largest_tension'][1] > 0.0 > table['statics.least_tension'][1]
    # The wall bears what falls.
    weight = swing.shell.mass * swing.body_count * 9.81
    assert table['statics.reaction.wall.z'][0] == pytest.approx(weight, rel=0.2)
    assert table['modes.frequency.0'][0] > 0.0
    assert 'statics.energy.kinetic' not in table.kept
    before = signal.getsignal(signal.SIGTERM)
    assert main(['verify', str(table.folder(1) / 'bag')]) == 0
    signal.signal(signal.SIGTERM, before)
    assert 'identical' in capsys.readouterr().out


def test_a_failure_is_kept_with_its_reason_until_it_is_tried_again(swing, tmp_path):
    words = {'verbs': 'run', 'keep': 'energies', 'store': tmp_path / 'store', 'workers': 0}
    vary = {'solver.step': [0.0, 0.04]}
    table = ico.sweep(swing, vary, **words)
    [failed] = table.failed
    assert failed.number == 1 and 'stability limit' in failed.reason
    assert math.isnan(table['run.energy.kinetic'][1]) and table['run.energy.kinetic'][0] > 0.0
    assert (table.folder(1) / 'failure.json').exists()
    assert [one.reused for one in ico.sweep(swing, vary, **words).outcomes] == [True, True]
    assert [one.reused for one in ico.sweep(swing, vary, retry=True, **words).outcomes] == [
        True, False]


def test_what_the_machine_is_to_blame_for_is_not_kept(swing, tmp_path, monkeypatch):
    def full(*arguments):
        raise MemoryError

    monkeypatch.setattr(single_run, 'carry_out', full)
    words = {'verbs': 'run', 'store': tmp_path / 'store', 'workers': 0}
    [lost] = ico.sweep(swing, {'connector.stiffness': [500.0]}, **words).outcomes
    assert lost.state is State.LOST and 'memory' in lost.reason
    monkeypatch.setattr(single_run, 'carry_out', carry_out)
    [done] = ico.sweep(swing, {'connector.stiffness': [500.0]}, **words).outcomes
    assert done.state is State.DONE and not done.reused


def test_a_shortage_of_memory_that_is_foreseen_is_not_kept(woven, tmp_path, monkeypatch):
    study = Study(woven, {'connector.stiffness': [500.0]}, verbs='elasticity', store=tmp_path)
    study.store.prepare()
    with monkeypatch.context() as patch:
        patch.setattr(scenes, '_UNCHECKED_BYTES', 0)
        patch.setattr(scenes, 'available_memory', lambda: 10)
        lost = perform(study.requests[0])
        # Elsewhere it is a parameter that cannot be taken.
        with pytest.raises(ParameterError, match='choose a smaller one'):
            ico.Scene.from_parameters(WOVEN)
    assert lost.state is State.LOST and 'weave.size' in lost.reason and 'GiB' in lost.reason
    [done] = study.outcomes(Executor(0, ''))
    assert done.state is State.DONE and not done.reused


def test_an_error_of_one_run_does_not_end_the_others(woven, tmp_path, monkeypatch):
    def sometimes(work, scene, folder):
        if scene.parameters['connector.stiffness'] == 500.0:
            raise RuntimeError('out of\norder')
        return carry_out(work, scene, folder)

    monkeypatch.setattr(single_run, 'carry_out', sometimes)
    table = ico.sweep(woven, {'connector.stiffness': [500.0, 600.0]}, verbs='elasticity',
                      store=tmp_path / 'store', workers=0)
    assert [one.state for one in table.outcomes] == [State.LOST, State.DONE]
    assert table.failed[0].reason == 'RuntimeError: out of order'
    # Nor does a store in which nothing can be claimed.
    shutil.rmtree(tmp_path / 'store' / '.locks')
    request = Study(woven, {'connector.stiffness': [700.0]}, verbs='elasticity',
                  store=tmp_path / 'store').requests[0]
    assert perform(request).state is State.LOST


def test_what_another_study_has_mended_is_not_tried_again(woven, tmp_path, monkeypatch):
    study = Study(woven, {'connector.stiffness': [500.0]}, verbs='elasticity', store=tmp_path)

    def fail(*words):
        raise RunFailed('it broke')

    with monkeypatch.context() as patch:
        patch.setattr(single_run, 'carry_out', fail)
        assert [one.state for one in study.outcomes(Executor(0, ''))] == [State.FAILED]
    request = study.requests[0]._replace(retry=True)
    # While somebody is at it, what is there stays.
    with study.store.claim(request.key):
        assert perform(request).state is State.BUSY
        assert study.store.read(request.key).reason == 'it broke'
    assert [one.state for one in study.outcomes(Executor(0, ''), retry=True)] == [State.DONE]
    assert perform(request).reused


class FakeFuture:
    """Answers as soon as somebody asks for it."""

    status = 'finished'

    def __init__(self, client, request):
        self.client, self.request = client, request

    def add_done_callback(self, call):
        if self.client.answers:
            call(self)

    def result(self, timeout=None):
        self.client.log.append(('answered', self.request.number))
        return single_run.Outcome(self.request.number, self.request.key, State.DONE)


class FakeClient:
    """As a client of Dask, with a scheduler that does nothing."""

    status = 'running'

    def __init__(self, answers=True, threads=None):
        self.answers, self.threads, self.log = answers, threads or {'tcp://w:1': 1}, []
        self.scheduler = types.SimpleNamespace(address='tcp://s:1')

    def nthreads(self):
        if isinstance(self.threads, Exception):
            raise self.threads
        return {} if self.threads == 'none' else self.threads

    def submit(self, function, request, **words):
        self.log.append(('sent', request.number))
        return FakeFuture(self, request)

    def cancel(self, futures, force=False):
        pass


def test_runs_wait_for_the_one_that_compiles_their_kernels(woven, tmp_path):
    """Two kernel variants: bending connectors and others."""
    study = Study(woven, {'connector.bending_stiffness': [0.02, 0.0],
                          'connector.stiffness': [300.0, 500.0, 700.0]},
                  verbs='elasticity', store=tmp_path)
    leaders, followers = study._by_kernel_variant(study.requests)
    assert [one.number for one in leaders] == [0, 3]
    assert {place: [one.number for one in requests] for place, requests in followers.items()} == {
        0: [1, 2], 1: [4, 5]}
    client = FakeClient()
    done = [one.number for one in Pool(client).perform(leaders, followers)]
    assert sorted(done) == [0, 1, 2, 3, 4, 5]
    for follower, leader in ((1, 0), (2, 0), (3, 0), (4, 3), (5, 3)):
        assert client.log.index(('sent', follower)) > client.log.index(('answered', leader))


@pytest.mark.parametrize('threads, said', [
    ('none', 'the scheduler tcp://s:1'),
    (OSError('broken'), 'tcp://s:1 is lost'), (RuntimeError('closed'), 'tcp://s:1 is lost')])
def test_a_sweep_without_workers_or_scheduler_ends(woven, tmp_path, monkeypatch, threads, said):
    monkeypatch.setattr(dask_runs, 'WORKERS_WITHIN', 0.1)
    monkeypatch.setattr(
        dask_runs, '_DASK', replace(dask_runs._DASK, poll_interval_s=0.02))
    study = Study(woven, {'connector.stiffness': [300.0]}, verbs='elasticity', store=tmp_path)
    with pytest.raises(dask_runs.SchedulerLost, match=said):
        list(Pool(FakeClient(False, threads)).perform(study.requests, {}))


def test_a_worker_of_another_version_is_refused(swing, tmp_path):
    study = Study(swing, {'connector.stiffness': [500.0]}, store=tmp_path / 'store')
    study.store.prepare()
    for name, said in (('source', 'version of icofabric_sim'), ('kernels', 'NUMBA_CPU_NAME'),
                       ('libraries', 'other versions of libraries')):
        request = study.requests[0]
        with pytest.raises(single_run.WorkersDiffer, match=said):
            perform(request._replace(environment={**request.environment, name: 'other'}))


def test_large_fabrics_and_many_runs_are_validated_without_building_each(tmp_path, monkeypatch):
    built = []
    make = ico.Scene.from_parameters
    monkeypatch.setattr(
        sweeps.Scene, 'from_parameters',
        lambda *words: built.append(1) or make(*words))
    words = {'verbs': 'elasticity', 'store': tmp_path}
    Study.from_parameters(BASE, {'connector.stiffness': '1..2/4'}, **words)
    each = len(built)
    monkeypatch.setattr(sweeps, '_BUILT_RUNS', 3)
    Study.from_parameters(BASE, {'connector.stiffness': '1..2/4'}, **words)
    assert len(built) - each == each // 4
    # What is wrong is found all the same, in a run that is not built.
    with pytest.raises(ValueError, match='run 3 .*duration must be above 0'):
        Study.from_parameters(BASE, {'duration': [0.1, 0.2, 0.3, 0.0]}, store=tmp_path)
    with pytest.raises(ValueError, match='run 3 .*weave.connector_length'):
        Study.from_parameters(
            BASE, {'weave.connector_length': [0.0, 0.0, 0.0, 1e3]}, **words)


def test_points_that_are_alike_are_one_run(woven, tmp_path, monkeypatch):
    done = []
    monkeypatch.setattr(
        sweeps, 'perform', lambda request: done.append(request) or perform(request))
    table = ico.sweep(
        woven, {'connector.stiffness': [300.0, 300.0, 300]}, verbs='elasticity', workers=0,
        store=tmp_path)
    assert len(done) == 1 and len(table) == 3
    assert len({*table['elasticity.density'].tolist()}) == 1


# Tables.

def test_what_a_case_does_not_say_is_a_hole_in_its_column(woven, tmp_path):
    study = Study(woven, cases=[
        {'loads.x.group': 'all', 'loads.x.force': [0.0, 0.0, 1.0], 'loads.x.hold': 1.0},
        {'gravity': [0.0, 0.0, -1.0]}], verbs='elasticity', store=tmp_path)
    table = study.table([single_run.Outcome(number, 'k', State.LOST, reason='no')
                         for number in range(2)])
    assert table['gravity'].tolist() == [[0.0, 0.0, 0.0], [0.0, 0.0, -1.0]]
    assert table['loads.x.force'][0].tolist() == [0.0, 0.0, 1.0]
    assert table['loads.x.force'].shape == (2, 3) and np.isnan(table['loads.x.force'][1]).all()
    assert table['loads.x.group'].tolist() == ['all', '']
    assert table['loads.x.hold'][0] == 1.0 and math.isnan(table['loads.x.hold'][1])
    table.save(tmp_path / 'x.csv')
    with open(tmp_path / 'x.csv', newline='') as stream:
        assert [row['loads.x.force [N]'] for row in csv.DictReader(stream)] == [
            '[0.0, 0.0, 1.0]', '']
    # No run is finished, so no column of results is there.
    assert len(table.lines(columns=['elasticity.density', 'gravity'])) == 3


def test_files_have_units_and_all_digits(woven, tmp_path):
    table = ico.sweep(
        woven, {'connector.stiffness': [1.0 / 3.0, 500.0], 'gravity': [[0.0, 0.0, -9.81]]},
        verbs='elasticity', store=tmp_path / 'store', workers=0)
    table.save(tmp_path / 'x.csv')
    with open(tmp_path / 'x.csv', newline='') as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row['connector.stiffness [N/m]']) for row in rows] == [1.0 / 3.0, 500.0]
    assert [float(row['elasticity.density [kg/m^3]']) for row in rows] == (
        table['elasticity.density'].tolist())
    assert json.loads(rows[0]['gravity [m/s^2]']) == [0.0, 0.0, -9.81]
    assert rows[0]['state'] == 'done' and len(rows[0]['key']) == 32
    with pytest.raises(ValueError, match=r'ends in .csv or .parquet'):
        table.save(tmp_path / 'x.txt')
    with pytest.raises(KeyError, match='there is no column'):
        table['elasticity.mass']
    with pytest.raises(KeyError, match='there is no run 2'):
        table.folder(2)
    parquet = pytest.importorskip('pyarrow.parquet')
    table.save(tmp_path / 'x.parquet')
    found = parquet.read_table(tmp_path / 'x.parquet')
    assert found.column('connector.stiffness [N/m]').to_pylist() == [1.0 / 3.0, 500.0]
    field = found.schema.field('elasticity.density [kg/m^3]')
    assert field.metadata[b'unit'] == b'kg/m^3'
    assert 'SweepTable: 2 runs' in repr(table) and len(table.lines(1)) == 3


def test_without_pyarrow_parquet_says_the_way(woven, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'pyarrow', None)
    with pytest.raises(ValueError, match='pip install pyarrow; a CSV'):
        ico.sweep(woven, {'connector.stiffness': [500.0]}, verbs='elasticity',
                  store=tmp_path, workers=0).save(tmp_path / 'x.parquet')


def test_without_dask_the_way_is_said(woven, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'distributed', None)
    with pytest.raises(ValueError, match='--workers 0'):
        ico.sweep(woven, {'connector.stiffness': [500.0]}, verbs='elasticity',
                  store=tmp_path, workers=2)


# The verb.

@pytest.fixture
def verb(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    before = signal.getsignal(signal.SIGTERM)

    def call(*words):
        try:
            status = main(['sweep', *words])
        except SystemExit as end:
            status = end.code
        return status, *capsys.readouterr()

    yield call
    signal.signal(signal.SIGTERM, before)


STUDY = """\
# Two weaves.
scene: stiff_cantilever
parameters: {weave.size: [3, 3, 3], gravity: [0.0, 0.0, 0.0]}
vary:
  connector.stiffness: {from: 1e3, to: 2e3, count: 2}
  weave.connector_angle: 0.1..0.7
sample: {method: halton, count: 3}
verbs: [elasticity]
"""


def test_a_study_of_a_file_writes_table_and_picture(verb, tmp_path):
    (tmp_path / 'weaves.yaml').write_text(STUDY)
    status, said, _ = verb('weaves.yaml', '--list')
    assert status == 0 and '6 runs of elasticity' in said and '0 finished in ' in said
    assert not (tmp_path / 'runs').exists()
    status, said, _ = verb('weaves.yaml', '--workers', '0', '--picture', 'runs/weaves.png')
    assert status == 0 and '6 runs, 0 from the store, 0 failed' in said
    rows = (tmp_path / 'runs' / 'sweep' / 'weaves.csv').read_text().splitlines()
    assert len(rows) == 7 and rows[0].startswith('run,connector.stiffness [N/m],weave.connector_a')
    assert (tmp_path / 'runs' / 'weaves.png').stat().st_size > 10_000
    status, said, _ = verb('weaves.yaml', '--workers', '0', '--json')
    table = json.loads(said)
    assert status == 0 and table['reused'] == 6
    assert table['table']['connector.stiffness [N/m]'] == [1e3] * 3 + [2e3] * 3
    status, said, error = verb(
        'weaves.yaml', '--workers', '0', '--columns', 'connector.stiffness',
        'elasticity.density', '--picture', 'runs/one.png')
    assert status == 0 and said.count('connector.stiffness') == 1, error
    status, _, error = verb('weaves.yaml', '--workers', '0', '--columns', 'elasticity.mass')
    assert status == 2 and '--columns elasticity.mass: unknown column' in error


def test_planning_says_how_far_it_is(verb, monkeypatch):
    """On a terminal it would be a bar."""
    said = []
    monkeypatch.setattr(sweep_command.Progress, 'update',
                        lambda self, done: said.append((self.unit, done, self.total)))
    status, *_ = verb('stiff_cantilever', '-p', 'weave.size:=[3, 3, 3]', '--verb', 'elasticity',
                      '--vary', 'connector.damping:=[0.0, 1.0, 2.0]', '--list')
    assert status == 0 and said == [('runs validated', done, 3) for done in (1, 2, 3)]


def test_a_study_of_flags_ends_with_1_where_a_run_fails(verb):
    status, said, notes = verb(
        'stiff_cantilever', '-p', 'weave.size:=[3, 3, 3]', '--vary', 'solver.step:=[0.5]',
        '--duration', '0.01', '--workers', '0', '--keep', 'energies')
    assert status == 1 and 'failed: ' in said and '1 run, 0 from the store' in said
    assert 'run 0 (solver.step 0.5): failed: ' in notes
    # No run is finished, so the columns are unknown.
    status, _, error = verb(
        'stiff_cantilever', '-p', 'weave.size:=[3, 3, 3]', '--vary', 'solver.step:=[0.5]',
        '--duration', '0.01', '--workers', '0', '--keep', 'energies', '--columns',
        'run.energy.kinetic', '--picture', 'x.png')
    assert status == 1 and 'no run has a result' in error


@pytest.mark.parametrize('text, said', [
    ('scene: nowhere\n', 'nowhere does not exist'),
    ('vary: {}\n', 'scene is missing'),
    ('scene: free_slab\nvarry: {}\n', 'unknown key varry'),
    ('scene: free_slab\nvary: 3\n', 'vary must be a dictionary'),
    ('scene: free_slab\nscene: free_slab\n', 'line 2: scene is given twice'),
    ('scene: free_slab\nvary: {1: [2]}\n', 'line 2: 1 must be a string'),
    ('scene: [\n', 'not YAML'),
    ('scene: free_slab\nparameters: 3\n', 'parameters must be a dictionary'),
    ('scene: free_slab\ncases: 3\n', 'cases must be a list'),
    ('scene: free_slab\nverbs: 3\n', 'verbs must be a list'),
    ('scene: free_slab\nkeep: [3]\n', 'keep must be phrases, got 3'),
    ('scene: free_slab\nvary: {drag.linear: 0..1}\nsample: 3\n', 'sample must be a dictionary'),
    ('scene: free_slab\nvary: {drag.linear: 0..1}\nsample: {count: 64.0}\n',
     'sample: count must be an integer'),
    ('scene: free_slab\nparameters: {weave.sise: 3}\n', 'weave.sise is not a parameter')])
def test_a_study_file_that_makes_no_sense_is_refused(verb, tmp_path, text, said):
    (tmp_path / 'study.yaml').write_text(text)
    status, _, error = verb('study.yaml', '--workers', '0')
    assert status == 2 and said in error and error.startswith('icofabric sweep: ')
    assert not (tmp_path / 'runs').exists()


@pytest.mark.parametrize('words, said', [
    (['--vary', 'connector.stiffness'], 'write NAME:=VALUES'),
    (['--sample', 'sobol'], 'write METHOD:COUNT'),
    (['--workers', '-1'], 'workers must be an integer from 0'),
    (['--output', 'x.txt'], 'ends in .csv or .parquet'),
    (['--picture', 'x.txt'], 'ends in .png or .svg'),
    (['--vary', 'connector.stiffness:=[1'], '--vary connector.stiffness:=[1'),
    (['--scheduler', 'nothing.json'], 'there is no file nothing.json')])
def test_flags_that_make_no_sense_are_refused(verb, words, said):
    status, _, error = verb('free_slab', '--duration', '0.01', *words)
    assert status == 2 and said in error
