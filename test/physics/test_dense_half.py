# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Fabrics from the least connector angle, where shells lie face to face, to long connectors.

What holds on both sides of level connectors, and at the limit itself (eq 54).
"""

from itertools import product

from fabrics import make_scene, snapshot_of
import icofabric_sim as ico
from icofabric_sim.commands.equilibrium_outputs import EquilibriumOutputs
from icofabric_sim.scene.shell_gaps import pair_gaps, smallest_gap
from icofabric_sim.scene.weave_geometry import MINIMUM_ANGLE
from icofabric_sim.simulation.contact.setup import ContactSetup
from icofabric_sim.statics.contacts import StaticContacts
from icofabric_sim.statics.periodic import band_path, solve_bands
from matplotlib.image import imread
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

ANGLES = (MINIMUM_ANGLE, -0.3, -0.1, 0.1, 0.7)
WEAVES = {
    **{f'variant {variant}': {'variant': variant} for variant in range(4)},
    'bias': {'kind': 'bias', 'azimuth': 0.3},
    'bias, whole': {'kind': 'bias', 'boundary': 'fabric', 'variant': 1},
    'sphere': {'region': 'sphere 1.0', 'size': [6, 6, 6]},
    'radial': {'kind': 'radial', 'size': [5, 2, 3]}}


def woven(angle, weave='variant 0', **sections):
    """A small fabric with contact; spheres and radii follow the pitch."""
    choices = {'size': [3, 3, 3], 'connector_angle': float(angle), **WEAVES[weave]}
    sections.setdefault('contact', {'mode': 'auto'})
    if weave in ('sphere', 'radial'):
        pitch = make_scene(weave={'size': [3, 3, 3], 'connector_angle': float(angle)}
                           ).geometry.pitch
        choices |= {'region': f'sphere {2.3 * pitch!r}'} if weave == 'sphere' else {
            'radius': 20.0 * pitch}
    return make_scene(weave=choices, **sections)


@pytest.mark.parametrize('weave', WEAVES)
@pytest.mark.parametrize('angle', ANGLES)
def test_rest_and_modes_of_all_weaves(angle, weave):
    """With contact: touching shells at rest do not press, and bear no motion that parts them."""
    scene = woven(angle, weave)
    rest, spectrum = ico.solve_equilibrium(scene), ico.solve_modes(scene)
    mechanisms = 6 * scene.body_count - scene.connector_count
    assert scene.body_count > 10 and scene.connector_count > 20
    assert rest.verdict == 'equilibrium, with mechanisms'
    assert spectrum.counts == (
        6 * scene.body_count, scene.connector_count, scene.connector_count)
    if angle == MINIMUM_ANGLE and weave == 'radial':
        # Bent around an axis, its inner shells press.
        return
    assert rest.mechanism_count == spectrum.mechanism_count == mechanisms
    assert len(spectrum.frequencies) == scene.connector_count
    touches = scene.connector_count if angle == MINIMUM_ANGLE else 0
    assert rest.first_touches == spectrum.first_touches == touches
    # Connectors lead along faces at the limit, and not into them.
    assert not snapshot_of(scene, scene.position, scene.orientation).obstructed.any()
    assert np.abs(rest.snapshot.position - scene.position).max() < 1e-9 * scene.shell.half_edge


@pytest.mark.parametrize('weave', ['variant 0', 'variant 3', 'bias'])
def test_all_neighbours_touch_at_the_least_angle_and_part_beyond_it(weave):
    gaps = []
    for angle in ANGLES:
        scene = woven(angle, weave)
        a = scene.shell.half_edge
        gap = pair_gaps(a, scene.position, scene.orientation, scene.connectors.bodies) / a
        assert np.ptp(gap) < 1e-12
        least, _ = smallest_gap(a, scene.position, scene.orientation)
        assert least / a == pytest.approx(gap[0], abs=1e-12)
        gaps.append(float(gap[0]))
    assert gaps[0] == pytest.approx(0.0, abs=1e-12)
    assert (np.diff(gaps) > 0.05).all()


@pytest.mark.parametrize('angle', ANGLES)
def test_waves_do_not_depend_on_how_a_fabric_is_turned(angle):
    bands = [solve_bands(scene, band_path(scene, 3)[0]) for scene in (
        woven(angle), woven(angle, 'variant 3'), woven(angle, 'bias'))]
    assert bands[0].max() > 100.0 and (bands[0] >= 0.0).all()
    for other in bands[1:]:
        assert np.allclose(other, bands[0], atol=1e-5 * bands[0].max())


@pytest.mark.parametrize('angle', [MINIMUM_ANGLE, -0.34, 0.3])
def test_motion_with_contact_keeps_energy_and_momenta(angle):
    scene = woven(angle, initial_random={'velocity_sigma': 0.05, 'seed': 2})
    simulation = ico.compile_scene(scene)
    start = simulation.snapshot()
    assert simulation.status.obstructed_ends == 0 == start.obstructed.sum()
    simulation.advance_to(0.03)
    end = simulation.snapshot()
    assert simulation.balance.worst < 1e-5
    momenta = [s.linear_velocity.sum(axis=0) for s in (start, end)]
    assert np.allclose(*momenta, atol=1e-12)
    deepest = simulation.status.deepest_overlap / scene.shell.half_edge
    assert (1e-6 < deepest < 0.01) if angle < 0.0 else deepest == 0.0
    assert np.abs(end.position - start.position).max() > 0.02 * scene.shell.half_edge


@pytest.mark.parametrize('angle', [MINIMUM_ANGLE, 0.7])
@pytest.mark.parametrize('weave', ['variant 0', 'bias', 'radial'])
def test_pictures_show_shells(angle, weave, tmp_path):
    scene = woven(angle, weave)
    EquilibriumOutputs(None, tmp_path / 'p.png').draw(
        'fabric', scene, [(scene.position, scene.orientation, 'as woven')])
    seen = imread(tmp_path / 'p.png')[:, :, :3]
    assert ((seen < 0.92).any(axis=2)).mean() > 0.02


def test_the_limits_themselves_are_woven():
    for angle in (MINIMUM_ANGLE, np.nextafter(np.pi / 4.0, 0.0)):
        scene = woven(angle)
        ends = scene.connectors.bodies
        between = scene.position[ends[:, 1]] - scene.position[ends[:, 0]]
        assert np.linalg.norm(between, axis=1) == pytest.approx(
            np.full(len(ends), np.sqrt(2.0) * scene.geometry.pitch), rel=1e-12)
        assert np.isfinite(scene.position).all()


@pytest.mark.parametrize('size, ratio, pairs', [((5, 5, 5), 200.0, 100), ((4, 4, 4), 2000.0, 40)])
def test_shells_face_to_face_rest_as_woven_however_stiff_contacts_are(size, ratio, pairs):
    scene = make_scene(size, {
        'weave.connector_angle': MINIMUM_ANGLE, 'contact.mode': 'always',
        'connector.stiffness': 500.0, 'contact.stiffness': 500.0 * ratio})
    rest = ico.solve_equilibrium(scene)
    assert rest.converged and rest.residual == 0.0
    # Rounding of places times the stiffness of contacts is all that acts.
    assert np.abs(rest.unbalanced_wrench[:, :3]).max() < 1e-15 * ratio * 500.0
    assert np.abs(rest.snapshot.position - scene.initial.position).max() < 1e-12
    tight = ico.solve_equilibrium(scene.with_changes({
        'connector.natural_length': 0.99 * scene.geometry.connector_length}))
    assert tight.converged and len(tight.contact_state.pairs) > pairs and tight.residual > 0.0


@pytest.mark.parametrize('ratio, pairs, mechanisms', [
    (1.05, 0, 48), (0.99, 12, 30), (0.9, 12, 30)])
def test_pre_tension_presses_faces_and_takes_mechanisms_away(ratio, pairs, mechanisms):
    """The table of docs/material.md: D over L at the smallest angle."""
    scene = woven(MINIMUM_ANGLE)
    tense = woven(MINIMUM_ANGLE, connector={
        'natural_length': ratio * scene.geometry.connector_length})
    rest = ico.solve_equilibrium(tense)
    assert rest.converged and rest.verdict == 'equilibrium, with mechanisms'
    assert rest.mechanism_count == mechanisms and len(rest.contact_state.pairs) == pairs
    assert rest.contact_state.depth < 0.005 * scene.shell.half_edge
    assert (np.abs(rest.tension).max() > 1e-3) == (pairs > 0)


@pytest.mark.parametrize('size, ratio, angle', [([5, 5, 4], 0.88, -0.3), ([3, 6, 6], 0.92, -0.2)])
def test_what_goes_slack_is_said_to_soon(size, ratio, angle):
    woven = ico.Scene.from_parameters(
        {'weave': {'size': size, 'connector_angle': angle}, 'contact': {'mode': 'always'}})
    tight = woven.with_changes(
        {'connector.natural_length': ratio * woven.geometry.connector_length})
    found = ico.solve_equilibrium(tight)
    assert found.step_count < 1200
    if found.converged:
        # It has come to where nothing bears anything.
        assert found.verdict == 'equilibrium, with mechanisms' and found.mechanism_count > 100
    else:
        assert found.reason.startswith('the fabric goes slack: the forces have dropped')
    # Connectors have come to their natural length.
    assert np.abs(found.tension).max() < 1e-6 * tight.parameters['connector.stiffness'] * (
        woven.geometry.connector_length)
    # Under a load, however small, it is the load that has to be borne.
    loaded = tight.with_changes({
        'groups.low': 'z_min', 'groups.high': 'z_max', 'supports.low.group': 'low',
        'supports.low.fix': 'all', 'loads.high.group': 'high', 'loads.high.force': [0., 0., 1e-9]})
    slack = ico.solve_equilibrium(loaded, largest_step_count=300)
    assert not slack.reason.startswith('the fabric goes')


@pytest.mark.parametrize('length, variant, size, pairs', [
    # At 0.88 this slab has an equilibrium without contact, too: round-off decides between them.
    (0.88, 2, [4, 5, 6], 0), (0.84, 2, [4, 5, 6], 140),
    pytest.param(0.88, 0, [6, 6, 6], 100, marks=pytest.mark.long),
    pytest.param(0.88, 2, [6, 6, 6], 100, marks=pytest.mark.long)])
def test_dense_slabs_whose_faces_meet_and_part_rest(length, variant, size, pairs):
    """Steps that know which shells will meet or part end where others go to and fro for ever."""
    woven = ico.Scene.from_parameters({
        'weave': {'size': size, 'variant': variant, 'connector_angle': -0.3}})
    tense = woven.with_changes({
        'connector.natural_length': length * woven.geometry.connector_length})
    rest = ico.solve_equilibrium(tense)
    assert rest.converged and rest.residual < 1e-9 and rest.unstable_count == 0
    assert len(rest.contact_state.pairs) > pairs
    assert not pairs or np.abs(rest.tension).max() > 1e-3
    # By forces that are found anew, in motion: nothing moves from there.
    simulation = ico.compile_scene(tense.with_changes({
        'contact.stiffness': rest.contact_state.stiffness}))
    simulation.set_state(position=rest.snapshot.position, orientation=rest.snapshot.orientation)
    simulation.advance_to(1e-3)
    moved = np.abs(simulation.snapshot().position - rest.snapshot.position).max()
    assert moved < 1e-8 * woven.shell.half_edge


@pytest.mark.long
def test_a_bias_slab_of_point_springs_rests_however_far_it_is_pulled():
    scene = ico.Scene.from_parameters({
        'weave': {'kind': 'bias', 'size': [9, 5, 5], 'connector_angle': 0.3}})
    strains = [1e-4, *np.arange(0.025, 0.226, 0.025)]
    curve = ico.measure_curve(scene, 'pull', strains)
    assert [point.strain for point in curve] == pytest.approx(strains)
    assert {point.verdict for point in curve} == {'equilibrium, with mechanisms'}
    stress = np.array([point.stress for point in curve])
    # Nothing bears up to 12.5 %; then shells that touch, and connectors that are stretched.
    assert np.abs(stress[:6]).max() < 1e-6 and (np.diff(stress[5:]) > 10.0).all()
    assert curve[6].contact_pairs > 0


def test_depths_of_shells_that_are_close_lead_to_where_they_touch():
    """Signed depths and first derivatives, of open ones too, beside depths a little farther on."""
    half_edge, generator, kinds = 0.05, np.random.default_rng(11), set()
    plane = np.array([[0.0, 0.6, 0.8, -0.1]])
    contacts = StaticContacts(ContactSetup(
        half_edge, 1e4, 0.0, 0.0, plane, ('wall',), True, False, np.zeros(3), ''), 2)
    for _ in range(300):
        axes = Rotation.random(2, random_state=generator).as_matrix()
        way = generator.normal(size=3)
        way *= generator.uniform(3.0, 3.7) * half_edge / np.linalg.norm(way)
        position = np.array([-0.5, 0.5])[:, None] * way
        position += (generator.uniform(1.2, 4.0) * half_edge - 0.1) * plane[0, :3]
        for pair, depth, slopes, touching in zip(*(
                np.moveaxis(part, 1, 0) if part.ndim == 3 else part
                for part in contacts.close(position, axes, 0.02 * half_edge))):
            is_plane = pair[0] == pair[1]
            # To where they overlap by a little, as the derivatives say.
            slope = float(np.linalg.norm(slopes[0, :3]))
            ahead = (1e-5 * half_edge - depth) / slope
            there = position.copy()
            there[pair[0]] += ahead * slopes[0, :3] / slope
            found = contacts.close(there, axes, 1e-9 * half_edge)
            same = [
                float(value) for other, value in zip(found[0], found[1])
                if other.tolist() == pair.tolist()]
            kinds.add((is_plane, bool(touching)))
            assert (depth > 0.0) == touching
            if abs(depth) < 1e-3 * half_edge:
                assert len(same) == 1 and same[0] == pytest.approx(
                    1e-5 * half_edge, rel=0.2), (is_plane, touching, depth)
    assert len(kinds) == 4


def test_second_derivatives_of_contacts_are_those_of_both_bodies():
    """Those of the second follow from the first: beside differences of what pushes both."""
    half_edge = 0.05
    contacts = StaticContacts(ContactSetup(
        half_edge, 1e4, 0.0, 0.0, np.zeros((0, 4)), (), True, True, np.zeros(3), ''), 2)
    generator, seen, step = np.random.default_rng(5), 0, 1e-6
    for _ in range(60):
        axes = Rotation.random(2, random_state=generator).as_matrix()
        way = generator.normal(size=3)
        way *= generator.uniform(1.55, 1.85) * half_edge / np.linalg.norm(way)
        position = np.array([-0.5, 0.5])[:, None] * way + [0.3, -0.2, 0.1]
        found = contacts.act(position, axes)
        if not found.depth > 1e-4 * half_edge:
            continue
        (pair,), (block,) = contacts.blocks(found, position, axes)
        columns = []
        for body, kind, k in product(pair, (0, 1), range(3)):
            sides = []
            for sign in (step, -step):
                places, turns = position.copy(), axes.copy()
                if kind == 0:
                    places[body, k] += sign * half_edge
                else:
                    rotation = Rotation.from_rotvec(sign * np.eye(3)[k]).as_matrix()
                    turns[body] = turns[body] @ rotation.T
                sides.append(contacts.act(places, turns).wrench[pair].ravel())
            columns.append((sides[1] - sides[0]) / (2.0 * step * (half_edge, 1.0)[kind]))
        expected = np.array(columns).T
        expected = 0.5 * (expected + expected.T)
        # Where an edge of a face begins or ceases to meet the other there is a kink.
        if np.abs(block - expected).max() < 1e-5 * np.abs(expected).max():
            seen += 1
        else:
            assert np.abs(block - expected).max() < 0.05 * np.abs(expected).max()
    assert seen > 20
