# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Steps on a device, by Warp's kernels on the processor: the motion of the other kernels."""

from pathlib import Path
import re

from analytical import quaternion_product, rotation_quaternion
import icofabric_sim as ico
from icofabric_sim.commands.main import main
from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.simulation.devices.refusals import require_on_device
from icofabric_sim.simulation.model.packing import pack_scene
import numpy as np
import pytest
from ranks_program import COMMON, FOR_RANKS_ALONE, SCENES
from references import axes_of, integrate_quaternions

warp = pytest.importorskip('warp', reason='Warp (extra `gpu`) is not installed')

# What both round in other places, times what a run of these lengths makes of it.
ROUNDING = 1e-12
CHOSEN = ['even rows, srkn8', 'kinks, srkn6', 'damped, dop8']
# By the embedded pair: what takes energy, loads in time, bodies of their own mass, an anchor.
LOSSY = {
    **COMMON, 'weave.size': [5, 7, 9], 'connector.damping': 0.05,
    'drag': {'linear': 0.02, 'angular': 1e-6},
    'groups': {'top': 'z_max', 'tip': 'x_max', 'some': 'ids 3 40 77 100'},
    'masses': {'m': {'group': 'some', 'mass': 0.03, 'inertia': 5e-6}},
    'connector_groups': {'g': {'between': 'some all', 'damping': 0.02}}}
OWN = {
    'damped, anchored and bent': {
        **LOSSY, 'anchors': {'a': {'body': 0, 'edge': 'west', 'position': [-0.2, 0.0, 0.0]}},
        'connector.bending_stiffness': 1e-3, 'solver': {'method': 'dop8', 'step': 2e-4}},
    'damped, given': {**LOSSY, 'solver': {'method': 'dop8', 'step': 2e-4}},
    'damped, dop8': {**LOSSY, 'solver': {'method': 'auto', 'tolerance': 1e-5}},
    # On paths, in all freedoms and in some, beside an anchor and bodies of their own mass.
    'driven, dop8': {
        **LOSSY, 'groups': {
            **LOSSY['groups'], 'low': 'z_min', 'side': 'y_min and not z_min and not z_max'},
        'drives': {
            'd': {'group': 'low', 'motion': 'sine', 'linear': [0.002, 0.0, 0.001],
                  'angular': [0.0, 0.5, 0.2], 'frequency': 40.0},
            'e': {'group': 'side', 'motion': 'velocity', 'linear': [0.0, -0.1, 0.0],
                  'freedoms': 'ty', 'duration': 0.004}},
        'anchors': {'a': {'body': 100, 'edge': 'west', 'position': [0.3, 0.0, 0.0]}},
        'solver': {'method': 'auto', 'tolerance': 1e-5}},
    'free, dop8': {**COMMON, 'weave.size': [5, 7, 9], 'solver': {
        'method': 'dop8', 'tolerance': 1e-5}}}
FIELDS = 'position', 'orientation', 'linear_velocity', 'angular_velocity'


def compiled(name, device='warp_cpu', **changes):
    parameters = {**{**SCENES, **OWN}[name], **changes}
    parameters['solver'] = {**parameters['solver'], 'device': device}
    return ico.compile_scene(ico.Scene.from_parameters(parameters))


def run(simulation, pieces=1):
    """Take a run through an input, in so many pieces; where it leads, health checks behind it."""
    end = 0.0049 if simulation.status.step < 5e-4 else 0.025
    for time in np.linspace(0.0, 0.0031, pieces + 1)[1:]:
        simulation.advance_to(time)
        simulation.snapshot()
    simulation.apply_wrench('l', force=(0.0, 0.02, 0.0))
    for time in np.linspace(0.0031, 0.0031 + end, pieces + 1)[1:]:
        simulation.advance_to(time)
        simulation.snapshot()
    return simulation.snapshot()


def bits(snapshot):
    return [getattr(snapshot, name).tobytes() for name in FIELDS]


@pytest.mark.parametrize('name', [
    *(name for name in SCENES if name not in FOR_RANKS_ALONE), 'damped, given', *(
        pytest.param(name, marks=pytest.mark.long)
        for name in ('driven, dop8', 'damped, anchored and bent'))])
def test_a_device_moves_as_the_processor_does(name):
    expected, simulation = compiled(name, 'cpu'), compiled(name)
    one, other = run(expected), run(simulation)
    # Twelve evaluations a step.
    rounding = ROUNDING * (10.0 if 'dop8' in name or 'damped' in name else 1.0)
    for field in FIELDS:
        values = getattr(one, field)
        assert np.abs(getattr(other, field) - values).max() <= rounding * max(
            np.abs(values).max(), 1.0), field
    assert simulation.status.step == pytest.approx(expected.status.step, rel=1e-9)
    assert simulation.status.step_count == expected.status.step_count > 10
    assert simulation.status.device == 'the processor, by Warp'
    assert simulation.error_estimate == pytest.approx(expected.error_estimate, rel=1e-5)
    scale = expected.balance.scale
    assert abs(simulation.balance.error - expected.balance.error) <= ROUNDING * scale
    if name == 'kinks, srkn6':
        # Some connector has crossed its natural length, and its step was mended.
        assert simulation._driver.trajectory.executor._fabric.active.numpy().max() == 2
    for kind, energy in one.energy.items():
        assert other.energy[kind] == pytest.approx(energy, abs=ROUNDING * scale), kind


@pytest.mark.parametrize('name', ['damped, dop8', 'free, dop8'])
def test_steps_are_tried_and_refused_as_on_the_processor(name):
    expected, simulation = compiled(name, 'cpu'), compiled(name)
    one, other = run(expected), run(simulation)
    status, wanted = simulation.status, expected.status
    assert status.method_name == 'dop8' and status.device == 'the processor, by Warp'
    assert status.step_count == wanted.step_count > 5
    assert simulation.error_estimate == pytest.approx(expected.error_estimate, rel=1e-3)
    # Lengths of steps follow from errors, which rounding changes more than it changes motions.
    error = 1e-3 * expected.error_estimate
    for field, scale in zip(FIELDS, (0.01, 1.0, 10.0, 1e3)):
        assert np.abs(getattr(other, field) - getattr(one, field)).max() < error * scale, field
    for kind, energy in one.energy.items():
        assert other.energy[kind] == pytest.approx(
            energy, rel=1e-6, abs=1e-9 * expected.balance.scale), kind
    assert (other.energy['dissipated'] > 1e-3 * other.energy['kinetic']) == (name[0] == 'd')
    assert abs(other.energy['balance_error']) < 1e-6 * other.energy['kinetic']
    # Between two steps, from the slopes that are brought here.
    for moment in (0.3, 0.7):
        time = simulation.time + moment * status.step
        for each in (simulation, expected):
            each.advance_to(time)
        assert np.abs(
            simulation.snapshot().position - expected.snapshot().position).max() < 0.01 * error


def test_what_broke_before_stays_broken_on_a_device():
    # A run in which connectors break, and the fabric that goes on without limits.
    torn = compiled('damped, given', 'cpu', **{
        'connector.break_length_extension': 0.034, 'gravity': [0.0, 0.0, -200.0]})
    torn.advance_to(0.03)
    broken = (~torn.snapshot().intact).sum()
    assert broken > 0
    ends = []
    for device in ('cpu', 'warp_cpu'):
        simulation = compiled('damped, given', device, gravity=[0.0, 0.0, -200.0])
        simulation.continue_from(torn, keep_motion=True)
        simulation.advance_to(0.035)
        ends.append(simulation.snapshot())
        assert (~ends[-1].intact).sum() == broken
    assert np.abs(ends[1].position - ends[0].position).max() < 1e-11
    whole = compiled('damped, given', gravity=[0.0, 0.0, -200.0])
    whole.set_state(**{field: getattr(torn.snapshot(), field) for field in FIELDS})
    whole.advance_to(0.005)
    assert np.abs(whole.snapshot().position - ends[1].position).max() > 1e-6


@pytest.mark.long
def test_bodies_have_masses_of_their_own_on_a_device():
    changes = {
        'weave.size': [5, 7, 9],
        'groups': {'top': 'z_max', 'tip': 'x_max', 'some': 'ids 3 40 77 100'},
        'masses': {'m': {'group': 'some', 'mass': 0.03, 'inertia': 5e-6}}}
    expected = compiled('kinks, srkn6', 'cpu', **changes)
    simulation = compiled('kinks, srkn6', **changes)
    one, other = run(expected), run(simulation)
    alike = run(compiled('kinks, srkn6', 'cpu', **{**changes, 'masses': {
        'm': {'group': 'some', 'mass': 0.01, 'inertia': 2e-6}}}))
    for field in FIELDS:
        values = getattr(one, field)
        assert np.abs(getattr(other, field) - values).max() <= ROUNDING * max(
            np.abs(values).max(), 1.0), field
    assert np.abs(alike.position - one.position).max() > 1e-5
    assert simulation.status.step == pytest.approx(expected.status.step, rel=1e-9)
    for kind, energy in one.energy.items():
        assert other.energy[kind] == pytest.approx(
            energy, abs=ROUNDING * expected.balance.scale), kind


def stored(scene, packed, position, orientation):
    """Energy [J] of connectors, their moments and dipoles, from the formulas of the docs."""
    connectors, moments = scene.connectors, packed.moments
    first, second = connectors.bodies.T
    axes = axes_of(orientation)
    points = packed.model.links.attachment
    ends = [
        position[bodies] + np.einsum('ci,cij->cj', points[connectors.edges[:, end]], axes[bodies])
        for end, bodies in enumerate((first, second))]
    u = ends[1] - ends[0]
    length = np.linalg.norm(u, axis=1)
    laws = connectors.laws
    stretch = length - laws.natural_length
    k = np.where(stretch > 0.0, laws.extension, laws.compression)
    total = 0.5 * (k * stretch**2).sum()
    for bodies in (first, second):
        n = np.einsum('ci,cij->cj', moments.direction, axes[bodies])
        total += (moments.bending * (1.0 - (n * u).sum(axis=1) / length)).sum()
    trace = (axes[first] * axes[second]).sum(axis=(1, 2))
    total += (moments.twisting * (3.0 - trace) / 2.0).sum()
    dipole = np.array(scene.parameters['charge.dipole']) @ axes
    return total - (dipole @ np.array(scene.parameters['field.electric'])).sum()


def test_forces_are_the_slopes_of_the_energy():
    """Of all that other scenes here lack, on bodies that were moved far."""
    from icofabric_sim.simulation.devices.gpu import arrays, kernels, opening, records
    scene = ico.Scene.from_parameters({
        'contact.mode': 'never', 'weave.size': [3, 5, 3], 'connector': {
            'stiffness_extension': 500.0, 'stiffness_compression': 100.0,
            'bending_stiffness': 1e-2, 'attachment': {'up': [0.001, 0.002, 0.011]}},
        'charge.dipole': [1e-9, 0.0, 2e-9], 'field.electric': [0.0, 1e6, 3e6],
        'groups': {'top': 'z_max'}, 'connector_groups': {'g': {
            'between': 'top all', 'bending_stiffness': 3e-2, 'twisting_stiffness': 2e-2}},
        'solver': {'method': 'leapfrog', 'device': 'warp_cpu'}})
    packed = pack_scene(scene)
    layout, model, count = packed.layout, packed.model, scene.body_count
    rng = np.random.default_rng(2)
    position = scene.initial.position + rng.normal(0.0, 2e-3, (count, 3))
    orientation = scene.initial.orientation + rng.normal(0.0, 0.1, (count, 4))
    orientation /= np.linalg.norm(orientation, axis=1, keepdims=True)
    device = opening.open_device('warp_cpu')
    rooms = arrays.StateArrays(layout.slot_count, device)
    state, work = layout.pack(scene.initial._replace(
        position=position, orientation=orientation)), layout.room(model.links)
    rooms.put(state, work)
    clock, stage = records.Clock(), records.Stage()
    clock.start = arrays.doubles(np.array([0.0, 1e-5]), device)
    stage.source, stage.keep = 2, 1
    terms = arrays.terms_of(model, loaded=False)
    assert terms.moments and terms.dipole and not terms.midpoints and not terms.one_law
    warp.launch(
        kernels.step_kernel(terms), dim=LANES * len(layout.blocks.slot), device='cpu', inputs=[
            arrays.fabric_of(model, layout, device), records.Acting(), records.Nearness(), clock,
            stage,
            *rooms.poses, rooms.motion, rooms.acceleration])
    rooms.take(0, state, work, whole=True)
    found = layout.gather(work.acceleration)
    mass, inertia = 1.0 / model.inverse_mass, 1.0 / model.inverse_inertia
    for body in rng.choice(count, 6, replace=False):
        for k in range(6):
            sides = []
            for side in (1e-6, -1e-6):
                place, turn = position.copy(), orientation.copy()
                if k < 3:
                    place[body, k] += side * 0.01
                else:
                    axis = np.zeros(3)
                    axis[k - 3] = side
                    turn[body] = quaternion_product(rotation_quaternion(axis), turn[body])
                sides.append(stored(scene, packed, place, turn))
            slope = (sides[0] - sides[1]) / (2e-6 * (0.01 if k < 3 else 1.0))
            force = found[body, k] * (mass if k < 3 else inertia)
            assert force == pytest.approx(-slope, abs=2e-6 if k < 3 else 2e-8), (body, k)
    assert np.abs(found[:, :3]).max() * mass > 0.1
    assert np.abs(found[:, 3:]).max() * inertia > 1e-3


def test_a_pull_by_hand_is_the_same():
    ends = []
    for device in ('cpu', 'warp_cpu'):
        simulation = compiled('slab, leapfrog', device)
        simulation.advance_to(0.001)
        simulation.pull(3, (0.0, 0.0, 0.4))
        simulation.advance_to(0.004)
        ends.append(simulation.snapshot().position)
        simulation.release(3)
        simulation.advance_to(0.006)
        ends.append(simulation.snapshot().position)
    assert np.abs(ends[0] - ends[2]).max() <= ROUNDING
    assert np.abs(ends[1] - ends[3]).max() <= ROUNDING
    still = compiled('slab, leapfrog', 'cpu')
    still.advance_to(0.004)
    assert np.abs(ends[0] - still.snapshot().position).max() > 1e-5


def test_against_an_independent_integrator():
    simulation = ico.compile_scene(ico.Scene.from_parameters({
        'weave.size': [3, 3, 3], 'contact.mode': 'never', 'gravity': [0.0, 0.3, -9.81],
        'initial_random': {'velocity_sigma': 0.02, 'spin_sigma': 1.0, 'seed': 3},
        'solver': {'method': 'srkn6', 'tolerance': 1e-8, 'device': 'warp_cpu'}}))
    reference = integrate_quaternions(simulation.scene, 0.02)
    simulation.advance_to(0.02)
    half_edge = simulation.scene.geometry.half_edge
    moved = np.abs(simulation.snapshot().position - simulation.scene.initial.position).max()
    error = np.abs(simulation.snapshot().position - reference.position).max()
    assert error <= 1e-8 * half_edge < moved


@pytest.mark.parametrize('name', CHOSEN)
def test_the_same_bits_in_pieces_and_from_a_checkpoint(name):
    whole = bits(run(compiled(name)))
    simulation = compiled(name)
    assert bits(run(simulation, pieces=3)) == whole
    checkpoint = simulation.checkpoint()
    end = simulation.time + 0.002
    simulation.advance_to(end)
    last = bits(simulation.snapshot())
    other = compiled(name)
    other.restore(checkpoint)
    other.advance_to(end)
    assert bits(other.snapshot()) == last != whole
    assert other.status.step_count == simulation.status.step_count


def test_sines_are_those_of_the_library():
    from icofabric_sim.simulation.devices.gpu.kernels import OPTIONS
    from icofabric_sim.simulation.devices.gpu.rotations import sine_and_cosine

    @warp.kernel(enable_backward=False, module='unique', module_options=OPTIONS)
    def sines(
        angles: warp.array(dtype=warp.float64), found: warp.array(dtype=warp.float64, ndim=2)
    ):
        thread = warp.tid()
        sine, cosine = sine_and_cosine(angles[thread])
        found[thread, 0] = sine
        found[thread, 1] = cosine

    rng = np.random.default_rng(5)
    angles = np.concatenate([
        rng.uniform(-7.0, 7.0, 2000), rng.uniform(-1e6, 1e6, 2000),
        np.arange(-8, 9) * (np.pi / 4.0), [0.0, 1e-9]])
    found = warp.zeros((len(angles), 2), dtype=warp.float64, device='cpu')
    warp.launch(
        sines, dim=len(angles), device='cpu',
        inputs=[warp.array(angles, dtype=warp.float64, device='cpu'), found])
    assert np.abs(found.numpy() - np.column_stack([np.sin(angles), np.cos(angles)])).max() < 3e-16


@pytest.mark.parametrize('changes, names', [
    ({'contact.mode': 'auto', 'solver.method': 'leapfrog', 'contact.friction': 0.2},
     ['contact.friction 0.2', 'take 0']),
    ({'contact.mode': 'auto', 'solver.method': 'leapfrog', 'contact.damping': 0.2},
     ['contact.damping 0.2', 'take 0']),
    ({'contact.mode': 'auto', 'solver.method': 'srkn6', 'connector.stiffness_compression': 0.0},
     ['solver.method srkn6', 'k_e', 'take auto, leapfrog, dop8']),
    ({'contact.mode': 'auto', 'solver.method': 'leapfrog', 'bodies.ball.position': [0.0, 0.0, 1.0],
      'bodies.ball.edge_length': 0.05}, ['bodies.ball.edge_length']),
    ({'charge': {'per_body': 1e-9, 'mutual': True}}, ['charge.mutual']),
    ({'connector': {'maxwell_stiffness': 100.0, 'maxwell_time': 0.01}}, ['dop8', 'Maxwell']),
    ({'charge.per_body': 1e-9, 'field.magnetic': [0.0, 0.0, 1.0]}, ['dop8', 'field.magnetic']),
    ({'connector.break_length_extension': 0.1}, ['dop8', 'break']),
    ({'shell.principal_inertia': [1e-6, 1.2e-6, 1.4e-6]}, ['dop8', 'isotropic']),
    ({'connector.law': str(Path(__file__).with_name('ranks_law.csv'))}, ['connector.law']),
    ({'groups': {'tip': 'z_min'}, 'connector.stiffness_compression': 200.0,
      'solver.method': 'srkn6', 'drives': {'pull': {
          'group': 'tip', 'motion': 'velocity', 'linear': [0.1, 0.0, 0.0]}}},
     ['drives.pull', 'srkn6', 'k_e', 'take solver.method auto']),
    ({'groups': {'tip': 'z_min'}, 'solver.method': 'tsit5', 'drives': {'pull': {
        'group': 'tip', 'motion': 'velocity', 'linear': [0.1, 0.0, 0.0]}}},
     ['drives.pull by tsit5 is not computed', 'take solver.method auto']),
    ({'groups': {'tip': 'z_min'}, 'tractions': {
        'wind': {'group': 'tip', 'faces': 'all', 'pressure': 1.0}}}, ['tractions.wind']),
    ({'weave.kind': 'radial', 'connector.bending_stiffness': 1e-3}, [
        'connector.bending_stiffness', 'radial'])])
def test_what_a_device_cannot_compute_is_refused_by_its_name(changes, names):
    scene = ico.Scene.from_parameters({
        'contact.mode': 'never', 'weave.size': [5, 5, 5], 'solver.device': 'cuda', **changes})
    # Before a GPU is looked for.
    with pytest.raises(ParameterError) as caught:
        ico.compile_scene(scene)
    for name in [*names, 'solver.device cuda', 'solver.device cpu']:
        assert name in str(caught.value)


def test_methods_and_ranks_are_refused_by_name_too():
    with pytest.raises(
            ParameterError,
            match='sdirk4 .* one of leapfrog, srkn4, srkn6, srkn8, dop8, tsit5, or'):
        compiled('slab, leapfrog', solver={'method': 'sdirk4'})
    scene = compiled('slab, leapfrog').scene
    with pytest.raises(ParameterError, match='not for ranks of MPI'):
        require_on_device(scene, cosines=False, body_force=False, shared=True)


@pytest.mark.skipif(warp.is_cuda_available(), reason='there is a GPU')
def test_without_a_gpu_cuda_names_the_way_out():
    with pytest.raises(ParameterError, match='finds no NVIDIA GPU .* take cpu, or warp_cpu'):
        compiled('slab, leapfrog', 'cuda')


def test_a_fabric_beyond_the_memory_of_the_device_is_refused(monkeypatch):
    from icofabric_sim.simulation.devices.gpu import opening, run
    monkeypatch.setattr(opening.Device, 'free_bytes', 10_000)
    monkeypatch.setattr(run, 'fabric_of', lambda *_: pytest.fail('allocated'))
    for name in ('slab, leapfrog', 'damped, dop8'):
        with pytest.raises(ValueError, match='bodies need about .* GB on the processor, by Warp'):
            compiled(name)


@pytest.mark.parametrize('name, spin', [
    ('slab, leapfrog', 60.0), ('kinks, srkn6', 1.0), ('damped, given', 1.0)])
def test_health_checks_on_the_device_see_what_those_here_see(name, spin):
    ledgers = []
    for device in ('cpu', 'warp_cpu'):
        simulation = compiled(name, device, initial_random={
            'velocity_sigma': 0.02, 'spin_sigma': spin, 'seed': 3})
        trajectory = simulation._driver.trajectory
        simulation.apply_wrench('l', force=(0.0, 0.02, 0.0))
        for _ in range(6):
            simulation.advance_steps(simulation._driver.monitor.interval - 1)
            # The device has the close bound of the frequency alone.
            trajectory.ledger.low = 1e-9
            simulation.advance_steps(1)
        ledgers.append(trajectory.ledger.numbers.copy())
    assert ledgers[0][monitor.CHECK_COUNT] >= 6.0 and ledgers[0][monitor.KINETIC] > 0.0
    assert ledgers[0][monitor.WORKED] > 0.0 and ledgers[0][monitor.TENSIONS] > 0.0
    # Shells that turn so fast let connectors in.
    assert spin < 2.0 or ledgers[0][monitor.OBSTRUCTED] > 5.0
    scale = ledgers[0][monitor.SCALE]
    margins = {monitor.ERROR: max(scale, 1.0), monitor.WORST: 1.0}
    for place, (here, there) in enumerate(zip(*ledgers)):
        if place == monitor.SAVED_AT:
            # Steps of a call, of which there are as many as take some milliseconds.
            continue
        margin = ROUNDING * margins.get(place, 0.0)
        assert there == pytest.approx(here, rel=1e-6, abs=margin), place


def test_the_saved_state_stays_on_the_device_until_somebody_asks():
    simulation = compiled('slab, leapfrog')
    trajectory = simulation._driver.trajectory
    simulation.apply_wrench('l', force=(0.0, 0.02, 0.0))
    # The first checks look into shells as well, which is done here.
    simulation.advance_steps(3 * simulation._driver.monitor.interval)
    holder = trajectory.executor
    assert holder.has_saved
    saved = trajectory.saved
    assert not holder.has_saved
    assert np.array_equal(saved.position, trajectory.state.position)
    assert np.array_equal(trajectory.loads.earlier_work, trajectory.loads.work)
    assert np.abs(trajectory.loads.work).max() > 0.0


def test_a_device_that_fails_ends_the_run_and_the_last_state_is_kept(monkeypatch):
    from icofabric_sim.simulation.devices.gpu.arrays import StateArrays
    from icofabric_sim.simulation.devices.gpu.steps import DeviceSteps
    simulation = compiled('slab, leapfrog')
    simulation.advance_to(0.02)
    before = simulation.status.step_count
    monkeypatch.setattr(DeviceSteps, '_steps', lambda *_: 1 / 0)
    monkeypatch.setattr(StateArrays, 'take_saved', lambda *_: 1 / 0)
    with pytest.raises(ico.SimulationError) as caught:
        simulation.advance_to(1.0)
    assert str(caught.value).startswith(
        'the processor, by Warp has failed: division by zero; the last good state, of t = 0.0')
    assert before > 64 and simulation.status.step_count == before
    snapshot = simulation.snapshot()
    assert np.isfinite(snapshot.position).all() and snapshot.energy['kinetic'] > 0.0
    monkeypatch.undo()
    simulation.reset()
    simulation.advance_steps(3)


def test_bytes_that_are_counted_are_those_that_are_taken():
    from icofabric_sim.simulation.devices.gpu import arrays, opening
    for name in ('even rows, srkn8', 'moments and an anchor, leapfrog'):
        packed = pack_scene(compiled(name, 'cpu').scene)
        device = opening.open_device('warp_cpu')
        fabric = arrays.fabric_of(packed.model, packed.layout, device)
        state = arrays.StateArrays(packed.layout.slot_count, device)
        taken = sum(
            values.capacity for values in (
                fabric.slot, fabric.alive, fabric.place, fabric.present, fabric.free_mass,
                fabric.free_inertia, fabric.extension, fabric.compression, fabric.natural,
                *state.poses, state.motion, state.acceleration, state.saved_pose,
                state.saved_motion) if values is not None)
        assert taken <= arrays.bytes_of(packed.model, packed.layout) <= 1.1 * taken


def test_bytes_of_the_pair_are_counted_too():
    from icofabric_sim.simulation.devices.gpu import pair
    names = ('_slopes', '_spent', '_done', '_stage', '_start', '_errors')
    for name in ('damped, dop8', 'free, dop8'):
        holder = compiled(name)._driver.trajectory.executor
        assert isinstance(holder, pair.DevicePair)
        fabric, state = holder._fabric, holder._state
        arrays = [
            fabric.slot, fabric.alive, fabric.place, fabric.present, fabric.free_mass,
            fabric.free_inertia, fabric.own_mass, fabric.own_inertia, fabric.extension,
            fabric.compression, fabric.natural, fabric.damping, *state.poses, state.motion,
            state.acceleration, state.saved_pose, state.saved_motion]
        for each in names:
            found = getattr(holder, each)
            arrays += found if isinstance(found, (list, tuple)) else [found]
        taken = sum(values.capacity for values in arrays if values is not None)
        assert taken <= 1.02 * holder.device_bytes and holder.device_bytes <= 1.1 * taken


def test_a_pair_that_fails_ends_the_run_and_the_last_state_is_kept(monkeypatch):
    from icofabric_sim.simulation.devices.gpu.pair import DevicePair
    simulation = compiled('damped, dop8')
    simulation.advance_to(0.01)
    before = simulation.status.step_count
    monkeypatch.setattr(DevicePair, 'try_step', lambda *_, **__: 1 / 0)
    with pytest.raises(ico.SimulationError, match='by Warp has failed: division by zero; the las'):
        simulation.advance_to(1.0)
    assert simulation.status.step_count == before > 5
    snapshot = simulation.snapshot()
    assert np.isfinite(snapshot.position).all() and snapshot.energy['kinetic'] > 0.0
    monkeypatch.undo()
    simulation.reset()
    simulation.advance_steps(3)


@pytest.mark.parametrize('more', [
    '{method: leapfrog, tolerance: 0.1, device: warp_cpu}',
    '{method: auto, tolerance: 1.0e-4, device: warp_cpu}\n    connector: {damping: 0.05}'])
def test_a_record_of_a_device_repeats_on_it(tmp_path, capsys, more):
    scene = tmp_path / 'scene.yaml'
    scene.write_text(
        '/**:\n  ros__parameters:\n    weave: {size: [7, 7, 9]}\n    contact: {mode: never}\n'
        '    initial_random: {velocity_sigma: 0.02, spin_sigma: 1.0, seed: 3}\n'
        f'    solver: {more}\n    duration: 0.05\n')
    assert main(['run', str(scene), '--record', str(tmp_path / 'bag')]) == 0
    said = capsys.readouterr().out
    # 221 bodies at about 331 bytes, or 1.9 kB by dop8, and slots without a body.
    taken = re.search(r'device +the processor, by Warp; memory about (.*) MB', said)
    assert taken and (0.06 if 'leapfrog' in more else 0.4) < float(taken[1]) < (
        0.2 if 'leapfrog' in more else 0.8)
    assert main(['verify', str(tmp_path / 'bag')]) == 0
    assert 'identical: ' in capsys.readouterr().out
