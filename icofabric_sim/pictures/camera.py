# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A viewer with perspective: where it stands, what it looks at, and where points land."""

import math
from typing import NamedTuple

import numpy as np

# Full angle of view [rad] along the shorter side of a picture: that of a short telephoto lens,
# which shows depth and distorts little.
_FIELD = math.radians(24.0)
# What comes nearer to the eye than this part of the distance to the target is not drawn.
_NEAR_RATIO = 0.05
# Rounds in which target and distance are fitted to what is shown.
_ROUNDS = 8


class View(NamedTuple):
    """Direction of the viewer, as seen from the fabric."""

    azimuth: float = math.radians(-62.0)  # [rad] from +x towards +y
    elevation: float = math.radians(16.0)  # [rad] above the horizontal plane
    distance: float = 0.0  # [m] from the target; 0: so that all that is shown fits

    @property
    def axes(self) -> np.ndarray:
        """Rows: unit vectors to the right, upwards and towards the viewer, world components."""
        ca, sa = math.cos(self.azimuth), math.sin(self.azimuth)
        ce, se = math.cos(self.elevation), math.sin(self.elevation)
        return np.array([[-sa, ca, 0.0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]])


class Area(NamedTuple):
    """The part of a picture in which the fabric is shown [pixels], from the upper left."""

    left: float
    top: float
    width: float
    height: float

    def times(self, factor: float) -> 'Area':
        """Return the same part of the picture with `factor` times as many pixels each way."""
        return Area(*(factor * value for value in self))


class Camera(NamedTuple):
    """A pinhole camera."""

    axes: np.ndarray  # (3, 3) rows: right, up, towards the viewer
    target: np.ndarray  # (3,) [m] in the middle of the area
    distance: float  # [m] from the eye to the target

    @property
    def eye(self) -> np.ndarray:
        """Position of the viewer (3,) [m]."""
        return np.asarray(self.target + self.distance * self.axes[2])

    def focal(self, area: Area) -> float:
        """Pixels for a meter at a distance of one meter."""
        return 0.5 * min(area.width, area.height) / math.tan(0.5 * _FIELD)

    def pixels_per_meter(self, area: Area) -> float:
        """Scale at the target."""
        return self.focal(area) / self.distance

    def seen(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) in axes of the viewer: right, up, towards the viewer [m]."""
        return np.asarray((points - self.target) @ self.axes.T)

    def project(self, points: np.ndarray, area: Area) -> np.ndarray:
        """Pixels (..., 2) of points (..., 3), rightwards and downwards."""
        seen = self.seen(points)
        depth = np.maximum(self.distance - seen[..., 2], _NEAR_RATIO * self.distance)
        scale = self.focal(area) / depth
        return np.stack([
            area.left + 0.5 * area.width + scale * seen[..., 0],
            area.top + 0.5 * area.height - scale * seen[..., 1]], axis=-1)

    def distances(self, points: np.ndarray) -> np.ndarray:
        """Distances (...) [m] of points (..., 3) from the eye."""
        return np.asarray(np.linalg.norm(points - self.eye, axis=-1))

    def is_before(self, points: np.ndarray) -> np.ndarray:
        """Return True for points (..., 3) that are far enough in front of the eye to be drawn."""
        return np.asarray(self.distance - self.seen(points)[..., 2] > _NEAR_RATIO * self.distance)

    def moved_to(self, target: np.ndarray) -> 'Camera':
        """Return the same camera aimed at another point from the same side."""
        return self._replace(target=np.asarray(target, dtype=float))


def fit_camera(
    view: View, points: np.ndarray, radius: float, area: Area, *,
    target: np.ndarray | None = None
) -> Camera:
    """
    Return the camera that shows balls of `radius` [m] at `points` (n, 3) as large as possible.

    `target` [m]: what it looks at; by default what centres the picture. A view with a distance of
    its own keeps it.
    """
    axes = view.axes
    wide, high = (
        math.tan(0.5 * _FIELD) * side / min(area.width, area.height)
        for side in (area.width, area.height))
    seen = points @ axes.T
    centre = 0.5 * (seen.min(axis=0) + seen.max(axis=0)) if target is None else axes @ target
    distance = max(view.distance, 4.0 * radius)
    for _ in range(_ROUNDS):
        away = seen - centre
        if not view.distance:
            needed = np.maximum(
                (np.abs(away[:, 0]) + radius) / wide, (np.abs(away[:, 1]) + radius) / high)
            distance = max(float((away[:, 2] + needed).max()), 4.0 * radius)
        if target is not None:
            break
        depth = np.maximum(distance - away[:, 2], 0.2 * distance)[:, None]
        slope = away[:, :2] / depth
        # The picture's middle, taken back to the depth of the target.
        centre[:2] += 0.5 * distance * (slope.min(axis=0) + slope.max(axis=0))
    return Camera(axes, axes.T @ centre, distance)


def near_ones(position: np.ndarray, reach: float) -> np.ndarray:
    """
    Return True for bodies (n, 3) of the fabric, False for those lost far away, (n,).

    Lost is what is farther from the median than twice the `reach` of the fabric [m] and than six
    times the median distance.
    """
    finite = np.isfinite(position).all(axis=1)
    if not finite.any():
        return finite
    away = np.full(len(position), np.inf)
    away[finite] = np.linalg.norm(
        position[finite] - np.median(position[finite], axis=0), axis=1)
    limit = max(2.0 * reach, 6.0 * float(np.median(away[finite])))
    return np.asarray(away <= limit)
