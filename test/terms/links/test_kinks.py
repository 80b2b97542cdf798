# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Fabrics at rest whose connectors are at their natural length, where k_e is not k_c."""

from typing import NamedTuple

from fabrics import changed, make_scene
import icofabric_sim as ico
from icofabric_sim.statics.equilibrium import AT_KINK, MECHANISM, STABLE
from icofabric_sim.statics.fabric import Configuration, StaticFabric
from icofabric_sim.statics.kinks import anchor_changes, length_changes
from icofabric_sim.statics.periodic import solve_bands
from icofabric_sim.statics.stress_strain import cross_section
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

PULL, PUSH, BEND = 2000.0, 200.0, 0.4
STIFF = {'stiffness': PULL, 'stiffness_compression': PUSH, 'bending_stiffness': BEND}
WALL = {'groups': {'wall': 'x_min'}, 'supports': {'wall': {'group': 'wall'}}}
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
NUDGED = (0.6, 0.6 + 1e-9, 0.6 - 1e-9, 0.6000001)


def woven(size=(3, 2, 2), angle=0.6, **sections):
    return make_scene(size, **{
        'weave': {'size': list(size), 'connector_angle': angle}, 'connector': STIFF, **sections})


class Springs(NamedTuple):
    """Connectors with two stiffnesses that resist bending, written apart from the package."""

    pairs: np.ndarray  # (c, 2)
    position: np.ndarray  # (n, 3) [m] as woven
    shift: np.ndarray  # (c, 3) [m] from the second body to its image at the connector's end
    arms: np.ndarray  # (c, 2, 3) [m] as woven, world axes

    def roots(self, gradient, displacement, turn):
        """
        Half the sum of their squares is the energy [J]; `turn` (n, 3): rotations since the weave.
        """
        first, second = self.pairs.T
        rotation = Rotation.from_rotvec(turn)

        def reach_of(position, shift, arms):
            return position[second] + shift + arms[:, 1] - position[first] - arms[:, 0]

        turned = np.stack([
            rotation[first].apply(self.arms[:, 0]), rotation[second].apply(self.arms[:, 1])], 1)
        start = reach_of(self.position, self.shift, self.arms)
        reach = reach_of(
            self.position @ gradient.T + displacement, self.shift @ gradient.T, turned)
        rest, length = (np.linalg.norm(vector, axis=1) for vector in (start, reach))
        stretch = length - rest
        parts = [np.sqrt(np.where(stretch > 0.0, PULL, PUSH)) * stretch]
        for bodies in (first, second):
            normal = rotation[bodies].apply(start / rest[:, None])
            parts.append(np.sqrt(BEND) * (normal - reach / length[:, None]).ravel())
        return np.concatenate(parts)

    def least_energy(self, gradient, free, displacement, unit):
        """Energy [J] of the best displacements and rotations of the bodies that are `free`."""
        def unpacked(values):
            places, turn = displacement.copy(), np.zeros_like(displacement)
            own = unit * values.reshape(2, -1, 3)
            places[free] += 0.05 * own[0]
            turn[free] = own[1]
            return places, turn

        found = least_squares(
            lambda values: self.roots(gradient, *unpacked(values)) / unit,
            np.zeros(6 * np.count_nonzero(free)), jac='3-point', x_scale='jac', xtol=1e-14,
            ftol=1e-14, gtol=1e-14)
        assert found.success
        return found.cost * unit**2


def world_arms(scene, chosen):
    bodies, points = scene.connectors.bodies[chosen], scene.connectors.points_body[chosen]
    return np.stack([
        Rotation.from_quat(scene.orientation[bodies[:, end]]).apply(points[:, end])
        for end in (0, 1)], axis=1)


def cell_of_four():
    """
    The conventional cell of the lattice, four bodies and 24 connectors, and its volume [m^3].
    """
    piece = woven((6, 6, 6))
    kind, bodies = (piece.weave.grid & 1) @ [4, 2, 1], piece.connectors.bodies
    full = np.bincount(bodies.ravel(), minlength=len(kind)) == 12
    kinds = np.unique(kind)
    own = np.array([np.flatnonzero(full & (kind == k))[0] for k in kinds])
    chosen = np.flatnonzero(np.isin(bodies[:, 0], own))
    pairs = np.searchsorted(kinds, kind[bodies[chosen]])
    shift = piece.position[bodies[chosen, 1]] - piece.position[own[pairs[:, 1]]]
    assert len(own) == 4 and len(chosen) == 24
    springs = Springs(pairs, piece.position[own], shift, world_arms(piece, chosen))
    return springs, 4.0 * 2.0 * piece.geometry.pitch**3


def test_the_last_bit_of_a_length_decides_nothing():
    """A change of 1e-9 rad, which lengths follow to rounding, changes no result by 1e-6."""
    results = []
    for angle in NUDGED:
        scene = woven(angle=angle, **WALL)
        lengths = StaticFabric(scene).start.stretched
        constants, found = ico.homogenise(scene), ico.solve_modes(scene)
        assert constants.at_kink == 6 and len(found.at_kink) == scene.connector_count
        assert constants.branch == found.branch == 'push'
        assert np.abs(lengths.stretch).max() < 1e-14 * lengths.length.max()
        results.append([
            *(constants.branches[name].stiffness[0, 0] for name in ('pull', 'push')),
            *(found.branches[name].frequencies[0] for name in ('pull', 'push')),
            *(constants.response(sign * np.eye(6)[k]).modulus for k in (0, 3) for sign in (1, -1)),
            constants.uniaxial_response((1, 0, 0)).modulus, *found.bounds[0]])
    results = np.array(results)
    ratio = results / results[0] - 1.0
    assert np.abs(ratio[:3]).max() < 1e-6
    assert 0.0 < np.abs(ratio[3]).max() < 1e-5
    # The branches are far apart, and what is true lies between.
    pulled, pushed = results[0, :2]
    assert pulled > 8.0 * pushed and pushed < results[0, 8] < pulled
    assert results[0, 3] < results[0, 2]


@pytest.mark.parametrize('angle', [0.3, 0.6, 0.7])
@pytest.mark.parametrize('off', [0.0, 1e-9, 0.9999e-8, 1e-7, 1e-5])
def test_a_nudge_changes_nothing_or_is_reported(angle, off):
    """With a natural length of its own the weave's angle moves connectors across their kink."""
    connector = {**STIFF, 'natural_length': woven(angle=angle).geometry.connector_length}
    for sign in (1.0, -1.0):
        found = [
            ico.homogenise(woven(angle=there, connector=connector))
            for there in (angle + sign * off, angle + sign * (off + 1e-9))]
        branch = 'pull' if sign > 0.0 else 'push'
        one, other = (each.branches.get(branch, each).stiffness for each in found)
        assert np.abs(one - other).max() < 1e-6 * np.abs(one).max()
        reported = [each.at_kink for each in found]
        if off < 0.5e-8:
            assert reported == [6, 6]
        elif off < 2e-8:
            # One of them is just beyond, where the other begins to be reported.
            assert sorted(reported) == [0, 6]
        else:
            assert reported == [0, 0]
            # Back towards the kink, and away from it.
            strain = -sign * np.eye(6)[0]
            assert 0.0 < found[0].response(strain).limit < 100.0 * off
            assert found[0].response(-strain).limit == np.inf


def test_small_strains_of_one_sign_meet_what_a_larger_cell_at_finite_strain_does():
    """
    Four bodies to a cell, energies minimised by SciPy: no cell yields more than one of one body.
    """
    constants = ico.homogenise(woven())
    springs, volume = cell_of_four()
    size = 1e-6
    seen = []
    for kind, sign in (('xx', 1), ('xx', -1), ('yz', 1), ('yz', -1), ('mixed', 1)):
        strain = np.array([0.6, -0.5, 0.2, 0.3, -0.7, 0.4])
        if kind != 'mixed':
            strain = sign * np.eye(6)[('xx', 'yy', 'zz', 'yz').index(kind)]
        gradient = np.zeros((3, 3))
        for value, (i, j) in zip(strain, VOIGT):
            gradient[i, j] += 0.5 * value
            gradient[j, i] += 0.5 * value
        energy = springs.least_energy(
            np.eye(3) + size * gradient, np.ones(4, bool), np.zeros((4, 3)), size)
        response = constants.response(strain)
        expected = 2.0 * energy / (volume * size**2 * float(strain @ strain))
        assert response.modulus == pytest.approx(expected, rel=1e-5)
        # Twice the strain, twice the stress.
        assert constants.response(3.0 * strain).stress == pytest.approx(
            3.0 * response.stress, abs=1e-9 * np.abs(response.stress).max())
        seen.append(response)
    assert seen[0].modulus > 8.0 * seen[1].modulus
    # They do not superpose: a shear and its opposite leave a pull across.
    left = seen[2].stress + seen[3].stress
    assert left[1] > 0.3 * seen[2].modulus and left[2] > 0.3 * seen[2].modulus


@pytest.mark.parametrize('push', [0.0, 200.0, 5000.0])
@pytest.mark.parametrize('bending', [0.0, 0.4])
def test_pulls_lie_between_the_branches(push, bending):
    connector = {'stiffness': PULL, 'stiffness_compression': push, 'bending_stiffness': bending}
    constants = ico.homogenise(woven(connector=connector))
    random = np.random.default_rng(1)
    for direction in (*np.eye(3), *random.standard_normal((6, 3))):
        branches = sorted(
            float(constants.branches[name].young_modulus(direction)) for name in ('pull', 'push'))
        for sign in (1.0, -1.0):
            found = constants.uniaxial_response(direction, sign)
            n = direction / np.linalg.norm(direction)
            slack = 1e-9 * np.abs(constants.branches['pull'].stiffness).max()
            assert branches[0] - slack <= found.modulus <= branches[1] + slack
            # The stress is a pull along it and nothing else.
            wanted = sign * found.modulus * np.array([n[i] * n[j] for i, j in VOIGT])
            assert found.stress == pytest.approx(wanted, abs=10.0 * slack)
    for strain in random.standard_normal((6, 6)):
        least, most = sorted(
            strain @ constants.branches[name].stiffness @ strain / (strain @ strain)
            for name in ('pull', 'push'))
        modulus = constants.response(strain).modulus
        assert least * (1.0 - 1e-9) - slack <= modulus <= most * (1.0 + 1e-9) + slack


def test_one_connector_has_the_frequencies_of_both_stiffnesses():
    """Squared: k (2/M + 2 |s x n|^2 / Lambda), with k_e and with k_c."""
    scene = woven((2, 1, 2), connector={'stiffness': PULL, 'stiffness_compression': PUSH})
    found = ico.solve_modes(scene)
    shell, ends = scene.shell, StaticFabric(scene).start.snapshot.connector_ends[0]
    direction = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    lever = np.linalg.norm(np.cross(ends[0] - scene.position[0], direction))
    square = 2.0 / shell.mass + 2.0 * lever**2 / shell.inertia
    assert found.bounds == pytest.approx(np.sqrt([[PUSH * square, PULL * square]]), rel=1e-12)
    assert found.first_bounded_motion == 11 and found.amplitudes.tolist() == [0.0]
    again = ico.solve_modes(scene, branch='pull')
    assert again.frequencies == pytest.approx(found.bounds[:, 1]) and again.branch == 'pull'


@pytest.mark.parametrize('push', [0.0, 200.0, 5000.0])
@pytest.mark.parametrize('count', [None, 5])
def test_frequencies_of_mixtures_lie_between_those_of_the_branches(push, count):
    """
    Each random mixture is a fabric of plain springs, k_e between some bodies and k_c elsewhere.
    """
    connector = {'stiffness': PULL, 'stiffness_compression': push, 'bending_stiffness': 0.01}
    scene = woven((3, 3, 3), connector=connector)
    found = ico.solve_modes(scene, count=count)
    bounds, first = found.bounds, found.first_bounded_motion
    assert (bounds[:, 0] <= bounds[:, 1] * (1.0 + 1e-12)).all() and len(bounds) >= 5
    if count is None:
        assert first + len(bounds) == found.degrees_of_freedom
    random = np.random.default_rng(2)
    inside = 0
    for _ in range(4):
        some = random.choice(scene.body_count, scene.body_count // 3, replace=False)
        mixture = ico.solve_modes(woven(
            (3, 3, 3), connector={'stiffness': push, 'bending_stiffness': 0.01},
            groups={'some': 'ids ' + ' '.join(map(str, sorted(some)))},
            connector_groups={'stiff': {'between': 'some all', 'stiffness': PULL}}))
        assert not mixture.branches and mixture.bounds is None
        every = np.concatenate([np.zeros(mixture.mechanism_count), mixture.frequencies])
        part = every[first:first + len(bounds)]
        top = bounds[:, 1].max()
        assert (part >= bounds[:, 0] * (1.0 - 1e-9) - 1e-5 * top).all()
        assert (part <= bounds[:, 1] * (1.0 + 1e-9) + 1e-5 * top).all()
        inside += np.count_nonzero(
            (part > 1.001 * bounds[:, 0]) & (part < 0.999 * bounds[:, 1]))
    assert inside > 4


def test_groups_of_both_kinds_are_bounded_too():
    """Where some connectors push more than they pull neither branch is the softer one."""
    scene = woven((3, 3, 3), groups={'some': 'x_min'}, connector_groups={
        'hard': {'between': 'some all', 'stiffness_extension': 100.0,
                 'stiffness_compression': 900.0}})
    found = ico.solve_modes(scene)
    for spectrum in found.branches.values():
        every = np.concatenate([np.zeros(spectrum.mechanism_count), spectrum.frequencies])
        part = every[found.first_bounded_motion:]
        assert (part >= found.bounds[:, 0] * (1.0 - 1e-9)).all()
        assert (part <= found.bounds[:, 1] * (1.0 + 1e-9)).all()
        assert (part > 1.01 * found.bounds[:, 0]).any()
        assert (part < 0.99 * found.bounds[:, 1]).any()


def test_under_pre_stress_the_first_connector_changes_side_at_the_amplitude_that_is_told():
    scene = woven((3, 3, 3), **WALL)
    rest = scene.geometry.connector_length * (1.0 - 2e-5)
    found = ico.solve_modes(changed(scene, {'connector.natural_length': rest}))
    assert not found.branches and not len(found.at_kink) and found.branch == ''
    at = found.snapshot
    side = at.connector_length > rest
    here = found.configuration
    for number in (0, 3, len(found.frequencies) - 1):
        amplitude = found.amplitudes[number]
        assert 0.0 < amplitude < np.inf
        for part, least, most in ((0.98, 0, 0), (1.02, 1, 100)):
            changes = sum(
                np.count_nonzero((here.moved(sign * part * amplitude * found.shapes[
                    number]).snapshot.connector_length > rest) != side) for sign in (1.0, -1.0))
            assert least <= changes <= most
    # Of a fabric without two stiffnesses there is no such amplitude.
    plain = ico.solve_modes(woven(connector={'stiffness': PULL}))
    assert np.isinf(plain.amplitudes).all() and not plain.branches


def test_lengths_of_connectors_and_anchors_change_as_motions_say():
    anchors = {
        name: {'body': body, 'edge': edge, 'position': [0.05, -0.02, 0.13]}
        for name, body, edge in (('rope', 0, 'up'), ('stay', 3, 'south'))}
    scene = woven(anchors=anchors)
    here = Configuration(
        StaticFabric(scene), scene.position,
        Rotation.random(scene.body_count, random_state=2).as_quat())
    motions = np.random.default_rng(3).standard_normal((4, scene.body_count, 6))
    h = 1e-7
    for changes, stretched in (
            (length_changes, lambda at: at.stretched),
            (anchor_changes, lambda at: at.anchor_state.here)):
        ends = [[stretched(here.moved(sign * h * motion)).length for motion in motions]
                for sign in (1.0, -1.0)]
        found = changes(here, motions)
        assert found.shape[1] >= 2 and np.abs(found).min() > 1e-3
        np.testing.assert_allclose(found, np.subtract(*ends) / (2.0 * h), rtol=0, atol=1e-7)


def test_verdicts_say_where_the_kink_decides():
    stable = ico.solve_equilibrium(woven((3, 3, 3), **WALL))
    assert stable.verdict == STABLE and len(stable.at_kink) > 10
    assert stable.branches == {'pull': (0, 0), 'push': (0, 0)}
    # Strings: pulled they bear, let loose they do not.
    strings = {'stiffness': PULL, 'stiffness_compression': 0.0}
    loose = ico.solve_equilibrium(woven((3, 3, 3), connector=strings, **WALL))
    assert loose.verdict == MECHANISM
    assert loose.mechanism_count == loose.branches['pull'].zero < loose.branches['push'].zero
    body = make_scene(
        (1, 1, 1), connector=strings, groups={'it': 'all'},
        supports={'it': {'group': 'it', 'fix': 'tx ty rotation'}},
        anchors={'rope': {'body': 0, 'edge': 'down', 'position': [0.0, 0.0, -1.0]}})
    arm = Rotation.from_quat(body.orientation[0]).apply(body.anchors['rope'].arm)
    below = body.position[0] + arm - [0.0, 0.0, body.geometry.connector_length]
    anchored = changed(body, {'anchors.rope.position': below.tolist()})
    found = ico.solve_equilibrium(anchored)
    assert found.verdict == AT_KINK and found.anchors_at_kink == ('rope',)
    assert found.branches == {'pull': (0, 0), 'push': (1, 0)}
    spectrum = ico.solve_modes(anchored)
    assert spectrum.bounds == pytest.approx(np.array(
        [[0.0, np.sqrt(PULL / body.shell.mass)]]), rel=1e-12)


@pytest.mark.parametrize('kind', ['pull', 'push'])
def test_curves_are_right_from_the_first_step(kind):
    """Beside energies of the same slab that SciPy minimises, and one angle beside the next."""
    strains = [1e-6, 2e-6, 1e-3]
    curves = [
        ico.measure_curve(woven((3, 3, 2), angle=angle), kind, strains) for angle in NUDGED[:3]]
    scene = woven((3, 3, 2))
    along = scene.position[:, 0]
    length, width = np.ptp(along), scene.geometry.pitch
    springs = Springs(
        scene.connectors.bodies, scene.position, np.zeros((scene.connector_count, 3)),
        world_arms(scene, np.arange(scene.connector_count)))
    free = (along > along.min() + 0.1 * width) & (along < along.max() - 0.1 * width)
    volume = cross_section(scene, 0) * length
    sign = 1.0 if kind == 'pull' else -1.0
    for number, strain in enumerate(strains):
        def energy(part, strain=strain):
            moved = np.zeros_like(scene.position)
            moved[along > along.max() - 0.1 * width, 0] = sign * part * strain * length
            return springs.least_energy(np.eye(3), free, moved, strain)

        # Castigliano, by a central difference.
        wanted = (energy(1.01) - energy(0.99)) / (0.02 * strain * volume)
        found = [curve[number].stress for curve in curves]
        assert found[0] == pytest.approx(wanted, rel=1e-4 if number < 2 else 1e-3)
        assert found[1:] == pytest.approx([found[0]] * 2, rel=1e-6)
        assert curves[0][number].verdict == STABLE
    pulls = [point.stress / point.strain for point in curves[0]]
    assert pulls[1] == pytest.approx(pulls[0], rel=1e-5) and free.any()


def test_slack_connectors_do_not_end_a_search_that_moments_have_not():
    """Pushed strings bear nothing; what bends is in equilibrium all the same, at less energy."""
    strings = {'stiffness': PULL, 'stiffness_compression': 0.0, 'bending_stiffness': 0.02}
    scene = woven((3, 3, 2), 0.177, connector=strings)
    for nudge in (0.0, 1e-5):
        rest = scene.geometry.connector_length * (1.0 + nudge)
        [point] = ico.measure_curve(
            changed(scene, {'connector.natural_length': rest}), 'push', [1e-4])
        found = StaticFabric(scene).configuration('at', point.snapshot)
        along = scene.position[:, 0]
        free = (along > along.min() + 1e-3) & (along < along.max() - 1e-3)
        assert point.verdict.startswith('equilibrium') and point.residual < 1e-6
        held = np.abs(found.force[~free, :3]).max()
        assert np.abs(found.force[free, :3]).max() < 1e-5 * held and held > 0.0


@pytest.mark.parametrize('size, angle, push, gravity, most', [
    ((2, 4, 2), 0.584, 662.0, (-0.60, -2.1, -1.04), 1000),
    ((4, 3, 2), 0.548, 0.0, (-77.6, -44.5, -17.9), 400)])
def test_connectors_that_change_side_do_not_hold_up_a_search(size, angle, push, gravity, most):
    """Point springs under weight have far to go: by the tangent alone 2,000 steps do not do."""
    connector = {'stiffness': 66200.0 if push else 17000.0, 'stiffness_compression': push}
    found = ico.solve_equilibrium(make_scene(
        size, weave={'size': list(size), 'connector_angle': angle, 'variant': 0 if push else 1},
        shell={'edge_length': 0.0272 if push else 0.0181,
               'thickness': 0.00272 if push else 0.00181}, connector=connector,
        gravity=list(gravity), groups={'wall': 'z_max'}, supports={'wall': {'group': 'wall'}}),
        largest_step_count=most)
    assert found.converged and found.step_count > 20


@pytest.mark.parametrize('kind', ['pull', 'push', 'shear'])
def test_curves_say_where_the_distance_from_the_kink_decides(kind):
    """With D given a change of angle strains the slab as woven."""
    length, reported, worst = woven().geometry.connector_length, set(), 0.0
    for off in (0.0, -1e-9, 1e-7, -1e-5, 1e-3):
        curves = [
            ico.measure_curve(woven(
                (3, 2, 2), angle=angle, connector={**STIFF, 'natural_length': length}),
                kind, [1e-5, 1e-3])
            for angle in (0.6 + off, 0.6 + off + 1e-9)]
        for one, other in zip(*curves):
            change = abs(
                (other.stress - other.rest_stress) / (one.stress - one.rest_stress) - 1.0)
            reported.add(one.past_kink > 0)
            worst = max(worst, change)
            assert change < 1e-6 or min(one.past_kink, other.past_kink) > 0
            if abs(off) > 1e-8 and kind != 'shear':
                # A larger angle is a longer woven length: connectors pull.
                assert one.rest_stress * off * (1.0 if kind == 'pull' else -1.0) > 0.0
    assert reported == {False, True} and worst > 1e-5


def test_results_near_flat_connectors_follow_the_geometry_not_the_kink():
    """At 0.78 rad lengths grow by 185 parts for each radian: plain fabrics change as much."""
    constants = [
        [ico.homogenise(woven(angle=angle, connector={**STIFF, **law}))
         for angle in (0.78, 0.78 + 1e-9)]
        for law in ({}, {'stiffness_compression': PULL})]
    kinked, plain = (
        np.array([one.young_modulus((1, 1, 0)) for one in pair]) if not pair[0].branches else
        np.array([one.uniaxial_response((1, 1, 0)).modulus for one in pair]) for pair in constants)
    change, expected = (abs(pair[1] / pair[0] - 1.0) for pair in (kinked, plain))
    assert change == pytest.approx(expected, rel=0.2) and 1e-8 < change < 1e-6


def test_pulling_and_pushing_a_slab_differ_from_the_first_step():
    pull, push = (
        ico.measure_curve(woven((3, 3, 2)), kind, [1e-6])[0].stress for kind in ('pull', 'push'))
    assert pull > 2.0 * push > 0.0


def test_a_law_that_is_flat_everywhere_adds_no_stiffness_of_its_own(tmp_path):
    """
    Connectors of one tension at any length: what resists is the tension over the length alone.
    """
    (tmp_path / 'flat.csv').write_text('0.01, 2e-3\n1.0, 2e-3\n')
    scene = woven((3, 2, 2), connector={'law': str(tmp_path / 'flat.csv')}, **WALL)
    here = StaticFabric(scene).start
    assert here.tension == pytest.approx(np.full(scene.connector_count, 2e-3), rel=1e-12)
    random = np.random.default_rng(3)
    motion = np.where(
        here.fabric.free, 0.01 * random.standard_normal(here.fabric.free.shape), 0.0)
    motion = np.where(np.arange(6) < 3, motion, 0.0)
    h = 1e-5
    change = (here.moved(-h * motion).force - here.moved(h * motion).force) / (2.0 * h)
    assert here.times(motion)[:, :3] == pytest.approx(
        change[:, :3], abs=1e-6 * np.abs(change).max())


def test_waves_at_the_kink_need_a_branch():
    scene = woven()
    wave = np.array([[30.0, 10.0, 0.0]])
    with pytest.raises(ValueError, match="branch='pull'"):
        solve_bands(scene, wave)
    pull, push = (solve_bands(scene, wave, branch=name) for name in ('pull', 'push'))
    assert (pull > push).all()
    plain = woven(connector={'stiffness': PULL, 'bending_stiffness': BEND})
    assert pull == pytest.approx(solve_bands(plain, wave), rel=1e-9)
    for call in (ico.homogenise, ico.solve_modes):
        with pytest.raises(ValueError, match='branch'):
            call(scene, branch='both')


def test_contacts_resist_alike_however_little_they_overlap():
    """
    A shell on its floor: the stiffness is that of the contact, also where the overlap is tiny.
    """
    def resting(stiffness, **sections):
        return make_scene(
            (1, 1, 1), groups={'it': 'all'},
            supports={'it': {'group': 'it', 'fix': 'tx ty rotation'}},
            contact={'mode': 'always', 'stiffness': stiffness},
            planes={'floor': {'normal': [0.0, 0.0, 1.0], 'offset': -0.03}}, **sections)

    at = ico.solve_equilibrium(resting(1e6, gravity=[0.0, 0.0, -9.81]))
    touch = at.snapshot.position[0, 2] + at.contact_state.depth
    ratios = []
    for part in (1.0, 1e-2, 1e-4):
        depth = part * at.contact_state.depth
        scene = resting(1e6, initial={'up': {
            'group': 'it', 'displacement': [0.0, 0.0, touch - depth]}})
        found = ico.solve_modes(scene)
        assert found.first_touches == 0
        assert found.configuration.contact_state.depth == pytest.approx(depth, rel=1e-4)
        ratios.append(found.frequencies[0]**2 * scene.shell.mass / 1e6)
    assert depth < 1e-8 * scene.geometry.half_edge
    assert ratios == pytest.approx([ratios[0]] * 3, rel=1e-3)
    # A little higher it just touches, on either side of the last bit: reported, and open.
    for off in (-1e-12, 0.0, 1e-12):
        initial = {'up': {'group': 'it', 'displacement': [0.0, 0.0, touch + off]}}
        found = ico.solve_modes(resting(1e6, initial=initial))
        assert found.first_touches == 1 and not len(found.frequencies)
