# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Rest and vibrations of shells whose charges act on each other (charge.mutual)."""

import math

from fabrics import make_scene
import icofabric_sim as ico
from icofabric_sim.parameters.validation import ParameterError
from icofabric_sim.simulation.model.electric import COULOMB_CONSTANT
from icofabric_sim.statics import modes, spectrum
from icofabric_sim.statics.charges import coulomb_matrix
from icofabric_sim.statics.equilibrium import NOT_COUNTED, STABLE
from icofabric_sim.statics.fabric import StaticFabric
from icofabric_sim.statics.held_motion import held_motion
from icofabric_sim.statics.spectrum import scaled_hessian
from icofabric_sim.statics.stress_strain import strained_volume
import numpy as np
import pytest

CHARGED = {
    'charge': {'per_body': 3e-7, 'dipole': [0.0, 1e-9, 2e-9], 'mutual': True},
    'field': {'electric': [1e5, 0.0, 3e5]},
    'connector': {'stiffness': 500.0, 'bending_stiffness': 0.01}, 'gravity': [0.0, 0.0, -9.81],
    'contact': {'mode': 'never'}}
HELD = {'groups': {'wall': 'x_min'}, 'supports': {'wall': {'group': 'wall'}}}


def test_second_derivatives_of_charges_by_the_complex_step():
    random = np.random.default_rng(1)
    place, strength, h = 0.1 * random.standard_normal((7, 3)), 2e-4, 1e-30
    columns = np.zeros((21, 21))
    for freedom in range(21):
        moved = place.astype(complex)
        moved[divmod(freedom, 3)] += 1j * h
        apart = moved[:, None] - moved[None]
        cube = (apart * apart).sum(axis=2) + np.eye(7)
        columns[:, freedom] = (-strength * (
            apart * cube[..., None]**-1.5).sum(axis=1)).ravel().imag / h
    assert np.abs(columns - coulomb_matrix(strength, place)).max() < 1e-12 * np.abs(columns).max()


def test_hessian_is_the_derivative_of_the_force():
    fabric = StaticFabric(make_scene((3, 3, 2), **CHARGED, **HELD))
    random = np.random.default_rng(1)
    shape = len(fabric.free), 3
    here = fabric.start.moved(np.hstack([
        2e-3 * random.standard_normal(shape), 0.2 * random.standard_normal(shape)]))
    first, second = (np.hstack([
        1e-2 * random.standard_normal(shape), random.standard_normal(shape)]) for _ in range(2))
    product, h = here.times(first), 1e-5
    charges = product - here.times(first, pairs=False)
    # Of all that there is a good part.
    assert np.abs(charges[:, :3]).max() > 0.01 * np.abs(product[:, :3]).max()
    ahead, behind = here.moved(h * first), here.moved(-h * first)
    change = (behind.force - ahead.force) / (2.0 * h)
    assert np.allclose(product[:, :3], change[:, :3], atol=1e-6 * np.abs(change[:, :3]).max())
    assert (ahead.energy - behind.energy) / (2.0 * h) == pytest.approx(
        -float((here.force * first).sum()), rel=1e-7)
    assert (second * product).sum() == pytest.approx((first * here.times(second)).sum(), rel=1e-10)
    free, root = fabric.free, fabric.root
    held = np.where(free, first, 0.0)
    assert np.allclose(
        scaled_hessian(here) @ (root * held)[free], (here.times(held) / root)[free],
        rtol=0, atol=1e-9 * np.abs(product / root).max())


def test_two_charges_on_one_connector():
    """
    Rest where the spring holds the repulsion, and swing with k + 2 kappa / r^3 along it.

    Across it the two turn freely; the reduced mass is M / 2.
    """
    scene = make_scene((2, 2, 1), connector={'stiffness': 200.0}, contact={'mode': 'never'},
                       charge={'per_body': 2e-7, 'mutual': True})
    found = ico.solve_equilibrium(scene)
    assert found.converged and scene.body_count == 2
    strength = COULOMB_CONSTANT * 4e-14
    [length] = found.snapshot.connector_length
    r = float(np.linalg.norm(np.diff(found.snapshot.position, axis=0)))
    tension = 200.0 * (length - float(scene.connectors.natural_length))
    assert tension == pytest.approx(strength / r**2, rel=1e-10) and tension > 1e-2
    # Stretched out straight: the attachment points lie on the line of centres.
    assert r == pytest.approx(length + scene.geometry.cube_width, rel=1e-12)
    shapes = ico.solve_modes(scene, at=found.snapshot)
    assert shapes.unstable_count == 0
    wanted = math.sqrt((200.0 + 2.0 * strength / r**3) / (0.5 * scene.shell.mass))
    assert np.abs(shapes.frequencies / wanted - 1.0).min() < 1e-9
    assert shapes.largest_frequency == pytest.approx(shapes.frequencies[-1], rel=1e-8)


@pytest.mark.long
def test_a_slab_rests_where_a_run_with_drag_ends():
    sections = {**CHARGED, **HELD, 'drag': {'linear': 0.5, 'angular': 2e-5}}
    scene = make_scene((3, 3, 2), **sections, solver={'tolerance': 1e-9})
    found = ico.solve_equilibrium(scene)
    assert found.verdict == STABLE
    simulation = ico.compile_scene(scene)
    simulation.advance_to(1.5)
    assert np.abs(simulation.snapshot().position - found.snapshot.position).max() < 1e-7
    away = np.abs(ico.solve_equilibrium(make_scene((3, 3, 2), **{
        **sections, 'charge': {'per_body': 3e-7, 'dipole': [0.0, 1e-8, 2e-8]}
    })).snapshot.position - found.snapshot.position).max()
    assert away > 1e-4


def test_large_fabrics_go_without_the_matrix(monkeypatch):
    scene = make_scene((3, 3, 2), **CHARGED, **HELD)
    found = ico.solve_equilibrium(scene)
    whole = ico.solve_modes(scene, at=found.snapshot)
    for module in (spectrum, modes):
        monkeypatch.setattr(module, 'DENSE', 10)
    assert ico.solve_equilibrium(scene).verdict == NOT_COUNTED
    for which, part in (('lowest', slice(0, 4)), ('highest', slice(-4, None))):
        some = ico.solve_modes(scene, at=found.snapshot, count=4, which=which)
        assert some.mechanism_count == -1 and some.unstable_count == -1
        assert np.sort(some.frequencies) == pytest.approx(whole.frequencies[part], rel=1e-7)


def test_a_curve_has_the_charges_and_the_periodic_fabric_has_none():
    """A pull does less work where charges push the ends apart, by their force there."""
    stresses = []
    for mutual in (False, True):
        scene = make_scene((3, 3, 3), connector={'stiffness': 500.0, 'bending_stiffness': 0.01},
                           charge={'per_body': 2e-7, 'mutual': mutual}, contact={'mode': 'never'})
        [point] = ico.measure_curve(scene, 'pull', [0.02])
        assert point.verdict == STABLE
        stresses.append(point)
    bare, charged = stresses
    assert charged.rest_stress < -1e-3 * abs(bare.stress)
    assert abs(bare.rest_stress) < 1e-9
    assert charged.stress < bare.stress
    # The energy, charges and all, differentiated.
    low, point, high = ico.measure_curve(scene, 'pull', [0.0199, 0.02, 0.0201])
    motion = held_motion(scene, 'pull', 0)
    assert (high.energy - low.energy) / 2e-4 == pytest.approx(
        point.stress * strained_volume(motion, 'pull', 0.02), rel=1e-5)
    with pytest.raises(ParameterError, match=r'charge\.mutual'):
        ico.homogenise(scene)
