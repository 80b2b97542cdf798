# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Bodies without connectors whose places are the solution of x'' = f(t, x, x').

The forces come from outside (kernels/external.py), so that steps, error estimate and their choice
are those of every run with `dop8`. The half edge is 1 m: errors over a are those of the places.
"""

from collections.abc import Callable, Iterator

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.model.body_force import BodyForce
from icofabric_sim.simulation.simulation import compile_scene
from icofabric_validation.named.problem import Curve, Point
import numpy as np

# (time, places (n, 3), velocities (n, 3)) to accelerations (n, 3), in SI units.
Acceleration = Callable[[float, np.ndarray, np.ndarray], np.ndarray]


def places_after(
    acceleration: Acceleration, position: np.ndarray, velocity: np.ndarray, duration: float,
    *, tolerance: float = 1e-6, step: float = 0.0
) -> tuple[np.ndarray, int]:
    """Places (n, 3) after a `duration` [s], and the steps that were taken."""
    scene = Scene.from_parameters({
        # Every second place of two rows holds a body.
        'weave.size': [len(position), 2, 1], 'weave.connected': False, 'contact.mode': 'never',
        'shell.edge_length': 2.0, 'shell.thickness': 0.5, 'solver.method': 'dop8',
        'solver.tolerance': tolerance, 'solver.step': step, 'solver.threads': 1,
        # Without a potential all energy is work; coarse steps must not end the run.
        'solver.energy_limit': 1e9})
    mass = scene.shell.mass

    def force(
        time: float, x: np.ndarray, orientation: np.ndarray, v: np.ndarray, spin: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        return mass * acceleration(time, x, v), np.zeros_like(spin)

    simulation = compile_scene(scene, body_force=BodyForce(force, compiled=False))
    simulation.set_state(
        position=position, linear_velocity=velocity, angular_velocity=np.zeros_like(position),
        orientation=np.tile([0.0, 0.0, 0.0, 1.0], (len(position), 1)))
    simulation.advance_to(duration)
    return simulation.snapshot().position, simulation.status.step_count


def refine(
    acceleration: Acceleration, position: np.ndarray, velocity: np.ndarray, duration: float,
    answer: np.ndarray, *, tolerances: tuple[float, ...], steps: tuple[float, ...],
    allowed: float, allowed_given: float, floor: float
) -> Iterator[Curve]:
    """Curves with steps that are chosen by tolerances, and with given steps."""
    for of, values, limit in (('dop8, its own steps', tolerances, allowed),
                              ('dop8, given steps', steps, allowed_given)):
        points = []
        for value in values:
            given = {'tolerance': value} if values is tolerances else {'step': value}
            place, taken = places_after(acceleration, position, velocity, duration, **given)
            error = float(np.abs(place - answer).max())
            points.append(Point(duration / taken, error, taken))
        yield Curve(
            of, 'mean step [s]' if values is tolerances else 'step [s]', tuple(points), limit,
            order=8.0, floor=floor)
