# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The scenes of the benchmarks, and the plain numbers that a peer builds them from."""

from typing import Any, NamedTuple

from icofabric_sim.scene.scene import Scene
import numpy as np

# A free slab with random velocities: a = 0.01 m, T = 0.002 m, rho = 1200 kg/m^3, L = w,
# k = 500 N/m. Nothing but the springs acts.
FABRIC: dict[str, Any] = {
    'shell': {'edge_length': 0.02, 'thickness': 0.002, 'density': 1200.0},
    'weave': {'kind': 'orthogonal', 'variant': 0, 'connector_angle': 0.0},
    'connector': {'stiffness': 500.0},
    'initial_random': {'velocity_sigma': 0.05, 'spin_sigma': 2.0, 'seed': 1},
    'contact': {'mode': 'never'},
}
# Connectors that push a fifth as strongly as they pull.
KINKED: dict[str, Any] = {'connector': {'stiffness': 500.0, 'stiffness_compression': 100.0}}
DAMPED: dict[str, Any] = {'connector': {'stiffness': 500.0, 'damping': 0.02}}
# L = w = (1 + sqrt 5) a [m].
FABRIC_LENGTH = (1.0 + 5.0**0.5) * 0.01
SIZES = {'S1': (5, 5, 5), 'S3': (21, 21, 21)}
# Time [s] over which the error of S1 is measured.
DURATION = 0.5
# And of the same with kinked connectors, whose reference stops at every kink: 26,000 in a second.
KINKED_DURATION = 0.1


class Motion(NamedTuple):
    """Where all bodies are at one time; world frame."""

    position: np.ndarray  # (n, 3) [m]
    axes: np.ndarray  # (n, 3, 3): row i is body axis i in world components


class PlainScene(NamedTuple):
    """A free fabric as numbers, for tools without weaves."""

    name: str
    half_edge: float  # a [m]
    half_width: float  # centre to edge midpoint [m]
    mass: float  # [kg]
    inertia: float  # isotropic [kg m^2]
    stiffness: float  # [N/m]
    compression: float  # [N/m] where they push; mostly the same
    damping: float  # [N s/m] of the rate of their length; mostly 0
    natural_length: float  # [m]
    bodies: np.ndarray  # (c, 2) body numbers
    edges: np.ndarray  # (c, 2) edge codes: up down north south west east
    position: np.ndarray  # (n, 3) [m] at the start
    orientation: np.ndarray  # (n, 4) x y z w, body to world
    velocity: np.ndarray  # (n, 3) [m/s]
    spin: np.ndarray  # (n, 3) [rad/s], world frame

    @property
    def body_count(self) -> int:
        """Count the bodies."""
        return len(self.position)

    @property
    def connector_count(self) -> int:
        """Count the connectors."""
        return len(self.bodies)

    @property
    def frequency_bound(self) -> float:
        """
        Frequency [rad/s] that no body exceeds while its connectors keep their length.

        Twelve connectors at most, each with k / M and k (w/2)^2 / Lambda, two bodies against each
        other.
        """
        rate = 1.0 / self.mass + self.half_width**2 / self.inertia
        return float(np.sqrt(2.0 * 12.0 * self.stiffness * rate))

    @property
    def axes(self) -> np.ndarray:
        """Body axes at the start, (n, 3, 3)."""
        return axes_from_quaternions(self.orientation)

    @property
    def edge_points(self) -> np.ndarray:
        """Midpoints (6, 3) of the edges by code [m], body frame."""
        unit = np.array([[0, 0, 1], [0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
        return self.half_width * unit


def scene_parameters(
    size: tuple[int, int, int], solver: dict[str, Any] | None = None,
    changes: dict[str, Any] | None = None
) -> dict[str, Any]:
    """Parameters of the benchmark fabric of `size` grid positions, with sections of its own."""
    parameters = {**FABRIC, **(changes or {}), 'weave': {**FABRIC['weave'], 'size': list(size)}}
    if solver:
        parameters['solver'] = dict(solver)
    return parameters


def plain_scene(
    name: str, size: tuple[int, int, int] | None = None, changes: dict[str, Any] | None = None
) -> PlainScene:
    """Numbers of scene `name` (a key of SIZES, or any name where a `size` is given)."""
    return plain_numbers(name, Scene.from_parameters(
        scene_parameters(SIZES[name] if size is None else size, changes=changes)))


def plain_numbers(name: str, scene: Scene) -> PlainScene:
    """Numbers of any fabric whose connectors are all alike, at its start."""
    start = scene.initial
    return PlainScene(
        name=name,
        half_edge=scene.geometry.half_edge,
        half_width=0.5 * scene.geometry.cube_width,
        mass=scene.shell.mass,
        inertia=scene.shell.inertia,
        stiffness=float(scene.connectors.laws.extension[0]),
        compression=float(scene.connectors.laws.compression[0]),
        damping=float(scene.connectors.damping[0]),
        natural_length=float(scene.connectors.laws.natural_length[0]),
        bodies=np.array(scene.connectors.bodies, dtype=np.int64),
        edges=np.array(scene.connectors.edges, dtype=np.int64),
        position=start.position.copy(),
        orientation=start.orientation.copy(),
        velocity=start.linear_velocity.copy(),
        spin=start.angular_velocity.copy(),
    )


def axes_from_quaternions(orientation: np.ndarray) -> np.ndarray:
    """
    Body axes as rows (n, 3, 3) of quaternions x y z w (n, 4), which need not have unit length.
    """
    x, y, z, w = (orientation / np.linalg.norm(orientation, axis=1, keepdims=True)).T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)),
        (2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)),
        (2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)),
    )
    return np.moveaxis(np.array(rows), -1, 0)


def axes_from_midpoints(points: np.ndarray) -> Motion:
    """Motion of bodies from the world positions (n, 6, 3) of their edge midpoints by code."""
    position = points.mean(axis=1)
    axes = np.stack(
        [points[:, 2] - points[:, 3], points[:, 4] - points[:, 5], points[:, 0] - points[:, 1]],
        axis=1,
    )
    return Motion(position, axes / np.linalg.norm(axes, axis=2, keepdims=True))


def motion_error(motion: Motion, reference: Motion, half_edge: float) -> float:
    """
    Largest over all bodies of the distance over a and the angle [rad] between two motions.

    Infinite where a motion is not finite.
    """
    if not (np.isfinite(motion.position).all() and np.isfinite(motion.axes).all()):
        return float('inf')
    distance = np.linalg.norm(motion.position - reference.position, axis=1) / half_edge
    # Chord between two orientations, |A - B| = 2 sqrt(2) sin(angle / 2): exact for small angles,
    # where the trace loses half the digits.
    chord = np.linalg.norm(motion.axes - reference.axes, axis=(1, 2)) / (2.0 * np.sqrt(2.0))
    angle = 2.0 * np.arcsin(np.minimum(chord, 1.0))
    return float(max(distance.max(), angle.max()))
