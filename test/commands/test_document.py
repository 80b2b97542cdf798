# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric document`: appendix, tables and figures against independent calculations."""

import json
import math
from pathlib import Path
import re

from icofabric_sim.commands.document import add_arguments
from icofabric_sim.commands.main import main
from icofabric_sim.geometry import icosahedron
from icofabric_sim.pictures import document_figures
from icofabric_sim.pictures.document_figures import FIGURES
import numpy as np
import pytest
from scipy.integrate import tplquad

ROOT = Path(__file__).resolve().parents[2]
ROOT_5 = math.sqrt(5.0)
TAU = (1.0 + ROOT_5) / 2.0
NAMES = ['V', 'xcm', 'ycm', 'zcm', 'Ixx', 'Iyy', 'Izz', 'Ixy', 'Ixz', 'Iyz']


@pytest.fixture
def printed(monkeypatch, capsys):
    """What the verb prints for some words."""
    monkeypatch.setattr('signal.signal', lambda number, handler: None)

    def get(*words, status=0):
        assert main(['document', *map(str, words)]) == status
        return capsys.readouterr().out

    return get


@pytest.fixture
def appendix(printed):
    return lambda *words: json.loads(printed('appendix', '--json', *words))['appendix']


def exact(text):
    """The value of a text such as -(7 + 3 sqrt(5))/24."""
    assert re.fullmatch(r'[-+/() 0-9]*(sqrt\(5\))?[-+/() 0-9]*', text)
    return eval(re.sub(r'(\d) sqrt', r'\1*sqrt', text), {'sqrt': math.sqrt})


def integrals_of_a_pyramid(corners):
    """
    The ten integrals over the pyramid of the centre and a triangle.

    Over a tetrahedron of volume V with vertices 0 and v, integral x = V/4 sum v, and
    integral x x^T = V/20 (sum v v^T + s s^T) with s = sum v.
    """
    volume, s = np.linalg.det(corners) / 6.0, corners.sum(axis=0)
    moments = volume / 20.0 * (corners.T @ corners + np.outer(s, s))
    tensor = np.trace(moments) * np.eye(3) - moments
    return [volume, *(volume / 4.0 * s), *np.diag(tensor), *tensor[[0, 0, 1], [1, 2, 2]]]


def test_200_integrals_are_those_of_pyramids(appendix):
    found = appendix()
    assert [face['face'] for face in found['faces']] == list(range(1, 21))
    for face in found['faces']:
        corners = np.array([[exact(part) for part in vertex] for vertex in face['vertices']])
        assert list(face['integrals']) == NAMES
        numbers = [face['integrals'][name]['coefficient'] for name in NAMES]
        assert numbers == pytest.approx(integrals_of_a_pyramid(corners), rel=1e-13, abs=1e-14)
        assert numbers == pytest.approx(
            [exact(face['integrals'][name]['exact']) for name in NAMES], rel=1e-14)
    totals = np.array([
        [face['integrals'][name]['coefficient'] for name in NAMES] for face in found['faces']])
    assert [found['totals'][name]['coefficient'] for name in NAMES] == pytest.approx(
        totals.sum(axis=0), rel=1e-13, abs=1e-13)


@pytest.mark.parametrize('number, name, integrand', [
    (1, 'V', lambda x, y, z: 1.0), (8, 'Ixy', lambda x, y, z: -1200.0 * x * y),
    (13, 'Iyy', lambda x, y, z: 1200.0 * (x * x + z * z)), (19, 'zcm', lambda x, y, z: z)])
def test_integrals_are_those_of_equation_34_by_scipy(appendix, number, name, integrand):
    found = appendix('--edge', 2.0, '--thickness', 0.6)
    a, b = found['shell']['half_edge'], found['shell']['inner_half_edge']
    assert (a, b) == pytest.approx((1.0, 1.0 - 0.6 / math.sqrt(2.0 / 3.0 + TAU)))
    face = found['faces'][number - 1]
    v1, v2, v3 = a * np.array([[exact(part) for part in v] for v in face['vertices']])
    frame = np.stack([v1, v2 - v1, v3 - v1], axis=1)
    value, _ = tplquad(
        lambda l3, l2, l1: integrand(*(frame @ [l1, l2, l3])) * np.linalg.det(frame),
        b / a, 1.0, 0.0, lambda l1: l1, 0.0, lambda l1, l2: l1 - l2)
    assert face['integrals'][name]['value'] == pytest.approx(value, rel=1e-10)


def test_totals_are_those_that_the_document_prints(appendix, printed):
    """The Maple output, with a^5 for a^-5 (C16)."""
    found = appendix()
    totals = {name: number['coefficient'] for name, number in found['totals'].items()}
    assert totals['V'] == pytest.approx(10.0 + 10.0 / 3.0 * ROOT_5, rel=1e-15)
    moment = -16.0 / 3.0 * (-7.0 - 3.0 * ROOT_5) / ((-1.0 + ROOT_5) * (1.0 + ROOT_5))
    for name in ('Ixx', 'Iyy', 'Izz'):
        assert totals[name] == pytest.approx(moment, rel=1e-14)
    for name in ('xcm', 'ycm', 'zcm', 'Ixy', 'Ixz', 'Iyz'):
        assert found['totals'][name]['exact'] == '0'
    one, = found['eigensystem']
    assert one['eigenvalue'] == pytest.approx(16.0 / 3.0 * -1.0 / (-7.0 + 3.0 * ROOT_5), rel=1e-13)
    assert np.abs(one['eigenvectors']).tolist() == np.eye(3).tolist()
    text = printed('appendix')
    assert re.search(r'^ +sum +\(30 \+ 10 sqrt\(5\)\)/3 = 17\.453560$', text, re.MULTILINE)
    assert 'Eigenvalue (28 + 12 sqrt(5))/3 = 18.27760524, 3-fold' in text
    assert len(re.findall(r'^ +\d+  ', text, re.MULTILINE)) == 4 * 20


@pytest.mark.parametrize('edge, thickness', [(0.02, 0.002), (1.0, 1e-9), (3.0, 2.2), (1e-6, 1e-8)])
def test_checks_pass_for_thin_and_thick_shells(printed, appendix, edge, thickness):
    words = ('--edge', edge, '--thickness', thickness, '--density', 2700.0)
    text = printed('appendix', *words)
    assert text.count('  passed  ') == 10 and 'FAILED' not in text
    found = appendix(*words)
    assert all(check['holds'] for check in found['checks'])
    assert found['shell']['mass'] == pytest.approx(
        2700.0 * found['totals']['V']['value'], rel=1e-12)
    assert found['shell']['inertia'] == pytest.approx(found['totals']['Izz']['value'], rel=1e-12)


@pytest.mark.parametrize('change, failing', [
    (lambda faces: faces[1].put([1, 2], faces[1, [2, 1]]), ('right-handed', 'eqs 42', 'eq 43')),
    (lambda faces: faces[4].put([0, 1, 2], faces[0]), ('20 faces', 'centre of mass', 'eq 43')),
    (lambda faces: faces[4].put([2], [9]), ('2a long', 'right-handed', 'Maple output'))],
    ids=['left-handed', 'twice', 'wrong vertex'])
def test_checks_fail_for_another_list_of_faces(monkeypatch, printed, change, failing):
    faces = icosahedron.FACES.copy()
    change(faces)
    monkeypatch.setattr(icosahedron, 'FACES', faces)
    icosahedron.face_geometry.cache_clear()
    try:
        text = printed('appendix', status=1)
    finally:
        icosahedron.face_geometry.cache_clear()
    failed = re.findall('  FAILED  (.*)', text)
    assert failed and all(any(words in line for line in failed) for words in failing), failed


def test_tables_are_those_of_the_alias_with_their_sources(printed, capsys):
    assert main(['tables', '--size', '3', '4', '5']) == 0
    alone = capsys.readouterr().out.rstrip('\n').split('\n\n')
    ours = printed('tables', '--size', 3, 4, 5).rstrip('\n').split('\n\n')
    assert len(alone) == 10
    for table, with_source in zip(alone, ours, strict=True):
        text, source = with_source.rsplit('\n', 1)
        assert text == table and re.fullmatch(r'  eqs [\d, to]+(; erratum C6)?', source)
    assert ours[2].endswith('erratum C6')
    assert re.findall(r'^Table (\d+)', printed('tables', 5, 6), re.MULTILINE) == ['5', '6']
    whole = printed()
    assert re.findall(r'^(Table|Appendix)', whole, re.MULTILINE) == 10 * ['Table'] + ['Appendix']
    found = json.loads(printed(3, '--json'))
    assert found['appendix'] is None and found['tables'][0]['errata'] == ['C6']


def test_figures_are_drawn_with_their_sources(printed, tmp_path):
    said = printed('--figures', tmp_path / 'new', '--format', 'svg')
    assert len(said.splitlines()) == len(FIGURES) and 'Table 1' not in said
    errata = (ROOT / 'docs' / 'errata.md').read_text('utf-8')
    for name, figure in FIGURES.items():
        path = tmp_path / 'new' / f'figure_{name}.svg'
        text = path.read_text('utf-8')
        assert f'{figure.number}: {figure.title}' in text and figure.sources in text
        assert f'{figure.number}: {figure.title}' in said and f'drawn to {path}' in said
        assert all(1 <= number <= 65 for number in figure.equations)
        assert all(f'| {number} |' in errata for number in figure.errata)
    assert {figure.number for figure in FIGURES.values()} == {
        *(f'Figure {number}' for number in range(1, 8)), 'Table 5'}
    shown = (tmp_path / 'new' / 'figure_2.svg').read_text('utf-8')
    assert 'x_cm = x_0 - R' in shown and "r = R + r'" in shown
    found = json.loads(printed('--figure', '3b', tmp_path / 'a.png', '--json'))
    assert found['figures'] == [{
        'figure': '3b', 'title': 'frustum of a face', 'equations': list(range(28, 35)),
        'errata': ['C2', 'C5', 'C16'], 'file': str(tmp_path / 'a.png')}]
    assert (tmp_path / 'a.png').stat().st_size > 10_000


def test_help_names_every_figure():
    from argparse import ArgumentParser
    parser = ArgumentParser()
    add_arguments(parser)
    text = ' '.join(parser.format_help().split()).partition('N: ')[2]
    assert [name for name in FIGURES if not re.search(rf'\b{name}\b', text)] == []


def test_golden_rectangles_have_the_vertices_as_corners_and_golden_sides():
    corners = document_figures.golden_rectangles()
    assert sorted(map(tuple, corners.reshape(12, 3))) == sorted(
        map(tuple, icosahedron.vertices(1.0)))
    sides = np.roll(corners, -1, axis=1) - corners
    assert np.linalg.norm(sides, axis=2) == pytest.approx(np.array(3 * [[2, 2 * TAU] * 2]))
    normals = np.cross(sides[:, 0], sides[:, 1]) / (4.0 * TAU)
    assert normals @ normals.T == pytest.approx(np.eye(3))


def test_frustum_lies_between_two_similar_triangles():
    """Eq 31 at lambda = (r, 0, 0), (r, r, 0) and (r, 0, r): the vertices of the face times r."""
    face = icosahedron.outer_triangles(1.0)[document_figures._FRUSTUM_FACE - 1]
    for ratio in (1.0, 0.5):
        assert document_figures.frustum_section(ratio) == pytest.approx(ratio * face)


def test_axes_of_the_body_are_right_handed():
    axes = document_figures.body_axes()
    assert axes @ axes.T == pytest.approx(np.eye(3)) and np.linalg.det(axes) == pytest.approx(1.0)
    assert np.abs(axes - np.eye(3)).max() > 0.2
