# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The study of the material: its verb end to end, its formulas, and its independent code."""

from dataclasses import replace
import itertools
import json
import math
from pathlib import Path
import re

import icofabric_sim as ico
from icofabric_sim import contact
from icofabric_sim.commands.main import main
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.pictures.figure_style import COLORS
from icofabric_sim.scene.weave_geometry import MINIMUM_ANGLE
from icofabric_sim.statics.fabric import StaticFabric
from icofabric_sim.statics.floppy import find_floppy
from icofabric_sim.statics.held_motion import held_motion
from icofabric_sim.statics.modes import solve_modes
from icofabric_sim.statics.slab_path import follow_path
from icofabric_sim.sweeps import single_run
from icofabric_sim.sweeps.independent import (
    compare_energies,
    PlainSlab,
    require_plain,
)
from icofabric_sim.sweeps.outcomes import carry_out, make_work
from icofabric_validation.material.catalogue import make_study, PARTS
from icofabric_validation.material.jamming import jamming_ratio
from icofabric_validation.material.part import cell, closed_form_ratio, fixed, Level, woven
from icofabric_validation.material.surfaces import expected, surface_mechanisms
from icofabric_validation.source_tree import ROOT
from matplotlib.image import imread
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

PAGE = ROOT / 'docs' / 'study.md'
LARGEST = 150_000  # [bytes] of a figure


# The verb.

def study(tmp_path, *words):
    return main(['study', '--quick', '--workers', '0', '--store', str(tmp_path / 'store'),
                 '--output', str(tmp_path / 'out'), *words])


def test_a_part_goes_on_where_it_was_interrupted_and_does_nothing_twice(
        tmp_path, capsys, monkeypatch):
    done = []

    def counted(*arguments):
        if len(done) == 5:
            raise KeyboardInterrupt
        done.append(arguments)
        return carry_out(*arguments)

    monkeypatch.setattr(single_run, 'carry_out', counted)
    assert study(tmp_path, '--part', 'constants') == 130
    assert 'finished runs are kept' in capsys.readouterr().err
    assert study(tmp_path, '--list') == 0
    assert re.search(r'^constants .*: 24 runs, 5 finished', capsys.readouterr().out, re.MULTILINE)
    monkeypatch.setattr(single_run, 'carry_out', carry_out)
    assert study(tmp_path, '--part', 'constants') == 0
    assert '24 runs, 5 of them from the store, 0 failed' in capsys.readouterr().out
    first = {path.name: path.read_bytes() for path in (tmp_path / 'out').iterdir()}
    assert {*first} == {'constants.png', 'constants.txt', 'constants.endless.csv'}
    monkeypatch.setattr(single_run, 'carry_out', None)
    assert study(tmp_path, '--part', 'constants') == 0
    said = capsys.readouterr().out
    assert '24 runs, 24 of them from the store' in said
    assert {path.name: path.read_bytes() for path in (tmp_path / 'out').iterdir()} == first
    # What is printed is what is kept, and the closed form of docs/material.md is in it.
    assert first['constants.txt'].decode() in f'{said}\n'
    rows = [line.strip('| ').split(' | ') for line in said.splitlines()
            if re.match(r'\| [\d.]+ \| -?0', line)]
    plain = [row for row in rows if row[0] == '0']
    assert len(plain) == 5 and plain[0][5] == '-0.500'
    for row in plain:
        s = math.sin(2.0 * float(row[1]))
        assert float(row[5]) == pytest.approx(s / (2.0 + s), abs=1e-3)
        assert row[4] == '0.000' and row[5] == row[6]
    # Bending stiffness bears shear.
    assert all(float(row[4]) > 0.2 for row in rows if row[0] == '1')
    said, = re.findall(r'closed form by at most (\S+)\.\n', said)
    assert float(said) < 1e-12
    # The same for programs.
    assert study(tmp_path, '--part', 'constants', '--json') == 0
    report = json.loads(capsys.readouterr().out)
    assert (report['runs'], report['from_store'], report['failed']) == (24, 24, 0)
    first_table = report['parts']['constants']['tables'][0]
    assert len(first_table['rows'][0]) == len(first_table['columns']) > 4
    assert study(tmp_path, '--list', '--json') == 0
    listed = json.loads(capsys.readouterr().out)['parts']
    assert listed['constants']['finished'] == 24 and len(listed) > 3


def test_a_part_whose_runs_fail_says_so_and_ends_with_1(tmp_path, capsys, monkeypatch):
    def failing(*arguments):
        raise ValueError('no such rest')

    monkeypatch.setattr(single_run, 'carry_out', failing)
    assert study(tmp_path, '--part', 'check') == 1
    said = capsys.readouterr()
    assert 'no such rest' in said.err and '1 failed' in said.out


@pytest.mark.parametrize('level', [
    pytest.param(level, marks=[pytest.mark.long] if level else []) for level in Level])
def test_all_parts_are_judged_before_anything_starts(level, tmp_path, capsys):
    assert study(tmp_path, '--part', 'nothing') == 2
    assert 'unknown part; choose from constants, slabs' in capsys.readouterr().err
    for part in PARTS.values():
        for name, stage in part.stages(level).items():
            judged = make_study(stage, tmp_path / 'none')
            assert len(judged.requests) == len(stage.cases) > 0, (part.name, name)
            # No run is there twice.
            assert len({request.key for request in judged.requests}) == len(stage.cases), name
    assert not (tmp_path / 'none').exists()


def test_cells_of_tables():
    assert [cell(value) for value in (0.12345, math.nan, 3.0, 12345, 'x', True)] == [
        '0.123', '-', '3', '12,345', 'x', 'True']
    assert [fixed(value, 2) for value in (-0.001, 1.005, math.nan)] == ['0.00', '1.00', '-']
    assert closed_form_ratio(MINIMUM_ANGLE) == pytest.approx(-0.5)
    assert jamming_ratio(MINIMUM_ANGLE) == pytest.approx(1.0)
    assert jamming_ratio(0.0) == pytest.approx(math.sqrt(0.6))


# Counting.

@pytest.mark.parametrize('size', [
    (1, 1, 1), (2, 2, 2), (3, 3, 3), (2, 3, 4), (3, 5, 1), (4, 4, 5), (5, 3, 7), (6, 1, 1)])
def test_connectors_of_a_slab_by_the_diagonals_of_unit_squares(size):
    scene = ico.Scene.from_parameters({'weave.size': list(size), 'contact.mode': 'never'})
    assert 6 * scene.body_count - scene.connector_count == expected(size)[0]


def test_a_cut_meets_the_connectors_that_lead_through_it():
    """Half of the ends that a plane cuts, of all twelve neighbours, per area W^2."""
    ways = np.array([
        way for way in itertools.product((-1, 0, 1), repeat=3) if np.abs(way).sum() == 2])
    assert len(ways) == 12
    normals = np.random.default_rng(5).standard_normal((50, 3))
    for normal in normals / np.linalg.norm(normals, axis=1, keepdims=True):
        along = ways @ normal
        assert surface_mechanisms(normal) == pytest.approx(0.5 * along[along > 0.0].sum() / 2.0)
        assert math.sqrt(0.75) <= surface_mechanisms(normal) <= math.sqrt(1.25)
    assert surface_mechanisms((1, 1, 1)) == pytest.approx(math.sqrt(0.75))
    assert surface_mechanisms((2, 1, 0)) == pytest.approx(math.sqrt(1.25))


@pytest.mark.parametrize('weave', [{}, {'kind': 'bias'}])
def test_places_of_mechanisms_add_up_to_their_number(weave):
    scene = ico.Scene.from_parameters({
        'weave': {'size': [4, 4, 4], 'connector_angle': 0.3, **weave},
        'contact': {'mode': 'never'}})
    found, spectrum = find_floppy(scene), solve_modes(scene)
    assert found.counts == spectrum.counts
    assert found.content.sum() == pytest.approx(spectrum.mechanism_count, abs=1e-9)
    assert (found.content > 0.1).all() and (found.content < 6.0).all()
    assert (found.rotation_content < found.content).all() and (found.rotation_content > 0.0).all()
    # The same from the shapes that modes finds: a basis of the same space, in scaled coordinates.
    shapes = spectrum.mechanisms * spectrum.configuration.fabric.root
    basis = np.linalg.qr(shapes.reshape(spectrum.mechanism_count, -1).T)[0]
    assert (basis**2).sum(axis=1).reshape(-1, 6).sum(axis=1) == pytest.approx(
        found.content, abs=1e-8)
    if weave:
        assert np.isnan(list(found.by_place().values())).all()
        return
    by_place = found.by_place()
    corners = (np.ptp(scene.weave.grid, axis=0) > 0).all() and found.place == 0
    assert by_place['corner'] == pytest.approx(found.content[corners].mean())
    assert by_place['corner'] > by_place['edge'] > by_place['face'] > by_place['within']
    assert math.isnan(by_place['depth.3']) and by_place['depth.1'] == by_place['within']


def test_where_mechanisms_are_is_refused_for_large_fabrics_by_name():
    scene = ico.Scene.from_parameters({'weave.size': [11, 11, 11], 'contact.mode': 'never'})
    with pytest.raises(ParameterError, match='weave.size: .* at most 3,000 degrees of freedom'):
        find_floppy(scene)


# The independent code.

def tight(stiffness=200.0, ratio=0.97, **more):
    plain = {'weave.size': [3, 3, 3], 'weave.connector_angle': MINIMUM_ANGLE}
    length = ico.Scene.from_parameters(plain).geometry.connector_length
    return ico.Scene.from_parameters({
        **plain, 'connector.natural_length': ratio * length,
        'contact.stiffness': stiffness * 500.0, **more})


def test_contact_of_two_shells_is_that_of_polytopes():
    slab = PlainSlab(tight())
    generator = np.random.default_rng(7)
    met = 0
    for _ in range(12):
        first, second = Rotation.random(2, random_state=generator)
        way = generator.standard_normal(3)
        apart = 0.01 * generator.uniform(2.7, 3.3) * way / np.linalg.norm(way)
        push = contact.contact_force(
            0.01, (np.zeros(3), first.as_quat()), (apart, second.as_quat()), 1e5)
        energy, wrench = slab._push(apart, first.as_matrix(), second.as_matrix())
        met += push.in_contact
        assert energy == pytest.approx(push.energy, rel=1e-9, abs=1e-18)
        assert wrench[:3] == pytest.approx(-np.array(push.force), rel=1e-8, abs=1e-9)
        assert wrench[3:] == pytest.approx(
            np.array(push.torque_on_second), rel=1e-7, abs=1e-10)
    assert 6 <= met < 12


def test_energies_and_forces_of_a_tight_slab_are_those_of_the_independent_code():
    scene = held_motion(tight(), 'shear', 0).placed(0.01)
    slab, fabric = PlainSlab(scene), StaticFabric(scene)
    place = 3e-3 * np.random.default_rng(3).standard_normal(6 * scene.body_count)
    position, turn = slab.pose(place)
    snapshot = ico.compile_scene(scene).snapshot()
    here = fabric.configuration('here', replace(
        snapshot, position=position, orientation=Rotation.from_matrix(turn).as_quat()))
    energy, gradient = slab.energy(place)
    assert len(here.contact_state.pairs) > 10
    assert energy == pytest.approx(here.energy, rel=1e-9)
    step = 1e-6
    for freedom in (0, 4, 31, 50):
        there = [slab.energy(place + sign * step * np.eye(len(place))[freedom])[0]
                 for sign in (1.0, -1.0)]
        assert gradient[freedom] == pytest.approx(
            (there[0] - there[1]) / (2.0 * step), rel=1e-5, abs=1e-8)
    assert gradient.reshape(-1, 6)[:, :3] == pytest.approx(
        -0.01 * here.force[:, :3], rel=1e-6, abs=1e-9)


def test_energy_of_a_slab_that_touches_is_the_work_that_went_in():
    """Castigliano, where contact takes part: with it the energy at rest is whole."""
    motion = held_motion(tight(), 'shear', 0)
    before, here, after = follow_path(motion, [0.99e-2, 1e-2, 1.01e-2])
    energies = [step.found.snapshot.energy for step in (before, here, after)]
    assert energies[1]['contact'] > 1e-6
    assert energies[1]['total'] == energies[1]['connectors'] + energies[1]['contact']
    assert here.conjugate == pytest.approx(
        (energies[2]['total'] - energies[0]['total']) / 2e-4, rel=1e-4)


@pytest.mark.long
def test_scipy_finds_the_same_rest_from_elsewhere():
    compared, = compare_energies(tight(), 'shear', [1e-3], 0)
    assert compared.scipy == pytest.approx(compared.package, rel=1e-9)
    assert compared.scipy_slope == pytest.approx(compared.package_slope, rel=1e-4)
    assert compared.position_difference < 1e-6 and compared.contact_pairs > 10


@pytest.mark.parametrize('changes, said', [
    ({'connector.bending_stiffness': 0.01}, 'connector.bending_stiffness'),
    ({'contact.stiffness': 0.0}, 'contact.stiffness must be above 0'),
    ({'connector.stiffness_compression': 10.0}, 'needs one stiffness'),
    ({'planes.floor.offset': -1.0, 'planes.floor.normal': [0.0, 0.0, 1.0]}, 'no planes')])
def test_what_the_independent_code_has_no_term_for_is_refused_by_name(changes, said):
    with pytest.raises(ParameterError, match=said):
        require_plain(tight(**changes))


# What sweeps keep of slabs.

def test_strength_says_what_happens_first():
    base = {
        'weave.size': [5, 3, 3], 'weave.connector_angle': 0.3,
        'connector.bending_stiffness': 0.02,
        'connector.break_length_extension': 1.06 * woven(0.3).connector_length}
    scene = ico.Scene.from_parameters(base)
    work = make_work('curve', ['strength pull 0.12 4 x', 'cycle pull 0.12 4 x'])
    kept = {column.name: column.value for column in carry_out(work, scene, Path())}
    strains = [1e-4, 3e-4, 1e-3, 0.03, 0.06, 0.09, 0.12]
    points = ico.measure_curve(scene, 'pull', strains)
    name = 'curve.pull.x'
    assert kept[f'{name}.modulus'] == pytest.approx(
        (points[1].stress - points[0].stress) / 2e-4, rel=1e-9)
    assert kept[f'{name}.modulus'] == pytest.approx(kept[f'{name}.secant'], rel=1e-2)
    assert kept[f'{name}.largest_stress'] == max(point.stress for point in points)
    first = next(point.strain for point in points if point.broken)
    assert kept[f'{name}.breaks_at'] == first > 0.03 and kept[f'{name}.broken'] > 0
    assert math.isnan(kept[f'{name}.buckles_at'])
    assert [float(word) for word in kept[f'{name}.strains'].split()] == strains
    cycle = 'curve.cycle.pull.x'
    assert 0.0 < kept[f'{cycle}.unloading_work'] < kept[f'{cycle}.loading_work']
    assert kept[f'{cycle}.loop_area'] == pytest.approx(
        kept[f'{cycle}.loading_work'] - kept[f'{cycle}.unloading_work'])
    assert kept[f'{cycle}.broken'] == kept[f'{name}.broken']


def test_curves_are_kept_of_both_signs_and_of_any_shear():
    scene = ico.Scene.from_parameters({
        'weave.size': [5, 3, 3], 'weave.connector_angle': 0.3,
        'connector.bending_stiffness': 0.02, 'connector.stiffness_compression': 200.0})
    work = make_work('curve', ['curve inflation 0.02 1', 'cycle hydrostatic 0.02 1',
                               'curve shear 0.02 1 xz', 'strength shear 0.02 1 xy'])
    kept = {column.name: column.value for column in carry_out(work, scene, Path())}
    for kind, name, along in (
            ('inflation', 'inflation.x', None), ('shear', 'shear.xz', [0, 0, 1])):
        [point] = ico.measure_curve(scene, kind, [0.02], along=along)
        assert kept[f'curve.{name}.stress.0.02'] == pytest.approx(point.stress, rel=1e-6)
    assert kept['curve.cycle.hydrostatic.x.loading_work'] > 0.0
    ratio = kept['curve.shear.xy.largest_stress'] / kept['curve.shear.xz.largest_stress']
    assert abs(ratio - 1.0) > 0.05


# The page.

def test_every_table_of_the_page_is_what_the_verb_wrote():
    text = PAGE.read_text('utf-8')
    tables = [line for line in text.splitlines() if line.startswith('|')]
    written = {line for path in sorted((ROOT / 'docs' / 'study').glob('*.txt'))
               for line in path.read_text('utf-8').splitlines()}
    assert len(tables) > 50
    for line in tables:
        assert line in written, f'docs/study.md: {line}'
    for name in PARTS:
        assert f'--part {name}' in text, name


def test_every_figure_of_the_page_is_drawn_as_figures_are():
    shown = re.findall(r'!\[[^\]]+\]\((study/\w+\.png)\)', PAGE.read_text('utf-8'))
    assert [f'study/{path.name}' for path in sorted((ROOT / 'docs' / 'study').glob('*.png'))] == (
        sorted(shown))
    for name in shown:
        path = ROOT / 'docs' / name
        assert path.stat().st_size < LARGEST
        pixels = np.rint(255.0 * imread(path)[:, :, :3]).reshape(-1, 3)
        for color in COLORS[:2]:
            wanted = [int(color[place:place + 2], 16) for place in (1, 3, 5)]
            assert (np.abs(pixels - wanted).max(axis=1) <= 2.0).sum() > 20, (name, color)
