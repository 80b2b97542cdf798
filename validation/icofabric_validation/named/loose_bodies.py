# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Shells without connectors that meet each other and a floor, and how they stand on it."""

from collections.abc import Sequence
import math
from typing import Any, Final, NamedTuple

from icofabric_sim.geometry.icosahedron import face_geometry, vertices
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.simulation import compile_scene, Simulation
import numpy as np
from scipy.spatial.transform import Rotation

# Half edge [m] and weight [m/s^2].
A: Final = 0.01
GRAVITY: Final = 9.81
UP: Final = np.array([0.0, 0.0, 1.0])
VERTICES: Final = vertices(A)
NORMALS: Final = face_geometry(A).normals
# Of the floor [m]: a scene begins at the places of the weave, where nothing may overlap.
FLOOR_HEIGHT: Final = -0.05
FLOOR: Final[dict[str, Any]] = {
    'planes.floor.normal': [0.0, 0.0, 1.0], 'planes.floor.offset': FLOOR_HEIGHT}
_AT_REST = (0.0, 0.0, 0.0)


class Body(NamedTuple):
    """One shell at the start."""

    position: Sequence[float] | np.ndarray  # [m], above the height of the floor
    velocity: Sequence[float] | np.ndarray = _AT_REST  # [m/s]
    rotation: Rotation = Rotation.identity()
    spin: Sequence[float] | np.ndarray = _AT_REST  # [rad/s]


def standing(direction: np.ndarray, azimuth: float = 0.0) -> Rotation:
    """The rotation by which a direction of the body looks down, turned about the vertical."""
    down = Rotation.align_vectors([-UP], [direction])[0]
    return Rotation.from_rotvec(azimuth * UP) * down


def simulate(bodies: Sequence[Body], parameters: dict[str, Any]) -> Simulation:
    """Simulation of these bodies; with FLOOR among the parameters there is a floor."""
    scene = Scene.from_parameters({
        # Every second place of two rows holds a body.
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
    """Heights (n,) of the centres above the floor [m]."""
    above: np.ndarray = simulation.snapshot().position[:, 2] - FLOOR_HEIGHT
    return above


def contact_time(mass: float, stiffness: float) -> float:
    """Time [s] after which a mass on a spring has been thrown back."""
    return math.pi * math.sqrt(mass / stiffness)
