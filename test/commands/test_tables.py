# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""`icofabric tables`: the tables of the document from the code's data, and Figure 5."""

from collections import Counter
import itertools
import json
import math
from pathlib import Path
import re

from icofabric_sim.commands.main import main
from icofabric_sim.geometry.icosahedron import midradius, NAMED_EDGES
from icofabric_sim.pictures.document_figures import draw_figure
from icofabric_sim.pictures.weave_diagram import connector_stubs, length_curve, PAIR_COLORS
from icofabric_sim.scene.weave_geometry import geometry_from_angle
from icofabric_sim.scene.weave_index import centre_rule
import numpy as np
import pytest

SIZES = ((5, 5, 5), (4, 5, 3), (3, 3, 2), (2, 7, 4))


@pytest.fixture
def printed(monkeypatch, capsys):
    """What the verb prints for some words."""
    monkeypatch.setattr('signal.signal', lambda number, handler: None)

    def get(*words):
        assert main(['tables', *map(str, words)]) == 0
        return capsys.readouterr().out

    return get


@pytest.fixture
def tables(printed):
    """Tables by number, as JSON has them."""
    def get(*words):
        found = json.loads(printed(*words, '--json'))['tables']
        return {table['number']: table for table in found}

    return get


def occupied(parity, size):
    x, y, z = np.indices(size)
    return (x + y + z) % 2 == parity


@pytest.mark.parametrize('size', SIZES)
def test_counts_are_those_of_the_places(tables, size):
    found = tables(1, 2, 3, 4, '--size', *size)
    for parity in (0, 1):
        there = occupied(parity, size)
        # Where level 0 and line 0 or 1 lie, and levels 0 and 1.
        assert found[1]['rows'][parity][1:] == there.sum(axis=0)[:2, 0].tolist()
        assert found[2]['rows'][parity][1:] == there.sum(axis=1)[:2, 0].tolist()
        assert found[3]['rows'][parity][1:] == there.sum(axis=(0, 1))[:2].tolist()
        assert found[4]['rows'][parity][1:] == [there.sum()]
        assert found[1]['rows'][parity][0] == ('0 or 2', '1 or 3')[parity]


def test_table_3_says_that_it_is_corrected(printed):
    """As printed, variant 0 has (9 - 1)/2 in level 0 of 3 x 3, which holds five."""
    text = printed(3, '--size', 3, 3, 3)
    assert re.search(r'0 or 2 +5 +4\n', text) and 'Corrected: k counts from 0' in text
    assert max(map(len, text.splitlines())) < 100


@pytest.mark.parametrize('size', SIZES)
def test_connections_are_counted_as_pairs_of_neighbours(tables, size):
    places = np.argwhere(occupied(0, size))
    apart = places[:, None] - places[None]
    pairs = ((np.abs(apart).sum(axis=2) == 2) & (np.abs(apart).max(axis=2) == 1)).sum() // 2
    for _, *counts in tables(10, '--size', *size)[10]['rows']:
        assert counts == [pairs, pairs]


def test_table_5_has_two_connectors_at_each_edge(tables, printed):
    rows = tables(5)[5]['rows']
    assert [row[0] for row in rows] == list(NAMED_EDGES)
    for local, remote, *centres in rows:
        assert {local, remote} in ({'up', 'down'}, {'north', 'south'}, {'west', 'east'})
        one, other = np.array(centres)
        common, other_way = (one + other) / 2, (one - other) / 2
        axis = 'zxy'[NAMED_EDGES.index(local) // 2]
        # Table 5 as printed: up +z, +-x; north +x, +-y; west +y, +-z.
        assert np.flatnonzero(common).tolist() == ['xyz'.index(axis)]
        assert np.flatnonzero(other_way).tolist() == ['xyz'.index({'z': 'x', 'x': 'y', 'y': 'z'}[
            axis])]
        assert common.sum() == (1 if local in ('up', 'north', 'west') else -1)
    assert re.search(r'up +down +\(W, 0, W\) +\(-W, 0, W\)\n', printed(5))


@pytest.mark.parametrize('variant', [0, 1, 2, 3])
def test_tables_6_to_9_lead_to_the_centres_that_they_say(tables, variant):
    table = tables(6 + variant)[6 + variant]
    assert len(table['rows']) == 12 and table['title'].endswith(f'variant {variant}')
    line = 1 if variant < 2 else 0
    for _, _, displacement, *steps in table['rows']:
        for local in itertools.product(range(2), repeat=3):
            step = steps[(local[line] + local[2]) % 2]
            there = centre_rule(variant, *(np.array(local) + step))
            assert (there - centre_rule(variant, *local)).tolist() == displacement
    # In each row the neighbour's own table has the way back.
    ways = Counter((local, remote, tuple(way)) for local, remote, way, *_ in table['rows'])
    assert ways == Counter(
        (remote, local, tuple(-part for part in way)) for local, remote, way in ways)


def test_text_is_that_of_the_document(printed):
    """Some rows as the document prints them."""
    text = printed()
    assert re.findall(r'^Table (\d+):', text, re.MULTILINE) == [str(n) for n in range(1, 11)]
    for row in (
            r'up +down +\(W, 0, W\) +\(i, j, k\+1\) +\(i\+1, j, k\+1\)',
            r'south +north +\(-W, W, 0\) +\(i-1, j\+1, k\) +\(i, j\+1, k\)',
            r'west +east +\(-W, 0, -W\) +\(i-1, j, k-1\) +\(i-1, j, k-1\)'):
        assert re.search(rf'^ +{row}$', text, re.MULTILINE), row


def test_curve_of_figure_5():
    """Eq 51 along the curve, from the printed L_min at the printed theta_min."""
    angles, lengths = length_curve()
    rise = lengths * np.sin(angles)
    assert 2 * rise**2 + 2 * rise == pytest.approx(lengths**2 - 1, abs=1e-12)
    assert (math.degrees(angles[0]), lengths[0]) == pytest.approx((-20.90515745, 0.774596669))
    assert lengths[-1] == pytest.approx(6.0) and (np.diff(lengths) > 0.0).all()


def test_stubs_are_connectors_of_the_right_length_and_angle():
    geometry = geometry_from_angle(0.01, 0.25)
    ends = connector_stubs(0.01, 0.25)
    assert ends.shape == (12, 2, 3)
    assert np.linalg.norm(ends[:, 0], axis=1) == pytest.approx(midradius(0.01), rel=1e-14)
    connector = ends[:, 1] - ends[:, 0]
    assert np.linalg.norm(connector, axis=1) == pytest.approx(
        geometry.connector_length, rel=1e-12)
    outward = ends[:, 0] / midradius(0.01)
    assert np.einsum('ca,ca->c', connector, outward) == pytest.approx(
        geometry.connector_length * math.sin(0.25), rel=1e-12)


def test_figure_is_drawn(printed, tmp_path):
    said = printed('--figure', tmp_path / 'new' / 'a.svg')
    assert said == f'Figure 5 drawn to {tmp_path}/new/a.svg\n'
    text = (tmp_path / 'new' / 'a.svg').read_text('utf-8')
    assert all(f'{name} (' in text for name in NAMED_EDGES) and 'Figure 5' in text
    assert all(color in text for color in PAIR_COLORS)
    draw_figure('5', tmp_path / 'b.svg')
    assert (tmp_path / 'b.svg').read_text('utf-8') == text
    with_table = json.loads(printed(5, '--json', '--figure', tmp_path / 'a.png'))
    assert [table['number'] for table in with_table['tables']] == [5]
    assert with_table['figure'] == str(tmp_path / 'a.png')
    check_picture(tmp_path / 'a.png')


def check_picture(path):
    from matplotlib.image import imread
    picture = imread(path)
    assert picture.shape[:2] == (620, 1300)
    for color in PAIR_COLORS:
        wanted = np.array([int(color[k:k + 2], 16) for k in (1, 3, 5)]) / 255
        assert (np.abs(picture[..., :3] - wanted).max(axis=-1) < 0.02).sum() > 200


def test_picture_of_the_page_is_such_a_figure():
    check_picture(Path(__file__).resolve().parents[2] / 'docs' / 'figure_5.png')


def test_colours_of_the_edges_are_three_and_dark_enough_on_white():
    def luminance(color):
        parts = np.array([int(color[k:k + 2], 16) for k in (1, 3, 5)]) / 255
        linear = np.where(parts < 0.04045, parts / 12.92, ((parts + 0.055) / 1.055)**2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    assert len(set(PAIR_COLORS)) == 3
    # A contrast of 3 at least, as WCAG 2 asks of graphics and large text.
    assert all(1.05 / (luminance(color) + 0.05) >= 3.0 for color in PAIR_COLORS)
