# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Bodies without connectors whose positions solve x'' = f(t, x, x').

The forces are external (terms/body_force), so steps, their control and the error estimate are
those of every run with `dop8`. The half edge is 1 m, so errors over a are errors of positions.
"""

from collections.abc import Callable, Iterator

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.model.body_force import BodyForce
from icofabric_sim.simulation.simulation import compile_scene
from icofabric_validation.named.problem import Curve, Point
import numpy as np

# (time, positions (n, 3), velocities (n, 3)) to accelerations (n, 3), in SI units.
Acceleration = Callable[[float, np.ndarray, np.ndarray], np.ndarray]


def positions_after(
    acceleration: Acceleration, position: np.ndarray, velocity: np.ndarray, duration: float,
    *, tolerance: float = 1e-6, step: float = 0.0
) -> tuple[np.ndarray, int]:
    """Return positions (n, 3) after a `duration` [s], and the number of steps."""
    scene = Scene.from_parameters({
        # Every second position of two rows has a body.
        'weave.size': [len(position), 2, 1], 'weave.connected': False, 'contact.mode': 'never',
        'shell.edge_length': 2.0, 'shell.thickness': 0.5, 'solver.method': 'dop8',
        'solver.tolerance': tolerance, 'solver.step': step, 'solver.threads': 1,
        # All energy is external work, and long steps must not stop the run.
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


def yield_refined_curves(
    acceleration: Acceleration, position: np.ndarray, velocity: np.ndarray, duration: float,
    answer: np.ndarray, *, tolerances: tuple[float, ...], steps: tuple[float, ...],
    allowed: float, allowed_given: float, floor: float
) -> Iterator[Curve]:
    """Yield curves with adaptive steps for `tolerances`, and with given `steps`."""
    for of, values, limit in (('dop8, adaptive steps', tolerances, allowed),
                              ('dop8, given steps', steps, allowed_given)):
        points = []
        for value in values:
            given = {'tolerance': value} if values is tolerances else {'step': value}
            place, taken = positions_after(acceleration, position, velocity, duration, **given)
            error = float(np.abs(place - answer).max())
            points.append(Point(duration / taken, error, taken))
        yield Curve(
            of, 'mean step [s]' if values is tolerances else 'step [s]', tuple(points), limit,
            order=8.0, floor=floor)
