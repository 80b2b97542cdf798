# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Rigid planes: floors, walls, and platens that move on prescribed paths."""

from collections.abc import Mapping
import math

from icofabric_sim.parameters.validation import ParameterError, Parameters
from icofabric_sim.scene.drives import make_path
from icofabric_sim.scene.paths import Path
import numpy as np


def make_planes(parameters: Parameters) -> np.ndarray:
    """Return unit normals and offsets [m] of all `planes.NAME`, (k, 4); refuse zero normals."""
    rows = []
    for name in parameters.names('planes'):
        normal = parameters[f'planes.{name}.normal']
        size = math.hypot(*normal)
        if not 0.0 < size < math.inf:
            key = f'planes.{name}.normal'
            raise ParameterError(
                key, f'{key} must be a nonzero, finite vector, got {normal}; give one that points '
                'from the plane to its free side')
        # The half space normal . x >= offset stays the same.
        offset = parameters[f'planes.{name}.offset']
        rows.append([*(part / size for part in normal), offset / size])
    return np.array(rows, dtype=float).reshape(-1, 4)


def planes_at(parameters: Parameters, paths: Mapping[str, Path], time: float) -> np.ndarray:
    """
    Return the planes, as `make_planes`, moved along their `paths` until a `time` [s]; NaN: 0.

    Twists that have replaced paths are left out.
    """
    planes = make_planes(parameters)
    for plane, name in zip(planes, parameters.names('planes')):
        if name in paths:
            plane[3] += plane[:3] @ paths[name].at(time if time == time else 0.0)[:3]
    return planes


def make_platens(parameters: Parameters) -> dict[str, Path]:
    """Return the paths of the planes that may move; refuse paths of fixed planes."""
    paths = {}
    for name in parameters.names('planes'):
        prefix = f'planes.{name}'
        if parameters[f'{prefix}.motion'] != 'fixed':
            paths[name] = make_path(parameters, prefix, turns=False)
            continue
        for field in ('linear', 'start', 'duration', 'frequency', 'phase', 'file'):
            value = parameters[f'{prefix}.{field}']
            if any(value) if isinstance(value, list) else value:
                raise ParameterError(
                    f'{prefix}.{field}',
                    f'{prefix}.{field} {value!r} is for a plane that moves, and '
                    f'{prefix}.motion is fixed: leave it out, or choose a motion')
    return paths
