# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Snapshots as plain numbers, and what objects say of themselves."""

import csv
from importlib.util import find_spec
import json
from pathlib import Path
import sys
from xml.etree import ElementTree

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.simulation.simulation import compile_scene
from icofabric_sim.statics.equilibrium import solve_equilibrium
from icofabric_sim.statics.modes import solve_modes
import numpy as np
import pytest
from recorded_runs import swing_scene


@pytest.fixture(scope='module')
def snapshot():
    simulation = compile_scene(swing_scene())
    simulation.advance_to(0.05)
    return simulation.snapshot()


def test_objects_say_in_one_short_line_what_they_are(snapshot):
    for thing, words in ((snapshot, ('t = 0.05 s', 'bodies')), (swing_scene(), ('3 x 3 x 3',))):
        said = repr(thing)
        assert len(said) < 120 and '\n' not in said
        assert all(word in said for word in words)


def test_notebooks_show_scenes_and_snapshots_as_tables(snapshot):
    for thing, words in ((snapshot, ('0.05 s', 'kinetic')), (swing_scene(), ('3 x 3 x 3', 'tip'))):
        shown = thing._repr_html_()
        assert ElementTree.fromstring(shown).tag == 'table'
        assert all(word in shown for word in words)


def test_equilibria_and_spectra_are_tables_too(tmp_path: Path):
    scene = swing_scene(**{'connector.bending_stiffness': 0.02, 'contact.mode': 'never'})
    rest = solve_equilibrium(scene)
    spectrum = solve_modes(scene, at=rest.snapshot)
    for thing in (rest, spectrum):
        said = repr(thing)
        assert len(said) < 120 and '\n' not in said
        thing.to_csv(tmp_path / 'table.csv')
        with open(tmp_path / 'table.csv', encoding='utf-8', newline='') as file:
            rows = list(csv.DictReader(file))
        columns = thing.table()
        assert [*rows[0]] == [*columns] and len(rows) == len(next(iter(columns.values())))
    assert rest.table()['reaction_z_n'] == rest.reaction[:, 2].tolist()
    assert rest.verdict in repr(rest)
    assert spectrum.table()['rad_per_s'] == spectrum.frequencies.tolist()


def test_what_is_measured_is_a_table_and_says_what_it_is_in_one_line(tmp_path: Path):
    scene = swing_scene(**{'connector.bending_stiffness': 0.02, 'contact.mode': 'never'})
    stiff = make_scene((3, 3, 3), connector={'bending_stiffness': 0.02})
    simulation = ico.compile_scene(scene)
    reactions = simulation.reactions()
    curve = ico.measure_curve(stiff, 'pull', [1e-3, 2e-3])
    turns = ico.measure_moment_curve(stiff, 'twist', [1e-3])
    cycles = ico.measure_cycles(stiff, 'pull', [1e-3, 2e-3], count=2)
    elasticity = ico.homogenise(stiff)
    growth = ico.measure_growth(scene, 0.02)
    for thing in (reactions, simulation.contacts(), curve, turns, cycles, elasticity, growth):
        said = repr(thing)
        assert len(said) < 140 and '\n' not in said, said
        thing.to_csv(tmp_path / 'table.csv')
        with open(tmp_path / 'table.csv', encoding='utf-8', newline='') as file:
            head, *rows = list(csv.reader(file))
        columns = thing.table()
        assert head == [*columns] and len(rows) == len(next(iter(columns.values())))
    assert reactions.table()['force_z_n'] == reactions.force[:, 2].tolist()
    assert reactions.names[0] in repr(reactions)
    assert curve.table()['stress_pa'] == [point.stress for point in curve] != [0.0, 0.0]
    assert curve[1].snapshot.time == 0.0 and isinstance(curve, list)
    assert cycles.table()['cycle'] == [1, 2]
    assert elasticity.table()['xy_pa'] == elasticity.stiffness[:, 5].tolist()
    assert growth.table()['time_s'][-1] == growth.time[-1] > 0.0
    # And what is no table.
    for thing in (simulation, simulation.status, simulation.checkpoint(), curve[0], turns[0],
                  cycles[0]):
        assert len(repr(thing)) < 140 and '\n' not in repr(thing), repr(thing)
    assert 't = 0 s' in repr(simulation) and simulation.status.method_name in repr(simulation)


def test_contacts_are_a_table_with_the_names_of_planes():
    scene = make_scene(
        (1, 1, 1), gravity=[0.0, 0.0, -9.81], contact={'mode': 'auto'},
        planes={'floor': {'normal': [0.0, 0.0, 1.0], 'offset': -0.0150}})
    contacts = ico.compile_scene(scene).contacts()
    table = contacts.table()
    assert set(table['second']) == {'planes.floor'} and min(table['overlap_m']) > 0.0
    assert sum(table['force_z_n']) > 0.0 and 'a shell and a plane' in repr(contacts)


def test_the_table_is_plain_numbers_of_the_state(snapshot, tmp_path: Path):
    table = snapshot.table()
    assert json.loads(json.dumps(table)) == table
    np.testing.assert_array_equal(
        np.array([table[name] for name in ('x_m', 'y_m', 'z_m')]).T, snapshot.position)
    np.testing.assert_array_equal(
        np.array([table[name] for name in ('qx', 'qy', 'qz', 'qw')]).T, snapshot.orientation)
    np.testing.assert_array_equal(
        np.array([table[f'w{axis}_rad_s'] for axis in 'xyz']).T, snapshot.angular_velocity)
    snapshot.to_csv(tmp_path / 'state.csv')
    with open(tmp_path / 'state.csv', encoding='utf-8', newline='') as file:
        rows = list(csv.DictReader(file))
    # In full: the same bits.
    assert [float(row['vz_m_s']) for row in rows] == table['vz_m_s']
    assert snapshot.linear_velocity.any()


def test_pandas_where_it_is_and_the_way_out_where_not(snapshot, monkeypatch):
    if find_spec('pandas') is not None:
        frame = snapshot.to_pandas()
        np.testing.assert_array_equal(frame['z_m'].to_numpy(), snapshot.position[:, 2])
    monkeypatch.setitem(sys.modules, 'pandas', None)
    with pytest.raises(ImportError, match='pip install pandas'):
        snapshot.to_pandas()
