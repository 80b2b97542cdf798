# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
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
