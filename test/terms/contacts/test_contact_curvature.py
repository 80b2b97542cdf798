# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Second derivatives of contact in closed form: symmetry, differences, planes, stiff contacts."""

import icofabric_sim as ico
from icofabric_sim.geometry.rotations import cosines_from_quaternions, rotate_axes
from icofabric_sim.simulation.contact.pair_forces import PairForces, PAIRS
from icofabric_sim.simulation.contact.setup import pack_contact
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

NORMAL = np.array([0.36, -0.48, 0.8])


def forces():
    scene = ico.Scene.from_parameters({
        'weave.size': [2, 2, 2], 'contact.mode': 'always', 'contact.stiffness': 2e4,
        'planes.wall.normal': NORMAL.tolist(), 'planes.wall.offset': -0.03})
    return PairForces(pack_contact(scene, np.zeros(3), moving=False)), scene.geometry.half_edge


def touching(overlap, which, count=200):
    """Pairs of shells, or a shell and the plane, that overlap by so much of a: places, axes."""
    found, a = forces()
    random = np.random.default_rng(3)
    places = np.zeros((count, 2, 3))
    axes = Rotation.random(2 * count, random_state=4).as_matrix().reshape(count, 2, 3, 3)
    way = random.standard_normal((count, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    low, high = np.full(count, 2.6 * a), np.full(count, 4.0 * a)
    if which != PAIRS:
        way = np.broadcast_to(NORMAL, way.shape)
        low, high = np.full(count, -0.03 + a), np.full(count, -0.03 + 3.0 * a)
    for _ in range(60):
        middle = 0.5 * (low + high)
        places[:, 0] = way * middle[:, None]
        met, _ = found.met(places, axes, which)
        low, high = np.where(met, middle, low), np.where(met, high, middle)
    places[:, 0] = way * (low - overlap * a)[:, None]
    return found, a, places, axes


def by_differences(found, a, places, axes, which, step):
    """Derivatives of minus the wrenches by the motions of the first body, (m, 12, 6)."""
    columns = []
    for k in range(6):
        ends = []
        for h in (step, -step):
            moved, turned = places.copy(), axes.copy()
            if k < 3:
                moved[:, 0, k] += h * a
            else:
                rotation = np.zeros((len(places), 3))
                rotation[:, k - 3] = h
                turned[:, 0] = rotate_axes(rotation, turned[:, 0])
            ends.append(found.wrenches(moved, turned, which)[0])
        columns.append((ends[1] - ends[0]) / (2.0 * step * (a if k < 3 else 1.0)))
    return np.stack(columns, axis=2)


@pytest.mark.parametrize('which', [PAIRS, 0])
@pytest.mark.parametrize('overlap', [1e-3, 1e-2, 0.1, 0.5])
def test_they_are_the_derivatives_of_the_forces(overlap, which):
    found, a, places, axes = touching(overlap, which)
    pairs = np.arange(2 * len(places)).reshape(-1, 2)
    if which == PAIRS:
        bodies, blocks = found.blocks(pairs, [], places.reshape(-1, 3), axes.reshape(-1, 3, 3))
    else:
        bodies, blocks = found.blocks(
            pairs[:0], [np.arange(len(places))], places[:, 0], axes[:, 0])
    assert len(bodies) == len(places)
    step = 1e-3 * overlap
    rows = 12 if which == PAIRS else 6
    # Of fourth order; half of the turn of a torque is seen from turned axes.
    whole, half = (
        by_differences(found, a, places, axes, which, h)[:, :rows] for h in (step, 0.5 * step))
    expected = (4.0 * half - whole) / 3.0
    wrench = found.wrenches(places, axes, which)[0]
    for k in range(3):
        expected[:, 3:6, 3 + k] += 0.5 * np.cross(np.eye(3)[k], wrench[:, 3:6])
    scales = np.tile(np.repeat([1.0, 1.0 / a], 3), 2)
    scale = scales[:rows, None] * scales[None, :6]
    size = np.abs(expected * scale).max(axis=(1, 2))
    error = np.abs((blocks[:, :rows, :6] - expected) * scale).max(axis=(1, 2)) / size
    # Where the overlap gains or loses a corner within a step, the differences have a kink.
    assert np.median(error) < 1e-8 and (error < 1e-6).mean() > 0.95 and error.max() < 1e-2
    assert not blocks[:, rows:].any()


@pytest.mark.parametrize('overlap, most', [(1e-6, 1e-7), (1e-3, 1e-9), (0.1, 1e-11)])
def test_they_are_symmetric_as_only_exact_ones_are(overlap, most):
    # Motions of one body twice follow from those of both and the forces: nothing makes them
    # symmetric but that they are right.
    for which in (PAIRS, 0):
        found, a, places, axes = touching(overlap, which)
        met, out = found.met(places, axes, which)
        assert met.all()
        part = found._curvatures(places, axes, which, np.full((len(places), 2), a), out)
        scales = np.tile(np.repeat([1.0, 1.0 / a], 3), 2)
        part *= scales[:, None] * scales
        size = np.abs(part).max(axis=(1, 2))
        assert (np.abs(part - np.swapaxes(part, 1, 2)).max(axis=(1, 2)) < most * size).all()
        assert np.abs(part).min(axis=(0, 1)).max() > 0.0


def test_stiff_contacts_have_them_to_rounding():
    # A dense slab whose faces overlap by 1e-5 to 1e-3 of a: differences were 1e-3 off there.
    scene = ico.Scene.from_parameters({
        'weave.size': [5, 3, 3], 'shell.edge_length': 0.02, 'connector.stiffness': 500.0,
        'weave.connector_angle': -0.3648, 'connector.natural_length': 0.0226,
        'contact.stiffness': 1e6})
    state = ico.measure_curve(scene, 'shear', [1e-4])[0].snapshot
    found = PairForces(pack_contact(scene, np.zeros(3), moving=False))
    axes = cosines_from_quaternions(state.orientation)
    pairs = found.near(state.position)
    met, out = found.met(state.position[pairs], axes[pairs], PAIRS)
    pairs, out = pairs[met], out[met]
    assert len(pairs) > 30 and out[:, 11].min() < 1e-4 * 0.01
    part = found._curvatures(
        state.position[pairs], axes[pairs], PAIRS, found.half_edges(pairs), out)
    scales = np.tile(np.repeat([1.0, 100.0], 3), 2)
    part *= scales[:, None] * scales
    unequal = np.abs(part - np.swapaxes(part, 1, 2)).max(axis=(1, 2))
    assert (unequal < 1e-9 * np.abs(part).max(axis=(1, 2))).all()
