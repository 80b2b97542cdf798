# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Bodies as named entities: found by name, place and group, and put elsewhere during a run."""
import ctypes
import math
import random

from driven_runs import Drive
import icofabric_sim as ico
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.running.entities import (
    Box,
    checked_parts,
    Entities,
    Query,
    set_body_state,
    Sphere,
)
from icofabric_sim.running.name_filter import name_filter
from icofabric_sim.running.replay.verify import verify_run
import numpy as np
import pytest
from recorded_runs import swing_scene
from runner_helpers import Beside


@pytest.fixture(scope='module')
def scene():
    return swing_scene()


def test_numbers_and_names(scene):
    entities = Entities(scene)
    assert entities.number('icosahedron_0') == 0
    assert entities.number(f'icosahedron_{scene.body_count - 1}') == scene.body_count - 1
    for name in ('', 'icosahedron', 'icosahedron_00', f'icosahedron_{scene.body_count}',
                 'icosahedron_1 ', 'icosahedron_\u0661', 'icosahedron_99999999999999'):
        with pytest.raises(KeyError, match='unknown entity'):
            entities.number(name)


def test_queries_add_up(scene):
    entities, position = Entities(scene), scene.position
    everyone = list(range(scene.body_count))
    assert entities.select(Query(), position) == everyone
    wall, tip = scene.groups['wall'].tolist(), scene.groups['tip'].tolist()
    assert entities.held[wall].all() and entities.held.sum() == len(wall)
    assert entities.select(Query(tags=('wall',), held=False), position) == []
    assert entities.select(Query(tags=('wall', 'tip'), expression='_[0-9]$'), position) == [
        body for body in sorted(wall + tip) if body < 10]
    near = Sphere(position[tip[0]], 0.0)
    assert entities.select(Query(bounds=near, tags=('tip',)), position) == [tip[0]]


def test_distance_to_bounds():
    points = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 2.0, 2.0]])
    sphere = Sphere(np.zeros(3), 1.0).distance(points)
    np.testing.assert_allclose(sphere, [0.0, 1.0, math.sqrt(12.0) - 1.0], rtol=1e-15)
    box = Box(np.full(3, -1.0), np.full(3, 1.0)).distance(points)
    np.testing.assert_allclose(box, [0.0, 1.0, math.sqrt(3.0)], rtol=1e-15)


@pytest.mark.parametrize(('expression', 'expected'), [
    ('', 20), ('_1', 11), ('_1$', 1), ('^icosahedron_(3|7)$', 2), ('_[0-9]$', 10), ('ICO', 0),
    ('icosahedron_1{2}$', 1), ('.*', 20), ('[^a-z_]$', 20), ('_(1|2)[0-5]+$', 6), (r'\.', 0)])
def test_names_match_as_posix_says(expression, expected):
    matches = name_filter(expression)
    assert sum(matches(f'icosahedron_{number}') for number in range(20)) == expected


@pytest.mark.parametrize('expression', [
    '(', 'a{2', '[[:digit:]]', '*a**(', '(a)\\1', 'a' * 201, 'a{100}', 'a\\w', 'a{3,2}', '[z-a]',
    'a**', 'a*?', '(?i)a', '^*', '(ab)*', '[a--b]', '[a&&b]', '((a+)+)+$', '(.*)*(.*)*(.*)*x'])
def test_expressions_that_are_not_valid_or_too_much(expression):
    with pytest.raises(ValueError, match='regular expression|too complex'):
        name_filter(expression)


@pytest.fixture(scope='module')
def posix():
    """What the C library says: whether a name matches, None where it refuses the expression."""
    library = ctypes.CDLL(None)

    def ask(expression, name):
        compiled = ctypes.create_string_buffer(256)
        if library.regcomp(compiled, expression.encode(), 1 | 8):  # extended, no positions
            return None
        found = library.regexec(compiled, name.encode(), 0, None, 0) == 0
        library.regfree(compiled)
        return found

    return ask


def test_what_is_taken_means_the_same_to_the_c_library(posix):
    generator, taken, hits = random.Random(2026), 0, 0
    pieces = [*'icosahedron_0123456789', *'.*+?|()^$[]{}-,', '[0-9]', '[^a]', '[]a]', '{2}',
              '{1,3}', '_1', r'\.', r'\$', '(', ')', '.*', 'x', ' ', 'é']
    for _ in range(30_000):
        expression = ''.join(generator.choices(pieces, k=generator.randrange(1, 8)))
        try:
            matches = name_filter(expression)
        except ValueError:
            continue
        taken += 1
        for name in ('icosahedron_0', 'icosahedron_11', 'icosahedron_2025'):
            assert matches(name) is posix(expression, name), (expression, name)
            hits += matches(name)
    assert taken > 5000 and hits > 2000


@pytest.mark.parametrize(
    'expression', ['.*.*.*!', '(.|.|.|.)(.|.|.|.)(.|.|.|.)!', '.{0,99}.{0,99}.{0,99}!'])
def test_the_slowest_expressions_come_to_an_end(expression):
    matches = name_filter(expression)
    assert not any(matches(f'icosahedron_{number}') for number in range(1000))


@pytest.mark.parametrize(('given', 'words'), [
    ({'position': [0.0, 1.0]}, '3 finite numbers'),
    ({'orientation': [0.0, 0.0, 0.0, math.nan]}, 'orientation must be 4 finite'),
    ({'angular_velocity': [0.0, math.inf, 0.0]}, 'inf')])
def test_parts_that_make_no_sense(given, words):
    with pytest.raises(ValueError, match=words):
        checked_parts(given)


def test_other_bodies_stay_as_they_are(scene):
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.05)
    before = simulation.snapshot()
    set_body_state(
        simulation, 5, {'position': [1.0, 2.0, 3.0], 'linear_velocity': [4.0, 5.0, 6.0]})
    after = simulation.snapshot()
    assert after.position[5].tolist() == [1.0, 2.0, 3.0]
    assert after.linear_velocity[5].tolist() == [4.0, 5.0, 6.0]
    others = np.arange(scene.body_count) != 5
    for name in ('position', 'orientation', 'linear_velocity', 'angular_velocity'):
        assert (getattr(before, name)[others] == getattr(after, name)[others]).all()
    assert (after.orientation == before.orientation).all() and after.time == before.time


def test_run_in_which_a_body_was_put_elsewhere_verifies(tmp_path):
    parts = {'position': [0.11, 0.013, -0.007], 'angular_velocity': [0.1, 1 / 3, -2.0]}
    scene = swing_scene()
    body = int(scene.groups['tip'][0])

    def put(drive):
        drive.answers.append(drive.runner.set_body_state(body, parts))

    Drive(tmp_path / 'bag', scene, [(101, put), (203, put)]).run()
    with RecordedRun(tmp_path / 'bag') as run:
        result = verify_run(run)
    assert result.verdict == 'identical', result.lines()
    assert result.repeated['states set'] == 2


def test_state_that_cannot_be_leaves_the_run_as_it_was(scene):
    from icofabric_sim.running.runner import Runner

    runner = Runner(ico.compile_scene(scene), [])
    runner.state.paused = True
    with Beside(runner):
        before = runner.post(runner.simulation.checkpoint).result(60.0)
        for parts in ({'position': [1e200, 0.0, 0.0]}, {'orientation': [0.0, 0.0, 0.0, 0.5]},
                      {'linear_velocity': [1e200, 0.0, 0.0]}):
            with pytest.raises(ValueError, match='body 1'):
                runner.set_body_state(1, parts).result(60.0)
        after = runner.post(runner.simulation.checkpoint).result(60.0)
        assert not before.difference(after) and not runner.failure
