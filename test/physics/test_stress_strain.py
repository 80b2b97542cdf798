# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Stress against strain of slabs between two held ends."""

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.statics.fabric import StaticFabric
from icofabric_sim.statics.stress_strain import cross_section
import numpy as np
import pytest

STIFF = {'connector': {'bending_stiffness': 0.02}}


def slab(size, angle=0.3, **sections):
    return make_scene(
        size, weave={'size': list(size), 'connector_angle': angle}, **sections)


@pytest.mark.parametrize('kind', ['pull', 'push', 'shear'])
def test_work_of_the_moved_end_is_the_energy_stored(kind):
    """Castigliano: the force is the derivative of the energy by the displacement."""
    scene = slab((5, 3, 3), **STIFF)
    strains = np.array([0.02, 0.0599, 0.06, 0.0601])
    points = ico.measure_curve(scene, kind, strains)
    assert all(point.verdict == 'equilibrium, stable' for point in points)
    length = np.ptp(scene.position[:, 0])
    force = points[2].stress * cross_section(scene, 0)
    slope = (points[3].energy - points[1].energy) / ((strains[3] - strains[1]) * length)
    assert force == pytest.approx(slope, rel=1e-5)
    assert points[0].stress > 0.0 and points[2].energy > points[0].energy > 0.0


def test_larger_slabs_come_closer_to_the_periodic_fabric():
    periodic = ico.homogenise(slab((3, 3, 3), **STIFF)).young_modulus(np.array([1.0, 0.0, 0.0]))
    found = [
        ico.measure_curve(slab(size, **STIFF), 'pull', [1e-4])[0].stress / 1e-4
        for size in ((7, 3, 3), (9, 5, 5), (11, 9, 9))]
    assert found[0] < found[1] < found[2] < periodic
    assert found[2] > 0.8 * periodic


def test_point_springs_let_an_orthogonal_slab_be_pushed_for_nothing():
    scene = slab((7, 3, 3))
    for kind in ('push', 'shear'):
        [point] = ico.measure_curve(scene, kind, [0.02])
        assert point.verdict == 'equilibrium, with mechanisms'
        assert abs(point.stress) < 1e-6 * 0.02 * 500.0 / scene.geometry.pitch


def test_a_crumpled_slab_rests_though_its_shells_touch_for_a_moment_only():
    """
    A turned slab of point springs, pushed by 40 %: nothing is left, where contacts come and go.
    """
    scene = make_scene(
        (6, 4, 4), weave={'kind': 'bias', 'size': [6, 4, 4], 'connector_angle': 0.3},
        contact={'mode': 'auto'})
    points = ico.measure_curve(scene, 'push', np.linspace(0.05, 0.4, 8))
    assert len(points) == 8 and points[-1].obstructed > 30
    modulus = float(np.abs(ico.homogenise(scene).stiffness).max())
    for point in points:
        assert point.verdict == 'equilibrium, with mechanisms' and point.residual < 1e-10
        assert abs(point.stress) < 1e-9 * modulus
    # Without softer contacts the search does not come to an end there.
    contacts = StaticFabric(scene).contacts
    soft = contacts.softer_stages()
    assert soft[-1] == contacts.whole and soft[0] == pytest.approx(contacts.whole / 3**6)


def test_all_axes_are_alike_and_loads_of_the_scene_are_left_out():
    scene = slab((5, 5, 5), gravity=[0.0, 0.0, -9.81], groups={'g': 'ids 1'},
                 loads={'l': {'group': 'g', 'force': [1.0, 0.0, 0.0]}}, **STIFF)
    stress = [ico.measure_curve(scene, 'pull', [0.03], axis=axis)[0].stress for axis in range(3)]
    assert stress == pytest.approx([stress[0]] * 3, rel=1e-8) and stress[0] > 0.0


def test_connectors_break_one_by_one_and_the_load_drops():
    sections = {'contact': {'mode': 'never'}}
    limit = 0.051
    scene = slab((5, 3, 3), connector={
        'bending_stiffness': 0.02, 'break_length_extension': limit}, **sections)
    strains = np.arange(0.02, 0.201, 0.02)
    points = ico.measure_curve(scene, 'pull', strains)
    whole = ico.measure_curve(slab((5, 3, 3), **STIFF, **sections), 'pull', strains)
    broken = np.array([point.broken for point in points])
    assert broken[0] == 0 and broken[-1] > 3 and (np.diff(broken) >= 0).all()
    first = int(np.argmax(broken > 0))
    assert [point.stress for point in points[:first]] == pytest.approx(
        [point.stress for point in whole[:first]], rel=1e-7)
    for point, other in zip(points[first:], whole[first:]):
        assert point.verdict.startswith('equilibrium')
        assert point.beyond_break_length == 0 and point.stress < other.stress
        # What holds is shorter than it may be; what broke is gone for good.
        assert point.snapshot.connector_length[point.snapshot.intact].max() < limit
        assert point.energy < other.energy
    stress = np.array([point.stress for point in points])
    assert stress[first:].min() < 0.9 * stress[:first].max()
    # Nothing but the unbroken ones holds the end: the mechanisms are those of what is left.
    found = ico.solve_modes(ico.Scene.from_parameters(
        slab((5, 3, 3), **sections).parameters), at=points[-1].snapshot)
    assert found.counts.connectors == scene.connector_count - broken[-1]


@pytest.mark.parametrize('broken', [False, True])
def test_forces_under_a_part_of_the_loads_and_without_what_broke(broken):
    """Minus the gradient of the energy, which the search follows."""
    scene = slab(
        (5, 3, 3), **STIFF, gravity=[1.0, 2.0, -9.0],
        charge={'per_body': 1e-6, 'dipole': [1e-7, 2e-7, -1e-7]},
        field={'electric': [1e4, 2e4, -3e4]}, groups={'g': 'ids 1 2'},
        loads={'l': {'group': 'g', 'force': [1.0, 0.0, 0.5], 'point': [0.003, 0.01, 0.0]}})
    since = np.full(scene.connector_count, np.nan)
    since[[1, 7, 20]] = 0.0
    fabric = StaticFabric(
        scene, contact=False, load_factor=0.4, broken_since=since if broken else None)
    random = np.random.default_rng(1)
    shape = scene.body_count, 3
    here, motion = (fabric.start.moved(np.hstack([
        1e-3 * random.standard_normal(shape), 0.1 * random.standard_normal(shape)])), np.hstack([
            1e-2 * random.standard_normal(shape), random.standard_normal(shape)]))
    h = 1e-5
    ahead, behind = here.moved(h * motion), here.moved(-h * motion)
    assert (ahead.energy - behind.energy) / (2.0 * h) == pytest.approx(
        -float((here.force * motion).sum()), rel=1e-7)
    change = float(((behind.force - ahead.force) * motion).sum()) / (2.0 * h)
    assert float((here.times(motion) * motion).sum()) == pytest.approx(change, rel=1e-6)
    whole = StaticFabric(scene, contact=False).start.energy
    assert abs(fabric.start.energy - whole) > 1e-3 * abs(whole)
    assert np.count_nonzero(here.tension == 0.0) == (3 if broken else 0)


@pytest.mark.parametrize('angle', [-0.3, 0.0, 0.3])
@pytest.mark.parametrize('size, kind', [
    ((3, 3, 3), 'orthogonal'), ((6, 4, 5), 'orthogonal'), ((6, 5, 5), 'bias')])
def test_all_outer_faces_meet_the_bulk_modulus_of_the_periodic_fabric(size, kind, angle):
    """
    With all faces held as in the periodic fabric, what is within rests there too.

    So every connector has the energy that the closed form of docs/material.md gives it.
    """
    for section in ({}, STIFF):
        scene = make_scene(
            size, weave={'size': list(size), 'connector_angle': angle, 'kind': kind}, **section)
        bulk = ico.homogenise(scene).bulk_modulus
        small = 1e-6
        points = ico.measure_curve(scene, 'hydrostatic', [small, 0.0499, 0.05, 0.0501])
        assert all(point.verdict.startswith('equilibrium') for point in points)
        assert points[0].stress == pytest.approx(3.0 * small * bulk, rel=1e-5)
        place = 2.0 * scene.geometry.pitch**3
        volume = scene.connector_count / 6.0 * place
        assert points[0].energy == pytest.approx(4.5 * bulk * small**2 * volume, rel=1e-4)
        # The work of the pressure is the energy stored.
        volumes = volume * (1.0 - np.array([points[1].strain, points[3].strain]))**3
        work = -points[2].stress * np.diff(volumes)[0]
        assert points[3].energy - points[1].energy == pytest.approx(work, rel=1e-4)
        assert points[2].end_force[0] < 0.0
        assert points[2].middle_strain == pytest.approx([-0.05] * 3, rel=1e-9)


def test_energy_under_pressure_is_that_of_connectors_between_scaled_places():
    """Bodies do not turn, by symmetry: so the length of a connector follows from two places."""
    scene = slab((5, 4, 4), 0.3)
    strain = 0.02
    [point] = ico.measure_curve(scene, 'hydrostatic', [strain])
    first, second = scene.connectors.bodies.T
    gap = scene.position[second] - scene.position[first]
    ends = scene.connectors.points_body
    length = np.linalg.norm((1.0 - strain) * gap + ends[:, 1] - ends[:, 0], axis=1)
    energy = 250.0 * ((length - scene.geometry.connector_length)**2).sum()
    assert energy > 0.0 and point.energy == pytest.approx(energy, rel=1e-9)


@pytest.mark.parametrize(
    'kind', ['pull', 'shear', 'hydrostatic', 'inflation', 'bend', 'twist'])
def test_connectors_of_their_own_count_in_curves(kind):
    """A group of all of them is the plain fabric; one of a part lies between the two."""
    def measure(**sections):
        scene = slab((5, 3, 3), **sections)
        [point] = (ico.measure_moment_curve if kind in ('bend', 'twist') else ico.measure_curve)(
            scene, kind, [0.05])
        return point.energy

    bending = {'bending_stiffness': 0.02}
    soft, stiff = (measure(connector={'stiffness': k, **bending}) for k in (500.0, 900.0))
    count = slab((5, 3, 3)).body_count
    # The name is that of a group of the load case itself.
    for bodies in (range(count), range(count // 2)):
        found = measure(
            connector={'stiffness': 500.0, **bending},
            groups={'moved_end': 'ids ' + ' '.join(map(str, bodies))}, connector_groups={
                'own': {'between': 'moved_end moved_end', 'stiffness_extension': 900.0,
                        'stiffness_compression': 900.0}})
        if len(bodies) == count:
            assert found == pytest.approx(stiff, rel=1e-9)
        else:
            assert soft * 1.01 < found < stiff / 1.01


@pytest.mark.parametrize('arguments, word', [
    (('pull', []), 'strains'), (('pull', [0.2, 0.1]), 'strains'), (('twist', [0.1]), 'kind'),
    (('hydrostatic', [0.5, 1.0]), 'hydrostatic'), (('inflation', [-0.1]), 'strains'),
    (('push', [0.5, 1.0]), 'push'), (('pull', [-0.1]), 'strains')])
def test_arguments_are_judged(arguments, word):
    with pytest.raises(ValueError, match=word):
        ico.measure_curve(slab((5, 3, 3)), *arguments)
    with pytest.raises(ValueError, match='does not have two ends'):
        ico.measure_curve(slab((2, 2, 1)), 'pull', [0.1], axis=2)


KINKED = {'stiffness_extension': 900.0, 'stiffness_compression': 300.0}


def springs(scene, position):
    """Energy [J] and forces (n, 3) [N] of connectors between bodies that have not turned."""
    first, second = scene.connectors.bodies.T
    axes = cosines_from_quaternions(scene.orientation)
    arms = np.einsum('cei,ceij->cej', scene.connectors.points_body, axes[scene.connectors.bodies])
    gap = position[second] - position[first] + arms[:, 1] - arms[:, 0]
    length = np.linalg.norm(gap, axis=1)
    stretch = length - scene.connectors.natural_length
    slope = np.where(stretch > 0.0, KINKED['stiffness_extension'],
                     KINKED['stiffness_compression'])
    force = np.zeros((scene.body_count, 3))
    pull = (slope * stretch / length)[:, None] * gap
    np.add.at(force, first, pull)
    np.add.at(force, second, -pull)
    return float((0.5 * slope * stretch**2).sum()), force


@pytest.mark.parametrize('kind', ['orthogonal', 'radial'])
@pytest.mark.parametrize('load, along, direction', [
    ('pull', None, [1.0, 0.0, 0.0]), ('pull', [2.0, 1.0, -2.0], [2 / 3, 1 / 3, -2 / 3]),
    ('push', None, [-1.0, 0.0, 0.0]), ('push', [2.0, 1.0, -2.0], [-2 / 3, -1 / 3, 2 / 3]),
    ('shear', None, [0.0, 1.0, 0.0]), ('shear', [0.0, -1.0, 0.0], [0.0, -1.0, 0.0]),
    ('shear', [0.0, 0.0, 7.0], [0.0, 0.0, 1.0]), ('shear', [0, -3, 4], [0.0, -0.6, 0.8])])
def test_an_end_moves_along_any_direction(kind, load, along, direction):
    """Two rows, all of whose bodies are held: the answer is a sum of springs."""
    scene = make_scene(
        (2, 4, 3), weave={'size': [2, 4, 3], 'connector_angle': 0.3, 'kind': kind},
        connector=KINKED, contact={'mode': 'never'})
    [point] = ico.measure_curve(scene, load, [0.05], along=along)
    moved = scene.weave.grid[:, 0] == 1
    places = [scene.position[chosen].mean(axis=0) for chosen in (~moved, moved)]
    shift = 0.05 * (places[1] - places[0])[0] * np.array(direction)
    energy, force = springs(scene, scene.position + moved[:, None] * shift)
    assert energy > 1e-4 and point.energy == pytest.approx(energy, rel=1e-10)
    assert point.end_force == pytest.approx(-force[moved].sum(axis=0), rel=1e-9, abs=1e-9)
    # Half of the places of a grid of pitch W are those of bodies.
    area = 4.0 * 3.0 * scene.geometry.pitch**2
    assert scene.body_count == 12
    assert point.stress * area == pytest.approx(-force[moved].sum(axis=0) @ direction, rel=1e-9)


@pytest.mark.parametrize('kind', ['orthogonal', 'radial'])
@pytest.mark.parametrize('load, sign', [('hydrostatic', -1.0), ('inflation', 1.0)])
def test_faces_move_inwards_and_outwards(kind, load, sign):
    """All bodies lack a neighbour, so places are given: k_c bears the one and k_e the other."""
    scene = make_scene(
        (3, 3, 2), weave={'size': [3, 3, 2], 'connector_angle': 0.3, 'kind': kind},
        connector=KINKED, contact={'mode': 'never'})
    strain, step = 0.03, 1e-5
    [point] = ico.measure_curve(scene, load, [strain])
    centre = 0.5 * (scene.position.min(axis=0) + scene.position.max(axis=0))

    def energy(amount):
        return springs(scene, centre + (1.0 + sign * amount) * (scene.position - centre))[0]

    assert point.energy == pytest.approx(energy(strain), rel=1e-10) and point.energy > 1e-4
    slope = (energy(strain + step) - energy(strain - step)) / (2.0 * step)
    # Places of a cylinder's level k are wider by its radius over that of the lowest one.
    level, pitch = scene.weave.grid[:, 2], scene.geometry.pitch
    wider = np.zeros(scene.body_count) if kind == 'orthogonal' else level / (4.0 / np.pi)
    volume = (2.0 * pitch**3 * (1.0 + wider))[scene.connectors.bodies].sum() / 12.0
    assert point.stress == pytest.approx(
        slope / (3.0 * (1.0 + sign * strain)**2 * volume), rel=1e-7)


def test_inflation_meets_the_stiffness_of_extension_and_pressure_that_of_compression():
    """Within larger slabs too, where bodies are free: k_e and k_c over those of one law."""
    [plain] = ico.measure_curve(slab((5, 4, 4)), 'inflation', [1e-4])
    both = [ico.measure_curve(slab((5, 4, 4), connector=KINKED), kind, [1e-4])[0].stress
            for kind in ('inflation', 'hydrostatic')]
    # Stiffness 500 N/m; stresses of either sign differ in second order of the strain.
    assert both == pytest.approx([9 / 5 * plain.stress, 3 / 5 * plain.stress], rel=1e-3)


def test_slabs_shear_differently_along_y_and_z():
    scene = slab((5, 3, 3), **STIFF)
    y, z, back, aslant = (
        ico.measure_curve(scene, 'shear', [1e-4], along=along)[0] for along in (
            [0, 1, 0], [0, 0, 1], [0, -1, 0], [0, 1, 1]))
    assert abs(y.stress / z.stress - 1.0) > 0.05 and min(y.stress, z.stress) > 0.0
    # The slab is its own image through the body in its middle.
    assert back.stress == pytest.approx(y.stress, rel=1e-6)
    # At small strains the energy is quadratic in the direction, and y and z are its axes.
    assert aslant.energy == pytest.approx(0.5 * (y.energy + z.energy), rel=1e-3)
    assert ico.measure_curve(scene, 'shear', [1e-4])[0].stress == y.stress
    assert ico.measure_cycles(scene, 'shear', [1e-4], along=[0, 0, 1])[0].points[0].stress == (
        pytest.approx(z.stress, rel=1e-9))


@pytest.mark.parametrize('kind, along, word', [
    ('hydrostatic', [1, 0, 0], 'leave it out for a hydrostatic'), ('inflation', [1, 0, 0], 'only'),
    ('pull', [0, 0, 0], 'must be a direction'), ('pull', [0, 1, 0], 'with a component along x'),
    ('push', [-1, 1, 0], 'with a component along x'),
    ('shear', [0.1, 1, 0], 'perpendicular to the axis x'),
    ('shear', [0, 1], 'along'), ('pull', [np.nan, 0, 0], 'along')])
def test_directions_are_judged(kind, along, word):
    with pytest.raises(ValueError, match=word):
        ico.measure_curve(slab((3, 3, 3)), kind, [0.1], along=along)
