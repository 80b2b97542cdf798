# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0

from analytical import quaternion_product, rotation_distance, rotation_quaternion
from fabrics import changed, make_scene
import icofabric_sim as ico
import numpy as np
import pytest


def test_woven_rest_state_is_at_rest():
    scene = make_scene((3, 3, 3))
    assert np.array_equal(scene.initial.position, scene.position)
    assert np.array_equal(scene.initial.orientation, scene.orientation)
    assert not scene.initial.linear_velocity.any() and not scene.initial.angular_velocity.any()
    simulation = ico.compile_scene(scene)
    simulation.advance_to(0.1)
    np.testing.assert_allclose(simulation.snapshot().position, scene.position, rtol=0, atol=1e-14)


def test_what_is_given_is_added_to_the_rest_state():
    rotation = [0.3, -1.2, 0.5]
    scene = make_scene(
        (3, 2, 2),
        {
            'groups.some': 'ids 1 4',
            'initial.a.group': 'some',
            'initial.a.displacement': [0.001, 0.002, -0.003],
            'initial.a.rotation': rotation,
            'initial.a.linear_velocity': [1.0, 2.0, 3.0],
            'initial.a.angular_velocity': [-1.0, 0.5, 4.0],
            'initial.b.group': 'all',
            'initial.b.linear_velocity': [0.0, 0.0, 10.0],
        },
    )
    initial, others = scene.initial, [0, 2, 3, 5]
    np.testing.assert_allclose(
        initial.position[[1, 4]] - scene.position[[1, 4]], [[0.001, 0.002, -0.003]] * 2, rtol=1e-12
    )
    expected = quaternion_product(rotation_quaternion(rotation), scene.orientation[1])
    assert rotation_distance(initial.orientation[[1, 4]], expected).max() < 1e-15
    assert np.array_equal(initial.linear_velocity[1], [1.0, 2.0, 13.0])
    assert np.array_equal(initial.angular_velocity[4], [-1.0, 0.5, 4.0])
    assert np.array_equal(initial.position[others], scene.position[others])
    assert np.array_equal(initial.orientation[others], scene.orientation[others])
    assert (initial.linear_velocity[others] == [0.0, 0.0, 10.0]).all()
    assert not initial.angular_velocity[others].any()


def test_rotation_turns_about_world_axes_through_each_centre():
    # In variant 2 the bodies are woven turned by 90 degrees about z: their axis x is world y.
    scene = make_scene(
        (2, 2, 2),
        {
            'weave.variant': 2,
            'initial.i.group': 'all',
            'initial.i.rotation': [np.pi / 2, 0.0, 0.0],
        },
    )
    s = ico.compile_scene(scene).snapshot()
    # Body x is world y in the weave, and world z after a quarter turn about world x.
    x, y, z, w = s.orientation[0]
    body_x = [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)]
    np.testing.assert_allclose(body_x, [0.0, 0.0, 1.0], atol=1e-15)
    assert np.array_equal(s.position, scene.position)


def test_several_rotations_are_applied_in_the_order_of_their_names():
    first, second = [0.7, 0.0, 0.0], [0.0, -0.4, 1.0]
    scene = make_scene(
        (1, 1, 1),
        {
            'initial.b.group': 'all',
            'initial.b.rotation': second,
            'initial.a.group': 'all',
            'initial.a.rotation': first,
        },
    )
    expected = quaternion_product(rotation_quaternion(second), rotation_quaternion(first))
    assert rotation_distance(scene.initial.orientation, expected).max() < 1e-15


@pytest.mark.parametrize('angle', [1e-12, 1e-3, 3.0, 2 * np.pi, 50.0])
def test_rotation_vector_of_any_length(angle):
    scene = make_scene(
        (1, 1, 1), {'initial.a.group': 'all', 'initial.a.rotation': [0.0, angle, 0.0]}
    )
    np.testing.assert_allclose(
        scene.initial.orientation[0],
        [0.0, np.sin(angle / 2), 0.0, np.cos(angle / 2)],
        rtol=1e-14,
        atol=1e-15,
    )


def test_random_start_has_the_same_numbers_everywhere():
    scene = make_scene(
        (2, 2, 2),
        {
            'initial_random.velocity_sigma': 2.0,
            'initial_random.spin_sigma': 4.0,
            'initial_random.seed': 7,
        },
    )
    velocity, spin = scene.initial.linear_velocity, scene.initial.angular_velocity
    # Written down once: NumPy's MT19937 with the legacy normal deviates, in single precision.
    # Two and four times such a number is exact.
    assert velocity[0].tolist() == [3.3810513019561768, -0.9318747520446777, 0.06564033031463623]
    assert spin[3].tolist() == [0.6173421144485474, -1.5485597848892212, 8.116289138793945]
    # One sigma does not change the numbers of the other, and each only scales.
    alone = make_scene(
        (2, 2, 2), {'initial_random.spin_sigma': 1.0, 'initial_random.seed': 7}
    ).initial
    assert not alone.linear_velocity.any()
    assert np.array_equal(4.0 * alone.angular_velocity, spin)
    other = changed(scene, {'initial_random.seed': 8}).initial
    assert (other.linear_velocity != velocity).all()


def test_random_start_has_the_deviation_asked_for():
    scene = make_scene(
        (11, 11, 11), {'initial_random.velocity_sigma': 0.3, 'initial_random.spin_sigma': 20.0}
    )
    for values, sigma in (
        (scene.initial.linear_velocity, 0.3),
        (scene.initial.angular_velocity, 20.0),
    ):
        assert values.std() == pytest.approx(sigma, rel=0.05)
        assert abs(values.mean()) < 0.05 * sigma
        assert np.array_equal(values / sigma, (values / sigma).astype(np.float32)) or sigma != 1.0


def test_loose_bodies_come_after_the_weave_in_the_order_of_their_names():
    scene = make_scene(
        (2, 2, 2),
        {
            'bodies.z.position': [1.0, 0.0, 0.0],
            'bodies.a.position': [0.0, 2.0, 0.0],
            'bodies.a.orientation': [0.0, 0.6, 0.0, 0.8],
            'bodies.a.linear_velocity': [0.0, -3.0, 0.0],
            'bodies.z.angular_velocity': [0.0, 0.0, 5.0],
        },
    )
    assert scene.body_count == 6
    assert scene.position[4:].tolist() == [[0.0, 2.0, 0.0], [1.0, 0.0, 0.0]]
    np.testing.assert_allclose(scene.orientation[4], [0.0, 0.6, 0.0, 0.8], rtol=1e-15)
    assert scene.initial.linear_velocity[4].tolist() == [0.0, -3.0, 0.0]
    assert scene.initial.angular_velocity[5].tolist() == [0.0, 0.0, 5.0]
    assert scene.connectors.bodies.max() == 3
    simulation = ico.compile_scene(scene)
    assert simulation.status.method_name == 'dop8'  # for the speed of a loose body
    simulation.advance_to(0.1)
    s = simulation.snapshot()
    np.testing.assert_allclose(
        s.position[4:], [[0.0, 1.7, 0.0], [1.0, 0.0, 0.0]], rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(
        s.orientation[5], [0.0, 0.0, np.sin(0.25), np.cos(0.25)], rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(s.position[:4], scene.position[:4], rtol=0, atol=1e-10)


def test_orientation_of_a_loose_body_must_be_a_unit_quaternion():
    nearly = make_scene(
        (1, 1, 1),
        {'bodies.a.position': [1.0, 0.0, 0.0], 'bodies.a.orientation': [0.0, 0.6002, 0.0, 0.8]},
    )
    assert np.linalg.norm(nearly.orientation[1]) == pytest.approx(1.0, abs=1e-15)
    for bad in ([0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.01], [1.0, 1.0, 0.0, 0.0]):
        with pytest.raises(
            ico.ParameterError, match='bodies.a.orientation must be a unit quaternion x y z w'
        ):
            make_scene(
                (1, 1, 1), {'bodies.a.position': [1.0, 0.0, 0.0], 'bodies.a.orientation': bad}
            )


def test_motion_of_a_held_loose_body_is_refused():
    with pytest.raises(
        ico.ParameterError, match='bodies.a.linear_velocity moves body 1, which a support holds'
    ):
        make_scene(
            (1, 1, 1),
            {
                'bodies.a.position': [1.0, 0.0, 0.0],
                'bodies.a.linear_velocity': [1.0, 0.0, 0.0],
                'supports.s.group': 'all',
            },
        )


def test_state_of_one_run_is_the_start_of_another(tmp_path):
    fabric = {'supports.wall.group': 'wall', 'groups.wall': 'x_min', 'gravity': [0.0, 0.0, -9.81]}
    run = ico.compile_scene(make_scene((3, 2, 2), fabric))
    run.advance_to(0.05)
    state = run.snapshot()
    state.to_csv(tmp_path / 'state.csv')
    start = {'initial.all.group': 'all', 'initial.all.file': str(tmp_path / 'state.csv')}
    initial = make_scene((3, 2, 2), fabric | start).initial
    for name in ('position', 'orientation', 'linear_velocity', 'angular_velocity'):
        assert np.array_equal(getattr(initial, name), getattr(state, name)), name
    assert np.abs(initial.angular_velocity).max() > 1e-3
    # What is added is added to it, and what the table lacks stays as it is woven.
    (tmp_path / 'some.csv').write_text(
        '# of two bodies\nbody,qx,qy,qz,qw,wx_body_rad_s,wy_body_rad_s,wz_body_rad_s\n'
        '4,0,0,0.6,0.8,1,0,0\n\n1,0,0,0,1,0,2,0\n')
    scene = make_scene((3, 2, 2), {
        'groups.two': 'ids 1 4', 'initial.two.group': 'two',
        'initial.two.file': str(tmp_path / 'some.csv'),
        'initial.two.angular_velocity': [0.0, 0.0, 5.0]})
    assert np.array_equal(scene.initial.position, scene.position)
    assert np.array_equal(scene.initial.orientation[4], [0.0, 0.0, 0.6, 0.8])
    # A turn about z with the cosine 0.28 and the sine 0.96.
    np.testing.assert_allclose(
        scene.initial.angular_velocity[[4, 1]], [[0.28, 0.96, 5.0], [0.0, 2.0, 5.0]], atol=1e-15)
    assert not scene.initial.angular_velocity[[0, 2, 3, 5]].any()


@pytest.mark.parametrize(('text', 'message'), [
    ('body,x_m,y_m\n1,0,0\n', 'line 1, must name the column body and one or more of these sets'),
    ('x_m,y_m,z_m\n0,0,0\n', 'line 1, must name the column body'),
    ('body\n1\n', 'line 1, must name the column body'),
    ('body,x_m,y_m,z_m\n1,0,0\n', 'line 2, must be 4 finite numbers'),
    ('body,x_m,y_m,z_m\n1,0,0,nan\n', 'line 2, must be 4 finite numbers'),
    ('body,x_m,y_m,z_m\n', 'has no line of numbers'),
    ('body,x_m,y_m,z_m\n1.5,0,0,0\n', 'body numbers must be integers without repetition'),
    ('body,x_m,y_m,z_m\n1,0,0,0\n1,0,0,0\n', 'body numbers must be integers without repetition'),
    ('body,x_m,y_m,z_m\n1e300,0,0,0\n', 'body numbers must be integers without repetition'),
    ('body,x_m,y_m,z_m\n6,0,0,0\n', 'has body 6, which is not in the group all'),
    ('body,x_m,y_m,z_m\n-1,0,0,0\n', 'has body -1, which is not in the group all'),
    ('body,qx,qy,qz,qw\n1,0,0,0,2\n', 'got length 2 for body 1'),
    ('body,vx_m_s,vy_m_s,vz_m_s\n1,2,0,0\n\n0,0,0.5,0\n',
     'state.csv, line 4, column vy_m_s: 0.5 m/s of body 0: a support holds'),
    ('body,wx_body_rad_s,wy_body_rad_s,wz_body_rad_s\n0,0,0,2\n',
     'line 2, column wz_body_rad_s: 2 rad/s of body 0: a support holds'),
    ('body,wx_rad_s,wy_rad_s,wz_rad_s\n1,-1e300,0,0\n',
     r'column wx_rad_s: -1e\+300 rad/s of body 1: time steps resolve 1e\+09 rad/s at most'),
    # Python's float takes these for 10 and for 1.
    ('body,x_m,y_m,z_m\n1,1_0,0,0\n', 'line 2, must be 4 finite numbers'),
    ('body,x_m,y_m,z_m\n1,\u0661,0,0\n', 'line 2, must be 4 finite numbers'),
    ('body,wx_rad_s,wy_rad_s,wz_rad_s,wx_body_rad_s,wy_body_rad_s,wz_body_rad_s\n'
     '1,1,0,0,1,0,0\n2,1,0,0,0,1,0\n', 'has two spins for body 2'),
])
def test_tables_that_give_no_state_are_refused(tmp_path, text, message):
    (tmp_path / 'state.csv').write_text(text, encoding='utf-8')
    with pytest.raises(ico.ParameterError, match=r'initial\.it\.file: .*' + message):
        make_scene((3, 2, 2), {
            'supports.wall.group': 'wall', 'groups.wall': 'ids 0',
            'initial.it.group': 'all', 'initial.it.file': str(tmp_path / 'state.csv')})


_SINE = {'drives.d.group': 'g', 'drives.d.motion': 'sine', 'drives.d.frequency': 2.0}


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('name, value, limit', [
    ('initial.it.linear_velocity', [0.0, 1e300, 0.0], '1e[+]07 m/s'),
    ('initial.it.angular_velocity', [-1e300, 0.0, 0.0], '1e[+]09 rad/s'),
    ('bodies.b.linear_velocity', [1e8, 0.0, 0.0], '1e[+]07 m/s'),
    ('bodies.b.angular_velocity', [1e10, 0.0, 0.0], '1e[+]09 rad/s'),
    ('initial_random.velocity_sigma', 1e300, '1e[+]07 m/s'),
    ('initial_random.spin_sigma', 1e308, '1e[+]09 rad/s'),
    ('anchors.tie.velocity', [0.0, 0.0, 1e300], '1e[+]07 m/s'),
    ('drives.d.linear', [1e6, 0.0, 0.0], '795775 m'),
    ('drives.d.frequency', 1e300, '1.59155e[+]08 Hz'),
])
def test_what_moves_faster_than_steps_can_follow_is_refused(name, value, limit):
    scene = make_scene((3, 2, 2), {
        'groups.g': 'x_max', 'initial.it.group': 'all', 'bodies.b.position': [0.0, 0.0, 0.5],
        'anchors.tie.position': [0.0, 0.0, 0.1], **(_SINE if 'drives' in name else {})})
    with pytest.raises(ico.ParameterError, match=(
            f'{name} .*: time steps resolve {limit} at most; choose')) as caught:
        changed(scene, {name: value})
    assert caught.value.name == name


@pytest.mark.filterwarnings('error')
def test_a_state_or_a_table_faster_than_steps_can_follow_is_refused(tmp_path):
    (tmp_path / 'way.csv').write_text('0,0,0,0\n1,1e9,0,0\n2,0,0,0\n')
    way = {'motion': 'table', 'file': str(tmp_path / 'way.csv')}
    for sections in (
            {'drives': {'d': {'group': 'all', **way}}},
            {'anchors': {'d': {'position': [0.0, 0.0, 0.1], 'file': way['file']}}}):
        with pytest.raises(ico.ParameterError, match=(
                r'\.d\.file: .* moves with up to .* m/s: time steps resolve 1e[+]07 m/s at most')):
            make_scene((2, 2, 2), **sections)
    run = ico.compile_scene(make_scene((2, 2, 2)))
    spin = np.zeros((run.scene.body_count, 3))
    spin[2, 1] = 1e300
    with pytest.raises(ValueError, match=(
            r'angular_velocity of body 2 is .* rad/s: time steps resolve 1e[+]09 rad/s at most')):
        run.set_state(angular_velocity=spin)
    assert not run.snapshot().angular_velocity.any()


@pytest.mark.parametrize('changes', [
    {'connector.law': 'law.csv'}, {'loads.it.profile': 'table law.csv'},
    {'loads.it.profile': 'sine 1_0'}, {'groups.g': 'box -1_0 -1 -1 1 1 1'},
    {'tractions.it.group': 'all', 'tractions.it.variation': '1 1_0 0'},
    {'drives.it.group': 'all', 'drives.it.motion': 'table', 'drives.it.file': 'way.csv'}])
def test_numbers_that_only_python_reads_are_refused(changes, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'law.csv').write_text('0,-1_0\n1,10\n')
    (tmp_path / 'way.csv').write_text('0,0,0,0\n1,1_0,0,0\n')
    with pytest.raises(ico.ParameterError, match='1_0'):
        make_scene((2, 2, 2), {'loads.it.group': 'all', **changes})
