# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Bodies on paths that meet each other, what is held, and planes: contact changes no motion there.

Where paths lead is known, and with it the energy of contact, which is the work of the drives.
"""

from contact_scenes import A, loose
import icofabric_sim as ico
from icofabric_sim import contact
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

# Half of the width of a shell along an axis of its own.
REACH = 0.5 * (1.0 + 5.0**0.5) * A
SPEED = 0.1  # [m/s]


def onto_plane(way):
    """A shell 0.01 m beside a plane, that a drive moves there by `way` [m] within way / SPEED."""
    return loose(**{
        'planes.wall.normal': [-1.0, 0.0, 0.0], 'planes.wall.offset': -0.01 - REACH,
        'drives.one.group': 'all', 'drives.one.motion': 'velocity',
        'drives.one.linear': [SPEED, 0.0, 0.0], 'drives.one.duration': way / SPEED})


def test_steps_are_judged_only_up_to_where_a_drive_stops():
    """A step in progress ends where shell and plane would overlap by more than ends a run."""
    live = ico.compile_scene(onto_plane(0.02))
    time = 0.1
    while not live._driver.stepping.next_step_time * SPEED > 0.0133:
        time += 1e-4
        live.advance_to(time)
    lasting = ico.compile_scene(onto_plane(0.02))
    lasting.restore(live.checkpoint())
    live.apply_twist('one')
    timed = ico.compile_scene(onto_plane(time * SPEED))
    for simulation in (live, timed):
        simulation.advance_to(1.0)
        place = simulation.snapshot().position[0]
        assert place == pytest.approx([time * SPEED, 0.0, 0.0], abs=1e-12)
        assert simulation.status.deepest_overlap == pytest.approx(place[0] - 0.01, rel=1e-9)
        assert simulation.status.deepest_overlap < 0.003
        assert simulation.balance.worst < 1e-9
    with pytest.raises(ico.SimulationError, match='body 0 and plane wall overlap by'):
        lasting.advance_to(0.2)


def meeting(tmp_path, kind, rows=((0.0, 0.0), (0.08, 0.7), (0.15, 1.0)), **fields):
    """Two shells that drives bring nearer along x, until they overlap by 1.7 % of a."""
    way = 0.0163
    flat = {
        'groups.one': 'ids 0', 'groups.other': 'ids 1', 'drives.one.group': 'one',
        'drives.one.motion': 'velocity', 'drives.one.linear': [SPEED, 0.0, 0.0],
        'drives.one.duration': way / SPEED}
    both = {'drives.other.group': 'other'}
    if kind == 'both driven':
        half = 0.5 * way / SPEED
        flat |= {**both, 'drives.other.motion': 'velocity', 'drives.one.duration': half,
                 'drives.other.linear': [-SPEED, 0.0, 0.0], 'drives.other.duration': half}
    elif kind == 'guided':
        flat |= {'drives.one.freedoms': 'tx', 'supports.guide.group': 'one',
                 'supports.guide.fix': 'ty tz rotation', **both}
    elif kind == 'held by a support':
        flat['supports.other.group'] = 'other'
    else:
        table = tmp_path / 'path.csv'
        table.write_text(''.join(f'{time}, {part * way}, 0, 0\n' for time, part in rows))
        flat |= {**both, 'drives.one.motion': 'table', 'drives.one.file': str(table)}
        del flat['drives.one.linear'], flat['drives.one.duration']
    return loose(
        ((0.05, 0.004, 0.002), (0, 0, 0), (0, 0, 0), Rotation.from_rotvec([0.2, 0.5, 0.1])),
        **flat, **fields)


def require_balance(scene, worst):
    """What drives do is what contact stores, less the energy with which they began to move."""
    simulation = ico.compile_scene(scene)
    moving = simulation.snapshot().energy['kinetic']
    for time in np.linspace(0.0, 0.2, 9)[1:]:
        simulation.advance_to(float(time))
    snapshot = simulation.snapshot()
    stored = contact.contact_force(
        A, *zip(snapshot.position, snapshot.orientation), scene.parameters['contact.stiffness'],
    ).energy
    assert snapshot.position[1, 0] - snapshot.position[0, 0] == pytest.approx(0.0337, abs=1e-12)
    assert stored > moving
    assert snapshot.energy['contact'] == pytest.approx(stored, rel=1e-9)
    assert snapshot.energy['work_in'] == pytest.approx(stored - moving, abs=worst * stored)
    assert simulation.balance.worst < worst
    return simulation


@pytest.mark.parametrize('kind', [
    'both driven', 'guided', 'held by a support', 'by a table'])
def test_drives_do_the_energy_of_contact_as_work(tmp_path, kind):
    require_balance(meeting(tmp_path, kind), 1e-9)


@pytest.mark.long
@pytest.mark.parametrize('method, worst', [('leapfrog', 1e-3), ('srkn6', 1e-3)])
def test_steps_of_one_length_do_so_too(tmp_path, method, worst):
    require_balance(meeting(tmp_path, 'both driven', **{
        'solver.method': method, 'solver.tolerance': 1e-6}), worst)


@pytest.mark.parametrize('kind', ['both driven', 'held by a support', 'by a table'])
def test_implicit_steps_do_so_too(tmp_path, kind):
    simulation = require_balance(meeting(tmp_path, kind, **{
        'solver.method': 'sdirk4', 'solver.tolerance': 1e-4}), 1e-4)
    assert simulation.status.method_name == 'sdirk4'


@pytest.mark.parametrize('method, tolerance, worst', [
    ('dop8', 1e-8, 1e-9), ('sdirk4', 1e-4, 1e-4)])
def test_drives_that_part_bodies_get_the_work_back(tmp_path, method, tolerance, worst):
    scene = meeting(tmp_path, 'by a table', ((0.0, 0.0), (0.15, 1.0), (0.4, -1.0)), **{
        'solver.method': method, 'solver.tolerance': tolerance})
    simulation, stored = ico.compile_scene(scene), 0.0
    for time in np.linspace(0.0, 0.5, 11)[1:]:
        simulation.advance_to(float(time))
        stored = max(stored, simulation.snapshot().energy['contact'])
    energy = simulation.snapshot().energy
    assert stored > 1e-4 and energy['contact'] == 0.0
    assert energy['work_in'] == pytest.approx(0.0, abs=worst * stored)
    assert simulation.balance.worst < worst


def pressed(**changes):
    """A shell that a drive presses along x on another one, whose centre is 0.05 m beside it."""
    return loose(
        ((0.05, 0.0, 0.0), (0, 0, 0), (0, 0, 0)),
        **{'groups.one': 'ids 0', 'groups.other': 'ids 1', 'drives.b.group': 'one',
           'drives.b.motion': 'velocity', 'drives.b.linear': [SPEED, 0.0, 0.0], **changes})


# Both shells have edges in front.
FIRST_TOUCH = (0.05 - 2.0 * REACH) / SPEED


@pytest.mark.parametrize('changes, said', [
    ({'supports.a.group': 'other'}, 'drives.b contradicts supports.a from'),
    ({'supports.a.group': 'other', 'supports.a.fix': 'tx ty rotation'},
     'drives.b contradicts supports.a from'),
    ({'drives.c.group': 'other'}, 'drives.b contradicts drives.c from'),
    ({'supports.a.group': 'other', 'solver.method': 'leapfrog', 'solver.tolerance': 1e-4},
     'drives.b contradicts supports.a from')])
def test_drives_that_press_on_what_cannot_yield_are_named_with_the_time(changes, said):
    simulation = ico.compile_scene(pressed(**changes))
    with pytest.raises(ico.SimulationError, match=said) as caught:
        simulation.advance_to(1.0)
    text = str(caught.value)
    since = float(text.partition('from t = ')[2].partition(' s')[0])
    assert since == pytest.approx(FIRST_TOUCH, rel=1e-5)
    assert 'body 0 and body 1 overlap by' in text and 'contact.stiffness' not in text
    # The last good state is kept.
    assert FIRST_TOUCH < simulation.snapshot().time < 1.2 * FIRST_TOUCH


def test_planes_that_press_on_what_cannot_yield_are_named():
    wall = {'planes.wall.normal': [-1.0, 0.0, 0.0], 'planes.wall.offset': -0.01 - REACH}
    for changes, said in (
            ({'drives.b.group': 'all', 'drives.b.motion': 'velocity',
              'drives.b.linear': [SPEED, 0.0, 0.0]}, 'drives.b contradicts planes.wall from'),
            ({'supports.a.group': 'all', 'planes.wall.motion': 'velocity',
              'planes.wall.linear': [-SPEED, 0.0, 0.0]}, 'planes.wall contradicts supports.a')):
        simulation = ico.compile_scene(loose(**wall, **changes))
        with pytest.raises(ico.SimulationError, match=f'{said}.* t = 0.1 s') as caught:
            simulation.advance_to(1.0)
        assert 'body 0 and plane wall overlap by' in str(caught.value)


def test_bodies_that_can_yield_are_no_conflict():
    """A body that is free to rotate, and one that lies between a drive and a held body."""
    oblique = ico.compile_scene(pressed(**{
        'supports.a.group': 'other', 'supports.a.fix': 'tx ty tz',
        'bodies.b0.position': [0.05, 0.008, 0.003]}))
    oblique.advance_to(0.21)
    assert np.abs(oblique.snapshot().angular_velocity[1]).max() > 0.1
    with pytest.raises(ico.SimulationError, match='Give a larger contact.stiffness'):
        oblique.advance_to(1.0)
    between = ico.compile_scene(pressed(**{
        'groups.held': 'ids 2', 'supports.a.group': 'held',
        'bodies.c.position': [0.085, 0.0, 0.0], 'supports.guide.group': 'other',
        'supports.guide.fix': 'ty tz rotation'}))
    with pytest.raises(ico.SimulationError, match='Give a larger contact.stiffness'):
        between.advance_to(1.0)
