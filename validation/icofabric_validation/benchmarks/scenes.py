# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The scenes of the benchmarks, and plain numbers for peers."""

from typing import Any, NamedTuple

from icofabric_sim.scene.scene import Scene
import numpy as np

# A free slab with random velocities: a = 0.01 m, T = 0.002 m, rho = 1200 kg/m^3, L = w,
# k = 500 N/m. Only springs act.
FABRIC: dict[str, Any] = {
    'shell': {'edge_length': 0.02, 'thickness': 0.002, 'density': 1200.0},
    'weave': {'kind': 'orthogonal', 'variant': 0, 'connector_angle': 0.0},
    'connector': {'stiffness': 500.0},
    'initial_random': {'velocity_sigma': 0.05, 'spin_sigma': 2.0, 'seed': 1},
    'contact': {'mode': 'never'},
}
# Connectors with a fifth of the stiffness in compression.
KINKED: dict[str, Any] = {'connector': {'stiffness': 500.0, 'stiffness_compression': 100.0}}
DAMPED: dict[str, Any] = {'connector': {'stiffness': 500.0, 'damping': 0.02}}
# L = w = (1 + sqrt 5) a [m].
FABRIC_LENGTH = (1.0 + 5.0**0.5) * 0.01
SIZES = {'S1': (5, 5, 5), 'S3': (21, 21, 21)}
# Time [s] over which the error of S1 is measured.
DURATION = 0.5
# The same with two stiffnesses, whose reference stops at every side change: 26,000 per second.
KINKED_DURATION = 0.1


class Motion(NamedTuple):
    """Positions and axes of all bodies at one time; world frame."""

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
        Upper bound of the frequency [rad/s] of a body while connectors keep their length.

        At most twelve connectors, each with k / M and k (w/2)^2 / Lambda, and two bodies in
        opposite motion.
        """
        rate = 1.0 / self.mass + self.half_width**2 / self.inertia
        return float(np.sqrt(2.0 * 12.0 * self.stiffness * rate))

    @property
    def axes(self) -> np.ndarray:
        """Return the initial body axes, (n, 3, 3)."""
        return axes_from_quaternions(self.orientation)

    @property
    def edge_points(self) -> np.ndarray:
        """Return the midpoints (6, 3) of the edges by code [m], in the body frame."""
        unit = np.array([[0, 0, 1], [0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
        return self.half_width * unit


def scene_parameters(
    size: tuple[int, int, int], solver: dict[str, Any] | None = None,
    changes: dict[str, Any] | None = None
) -> dict[str, Any]:
    """Return parameters of the benchmark fabric of `size` positions, with changed sections."""
    parameters = {**FABRIC, **(changes or {}), 'weave': {**FABRIC['weave'], 'size': list(size)}}
    if solver:
        parameters['solver'] = dict(solver)
    return parameters


def plain_scene(
    name: str, size: tuple[int, int, int] | None = None, changes: dict[str, Any] | None = None
) -> PlainScene:
    """Return the numbers of scene `name`, a key of SIZES, or any name with a `size`."""
    return plain_numbers(name, Scene.from_parameters(
        scene_parameters(SIZES[name] if size is None else size, changes=changes)))


def plain_numbers(name: str, scene: Scene) -> PlainScene:
    """Return the numbers of a fabric with equal connectors, at its start."""
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
    """Return body axes as rows (n, 3, 3) of quaternions x y z w (n, 4) of any length."""
    x, y, z, w = (orientation / np.linalg.norm(orientation, axis=1, keepdims=True)).T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)),
        (2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)),
        (2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)),
    )
    return np.moveaxis(np.array(rows), -1, 0)


def axes_from_midpoints(points: np.ndarray) -> Motion:
    """Return the motion from world positions (n, 6, 3) of edge midpoints by code."""
    position = points.mean(axis=1)
    axes = np.stack(
        [points[:, 2] - points[:, 3], points[:, 4] - points[:, 5], points[:, 0] - points[:, 1]],
        axis=1,
    )
    return Motion(position, axes / np.linalg.norm(axes, axis=2, keepdims=True))


def motion_error(motion: Motion, reference: Motion, half_edge: float) -> float:
    """
    Return the largest distance over a or angle [rad] of a body between two motions.

    Infinite if a motion is not finite.
    """
    if not (np.isfinite(motion.position).all() and np.isfinite(motion.axes).all()):
        return float('inf')
    distance = np.linalg.norm(motion.position - reference.position, axis=1) / half_edge
    # The chord |A - B| = 2 sqrt(2) sin(angle / 2) is exact for small angles; the trace would lose
    # half of the digits.
    chord = np.linalg.norm(motion.axes - reference.axes, axis=(1, 2)) / (2.0 * np.sqrt(2.0))
    angle = 2.0 * np.arcsin(np.minimum(chord, 1.0))
    return float(max(distance.max(), angle.max()))
