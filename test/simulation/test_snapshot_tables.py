# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Snapshots as plain numbers, and what objects say of themselves."""

import csv
from importlib.util import find_spec
import json
from pathlib import Path
import sys
from xml.etree import ElementTree

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
