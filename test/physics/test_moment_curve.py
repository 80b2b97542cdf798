# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Moment against angle of slabs that are bent and twisted between two held ends."""

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.statics.held_motion import held_motion
from icofabric_sim.statics.moment_curve import MOMENT_CURVE_COLUMNS
import numpy as np
import pytest

STIFF = {'connector': {'bending_stiffness': 0.02}}
KINDS = ('bend', 'twist')


def slab(size, angle=0.3, **sections):
    return make_scene(
        size, weave={'size': list(size), 'connector_angle': angle}, **sections)


@pytest.mark.parametrize('kind, about', [('bend', 1), ('bend', 2), ('twist', None)])
@pytest.mark.parametrize('angle', [-0.3, 0.3])
def test_the_moment_is_the_derivative_of_the_energy(kind, about, angle):
    """Castigliano, at small and at large angles."""
    scene = slab((7, 3, 3), angle, **STIFF)
    step = 2e-4
    for at in (0.05, 0.8):
        before, here, ahead = ico.measure_moment_curve(
            scene, kind, [at - step, at, at + step], about=about)
        assert here.verdict == 'equilibrium, stable'
        slope = (ahead.energy - before.energy) / (2.0 * step)
        assert here.moment == pytest.approx(slope, rel=1e-6)
        assert here.moment > 0.0 and here.energy > 0.0


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('axis', [0, 1, 2])
def test_moving_ends_go_the_way_that_their_rates_say(kind, axis):
    """Rates of the held bodies against differences of their places, also about angle 0."""
    motion = held_motion(slab((5, 5, 5)), kind, axis)
    h = 1e-5
    for angle in (0.0, 1e-3, -0.00999, 0.01001, 0.7, -2.0):
        here, ahead, behind = (motion.at(angle + change) for change in (0.0, h, -h))
        moved = (ahead.position - behind.position) / (2.0 * h)
        assert np.abs(here.rate[:, :3] - moved).max() < 1e-9 * motion.length
        assert (ahead.rotation - behind.rotation) / (2.0 * h) == pytest.approx(here.rate[0, 3:])
        # As one rigid body, its centre on an arc of the woven length.
        arms = here.position - here.position.mean(axis=0)
        woven = motion.scene.position[motion.moved]
        assert np.linalg.norm(arms, axis=1) == pytest.approx(
            np.linalg.norm(woven - woven.mean(axis=0), axis=1), rel=1e-12)
        shift = here.position.mean(axis=0) - woven.mean(axis=0)
        shift[axis] += motion.length
        chord = motion.length * (
            np.sinc(angle / (2.0 * np.pi)) if kind == 'bend' else 1.0)
        assert np.linalg.norm(shift) == pytest.approx(chord, rel=1e-12)


@pytest.mark.parametrize('kind', KINDS)
def test_the_opposite_angle_meets_the_opposite_moment(kind):
    """A slab with a body in its middle is its own image through that body."""
    scene = slab((7, 3, 3), **STIFF)
    angles = np.array([0.01, 0.2, 0.6])
    there, back = (ico.measure_moment_curve(scene, kind, sign * angles) for sign in (1.0, -1.0))
    for one, other in zip(there, back):
        assert one.moment > 0.0
        assert other.moment == pytest.approx(-one.moment, rel=1e-9)
        assert other.energy == pytest.approx(one.energy, rel=1e-9)
        assert other.rigidity == pytest.approx(one.rigidity, rel=1e-9)


@pytest.mark.parametrize('kind', KINDS)
def test_reactions_of_both_ends_balance(kind):
    scene = slab((7, 3, 3), **STIFF)
    [point] = ico.measure_moment_curve(scene, kind, [0.5])
    rest = ico.solve_equilibrium(
        held_motion(scene, kind, 0).placed(0.5), start=point.snapshot)
    held, place = rest.reaction, rest.snapshot.position
    size = np.abs(point.end_moment).max()
    assert size > 1e-3
    moment = held[:, 3:] + np.cross(place, held[:, :3])
    assert np.abs(held[:, :3].sum(axis=0)).max() < 1e-8 * np.abs(held[:, :3]).max()
    assert np.abs(moment.sum(axis=0)).max() < 1e-8 * size
    # The moment about the centre of the end: along its axis in a twist, nearly in a bend.
    about = 0 if kind == 'twist' else 1
    assert point.end_moment[about] == pytest.approx(
        point.moment, rel=1e-9 if kind == 'twist' else 0.05)


def fitted(points, moved, terms):
    """Coefficient of the last of the terms of a displacement, by least squares."""
    return np.linalg.lstsq(
        np.stack([np.ones(len(points)), *terms], axis=1), moved, rcond=None)[0][-1]


@pytest.mark.parametrize('about, lateral', [(1, 2), (2, 1)])
def test_bending_stiffness_is_that_of_a_beam_under_a_load_at_its_tip(about, lateral):
    """
    Moment over curvature in the middle of a cantilever, M = F (l - x): no end shows there.
    """
    scene = slab((17, 3, 3), **STIFF)
    force = 1e-5
    load = np.zeros(3)
    load[lateral] = force
    beam = scene.with_changes({
        'groups': {'root': 'x_min', 'tip': 'x_max'}, 'supports': {'root': {'group': 'root'}},
        'loads': {'tip': {'group': 'tip', 'share': 'total', 'force': load.tolist()}}})
    rest = ico.solve_equilibrium(beam)
    assert rest.verdict == 'equilibrium, stable'
    place, moved = scene.position, rest.snapshot.position - scene.position
    middle = np.abs(place[:, 0] - place[:, 0].mean()) < np.ptp(place[:, 0]) / 4.0
    x, aside = (place[middle, side] - place[middle, side].mean() for side in (0, lateral))
    curvature = -fitted(x, moved[middle, 0], [x, aside, x * x * aside, x * aside])
    arm = place[:, 0].max() - place[middle, 0].mean()
    stiffness = force * arm / curvature
    short, long = (
        ico.measure_moment_curve(slab((size, 3, 3), **STIFF), 'bend', [1e-4], about=about)[0]
        for size in (11, 17))
    lengths = [held_motion(slab((size, 3, 3)), 'bend', 0).length for size in (11, 17)]
    # What the ends add is the same for both lengths.
    yields = long.angle / long.moment - short.angle / short.moment
    assert (lengths[1] - lengths[0]) / yields == pytest.approx(stiffness, rel=0.01)
    assert long.rigidity == pytest.approx(stiffness, rel=0.06)


def test_twisting_stiffness_is_that_of_a_bar_under_a_torque_at_its_tip():
    scene = slab((17, 3, 3), **STIFF)
    torque = 1e-6
    bar = scene.with_changes({
        'groups': {'root': 'x_min', 'tip': 'x_max'}, 'supports': {'root': {'group': 'root'}},
        'loads': {'tip': {'group': 'tip', 'share': 'total', 'torque': [torque, 0.0, 0.0]}}})
    rest = ico.solve_equilibrium(bar)
    assert rest.converged
    place, moved = scene.position, rest.snapshot.position - scene.position
    middle = np.abs(place[:, 0] - place[:, 0].mean()) < np.ptp(place[:, 0]) / 4.0
    x, y, z = (place[middle] - place[middle].mean(axis=0)).T
    rates = [-fitted(x, moved[middle, 1], [x, z, y, x * z]),
             fitted(x, moved[middle, 2], [x, y, z, x * y])]
    assert rates[0] > 0.0 and rates[1] > 0.0
    short, long = (
        ico.measure_moment_curve(slab((size, 3, 3), **STIFF), 'twist', [1e-4])[0]
        for size in (11, 17))
    lengths = [held_motion(slab((size, 3, 3)), 'twist', 0).length for size in (11, 17)]
    yields = long.angle / long.moment - short.angle / short.moment
    stiffness = torque / (0.5 * (rates[0] + rates[1]))
    assert (lengths[1] - lengths[0]) / yields == pytest.approx(stiffness, rel=0.02)


def test_point_springs_let_a_slab_be_turned_for_nothing():
    scene = slab((7, 3, 3))
    scale = 500.0 * scene.geometry.pitch**2
    for kind in KINDS:
        [point] = ico.measure_moment_curve(scene, kind, [0.02])
        assert point.verdict == 'equilibrium, with mechanisms'
        assert abs(point.moment) < 1e-6 * 0.02 * scale


def test_connectors_break_as_a_slab_is_bent_and_say_on_which_side():
    limits = {'break_length_extension': 0.051, 'break_length_compression': 0.0472}
    scene = slab((7, 3, 3), connector={'bending_stiffness': 0.02, **limits})
    angles = np.linspace(0.1, 1.5, 15)
    points = ico.measure_moment_curve(scene, 'bend', angles)
    whole = ico.measure_moment_curve(slab((7, 3, 3), **STIFF), 'bend', angles)
    breaks = [each for point in points for each in point.breaks]
    assert len(breaks) == points[-1].broken > 3
    assert {each.side for each in breaks} == {'extension', 'compression'}
    for each in breaks:
        assert each.released_energy > 0.0 and 0.1 <= each.amount <= 1.5
        assert each.length >= 0.051 if each.side == 'extension' else each.length <= 0.0472
    first = int(np.argmax([point.broken > 0 for point in points]))
    assert first > 0 and points[first - 1].moment == pytest.approx(
        whole[first - 1].moment, rel=1e-7)
    assert points[first].moment < whole[first].moment
    row = dict(zip(MOMENT_CURVE_COLUMNS, points[-1].row()))
    assert len(MOMENT_CURVE_COLUMNS) == len(points[-1].row())
    assert row['angle_rad'] == 1.5 and row['end_moment_y_nm'] == points[-1].end_moment[1]
    assert row['largest_tension_n'] == points[-1].tension_range[1]


@pytest.mark.parametrize('arguments, more, word', [
    (('bend', []), {}, 'angles'), (('bend', [0.2, 0.1]), {}, 'angles'),
    (('twist', [-0.1, 0.2]), {}, 'angles'), (('pull', [0.1]), {}, 'kind'),
    (('bend', [0.0, 0.1]), {}, 'angles'), (('bend', [0.1]), {'about': 0}, 'about must be an axis'),
    (('twist', [0.1]), {'about': 1}, 'about applies to a bend only')])
def test_arguments_are_judged(arguments, more, word):
    with pytest.raises(ValueError, match=word):
        ico.measure_moment_curve(slab((5, 3, 3)), *arguments, **more)
    with pytest.raises(ValueError, match='does not have two ends'):
        ico.measure_moment_curve(slab((2, 2, 1)), 'twist', [0.1], axis=2)
