# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""One fabric shared by ranks of MPI: the bits of one process, clear refusals, no hang."""

from contextlib import nullcontext
import gc
import json
import os
from pathlib import Path
import subprocess
import sys
from types import SimpleNamespace
import weakref

import icofabric_sim as ico
from icofabric_sim.commands.main import main
from icofabric_sim.kernels.flows import keep_accelerations, place_all
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.simulation.devices import transport
from icofabric_sim.simulation.devices.division import divide, halo_bytes
from icofabric_sim.simulation.devices.leader import SharedSteps
from icofabric_sim.simulation.devices.refusals import (
    require_shareable,
    require_shareable_method,
)
from icofabric_sim.simulation.devices.shared_contacts import SharedContacts
from icofabric_sim.simulation.devices.transport import Transport
from icofabric_sim.simulation.devices.window import resting, slots_of, window_of
from icofabric_sim.simulation.model.packing import pack_scene
from mpi_launcher import launcher
import numpy as np
import pytest
from ranks_program import (
    COMMON,
    COUNTS,
    frequencies,
    jumps,
    LONG_SCENES,
    run,
    run_ready,
    SCENES,
    state_of,
    steps_taken,
    stop,
    STOPPING,
    STOPPING_LONG,
    TOUCHING,
)

ROOT = Path(__file__).resolve().parents[2]
MOST = 4


def launch(count, *words, seconds=450.0):
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
@pytest.mark.parametrize('count', COUNTS)
def test_any_number_of_ranks_gives_the_bits_of_one_process(count, name, alone, shared):
    assert shared['found'][str(count)][name] == alone[name]
    require_motion(alone[name], touching='contact.mode' not in SCENES[name])


@pytest.mark.long
def test_other_scenes_have_the_bits_of_one_process():
    alone = {name: json.loads(json.dumps(run(name))) for name in LONG_SCENES}
    done = launch(MOST, Path(__file__).with_name('ranks_program.py'), 'long')
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)['found']
    for name, expected in alone.items():
        is_auto = name.endswith('auto')
        require_motion(
            expected, touching='contact.mode' not in LONG_SCENES[name] and not is_auto)
        assert not is_auto or expected['method'] == 'dop8', name
        if name.startswith('torn'):
            lost = [energy['lost_at_breaks'] for _, energy in expected['states']]
            assert float.fromhex(lost[-1]) > 0.0
        for count in range(2, MOST + 1):
            assert found[str(count)][name] == expected, (count, name)
    require_same_stops(STOPPING_LONG, found)


@pytest.mark.long
def test_example_scenes_have_the_bits_of_one_process_or_are_refused():
    names = [str(path) for path in sorted((ROOT / 'config').glob('*.yaml'))]
    alone = {name: json.loads(json.dumps(run_ready(name))) for name in names}
    done = launch(3, Path(__file__).with_name('ranks_program.py'), 'ready', *names)
    assert done.returncode == 0, done.stderr
    found, refused = json.loads(done.stdout)['found']['3'], []
    for name in names:
        if isinstance(found[name], str) and 'shared by ranks' in found[name]:
            refused.append(Path(name).stem)
        else:
            assert found[name] == alone[name] and alone[name][-1] > 0, name
    # Charges that repel each other, and connectors around shells.
    assert refused == ['charged_slab', 'twisted_column']


def require_motion(found, *, touching):
    """Something happened between the states; where shells are to be `touching` they were."""
    states = [digest for digest, _ in found['states']]
    assert found['steps'] > 5 and len(set(states)) == len(states)
    if touching:
        assert any(
            float.fromhex(energy[name]) > 0.0 for _, energy in found['states']
            for name in ('contact', 'dissipated'))


def test_each_pair_is_with_the_ranks_of_its_bodies_in_order():
    scene = ico.Scene.from_parameters({
        **TOUCHING, 'weave': {'size': [5, 5, 9], 'connector_angle': -0.3},
        'planes': {'floor': {'normal': [0.0, 0.0, 1.0], 'offset': -0.016}},
        'solver': {'method': 'leapfrog', 'tolerance': 0.5}})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.002)
    packed, contacts = simulation.packed, simulation._event_loop.driver.contact.phase.contacts
    layout, links, count = packed.layout, packed.model.links, 3
    shared = SharedContacts(layout, count)
    assert shared.is_shared(None) and not shared.is_shared(contacts)
    needed = shared.split(contacts)
    assert shared.is_shared(contacts)
    parts = divide(layout, links, count, needed)
    block = np.full(layout.slot_count, -1)
    block[layout.slot] = layout.block_of(np.arange(layout.body_count, dtype=np.int32))
    crossing = 0
    for rank, part in enumerate(parts):
        is_own = np.append((block >= part.first) & (block < part.last), False)
        # Places below 0 are those of planes.
        mine = [
            number for number, (first, second) in enumerate(contacts.pairs.tolist())
            if is_own[first] or is_own[max(second, -1)]]
        assert shared.which[rank].tolist() == mine
        window = slots_of(packed.model, layout, part)
        near = shared.near(contacts, rank, window)
        for (first, second), number in zip(near.pairs.tolist(), mine):
            for there, here in zip((first, second), contacts.pairs[number].tolist()):
                if here < 0:
                    assert there == here
                    continue
                assert LANES * window.kept[there // LANES] + there % LANES == here
                if not is_own[here]:
                    crossing += 1
                    assert block[here] in part.halo and block[here] in needed[rank]
        assert np.isin(needed[rank], part.halo).all()
    assert crossing > 5 and (contacts.pairs[:, 1] < 0).any()


def test_after_the_block_the_state_is_there_and_goes_no_further(shared):
    expected = json.loads(json.dumps(state_of(steps_taken())))
    for found in shared['found'].values():
        assert found['left'] == expected
        assert found['ended'].startswith("the ranks have ended with their 'with' block; the last")


def test_a_run_that_stops_comes_back_to_the_state_that_the_ranks_have_saved(shared):
    require_same_stops(STOPPING, shared['found'])


def require_same_stops(names, found):
    """Runs stop where one process stops, and come back to the same state."""
    expected = {name: json.loads(json.dumps(stop(name))) for name in names}
    for said, steps, *_ in expected.values():
        assert 'connector.obstruction is stop' in said and 'is kept' in said and steps > 10
    for what in found.values():
        assert what['stopped'] == expected


def test_the_largest_frequency_is_found_by_all_ranks_with_the_same_bits(shared):
    expected = frequencies()
    assert len({rate for rate, _ in expected}) == 4
    assert all(float.fromhex(rate) > 100.0 and steps > 5 for rate, steps in expected)
    for found in shared['found'].values():
        assert found['frequencies'] == expected


def test_a_run_that_is_put_elsewhere_goes_on_with_the_same_bits(shared):
    # Where shells may touch, too, though none do.
    expected = json.loads(json.dumps([jumps(contact=mode) for mode in ('never', 'auto')]))
    for run_found in expected:
        digests = [state[0] for state, *_ in run_found]
        # Two starts are the first one again; of one the loads have begun before.
        assert digests[0] == digests[3] == digests[5] and len(set(digests)) == 5
    for found in shared['found'].values():
        assert found['jumps'] == expected


def test_from_the_start_on_states_are_where_the_bodies_are(shared):
    found = shared['found'][str(COUNTS[-1])]['gathered']
    for gathered, checks, _measured, iterations, others, there, again in found:
        assert gathered == 0 and checks >= 4 and iterations >= 2
        # Nor has the first rank any numbers of bodies of others.
        assert others > 100 and there == 0
        # Once a step was taken, ranks save what they have after a reset, too.
        assert again == 0
    # Where differences tell no errors, these were measured on the way.
    assert found[-1][2] >= 1


def test_steps_of_an_embedded_pair_gather_no_whole_state(shared):
    in_steps, after_snapshot = shared['found'][str(COUNTS[-1])]['pair_gathered']
    assert in_steps == 0 and after_snapshot == 1


def test_a_rank_that_fails_ends_the_run_on_all_with_its_number_and_reason(shared):
    *members, outsider = shared['heard']
    assert outsider == ''
    reason = 'rank 1 of 3 has failed: MemoryError: no room'
    said, time = members[0].split(', of t = ')
    assert said == f'{reason}; the last good state'
    # Of the last health check before somebody looked, at 0.05 s or later.
    assert 0.02 < float(time.split()[0]) < 0.5
    assert members[1:] == [reason, reason]


def test_a_rank_that_fails_before_anybody_has_looked_leaves_the_start(shared):
    reason = 'rank 1 of 2 has failed: MemoryError: no room'
    for begins_again, (first, second, *outsiders) in enumerate(shared['unseen']):
        said, is_back = first
        assert said.startswith(f'{reason}; the last good state, of t = ') and is_back
        assert ('t = 0 s' in said) == (not begins_again)
        assert second[0] == reason and outsiders == [None, None]


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
    assert done.stdout.count('method       srkn8') == 1
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
    ({'charge': {'per_body': 1e-9, 'mutual': True}}, ['charge.mutual']),
    ({'connector.obstruction': 'wrap'}, ['connector.obstruction', 'warn'])])
def test_what_ranks_cannot_share_is_refused_by_its_name(changes, names):
    scene = ico.Scene.from_parameters({**COMMON, 'weave.size': [5, 5, 5], **changes})
    with pytest.raises(ParameterError) as caught:
        require_shareable(scene, cosines=False, body_force=False)
    for name in [*names, 'one process']:
        assert name in str(caught.value)


def test_what_no_parameter_asks_for_is_refused_too():
    for name in ico.METHODS:
        require_shareable_method(name)
    with pytest.raises(ParameterError, match='sdirk4 .* of leapfrog, .*, srkn8, dop8, tsit5, or'):
        require_shareable_method('sdirk4')
    scene = ico.Scene.from_parameters({**COMMON, 'weave.size': [5, 5, 5]})
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


KINKED = {'stiffness_extension': 500.0, 'stiffness_compression': 100.0}


# In rows end to end, in rows of their own, and where every body has its own woven orientation.
@pytest.mark.parametrize(('weave', 'law'), [
    ({'kind': 'orthogonal', 'size': [5, 5, 7]}, KINKED),
    ({'kind': 'orthogonal', 'size': [5, 5, 7]}, {'law': 'exponential', 'alpha': 300.0}),
    ({'kind': 'bias', 'size': [5, 5, 5]}, KINKED),
    ({'kind': 'radial', 'size': [9, 5, 4], 'radius': 0.3, 'connector_angle': 0.6}, KINKED)])
def test_a_window_has_the_accelerations_of_the_whole(weave, law):
    scene = ico.Scene.from_parameters({
        'weave': weave, 'contact.mode': 'never', 'connector': {
            **law, 'bending_stiffness': 1e-3, 'twisting_stiffness': 1e-3},
        'gravity': [0.0, 0.3, -9.81], 'groups': {'top': 'z_max'},
        'supports': {'s': {'group': 'top', 'fix': 'tx tz'}},
        'initial_random': {'velocity_sigma': 0.02, 'spin_sigma': 1.0, 'seed': 3}})
    packed = pack_scene(scene)
    layout, links = packed.layout, packed.model.links
    moved = np.random.RandomState(1).standard_normal(scene.position.shape)
    state = layout.pack(scene.initial._replace(position=scene.position + 1e-3 * moved))
    whole, found = accelerations(packed.model, state, layout.room(links)), []
    for part in divide(layout, links, 3):
        slots = slots_of(packed.model, layout, part)
        window = window_of(packed.model, layout, part, slots, np.zeros(0, np.int64))
        held = resting(window.slot_count)
        for blocks, numbers in (
                (np.arange(part.first, part.last), np.arange(part.last - part.first)),
                (part.halo, np.arange(len(part.halo)) + part.last - part.first)):
            source = lanes_of(layout.blocks.slot[blocks])
            target = lanes_of(window.model.blocks.slot[numbers])
            for own, values in zip(held.rows(), state.rows()):
                own[:, target] = values[:, source]
        assert window.slot_count < layout.slot_count
        work = layout.room(links)._replace(
            points=np.zeros(18 * window.slot_count), acceleration=np.zeros((6, window.slot_count)))
        result = accelerations(window.model, held, work, part.last - part.first)
        found.append(result[:, lanes_of(window.model.blocks.slot[:part.last - part.first])])
    assert np.array_equal(np.hstack(found), whole[:, lanes_of(layout.blocks.slot)])
    assert np.abs(whole).max() > 1.0


def accelerations(model, state, work, count=None):
    """Of the first `count` blocks, or all; points are placed for those around them too."""
    place_all(model, state, work, 0, len(model.blocks.slot))
    keep_accelerations(
        model, state, work, 0.0, 0, len(model.blocks.slot) if count is None else count)
    return work.acceleration


def lanes_of(slots):
    return (slots[:, None] + np.arange(LANES)).ravel()


class Answering:
    """What a run without other processes needs of a transport."""

    def __init__(self, size, *machines):
        self.size, self.machines, self.orders, self.dropped = size, machines, [], []
        self.holders = weakref.WeakSet()

    def alone(self):
        return nullcontext()

    def order(self, what):
        self.orders.append(what)

    def answers(self):
        return list(self.machines)


def test_windows_that_a_machine_has_no_memory_for_are_refused_before_any_is_made():
    packed = pack_scene(ico.Scene.from_parameters({'weave.size': [7, 7, 9]}))
    words = {'given': True, 'estimated': True, 'half_edge': 0.01}
    transport = Answering(3, ('far', 10**9), ('far', 60_000))
    with pytest.raises(ValueError, match=r'rank 1, 2 on far: .* GB are left'):
        SharedSteps(transport, packed, ico.METHODS['leapfrog'], **words)
    assert transport.orders == [('room',)]
    enough = Answering(3, ('far', 10**9), ('near', 10**9))
    steps = SharedSteps(enough, packed, ico.METHODS['leapfrog'], **words)
    assert steps.rank_count == 3 and steps.halo_bytes > 0
    del steps
    gc.collect()
    # Noted for the next order, and not sent by the collector of garbage.
    assert len(enough.dropped) == 1 and len(enough.orders) == 1


def test_one_rank_is_one_process():
    MPI = pytest.importorskip('mpi4py.MPI', reason='mpi4py (extra `mpi`) is not installed')
    scene = ico.Scene.from_parameters(SCENES['slab, leapfrog'])
    with ico.Ranks(MPI.COMM_SELF) as ranks:
        assert (ranks.rank, ranks.size, ranks.leads) == (0, 1, True)
        simulation = ico.compile_scene(scene, ranks=ranks)
    simulation.advance_steps(1)
    assert simulation.status.rank_count == 1 and simulation.status.halo_bytes == 0
    with pytest.raises(ValueError, match="the ranks have ended with their 'with' block"):
        ico.compile_scene(scene, ranks=ranks)


def test_a_simulation_on_every_rank_or_outside_the_block_is_refused(tmp_path):
    program = tmp_path / 'every_rank.py'
    program.write_text("""
import sys
import icofabric_sim as ico

scene = ico.Scene.from_parameters({'weave.size': [3, 3, 3]})


def refusal(ranks):
    try:
        ico.compile_scene(scene, ranks=ranks)
    except Exception as error:
        return f'{ranks.rank} {type(error).__name__}: {error}\\n'


found = refusal(ico.Ranks())
try:
    with ico.Ranks() as ranks:
        found += refusal(ranks)
except ico.RankError:
    found += 'block ended\\n'
sys.stdout.write(found)
""", encoding='utf-8')
    done = launch(2, program, seconds=120.0)
    assert done.returncode == 0, done.stderr
    first = "a simulation is made on the first rank, not on rank 1: put it after 'if ranks.leads:'"
    assert sorted(done.stdout.splitlines()) == sorted([
        "0 ValueError: the other ranks serve within the block of 'with ico.Ranks() as ranks:' "
        'only: put compile_scene(scene, ranks=ranks) into it',
        f'0 ValueError: this scene cannot start: rank 1 of 2 has failed: {first}',
        f'1 ValueError: {first}', f'1 ValueError: {first}', 'block ended'])


def test_who_waits_where_others_compute_sleeps_instead_of_offering(monkeypatch):
    """Processes that compute go before one that offers the processor, and after one that wakes."""
    mpi = pytest.importorskip('mpi4py.MPI')
    ranks = Transport(mpi.COMM_SELF)
    now, offers, naps, taken = [1.0], [], [], [1e-6]

    def offer():
        offers.append(taken[0])
        now[0] += taken[0]

    def sleep(seconds):
        naps.append(seconds)
        now[0] += seconds

    monkeypatch.setattr(transport, 'time', SimpleNamespace(monotonic=lambda: now[0], sleep=sleep))
    monkeypatch.setattr(transport, 'os', SimpleNamespace(sched_yield=offer))

    def wait(count):
        """Wait until it has slept so often; how often it has offered and slept."""
        offers.clear()
        naps.clear()
        ranks._wait_until(lambda: len(naps) >= count)
        return len(offers), len(naps)

    # Nobody takes it: it is offered for 2 ms, and naps grow with the time that has been waited.
    assert wait(1)[0] == pytest.approx(2000, abs=2)
    assert wait(500)[1] == 500 and naps[0] == 5e-5 and 1e-4 < naps[-1] <= 2e-3
    # Somebody computes on it for 3 ms: nothing is offered for a while, by the next wait neither.
    taken[0] = 3e-3
    assert wait(20) == (1, 20)
    assert wait(20) == (0, 20)
    now[0] += 0.1
    assert wait(20) == (1, 20)


def test_without_mpi_ranks_say_what_is_missing(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'mpi4py.MPI', None)
    with pytest.raises(ico.RankError, match='pip install mpi4py mpich'):
        ico.Ranks()
    assert main(['run', 'hanging_slab', '--duration', '0.1', '--ranks']) == 2
    assert 'ranks need mpi4py' in capsys.readouterr().err


def test_more_ranks_than_blocks_are_refused():
    packed = pack_scene(ico.Scene.from_parameters({'weave.size': [3, 3, 3]}))
    count = len(packed.layout.blocks.slot)
    with pytest.raises(ValueError, match=f'{count + 1} ranks are too many .* -n {count} or less'):
        divide(packed.layout, packed.model.links, count + 1)
