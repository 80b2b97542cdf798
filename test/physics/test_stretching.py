# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Stress against strain of slabs between two held ends.
"""

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.statics.stretching import cross_section
import numpy as np
import pytest

STIFF = {'connector': {'bending_stiffness': 0.02}}


def slab(size, angle=0.3, **sections):
    return make_scene(
        size, weave={'size': list(size), 'connector_angle': angle}, **sections)


@pytest.mark.parametrize('kind', ['pull', 'push', 'shear'])
def test_work_of_the_moved_end_is_the_energy_stored(kind):
    """
    Castigliano: the force is the derivative of the energy by the displacement.
    """
    scene = slab((5, 3, 3), **STIFF)
    strains = np.array([0.02, 0.0599, 0.06, 0.0601])
    points = ico.measure_curve(scene, kind, strains)
    assert all(point.verdict == 'equilibrium, stable' for point in points)
    length = np.ptp(scene.position[:, 0])
    force = points[2].stress * cross_section(scene, 0)
    slope = (points[3].energy - points[1].energy) / ((strains[3] - strains[1]) * length)
    assert force == pytest.approx(slope, rel=1e-5)
    assert points[0].stress > 0.0 and points[2].energy > points[0].energy > 0.0


def test_larger_slabs_come_closer_to_the_endless_fabric():
    endless = ico.homogenise(slab((3, 3, 3), **STIFF)).young_modulus(np.array([1.0, 0.0, 0.0]))
    found = [
        ico.measure_curve(slab(size, **STIFF), 'pull', [1e-4])[0].stress / 1e-4
        for size in ((7, 3, 3), (9, 5, 5), (11, 9, 9))]
    assert found[0] < found[1] < found[2] < endless
    assert found[2] > 0.8 * endless


def test_point_springs_let_an_orthogonal_slab_be_pushed_for_nothing():
    scene = slab((7, 3, 3))
    for kind in ('push', 'shear'):
        [point] = ico.measure_curve(scene, kind, [0.02])
        assert point.verdict == 'equilibrium, with mechanisms'
        assert abs(point.stress) < 1e-6 * 0.02 * 500.0 / scene.geometry.pitch


def test_all_axes_are_alike_and_loads_of_the_scene_are_left_out():
    scene = slab((5, 5, 5), gravity=[0.0, 0.0, -9.81], groups={'g': 'ids 1'},
                 loads={'l': {'group': 'g', 'force': [1.0, 0.0, 0.0]}}, **STIFF)
    stress = [ico.measure_curve(scene, 'pull', [0.03], axis=axis)[0].stress for axis in range(3)]
    assert stress == pytest.approx([stress[0]] * 3, rel=1e-8) and stress[0] > 0.0


def test_a_curve_ends_where_connectors_would_break():
    scene = slab((5, 3, 3), connector={
        'bending_stiffness': 0.02, 'break_length_extension': 0.051})
    points = ico.measure_curve(scene, 'pull', [0.01, 0.1, 0.2, 0.3])
    assert points[0].beyond == 0 and points[-1].beyond > 0 and len(points) < 4


@pytest.mark.parametrize('arguments, word', [
    (('pull', []), 'strains'), (('pull', [0.2, 0.1]), 'strains'), (('twist', [0.1]), 'kind'),
    (('push', [0.5, 1.0]), 'push'), (('pull', [-0.1]), 'strains')])
def test_arguments_are_judged(arguments, word):
    with pytest.raises(ValueError, match=word):
        ico.measure_curve(slab((5, 3, 3)), *arguments)
    with pytest.raises(ValueError, match='no two ends'):
        ico.measure_curve(slab((2, 2, 1)), 'pull', [0.1], axis=2)
