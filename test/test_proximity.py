# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.

import logging

from fabrics import changed, make_scene, warnings_said
import icofabric_sim as ico
from icofabric_sim.icosahedron import TAU
from icofabric_sim.layout import make_layout
from icofabric_sim.proximity import ProximityWatch
import numpy as np
import pytest
from scipy.spatial.distance import pdist, squareform


def closest(position):
    distance = squareform(pdist(position))
    np.fill_diagonal(distance, np.inf)
    pair = np.unravel_index(np.argmin(distance), distance.shape)
    return tuple(sorted(int(b) for b in pair)), distance.min()


class Watched(ProximityWatch):
    """
    A watch that is told of bodies first.
    """

    def __init__(self, limit, count):
        self.layout = make_layout(np.zeros((0, 3), np.int32), count)
        super().__init__(limit, self.layout)

    def look(self, time, position):
        super().look(time, self.layout.spread(position))


@pytest.mark.parametrize('seed', range(20))
@pytest.mark.parametrize('count', [2, 3, 50, 400])
def test_watch_finds_the_closest_pair(seed, count):
    position = np.random.default_rng(seed).uniform(0.0, 10.0, (count, 3))
    pair, distance = closest(position)
    watch = Watched(0.999 * distance, count)
    watch.look(1.0, position)
    assert watch.found is None
    assert 0.0 < watch.reach < distance
    assert np.array_equal(watch.layout.gather(watch.reference), position)
    watch = Watched(1.001 * distance, count)
    watch.look(2.0, position)
    assert (watch.found.first, watch.found.second) == pair
    assert watch.found.distance == pytest.approx(distance, rel=1e-12)
    assert watch.found.time == 2.0


@pytest.mark.parametrize('seed', range(10))
def test_nothing_comes_closer_before_a_body_has_moved_by_the_reach(seed):
    generator = np.random.default_rng(seed)
    position = generator.uniform(0.0, 10.0, (60, 3))
    watch = Watched(0.3 * closest(position)[1], 60)
    watch.look(0.0, position)
    for _ in range(50):
        way = generator.standard_normal(position.shape)
        way *= watch.reach / np.linalg.norm(way, axis=1, keepdims=True)
        # The common way counts for nothing.
        assert closest(position + way + [5.0, -3.0, 1.0])[1] > watch.limit


def test_bodies_in_one_place_are_found():
    position = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0], [1.0, 0, 0]])
    watch = Watched(0.5, 4)
    watch.look(0.0, position)
    assert (watch.found.first, watch.found.second, watch.found.distance) == (1, 3, 0.0)


def test_single_body_has_nothing_to_watch():
    watch = Watched(0.5, 1)
    watch.look(0.0, np.zeros((1, 3)))
    assert watch.found is None and watch.reach == np.inf


def first_overlap(scene, duration, interval):
    """
    First time that two centres are closer than the limit, to within `interval` [s].
    """
    limit = 2.0 * scene.geometry.half_edge * TAU**2 / np.sqrt(3.0)
    simulation = ico.compile_scene(changed(scene, {'contact.mode': 'never'}))
    for time in np.arange(0.0, duration, interval):
        simulation.advance_to(time)
        pair, distance = closest(simulation.snapshot().position)
        if distance < limit:
            return time, pair, limit
    return None, None, limit


@pytest.mark.parametrize('seed', range(3))
def test_run_warns_once_with_bodies_and_time(seed, caplog):
    scene = make_scene(
        (3, 3, 3),
        {
            'initial_random.velocity_sigma': 0.5,
            'initial_random.spin_sigma': 50.0,
            'initial_random.seed': seed,
        },
    )
    time, pair, limit = first_overlap(scene, 0.2, 1e-4)
    simulation = ico.compile_scene(scene)
    with caplog.at_level(logging.WARNING):
        simulation.advance_to(0.2)
    found = simulation.proximity
    assert time is not None and found is not None
    # Looked at every eight steps.
    assert time - 1e-4 <= found.time <= time + 9 * simulation.step
    assert (found.first, found.second) == pair
    assert 0.9 * limit < found.distance < limit == pytest.approx(found.limit, rel=1e-14)
    assert len(warnings_said(caplog)) == 1
    text = warnings_said(caplog)[0]
    assert (
        f'bodies {pair[0]} and {pair[1]} came within' in text and 'contact is not computed' in text
    )
    simulation.advance_to(0.5)
    assert len(warnings_said(caplog)) == 1
    assert simulation.proximity == found


def test_watching_does_not_touch_the_motion():
    scene = make_scene(
        (3, 3, 3), {'initial_random.velocity_sigma': 0.5, 'initial_random.spin_sigma': 50.0}
    )
    states = []
    for mode in ('auto', 'never'):
        simulation = ico.compile_scene(changed(scene, {'contact.mode': mode}))
        simulation.advance_to(0.1)
        states.append(simulation.snapshot())
        assert (simulation.proximity is None) == (mode == 'never')
    assert np.array_equal(states[0].position, states[1].position)
    assert np.array_equal(states[0].orientation, states[1].orientation)


@pytest.mark.parametrize('speed', [0.1, 1.0, 3.0])
def test_loose_body_that_flies_into_another_is_seen(speed):
    scene = make_scene(
        (1, 1, 1),
        {'bodies.p.position': [-0.1, 0.01, 0.0], 'bodies.p.linear_velocity': [speed, 0.0, 0.0]},
    )
    simulation = ico.compile_scene(scene)
    limit = 2.0 * scene.geometry.half_edge * TAU**2 / np.sqrt(3.0)
    contact = (0.1 - np.sqrt(limit**2 - 0.01**2)) / speed
    simulation.advance_to(0.2 / speed)
    assert simulation.proximity is not None
    assert contact <= simulation.proximity.time <= contact + simulation.step


def test_nothing_is_found_where_bodies_part():
    scene = make_scene(
        (2, 2, 2),
        {
            'weave.connected': False,
            'groups.one': 'ids 0',
            'initial.i.group': 'one',
            'initial.i.linear_velocity': [-1.0, -1.0, -1.0],
        },
    )
    simulation = ico.compile_scene(scene)
    simulation.advance_to(2.0)
    assert simulation.proximity is None
    assert simulation.snapshot().position[0, 0] < -1.9
