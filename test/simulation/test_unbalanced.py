# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Connectors and anchors that do not balance as woven, and the method that `auto` takes then."""

from fabrics import changed, make_scene
import icofabric_sim as ico
from icofabric_sim.simulation.model.unbalanced import unbalanced_rate
import numpy as np
import pytest


@pytest.mark.parametrize('kind, held', [('orthogonal', False), ('radial', True)])
def test_it_is_the_acceleration_at_the_start(kind, held):
    changes = {'weave.kind': kind, 'connector.natural_length': 0.03, 'solver.method': 'dop8'}
    if held:
        changes |= {'groups.held': 'ids 0', 'supports.hold.group': 'held'}
    scene = make_scene((3, 3, 3), changes)
    simulation = ico.compile_scene(scene)
    time = 1e-4 / simulation.status.largest_frequency
    simulation.advance_to(time)
    state = simulation.snapshot()
    fastest = max(
        np.linalg.norm(state.linear_velocity, axis=1).max() / scene.geometry.half_edge,
        np.linalg.norm(state.angular_velocity, axis=1).max())
    assert unbalanced_rate(scene) == pytest.approx(fastest / time, rel=1e-5)


def test_a_fabric_at_rest_is_balanced():
    assert unbalanced_rate(make_scene((3, 3, 3))) == 0.0
    assert unbalanced_rate(make_scene((1, 1, 1), {'weave.connected': False})) == 0.0


def test_pre_stress_that_moves_a_fabric_decides_about_the_method():
    # By 20 % of their length at once: within a few periods some all but collapse. Steps of one
    # length then added up to 1000 times what the tolerance allows.
    length = make_scene((3, 3, 3)).geometry.connector_length
    methods = [
        ico.compile_scene(make_scene((3, 3, 3), {
            'connector.natural_length': part * length})).status.method_name
        for part in (1.0, 0.8)]
    assert ico.METHODS[methods[0]].symplectic and methods[1] == 'dop8'


TIED = {'anchors.tie.body': 0, 'anchors.tie.edge': 'up', 'anchors.tie.position': [0.0, 0.0, 0.5]}


def where_slack():
    """The place of the anchor's point where it has its natural length."""
    scene = make_scene((3, 3, 3), TIED)
    edge = scene.position[0] + scene.anchors['tie'].arm
    return [*edge[:2].tolist(), float(edge[2] + scene.connectors.natural_length)]


@pytest.mark.parametrize('place', [[0.0, 0.0, 0.5], [0.3, -0.2, 0.1]])
def test_anchors_count(place):
    held = {'groups.held': 'ids 13', 'supports.hold.group': 'held', 'solver.method': 'dop8'}
    scene = make_scene((3, 3, 3), {
        **TIED, **held, 'anchors.tie.position': place, 'anchors.tie.edge': 'north'})
    simulation = ico.compile_scene(scene)
    time = 1e-4 / simulation.status.largest_frequency
    simulation.advance_to(time)
    state = simulation.snapshot()
    fastest = max(
        np.linalg.norm(state.linear_velocity, axis=1).max() / scene.geometry.half_edge,
        np.linalg.norm(state.angular_velocity, axis=1).max())
    assert unbalanced_rate(scene) == pytest.approx(fastest / time, rel=1e-5) and fastest > 0.0
    # Of a body that is held they move nothing.
    assert unbalanced_rate(changed(scene, {'anchors.tie.body': 13})) == 0.0


@pytest.mark.parametrize('place, velocity, wild', [
    ([0.0, 0.0, 0.5], 0.0, True), (None, 0.0, False), (None, 5.0, True)])
def test_an_anchor_that_pulls_or_moves_decides_about_the_method(place, velocity, wild):
    method = ico.compile_scene(make_scene((3, 3, 3), {
        **TIED, 'anchors.tie.position': place or where_slack(),
        'anchors.tie.velocity': [0.0, 0.0, velocity]})).status.method_name
    assert (method == 'dop8') == wild and ico.METHODS[method].symplectic != wild


@pytest.mark.parametrize('changes, says', [
    ({'solver.method': 'srkn6'}, True), ({'solver.method': 'dop8', 'solver.step': 2e-4}, True),
    ({'solver.method': 'dop8'}, False),
    ({'solver.method': 'srkn6', 'connector.natural_length': 0.0}, False)])
def test_steps_that_do_not_follow_a_collapse_say_so(changes, says):
    length = make_scene((3, 3, 3)).geometry.connector_length
    simulation = ico.compile_scene(make_scene(
        (3, 3, 3), {'connector.natural_length': 0.8 * length, **changes}))
    assert ('collapses within a step' in simulation.status.error_estimate_lacks) == says
