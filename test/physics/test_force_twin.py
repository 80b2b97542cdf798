# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The force kernel against its plain twin, against a loop in more digits, and at any scale."""

import os
from pathlib import Path
import subprocess
import sys

from analytical import quaternion_product, rotation_quaternion
from fabrics import FORMS, make_scene, wrenches
import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
CASES = (
    ((2, 2, 1), {}), ((3, 3, 3), {'weave.variant': 1}), ((5, 4, 6), {'weave.variant': 2}),
    ((4, 4, 4), {'weave.kind': 'bias', 'weave.azimuth': 0.7, 'connector.natural_length': 0.04}))


def configuration(size, changes, seed=4, amplitude=0.4):
    """Scene with a stretched, scattered, turned configuration."""
    generator = np.random.default_rng(seed)
    scene = make_scene(size, changes)
    shape = (scene.body_count, 3)
    position = scene.position * np.exp(amplitude * generator.uniform(-1, 1, 3))
    position = position + 0.3 * amplitude * scene.geometry.pitch * generator.standard_normal(shape)
    turn = rotation_quaternion(amplitude * generator.standard_normal(shape))
    return scene, position, quaternion_product(turn, scene.orientation)


def in_long_doubles(scene, position, orientation):
    """Forces and torques of eqs 1 and 49, connector by connector, with 64 bits of mantissa."""
    orientation = orientation.astype(np.longdouble)
    position = position.astype(np.longdouble)
    # The kernels take the midpoints to lie on the body axes, as far out as half the width.
    half = np.longdouble(0.5 * scene.geometry.cube_width)
    axis_of = {0: 2, 1: 2, 2: 0, 3: 0, 4: 1, 5: 1}
    force = np.zeros((scene.body_count, 3), np.longdouble)
    torque = np.zeros_like(force)
    stiffness = np.longdouble(scene.connectors.stiffness)
    natural = np.longdouble(scene.connectors.natural_length)
    for pair, codes in zip(scene.connectors.bodies, scene.connectors.edges):
        arms = []
        for body, code in zip(pair, codes):
            unit = np.zeros(3, np.longdouble)
            unit[axis_of[int(code)]] = 1.0 - 2.0 * (int(code) & 1)
            x, y, z, w = orientation[body]
            v = np.array([x, y, z])
            # q unit q* / |q|^2, whatever the length of q.
            turned = (
                2 * (v @ unit) * v + (w * w - v @ v) * unit + 2 * w * np.cross(v, unit)
            ) / (w * w + v @ v)
            arms.append(half * turned)
        span = (position[pair[1]] - position[pair[0]]) + (arms[1] - arms[0])
        length = np.sqrt(span @ span)
        pull = stiffness * (length - natural) / length * span
        force[pair[0]] += pull
        force[pair[1]] -= pull
        torque[pair[0]] += np.cross(arms[0], pull)
        torque[pair[1]] -= np.cross(arms[1], pull)
    return force, torque


def unit_of(scene):
    """The pull k L of a connector that is stretched to twice its length."""
    return scene.connectors.stiffness * scene.geometry.connector_length


@pytest.mark.parametrize('form', FORMS)
@pytest.mark.parametrize('size, changes', CASES)
def test_forces_are_those_of_a_loop_in_more_digits(size, changes, form):
    scene, position, orientation = configuration(size, changes)
    force, torque = in_long_doubles(scene, position, orientation)
    got = wrenches(scene, position, orientation, cosines=form == 'direction_cosines')
    scale = unit_of(scene)
    error = float(np.abs(got.force - force).max()) / scale
    moment_error = float(np.abs(got.torque - torque).max()) / (scale * scene.geometry.half_edge)
    print(f'{size} {form}: {error:.2e} of k L, {moment_error:.2e} of k L a')
    assert error < 1e-13 and moment_error < 1e-13
    assert float(np.abs(force).max()) > 0.1 * scale


EVALUATION = """
import sys
sys.path[:0] = ['test', 'test/physics']
import numba
import numpy as np
from fabrics import wrenches
from test_force_twin import CASES, configuration
results = [np.array([bool(numba.config.DISABLE_JIT)])]
for size, changes in CASES:
    for cosines in (False, True):
        results += wrenches(*configuration(size, changes), cosines=cosines)
np.savez(sys.argv[1], *results)
"""


def test_plain_forces_are_the_compiled_ones(tmp_path):
    path = tmp_path / 'plain.npz'
    environment = {**os.environ, 'NUMBA_DISABLE_JIT': '1'}
    environment['PYTHONPATH'] = os.pathsep.join([str(ROOT), environment.get('PYTHONPATH', '')])
    subprocess.run([sys.executable, '-c', EVALUATION, str(path)], env=environment, cwd=ROOT,
                   check=True)
    with np.load(path) as arrays:
        plain = [arrays[name] for name in arrays.files]
    assert plain[0][0] and len(plain) == 1 + 4 * len(CASES)
    place = 1
    for size, changes in CASES:
        scene, position, orientation = configuration(size, changes)
        for cosines in (False, True):
            got = wrenches(scene, position, orientation, cosines=cosines)
            scale = unit_of(scene)
            assert np.abs(got.force - plain[place]).max() < 1e-13 * scale
            assert (np.abs(got.torque - plain[place + 1]).max()
                    < 1e-13 * scale * scene.geometry.half_edge)
            place += 2


@pytest.mark.parametrize('form', FORMS)
@pytest.mark.parametrize('length, mass, time', [
    (4.0, 1.0, 1.0), (1.0, 16.0, 1.0), (1.0, 1.0, 64.0), (4.0**-8, 4.0**5, 4.0**-6),
    (4.0**20, 4.0**-30, 4.0**9)])
def test_forces_have_the_same_bits_in_units_of_powers_of_four(length, mass, time, form):
    # Nothing absolute hides in the kernel: all roundings, and the first guess of 1 / sqrt, scale.
    def evaluate(length, mass, time):
        scene, position, orientation = configuration((4, 3, 3), {
            'shell.edge_length': 0.02 * length, 'shell.thickness': 0.002 * length,
            'shell.mass': 0.0073 * mass, 'shell.inertia': 1.1e-6 * mass * length**2,
            'connector.stiffness': 500.0 * mass / time**2})
        return wrenches(scene, position, orientation, cosines=form == 'direction_cosines')

    one, other = evaluate(1.0, 1.0, 1.0), evaluate(length, mass, time)
    factor = mass * length / time**2
    assert np.array_equal(one.force * factor, other.force)
    assert np.array_equal(one.torque * (factor * length), other.torque)
    assert np.abs(one.force).max() > 1.0
