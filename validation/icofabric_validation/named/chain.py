# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
A chain of masses on a line: the middle diagonal row of a rotated slab, cut out by a region.

Attachment points lie on the line, and supports leave each body only the freedom to move along the
line. Positions x_i therefore obey m x_i'' = T(x_i+1 - x_i) - T(x_i - x_i-1) with the law T of the
connectors. Masses are 1 kg.
"""

from collections.abc import Callable
import math
from pathlib import Path
from typing import Any, Final

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.simulation import Simulation
import numpy as np
from scipy.spatial.transform import Rotation

_HALF_EDGE: Final = 1.0  # [m]
_REACH: Final = 0.5  # from a centre to its attachment points [m]
# weave.connector_length [m]; no extension in these problems makes two points coincide.
_CONNECTOR_LENGTH: Final = 10.0


def chain_parameters(count: int, fixed: str, parameters: dict[str, Any]) -> dict[str, Any]:
    """Return the parameters of a chain of an odd number of bodies; `fixed` selects held ones."""
    if count % 2 == 0:
        raise ValueError(f'count must be odd as in the middle row of a slab, got {count}')
    values: dict[str, Any] = {
        'weave.kind': 'bias', 'weave.boundary': 'fabric', 'weave.size': [count, count, 1],
        # The middle row is along x; all other bodies are outside the region.
        'weave.azimuth': 0.25 * math.pi, 'weave.region': f'box {40.0 * count} 1 1',
        'weave.connector_length': _CONNECTOR_LENGTH, 'shell.edge_length': 2.0 * _HALF_EDGE,
        'shell.thickness': 0.5, 'shell.mass': 1.0, 'contact.mode': 'never', 'solver.threads': 1,
        'groups.row': 'all', 'supports.line.group': 'row', 'supports.line.fix': 'ty tz rotation',
        'groups.ends': fixed, 'supports.ends.group': 'ends', 'supports.ends.fix': 'all'}
    woven = Scene.from_parameters(values)
    along = Rotation.from_quat(woven.initial.orientation[0]).inv().apply(_direction(woven))
    for edge, sign in (('south', 1.0), ('north', -1.0)):
        values[f'connector.attachment.{edge}'] = [float(sign * _REACH * x) for x in along]
    return {**values, **parameters}


def natural_length() -> float:
    """Return the woven length of the connectors [m], at which laws have extension 0."""
    scene = Scene.from_parameters(chain_parameters(3, 'ids 0 2', {}))
    return float(np.linalg.norm(scene.position[1] - scene.position[0])) - 2.0 * _REACH


def write_law(
    path: Path, tension: Callable[[np.ndarray], np.ndarray], low: float, high: float, lines: int
) -> float:
    """
    Write a law for extensions `low` to `high` [m] as a table; return the spacing [m].

    One line is at extension 0, where the force is 0, so the natural length is the woven one.
    """
    spacing = (high - low) / lines
    extension = spacing * np.arange(round(low / spacing), round(high / spacing) + 1)
    rows = zip((natural_length() + extension).tolist(), tension(extension).tolist())
    path.write_text(''.join(f'{length!r},{force!r}\n' for length, force in rows), encoding='utf-8')
    return spacing


def set_chain_state(
    simulation: Simulation, displacement: np.ndarray, velocity: np.ndarray
) -> None:
    """Set displacements [m] from woven positions and velocities [m/s] along the line, (n,)."""
    scene = simulation.scene
    along = _direction(scene)
    simulation.set_state(
        position=scene.position + displacement[:, None] * along,
        linear_velocity=velocity[:, None] * along)


def chain_state(simulation: Simulation) -> tuple[np.ndarray, np.ndarray]:
    """Return displacements [m] and velocities [m/s] along the line, (n,)."""
    snapshot, along = simulation.snapshot(), _direction(simulation.scene)
    return (snapshot.position - simulation.scene.position) @ along, (
        snapshot.linear_velocity @ along)


def _direction(scene: Scene) -> np.ndarray:
    """Return the unit vector (3,) from each body to the next."""
    step: np.ndarray = scene.position[1] - scene.position[0]
    return step / np.linalg.norm(step)
