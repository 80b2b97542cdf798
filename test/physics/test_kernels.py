# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels one by one: forces from energies, actions and reactions, compiled and plain."""

import os
from pathlib import Path
import subprocess
import sys

from analytical import quaternion_product, rotation_quaternion
from fabrics import FORMS, LOADED, make_scene, packed_state, RANDOM, wrenches
import icofabric_sim as ico
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.kernels.outlines import fill_lines
from icofabric_sim.kernels.rotations import half_angle_factors, orthonormalise, to_world
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import lane, LANES, splat
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.simulation.model.stability import hessian_product
import numpy as np
import pytest
from references import axes_of, resultants

ROOT = Path(__file__).resolve().parents[2]
# One law for all connectors, two stiffnesses, and groups of connectors with their own.
LAWS = {
    'one': {},
    'slack': {'connector.stiffness_compression': 0.0},
    'groups': {
        'connector.stiffness_compression': 80.0, 'groups.low': 'z_min', 'groups.high': 'z_max',
        'connector_groups.a.between': 'low high', 'connector_groups.a.stiffness_extension': 900.0,
        'connector_groups.b.between': 'low low', 'connector_groups.b.natural_length': 0.03,
        'connector_groups.b.stiffness': 40.0},
}


def configuration(seed, size=(2, 2, 2), amplitude=0.6, **changes):
    """Scene with a stretched, scattered, turned configuration far from equilibrium."""
    generator = np.random.default_rng(seed)
    scene = make_scene(size, {'weave.variant': seed % 4, **changes})
    shape = (scene.body_count, 3)
    position = scene.position * np.exp(amplitude * generator.uniform(-1, 1, 3))
    position += 0.3 * amplitude * scene.geometry.pitch * generator.standard_normal(shape)
    turn = rotation_quaternion(amplitude * generator.standard_normal(shape))
    return scene, position, quaternion_product(turn, scene.orientation)


def energy(scene, position, axes, turn):
    """
    Energy of all connectors with every body turned by its rotation vector (n, 3); real or complex.

    R v = v + sin(t)/t (turn x v) + (1 - cos(t))/t^2 turn x (turn x v), t = |turn|
    (Rodrigues): both factors are entire functions of t^2, so that complex steps go through.
    """
    square = (turn * turn).sum(axis=1, keepdims=True)[:, None, :]
    root = np.sqrt(square + 0j)
    safe = np.where(np.abs(root) < 1e-6, 1.0, root)
    first = np.where(np.abs(root) < 1e-6, 1.0 - square / 6.0, np.sin(safe) / safe)
    second = np.where(np.abs(root) < 1e-6, 0.5 - square / 24.0, (1.0 - np.cos(safe)) / safe**2)
    across = np.cross(turn[:, None, :], axes)
    turned = axes + first * across + second * np.cross(turn[:, None, :], across)
    connectors = scene.connectors
    ends = [
        position[connectors.bodies[:, end]]
        + np.einsum(
            'cj,cji->ci', connectors.points_body[:, end], turned[connectors.bodies[:, end]]
        )
        for end in range(2)
    ]
    span = ends[1] - ends[0]
    length = np.sqrt((span * span).sum(axis=1))
    extension, compression, natural = connectors.laws
    stretch = length - natural
    return 0.5 * (np.where(stretch.real > 0.0, extension, compression) * stretch**2).sum()


def slope(scene, position, axes, point, direction):
    """Derivative of the energy along `direction` (2, n, 3) at `point`, by a complex step."""
    step = 1e-30
    complex_point = point + 1j * step * direction
    return energy(scene, position + complex_point[0], axes, complex_point[1]).imag / step


@pytest.mark.parametrize('laws', LAWS)
@pytest.mark.parametrize('seed', range(4))
def test_wrench_is_minus_the_gradient_of_the_energy(seed, laws):
    scene, position, orientation = configuration(seed, **LAWS[laws])
    axes, rest = axes_of(orientation), np.zeros((2, scene.body_count, 3))
    units = np.eye(rest.size).reshape(rest.size, *rest.shape)
    gradient = np.array([slope(scene, position, axes, rest, unit) for unit in units])
    work = wrenches(scene, position, orientation)
    kernel = np.concatenate([work.force.ravel(), work.torque.ravel()])
    np.testing.assert_allclose(kernel, -gradient, rtol=0, atol=1e-12 * np.abs(gradient).max())
    # And it is the energy that a snapshot reports.
    simulation = ico.compile_scene(scene)
    simulation.set_state(position=position, orientation=orientation)
    reported = simulation.snapshot().energy['connectors']
    assert reported == pytest.approx(energy(scene, position, axes, rest[1]).real, rel=1e-13)
    assert reported > 1e-3


@pytest.mark.parametrize('seed', range(8))
def test_hessian_product_is_the_second_derivative_of_the_energy(seed):
    scene, position, orientation = configuration(
        seed, **{'connector.natural_length': [0.0, 0.03, 0.04][seed % 3]}
    )
    axes, packed = axes_of(orientation), pack_scene(scene)
    state = packed_state(packed, position, orientation)
    count = scene.body_count
    shape = (2, count, 3)
    units = np.eye(6 * count).reshape(6 * count, *shape)
    matrix, differences = [], []
    for unit in units:
        # Turning by exp(vector): both sides expand about the same configuration. Positions in
        # units of the pitch, so that one step suits both parts.
        step = 1e-5 * np.array([scene.geometry.pitch, 1.0])[:, None, None]
        width = (step * unit).sum()
        force, torque = hessian_product(packed, state, *unit)
        matrix.append(np.concatenate([force.ravel(), torque.ravel()]))
        differences.append(
            [
                (
                    slope(scene, position, axes, step * unit, other)
                    - slope(scene, position, axes, -step * unit, other)
                )
                / (2.0 * width)
                for other in units
            ]
        )
    matrix, differences = np.array(matrix), np.array(differences)
    scale = np.repeat([1.0, scene.geometry.pitch], 3 * count)
    matrix, differences = [scale[:, None] * m * scale for m in (matrix, differences)]
    largest = np.abs(matrix).max()
    np.testing.assert_allclose(matrix, matrix.T, rtol=0, atol=1e-13 * largest)
    np.testing.assert_allclose(matrix, differences, rtol=0, atol=1e-8 * largest)
    # Out of equilibrium the forces themselves take part.
    values = np.linalg.eigvalsh(matrix)
    assert values[-1] > 0.1 * largest
    stretch = np.abs(wrenches(scene, position, orientation).force).max()
    assert stretch > 1e-3 * largest * scene.geometry.pitch


@pytest.mark.parametrize('form', FORMS)
@pytest.mark.parametrize('loaded', [False, True])
def test_wrenches_agree_with_the_reference(form, loaded):
    sections = LOADED if loaded else {}
    scene, position, orientation = configuration(5)
    scene = make_scene((2, 2, 2), {'weave.variant': 1}, **sections)
    axes = axes_of(orientation)
    force, moment = resultants(scene, position, axes)
    work = wrenches(
        scene, position, orientation, cosines=form == 'direction_cosines', loaded=loaded)
    np.testing.assert_allclose(work.force, force, rtol=0, atol=1e-13 * np.abs(force).max())
    np.testing.assert_allclose(work.torque, moment, rtol=0, atol=1e-13 * np.abs(moment).max())


@pytest.mark.parametrize('laws', LAWS)
@pytest.mark.parametrize('seed', range(4))
def test_action_equals_reaction(seed, laws):
    scene, position, orientation = configuration(seed, (3, 3, 2), 1.0, **LAWS[laws])
    work = wrenches(scene, position, orientation)
    total = work.force.sum(axis=0)
    about_origin = (work.torque + np.cross(position, work.force)).sum(axis=0)
    assert np.abs(total).max() < 1e-13 * np.abs(work.force).sum()
    assert np.abs(about_origin).max() < 1e-13 * np.abs(np.cross(position, work.force)).sum()
    assert np.abs(work.force).max() > 1.0


def test_woven_rest_state_is_free_of_wrenches():
    for variant in range(4):
        scene = make_scene((4, 4, 4), {'weave.variant': variant, 'weave.connector_angle': 0.3})
        work = wrenches(scene, scene.position, scene.orientation)
        natural = scene.connectors.stiffness * scene.connectors.natural_length
        assert np.abs(work.force).max() < 1e-13 * natural
        # A natural length off by a hundredth shows in the bodies at the border.
        off = make_scene(
            (4, 4, 4),
            {
                'weave.variant': variant,
                'weave.connector_angle': 0.3,
                'connector.natural_length': 0.99 * scene.connectors.natural_length,
            },
        )
        assert np.abs(wrenches(off, off.position, off.orientation).force).max() > 5e-3 * natural


def test_connector_of_no_length_pulls_in_no_direction():
    # Ends in one point: eq 49 has no direction there, and nothing may become NaN.
    scene = make_scene((2, 2, 1))
    arms = scene.connectors.points_body[0]
    position = np.array([[0.1, 0.2, 0.3], [0.1, 0.2, 0.3] + arms[0] - arms[1]])
    # The difference is exactly zero, not just small.
    ends = position + arms
    position[1] += ends[0] - ends[1]
    work = wrenches(scene, position, scene.orientation)
    assert np.isfinite(work.force).all() and np.isfinite(work.torque).all()
    simulation = ico.compile_scene(scene)
    simulation.set_state(position=position)
    simulation.advance_to(0.01)
    assert np.isfinite(simulation.snapshot().position).all()


def test_connector_ends_are_where_the_reference_puts_them():
    scene, position, orientation = configuration(2)
    ends = np.empty((scene.connector_count, 2, 3))
    every = np.zeros(scene.connector_count, np.uint8)
    fill_lines(
        pack_scene(scene).connectors, position, orientation, every, 0, ends.reshape(-1, 3))
    bodies, axes = scene.connectors.bodies, axes_of(orientation)
    expected = position[bodies] + np.einsum(
        'cej,ceji->cei', scene.connectors.points_body, axes[bodies]
    )
    np.testing.assert_allclose(ends, expected, rtol=0, atol=1e-16)


@compiled
def factors_of(h, spins, cosines, sines):
    """`half_angle_factors` for vectors of equal lanes."""
    for i in range(spins.shape[0]):
        cosine, sine = half_angle_factors(h, splat(0.0), splat(spins[i]), splat(0.0))
        cosines[i], sines[i] = lane(cosine, 0), lane(sine, LANES - 1)


def test_half_angle_factors_are_smooth():
    # The series meets the functions at a half angle of 1/8; both agree with 40 digits there.
    rates = np.concatenate(
        [np.geomspace(1e-12, 10.0, 400), 0.25 * (1.0 + np.linspace(-1e-6, 1e-6, 21))]
    )
    cosine, sine = np.empty_like(rates), np.empty_like(rates)
    factors_of(1.0, rates, cosine, sine)
    np.testing.assert_allclose(cosine, np.cos(0.5 * rates), rtol=3e-16, atol=3e-16)
    np.testing.assert_allclose(sine, np.sin(0.5 * rates) / rates, rtol=7e-16)
    factors_of(2.0, np.zeros(1), cosine, sine)
    assert (cosine[0], sine[0]) == (1.0, 1.0)


def test_orthonormalise_repairs_what_rounding_does():
    generator = np.random.default_rng(7)
    exact = axes_of(rotation_quaternion(generator.standard_normal((24, 3))))
    spoiled = exact + 1e-8 * generator.standard_normal(exact.shape)
    slots = np.ascontiguousarray(np.moveaxis(spoiled, 0, -1))
    for first in range(0, 24, LANES):
        orthonormalise(slots, first)
    spoiled = np.moveaxis(slots, -1, 0)
    gram = spoiled @ np.swapaxes(spoiled, 1, 2)
    # Quadratic: what is left is the square of the error.
    np.testing.assert_allclose(gram, np.broadcast_to(np.eye(3), gram.shape), rtol=0, atol=1e-14)
    np.testing.assert_allclose(spoiled, exact, rtol=0, atol=1e-7)


def test_to_world_turns_vectors_both_ways_of_writing():
    generator = np.random.default_rng(8)
    quaternion = rotation_quaternion(generator.standard_normal((10, 3)))
    cosines = cosines_from_quaternions(quaternion)
    for body in range(10):
        x, y, z = generator.standard_normal(3)
        expected = np.array([x, y, z]) @ axes_of(quaternion)[body]
        for form in (quaternion.T.copy(), np.moveaxis(cosines, 0, -1).copy()):
            np.testing.assert_allclose(to_world(form, body, x, y, z), expected, atol=1e-15)


SHORT_RUN = """
import sys
sys.path.insert(0, 'test')
import numba
from icofabric_sim.simulation.model.stability import hessian_product
import numpy as np
import icofabric_sim as ico
from fabrics import FORMS, LOADED, make_scene, RANDOM, SUPPORTED
from icofabric_sim.simulation.model.stability import largest_frequency
results = [np.array([bool(numba.config.DISABLE_JIT)])]
for sections, form in zip((LOADED, SUPPORTED), FORMS):
    scene = make_scene((2, 2, 2), {'solver.step': 2e-4}, **RANDOM, **sections)
    simulation = ico.compile_scene(scene, rotation=form)
    simulation.advance_to(0.0017)
    s = simulation.snapshot()
    results += [s.position, s.orientation, s.linear_velocity, s.angular_velocity,
                s.connector_ends, np.array(list(s.energy.values()))]
    simulation.set_state(position=s.position)
    results.append(np.array([simulation.status.largest_frequency]))
np.savez(sys.argv[1], *results)
"""


def test_plain_python_gives_what_compiled_code_gives(tmp_path):
    results = []
    for value in ('0', '1'):
        path = tmp_path / f'{value}.npz'
        environment = {**os.environ, 'NUMBA_DISABLE_JIT': value}
        environment['PYTHONPATH'] = os.pathsep.join([str(ROOT), environment.get('PYTHONPATH', '')])
        subprocess.run(
            [sys.executable, '-c', SHORT_RUN, str(path)], env=environment, cwd=ROOT, check=True
        )
        with np.load(path) as arrays:
            results.append([arrays[name] for name in arrays.files])
    compiled, plain = results
    assert not compiled[0][0] and plain[0][0]
    assert len(compiled) == len(plain) == 15
    for one, other in zip(compiled[1:], plain[1:]):
        # Frequencies, single numbers, end an iteration.
        close = 1e-12 if one.size == 1 else 1e-13
        np.testing.assert_allclose(one, other, rtol=0, atol=close * np.abs(one).max())
    start = make_scene((2, 2, 2), **RANDOM, **LOADED).initial.position
    assert np.abs(compiled[1] - start).max() > 0.0005
