# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Rigid planes: floors and walls."""

import math

from icofabric_sim.parameters.validation import ParameterError, Parameters
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
