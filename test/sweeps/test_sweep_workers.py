# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Parameter studies on several workers of Dask: same bits, and no finished run is lost."""

import json
import os
from pathlib import Path
import runpy
import signal
import subprocess
import sys
import time
from types import SimpleNamespace

import icofabric_sim as ico
from icofabric_sim.commands.main import main
from icofabric_sim.sweeps.dask_runs import Pool, pool, SchedulerLost
from icofabric_sim.sweeps.single_run import Outcome, State, WorkersDiffer
from icofabric_sim.sweeps.store import Store
from icofabric_sim.sweeps.sweep import Study
import pytest
from test_sweep import SWING, WOVEN

distributed = pytest.importorskip('distributed')

ROOT = Path(__file__).resolve().parents[2]
COMMAND = [sys.executable, '-m', 'icofabric_sim.commands.main', 'sweep']
# Steps so short that a run takes some tenths of a second.
SLOW = {**SWING, 'solver.step': 6e-7}
STUDY = ['slow.yaml', '--vary', 'connector.stiffness:=500..600/12', '--keep', 'energies',
         '--store', 'store']
# So many that a busy machine has not done them all before something is killed.
RUNS = 30
MANY = [word.replace('/12', f'/{RUNS}') for word in STUDY]
# Sockets of workers that were killed.
pytestmark = [
    pytest.mark.filterwarnings('ignore:unclosed:ResourceWarning'),
    pytest.mark.filterwarnings('ignore::pytest.PytestUnraisableExceptionWarning')]


def start(*words, folder):
    """Start a program whose processes can be killed together."""
    return subprocess.Popen(
        words, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True, env={**os.environ, 'PYTHONPATH': str(ROOT)})


def wait_until(condition, *programs, seconds=300.0):
    """Wait for a condition, and show the errors of a program that ends before."""
    end = time.monotonic() + seconds
    while not condition():
        for program in programs:
            assert program.poll() is None, program.communicate()[1]
        assert time.monotonic() < end, 'waited in vain'
        time.sleep(0.02)


def finished(folder):
    return Store(folder / 'store').keys()


@pytest.fixture
def folder(tmp_path):
    (tmp_path / 'slow.yaml').write_text(
        '/**:\n  ros__parameters:\n' + ''.join(
            f'    {name}: {json.dumps(value)}\n' for name, value in SLOW.items()))
    return tmp_path


@pytest.fixture(scope='module')
def single(tmp_path_factory):
    """The same study in one process."""
    return ico.sweep(
        ico.Scene.from_parameters(SLOW), {'connector.stiffness': '500..600/12'}, keep='energies',
        workers=0, store=tmp_path_factory.mktemp('single'))


@pytest.fixture(scope='module')
def many(tmp_path_factory):
    """The larger study in one process."""
    return ico.sweep(
        ico.Scene.from_parameters(SLOW), {'connector.stiffness': f'500..600/{RUNS}'},
        keep='energies', workers=0, store=tmp_path_factory.mktemp('many'))


@pytest.fixture(scope='module')
def scheduler():
    """Address of a scheduler with two workers."""
    with distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address='127.0.0.1:0', memory_limit=0,
            host='127.0.0.1', silence_logs=50) as cluster:
        yield cluster.scheduler_address


def same_bits(folder, single):
    """A table of the folder says what one process has found."""
    single.save(folder / 'single.csv')
    return (folder / 'slow.csv').read_bytes() == (folder / 'single.csv').read_bytes()


def test_two_workers_give_the_bits_of_one(tmp_path, scheduler):
    scene = ico.Scene.from_parameters(WOVEN)
    vary = {'weave.connector_angle': '0.1..0.7/5', 'weave.variant': [0, 1]}
    words = {'verbs': ['elasticity', 'bands']}
    tables = [ico.sweep(scene, vary, store=tmp_path / name, **who, **words)
              for name, who in (('one', {'workers': 0}), ('two', {'scheduler': scheduler}))]
    for number, table in enumerate(tables):
        assert not table.failed, table.failed
        table.save(tmp_path / f'{number}.csv')
    assert (tmp_path / '0.csv').read_bytes() == (tmp_path / '1.csv').read_bytes()
    assert not any(outcome.reused for outcome in tables[1].outcomes)


def test_a_worker_that_is_killed_costs_its_run_only(folder, single):
    study = Study(
        ico.Scene.from_parameters(SLOW), {'connector.stiffness': '500..600/12'}, keep='energies',
        store=folder / 'store')
    study.store.prepare()
    outcomes, killed = [], []
    with pool(workers=2, scheduler='') as workers:
        workers.check(study.store.path)
        before = workers._client.run(os.getpid)
        for outcome in workers.perform(*study._by_kernel_variant(study.requests)):
            outcomes.append(outcome)
            if len(outcomes) == 3:
                killed = list(before.values())[:1]
                os.kill(killed[0], signal.SIGKILL)

        def are_both_there():
            # The other one may have done the rest before the next one is there.
            now = workers._client.run(os.getpid, on_error='ignore').values()
            return len(now) == 2 and killed[0] not in now

        wait_until(are_both_there)
    assert [one.state for one in outcomes] == [State.DONE] * 12
    study.table(outcomes).save(folder / 'slow.csv')
    assert same_bits(folder, single)


class Answer:
    """A future of Dask whose result never comes where `found` is None."""

    def __init__(self, status, found):
        self.status, self.found = status, found

    def add_done_callback(self, call):
        call(self)

    def cancel(self):
        self.status = 'cancelled'

    def result(self, timeout=None):
        if self.found is None:
            assert timeout, 'would wait for ever'
            raise TimeoutError
        return self.found


def test_outcomes_that_died_with_their_workers_are_asked_for_again(tmp_path):
    study = Study(ico.Scene.from_parameters(SLOW), {'connector.damping': [0.1, 0.2]},
                  store=tmp_path)
    answers, scaled = [('finished', False), ('lost', False)], []

    def submit(function, request, **words):
        status, found = answers.pop() if answers else ('finished', True)
        return Answer(status, Outcome(request.number, request.key, State.DONE) if found else None)

    client = SimpleNamespace(
        submit=submit, status='running', nthreads=lambda: {'one': 1}, cancel=lambda *a, **b: None,
        scheduler=SimpleNamespace(address='tcp://nowhere'))
    cluster = SimpleNamespace(worker_spec={0: {}, 1: {}}, scale=scaled.append)
    found = list(Pool(client, cluster).perform(*study._by_kernel_variant(study.requests)))
    assert not answers and [outcome.state for outcome in found] == [State.DONE] * 2
    assert scaled and set(scaled) == {2}


def test_workers_that_die_while_they_start_are_replaced(folder, single):
    study = Study(
        ico.Scene.from_parameters(SLOW), {'connector.stiffness': '500..600/12'}, keep='energies',
        store=folder / 'store')
    study.store.prepare()
    outcomes = []
    with pool(workers=1, scheduler='') as workers:
        workers.check(study.store.path)
        for outcome in workers.perform(*study._by_kernel_variant(study.requests)):
            outcomes.append(outcome)
            if len(outcomes) == 3:
                # As Dask leaves it when the worker that follows one that died dies at its start.
                present = workers._cluster.workers
                workers._cluster.sync(next(iter(present.values())).close)
    assert [one.state for one in outcomes] == [State.DONE] * 12
    study.table(outcomes).save(folder / 'slow.csv')
    assert same_bits(folder, single)


def test_a_script_without_a_main_is_told_so(tmp_path):
    (tmp_path / 'script.py').write_text(
        'import icofabric_sim as ico\n'
        "ico.sweep(ico.load_scene('free_slab'), {'connector.damping': [1.0]}, workers=1,\n"
        "          verbs='elasticity', store='store')\n")
    script = start(sys.executable, 'script.py', folder=tmp_path)
    _, error = script.communicate(timeout=120)
    assert script.returncode == 1 and "inside if __name__ == '__main__'" in error
    assert finished(tmp_path) == set()


@pytest.mark.long
def test_a_study_that_is_killed_goes_on_beside_another_one(folder, many):
    """Kill -9 of the command; its workers end with it. Then two at once share the rest."""
    client = start(*COMMAND, *MANY, '--workers', '2', folder=folder)
    wait_until(lambda: len(finished(folder)) >= 3, client)
    os.kill(client.pid, signal.SIGKILL)
    client.communicate(timeout=60)
    before = finished(folder)
    # Workers see that their parent is gone, and end within a moment.
    wait_until(lambda: not subprocess.run(
        ['pgrep', '-s', str(client.pid)], capture_output=True, check=False).stdout, seconds=60.0)
    assert 3 <= len(before) < RUNS
    both = [start(*COMMAND, *MANY, '--workers', '1', '--json', '--output', f'{number}.csv',
                  folder=folder) for number in range(2)]
    reports = []
    for one in both:
        said, error = one.communicate(timeout=200)
        assert one.returncode == 0, error
        reports.append(json.loads(said))
    assert len(finished(folder)) == RUNS and not list((folder / 'store' / '.work').iterdir())
    # Each run was done by one of them; both have the whole table.
    done = [RUNS - report['reused'] for report in reports]
    assert sum(done) == RUNS - len(before) and (folder / '0.csv').read_bytes() == (
        folder / '1.csv').read_bytes()
    (folder / '0.csv').rename(folder / 'slow.csv')
    assert same_bits(folder, many)


def test_a_scheduler_that_is_killed_loses_no_finished_run(folder, many):
    """Scheduler and workers are separate processes, as on a cluster."""
    dask = [sys.executable, '-m', 'dask']
    where = ['--scheduler-file', 'scheduler.json', '--no-dashboard']
    programs = [start(*dask, 'scheduler', *where, '--host', '127.0.0.1', '--port', '0',
                      folder=folder)]
    try:
        wait_until((folder / 'scheduler.json').exists, *programs)
        programs += [start(*dask, 'worker', *where, '--nthreads', '1', folder=folder)
                     for _ in range(2)]
        client = start(*COMMAND, *MANY, '--scheduler', 'scheduler.json', folder=folder)
        programs.append(client)
        wait_until(lambda: len(finished(folder)) >= 3, *programs)
        os.kill(programs[0].pid, signal.SIGKILL)
        _, error = client.communicate(timeout=120)
        assert client.returncode == 1 and 'is lost' in error, error
        assert 'the same command continues' in error
    finally:
        for program in programs:
            if program.poll() is None:
                os.killpg(program.pid, signal.SIGKILL)
            program.communicate(timeout=60)
    before = finished(folder)
    assert 3 <= len(before) < RUNS
    again = start(*COMMAND, *MANY, '--workers', '0', '--json', '--output', 'slow.csv',
                  folder=folder)
    said, error = again.communicate(timeout=200)
    assert again.returncode == 0, error
    assert json.loads(said)['reused'] == len(before)
    assert same_bits(folder, many)


@pytest.mark.long
def test_an_interrupt_of_a_sweep_says_what_is_kept(folder):
    client = start(*COMMAND, *STUDY, '--workers', '2', folder=folder)
    wait_until(lambda: len(finished(folder)) >= 2, client)
    # As Ctrl-C on a terminal: to the whole group.
    os.killpg(client.pid, signal.SIGINT)
    _, error = client.communicate(timeout=60)
    assert client.returncode == 130 and 'the same command continues' in error
    assert 'Traceback' not in error
    rows = (folder / 'store' / 'slow.csv').read_text().splitlines()
    assert len(rows) >= 3


@pytest.mark.parametrize('address, said', [
    ('http://x:1', "'http://x:1' is not an address: unknown address scheme"),
    ('tcp://127.0.0.1:x', 'is not an address'),
    ('host', 'missing port number'),
    ('empty.json', 'empty.json contains no address'),
    ('broken.json', 'broken.json cannot be read as JSON'),
    ('nothing.json', 'there is no file nothing.json')])
def test_what_is_not_an_address_is_refused_at_once(tmp_path, monkeypatch, address, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'empty.json').write_text('{}')
    (tmp_path / 'broken.json').write_text('{')
    monkeypatch.setattr(distributed, 'Client', None)
    with pytest.raises(ValueError, match=said), pool(workers=1, scheduler=address):
        pass


def test_a_cluster_that_does_not_start_says_so(monkeypatch):
    def full(**words):
        raise OSError('Too many\nopen files')

    monkeypatch.setattr(distributed, 'LocalCluster', full)
    with pytest.raises(SchedulerLost, match='could not be started .Too many open files'):
        with pool(workers=1, scheduler=''):
            pass


def test_a_worker_that_comes_late_and_differs_is_named(tmp_path, scheduler):
    study = Study(ico.Scene.from_parameters(WOVEN), {'connector.stiffness': [300.0]},
                  verbs='elasticity', store=tmp_path)
    study.store.prepare()
    request = study.requests[0]
    request = request._replace(environment={**request.environment, 'libraries': 'numpy 0.1'})
    with pytest.raises(WorkersDiffer, match='the worker tcp://.* has other versions of libraries'):
        with pool(workers=0, scheduler=scheduler) as workers:
            list(workers.perform([request], {}))
    assert study.store.keys() == set()


@pytest.mark.parametrize('name, fewer, column', [
    ('moduli', ['connector.stiffness_compression:=[50.0, 500.0]',
                'weave.connector_angle:=0.2..0.4/2'], 'elasticity.young.x.compression [Pa]'),
    ('band_gap', ['connector.bending_stiffness:=[0.01, 1.0]',
                  'weave.connector_angle:=[0.3]'], 'bands.gap [rad/s]'),
    ('fall', ['connector.damping:=[0.05, 0.2]'], 'run.energy.dissipated [J]')])
def test_a_ready_study_runs_on_two_workers(tmp_path, name, fewer, column, scheduler, capsys):
    words = [word for rule in fewer for word in ('--vary', rule)]
    if name == 'fall':
        # Before anything touches.
        words += ['--duration', '0.02']
    before = signal.getsignal(signal.SIGTERM)
    status = main(['sweep', str(ROOT / 'examples' / f'{name}.yaml'), *words,
                   '--scheduler', scheduler, '--store', str(tmp_path / 'store'), '--json'])
    signal.signal(signal.SIGTERM, before)
    said = json.loads(capsys.readouterr().out)
    assert status == 0 and said['failed'] == 0
    values = said['table'][column]
    # Each grows with what varies first.
    assert len(values) == 2 ** len([rule for rule in fewer if '/2' in rule or ', ' in rule])
    assert values[0] < values[-1]


def test_a_search_finds_the_lightest_weave_that_is_stiff_enough(tmp_path):
    search = runpy.run_path(str(ROOT / 'examples' / 'weave_search.py'))['search']
    words = {'population': 4, 'generations': 5, 'workers': 0, 'store': tmp_path / 'store'}
    (angle, scale), stiffness, density, tried = search(500.0, **words)
    assert tried == 6 * 8 and 500.0 <= stiffness < 700.0
    scene = ico.Scene.from_parameters({**WOVEN, 'weave.connector_angle': float(angle),
                                       'connector.attachment_scale': float(scale)})
    assert ico.homogenise(scene).stiffness[3, 3] == pytest.approx(stiffness, rel=1e-12)
    # A closer weave is stiffer, and weighs more than it gains.
    closer = ico.homogenise(scene.with_changes({'weave.connector_angle': 0.6 * float(angle)}))
    assert closer.stiffness[3, 3] / closer.density < stiffness / density
    # The same search again takes all of it from the store.
    keys = Store(tmp_path / 'store').keys()
    assert search(500.0, **words)[1] == stiffness
    assert Store(tmp_path / 'store').keys() == keys and 30 < len(keys) <= tried
