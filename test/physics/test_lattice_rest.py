# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Rest of the periodic fabric under pre-stress and with contact, and what it is like about it."""

from itertools import combinations_with_replacement
import json

from fabrics import changed, make_scene
import icofabric_sim as ico
from icofabric_sim.commands.main import main
from icofabric_sim.geometry.rotations import cosines_from_quaternions, rotate_quaternions
from icofabric_sim.simulation.contact.pair_forces import PAIRS
from icofabric_sim.simulation.contact.setup import pack_contact
from icofabric_sim.statics.contacts import StaticContacts
from icofabric_sim.statics.lattice import VOIGT
from icofabric_sim.statics.periodic import make_cell, sample_zone
import numpy as np
import pytest

K = 500.0  # of connectors [N/m]
# Face to face, by a little.
LEAST = -0.3648


def fabric(angle, part, contact=None, **changes):
    """A weave whose connectors are `part` times as long as woven; stiffness of contacts over K."""
    woven = make_scene((5, 5, 5), {'weave.connector_angle': angle}).connectors.woven_length
    values = {
        'weave.connector_angle': angle, 'connector.stiffness': K,
        'connector.natural_length': part * float(np.max(woven)),
        'contact.mode': 'never' if contact is None else 'always', **{
            name.replace('__', '.'): value for name, value in changes.items()}}
    if contact is not None:
        values['contact.stiffness'] = contact * K
    return make_scene((5, 5, 5), values)


@pytest.mark.parametrize('kind', ['orthogonal', 'bias'])
@pytest.mark.parametrize('angle, part', [(0.4, 0.95), (0.0, 1.05), (-0.2, 0.97)])
def test_point_springs_rest_as_a_weave_of_their_natural_length(kind, angle, part):
    scene = fabric(angle, part, weave__kind=kind)
    length = scene.parameters['connector.natural_length']
    woven = changed(scene, {
        'weave.connector_angle': 0.0, 'weave.connector_length': length,
        'connector.natural_length': 0.0})
    found, expected = ico.homogenise(scene, relaxed=True), ico.homogenise(woven)
    size = np.abs(expected.stiffness).max()
    assert np.abs(found.stiffness - expected.stiffness).max() < 1e-9 * size
    assert np.abs(found.stress).max() < 1e-8 * size
    assert found.density == pytest.approx(expected.density, rel=1e-9)
    ratio = float(woven.geometry.pitch / scene.geometry.pitch)
    assert abs(ratio - 1.0) > 0.01
    assert found.relaxed_state.gradient == pytest.approx(ratio * np.eye(3), abs=1e-9)
    assert found.relaxed_state.verdict == 'with zero-energy strains'
    assert not len(found.relaxed_state.contact_vectors)
    waves = sample_zone(scene, 2)
    # Wave vectors are those of the lattice as woven.
    assert ico.solve_bands(scene, waves, relaxed=True) == pytest.approx(
        ico.solve_bands(woven, waves / ratio), rel=1e-6, abs=1e-3)


def cell_energy(scene, gradient, vector):
    """Energy [J] of a cell: six springs and the pushes on half of the neighbours, one by one."""
    cell = make_cell(scene)
    piece, body = cell.scene, cell.body
    place = (piece.position - piece.position[body]) @ gradient.T
    turned = rotate_quaternions(np.tile(vector, (piece.body_count, 1)), piece.orientation.copy())
    axes = cosines_from_quaternions(turned)
    ahead = (piece.position - piece.position[body]) @ [1.0, np.pi, np.e**3] > 0.0
    energy, rest = 0.0, float(scene.parameters['connector.natural_length'])
    for (one, two), points in zip(piece.connectors.bodies, piece.connectors.points_body):
        other = two if one == body else one
        if body in (one, two) and ahead[other]:
            ends = [place[b] + points[k] @ axes[b] for k, b in enumerate((one, two))]
            energy += 0.5 * K * (np.linalg.norm(ends[1] - ends[0]) - rest) ** 2
    setup = pack_contact(
        scene.with_changes({'weave.size': [5, 5, 5]}), np.zeros(3), moving=False)
    contacts = StaticContacts(setup, piece.body_count)
    pairs = np.column_stack([np.full(int(ahead.sum()), body), np.flatnonzero(ahead)])
    _, pushes, _, _ = contacts._forces.wrenches(place[pairs], axes[pairs], PAIRS)
    return energy + float(pushes.sum())


def slip_energy(scene, rest, gradient, vector):
    """
    Energy [J] of the springs of friction of a cell, by the slips since `rest`.

    Two shells are alike about the middle between their centres, which therefore is where they
    meet.
    """
    cell = make_cell(scene)
    piece, body = cell.scene, cell.body
    lattice = piece.position - piece.position[body]
    others = np.flatnonzero(lattice @ [1.0, np.pi, np.e**3] > 0.0)
    setup = pack_contact(
        scene.with_changes({'weave.size': [5, 5, 5]}), np.zeros(3), moving=False)
    contacts = StaticContacts(setup, piece.body_count)
    contacts.restrict(np.column_stack([np.full(len(others), body), others]))
    axes = cosines_from_quaternions(piece.orientation)
    met = contacts.contact_points(lattice @ rest.gradient.T, axes)
    stiffness, energy = 2.0 / 7.0 * setup.stiffness, 0.0
    for (_, other), normal, radius, push in zip(met.pairs, met.normal, met.radius, met.push):
        assert push > 0.0
        middle = 0.5 * rest.gradient @ lattice[other]
        turned = rotate_quaternions(vector[None], np.array([[0.0, 0.0, 0.0, 1.0]]))
        turn = cosines_from_quaternions(turned)[0].T
        # Both bodies turn alike, so nothing turns about the normal.
        own, next_ = turn @ middle, gradient @ lattice[other] - turn @ middle
        slip = own - next_
        slip -= (slip @ normal) * normal
        energy += 0.5 * stiffness * slip @ slip
        assert radius > 0.0
    return energy


@pytest.mark.parametrize('angle, part, contact, friction', [
    (LEAST, 0.97, 20.0, 0.0), (LEAST, 0.9, 200.0, 0.0), (-0.3, 0.9, 200.0, 0.0),
    (LEAST, 0.9, 200.0, 0.3)])
def test_faces_that_press_make_the_least_energy_and_its_curvature(
        angle, part, contact, friction):
    scene = fabric(angle, part, contact, contact__friction=friction)
    found = ico.homogenise(scene, relaxed=True)
    rest = found.relaxed_state
    # Each of the twelve neighbours, of which six belong to the cell.
    assert rest.verdict == 'stable' and len(rest.contact_vectors) == 6
    assert 0.0 < rest.overlap < 0.01 * scene.geometry.half_edge and rest.first_touches == 0
    assert np.abs(found.stress).max() < 1e-6 * np.abs(found.stiffness).max()
    vector = 2.0 * rest.turn[:3]
    assert np.linalg.norm(vector) < 1e-9

    def energy(y):
        strain = np.zeros((3, 3))
        for value, (i, j) in zip(y, VOIGT):
            strain[i, j] += 0.5 * value
            strain[j, i] += 0.5 * value
        gradient, turn = (np.eye(3) + strain) @ rest.gradient, vector + y[6:]
        rubbed = slip_energy(scene, rest, gradient, turn) if friction else 0.0
        return cell_energy(scene, gradient, turn) + rubbed

    h, base, unit = 1e-5, energy(np.zeros(9)), np.eye(9)
    second = np.zeros((9, 9))
    for a, b in combinations_with_replacement(range(9), 2):
        second[a, b] = second[b, a] = (
            energy(h * (unit[a] + unit[b])) - energy(h * (unit[a] - unit[b]))
            - energy(h * (unit[b] - unit[a])) + energy(-h * (unit[a] + unit[b]))) / (4.0 * h * h)
    for a in range(9):
        # It is the least of all near it.
        assert min(energy(1e-4 * unit[a]), energy(-1e-4 * unit[a])) > base
    strain, mixed, turn = second[:6, :6], second[:6, 6:], second[6:, 6:]
    volume = 2.0 * float(scene.geometry.pitch) ** 3 * np.linalg.det(rest.gradient)
    expected = (strain - mixed @ np.linalg.inv(turn) @ mixed.T) / volume
    if friction:
        smooth = ico.homogenise(changed(scene, {'contact.friction': 0.0}), relaxed=True)
        assert found.relaxed_state.gradient == pytest.approx(
            smooth.relaxed_state.gradient, abs=1e-12)
        assert found.stiffness[3, 3] > 1.2 * smooth.stiffness[3, 3]
    assert found.stiffness == pytest.approx(expected, abs=2e-3 * np.abs(expected).max() / contact)


@pytest.mark.parametrize('friction', [0.0, 0.4])
def test_long_waves_run_as_the_constants_say(friction):
    """Two ways to the same: blocks between bodies, and the energy of a cell."""
    scene = fabric(LEAST, 0.97, 200.0, contact__friction=friction)
    found = ico.homogenise(scene, relaxed=True)
    number = {pair: k for k, pair in enumerate(VOIGT)} | {
        (j, i): k for k, (i, j) in enumerate(VOIGT)}
    tensor = np.array([[[[
        found.stiffness[number[i, j], number[m, n]] for n in range(3)] for m in range(3)]
        for j in range(3)] for i in range(3)])
    for direction in np.random.default_rng(1).standard_normal((4, 3)):
        n = direction / np.linalg.norm(direction)
        speeds = np.sqrt(np.linalg.eigvalsh(
            np.einsum('ijmn,j,n->im', tensor, n, n) / found.density))
        wave = found.relaxed_state.gradient.T @ (0.1 * n)
        frequencies = ico.solve_bands(scene, wave[None], relaxed=True)[0, :3]
        assert frequencies / 0.1 == pytest.approx(speeds, rel=1e-5)


def test_contact_makes_a_structure_of_the_densest_weave():
    """Point springs alone resist no shear; with faces that press all waves cost energy."""
    alone = ico.homogenise(fabric(LEAST, 1.0), relaxed=True)
    pressed = fabric(LEAST, 0.97, 200.0)
    found = ico.homogenise(pressed, relaxed=True)
    unit = K / float(pressed.geometry.pitch)
    assert abs(alone.stiffness[3, 3]) < 1e-9 * unit and len(alone.zero_energy_strains) == 3
    assert 2.5 * unit < found.stiffness[3, 3] < 3.5 * unit and not len(found.zero_energy_strains)
    assert ico.solve_bands(pressed, sample_zone(pressed, 3), relaxed=True).min() > 100.0
    # As woven, or without contact, nothing of that shows.
    for other in (ico.homogenise(pressed), ico.homogenise(
            changed(pressed, {'contact.mode': 'never'}), relaxed=True)):
        assert abs(other.stiffness[3, 3]) < 0.1 * unit


def test_it_is_refused_where_there_is_none():
    with pytest.raises(ValueError, match='natural_length: the periodic fabric has no equilibrium'):
        ico.homogenise(fabric(LEAST, 10.0), relaxed=True)


def test_the_commands_say_where_it_rests(tmp_path, capsys):
    values = ['-p', 'weave.connector_angle:=-0.3', '-p', 'connector.natural_length:=0.0128',
              '-p', 'contact.mode:=always', '-p', 'contact.stiffness:=100000.0',
              '-p', 'weave.size:=[3,3,3]', '-p', 'connector.stiffness:=500.0']
    words = ['elasticity', 'free_slab', *values, '--kinds', '--relaxed']
    assert main(words) == 0
    text = capsys.readouterr().out
    assert 'about its equilibrium, stable' in text and 'in contact with 12 others' in text
    assert main([*words, '--json']) == 0
    rest = json.loads(capsys.readouterr().out)['rest']
    assert rest['verdict'] == 'stable' and rest['contact_pairs'] == 6
    assert 0.9 < rest['deformation_gradient'][0][0] < 1.0
    picture = tmp_path / 'bands.png'
    assert main(['modes', 'free_slab', *values, '--equilibrium', '--bands', str(picture)]) == 0
    assert picture.read_bytes().startswith(b'\x89PNG')
