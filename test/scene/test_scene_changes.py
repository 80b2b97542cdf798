# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A changed scene from one that is there."""

import icofabric_sim as ico
from icofabric_sim.checks import counted
from icofabric_sim.scene.summary import size_text
import numpy as np
import pytest


def test_what_is_changed_is_changed_and_the_rest_stays():
    scene = ico.load_scene('hanging_slab')
    before = dict(scene.parameters)
    nested = scene.with_changes({'weave': {'size': [3, 3, 3]}, 'connector.stiffness': 123.0})
    dotted = scene.with_changes({'weave.size': [3, 3, 3], 'connector.stiffness': 123.0})
    assert nested.parameters == dotted.parameters
    assert nested.body_count < scene.body_count
    assert set(nested.parameters['weave.size']) == {3}
    assert nested.parameters['gravity'] == scene.parameters['gravity']
    assert np.array_equal(nested.position, dotted.position)
    assert dict(scene.parameters) == before
    assert scene.with_changes({}).parameters == scene.parameters


def test_a_shell_that_was_given_is_kept():
    plain = ico.Scene.from_parameters({'weave.size': [2, 2, 2]})
    heavy = ico.Shell.from_thickness(0.02, 0.002, 7800.0)
    scene = ico.Scene.from_parameters({'weave.size': [2, 2, 2]}, shell=heavy)
    assert scene.with_changes({'weave.size': [2, 2, 3]}).shell == heavy != plain.shell
    assert plain.with_changes({'shell.density': 2400.0}).shell.mass == pytest.approx(
        2.0 * plain.shell.mass, rel=1e-12)


@pytest.mark.parametrize('changes, error, said', [
    ({'weave.sise': [2, 2, 2]}, ValueError, 'weave.sise'),
    ({'weave.size': [0, 2, 2]}, ValueError, 'weave.size'),
    ('weave.size', TypeError, 'changes'),
    (None, TypeError, 'changes'),
])
def test_bad_changes(changes, error, said):
    with pytest.raises(error, match=said):
        ico.load_scene('hanging_slab').with_changes(changes)


@pytest.mark.parametrize(('size', 'expected'), [
    ([1, 1, 1], '1 body, 0 connectors'), ([2, 2, 1], '2 bodies, 1 connector')])
def test_one_body_is_singular(size, expected):
    scene = ico.Scene.from_parameters({'weave': {'size': size}})
    assert size_text(scene) == expected and f' {expected}>' in repr(scene)
    assert counted(1, 'solver step') == '1 solver step'
    assert counted(1000, 'message') == '1,000 messages'
