# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The map of stability: what runs, what is refused, what is against the theory; its command."""

import csv
import json
import math

from icofabric_sim.commands.main import main
from icofabric_sim.simulation.stepping.methods import facts_of, IMPLICIT, METHODS
from icofabric_validation import stability_map
from icofabric_validation.stability_map import Cell, map_stability
import pytest


def test_steps_are_refused_where_the_theory_says():
    cells = [*map_stability(('free',), products=(0.2, 1.9, 2.1, 3.0, 3.3, 5.0, 6.5), steps=200)]
    assert len(cells) == 7 * len((*METHODS, *IMPLICIT)) and not any(cell.fault for cell in cells)
    for cell in cells:
        facts = facts_of(cell.method)
        assert (cell.outcome == 'refused') == (cell.product > facts.stability)
        if cell.outcome == 'ran':
            assert cell.steps == (20 if facts.implicit else 200)
            assert cell.norm < 1e-14 and cell.momentum < 1e-13
            assert 0.0 < cell.energy < 1.0
    # Of order 2 the energy swings by the square of the step.
    swings = [next(map_stability(('free',), ('leapfrog',), products=(product,), steps=400)).energy
              for product in (0.1, 0.4)]
    assert swings[1] / swings[0] == pytest.approx(16.0, rel=0.2)


def test_implicit_steps_have_no_limit_and_gain_no_energy(monkeypatch):
    for fabric in ('free', 'hanging'):
        cells = [*map_stability((fabric,), ('sdirk4',), products=(0.2, 2.0, 20.0), steps=1000)]
        assert [cell.outcome for cell in cells] == ['ran'] * 3
        assert not any(cell.fault for cell in cells)
        assert all(cell.steps == 100 and cell.norm < 1e-14 for cell in cells)
        # Long steps take the fast vibrations away.
        assert cells[0].energy < 1e-5 < 1e-3 < cells[2].energy
    # As an explicit method would beyond its limit, or one with a wrong sign.
    monkeypatch.setattr(stability_map, '_measure_drifts', lambda *words: (0.5, 0.02, 0.0, 0.0))
    (cell,) = map_stability(('free',), ('sdirk4',), products=(0.2,), steps=1000)
    assert 'gains 0.02' in cell.fault


def test_driven_and_tensioned_fabrics_have_the_limit_of_their_own_frequency():
    for fabric in ('driven', 'tensioned'):
        cells = [*map_stability((fabric,), ('leapfrog', 'srkn6'), products=(0.2, 1.95, 3.05, 3.25),
                                steps=100)]
        assert [cell.outcome for cell in cells] == [
            'ran', 'ran', 'refused', 'refused', 'ran', 'ran', 'ran', 'refused']
        assert not any(cell.fault for cell in cells) and math.isnan(cells[0].momentum)
    # Tension stiffens.
    assert stability_map._largest_frequency(stability_map.FABRICS['tensioned']) > 1.1 * (
        stability_map._largest_frequency(stability_map.FABRICS['free']))


def test_shells_that_stay_pressed_together_are_as_smooth_as_springs():
    """The energy of leapfrog errs by the square of the step, also through contacts."""
    assert stability_map.methods_of('touching', ('leapfrog', 'sdirk4')) == ['leapfrog', 'sdirk4']
    (cell,) = map_stability(('touching',), ('sdirk4',), products=(0.2,), steps=1000)
    assert cell.outcome == 'ran' and not cell.fault and 0.0 < cell.energy < 1e-3
    cells = [*map_stability(('touching',), ('leapfrog',), products=(0.2, 1.0, 2.1), steps=400)]
    assert [cell.outcome for cell in cells] == ['ran', 'ran', 'refused']
    assert not any(cell.fault for cell in cells)
    assert 15.0 < cells[1].energy / cells[0].energy < 40.0
    assert cells[0].momentum < 1e-9
    # Connectors alone, which hold faces apart that are pressed, are another fabric.
    apart = {**stability_map.FABRICS['touching'], 'contact.mode': 'never'}
    touching = stability_map._largest_frequency(stability_map.FABRICS['touching'])
    assert touching > 1.1 * stability_map._largest_frequency(apart)


def test_connectors_that_break_are_followed_up_to_the_limit():
    assert stability_map.methods_of('breaking') == ['dop8']
    low, high, beyond = map_stability(('breaking',), products=(0.2, 5.8, 6.1), steps=200)
    # A step that ends where one breaks is two.
    assert low.steps > 200 and high.steps > 200 and beyond.outcome == 'refused'
    assert low.energy < 1e-8 and low.momentum < 1e-14 and not low.fault and not beyond.fault


def test_a_limit_that_is_too_high_is_found(monkeypatch):
    monkeypatch.setitem(METHODS, 'leapfrog', METHODS['leapfrog']._replace(stability=3.0))
    (cell,) = map_stability(('free',), ('leapfrog',), products=(2.2,), steps=400)
    assert 'energy error too large' in cell.fault


def test_what_is_against_the_theory_is_a_fault(monkeypatch):
    # The largest frequency is taken for ten times, or a tenth, of what it is.
    real = stability_map._largest_frequency
    for factor, product, words in ((10.0, 4.0, 'ran beyond'), (0.1, 0.5, 'refused below')):
        monkeypatch.setattr(
            stability_map, '_largest_frequency', lambda values, f=factor: f * real(values))
        (cell,) = map_stability(('free',), ('leapfrog',), products=(product,), steps=100)
        assert words in cell.fault


def made_up(fault):
    """Three cells that need no run."""
    def cells(fabrics, *, products, steps):
        yield Cell('free', 'leapfrog', 0.1, 'ran', steps, 1e-3, 1e-16, 1e-16, '')
        yield Cell('free', 'leapfrog', 1.9, 'stopped', 7, math.nan, math.nan, math.nan, '')
        yield Cell('free', 'leapfrog', 2.1, 'refused', 0, math.nan, math.nan, math.nan, fault)
    return cells


def test_the_command_prints_writes_and_draws(monkeypatch, tmp_path, capsys):
    table, picture = tmp_path / 'new' / 'map.csv', tmp_path / 'newer' / 'map.png'
    monkeypatch.setattr(stability_map, 'map_stability', made_up(''))
    words = ['stress', '--map', '--steps', '500', '--output', str(table), '--picture',
             str(picture)]
    assert main(words) == 0
    assert '3 runs of 500 steps, 0 contradict the theory' in capsys.readouterr().out
    with table.open() as file:
        assert [row['outcome'] for row in csv.DictReader(file)] == ['ran', 'stopped', 'refused']
    assert picture.read_bytes().startswith(b'\x89PNG')
    monkeypatch.setattr(stability_map, 'map_stability', made_up('ran'))
    assert main(['stress', '--map', '--json']) == 1
    rows = [*map(json.loads, capsys.readouterr().out.splitlines())]
    assert rows[0]['steps'] == stability_map.STEPS and rows[1]['energy'] is None


def test_the_command_takes_a_part_of_the_map(capsys):
    words = ['stress', '--map', '--steps', '100', '--json', '--fabrics']
    assert main([*words, 'breaking, free', '--products', '0.5,2.1']) == 0
    rows = [*map(json.loads, capsys.readouterr().out.splitlines())]
    assert [(row['fabric'], row['product']) for row in rows if row['method'] == 'dop8'] == [
        ('free', 0.5), ('free', 2.1), ('breaking', 0.5), ('breaking', 2.1)]
    assert main([*words, 'free,silk']) == 2 and "'silk'" in capsys.readouterr().err
    for text in ('0', 'x', '1,-2', 'inf', 'nan', ''):
        assert main([*words, 'free', '--products', text]) == 2
        assert '--products must be' in capsys.readouterr().err


def test_an_interrupt_loses_no_row(monkeypatch, tmp_path):
    def ends(fabrics, *, products, steps):
        yield from made_up('')(fabrics, products=products, steps=steps)
        # What is known is on the disk before anything else begins.
        with table.open() as file:
            assert [row['outcome'] for row in csv.DictReader(file)] == [
                'ran', 'stopped', 'refused']
        raise KeyboardInterrupt
    table = tmp_path / 'map.csv'
    monkeypatch.setattr(stability_map, 'map_stability', ends)
    assert main(['stress', '--map', '--output', str(table)]) == 130
    assert len(table.read_text().splitlines()) == 4


def test_all_but_what_is_closest_to_a_limit_is_judged():
    for name, method in METHODS.items():
        parts = [product / method.stability for product in stability_map.PRODUCTS]
        below = [part for part in parts if part < 1.0 - stability_map._LIMIT_TOLERANCE_RATIO]
        above = [part for part in parts if part > 1.0 + stability_map._LIMIT_TOLERANCE_RATIO]
        # No mapped product lies between 0.42 and 1.04 of the limit of tsit5.
        assert max(below) >= (0.4 if name == 'tsit5' else 0.65) and min(above) <= 1.1, name
        assert len(below) + len(above) >= len(parts) - 1


def test_what_does_not_go_with_it_is_refused(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(stability_map, 'map_stability', None)
    for words, part in ((['--map', '--seed', '1'], '--seed'), (['--steps', '500'], '--map'),
                        (['--map', '--named'], '--named'), (['--picture', 'x.png'], '--map'),
                        (['--map', '--seed', '0'], '--seed'),
                        (['--map', '--processes', '1'], '--processes'),
                        (['--map', '--picture', str(tmp_path / 'map.svg')], '.png'),
                        (['--map', '--steps', '5'], '--steps')):
        assert main(['stress', *words]) == 2
        assert part in capsys.readouterr().err
