# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Light on facets: a lamp with soft shadows, light from the sky, and less of it between neighbours.

Neighbours cast shadows as balls. A facet is lit as one, from what reaches its middle: that keeps
the facets visible, and is the same for the same state.
"""

from typing import NamedTuple

from icofabric_sim.geometry.icosahedron import inscribed_radius
import numpy as np
from scipy.spatial import cKDTree

# Neighbours that are asked for shadows, beside the nearest one.
_NEIGHBOURS = 20
# Parts of the light: from the sky, from the lamp, from the viewer's side.
_SKY, _LAMP, _FRONT = 0.60, 0.44, 0.20
# Tints of light and shade.
_WARM, _COOL = np.array([1.02, 1.0, 0.96]), np.array([0.94, 0.98, 1.05])
# How fast the edge of a shadow becomes soft with the distance, and how soft it is at its origin.
_SOFTENING, _SOFT = 0.22, 0.35


class Lighting(NamedTuple):
    """Directions (3,) of the lamp and of the viewer, world frame."""

    lamp: np.ndarray
    front: np.ndarray

    @classmethod
    def of(cls, axes: np.ndarray) -> 'Lighting':
        """From above, left of a viewer with these axes, and a little from behind it."""
        level = np.array([axes[2][0], axes[2][1], 0.0])
        size = np.linalg.norm(level)
        towards = level / size if size > 1e-6 else np.zeros(3)
        lamp = -0.55 * axes[0] + 0.45 * towards + np.array([0.0, 0.0, 1.0])
        return cls(lamp / np.linalg.norm(lamp), axes[2])


def light_on(
    lighting: Lighting, points: np.ndarray, normals: np.ndarray, body: np.ndarray,
    position: np.ndarray, half_edges: np.ndarray
) -> np.ndarray:
    """
    Return the factors of the colours of facets, (m, 3).

    Their middles are `points` (m, 3), of the shells `body` (m,) at `position` (n, 3), with
    their half edges (n,) [m].
    """
    shadow, openness = _from_neighbours(
        lighting.lamp, points, normals, body, position, half_edges)
    lamp = np.clip(normals @ lighting.lamp, 0.0, 1.0) * shadow
    sky = (0.72 + 0.28 * normals[:, 2]) * openness
    front = np.clip(normals @ lighting.front, 0.0, 1.0)
    return np.asarray(
        (_SKY * sky + _FRONT * front)[:, None] * _COOL + (_LAMP * lamp)[:, None] * _WARM)


def _from_neighbours(
    lamp: np.ndarray, points: np.ndarray, normals: np.ndarray, body: np.ndarray,
    position: np.ndarray, half_edges: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the unshaded fractions of lamp light and sky light on each facet, 0 to 1."""
    count = min(len(position), _NEIGHBOURS + 1)
    if count < 2:
        return np.ones(len(points)), np.ones(len(points))
    _, near = cKDTree(position).query(position, k=count)
    balls = position[near[:, 1:]]
    radii = 1.08 * inscribed_radius(1.0) * half_edges[near[:, 1:]]
    shadow, openness = np.ones(len(points)), np.ones(len(points))
    for number in range(balls.shape[1]):
        away, radius = balls[body, number] - points, radii[body, number]
        square = np.einsum('mi,mi->m', away, away)
        along = away @ lamp
        beside = np.sqrt(np.maximum(square - along**2, 0.0))
        soft = _SOFT * radius + _SOFTENING * np.maximum(along, 0.0)
        part = np.clip((radius + 0.5 * soft - beside) / soft, 0.0, 1.0)
        part = part * part * (3.0 - 2.0 * part)
        shadow *= np.where(along > 0.0, 1.0 - part, 1.0)
        facing = np.einsum('mi,mi->m', away, normals) / np.sqrt(square)
        openness -= 0.9 * np.clip(facing, 0.0, 1.0) * np.minimum(radius**2 / square, 1.0)
    return shadow, np.clip(openness, 0.35, 1.0)
