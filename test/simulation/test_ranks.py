# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""One fabric shared by ranks of MPI: the bits of one process, clear refusals, no hang."""

import json
import os
from pathlib import Path
import shutil
import subprocess
import sys

import icofabric_sim as ico
from icofabric_sim.commands.main import main
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.simulation.devices.division import divide, halo_bytes
from icofabric_sim.simulation.devices.refusals import require_shareable, require_shareable_method
from icofabric_sim.simulation.model.packing import pack_scene
import numpy as np
import pytest
from ranks_program import COMMON, run, SCENES

ROOT = Path(__file__).resolve().parents[2]
MOST = 4


def launcher():
    """Return the launcher of the MPI library beside this Python, or of the machine."""
    pytest.importorskip('mpi4py', reason='mpi4py (extra `mpi`) is not installed')
    found = shutil.which('mpiexec', path=str(Path(sys.executable).parent)) or shutil.which(
        'mpiexec')
    if found is None:
        pytest.skip('no mpiexec on this machine')
    return found


def launch(count, *words, seconds=240.0):
    """Run a program with so many ranks; a hang is a failure."""
    return subprocess.run(
        [launcher(), '-n', str(count), sys.executable, *map(str, words)], timeout=seconds,
        capture_output=True, text=True, env={**os.environ, 'PYTHONPATH': str(ROOT)})


@pytest.fixture(scope='module')
def alone():
    """What one process finds, scene by scene."""
    return {name: json.loads(json.dumps(run(name))) for name in SCENES}


@pytest.fixture(scope='module')
def shared(alone):
    """What all numbers of ranks find; after `alone`, which compiles what both need."""
    done = launch(MOST, Path(__file__).with_name('ranks_program.py'))
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize('name', SCENES)
@pytest.mark.parametrize('count', range(2, MOST + 1))
def test_any_number_of_ranks_gives_the_bits_of_one_process(count, name, alone, shared):
    assert shared['found'][str(count)][name] == alone[name]
    states = [digest for digest, _ in alone[name]['states']]
    assert alone[name]['steps'] > 5 and len(set(states)) == len(states)


def test_a_rank_that_fails_ends_the_run_on_all_with_its_number_and_reason(shared):
    *members, outsider = shared['heard']
    assert outsider == ''
    reason = 'rank 1 of 3 has failed: MemoryError: no room'
    assert members[0].startswith(f'{reason}; the last good state, of t = ')
    assert members[1:] == [reason, reason]


def test_a_record_of_ranks_is_identical_to_one_process(tmp_path, capsys):
    scene = tmp_path / 'scene.yaml'
    scene.write_text(
        '/**:\n  ros__parameters:\n    weave: {size: [7, 7, 9]}\n    contact: {mode: never}\n'
        '    initial_random: {velocity_sigma: 0.02, spin_sigma: 1.0, seed: 3}\n'
        '    solver: {method: srkn8, tolerance: 1.0e-3}\n    duration: 0.02\n')
    done = launch(
        2, '-m', 'icofabric_sim.commands.main', 'run', scene, '--ranks', '--record',
        tmp_path / 'bag')
    assert done.returncode == 0, done.stderr
    # One rank speaks.
    assert done.stdout.count('method    srkn8') == 1
    assert '2 share the steps' in done.stdout and 'growth is not measured' in done.stderr
    assert main(['verify', str(tmp_path / 'bag')]) == 0
    assert 'identical: ' in capsys.readouterr().out


@pytest.mark.parametrize('size, rank', [('PMI_SIZE', 'PMI_RANK'), (
    'OMPI_COMM_WORLD_SIZE', 'OMPI_COMM_WORLD_RANK')])
def test_processes_of_a_launcher_do_not_all_do_one_run(size, rank, monkeypatch, capsys):
    monkeypatch.setenv(size, '3')
    monkeypatch.setenv(rank, '0')
    assert main(['run', 'falling_slab', '--duration', '0.1']) == 2
    said = capsys.readouterr().err
    assert 'started 3 processes' in said and 'give --ranks' in said
    monkeypatch.setenv(rank, '2')
    with pytest.raises(SystemExit, match='2'):
        main(['run', 'falling_slab', '--duration', '0.1'])
    assert capsys.readouterr().err == ''


@pytest.mark.parametrize('changes, names', [
    ({'contact.mode': 'auto'}, ['contact.mode', 'never']),
    ({'charge': {'per_body': 1e-9, 'mutual': True}}, ['charge.mutual']),
    ({'connector.obstruction': 'wrap'}, ['connector.obstruction', 'warn']),
    ({'drag.linear': 0.1}, ['dop8', 'drag.linear']),
    ({'connector.damping': 0.1}, ['dop8', 'damped']),
    ({'connector.break_length_extension': 0.2}, ['dop8']),
    ({'groups': {'top': 'z_max', 'tip': 'z_min'}, 'drives': {'pull': {
        'group': 'tip', 'motion': 'velocity', 'linear': [0.1, 0.0, 0.0]}}}, ['drives.pull']),
    ({'tractions': {'wind': {'group': 'tip', 'faces': 'all', 'pressure': 1.0}}},
     ['tractions.wind'])])
def test_what_ranks_cannot_share_is_refused_by_its_name(changes, names):
    scene = ico.Scene.from_parameters({**COMMON, 'weave.size': [5, 5, 5], **changes})
    with pytest.raises(ParameterError) as caught:
        require_shareable(scene, cosines=False, body_force=False)
    for name in [*names, 'one process']:
        assert name in str(caught.value)


def test_methods_that_ranks_cannot_take_are_refused_with_those_that_they_can():
    scene = ico.Scene.from_parameters({
        **COMMON, 'weave.size': [5, 5, 5], 'connector.stiffness_compression': 100.0})
    require_shareable(scene, cosines=False, body_force=False)
    packed = pack_scene(scene)
    for name in ('leapfrog', 'srkn8'):
        require_shareable_method(name, packed)
    for name in ('srkn4', 'srkn6', 'dop8'):
        with pytest.raises(ParameterError, match='take (one of )?leapfrog, srkn8'):
            require_shareable_method(name, packed)
    for asked in ({'cosines': True, 'body_force': False}, {'cosines': False, 'body_force': True}):
        with pytest.raises(ValueError, match='not shared by ranks'):
            require_shareable(scene, **asked)


@pytest.mark.parametrize('weave', [
    {'size': [7, 7, 9]}, {'size': [8, 8, 8]}, {'kind': 'bias', 'size': [6, 6, 6]}])
@pytest.mark.parametrize('count', [1, 2, 3, 7])
def test_every_block_has_one_owner_and_what_one_needs_another_gives(weave, count):
    packed = pack_scene(ico.Scene.from_parameters({'weave': weave}))
    layout, links = packed.layout, packed.model.links
    parts = divide(layout, links, count)
    assert np.array_equal(
        np.concatenate([np.sort(part.drifts) for part in parts]),
        np.arange(len(layout.blocks.slot)))
    block = layout.block_of(np.arange(layout.body_count, dtype=np.int32))
    owner = np.searchsorted([part.last for part in parts], block, side='right')
    ends = np.vstack([packed.connectors.first, packed.connectors.second]).T
    for rank, part in enumerate(parts):
        assert sorted([*part.drifts[:part.border], *part.inner]) == sorted(part.drifts)
        for other, blocks in part.needs:
            given = dict(parts[other].gives)[rank]
            assert np.array_equal(blocks, given)
            assert set(given) <= set(parts[other].drifts[:parts[other].border])
        # Of each connector that leads out of the part, the other end is in the halo.
        crossing = ends[(owner[ends] == rank).sum(axis=1) == 1]
        outside = np.unique(crossing[owner[crossing] != rank])
        assert np.array_equal(np.unique(block[outside]), part.halo)
        halo = halo_bytes(layout, links, part)
        assert halo.least == 56 * len(outside)
        assert halo.received == 56 * LANES * len(part.halo) >= halo.least


def test_more_ranks_than_blocks_are_refused():
    packed = pack_scene(ico.Scene.from_parameters({'weave.size': [3, 3, 3]}))
    count = len(packed.layout.blocks.slot)
    with pytest.raises(ValueError, match=f'{count + 1} ranks are too many .* -n {count} or less'):
        divide(packed.layout, packed.model.links, count + 1)
