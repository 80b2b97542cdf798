# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Simulations of shells without connectors, with contacts and an optional floor."""

from collections.abc import Sequence
import math
from typing import Any, Final, NamedTuple

from icofabric_sim.geometry.icosahedron import face_geometry, vertices
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.simulation import compile_scene, Simulation
import numpy as np
from scipy.spatial.transform import Rotation

# Half edge [m] and acceleration of gravity [m/s^2].
A: Final = 0.01
GRAVITY: Final = 9.81
UP: Final = np.array([0.0, 0.0, 1.0])
VERTICES: Final = vertices(A)
NORMALS: Final = face_geometry(A).normals
# Height of the floor [m], below the woven positions, where shells must not overlap it.
FLOOR_HEIGHT: Final = -0.05
FLOOR: Final[dict[str, Any]] = {
    'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': FLOOR_HEIGHT}
_AT_REST = (0.0, 0.0, 0.0)


class Body(NamedTuple):
    """The initial state of one shell."""

    position: Sequence[float] | np.ndarray  # [m], above the height of the floor
    velocity: Sequence[float] | np.ndarray = _AT_REST  # [m/s]
    rotation: Rotation = Rotation.identity()
    spin: Sequence[float] | np.ndarray = _AT_REST  # [rad/s]


def rotate_down(direction: np.ndarray, azimuth: float = 0.0) -> Rotation:
    """Return the rotation that turns a body direction down, and then about the vertical."""
    down = Rotation.align_vectors([-UP], [direction])[0]
    return Rotation.from_rotvec(azimuth * UP) * down


def simulate(bodies: Sequence[Body], parameters: dict[str, Any]) -> Simulation:
    """Compile a simulation of `bodies`; add the values of FLOOR to the parameters for a floor."""
    scene = Scene.from_parameters({
        # Every second position of two rows has a body.
        'weave.size': [len(bodies), 2, 1], 'weave.connected': False, 'shell.edge_length': 2.0 * A,
        'weave.connector_length': 0.03, 'contact.mode': 'auto', 'solver.method': 'dop8',
        'solver.threads': 1, **parameters})
    simulation = compile_scene(scene)
    simulation.set_state(
        position=np.array([body.position for body in bodies], float) + FLOOR_HEIGHT * UP,
        linear_velocity=np.array([body.velocity for body in bodies], float),
        orientation=np.array([body.rotation.as_quat() for body in bodies]),
        angular_velocity=np.array([body.spin for body in bodies], float))
    return simulation


def heights(simulation: Simulation) -> np.ndarray:
    """Return heights (n,) of the centres above the floor [m]."""
    above: np.ndarray = simulation.snapshot().position[:, 2] - FLOOR_HEIGHT
    return above


def contact_time(mass: float, stiffness: float) -> float:
    """Return the time [s] of one contact: half a period of a mass on a spring."""
    return math.pi * math.sqrt(mass / stiffness)
