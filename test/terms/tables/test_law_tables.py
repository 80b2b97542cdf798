# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Connectors whose tension follows a table."""

from analytical import quaternion_product, rotation_quaternion
from fabrics import make_scene, packed_state, pair_face_to_face, RANDOM, wrenches
import icofabric_sim as ico
from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import LANES, load_at, splat, store
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.scene.law_tables import make_law
from icofabric_sim.simulation.model.packing import pack_loads, pack_scene
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.model.stability import largest_frequency
from icofabric_sim.terms.laws import replace_alone
from icofabric_sim.terms.tables.law import ROW_SIZE, tabled_factor
import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

LENGTH = 0.032360679774997896
# A band that buckles when short, is soft at first, and stiffens until it yields.
BAND = [(0.5, -1.0), (0.9, -0.7), (1.0, 0.0), (1.1, 0.6), (1.25, 3.0), (1.4, 7.0), (1.6, 7.2)]


def write(path, rows, head='length, force\n# by hand\n'):
    """A table of lengths in parts of L."""
    path.write_text(head + ''.join(f'{x * LENGTH!r}, {f!r}\n' for x, f in rows))
    return str(path)


@pytest.fixture
def band(tmp_path):
    return write(tmp_path / 'band.csv', BAND)


@pytest.mark.parametrize('points', [
    BAND, [(0.4, -2.0), (1.3, 4.0)], [(0.0, -1.0), (1.0, 0.0), (1.5, 0.0), (2.0, 9.0)],
    [(0.2, 3.0), (0.3, 1.0), (0.8, 2.0), (0.9, 2.0), (1.0, -1.0)]])
def test_law_is_the_monotone_cubic_and_its_energy_the_integral(points):
    x, f = np.array(points).T
    law, reference = make_law(x, f), PchipInterpolator(x, f)
    at = np.linspace(x[0], x[-1], 2001)
    force, energy = law.evaluate(at)
    np.testing.assert_allclose(force, reference(at), rtol=0, atol=1e-13)
    expected = [reference.integrate(x[0], value) for value in at]
    np.testing.assert_allclose(energy - energy[0], expected, rtol=0, atol=1e-13)
    slope = reference.derivative()
    steepest = slope(np.linspace(x[0], x[-1], 100_001)).max()
    assert law.largest_slope == pytest.approx(max(steepest, 0.0), rel=1e-6)
    # Straight beyond the ends.
    force, _ = law.evaluate(np.array([x[0] - 0.3, x[-1] + 0.5]))
    np.testing.assert_allclose(
        force, [f[0] - 0.3 * slope(x[0]), f[-1] + 0.5 * slope(x[-1])], rtol=0, atol=1e-12)
    if law.natural_length > 0.0:
        rest = law.evaluate(np.array([law.natural_length]))
        assert abs(rest[0][0]) < 1e-14 and abs(rest[1][0]) < 1e-15


def test_one_connector_alone_has_the_tension_and_the_integral(band):
    links = pack_scene(make_scene((3, 3, 3), {'connector.law': band})).model.links
    (link, s), *_ = np.argwhere(links.laws.tables.number >= 0.0)
    lengths, forces = np.array(BAND).T
    curve = PchipInterpolator(LENGTH * lengths, forces)
    for length in LENGTH * np.array([0.6, 0.95, 1.05, 1.2, 1.35, 1.5]):
        tension, energy, _ = replace_alone(
            links.laws, links.variety, link, s, length, (1.0, 2.0, 3.0))
        assert tension == pytest.approx(float(curve(length)), rel=1e-12)
        assert energy == pytest.approx(float(curve.integrate(LENGTH, length)), rel=1e-11)


def test_natural_length_is_where_it_begins_to_pull():
    assert make_law(*np.array([(0.0, -1.0), (1.0, 0.0), (1.5, 0.0), (2.0, 9.0)]).T
                    ).natural_length == 1.5
    assert make_law(*np.array([(2.0, 3.0), (3.0, 4.5)]).T).natural_length == 0.0
    assert make_law(*np.array([(2.0, 1.5), (3.0, 4.5)]).T).natural_length == 1.5
    assert make_law(*np.array([(2.0, -4.5), (3.0, -1.5)]).T).natural_length == 3.5


def disturbed(scene, amplitude, seed=1):
    generator = np.random.default_rng(seed)
    shape = (scene.body_count, 3)
    shift = amplitude * scene.geometry.cube_width * generator.standard_normal(shape)
    turn = rotation_quaternion(amplitude * generator.standard_normal(shape))
    return scene.position + shift, quaternion_product(turn, scene.orientation)


def looked_at(scene, position, orientation):
    """Energy [J] that a snapshot reports, that of the kernels, and the bound of the frequency."""
    rest, packed = np.zeros_like(position), pack_scene(scene)
    reported = Snapshot(
        0.0, position, orientation, rest, rest, scene.connector_count, packed,
        {'work_in': 0.0, 'start': 0.0, 'spent': 0.0, 'potential': 0.0}).energy['connectors']
    state, work = packed_state(packed, position, orientation), packed.layout.room(
        packed.model.links)
    place_all(packed.model, state, work, 0, len(packed.model.blocks.slot))
    ledger = np.zeros(monitor.LEDGER_COUNT)
    monitor.examine(packed.model, pack_loads((), packed.layout), state, work, 0.0, ledger)
    return reported, ledger[monitor.STORED], ledger[monitor.RATE], largest_frequency(
        packed, state).rate


@pytest.mark.parametrize('groups', [False, True])
def test_wrench_is_minus_the_gradient_of_the_energy(band, groups):
    changes = {'connector.law': band}
    if groups:
        changes = {
            'groups.low': 'z_min', 'connector_groups.g.between': 'low all',
            'connector_groups.g.law': band}
    scene = make_scene((3, 3, 3), changes)
    position, orientation = disturbed(scene, 0.1)
    generator = np.random.default_rng(3)
    shift = 0.01 * generator.standard_normal((scene.body_count, 3))
    turn = generator.standard_normal((scene.body_count, 3))

    def along(h):
        return looked_at(scene, position + h * shift, quaternion_product(
            rotation_quaternion(h * turn), orientation))[0]

    work = wrenches(scene, position, orientation)
    expected = -(work.force * shift).sum() - (work.torque * turn).sum()
    errors = [(along(h) - along(-h)) / (2.0 * h) - expected for h in (4e-4, 2e-4)]
    assert abs(4.0 * errors[1] - errors[0]) < 1e-6 * abs(expected)
    reported, stored, bound, rate = looked_at(scene, position, orientation)
    assert stored == pytest.approx(reported, rel=1e-12) and reported > 0.01
    assert bound >= rate > 0.0
    assert np.abs(work.force.sum(axis=0)).max() < 1e-13 * np.abs(work.force).max()
    lengths = ico.compile_scene(scene)
    lengths.set_state(position=position, orientation=orientation)
    lengths = lengths.snapshot().connector_length / LENGTH
    assert lengths.min() < 0.9 and lengths.max() > 1.25


@pytest.mark.parametrize('method', [
    pytest.param('srkn6', marks=pytest.mark.long), 'dop8'])
def test_a_straight_table_is_the_spring(tmp_path, method):
    straight = write(tmp_path / 'k.csv', [(x, 500.0 * LENGTH * (x - 1.0)) for x in (
        0.2, 0.7, 1.0, 1.3)])
    fixed = {'solver.method': method, 'solver.step': 2e-4, 'contact.mode': 'never'}
    ends = []
    for changes in ({}, {'connector.law': straight}):
        simulation = ico.compile_scene(make_scene((3, 3, 3), {**fixed, **changes}, **RANDOM))
        simulation.advance_to(0.02)
        ends.append(simulation.snapshot())
        assert simulation.status.largest_frequency == pytest.approx(653.0, rel=0.5)
    scale = np.abs(ends[0].position - simulation.scene.initial.position).max()
    assert np.abs(ends[1].position - ends[0].position).max() < 1e-10 * scale
    assert ends[1].energy['connectors'] == pytest.approx(ends[0].energy['connectors'], rel=1e-9)


def test_energy_of_a_swing_through_all_pieces_stays(band):
    scene = make_scene((2, 2, 1), {'connector.law': band, 'contact.mode': 'never'})
    simulation = ico.compile_scene(scene)
    assert simulation.status.method_name == 'dop8'
    position, orientation = pair_face_to_face(scene, scene.geometry.cube_width + 1.28 * LENGTH)
    simulation.set_state(position=position, orientation=orientation)
    start = simulation.snapshot().energy['connectors']
    lengths = []
    for time in np.linspace(0.0, 0.06, 120)[1:]:
        simulation.advance_to(time)
        s = simulation.snapshot()
        lengths.append(s.connector_length[0] / LENGTH)
        assert abs(s.energy['total'] - start) < 1e-6 * start
    assert min(lengths) < 0.9 and max(lengths) > 1.25


def forces_by_tables(scene, lengths, passes=1):
    """Tensions [N] by the kernels of the first connector of a scene, in all lanes."""
    links = pack_scene(scene).model.links
    tables = links.laws.tables
    place, = np.argwhere(tables.number >= 0.0)[:1]
    link, s = int(place[0]), int(place[1]) // LANES * LANES
    tables.number[link, s:s + LANES] = 0.0
    result = np.zeros((passes, len(lengths)))
    for row in range(passes):
        put_tensions(tables, links.variety, link, s, lengths, result, row)
    return result.ravel()


@compiled
def put_tensions(tables, variety, link, s, lengths, result, row):
    there = splat(1.0) > splat(0.0)
    for i in range(0, len(lengths), LANES):
        length = load_at(lengths, i)
        factor = tabled_factor(tables, variety, link, s, length * length, there)
        store(result, row, i, factor * length)


# Points far closer together than bins can be, and evenly spaced ones.
CROWDED = [(0.5, -1.0), (1.0, 0.0), *((1.0 + k * 1e-7, 0.01 * k) for k in range(1, 5)), (1.6, 3.0)]


@pytest.mark.parametrize('points', [
    BAND, CROWDED, [(0.9, -1.0), (1.1, 1.0)],
    [(0.5 + 0.01 * k, k / 50.0 - 1.0 + (k / 50.0 - 1.0)**3) for k in range(101)]])
def test_kernels_find_the_piece_of_each_length(tmp_path, points):
    scene = make_scene((3, 3, 3), {'connector.law': write(tmp_path / 'law.csv', points)})
    table, = scene.connectors.curves.curves
    assert pack_scene(scene).model.links.laws.tables.is_alike
    bounds = table.rows[1:, 0]
    generator = np.random.default_rng(5)
    lengths = np.concatenate([
        bounds, bounds * (1.0 + 1e-9), bounds * (1.0 - 1e-9), LENGTH * generator.uniform(
            0.3, 1.8, 1000), LENGTH * (1.0 + 0.002 * generator.standard_normal(1000))])
    lengths = np.resize(lengths, len(lengths) // LANES * LANES)
    expected = table.evaluate(lengths)[0]
    # Kernels know lengths to about an ulp.
    rounding = 2.0 * np.spacing(lengths.max()) * table.largest_slope
    np.testing.assert_allclose(
        forces_by_tables(scene, lengths, passes=2), np.tile(expected, 2), rtol=0,
        atol=1e-13 * np.abs(expected).max() + rounding)
    assert len({*np.searchsorted(bounds, lengths)}) == len(bounds) + 1


@pytest.mark.parametrize('groups', [False, True])
def test_pieces_remembered_from_elsewhere_change_no_bit(band, groups):
    """Forces try the pieces of before first, which must not matter, whatever they were."""
    changes = {'connector.law': band}
    if groups:
        changes = {
            'groups.low': 'z_min', 'connector_groups.g.between': 'low all',
            'connector_groups.g.law': band}
    scene = make_scene((3, 3, 3), changes)
    packed = pack_scene(scene)
    tables = packed.model.links.laws.tables
    assert tables.is_alike is not groups
    tables.near[:] = ROW_SIZE * 3
    places = [disturbed(scene, 0.05, seed) for seed in range(6)]
    used = [wrenches(scene, *place, packed=packed) for place in (*places, places[0])]
    if not groups:
        # Some are remembered, some have lanes on more than two pieces.
        assert len({*tables.near}) > 2 and -1 in tables.near
    for place, seen in zip((*places, places[0]), used):
        fresh = wrenches(scene, *place)
        assert np.array_equal(fresh.force, seen.force)
        assert np.array_equal(fresh.torque, seen.torque)
    assert not np.array_equal(used[0].force, used[1].force)


@pytest.mark.parametrize('rows, words', [
    ([(1.0, 0.0)], ['connector.law', 'two lines', 'length [m], force [N]']),
    ([(1.0, 0.0), (0.9, 1.0)], ['connector.law', 'line 4', 'lengths must increase']),
    ([(1.0, 0.0), (1.2, np.nan)], ['connector.law', 'finite']),
])
def test_bad_tables_are_refused(tmp_path, rows, words):
    with pytest.raises(ParameterError) as caught:
        make_scene((2, 2, 1), {'connector.law': write(tmp_path / 'bad.csv', rows)})
    for word in words:
        assert word in str(caught.value)


def test_what_contradicts_a_table_is_refused(band):
    with pytest.raises(ParameterError, match='connector.law.*no file.*give the path'):
        make_scene((2, 2, 1), {'connector.law': 'nowhere.csv'})
    with pytest.raises(ParameterError, match='natural_length.*leave one of them out'):
        make_scene((2, 2, 1), {'connector.law': band, 'connector.natural_length': 0.03})


def pulled(band, **changes):
    """A fabric whose top is pulled up until its connectors leave their table."""
    return make_scene((2, 2, 2), {
        'connector.law': band, 'groups.top': 'z_max', 'groups.foot': 'z_min',
        'supports.foot.group': 'foot', 'drives.top.group': 'top', 'drives.top.motion': 'velocity',
        'drives.top.linear': [0.0, 0.0, 1.0], 'contact.mode': 'never', **changes})


@pytest.mark.parametrize('method', ['leapfrog', 'dop8'])
def test_lengths_beyond_a_table_are_reported_once(band, method, caplog):
    simulation = ico.compile_scene(pulled(band, **{'solver.method': method}))
    simulation.advance_to(0.01)
    assert 'beyond its table' not in caplog.text
    simulation.advance_to(0.06)
    simulation.restore(simulation.checkpoint())
    simulation.advance_to(0.07)
    said, = [record.getMessage() for record in caplog.records if 'table' in record.getMessage()]
    assert 'band.csv (0.0161803 to 0.0517771 m)' in said and 'seen at t = 0.0' in said
    assert 'connector ' in said and 'between bodies' in said
    assert simulation.snapshot().connector_length.max() > 1.6 * LENGTH


@pytest.mark.parametrize('changes', [
    {'connector.law_beyond': 'stop'},
    {'connector.law_beyond': 'stop', 'solver.method': 'dop8'},
    {'connector_groups.some.between': 'all all', 'connector_groups.some.law_beyond': 'stop'}])
def test_run_stops_beyond_a_table_in_pieces_and_in_one_go(band, changes):
    ended = []
    for times in ([0.08], np.linspace(0.0, 0.08, 30)[1:]):
        simulation = ico.compile_scene(pulled(band, **changes))
        with pytest.raises(ico.SimulationError, match='law_beyond is stop') as caught:
            for time in times:
                simulation.advance_to(float(time))
        assert '(0.0161803 to 0.0517771 m), seen at t = 0.' in str(caught.value)
        # No later than what was asked for, though a step in progress may be sound beyond.
        assert simulation.time <= 0.08 and simulation.snapshot().time == simulation.time
        assert f'The state of t = {simulation.time:.9g} s is kept' in str(caught.value)
        ended.append((str(caught.value), simulation.time))
    assert ended[0] == ended[1]


def test_scene_that_begins_beyond_its_table_is_refused_or_reported(tmp_path, caplog):
    short = write(tmp_path / 'short.csv', [(0.5, -1.0), (0.8, 0.0)])
    with pytest.raises(ValueError, match='law_beyond is stop'):
        ico.compile_scene(pulled(short, **{'connector.law_beyond': 'stop'}))
    ico.compile_scene(pulled(short))
    assert 'seen at t = 0 s' in caplog.text


def test_equilibrium_beyond_a_table_is_reported_or_not_found(band, caplog):
    found = ico.solve_equilibrium(pulled(band), time=0.05)
    assert found.converged and 'm long, beyond its table' in caplog.text
    refused = ico.solve_equilibrium(pulled(band, **{'connector.law_beyond': 'stop'}), time=0.05)
    assert not refused.converged and 'connector.law_beyond is stop' in refused.reason
    assert ico.solve_equilibrium(
        pulled(band, **{'connector.law_beyond': 'stop'}), time=0.001).converged
