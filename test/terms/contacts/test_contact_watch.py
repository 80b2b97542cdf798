# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""No pair that can touch before the next look is missed, and none is computed that cannot."""

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.simulation.contact.neighbour_list import NeighbourList
from icofabric_sim.simulation.contact.passing import Course, first_passing
from icofabric_sim.simulation.contact.setup import ContactSetup
from icofabric_sim.simulation.model.layout import make_layout
from icofabric_sim.terms.contacts.displacement import (
    LATE,
    LIMIT_COUNT,
    MAX_REACH,
    MIN_REACH,
    MOST_STRIDE,
    OWN,
    SKIN,
    SPEED,
    ways_of,
)
from icofabric_sim.terms.contacts.gap import axes_of, widest_gap
from icofabric_sim.terms.contacts.listing import arrange, find_both
from icofabric_sim.terms.contacts.pair import contact_scratch, OUT_SIZE, touch_pair, touch_plane
from icofabric_sim.terms.contacts.rebuild_check import look_around
from icofabric_sim.terms.contacts.record import Watch
from icofabric_sim.terms.contacts.search import find_close, sort_cubes
import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

SCRATCH, OUT = contact_scratch(), np.zeros(OUT_SIZE)


def close_pairs(position, width):
    """What the kernels find among points (n, 3)."""
    count = len(position)
    slots = np.arange(count, dtype=np.int32)
    heads = np.empty(1 << (2 * count).bit_length(), np.int32)
    cubes, following = np.empty((3, count), np.int64), np.empty(count, np.int32)
    places = np.ascontiguousarray(position.T)
    sort_cubes(places, slots, width, cubes, heads, following)
    few = np.empty((1, 2), np.int32)
    found = find_close(places, slots, width, cubes, heads, following, few, None)
    pairs = np.empty((found, 2), np.int32)
    assert find_close(places, slots, width, cubes, heads, following, pairs, None) == found
    return pairs


@pytest.mark.parametrize('place', [0.0, 1e7])
@pytest.mark.parametrize('spread', [0.1, 3.0, 1e5])
def test_all_close_pairs_are_found_however_bodies_lie(spread, place):
    generator = np.random.default_rng(3)
    position = spread * generator.standard_normal((300, 3)) + [place, -place, 0.0]
    # Some fly away, some are in one place, some on the faces of cubes.
    position[:5] *= 1e3
    position[5:8] = position[8]
    position[20:60] = np.round(position[20:60])
    pairs = close_pairs(position, 1.0)
    expected = cKDTree(position).query_pairs(1.0, output_type='ndarray')
    distance = np.linalg.norm(position[expected[:, 0]] - position[expected[:, 1]], axis=1)
    expected = expected[distance < 1.0]
    order = np.lexsort((expected[:, 1], expected[:, 0]))
    assert len(pairs) >= 3
    assert np.array_equal(pairs, expected[order])


def packed_state(layout, position, quaternion):
    zero = np.zeros_like(position)
    return layout.pack(InitialState(position, quaternion, zero, zero))


def make_watch(lists, state, frame=None):
    """A watch of bodies that were where they are in `state`."""
    limits = np.zeros(LIMIT_COUNT)
    return Watch(
        state.position.copy(), state.orientation.copy(), np.zeros(7) if frame is None else frame,
        lists.nearby.radius, limits, np.zeros(8), lists.nearby)


def touching(position, rotation, i, j):
    if j < 0:
        plane = PLANES[-1 - j]
        return touch_plane(1.0, plane[:3], plane[3], position[i], rotation[i], SCRATCH, OUT)
    return touch_pair(1.0, 1.0, position[i], rotation[i], position[j], rotation[j], SCRATCH, OUT)


def test_shells_touch_where_no_axis_shows_a_gap_and_nowhere_else():
    generator = np.random.default_rng(5)
    seen = [0, 0]
    for _ in range(1500):
        both = Rotation.random(2, random_state=generator)
        way = generator.standard_normal(3)
        way *= generator.uniform(2.9, 3.9) / np.linalg.norm(way)
        quaternion = both.as_quat().T.copy()
        gap, _ = widest_gap(
            np.inf, 1.0, 1.0, *way, axes_of(quaternion, 0), axes_of(quaternion, 1))
        touches = touching(np.array([np.zeros(3), way]), both.as_matrix(), 0, 1)
        assert touches == (gap < 0.0) or abs(gap) < 1e-12
        seen[touches] += 1
    assert min(seen) > 200


PLANES = np.array([[0.0, 0.0, 1.0, -14.0], [0.6, 0.8, 0.0, -12.0]])
SETUP = ContactSetup(1.0, 1.0, 0.0, 0.0, PLANES, ('floor', 'wall'), False, False, np.zeros(3), '')


def crowd(generator, count=140):
    """Places and orientations of bodies that overlap, nearly touch, or are alone."""
    position = generator.uniform(-11.0, 11.0, (count, 3))
    return position, Rotation.random(count, random_state=generator)


@pytest.mark.parametrize('seed', range(4))
def test_nothing_else_touches_before_a_way_is_as_long_as_the_reach(seed):
    generator = np.random.default_rng(seed)
    layout = make_layout(np.zeros((0, 3), np.int32), 140)
    position, rotation = crowd(generator)
    lists = NeighbourList(SETUP, layout)
    state = packed_state(layout, position, rotation.as_quat())
    watch = make_watch(lists, state)
    lists.survey(state, np.empty(3))
    near = lists.find(state, 0.05, 0.4)
    listed = {tuple(pair) for pair in near.pairs.tolist()}
    assert near.reach == 0.05 and len(listed) > 50
    assert any(pair[1] < 0 for pair in listed)
    changed = 0
    for _ in range(30):
        # Half of the way by displacement, half by turning, to the end of the reach.
        way = generator.standard_normal((140, 3))
        way *= 0.5 * near.reach / np.linalg.norm(way, axis=1, keepdims=True)
        axis = generator.standard_normal((140, 3))
        axis *= 0.5 * near.reach / 1.9022 / np.linalg.norm(axis, axis=1, keepdims=True)
        moved, turned = position + way, Rotation.from_rotvec(axis) * rotation
        after = packed_state(layout, moved, turned.as_quat())
        watch.far[:] = 0.0
        ways_of(watch, layout.blocks, after, 0.0, 0, 0, len(layout.blocks.slot))
        # What kernels take for the way is no shorter than that of any vertex.
        assert 0.99 * near.reach < np.sqrt(watch.far[0]) < 1.5 * near.reach
        matrices, before = turned.as_matrix(), rotation.as_matrix()
        pairs = [tuple(pair) for pair in close_pairs(moved, 4.0).tolist()]
        pairs += [(body, -1 - k) for body in range(140) for k in range(2)]
        for pair in pairs:
            if touching(moved, matrices, *pair):
                assert pair in listed
                changed += not touching(position, before, *pair)
    assert changed > 2


@pytest.mark.parametrize('seed', range(2))
def test_few_axes_list_all_that_can_touch_whatever_axes_were_kept(seed):
    generator = np.random.default_rng(seed)
    layout = make_layout(np.zeros((0, 3), np.int32), 140)
    position, rotation = crowd(generator)
    state = packed_state(layout, position, rotation.as_quat())
    lists, fresh = NeighbourList(SETUP, layout), NeighbourList(SETUP, layout)
    for one in (lists, fresh):
        one.survey(state, np.empty(3))
    exact = lists.find(state, 0.05, 0.4)
    found = lists.find(state, 0.05, 0.4, few_axes=True)
    assert found.reach == exact.reach == 0.05
    more = {tuple(pair) for pair in found.pairs.tolist()}
    assert more >= {tuple(pair) for pair in exact.pairs.tolist()}
    assert len(exact.pairs) <= len(found.pairs) < 1.5 * len(exact.pairs)
    np.testing.assert_array_equal(
        fresh.find(state, 0.05, 0.4, few_axes=True).pairs, found.pairs)
    # Where nothing is near the reach is that of all axes.
    apart = packed_state(layout, 3.0 * position, rotation.as_quat())
    reaches = []
    for few_axes in (True, False):
        lists.survey(apart, np.empty(3))
        reaches.append(lists.find(apart, 1e-6, 0.4, few_axes=few_axes))
    assert len(reaches[1].pairs) or reaches[0].reach == reaches[1].reach


def test_lists_are_arranged_by_blocks_slots_and_pairs():
    generator = np.random.default_rng(3)
    layout = make_layout(np.zeros((0, 3), np.int32), 61)
    lists = []
    for _ in range(2):
        pairs = {(int(min(a, b)), int(max(a, b))) for a, b in generator.integers(61, size=(150, 2))
                 if a != b}
        planes = {(int(a), -1 - int(k)) for a, k in generator.integers((61, 3), size=(40, 2))}
        lists.append(np.array(
            sorted(pairs) + sorted(planes, key=lambda pair: (pair[0], -pair[1])), np.int32))
    pairs, others = lists
    which = np.flatnonzero(pairs[:, 1] >= 0)
    slots = np.empty_like(pairs)
    entries = len(pairs) + len(which)
    slot, entry = np.empty(entries, np.int32), np.empty(entries, np.int32)
    start = np.zeros(len(layout.blocks.slot) + 1, np.int32)
    arrange(pairs, layout.slot, layout.blocks.slot, np.empty(layout.slot_count, np.int64), slots,
            start, slot, entry)
    bodies = np.concatenate([pairs[:, 0], pairs[which, 1]])
    number = np.arange(len(pairs))
    numbers = np.concatenate([2 * number, 2 * number[which] + 1])
    order = np.lexsort((numbers, layout.slot[bodies], layout.block_of(bodies)))
    np.testing.assert_array_equal(slot, layout.slot[bodies][order])
    np.testing.assert_array_equal(entry, numbers[order])
    np.testing.assert_array_equal(
        np.diff(start), np.bincount(layout.block_of(bodies), minlength=len(start) - 1))
    np.testing.assert_array_equal(slots[which, 1], layout.slot[pairs[which, 1]])
    here, there = np.empty(len(pairs), np.int64), np.empty(len(pairs), np.int64)
    both = find_both(pairs, others, here, there)
    shared = {tuple(pair) for pair in pairs.tolist()} & {tuple(pair) for pair in others.tolist()}
    assert both == len(shared) > 10
    np.testing.assert_array_equal(pairs[here[:both]], others[there[:both]])


@pytest.mark.parametrize('curve', [0.0, 2.0])
def test_what_may_pass_unseen_in_a_step_is_found_and_no_more(curve):
    # One of twelve moves, on a cubic that is sampled too: what comes closer than two radii is
    # found, and where it goes straight nothing else.
    generator = np.random.default_rng(5)
    radius, count, shift = 1.0, 12, np.zeros((4, 3))
    radii = np.full(count, radius)
    t = np.linspace(0.0, 1.0, 2000)[:, None]
    weights = ((1.0 - t)**3, 3.0 * t * (1.0 - t)**2, 3.0 * t**2 * (1.0 - t), t**3)
    found, nearest, below, lowest = [], [], [], []
    for _ in range(400):
        look = 5.0 * generator.standard_normal((count, 3))
        points = np.broadcast_to(look, (4, count, 3)).copy()
        points[:, 0] += np.arange(4.0)[:, None] * 8.0 * generator.standard_normal(3)
        points[1:, 0] += curve * generator.standard_normal((3, 3))
        path = sum(weight * point for weight, point in zip(weights, points[:, 0]))
        course = Course(points, np.zeros(count))
        apart = np.linalg.norm(path[:, None] - look[1:], axis=2).min(axis=0)
        passing = first_passing(
            course, look, np.zeros((0, 4)), shift, reach=0.5, radius=radii)
        found.append(passing is not None)
        nearest.append(apart.min())
        if passing is not None:
            assert passing.first == 0 and (curve or apart[passing.second - 1] < 2.0 * radius)
        floor = np.array([[0.0, 0.0, 1.0, -20.0]])
        passing = first_passing(
            Course(points[:, :1], np.zeros(1)), look[:1], floor, shift, reach=0.5,
            radius=radii[:1])
        below.append(passing is not None and passing.second == -1)
        lowest.append(path[:, 2].min() - radius)
    found, nearest, below = np.array(found), np.array(nearest), np.array(below)
    assert found[nearest < 2.0 * radius].all() and below[np.array(lowest) < -20.0].all()
    if not curve:
        np.testing.assert_array_equal(found, nearest < 2.0 * radius)
    assert 30 < found.sum() < 300 and 30 < below.sum() < 200


def test_ways_are_those_of_both_rotation_forms_beside_a_moving_frame():
    generator = np.random.default_rng(8)
    position, rotation = crowd(generator, 20)
    turned = Rotation.from_rotvec(1e-2 * generator.standard_normal((20, 3))) * rotation
    common = np.array([3.0, -2.0, 1.0])
    way = 1e-2 * generator.standard_normal((20, 3))
    frame = np.concatenate([[1.0], common / 2.0, np.zeros(3)])
    far = []
    for cosines in (False, True):
        layout = make_layout(np.zeros((0, 3), np.int32), 20, cosines=cosines)
        before = packed_state(layout, position, rotation.as_quat())
        after = packed_state(layout, position + way + common, turned.as_quat())
        watch = make_watch(NeighbourList(SETUP, layout), before, frame)
        # Two seconds later.
        ways_of(watch, layout.blocks, after, 3.0, 0, 0, len(layout.blocks.slot))
        far.append(np.sqrt(watch.far[0]))
    corners = np.linalg.norm(way, axis=1) + 1.9021 * (turned * rotation.inv()).magnitude()
    assert far[0] == pytest.approx(far[1], rel=1e-3)
    assert corners.max() <= far[0] * (1.0 + 1e-9) and far[0] <= 1.5 * corners.max()


def test_longer_reach_where_nothing_is_near():
    layout = make_layout(np.zeros((0, 3), np.int32), 2)
    lists = NeighbourList(SETUP._replace(planes=np.zeros((0, 4))), layout)
    straight = np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
    normal = np.ones(3) / np.sqrt(3.0)
    for gap, reach in ((0.3, 0.15), (5.0, 0.4), (0.09, 0.05)):
        position = np.array([np.zeros(3), (2.0 * 1.511522628152342 + gap) * normal])
        state = packed_state(layout, position, straight)
        lists.survey(state, np.empty(3))
        near = lists.find(state, 0.05, 0.4)
        assert near.reach == pytest.approx(reach, rel=1e-12)
        assert len(near.pairs) == (gap < 0.1)


def slowly_apart(generator, layout, count):
    """Loose bodies at places of a coarse grid, that drift and turn; states at several times."""
    grid = np.stack(np.meshgrid(*[5.0 * np.arange(5)] * 3), axis=-1).reshape(-1, 3)[:count]
    velocity = 0.05 * generator.standard_normal((count, 3))
    spin = 0.03 * generator.standard_normal((count, 3))
    for time in 2.0 * np.arange(8):
        turn = Rotation.from_rotvec(time * spin).as_quat()
        yield time, layout.pack(InitialState(grid + time * velocity, turn, velocity, spin))


@pytest.mark.parametrize('free', [False, True])
def test_kernels_look_as_others_do(free):
    # On the way, with axes and lists of their own; until something is near.
    count = 120
    layout = make_layout(np.zeros((0, 3), np.int32), count)
    setup = SETUP._replace(planes=np.array([[0.0, 0.0, 1.0, -9.0]]), free=free)
    lists, watch = NeighbourList(setup, layout), None
    reaches = []
    for time, state in slowly_apart(np.random.default_rng(6), layout, count):
        fresh = NeighbourList(setup, layout)
        speed = fresh.survey(state, frame := np.empty(3))
        near = fresh.find(state, 0.02, fresh.most)
        if watch is None:
            lists.survey(state, np.empty(3))
            lists.find(state, 0.02, lists.most)
            watch = make_watch(lists, state)
            watch.limits[[MIN_REACH, MAX_REACH, SKIN]] = 0.02, lists.most, lists.skin
            watch.limits[[OWN, MOST_STRIDE]] = 1.0, 8.0
        looked = look_around(watch, state, time, 1e-3)
        assert looked == (not len(near.pairs))
        if looked:
            assert watch.limits[LATE] == near.reach**2
            assert watch.limits[SPEED] == speed
            assert np.array_equal(watch.frame, [time, *frame, 0.0, 0.0, 0.0])
            assert np.array_equal(watch.reference, state.position)
            assert np.array_equal(watch.turned, state.orientation)
            reaches.append(near.reach)
    assert len(set(reaches)) > 3


def test_kernels_do_not_look_where_steps_must_follow_or_lists_have_no_room():
    layout = make_layout(np.zeros((0, 3), np.int32), 27)
    setup = SETUP._replace(planes=np.zeros((0, 4)))
    lists = NeighbourList(setup, layout)
    (_, state), (_, later), *_ = slowly_apart(np.random.default_rng(7), layout, 27)
    lists.survey(state, np.empty(3))
    near = lists.find(state, 0.02, lists.most)
    watch = make_watch(lists, state)
    watch.limits[[MIN_REACH, MAX_REACH, SKIN, OWN]] = 0.02, lists.most, lists.skin, 1.0
    longest = near.reach / 3.0 / lists.survey(state, np.empty(3))
    assert not look_around(watch, state, 0.0, 1.01 * longest)
    assert look_around(watch, state, 0.0, 0.99 * longest)
    watch.limits[OWN] = 0.0
    assert not look_around(watch, later, 2.0, 1e-3)
    watch.limits[OWN] = 1.0
    assert look_around(watch, later, 2.0, 1e-3)
    # All bodies elsewhere, in a dense pile: more pairs than there is room for.
    dense = InitialState(
        np.random.default_rng(1).uniform(0.0, 9.0, (27, 3)),
        *(layout.gather(part) for part in state.rows()[1:]))
    before = watch.reference.copy()
    assert not look_around(watch, layout.pack(dense), 3.0, 1e-3)
    assert np.array_equal(watch.reference, before)
    state.position[0, layout.slot[0]] = np.nan
    assert not look_around(watch, state, 4.0, 1e-3)


def test_a_gently_moving_fabric_near_the_least_angle_computes_no_contact():
    # Spheres around the shells overlap here.
    least = np.arccos(np.sqrt(0.6) ** -1 / np.sqrt(2.0)) - np.pi / 4.0
    states = []
    for mode in ('auto', 'never'):
        scene = make_scene((3, 3, 3), {
            'weave.connector_angle': least + np.radians(1.0), 'contact.mode': mode,
            'solver.method': 'srkn4', 'initial_random.velocity_sigma': 0.001,
            'initial_random.spin_sigma': 0.1})
        nearest = np.sqrt(2.0) * scene.geometry.pitch
        assert 2.0 * 1.5115 < nearest / scene.geometry.half_edge < 2.0 * 1.9021
        simulation = ico.compile_scene(scene)
        simulation.advance_to(0.03)
        assert simulation.status.contact_tests == simulation.status.contact_count == 0
        assert simulation.status.step_count > 10
        states.append(simulation.snapshot())
    assert np.array_equal(states[0].position, states[1].position)
    assert np.array_equal(states[0].orientation, states[1].orientation)
    assert np.abs(states[0].position - scene.position).max() > 1e-5
