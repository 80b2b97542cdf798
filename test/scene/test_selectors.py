# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.scene.selectors import Bodies, check_syntax, select
import numpy as np
import pytest

SCENE = make_scene((4, 3, 5))
BODIES = Bodies(SCENE.position, SCENE.weave.grid, SCENE.geometry.pitch)
X, Y, Z = SCENE.weave.grid.T
POSITION = SCENE.position
NUMBERS = np.arange(SCENE.body_count)
W = SCENE.geometry.pitch

FORMS = {
    'all': NUMBERS >= 0,
    'x_min': X == 0,
    'x_max': X == 3,
    'y_min': Y == 0,
    'y_max': Y == 2,
    'z_min': Z == 0,
    'z_max': Z == 4,
    'level 3': Z == 3,
    'row 1': X == 1,
    'column 2': Y == 2,
    'ids 0 5 7': np.isin(NUMBERS, [0, 5, 7]),
    'ids 3 3': NUMBERS == 3,
    f'box 0 0 0 {1.5 * W} {1.5 * W} {W * 1.000001}': (X <= 1) & (Y <= 1) & (Z <= 1),
    f'box -1e9 -1 -1 1 1 {0.5 * W:e}': Z == 0,
    'not z_max': Z != 4,
    'not not z_max': Z == 4,
    'not not not z_max': Z != 4,
    'z_max and x_min': (Z == 4) & (X == 0),
    'z_max or x_min': (Z == 4) | (X == 0),
    'z_max and not ids 0 29': (Z == 4) & (NUMBERS != 29),
    # not binds closest, or loosest.
    'level 0 or level 1 and row 0': (Z == 0) | (Z == 1) & (X == 0),
    'not level 0 and row 0 or ids 0': (Z != 0) & (X == 0) | (NUMBERS == 0),
    'ids 0 1 2 and ids 1 2 3 or column 0': np.isin(NUMBERS, [1, 2]) | (Y == 0),
    ' '.join(['not'] * 5000) + ' z_min': Z == 0,
}


@pytest.mark.parametrize('text', FORMS, ids=lambda text: text[:40])
def test_selectors(text):
    chosen = select('groups.g', text, BODIES)
    assert chosen.dtype == np.int32
    assert chosen.tolist() == np.flatnonzero(FORMS[text]).tolist()
    assert 0 < len(chosen)
    check_syntax('groups.g', text)


@pytest.mark.parametrize(
    'text, message',
    [
        ('', 'groups.g is an empty selector; use x_min'),
        ('   ', 'groups.g is an empty selector'),
        ('top', "'top' is unknown"),
        ('Z_MAX', "'Z_MAX' is unknown"),
        ('z_max and', 'a word is missing at the end'),
        ('not', 'a word is missing at the end'),
        ('and z_max', "'and' is unknown"),
        ('z_max x_min', "unexpected 'x_min'"),
        ('level', 'an integer is needed'),
        ('level x', 'an integer is needed'),
        ('level 1.5', 'an integer is needed'),
        ('ids', 'an integer is needed'),
        ('ids 1 2.5', "unexpected '2.5'"),
        ('row 1 2', "unexpected '2'"),
        ('box 0 0 0 1 1', '6 finite numbers'),
        ('box 0 0 0 1 1 nan', '6 finite numbers'),
        ('box 0 0 0 1 1 inf', '6 finite numbers'),
        ('box 0 0 0 1 1 x', "'x' is not a number"),
        ('box 1 0 0 0 1 1', 'second corner of a box must not lie below the first'),
        ('z_max; x_min', "'z_max;' is unknown"),
        ('( z_max )', r"'\(' is unknown"),
    ],
)
def test_what_is_no_selector_is_refused(text, message):
    for judge in (
        lambda: select('groups.g', text, BODIES),
        lambda: check_syntax('groups.g', text),
    ):
        with pytest.raises(ico.ParameterError, match=message) as caught:
            judge()
        assert caught.value.name == 'groups.g'


@pytest.mark.parametrize(
    'text, message',
    [
        ('ids 30', 'there is no body 30; bodies are numbered 0 to 29'),
        ('ids 0 -1', 'there is no body -1'),
        ('ids 99999999999999999999999', 'there is no body 9999'),
        (
            'level 5',
            "'level 5' selects no body of the 30; there are rows 0 to 3, columns 0 to 2, levels",
        ),
        ('level 99999999999999999999999', 'selects no body'),
        ('not all', "'not all' selects no body"),
        ('z_max and z_min', 'selects no body'),
        ('box 5 5 5 6 6 6', 'selects no body'),
    ],
)
def test_selectors_that_pick_nothing_are_refused(text, message):
    with pytest.raises(ico.ParameterError, match=message):
        select('groups.g', text, BODIES)
    check_syntax('groups.g', text)  # needs the fabric to be judged


def test_extremes_hold_bodies_within_half_a_pitch():
    position = np.array(
        [[0.0, 0, 0], [0.49, 0, 0], [0.51, 0, 0], [2.0, 0, 0], [1.49, 0, 0], [1.51, 0, 0]]
    )
    bodies = Bodies(position, np.zeros((6, 3), int), 1.0)
    assert select('groups.g', 'x_min', bodies).tolist() == [0, 1]
    assert select('groups.g', 'x_max', bodies).tolist() == [3, 5]
    assert select('groups.g', 'y_min', bodies).tolist() == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize('edge', [1e-6, 0.02, 1e4])
@pytest.mark.parametrize('size', [(3, 3, 3), (7, 7, 7)])
def test_extremes_are_one_layer_at_any_size(edge, size):
    scene = make_scene(
        size,
        {
            'shell.edge_length': edge,
            'shell.thickness': 0.1 * edge,
            'groups.a': 'x_min',
            'groups.b': 'z_max',
        },
    )
    assert np.array_equal(scene.groups['a'], np.flatnonzero(scene.weave.grid[:, 0] == 0))
    assert np.array_equal(scene.groups['b'], np.flatnonzero(scene.weave.grid[:, 2] == size[2] - 1))


def test_loose_bodies_have_no_place_on_the_grid():
    scene = make_scene(
        (2, 2, 2),
        {
            'bodies.a.position': [0.0, 0.0, 5.0],
            'groups.high': 'z_max',
            'groups.low': 'level 0',
            'groups.loose': 'ids 4',
            'groups.rest': 'not level 0',
        },
    )
    assert scene.groups['high'].tolist() == [4]
    assert 4 not in scene.groups['low']
    assert scene.groups['loose'].tolist() == [4]
    assert scene.groups['rest'].tolist() == [2, 3, 4]


def test_names_of_groups():
    with pytest.raises(
        ico.ParameterError, match="supports.s.group: there is no group 'top'; known: all, tip"
    ):
        make_scene((2, 2, 2), {'groups.tip': 'ids 0', 'supports.s.group': 'top'})
    for word in ('all', 'not', 'and', 'or'):
        with pytest.raises(ico.ParameterError, match='is a keyword of selectors'):
            make_scene((2, 2, 2), {f'groups.{word}': 'ids 0'})
