# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Steps in which nothing can touch are as long as without contact; others see what touches."""

from fabrics import changed, make_scene, same_state
import icofabric_sim as ico
from icofabric_sim.geometry.icosahedron import vertices
from icofabric_sim.parameters.example_scenes import example_scenes
import numpy as np
from scipy.spatial.transform import Rotation

# A free block that expands and shrinks, by steps as long as a loose tolerance allows.
BREATHING = {
    'weave.connector_angle': 0.3, 'connector.stiffness': 500.0,
    'solver.method': 'dop8', 'solver.tolerance': 0.1, 'gravity': [0.0, 0.0, 0.0]}


def lowest(scene, snapshot):
    """Height [m] of the lowest vertex of all shells."""
    corners = vertices(scene.geometry.half_edge)
    return min(
        (place + Rotation.from_quat(turned).apply(corners))[:, 2].min()
        for place, turned in zip(snapshot.position, snapshot.orientation))


def test_steps_in_which_nothing_can_touch_are_those_without_contact():
    scene = ico.load_scene(example_scenes()['woven_ball'])
    end, steps = [], []
    for mode in ('auto', 'never'):
        run = ico.compile_scene(changed(scene, {'contact.mode': mode}))
        longest = 0.0
        for time in np.linspace(0.0, 0.05, 26)[1:]:
            run.advance_to(time)
            longest = max(longest, run.status.step * run.status.largest_frequency)
        end.append(run.snapshot())
        steps.append(run.status.step_count)
        # Longer than any in which something may touch.
        assert longest > 1.5
    assert same_state(*end) and steps[0] == steps[1] > 20


def test_long_steps_do_not_lead_through_a_contact():
    scene = make_scene([3, 3, 3], BREATHING)
    scene = changed(
        scene, {'connector.natural_length': 1.04 * scene.geometry.connector_length})
    free = ico.compile_scene(changed(scene, {'contact.mode': 'never'}))
    heights, moved = [], []
    for time in np.linspace(0.0, 0.2, 400):
        free.advance_to(time)
        heights.append(lowest(scene, free.snapshot()))
        moved.append(free.status.step * free.status.largest_frequency)
    first, depth = heights[0], heights[0] - min(heights)
    assert depth > 0.5 * scene.geometry.half_edge and max(moved) > 4.0
    # A floor that the lowest vertices only just reach.
    floor = changed(scene, {
        'contact.mode': 'auto', 'planes.floor.normal': [0.0, 0.0, 1.0],
        'planes.floor.offset': float(first - 0.98 * depth), 'contact.stiffness': 2e5})
    one, other = (
        ico.compile_scene(changed(floor, {'solver.tolerance': tolerance}))
        for tolerance in (BREATHING['solver.tolerance'], 1e-9))
    for run in (one, other):
        run.advance_to(0.2)
        assert run.status.contact_tests > 1000

    def apart(run):
        ways = run.snapshot().position - other.snapshot().position
        return np.abs(ways).max() / scene.geometry.half_edge

    assert apart(one) < 0.2 * BREATHING['solver.tolerance']
    # A floor that was not felt would change all.
    assert apart(free) > 1.0
