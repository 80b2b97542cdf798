# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric warm`: what it compiles, and that a run finds it."""

import os
from pathlib import Path
import signal
import subprocess
import sys
import time

from icofabric_sim.commands import warm
from icofabric_sim.commands.main import BAD_INPUT, FAILED, main, VERBS
from icofabric_sim.parameters.example_scenes import example_scenes, find_scene
from icofabric_sim.parameters.file import load_parameter_file
from icofabric_sim.parameters.validation import make_parameters
from icofabric_sim.scene.scene import Scene
import pytest

# Two shells and one connector: the smallest scene with kernels of its own.
SMALL = """
icofabric:
  ros__parameters:
    weave: {size: [2, 1, 1]}
    gravity: [0.0, 0.0, 0.0]
    contact: {mode: never}
    solver: {method: leapfrog, step: 1.0e-4}
"""


def icofabric(*words, cache):
    """Run a verb in a process of its own, with kernels in `cache`."""
    return subprocess.run(
        [sys.executable, '-m', 'icofabric_sim.commands.main', *words], capture_output=True,
        text=True, timeout=600, env={**os.environ, 'NUMBA_CACHE_DIR': str(cache)})


def test_a_run_finds_what_was_compiled(tmp_path):
    scene, cache = tmp_path / 'small.yaml', tmp_path / 'cache'
    scene.write_text(SMALL)
    done = icofabric('warm', str(scene), '--processes', '2', cache=cache)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith('1 kernel variant is ready')
    entries = {path.name for path in cache.rglob('*.nbc')}
    assert len(entries) > 20
    ran = icofabric(
        'run', str(scene), '--duration', '0.001', '--no-record', cache=cache)
    assert ran.returncode == 0, ran.stderr
    assert 'compiling' not in ran.stderr
    # The growth of errors may need a kernel more, but no step does.
    steps = {'splitting', 'embedded', 'flows', 'rhs', 'monitor', 'hessian', 'sweep'}
    modules = {path.name.partition('.')[0] for path in cache.rglob('*.nbc')}
    assert 'splitting' in modules
    more = {path.name for path in cache.rglob('*.nbc')} - entries
    assert not [name for name in more if name.partition('.')[0] in steps], more


def test_everything_means_all_example_scenes_changes_and_verbs():
    kinds = list(warm.variants_of([]))
    assert {kind.scene for kind in kinds} == set(example_scenes())
    plain = [kind for kind in kinds if not kind.changes + kind.verb]
    assert {kind.scene for kind in plain} == set(example_scenes())
    assert len(set(map(str, kinds))) >= len(example_scenes()) + len(warm.CHANGES) + len(warm.VERBS)
    assert {kind.verb[0] for kind in kinds if kind.verb} <= set(VERBS)
    assert {kind.scene for kind in warm.variants_of(['woven_ball'])} == {'woven_ball'}


def test_one_scene_is_compiled_by_two_processes(monkeypatch):
    """As it is, and as from its first contact on; not where there are kinds enough."""
    asked = []

    def compile_all(kinds, processes):
        asked.append([(kind.scene, kind.touching) for kind in kinds])
        return iter([(kind, '') for kind in kinds])

    monkeypatch.setattr(warm, '_compile_all', compile_all)
    for words in (['hanging_slab', '-j', '2'], ['hanging_slab', '-j', '1'],
                  ['hanging_slab', 'free_slab', '-j', '2']):
        assert main(['warm', *words]) == 0
    assert asked == [
        [('hanging_slab', True), ('hanging_slab', False)], [('hanging_slab', None)],
        [('hanging_slab', None), ('free_slab', None)]]


@pytest.mark.parametrize('touching', [True, False])
def test_parts_are_simulated_as_the_scene_will_be(touching, monkeypatch):
    ready = []
    monkeypatch.setattr(warm, '_ready', lambda simulation: ready.append(simulation))
    assert warm.compile_variant(warm.Variant('hanging_slab', touching=touching)) == ''
    simulation, = ready
    assert simulation.scene.parameters['contact.mode'] == ('always' if touching else 'auto')
    assert simulation.status.method_name == 'dop8'


@pytest.mark.parametrize('change', warm.CHANGES, ids=str)
def test_changes_are_possible(change):
    given = load_parameter_file(find_scene(warm._CHANGED))
    assert all(given.get(name) != value for name, value in change.items())
    Scene.from_parameters(make_parameters({**given, **change}))


def test_a_kind_that_cannot_be_compiled_is_named_and_the_others_are(monkeypatch, capsys):
    results = [(warm.Variant('a'), ''), (warm.Variant('b', (('x', 1.0),)), 'no memory')]
    monkeypatch.setattr(warm, '_compile_all', lambda kinds, processes: iter(results))
    monkeypatch.setattr(warm, 'variants_of', lambda scenes: iter([kind for kind, _ in results]))
    assert main(['warm']) == FAILED
    said = capsys.readouterr()
    assert said.out.startswith('1 kernel variant is ready')
    assert said.err.strip() == 'icofabric warm: not compiled: b, x 1.0: no memory'


def test_a_fault_within_a_kind_is_a_text():
    fault = warm.compile_variant(warm.Variant('hanging_slab', (('weave.size', [0, 1, 1]),)))
    assert 'weave.size' in fault and '\n' not in fault


@pytest.mark.parametrize('words, said', [
    (['no_such_scene'], 'no_such_scene does not exist'),
    (['-j', '0', 'hanging_slab'], '--processes must be from 1 to 256, got 0'),
])
def test_bad_input(words, said, capsys):
    assert main(['warm', *words]) == BAD_INPUT
    assert said in capsys.readouterr().err


def test_more_kinds_than_a_batch_of_workers_takes_all_end(monkeypatch):
    """Kinds that are refused at once: the workers are real."""
    monkeypatch.setattr(warm, '_VARIANTS_PER_WORKER', 2)
    kinds = [warm.Variant('hanging_slab', (('weave.size', (0, 1, k)),)) for k in range(1, 6)]
    done = dict(warm._compile_all(kinds, 2))
    assert set(done) == set(kinds) and all('weave.size' in fault for fault in done.values())


@pytest.mark.parametrize('sent', [signal.SIGINT, signal.SIGKILL])
def test_processes_that_compile_end_with_it(sent, tmp_path):
    """However it ends: the signal goes to it alone, as from `timeout` or a supervisor."""
    begun = subprocess.Popen(
        [sys.executable, '-m', 'icofabric_sim.commands.main', 'warm', 'twisted_column'],
        stderr=subprocess.PIPE, text=True, env={**os.environ, 'NUMBA_CACHE_DIR': str(tmp_path)})
    listed = Path(f'/proc/{begun.pid}/task/{begun.pid}/children')
    workers: list[int] = []
    while begun.poll() is None and not workers:
        time.sleep(0.05)
        # Beside them there is the one that tracks what they share.
        workers = [
            int(pid) for pid in listed.read_text().split()
            if b'spawn_main' in Path(f'/proc/{pid}/cmdline').read_bytes()]
        # They are asked to leave signals to the first one when they begin to compile.
        workers = workers if any(tmp_path.rglob('*.nbc')) else []
    begun.send_signal(sent)
    _, said = begun.communicate(timeout=60)
    assert workers
    if sent == signal.SIGINT:
        assert begun.returncode == 130 and said.endswith('icofabric warm: interrupted\n')
    else:
        assert begun.returncode == -sent
    for pid in workers:
        # What nobody waits for is left as a zombie, where init does not reap it.
        for _ in range(600):
            try:
                state = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0]
            except OSError:
                break
            if state in 'ZX':
                break
            time.sleep(0.05)
        else:
            pytest.fail(f'process {pid} compiles on')
