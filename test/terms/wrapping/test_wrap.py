# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Connectors that lie around the shells they are attached to (connector.obstruction: wrap)."""

import json
import logging
import re

from analytical import quaternion_product, rotation_quaternion
from fabrics import (
    changed,
    FORMS,
    make_scene,
    packed_state,
    pair_face_to_face,
    RANDOM,
    same_state,
    snapshot_of,
    wrenches,
)
import icofabric_sim as ico
from icofabric_sim import contact
from icofabric_sim.geometry.icosahedron import (
    edge_midpoints,
    face_geometry,
    inscribed_radius,
    outer_triangles,
    vertices,
)
from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.frequency_bound import frequency_bound
from icofabric_sim.parameters.validation import make_parameters, ParameterError
from icofabric_sim.scene.attachments import attachment_points
from icofabric_sim.simulation.model import wrapping as wrapping_module
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.simulation.model.stability import largest_frequency
from icofabric_sim.simulation.model.wrapping import (
    FROM_MIDPOINTS,
    MOST_EDGES,
    pack_wrapping,
    ways_from,
)
from icofabric_sim.simulation.reports.divergence import distance_between
from icofabric_sim.simulation.stepping import thread_team
from icofabric_sim.terms.wrapping.pairs import taut, whole
from icofabric_sim.terms.wrapping.path import apart, leaving, seen_from
import numpy as np
import pytest
from references import axes_of
from wrap_oracle import shortest, shortest_of_all, Surface

WRAP = {'connector.obstruction': 'wrap', 'contact.mode': 'never', 'solver.method': 'leapfrog'}
# Long connectors keep the shells of a lively fabric out of each other.
LOOSE = {**WRAP, 'weave.connector_length': 0.09}
# Two shells, of which one turns through the other.
PASSING = {
    'weave.kind': 'orthogonal', 'weave.variant': 3, 'shell.edge_length': 0.0042,
    'shell.density': 2970.0, 'shell.thickness': 0.00106, 'weave.connector_angle': 0.138,
    'connector.stiffness': 364.0,
    'initial_random.velocity_sigma': 0.00335, 'initial_random.spin_sigma': 139.0,
    'initial_random.seed': 1447408702, 'groups.first': 'ids 0',
    'initial.kick.group': 'first', 'initial.kick.angular_velocity': [-0.627, -0.665, 2.21]}
# Beside equal springs, springs of their own and a law by table.
CASES = {
    'plain': WRAP,
    'kinked': {
        **WRAP, 'connector.stiffness_compression': 150.0, 'connector.natural_length': 0.035,
        'weave.kind': 'bias'},
    'posts': {**WRAP, 'connector.attachment_scale': 1.2},
    'anywhere that resists bending': {
        **WRAP, 'connector.attachment.up': [0.0, 0.004, 0.0165],
        'connector.attachment.north': [0.002, 0.019, 0.001],
        'connector.attachment.west': (0.01 * vertices(1.0)[9]).tolist(),
        'connector.bending_stiffness': 0.02, 'connector.twisting_stiffness': 0.01,
        'connector.stiffness_compression': 150.0}}


def turned_about(scene, amplitude, seed=2):
    """Positions a little and orientations much away from the woven ones."""
    generator = np.random.default_rng(seed)
    shape = (scene.body_count, 3)
    shift = 0.02 * scene.geometry.cube_width * generator.standard_normal(shape)
    turn = rotation_quaternion(amplitude * generator.standard_normal(shape))
    return scene.position + shift, quaternion_product(turn, scene.orientation)


def random_poses(generator, count, distances=(3.9, 6.0)):
    """
    Positions (2, 3), rows of axes (2, 3, 3) and edges of pairs of shells of half edge 1, apart.
    """
    while count > 0:
        axes = axes_of(rotation_quaternion(3.0 * generator.standard_normal((2, 3))))
        way = generator.standard_normal(3)
        way *= generator.uniform(*distances) / np.linalg.norm(way)
        if np.linalg.norm(way) > 3.9 or faces_between(way, axes):
            count -= 1
            yield np.array([np.zeros(3), way]), axes, generator.integers(0, 6, 2).tolist()


def faces_between(way, axes):
    """Whether the plane of a face of one of two shells has the other beyond it."""
    normals, corners, height = face_geometry(1.0).normals, vertices(1.0), inscribed_radius(1.0)
    seen = [corners @ axes[1] + way, corners @ axes[0] - way]
    return any(
        ((normals @ own) @ other.T).min(axis=1).max() > height for own, other in zip(axes, seen))


def length_of(wrapping, poses, edges):
    """Length of the connector that was found, and its two ways."""
    way, place, far_way, far_place = taut(wrapping, poses[0], edges[0], poses[1], edges[1])
    return whole(
        wrapping, poses[0], edges[0], way, place, poses[1], edges[1], far_way, far_place), (
            way, far_way)


def pose(position, axes):
    return (*position.tolist(), *axes.ravel().tolist())


# Attachment points of a shell of half edge 1: on edges, faces and at corners, and outside; far out
# a shell is seen from elsewhere than its edge midpoint.
PLACES = {
    'midpoints': {},
    'posts': {'connector.attachment_scale': 1.15},
    'long posts': {'connector.attachment_scale': 1.6},
    'on the shell': {
        'connector.attachment.up': vertices(1.0)[0].tolist(),
        'connector.attachment.down': face_geometry(1.0).centroids[7].tolist(),
        'connector.attachment.north': (
            outer_triangles(1.0)[3].T @ [0.6, 0.3, 0.1]).tolist(),
        'connector.attachment.south': (
            outer_triangles(1.0)[12].T @ [0.8, 0.2, 0.0]).tolist()},
    'anywhere': {
        'connector.attachment.up': [0.5, -0.3, 2.1],
        'connector.attachment.down': (1.2 * vertices(1.0)[5]).tolist(),
        'connector.attachment.west': [-1.9, 0.4, -0.8]}}


def wrapping_at(place):
    """Ways about a shell of half edge 1 with these attachment points, and the points."""
    parameters = make_parameters({
        'connector.obstruction': 'wrap', 'shell.edge_length': 2.0, **PLACES[place]})
    return pack_wrapping(parameters, 1.0), attachment_points(parameters, 1.0)


@pytest.mark.parametrize('place', PLACES)
def test_ways_are_the_shortest_of_brute_force(place):
    wrapping, points = wrapping_at(place)
    surface, seen, longer = Surface(10, points), np.zeros(3, int), 0
    for position, axes, edges in random_poses(np.random.default_rng(4), 80):
        poses = [pose(*both) for both in zip(position, axes)]
        ends = [taut(wrapping, poses[0], edges[0], poses[1], edges[1]),
                taut(wrapping, poses[1], edges[1], poses[0], edges[0])]
        one = whole(wrapping, poses[0], edges[0], *ends[0][:2], poses[1], edges[1], *ends[0][2:])
        two = whole(wrapping, poses[1], edges[1], *ends[1][:2], poses[0], edges[0], *ends[1][2:])
        assert one == pytest.approx(two, rel=1e-12)
        wanted = shortest(surface, position, axes, edges)
        # Points along edges make the way of brute force a little longer.
        assert wanted * (1.0 - 5e-3) < one < wanted * 1.05
        longer += one > wanted * (1.0 + 1e-9)
        assert min(ends[0][0], ends[0][2]) > -2
        seen[(ends[0][0] >= 0) + (ends[0][2] >= 0)] += 1
    print(seen, longer)
    assert seen[:2].min() > 10 and seen[2] > (10 if place == 'midpoints' else 1) and longer <= 1


def test_no_way_crosses_more_edges_than_are_tried(monkeypatch):
    # From all kinds of places to places all around, over rows of up to eight edges.
    generator = np.random.default_rng(1)
    shares = generator.dirichlet([0.6, 0.6, 0.6], 40)
    points = [*np.einsum('fki,fk->fi', outer_triangles(1.0)[np.arange(40) % 20], shares)]
    points += [*np.vstack([wrapping_at(place)[1] for place in PLACES if place != 'midpoints'])]
    targets = generator.standard_normal((400, 3))
    targets *= generator.uniform(1.53, 2.2, (400, 1)) / np.linalg.norm(targets, axis=1)[:, None]
    midpoints = edge_midpoints(1.0)
    lengths = {}
    for most in (4, FROM_MIDPOINTS, MOST_EDGES, 8):
        monkeypatch.setattr(wrapping_module, 'MOST_EDGES', most)
        monkeypatch.setattr(wrapping_module, 'FROM_MIDPOINTS', most)
        ways_from.cache_clear()
        lengths[most] = [
            np.array([lengths_over(point, targets) for point in some])
            for some in (points, midpoints)]
    ways_from.cache_clear()
    for kind, enough, fewer in ((0, MOST_EDGES, FROM_MIDPOINTS), (1, FROM_MIDPOINTS, 4)):
        around = np.isfinite(lengths[8][kind])
        assert around.any()
        np.testing.assert_array_equal(lengths[enough][kind], lengths[8][kind])
        assert (lengths[fewer][kind][around] > lengths[8][kind][around] + 1e-6).any()


def lengths_over(point, targets):
    """Lengths of the ways from a point around a shell of half edge 1; infinite: straight."""
    found = ways_from(*point.tolist())
    begin, end = vertices(1.0)[np.array([(way.corner, way.end) for way in found.rows]).T]
    along, (foot, away, low, high) = 0.5 * (end - begin), np.array([
        (way.foot, way.away, way.low, way.high) for way in found.rows]).T
    on, following = found.planes[np.array([way.faces for way in found.rows]).T]
    lengths = np.full(len(targets), np.inf)
    for k, target in enumerate(targets):
        heights = found.planes[:, :3] @ target - found.planes[:, 3]
        if heights[:20].max() < 0.0 or heights[list(found.start)].max() >= 0.0:
            continue
        x = ((target - begin) * along).sum(axis=1)
        y = np.linalg.norm(target - begin - x[:, None] * along, axis=1)
        passed = foot + (x - foot) * away / (away + y)
        taut_ = (passed > low - 1e-12) & (passed < high + 1e-12) & (
            on[:, :3] @ target - on[:, 3] < 1e-12) & (
            following[:, :3] @ target - following[:, 3] > -1e-12)
        assert taut_.any() or wrapping_module.MOST_EDGES < 6
        lengths[k] = np.where(taut_, np.hypot(x - foot, y + away), np.inf).min()
    return lengths


def test_either_end_finds_the_same_ways_where_shells_pass_through_each_other():
    wrapping = pack_wrapping(make_parameters({'connector.obstruction': 'wrap'}), 1.0)
    generator, around = np.random.default_rng(11), 0
    for distance in generator.uniform(0.5, 3.0, 400):
        axes = axes_of(rotation_quaternion(3.0 * generator.standard_normal((2, 3))))
        first, second = (
            pose(np.array([x, 0.0, 0.0]), turn) for x, turn in zip((0.0, distance), axes))
        edge = int(generator.integers(0, 6))
        found = taut(wrapping, first, edge, second, edge ^ 1)
        turned_round = taut(wrapping, second, edge ^ 1, first, edge)
        assert turned_round == (*found[2:], *found[:2])
        around += min(found[0], found[2]) >= 0
    assert around > 50


def test_no_other_pair_of_ways_is_shorter():
    # All pairs of 69 ways from either end. Of 8,000 poses like these none had a shorter one.
    wrapping = pack_wrapping(make_parameters({'connector.obstruction': 'wrap'}), 1.0)
    both = 0
    for distances in ((3.03, 3.8), (3.9, 6.0)):
        for position, axes, edges in random_poses(
                np.random.default_rng(6), 300, distances):
            poses = [pose(*place) for place in zip(position, axes)]
            found, ways = length_of(wrapping, poses, edges)
            if min(ways) >= 0:
                both += 1
                assert found == pytest.approx(shortest_of_all(
                    wrapping, poses[0], edges[0], poses[1], edges[1]), rel=1e-12)
    assert both > 100


@pytest.mark.parametrize('distance', [3.4, 4.5])
def test_a_length_never_changes_by_more_than_the_ends_move(distance):
    # In slow motion through very many poses: a pair of ways that was missed would be a jump.
    wrapping = pack_wrapping(make_parameters({'connector.obstruction': 'wrap'}), 1.0)
    generator, both, apart_ = np.random.default_rng(8), 0, 0
    turn, step = rotation_quaternion(3.0 * generator.standard_normal((2, 3))), 2e-3
    spin = generator.standard_normal((2, 3))
    little = rotation_quaternion(step * spin)
    # Every point of a shell moves by at most this.
    most = np.linalg.norm(spin, axis=1).sum() * step * np.linalg.norm(vertices(1.0)[0])
    before = None
    for _ in range(4000):
        turn = quaternion_product(little, turn)
        axes, way = axes_of(turn), np.array([distance, 0.0, 0.0])
        if not faces_between(way, axes):
            before = None
            continue
        apart_ += 1
        poses = [pose(*place) for place in zip([np.zeros(3), way], axes)]
        found = [length_of(wrapping, poses, (edge, 3 - edge)) for edge in (0, 1, 2)]
        lengths = np.array([length for length, _ in found])
        both += sum(min(ways) >= 0 for _, ways in found)
        if before is not None:
            assert np.abs(lengths - before).max() < 1.001 * most
        before = lengths
    print(both, apart_)
    assert both > 500 and apart_ > 500


def test_a_length_does_not_jump_where_shells_begin_to_touch():
    # Contacts are springs: shells that they keep apart overlap by some thousandths of a.
    wrapping = pack_wrapping(make_parameters({'connector.obstruction': 'wrap'}), 1.0)
    generator, both, half = np.random.default_rng(12), 0, 1e-3
    turns = rotation_quaternion(3.0 * generator.standard_normal((2000, 2, 3)))
    low, high = np.full((2, len(turns)), [[2.0], [4.0]])
    place = np.zeros((len(turns), 3))
    for _ in range(40):
        place[:, 0] = 0.5 * (low + high)
        gap = contact.separation(
            1.0, (np.zeros(3), turns[:, 0]), (place, turns[:, 1])).distance
        low, high = np.where(gap < 0.0, place[:, 0], low), np.where(gap < 0.0, high, place[:, 0])
    for distance, turn in zip(low, turns):
        axes = axes_of(turn)
        for edge in range(6):
            apart_, overlapping = (
                length_of(
                    wrapping, [pose(np.array([x, 0.0, 0.0]), own) for x, own in zip(
                        (0.0, distance + shift), axes)], (edge, edge ^ 1))
                for shift in (half, -half))
            assert abs(apart_[0] - overlapping[0]) < 2.001 * half
            both += min(apart_[1]) >= 0
    assert both > 1000


def test_no_place_can_be_moved_to_shorten_a_way():
    # Stationary to rounding, also where both ends lie around their shells.
    wrapping = pack_wrapping(make_parameters({'connector.obstruction': 'wrap'}), 1.0)
    both = 0
    for position, axes, edges in random_poses(np.random.default_rng(5), 60):
        first, second = [pose(*place) for place in zip(position, axes)]
        way, s, far_way, r = taut(wrapping, first, edges[0], second, edges[1])

        for h, k in ((1e-4, 0.0), (0.0, 1e-4)):
            if (way if h else far_way) >= 0:
                less, least, more = (
                    whole(
                        wrapping, first, edges[0], way, s + sign * h, second, edges[1], far_way,
                        r + sign * k)
                    for sign in (-1.0, 0.0, 1.0))
                assert abs(more - less) < 1e-12 and more > least
        both += way >= 0 and far_way >= 0
        # The free part touches neither shell.
        p = leaving(wrapping, first, edges[0], way, s)
        q = leaving(wrapping, second, edges[1], far_way, r)
        for t in np.linspace(0.05, 0.95, 7):
            point = tuple((1.0 - t) * np.array(p) + t * np.array(q))
            for own in (first, second):
                height = wrapping.normals @ np.array(seen_from(own, point)) - wrapping.height
                assert height.max() > -1e-9
        assert apart(p, q) > 0.0
    assert both > 10


@pytest.mark.parametrize('form', FORMS)
@pytest.mark.parametrize('name', CASES)
def test_wrench_is_minus_the_gradient(name, form):
    scene = make_scene((3, 3, 3), CASES[name])
    generator, both = np.random.default_rng(3), 0
    for seed in range(6):
        position, orientation = turned_about(scene, 0.7, seed)
        shift = scene.geometry.half_edge * generator.standard_normal((scene.body_count, 3))
        turn = generator.standard_normal((scene.body_count, 3))

        def along(h, position=position, orientation=orientation, shift=shift, turn=turn):
            return snapshot_of(scene, position + h * shift, quaternion_product(
                rotation_quaternion(h * turn), orientation)).energy['connectors']

        work = wrenches(scene, position, orientation, cosines=form != 'quaternion')
        expected = -(work.force * shift).sum() - (work.torque * turn).sum()
        errors = [(along(h) - along(-h)) / (2.0 * h) - expected for h in (4e-5, 2e-5)]
        assert abs((4.0 * errors[1] - errors[0]) / 3.0) < 1e-6 * abs(along(0.0))
        snapshot = snapshot_of(scene, position, orientation)
        both += (snapshot.obstructed == 3).sum()
        assert (snapshot.obstructed > 0).sum() > 8
        straight = np.linalg.norm(np.diff(snapshot.connector_ends, axis=1)[:, 0], axis=1)
        around = snapshot.obstructed > 0
        assert (snapshot.connector_length[around] > straight[around]).all()
        assert np.array_equal(snapshot.connector_length[~around], straight[~around]) or (
            np.abs(snapshot.connector_length - straight)[~around].max() < 1e-15)
    assert both > 0


def test_actions_are_reactions():
    scene = make_scene((4, 3, 3), WRAP)
    position, orientation = turned_about(scene, 0.9)
    work = wrenches(scene, position, orientation)
    size = np.abs(work.force).max()
    assert np.abs(work.force.sum(axis=0)).max() < 1e-14 * size
    moment = (np.cross(position, work.force) + work.torque).sum(axis=0)
    assert np.abs(moment).max() < 1e-12 * size * scene.geometry.half_edge
    plain = wrenches(changed(scene, {'connector.obstruction': 'warn'}), position, orientation)
    assert np.abs(plain.force - work.force).max() > 0.1 * size
    # A common rigid motion changes nothing.
    turn = rotation_quaternion(np.array([[0.7, -2.0, 1.1]]))
    axes = axes_of(turn)[0]
    moved = wrenches(
        scene, position @ axes + [0.1, -0.2, 0.05], quaternion_product(turn, orientation))
    np.testing.assert_allclose(moved.force, work.force @ axes, rtol=0, atol=1e-10 * size)
    np.testing.assert_allclose(
        moved.torque, work.torque @ axes, rtol=0, atol=1e-10 * size * scene.geometry.half_edge)


def test_it_begins_smoothly_and_is_the_chord_over_one_edge():
    # One body turns about the edge's own direction until its connector leads along a face, below
    # it, and round the far edges of that face.
    scene = make_scene((2, 2, 1), {**WRAP, 'connector.natural_length': 0.01})
    width = scene.geometry.cube_width
    position, orientation = pair_face_to_face(scene, 2.4 * width)

    def at(angle):
        turn = rotation_quaternion(np.array([[0.0, 0.0, angle], np.zeros(3)]))
        return position, quaternion_product(turn, orientation)

    # Where the connector first lies in a face: looked for along the angle.
    packed = pack_scene(scene)
    angles = np.linspace(0.0, 2.8, 4001)
    coarse = angles[::20]
    bits = [snapshot_of(scene, *at(angle), packed).obstructed[0] for angle in coarse]
    first = float(coarse[np.flatnonzero(bits)[0]])
    low, high = first - 20 * 0.0007, first
    while high - low > 1e-13:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if snapshot_of(
            scene, *at(middle), packed).obstructed[0] else (middle, high)
    for h, wanted in ((1e-3, 3e-3), (1e-5, 3e-5), (1e-7, 3e-7)):
        before, after = (wrenches(scene, *at(high + sign * h)) for sign in (-1.0, 1.0))
        assert np.abs(after.force - before.force).max() < wanted * np.abs(before.force).max()
        assert np.abs(after.torque - before.torque).max() < 2.0 * wanted * np.abs(
            before.force).max() * width
    lengths = np.array([
        snapshot_of(scene, *at(angle), packed).connector_length[0] for angle in angles])
    assert np.abs(np.diff(lengths)).max() < 1.5 * width * 0.0007
    # Straight through, it would be shorter by a good part.
    turned = snapshot_of(scene, *at(2.8))
    straight = np.linalg.norm(np.diff(turned.connector_ends[0], axis=0))
    assert turned.connector_length[0] > straight + 0.2 * width


def dense_hessian(scene, position, orientation, h=1e-6):
    """M^-1/2 H M^-1/2 from differences of the wrenches."""
    count, a = scene.body_count, scene.geometry.half_edge
    rows = []
    for unit in np.eye(6 * count).reshape(6 * count, 2, count, 3):
        ends = []
        for sign in (-h, h):
            work = wrenches(scene, position + sign * a * unit[0], quaternion_product(
                rotation_quaternion(sign * unit[1]), orientation))
            ends.append(np.hstack([work.force.ravel(), work.torque.ravel()]))
        rows.append((ends[0] - ends[1]) / (2.0 * h) * (1.0 / a if unit[0].any() else 1.0))
    root = np.repeat([scene.shell.mass**-0.5, scene.shell.inertia**-0.5], 3 * count)
    matrix = np.array(rows) * np.outer(root, root)
    return 0.5 * (matrix + matrix.T)


@pytest.mark.parametrize('name', ['plain', 'posts', 'anywhere that resists bending', 'arms'])
def test_the_step_knows_an_upper_bound_of_the_frequency(name):
    ratios = []
    for rest in (0.0, 0.02, 0.06):
        case = {**CASES.get(name, WRAP), 'connector.natural_length': rest}
        scene = make_scene((2, 2, 2), case)
        whole_spring = scene
        if name == 'arms':
            # A spring and an arm that rest at the same length are one spring.
            k = scene.connectors.stiffness
            scene = make_scene((2, 2, 2), {
                **case, 'connector.maxwell_stiffness': 3.0 * k, 'connector.maxwell_time': 1.0,
                'solver.method': 'dop8'})
            whole_spring = make_scene((2, 2, 2), {**case, 'connector.stiffness': 4.0 * k})
        for seed in range(3):
            position, orientation = turned_about(scene, 1.0, seed)
            packed = pack_scene(scene)
            state = packed_state(packed, position, orientation)
            if name == 'arms':
                state = packed.pack(
                    packed.layout.unpack(state), np.full(scene.connector_count, rest))
            work = packed.layout.room(packed.model.links)
            place_all(packed.model, state, work, 0, len(packed.model.blocks.slot))
            exact = np.linalg.eigvalsh(dense_hessian(whole_spring, position, orientation))[-1]
            ratios.append((
                largest_frequency(packed, state).rate / np.sqrt(exact),
                np.sqrt(frequency_bound(packed.model, state, work) / exact)))
    print(np.round(ratios, 2).tolist())
    assert np.min(ratios) > 0.999 and np.max(ratios) < 4.0


def momenta(scene, state):
    linear = scene.shell.mass * state.linear_velocity
    turning = np.cross(state.position, linear) + scene.shell.inertia * state.angular_velocity
    return linear, turning


def lively(**changes):
    return make_scene(
        (3, 3, 2), {**LOOSE, 'initial_random.spin_sigma': 90.0, **changes}, **RANDOM)


def test_energy_and_momenta_stay():
    # By dop8, which shortens its steps where a way changes; the other side of a shell may become
    # the shorter way, and forces jump there, but not the energy.
    scene = lively(**{'solver.method': 'dop8'})
    simulation = ico.compile_scene(scene)
    around = 0
    for time in (0.02, 0.04, 0.06):
        simulation.advance_to(time)
        s, first = simulation.snapshot(), scene.initial
        around += int((s.obstructed > 0).sum())
        assert abs(s.energy['balance_error']) < 1e-5 * s.energy['kinetic']
        for before, after in zip(momenta(scene, first), momenta(scene, s)):
            change = (after - before).sum(axis=0)
            assert np.abs(change).max() < 1e-10 * np.abs(before).sum()
    assert around > 10 and simulation.status.obstruction == ''
    assert 'another geodesic' in simulation.status.error_estimate_lacks
    free = ico.compile_scene(changed(scene, {'connector.obstruction': 'warn'}))
    free.advance_to(0.06)
    assert np.abs(free.snapshot().position - s.position).max() > 0.01 * scene.geometry.half_edge


@pytest.mark.parametrize('mode', ['never', pytest.param('auto', marks=pytest.mark.long)])
def test_a_stop_where_shells_may_pass_through_each_other_names_contact_mode(mode):
    simulation = ico.compile_scene(lively(**{'contact.mode': mode}))
    driver = simulation._event_loop.driver
    driver.trajectory.ledger.error = driver.trajectory.ledger.balance.scale
    with pytest.raises(ico.SimulationError, match='does not balance') as caught:
        driver.monitor.fail_unbalanced(0.0)
    assert ('contact.mode auto keeps shells apart' in str(caught.value)) == (mode == 'never')


@pytest.mark.parametrize('method, step', [('leapfrog', 5e-7), ('dop8', 0.0)])
def test_a_length_that_jumps_where_shells_pass_through_each_other_is_named(method, step):
    # The energy that a jump takes is the one that is missing, for any method and step.
    simulation = ico.compile_scene(make_scene((1, 2, 2), {
        **WRAP, **PASSING, 'solver.method': method, 'solver.step': step}))
    with pytest.raises(ico.SimulationError, match='connector.obstruction is wrap') as caught:
        simulation.advance_to(0.03)
    numbers = re.search(
        r'shells of bodies 0 and 1 pass through each other, by (\S+) m, .* connector 0 .* jumps '
        r'from (\S+) m to (\S+) m, .* by (\S+) J: .* an error of (\S+) J', str(caught.value))
    depth, before, after, energy, error = (float(number) for number in numbers.groups())
    s, scene = simulation.snapshot(), simulation.scene
    # The last good state is just before.
    ends = zip(s.position, s.orientation)
    assert depth == pytest.approx(
        -contact.separation(scene.geometry.half_edge, *ends).distance, rel=0.05)
    assert before == pytest.approx(s.connector_length[0], rel=1e-5)
    assert abs(after - before) > 0.05 * before
    k, rest = scene.connectors.stiffness, scene.connectors.natural_length
    assert energy == pytest.approx(
        0.5 * k * ((after - rest) ** 2 - (before - rest) ** 2), rel=1e-2)
    assert error == pytest.approx(energy, rel=0.05)
    assert abs(s.energy['balance_error']) < 0.05 * abs(error)
    assert 'solver.tolerance' not in str(caught.value)


def test_what_is_left_for_jumps_is_not_used_by_smooth_steps():
    """Window by window against a run at a hundredth: the mean is a few tolerances, not 40."""
    scene = lively(**{'solver.method': 'dop8', 'solver.tolerance': 1e-6})
    run, finer = ico.compile_scene(scene), ico.compile_scene(
        changed(scene, {'solver.tolerance': 1e-8}))
    added = 0.0
    for _ in range(5):
        start = run.time
        finer.reset_time()
        finer.continue_from(run, keep_motion=True)
        run.advance_to(start + 2.0 * np.pi / run.status.largest_frequency)
        run.advance_steps(1)
        finer.advance_to(run.time)
        added += distance_between(run.snapshot(), finer.snapshot(), scene.geometry.half_edge)
    assert run.snapshot().obstructed.any()
    assert 0.1 < added / (1e-6 * run.time) < 8.0
    assert 0.2 < run.error_estimate / added < 3.0


def test_splitting_keeps_energy_the_better_the_shorter_its_steps():
    errors = []
    for step in (4e-4, 1e-4, 2.5e-5):
        simulation = ico.compile_scene(lively(**{'solver.step': step}))
        simulation.advance_to(0.04)
        errors.append(simulation.balance.worst)
        linear, _ = momenta(simulation.scene, simulation.snapshot())
        start, _ = momenta(simulation.scene, simulation.scene.initial)
        assert np.abs((linear - start).sum(axis=0)).max() < 1e-12 * np.abs(start).sum()
    print(errors)
    assert errors[2] < errors[1] / 2.5 < errors[0] / 6.0 and errors[2] < 1e-3


def test_same_bits_in_pieces_threads_and_checkpoints(monkeypatch):
    scene = make_scene(
        (5, 5, 5), {**LOOSE, 'solver.threads': 2, 'solver.step': 2e-6}, **RANDOM)
    monkeypatch.setattr(thread_team, 'BODIES_PER_THREAD', 20)
    ends = []
    for threads, pieces in ((1, 1), (2, 1), (1, 5)):
        monkeypatch.setattr(thread_team, 'core_count', lambda threads=threads: threads)
        simulation = ico.compile_scene(scene)
        assert simulation.status.thread_count == threads
        for piece in range(pieces):
            simulation.advance_to(0.02 * (piece + 1) / pieces)
            if piece == 2:
                checkpoint = simulation.checkpoint()
                simulation = ico.compile_scene(scene)
                simulation.restore(checkpoint)
        ends.append(simulation.snapshot())
    assert same_state(ends[0], ends[1]) and same_state(ends[0], ends[2])
    assert (ends[0].obstructed > 0).sum() > 10


def test_a_fabric_of_millimetres_moves_like_one_of_metres():
    ends = []
    for a, k in ((1e-3, 40.0), (1.0, 9e4)):
        scene = make_scene((3, 3, 2), {
            **WRAP, 'shell.edge_length': 2.0 * a, 'shell.thickness': 0.2 * a,
            'shell.mass': 1e-3 * k, 'connector.stiffness': k, 'solver.step': 1e-4,
            'initial_random.velocity_sigma': 3.0 * a, 'initial_random.spin_sigma': 30.0})
        simulation = ico.compile_scene(scene)
        simulation.advance_to(0.05)
        s = simulation.snapshot()
        assert (s.obstructed > 0).sum() > 3
        ends.append(np.hstack([s.position / a, s.orientation]))
    assert np.abs(ends[0] - ends[1]).max() < 1e-9


DAMPED = {
    'solver.method': 'dop8', 'connector.damping': 0.02, 'connector.break_length_extension': 1.0}


@pytest.mark.long
def test_damping_follows_the_rate_of_the_whole_way():
    # The power that it takes is c (dl/dt)^2, and the wrench -c dl/dt times the gradient of l.
    # Steps of one length: no kernel that chooses them is compiled for this kind of scene.
    scene = make_scene((3, 3, 3), {**WRAP, **DAMPED, 'solver.step': 2e-7})
    position, orientation = turned_about(scene, 0.8)
    packed = pack_scene(scene)
    generator = np.random.default_rng(4)
    shape = (scene.body_count, 3)
    velocity = 0.3 * generator.standard_normal(shape)
    spin = 20.0 * generator.standard_normal(shape)

    def lengths(h):
        return snapshot_of(scene, position + h * velocity, quaternion_product(
            rotation_quaternion(h * spin), orientation), packed).connector_length

    rate = (8.0 * (lengths(1e-7) - lengths(-1e-7)) - (lengths(2e-7) - lengths(-2e-7))) / 12e-7
    around = snapshot_of(scene, position, orientation, packed).obstructed > 0
    assert around.sum() > 10
    c = DAMPED['connector.damping']

    def accelerations(speed, turning):
        ends, spent = [], []
        for h in (1e-6, 2e-6):
            simulation = ico.compile_scene(scene)
            simulation.set_state(
                position=position, orientation=orientation, linear_velocity=speed,
                angular_velocity=turning)
            simulation.advance_to(h)
            s = simulation.snapshot()
            ends.append(np.array([
                s.linear_velocity - speed, s.angular_velocity - turning]) / h)
            spent.append(s.energy['dissipated'] / h)
        return 2.0 * ends[0] - ends[1], 2.0 * spent[0] - spent[1]

    (linear, angular), spent = accelerations(velocity, spin)
    (still, turning), nothing = accelerations(0.0 * velocity, 0.0 * spin)
    force, torque = scene.shell.mass * (linear - still), scene.shell.inertia * (angular - turning)
    wanted = c * (rate**2).sum()
    assert spent == pytest.approx(wanted, rel=1e-4) and nothing < 1e-6 * spent
    assert -(force * velocity).sum() - (torque * spin).sum() == pytest.approx(wanted, rel=1e-4)
    # Straight ones alone take another part.
    assert abs(c * (rate[~around]**2).sum() / wanted - 1.0) > 0.1


ARMS = {'connector.maxwell_stiffness': 600.0, 'connector.maxwell_time': 2e-3}


@pytest.mark.long
def test_quick_arms_around_shells_are_dampers_and_slow_ones_springs():
    # Springs and dampers around shells have oracles of their own above.
    ends = {}
    k = lively().connectors.stiffness
    for name, changes in {
            'quick': {'connector.maxwell_stiffness': 4e4, 'connector.maxwell_time': 2e-6},
            'damper': {'connector.damping': 0.08},
            'slow': {'connector.maxwell_stiffness': 600.0, 'connector.maxwell_time': 1e4},
            'spring': {'connector.stiffness': k + 600.0}, 'plain': {}}.items():
        simulation = ico.compile_scene(lively(**{
            'solver.method': 'dop8', 'initial_random.seed': 3, **changes}))
        around = False
        for time in (0.01, 0.02, 0.03):
            simulation.advance_to(time)
            around |= (simulation.snapshot().obstructed > 0).any()
        assert around
        ends[name] = simulation.snapshot()
        assert abs(ends[name].energy['balance_error']) < 1e-4 * ends[name].energy['kinetic']
    a, plain = lively().geometry.half_edge, ends['plain'].position
    for arm, other, part in (('quick', 'damper', 0.02), ('slow', 'spring', 1e-4)):
        change = np.abs(ends[other].position - plain).max()
        assert change > 0.01 * a
        assert np.abs(ends[arm].position - ends[other].position).max() < part * change
    assert ends['quick'].energy['dissipated'] == pytest.approx(
        ends['damper'].energy['dissipated'], rel=0.02)


def test_arms_around_shells_follow_the_whole_way():
    # None breaks: with limits it is the kind of scene of those that do.
    scene = lively(**ARMS, **{'solver.method': 'dop8', 'connector.break_length_extension': 1.0})
    runs = [ico.compile_scene(scene) for _ in range(2)]
    for time in (0.01, 0.02, 0.03):
        runs[0].advance_to(time)
        if time == 0.02:
            checkpoint = runs[0].checkpoint()
    s = runs[0].snapshot()
    runs[1].restore(checkpoint)
    runs[1].advance_to(0.03)
    assert same_state(s, runs[1].snapshot())
    np.testing.assert_array_equal(s.rest_length, runs[1].snapshot().rest_length)
    around = s.obstructed > 0
    assert around.sum() > 3 and np.abs(s.maxwell_tension[around]).min() > 0.0
    np.testing.assert_array_equal(
        s.maxwell_tension, 600.0 * (s.connector_length - s.rest_length))
    assert abs(s.energy['balance_error']) < 1e-4 * s.energy['kinetic']
    assert s.energy['dissipated'] > 0.1 * s.energy['kinetic']
    # Arms at rest have the lengths of the ways, also where these are around shells.
    runs[0].set_state(position=s.position, orientation=s.orientation, relaxed=True)
    np.testing.assert_allclose(runs[0].snapshot().rest_length, s.connector_length, rtol=1e-12)
    # Held there, an arm loses its pull as exp(-t / tau).
    held = ico.compile_scene(changed(scene, {
        'groups.every': 'all', 'supports.hold.group': 'every'}))
    held.set_state(position=scene.position, orientation=scene.orientation, relaxed=True)
    held.set_state(position=s.position, orientation=s.orientation)
    pull = held.snapshot().maxwell_tension
    held.advance_to(3e-3)
    np.testing.assert_allclose(
        held.snapshot().maxwell_tension, pull * np.exp(-1.5), rtol=1e-5,
        atol=1e-6 * np.abs(pull).max())


@pytest.mark.long
def test_damped_connectors_around_shells_keep_the_balance():
    scene = lively(**DAMPED)
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.04)
    s, first = simulation.snapshot(), scene.initial
    assert (s.obstructed > 0).sum() > 3
    start = ico.compile_scene(scene).snapshot().energy['kinetic']
    assert s.energy['dissipated'] > 0.05 * start
    assert abs(s.energy['balance_error']) < 1e-5 * start
    for before, after in zip(momenta(scene, first), momenta(scene, s)):
        assert np.abs((after - before).sum(axis=0)).max() < 1e-10 * np.abs(before).sum()


@pytest.mark.parametrize('seed, around', [
    pytest.param(1, 2, marks=pytest.mark.long), (9, 3)])
def test_they_break_at_the_length_of_the_whole_way(seed, around):
    # Around one shell, and around both, after a while in which the shortest way has changed.
    limit, moments = 0.093, []
    for tolerance in (1e-6, 1e-9):
        scene = make_scene((2, 2, 1), {
            # Arms of next to nothing: the kind of scene of the arms above.
            **LOOSE, 'connector.maxwell_stiffness': 1e-3, 'connector.maxwell_time': 2e-3,
            'solver.method': 'dop8', 'solver.tolerance': tolerance,
            'connector.break_length_extension': limit, 'initial_random.spin_sigma': 40.0,
            'initial_random.seed': seed})
        simulation = ico.compile_scene(scene)
        s = simulation.snapshot()
        while s.intact[0] and s.time < 0.5:
            simulation.advance_to(s.time + 0.02)
            s = simulation.snapshot()
        moments.append(s.break_time[0])
        assert s.energy['lost_at_breaks'] > 0.0
        assert abs(s.energy['balance_error']) < 1e-4 * s.energy['kinetic']
        other = ico.compile_scene(scene)
        other.advance_to(moments[-1] - 1e-9)
        before = other.snapshot()
        assert before.intact[0] and before.obstructed[0] == around
        assert before.connector_length[0] == pytest.approx(limit, abs=3e-9)
        assert before.connector_length[0] < limit
    print(moments)
    assert abs(moments[1] - moments[0]) < 1e-4


def test_what_finds_no_way_is_said(caplog):
    # The far end within the shell, just below the face that the connector comes from.
    scene = make_scene((2, 2, 1), WRAP)
    width = scene.geometry.cube_width
    position, orientation = pair_face_to_face(scene, 0.9 * width)
    simulation = ico.compile_scene(scene)
    simulation.set_state(position=position, orientation=orientation)
    snapshot = simulation.snapshot()
    assert snapshot.without_geodesic.tolist() == [3] and simulation.status.obstructed_ends == 2
    assert np.isfinite(snapshot.energy['connectors'])
    with caplog.at_level(logging.WARNING):
        simulation.advance_to(0.001)
    assert 'finds no way around the shell of body 0' in simulation.status.obstruction
    assert 'contact.mode auto keeps shells apart' in simulation.status.error_estimate_lacks
    assert sum('finds no way' in record.message for record in caplog.records) == 1


@pytest.mark.parametrize('changes', [
    {'connector.attachment_scale': 0.9}, {'connector.attachment_scale': 0.01},
    {'connector.attachment.up': [0.001, 0.0, 0.012]}])
def test_points_within_a_shell_are_refused(changes):
    name, = changes
    with pytest.raises(ParameterError, match='inside the shell.*connector.obstruction wrap') as of:
        make_scene((2, 2, 2), {**WRAP, **changes})
    assert of.value.name == name and repr(changes[name]) in str(of.value)
    assert make_scene((2, 2, 2), {**changes, 'connector.obstruction': 'warn'}).body_count
    nearest = re.search(r'outside, such as (\[.*\]|\S+), or', str(of.value)).group(1)
    assert make_scene((2, 2, 2), {**WRAP, name: json.loads(nearest)}).body_count


@pytest.mark.parametrize(('method', 'step', 'said'), [
    ('leapfrog', 0.0, True), ('leapfrog', 1e-5, False), ('dop8', 0.0, False)])
def test_chosen_steps_of_one_length_say_what_geodesics_cost(caplog, method, step, said):
    with caplog.at_level(logging.WARNING):
        ico.compile_scene(make_scene(
            (2, 2, 2), {**WRAP, 'solver.method': method, 'solver.step': step}))
    assert sum('other geodesics (connector.obstruction wrap)' in record.message
               for record in caplog.records) == said


@pytest.mark.parametrize('method', ['srkn4', 'srkn6', 'srkn8'])
def test_high_orders_choose_no_steps_around_shells(method):
    given = {**WRAP, 'solver.method': method}
    with pytest.raises(ParameterError, match=f'solver.method {method} cannot choose .*take dop8'):
        ico.compile_scene(make_scene((2, 2, 2), given))
    run = ico.compile_scene(make_scene((2, 2, 2), {**given, 'solver.step': 1e-5}))
    run.advance_to(1e-4)
    assert run.status.step_count == 10


def test_auto_takes_a_method_that_sees_the_bends():
    scene = make_scene((2, 2, 2), {**WRAP, 'solver.method': 'auto'})
    assert ico.compile_scene(scene).status.method_name == 'dop8'
    assert pack_scene(make_scene((2, 2, 2))).model.wrapping is None
