# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Shells that touch on a device, by Warp on the processor, beside the processor's own loops."""

from types import SimpleNamespace

from contact_poses import (
    facing,
    first_touch,
    KINDS,
    NORMALS,
    pose,
    touch,
    touch_floor,
    VERTICES,
)
from contact_scenes import crowd
from fabrics import changed, same_state
import icofabric_sim as ico
from icofabric_sim.commands.main import main
from icofabric_sim.parameters.text import dump_parameters
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.errors import SimulationError
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

warp = pytest.importorskip('warp', reason='Warp (extra `gpu`) is not installed')

A = 0.01
DOWN = np.array([0.0, 0.0, -1.0])
# What rounding does to a force at an overlap of 1e-6 a, relative.
ROUNDING = 1e-8

# Pressed together from both sides, so that shells meet some time later.
PRESSED = ico.load_scene('free_slab').with_changes({
    'weave.size': [4, 4, 2], 'solver.threads': 1, 'groups.left': 'x_min', 'groups.right': 'x_max',
    'contact.stiffness': 1e6, 'loads.left.group': 'left', 'loads.right.group': 'right'})


def press(simulation):
    """Press both sides together."""
    for side, force in (('left', 0.5), ('right', -0.5)):
        simulation.apply_wrench(side, force=(force, 0.0, 0.1 * force), time=0.001)


def pushes(poses, pairs, planes=()):
    """What the device's law says of pairs of slots, for 1 N/m, and overlaps [m]."""
    from icofabric_sim.simulation.devices.gpu import contact, opening, records, touching

    count, slots = len(pairs), len(poses)
    fabric = records.Fabric()
    fabric.stride, fabric.lanes = slots, 8
    device = opening.open_device('warp_cpu')
    fabric.slot = warp.zeros(1, dtype=warp.int32, device='cpu')
    fabric.alive = warp.zeros(1, dtype=warp.uint8, device='cpu')
    found = touching.DeviceContacts(
        SimpleNamespace(blocks=SimpleNamespace(slot=np.zeros(1)), slot_count=slots), fabric,
        device)
    found._put_pairs(SimpleNamespace(
        pairs=np.array(pairs, np.int32), half_edge=A, stiffness=1.0,
        planes=np.array(planes, float).reshape(-1, 4), entry=np.zeros(0, np.int32),
        slot=np.zeros(0, np.int64)))
    warp.launch(contact.touch, dim=found.room, device='cpu', inputs=[
        fabric, found.near,
        warp.array(np.array(poses).T.ravel(), dtype=warp.float64, device='cpu')])
    return (found.near.pushes.numpy().reshape(-1, contact.PUSH_SIZE)[:count],
            found.near.depths.numpy()[:2 * count:2])


def same_push(found, overlap, touching, out):
    """Hold one pair beside what the processor says of it."""
    assert bool(found[9]) == touching
    if touching:
        force = np.linalg.norm(out[:3])
        np.testing.assert_allclose(found[:3], out[:3], atol=ROUNDING * force)
        np.testing.assert_allclose(found[3:9], out[3:9], atol=ROUNDING * force * A)
        # Of facets of edges it is larger, or the least of all, but never 0.
        assert 0.0 < overlap < out[11] + 0.021 * A


@pytest.mark.parametrize('kind', KINDS)
def test_pairs_push_each_other_as_on_the_processor(kind):
    rng, poses, pairs, wanted = np.random.default_rng(2), [], [], []
    for number in range(60):
        ra, rb, way = pose(kind, rng)
        way = A * (first_touch(ra, rb, way) - rng.choice([1.0, 1.0, -1.0]) * 10.0**rng.uniform(
            -6.0, -0.5)) * way
        place = 0.1 * rng.standard_normal(3)
        turns = [Rotation.from_matrix(turn).as_quat() for turn in (ra, rb)]
        poses += [[*place, *turns[0]], [*(place + way), *turns[1]]]
        pairs.append([2 * number, 2 * number + 1])
        wanted.append(touch(
            place, Rotation.from_quat(turns[0]).as_matrix(), place + way,
            Rotation.from_quat(turns[1]).as_matrix(), A))
    assert 20 < sum(touching for touching, _ in wanted) < 60
    for found, overlap, one in zip(*pushes(poses, pairs), wanted):
        same_push(found, overlap, *one)


def test_planes_push_as_on_the_processor():
    rng, poses, wanted = np.random.default_rng(3), [], []
    plane = np.array([0.6, 0.0, 0.8, -0.02])
    onto = Rotation.align_vectors([plane[:3]], [-DOWN])[0]
    for number in range(120):
        stood = (
            Rotation.random(random_state=rng),
            Rotation.from_matrix(facing(np.eye(3), VERTICES[number % 12], DOWN)),
            Rotation.from_matrix(facing(np.eye(3), NORMALS[number % 20], DOWN)))[number % 3]
        low = (VERTICES @ stood.as_matrix().T)[:, 2].min()
        depth = rng.choice([1.0, 1.0, -1.0]) * 10.0**rng.uniform(-6.0, -0.3)
        place = (plane[3] - A * (low + depth)) * plane[:3] + 0.1 * np.cross(
            plane[:3], rng.standard_normal(3))
        turn = (onto * stood).as_quat()
        poses.append([*place, *turn])
        wanted.append(touch_floor(
            plane[:3], plane[3], place, Rotation.from_quat(turn).as_matrix(), A))
    assert 40 < sum(touching for touching, _ in wanted) < 120
    found, overlaps = pushes(poses, [[k, -1] for k in range(120)], [plane])
    for one, overlap, (touching, out) in zip(found, overlaps, wanted):
        same_push(one, overlap, touching, out)
        assert overlap == pytest.approx(out[11], abs=1e-14) and not one[6:9].any()


BOX = {
    'planes__floor__normal': [0.0, 0.0, 1.0], 'planes__floor__offset': -0.062,
    'gravity': [0.0, 0.0, -9.81], 'contact__stiffness': 2e4}


@pytest.mark.parametrize('solver', [
    {'solver.method': 'leapfrog', 'solver.step': 2e-5},
    {'solver.method': 'leapfrog', 'solver.tolerance': 1e-2},
    pytest.param({'solver.method': 'srkn6', 'solver.step': 4e-5}, marks=pytest.mark.long),
    pytest.param({'solver.method': 'dop8', 'solver.step': 1e-4}, marks=pytest.mark.long),
    {'solver.method': 'dop8', 'solver.tolerance': 1e-2},
    pytest.param(
        {'solver.method': 'auto', 'connector.damping': 0.02, 'solver.tolerance': 1e-2},
        marks=pytest.mark.long)],
    ids=['given', 'chosen', 'srkn6', 'dop8, given', 'dop8, chosen', 'auto'])
def test_a_crowd_moves_on_a_device_as_on_the_processor(solver):
    scene, ends = changed(crowd(**BOX), solver), []
    for device in ('cpu', 'warp_cpu', 'warp_cpu'):
        simulation = ico.compile_scene(changed(scene, {'solver.device': device}))
        if len(ends) == 2:
            # In pieces, and from a checkpoint in the midst of a contact.
            simulation.advance_to(0.0095)
            checkpoint = simulation.checkpoint().to_bytes()
            simulation = ico.compile_scene(changed(scene, {'solver.device': device}))
            simulation.restore(Checkpoint.from_bytes(checkpoint))
        simulation.advance_to(0.012)
        ends.append((simulation.snapshot(), simulation.status))
    (one, run), (other, there), (again, _) = ends
    given = 'solver.step' in solver
    assert run.contact_tests > 1000
    if given:
        assert run.contact_tests == there.contact_tests and run.step_count == there.step_count
    else:
        # The same, but where rounding decides between two lengths.
        assert there.step_count == pytest.approx(run.step_count, rel=0.5)
    # Beside steps that were chosen: what these err by.
    apart = 1e-9 if given else 1e-3
    assert np.abs(one.position - other.position).max() < apart * A
    assert other.energy['total'] == pytest.approx(one.energy['total'], rel=apart)
    assert abs(other.energy['balance_error']) < 1e-3 * other.energy['total']
    # Something has been hit hard.
    start = scene.initial.linear_velocity
    assert np.abs(one.linear_velocity - start).max() > 0.1
    if given or run.method_name == 'dop8':
        assert same_state(other, again)


def test_a_state_that_was_here_is_followed_from_where_it_is():
    # At the same time and with the same mean velocity: nothing else tells two searches apart.
    from icofabric_sim.simulation.devices.gpu import opening, records, touching

    slots, rng = 16, np.random.default_rng(1)
    found = touching.DeviceContacts(
        SimpleNamespace(blocks=SimpleNamespace(slot=np.zeros(2)), slot_count=slots),
        records.Fabric(), opening.open_device('warp_cpu'))
    watch = SimpleNamespace(
        frame=np.zeros(7), radius=1.0, reference=rng.standard_normal((3, slots)),
        turned=rng.standard_normal((4, slots)))
    for _ in range(2):
        found.put(None, watch, anew=True)
        np.testing.assert_array_equal(
            found.near.reference.numpy().reshape(7, slots),
            np.vstack([watch.reference, watch.turned]))
        watch.reference[:] = rng.standard_normal((3, slots))
        before = found.near.reference.numpy()
        found.put(None, watch, anew=False)
        np.testing.assert_array_equal(found.near.reference.numpy(), before)


def test_shells_that_overlap_too_deeply_end_a_run_on_a_device():
    scene = crowd(**{
        **BOX, 'contact__stiffness': 20.0, 'solver__method': 'leapfrog', 'solver__step': 2e-5})
    said = []
    for device in ('cpu', 'warp_cpu'):
        simulation = ico.compile_scene(changed(scene, {'solver.device': device}))
        with pytest.raises(SimulationError, match='overlap by .* might pass through') as caught:
            simulation.advance_to(0.1)
        said.append(str(caught.value))
    assert said[0].split(' overlap')[0] == said[1].split(' overlap')[0]


def test_a_record_of_shells_that_touch_is_verified(tmp_path):
    scene = changed(crowd(**BOX), {
        'solver.device': 'warp_cpu', 'solver.method': 'leapfrog', 'solver.step': 2e-5})
    path, bag = tmp_path / 'crowd.yaml', tmp_path / 'bag'
    path.write_text(dump_parameters(scene.parameters.complete()))
    assert main(['run', str(path), '--duration', '0.012', '--record', str(bag)]) == 0
    assert main(['verify', str(bag)]) == 0


def test_auto_goes_on_by_dop8_once_shells_are_near_on_a_device_too():
    ends, changed_at, kept = [], [], None
    for device in ('cpu', 'warp_cpu', 'warp_cpu'):
        simulation = ico.compile_scene(PRESSED.with_changes({'solver.device': device}))
        press(simulation)
        assert simulation.status.method_name == 'srkn6'
        if kept is not None:
            # Between two looks, from a checkpoint of after the change, or watched all the while.
            simulation.restore(Checkpoint.from_bytes(kept))
            simulation.advance_to(0.072)
            assert same_state(simulation.snapshot(), ends[-1])
            break
        while simulation.status.method_name != 'dop8':
            simulation.advance_to(simulation.time + 5e-4)
            assert simulation.time < 0.08
        changed_at.append(simulation.time)
        simulation.advance_to(changed_at[-1] + 0.002)
        kept = simulation.checkpoint().to_bytes() if device != 'cpu' else None
        simulation.advance_to(0.072)
        assert simulation.status.contact_count > 0 or simulation.status.deepest_overlap > 0.0
        assert simulation.status.device in ('', 'the processor, by Warp')
        ends.append(simulation.snapshot())
    assert changed_at[0] == changed_at[1]
    one, other = ends
    # What rounding makes of steps, and the motion of that.
    assert np.abs(one.position - other.position).max() < 1e-7 * A
    assert not same_state(one, other)


@pytest.mark.parametrize('changes, name', [
    ({}, 'srkn6'), ({'connector.stiffness_compression': 200.0}, 'leapfrog'),
    ({'solver.step': 1e-4}, 'srkn4'), ({'contact.mode': 'never'}, 'srkn6')])
def test_auto_takes_what_a_device_can_take_through_contacts(changes, name):
    simulation = ico.compile_scene(PRESSED.with_changes({'solver.device': 'warp_cpu', **changes}))
    assert simulation.status.method_name == name


def test_room_for_the_method_that_may_follow_is_asked_for_at_the_start(monkeypatch):
    from icofabric_sim.simulation.devices.gpu import opening

    scene = PRESSED.with_changes({'solver.device': 'warp_cpu'})
    first = ico.compile_scene(scene).status
    assert first.method_name == 'srkn6' and first.touching_method == 'dop8'
    monkeypatch.setattr(opening.Device, 'free_bytes', first.device_bytes + 1000)
    with pytest.raises(ValueError, match='bodies need about .* GB on the processor, by Warp'):
        ico.compile_scene(scene)
    # Where nothing else may follow it is enough.
    assert ico.compile_scene(scene.with_changes({'solver.method': 'srkn6'})).time == 0.0
