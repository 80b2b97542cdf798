# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A heap of shells at rest in a box: support forces carry the weight, and no shell creeps."""

from collections.abc import Iterator

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.contact.broad_phase import Touching
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.simulation import compile_scene, Simulation
from icofabric_validation.named.crowds import crowd
from icofabric_validation.named.loose_bodies import A, GRAVITY
from icofabric_validation.named.problem import Curve, Point, PremiseError, Problem
from icofabric_validation.named.restitution import TIP
import numpy as np
from scipy.spatial.transform import Rotation

_MAX_REST_ENERGY_RATIO = 1e-14  # kinetic energy of a body at rest, over its weight times a
_MAX_SETTLING_TIME_S = 20.0


def _scene(size: tuple[int, int, int]) -> Scene:
    return crowd(size, within='box', parameters={
        'initial_random.velocity_sigma': 0.02, 'initial_random.spin_sigma': 2.0,
        'contact.stiffness': 1e5, 'contact.damping': 20.0, 'contact.friction': 0.6,
        'solver.method': 'leapfrog', 'solver.tolerance': 0.1})


def _settle(simulation: Simulation) -> None:
    """Advance until the heap is at rest."""
    scene, calm = simulation.scene, 0
    while calm < 3:
        simulation.advance_to(simulation.time + 0.1)
        kinetic = simulation.snapshot().energy['kinetic'] / scene.body_count
        calm = calm + 1 if kinetic < _MAX_REST_ENERGY_RATIO * scene.shell.mass * GRAVITY * A else 0
        if simulation.time > _MAX_SETTLING_TIME_S:
            raise PremiseError(
                f'after {_MAX_SETTLING_TIME_S:g} s the heap still moves: {kinetic:.3g} J per body')


def upward_force(touching: Touching, body_count: int) -> float:
    """
    Return the upward force [N] of floor and walls, with friction.

    Raises PremiseError if all bodies lie on the floor.
    """
    planes = touching.bodies[:, 1] < 0
    floor = touching.bodies[:, 1] == -1 - touching.planes.index('floor')
    if not len(np.unique(touching.bodies[floor, 0])) < body_count:
        raise PremiseError(f'no heap: the floor touches all {body_count} shells')
    return float((touching.force + touching.spring)[planes, 2].sum())


def _largest_displacement(one: Snapshot, other: Snapshot) -> float:
    """Return the largest displacement [m] of a body, with rotations times the radius."""
    moved = np.linalg.norm(other.position - one.position, axis=1)
    turn = Rotation.from_quat(other.orientation) * Rotation.from_quat(one.orientation).inv()
    return float((moved + TIP * turn.magnitude()).max())


def _solve(long: bool) -> Iterator[Curve]:
    size, hold = ((2, 2, 10), 10.0) if long else ((2, 2, 6), 1.0)
    simulation = compile_scene(_scene(size))
    scene = simulation.scene
    _settle(simulation)
    began, before = simulation.time, simulation.snapshot()
    weight = scene.shell.mass * GRAVITY * scene.body_count
    error = moved = 0.0
    for time in began + hold * np.arange(1, 11) / 10.0:
        simulation.advance_to(float(time))
        up = upward_force(simulation.status.touching(), scene.body_count)
        error = max(error, abs(up / weight - 1.0))
        moved = max(moved, _largest_displacement(before, simulation.snapshot()) / A)
    steps, of = simulation.status.step_count, f'leapfrog, {scene.body_count} shells'
    yield Curve(f'{of}: upward force', 'rest from [s]', (Point(began, error, steps),), 1e-6,
                is_refined=False)
    yield Curve(f'{of}: displacement over a', 'held for [s]', (Point(hold, moved, steps),), 1e-5,
                is_refined=False)


PROBLEM = Problem(
    'heap', 'a heap of shells at rest in a box', 'statics: support forces equal the weight',
    'relative error of the force of floor and walls against the weight; largest displacement of a '
    'body over a, with rotations times the radius', _solve, has_long_form=True)
