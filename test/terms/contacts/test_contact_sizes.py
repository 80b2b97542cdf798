# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Contact of two shells of different sizes: potential, forces, distances, gaps."""

from contact_poses import half_spaces, KINDS, moments, pose, RHO, touch, wrench
from contact_scenes import A, loose
from fabrics import same_state
import icofabric_sim as ico
from icofabric_sim import contact
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.contact.pair_forces import PairForces
from icofabric_sim.simulation.contact.setup import ContactSetup
from icofabric_sim.simulation.stepping.thread_team import teams_of
from icofabric_sim.terms.contacts.gap import axes_of, widest_gap
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

SIZES = (0.3, 0.7, 1.6, 4.0)
SIZES_TWO_LONG = (
    0.3, 1.6, *(pytest.param(size, marks=pytest.mark.long) for size in (0.7, 4.0)))


def first_touch(ra, rb, way, size):
    """Distance of the centres at which they begin to touch."""
    low, high = 0.0, 2.0 * (1.0 + size)
    for _ in range(60):
        middle = (low + high) / 2.0
        if touch(np.zeros(3), ra, middle * way, rb, 1.0, size)[0]:
            low = middle
        else:
            high = middle
    return low


def overlapping(kind, rng, size, depth):
    """Two bodies (place, matrix) of half edges 1 and `size` that overlap by so much."""
    ra, rb, way = pose(kind, rng)
    return np.zeros(3), ra, (first_touch(ra, rb, way, size) - depth) * way, rb


@pytest.mark.parametrize('size', SIZES_TWO_LONG)
@pytest.mark.parametrize('kind', KINDS)
def test_the_depth_is_four_times_the_mean_depth_of_the_overlap(kind, size):
    rng = np.random.default_rng(5)
    for depth in (1e-3, 0.05, 0.3, 1.2 * min(size, 1.0)):
        xa, ra, xb, rb = overlapping(kind, rng, size, depth)
        touching, out = touch(xa, ra, xb, rb, 1.0, size)
        volume, first = moments(half_spaces(xa, ra), half_spaces(xb, rb, size))
        assert touching and out[10] == pytest.approx(4.0 * first / volume, rel=1e-6)
        assert out[9] == 0.5 * out[10]**2 and out[11] > 0.5 * depth


@pytest.mark.parametrize('size', SIZES_TWO_LONG)
@pytest.mark.parametrize('kind', KINDS)
def test_forces_are_the_gradient_of_the_energy(kind, size):
    rng, step = np.random.default_rng(6), 1e-5
    for depth in (0.02, 0.3):
        xa, ra, xb, rb = overlapping(kind, rng, size, depth)
        out = touch(xa, ra, xb, rb, 1.0, size)[1]
        found, largest = wrench(out), np.abs(out[:3]).max()
        for k in range(6):
            energies = []
            for sign in (1.0, -1.0):
                moved, turned = xa.copy(), ra
                if k < 3:
                    moved[k] += sign * step
                else:
                    turned = Rotation.from_rotvec(sign * step * np.eye(3)[k - 3]).as_matrix() @ ra
                energies.append(touch(moved, turned, xb, rb, 1.0, size)[1][9])
            slope = (energies[0] - energies[1]) / (2.0 * step)
            assert found[k] == pytest.approx(-slope, abs=2e-4 * largest * max(size, 1.0))
        # Angular momentum is kept.
        about = out[3:6] + out[6:9] + np.cross(xa - xb, out[:3])
        np.testing.assert_allclose(about, 0.0, atol=1e-12 * largest * (1.0 + size))


@pytest.mark.parametrize('size', SIZES)
def test_second_derivatives_are_those_of_the_forces(size):
    rng, seen = np.random.default_rng(9), 0
    forces = PairForces(ContactSetup(
        1.0, 1.0, 0.0, 0.0, np.zeros((0, 4)), (), False, False, np.zeros(3), '',
        half_edges=np.array([1.0, size])))
    for kind in KINDS:
        xa, ra, xb, rb = overlapping(kind, rng, size, 0.02)
        pair, place = np.array([[0, 1]]), np.array([xa, xb])
        exact, smoothed = (
            forces.blocks(pair, [], place, np.array([ra.T, rb.T]), smoothed=smoothed)[1][0]
            for smoothed in (False, True))
        # Differences see what lies beyond where a corner comes or goes.
        if kind in ('random', 'tilted face', 'edge on edge', 'vertex on face'):
            largest = np.abs(exact).max()
            np.testing.assert_allclose(exact, smoothed, atol=1e-3 * largest)
            seen += 1
        np.testing.assert_allclose(exact, exact.T, atol=1e-12 * np.abs(exact).max())
    assert seen == 4


@pytest.mark.parametrize('size', SIZES)
def test_bodies_that_change_places_push_each_other_alike(size):
    rng = np.random.default_rng(7)
    for kind in KINDS:
        xa, ra, xb, rb = overlapping(kind, rng, size, 0.1)
        one = touch(xa, ra, xb, rb, 1.0, size)[1]
        two = touch(xb, rb, xa, ra, size, 1.0)[1]
        assert (one[:3] == -two[:3]).all() and one[9] == two[9] and one[11] == two[11]
        assert (one[3:6] == two[6:9]).all() and (one[6:9] == two[3:6]).all()
        np.testing.assert_allclose(one[15:18], two[15:18], atol=1e-14 * (1.0 + size))


def test_a_face_on_a_face_overlaps_by_what_it_is_pushed_in():
    for size in SIZES:
        ra = np.eye(3)
        way = half_spaces(np.zeros(3), ra)[0, :3]
        place = (RHO * (1.0 + size) - 1e-3) * way
        touching, out = touch(np.zeros(3), ra, place, ra, 1.0, size)
        # Sides of the smaller lean outwards, which takes some of the mean depth.
        assert touching and out[10] == pytest.approx(1e-3, rel=3e-3 / min(size, 1.0))
        assert out[11] == pytest.approx(1e-3, rel=1e-9)


def test_a_body_wholly_within_another_is_not_pushed():
    ra, rb = Rotation.random(2, random_state=3).as_matrix()
    touching, out = touch(np.zeros(3), ra, np.full(3, 0.05), rb, 4.0, 0.3)
    assert touching and (out[:9] == 0.0).all() and np.isfinite(out).all()
    assert out[10] == pytest.approx(0.3 * RHO, rel=1e-12)


@pytest.mark.parametrize('size', SIZES)
def test_distances_are_those_at_which_a_shift_makes_them_touch(size):
    rng = np.random.default_rng(8)
    for _ in range(30):
        ra, rb = (Rotation.random(random_state=rng) for _ in range(2))
        way = rng.standard_normal(3)
        way *= rng.uniform(0.85, 1.5) * 1.6 * (1.0 + size) / np.linalg.norm(way)
        found = contact.separation(
            1.0, (np.zeros(3), ra.as_quat()), (way, rb.as_quat()), other_edge=size)
        other = contact.separation(
            size, (way, rb.as_quat()), (np.zeros(3), ra.as_quat()), other_edge=1.0)
        assert found.distance == pytest.approx(other.distance, abs=1e-12 * (1.0 + size))
        for part in (1.0 - 1e-6, 1.0 + 1e-6):
            wanted = (part > 1.0) == (found.distance > 0.0)
            moved = part * found.distance
            push = contact.contact_force(
                1.0, (moved * found.axis, ra.as_quat()), (way, rb.as_quat()), 1.0,
                other_edge=size)
            assert push.in_contact == wanted, (found.distance, part)


@pytest.mark.parametrize('size', SIZES)
def test_shells_touch_where_no_axis_shows_a_gap_and_nowhere_else(size):
    generator, seen = np.random.default_rng(5), [0, 0]
    for _ in range(400):
        both = Rotation.random(2, random_state=generator)
        way = generator.standard_normal(3)
        way *= generator.uniform(1.45, 1.95) * (1.0 + size) / np.linalg.norm(way)
        quaternion = both.as_quat().T.copy()
        gap, _ = widest_gap(
            np.inf, 1.0, size, *way, axes_of(quaternion, 0), axes_of(quaternion, 1))
        ra, rb = both.as_matrix()
        touches = touch(np.zeros(3), ra, way, rb, 1.0, size)[0]
        assert touches == (gap < 0.0) or abs(gap) < 1e-12 * (1.0 + size)
        seen[touches] += 1
    assert min(seen) > 40


def sized(*bodies, **changes):
    """
    Loose bodies: half edge over that of the shell, place, velocity, spin, orientation.

    Body 0 is a woven one, alone at the origin.
    """
    flat = {}
    for number, (size, *_) in enumerate(bodies):
        flat[f'bodies__b{number}__edge_length'] = 2.0 * A * size
    return loose(*(body[1:] for body in bodies), **flat, **changes)


def momenta_of(scene, snapshot):
    """Momentum and angular momentum about the origin of all bodies."""
    linear = scene.masses.mass[:, None] * snapshot.linear_velocity
    angular = np.cross(snapshot.position, linear) + (
        scene.masses.inertia[:, None] * snapshot.angular_velocity)
    return linear.sum(axis=0), angular.sum(axis=0)


MET = ((2.5, (0.07, 0.01, 0.005), (-0.3, 0.0, 0.0), (1.0, 0.0, 2.0),
        Rotation.from_rotvec([0.3, -0.8, 0.5])),
       (0.4, (-0.03, 0.004, 0.0), (2.0, 0.0, 0.0), (0.0, 0.0, 0.0)))


@pytest.mark.parametrize('method', [
    'dop8',
    *(pytest.param(name, marks=pytest.mark.long) for name in ('srkn6', 'leapfrog', 'sdirk4'))])
def test_collisions_of_bodies_of_several_sizes_keep_what_is_conserved(method):
    scene = sized(*MET, solver__method=method, **(
        {} if method == 'dop8' else {'solver__tolerance': 1e-6}))
    # As magnified: masses with the cube, inertias with the fifth power.
    np.testing.assert_allclose(scene.masses.mass / scene.shell.mass, [1.0, 2.5**3, 0.4**3])
    np.testing.assert_allclose(scene.masses.inertia / scene.shell.inertia, [1.0, 2.5**5, 0.4**5])
    simulation = ico.compile_scene(scene)
    before, start = momenta_of(scene, simulation.snapshot()), simulation.snapshot()
    simulation.advance_to(0.1)
    end = simulation.snapshot()
    # All have met.
    assert (np.abs(end.linear_velocity - start.linear_velocity).max(axis=1) > 0.05).all()
    sizes = np.abs(before[0]).max(), np.abs(before[1]).max()
    for one, other, size in zip(before, momenta_of(scene, end), sizes):
        np.testing.assert_allclose(one, other, atol=1e-11 * size)
    assert abs(end.energy['total'] / start.energy['total'] - 1.0) < 1e-4


@pytest.mark.parametrize('losses', [
    {}, pytest.param({'contact__damping': 1.0, 'contact__friction': 0.3}, marks=pytest.mark.long)])
def test_what_is_known_of_contacts_changes_no_bit(losses):
    rng = np.random.default_rng(11)
    places = 0.05 * np.array(
        [[x, y, z] for x in (0, 1, 2) for y in (0, 1, 2) for z in (0, 1)][1:])
    bodies = [
        (size, place, -4.0 * (place - 0.04), 5.0 * rng.standard_normal(3),
         Rotation.random(random_state=rng))
        for size, place in zip(np.exp(rng.uniform(-0.7, 0.6, len(places))), places)]
    ends = []
    for mode, threads in (('auto', 1), ('always', 1), ('auto', 2)):
        scene = sized(
            *bodies, contact__mode=mode, solver__tolerance=1e-5, contact__stiffness=1e5,
            **losses)
        with teams_of(threads):
            simulation = ico.compile_scene(scene)
        simulation.advance_to(0.015)
        checkpoint = simulation.checkpoint().to_bytes()
        simulation = ico.compile_scene(scene)
        simulation.restore(Checkpoint.from_bytes(checkpoint))
        simulation.advance_to(0.03)
        ends.append(simulation.snapshot())
    # Whatever they lose, they have hit each other.
    changed = ends[0].linear_velocity - scene.initial.linear_velocity
    assert (np.abs(changed).max(axis=1) > 0.05).sum() > 3
    assert (ends[0].energy['dissipated'] > 0.02 * ends[0].energy['total']) == bool(losses)
    for other in ends[1:]:
        assert same_state(ends[0], other) and ends[0].energy == other.energy


@pytest.mark.parametrize('size', [0.5, 2.0])
def test_a_body_rests_on_a_plane_and_on_another_by_its_own_faces(size):
    # On a face, each: heights are inscribed radii.
    way = half_spaces(np.zeros(3), np.eye(3))[0, :3]
    turned = Rotation.align_vectors([[0.0, 0.0, 1.0]], [way])[0]
    low, high = RHO * A - 0.05, RHO * A * (2.0 + size) - 0.05
    scene = sized(
        (1.0, (0.2, 0.0, low), (0, 0, 0), (0, 0, 0), turned),
        (size, (0.2, 0.0, high), (0, 0, 0), (0, 0, 0), turned),
        planes__floor__normal=[0.0, 0.0, 1.0], planes__floor__offset=-0.05,
        groups__woven='ids 0', supports__woven__group='woven',
        gravity=[0.0, 0.0, -9.81], contact__stiffness=1e5)
    weight = 9.81 * scene.masses.mass[1:]
    found = ico.solve_equilibrium(scene)
    assert found.converged and len(found.contact_state.pairs) == 1
    # Sides lean outwards, which takes a little of the mean depth.
    gaps = found.snapshot.position[1:, 2] - [low, high]
    assert gaps[0] == pytest.approx(-weight.sum() / 1e5, rel=0.02)
    assert gaps[1] - gaps[0] == pytest.approx(-weight[1] / 1e5, rel=0.02)


def test_sizes_that_make_no_sense_are_refused():
    with pytest.raises(ParameterError, match='bodies.b0.edge_length.*times shell.edge_length'):
        sized((1e-3, (0.0, 0.0, 0.0), (0, 0, 0), (0, 0, 0)))
    with pytest.raises(ParameterError, match='bodies.b0.inertia'):
        sized((0.5, (0.0, 0.0, 0.0), (0, 0, 0), (0, 0, 0)), bodies__b0__inertia=1e-5)
    with pytest.raises(ParameterError, match='tractions.t.group.*body 1'):
        sized((0.5, (0.0, 0.0, 0.0), (0, 0, 0), (0, 0, 0)), tractions__t__group='all',
              tractions__t__faces='all', tractions__t__pressure=10.0)
    woven = {
        'weave.size': [3, 3, 3], 'groups.low': 'z_min', 'masses.low.group': 'low',
        'masses.low.edge_length': 0.015, 'connector.bending_stiffness': 0.02}
    with pytest.raises(ParameterError, match='masses.low.edge_length.*obstruction warn'):
        ico.Scene.from_parameters({**woven, 'connector.obstruction': 'wrap'})
    with pytest.raises(ParameterError, match='masses.low.edge_length.*contact.mode never'):
        ico.homogenise(ico.Scene.from_parameters(woven), relaxed=True)


def test_slabs_that_are_stretched_keep_the_sizes_of_their_shells():
    # Shells that are so large that those above press on them from the start.
    close = {
        'weave.size': [3, 3, 3], 'weave.connector_angle': 0.0, 'connector.stiffness': 500.0,
        'connector.bending_stiffness': 0.02, 'contact.stiffness': 2e4, 'groups.mid': 'level 1',
        'masses.mid.group': 'mid'}
    pressed = [
        ico.measure_curve(
            ico.Scene.from_parameters({**close, 'masses.mid.edge_length': edge}), 'push', [0.03],
            axis=2)[0]
        for edge in (0.02, 0.032)]
    assert pressed[0].contact_pairs == 0 and pressed[1].contact_pairs > 3
    assert pressed[1].energy > 1.2 * pressed[0].energy > 0.0
