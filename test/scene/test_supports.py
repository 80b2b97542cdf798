# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0

from fabrics import FORMS, make_scene
import icofabric_sim as ico
import numpy as np
import pytest

GRAVITY = [1.0, -2.0, -9.81]
HELD = {
    'tx': [0],
    'ty': [1],
    'tz': [2],
    'tx ty': [0, 1],
    'tz tx': [0, 2],
    'rotation': [],
    'tx ty tz rotation': [0, 1, 2],
    'all': [0, 1, 2],
    'ty rotation': [1],
}


def shaken(fix):
    """Fabric under gravity, random motion and a load on a held body."""
    return make_scene(
        (3, 2, 2),
        {
            'gravity': GRAVITY,
            'groups.held': 'ids 0 4',
            'supports.s.group': 'held',
            'supports.s.fix': fix,
            'initial_random.velocity_sigma': 0.3,
            'initial_random.spin_sigma': 30.0,
            'contact.mode': 'never',
            'loads.l.group': 'held',
            'loads.l.force': [1.0, 2.0, 3.0],
            'loads.l.torque': [0.01, 0.0, -0.01],
            'loads.l.point': [0.0, 0.01, 0.0],
        },
    )


@pytest.mark.parametrize('form', FORMS)
@pytest.mark.parametrize('fix', HELD)
def test_held_freedoms_do_not_move_by_a_bit(fix, form):
    scene = shaken(fix)
    simulation = ico.compile_scene(scene, rotation=form)
    start = simulation.snapshot()
    simulation.advance_to(0.05)
    s = simulation.snapshot()
    axes = HELD[fix]
    free = [axis for axis in range(3) if axis not in axes]
    for body in (0, 4):
        assert np.array_equal(s.position[body, axes], scene.initial.position[body, axes])
        assert not s.linear_velocity[body, axes].any()
        if free:
            assert np.abs(s.position[body, free] - scene.initial.position[body, free]).min() > 1e-4
        if 'rotation' in fix or fix == 'all':
            assert np.array_equal(s.orientation[body], start.orientation[body])
            assert not s.angular_velocity[body].any()
        else:
            assert np.abs(s.orientation[body] - start.orientation[body]).max() > 1e-2
    others = [body for body in range(scene.body_count) if body not in (0, 4)]
    assert np.abs(s.position - scene.initial.position)[others].min(axis=1).max() > 1e-4
    assert np.abs(s.angular_velocity[others]).min() > 0.0


def test_several_supports_add_up():
    scene = make_scene(
        (3, 2, 2),
        {
            'groups.a': 'ids 0 1',
            'groups.b': 'ids 1 2',
            'supports.one.group': 'a',
            'supports.one.fix': 'tx',
            'supports.two.group': 'b',
            'supports.two.fix': 'tz rotation',
        },
    )
    translation, rotation = scene.supports
    assert translation[:4].tolist() == [
        [True, False, False],
        [True, False, True],
        [False, False, True],
        [False, False, False],
    ]
    assert rotation[:4].tolist() == [False, True, True, False]
    assert make_scene((2, 2, 2)).supports is None


@pytest.mark.parametrize('fix', ['', 'tx, ty', 'x', 'TX', 'none'])
def test_unknown_freedoms_are_refused(fix):
    with pytest.raises(
        ico.ParameterError, match='supports.s.fix must name some of tx ty tz rotation, or all'
    ):
        make_scene((2, 2, 2), {'supports.s.group': 'all', 'supports.s.fix': fix})


@pytest.mark.parametrize('fix', ['rx', 'tx all ry'])
def test_single_rotations_are_refused(fix):
    with pytest.raises(ico.ParameterError, match='a single component of the angular velocity'):
        make_scene((2, 2, 2), {'supports.s.group': 'all', 'supports.s.fix': fix})


def test_held_bodies_take_no_part_in_the_random_start_but_leave_the_others_theirs():
    free = make_scene(
        (3, 2, 2), {'initial_random.velocity_sigma': 1.0, 'initial_random.spin_sigma': 2.0}
    )
    held = make_scene(
        (3, 2, 2),
        {
            'initial_random.velocity_sigma': 1.0,
            'initial_random.spin_sigma': 2.0,
            'groups.h': 'ids 1',
            'supports.s.group': 'h',
            'supports.s.fix': 'ty rotation',
        },
    )
    expected = free.initial.linear_velocity.copy()
    expected[1, 1] = 0.0
    assert np.array_equal(held.initial.linear_velocity, expected)
    expected = free.initial.angular_velocity.copy()
    expected[1] = 0.0
    assert np.array_equal(held.initial.angular_velocity, expected)


@pytest.mark.parametrize(
    'field, value', [('linear_velocity', [0.0, 1.0, 0.0]), ('angular_velocity', [1.0, 0.0, 0.0])]
)
def test_initial_motion_of_a_held_freedom_is_refused(field, value):
    with pytest.raises(
        ico.ParameterError, match=f'initial.i.{field} moves body 2, which a support holds'
    ):
        make_scene(
            (3, 2, 2),
            {
                'groups.h': 'ids 2 3',
                'supports.s.group': 'h',
                'supports.s.fix': 'ty rotation',
                'initial.i.group': 'all',
                f'initial.i.{field}': value,
            },
        )
    scene = make_scene(
        (3, 2, 2),
        {
            'groups.h': 'ids 2 3',
            'supports.s.group': 'h',
            'supports.s.fix': 'ty',
            'initial.i.group': 'all',
            'initial.i.linear_velocity': [1.0, 0.0, 2.0],
        },
    )
    assert np.array_equal(scene.initial.linear_velocity[2], [1.0, 0.0, 2.0])


def test_set_state_and_reset_leave_held_freedoms_at_rest():
    simulation = ico.compile_scene(shaken('tx rotation'))
    count = simulation.scene.body_count
    simulation.set_state(linear_velocity=np.ones((count, 3)), angular_velocity=np.ones((count, 3)))
    s = simulation.snapshot()
    assert s.linear_velocity[0].tolist() == [0.0, 1.0, 1.0]
    assert not s.angular_velocity[0].any() and s.angular_velocity[1].all()
    # Where a held body is may be set; from there on it is held.
    position = s.position + 0.001
    simulation.set_state(position=position)
    simulation.advance_to(0.01)
    assert simulation.snapshot().position[0, 0] == position[0, 0]
    assert simulation.snapshot().position[1, 0] != position[1, 0]


def test_hanging_slab_hangs():
    scene = make_scene(
        (3, 3, 3),
        {
            'gravity': [0.0, 0.0, -9.81],
            'groups.top': 'z_max',
            'supports.c.group': 'top',
            'contact.mode': 'never',
        },
    )
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.2)
    s = simulation.snapshot()
    top = scene.groups['top']
    below = np.setdiff1d(np.arange(scene.body_count), top)
    assert np.array_equal(s.position[top], scene.position[top])
    sunk = scene.position[below, 2] - s.position[below, 2]
    assert 0.001 < sunk.mean() < 0.05
    assert np.abs(s.position[below] - scene.position[below]).max() < 0.05
