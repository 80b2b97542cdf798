# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""How displacements of the start grow: alike down to rounding, or a fault; its command."""

import csv
import json
import math

from icofabric_sim.commands.main import main
from icofabric_validation import predictability
from icofabric_validation.predictability import CASES, measure_predictability, Row
import numpy as np
import pytest


@pytest.mark.parametrize('scene', CASES)
def test_displacements_grow_alike_down_to_rounding(scene):
    rows = [*measure_predictability((scene,), samples=4, duration_ratio=0.5)]
    assert len(rows) == 4 * len(CASES[scene].methods) and not any(row.fault for row in rows)
    for row in rows:
        # A unit in the last place is no displacement of a known size: it is not compared.
        assert row.growth_9 == pytest.approx(row.growth_6, rel=0.1)
        if row.method != 'dop8':
            assert row.growth_12 == pytest.approx(row.growth_6, rel=0.3)
        assert 0.0 < row.rounding < row.allowed
    # Something moved, and not along: distances grow.
    assert max(row.growth_6 for row in rows) > 3.0


def test_methods_of_one_scene_find_the_same_growth():
    # It is that of the motion, whatever computes it.
    last = {row.method: row.growth_9
            for row in measure_predictability(('free',), samples=4, duration_ratio=0.25)}
    assert len(last) == 4 and min(last.values()) > 10.0
    assert max(last.values()) < 1.01 * min(last.values())


def test_a_start_of_which_the_last_bit_decides_is_found(monkeypatch):
    # As woven all connectors are as long as where their stiffness changes.
    monkeypatch.setitem(CASES, 'kinked', CASES['kinked']._replace(offset=0.0))
    rows = [*measure_predictability(('kinked',), ('srkn4',), samples=2, duration_ratio=0.25)]
    assert all('round-off adds' in row.fault for row in rows)


def test_a_state_that_loses_bits_is_found(monkeypatch):
    real = predictability._start_run

    def rough(scene, way):
        simulation = real(scene, way)
        state = simulation.snapshot()
        simulation.set_state(position=state.position.astype(np.float32).astype(float))
        return simulation

    monkeypatch.setattr(predictability, '_start_run', rough)
    rows = [*measure_predictability(('free',), ('srkn6',), samples=2, duration_ratio=0.25)]
    assert all(row.fault for row in rows)


def test_a_run_that_stops_is_a_fault(monkeypatch):
    monkeypatch.setitem(CASES, 'free', CASES['free']._replace(
        parameters={**CASES['free'].parameters, 'solver.energy_limit': 1e-9}))
    (row,) = measure_predictability(('free',), ('leapfrog',), samples=1, duration_ratio=0.25)
    assert 'energy' in row.fault and math.isnan(row.time)


def made_up(fault):
    def rows():
        yield Row('free', 'dop8', 0.1, 7, 1.0, 1.0, 1.0, 3.0, 1e-15, 1e-13, '')
        yield Row('free', 'dop8', 0.2, 14, 2.0, 2.0, 2.0, 6.0, 1e-15, 1e-13, fault)
    return rows


def test_the_command_prints_and_writes(monkeypatch, tmp_path, capsys):
    table = tmp_path / 'new' / 'growth.csv'
    monkeypatch.setattr(predictability, 'measure_predictability', made_up(''))
    assert main(['stress', '--predictability', '--output', str(table)]) == 0
    assert '1 runs, 0 with growth' in capsys.readouterr().out
    with table.open() as file:
        assert [row['steps'] for row in csv.DictReader(file)] == ['7', '14']
    monkeypatch.setattr(predictability, 'measure_predictability', made_up('round-off adds 1 a'))
    assert main(['stress', '--predictability', '--json']) == 1
    rows = [*map(json.loads, capsys.readouterr().out.splitlines())]
    assert rows[1]['fault'] == 'round-off adds 1 a' and rows[0]['growth_15'] == 3.0


def test_what_does_not_go_with_it_is_refused(capsys, monkeypatch):
    monkeypatch.setattr(predictability, 'measure_predictability', None)
    for words, part in ((['--seed', '0'], '--seed'), (['--map'], '--map'),
                        (['--named'], '--named'), (['--steps', '500'], '--steps'),
                        (['--list'], '--list')):
        assert main(['stress', '--predictability', *words]) == 2
        assert part in capsys.readouterr().err
