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
"""What touches in a configuration, as friction needs it: pushes, points, normals, patches."""

from typing import NamedTuple

from icofabric_sim.kernels.contact.laws import patch_radius
import numpy as np


class Meetings(NamedTuple):
    """What touches in a configuration, and how."""

    pairs: np.ndarray  # (p, 2) bodies; the second one -1 - k: plane k
    push: np.ndarray  # (p,) N [N]
    point: np.ndarray  # (p, 3) [m] world
    normal: np.ndarray  # (p, 3) of the push on the first body
    radius: np.ndarray  # (p,) [m] of the patch, at which friction acts about the normal
    # (p, 12) force and torque about its centre on the first body, and on the second, of 1 N
    wrenches: np.ndarray
    overlap: np.ndarray  # (p,) [m]


def meetings_of(
    pairs: np.ndarray, pushes: np.ndarray, out: np.ndarray, middle: np.ndarray
) -> Meetings:
    """
    Of contacts as they come from the kernels, `out` (p, 20); `middle` (p, 3) [m] of both bodies.

    `pushes` (p, 3) [N] on the first one.
    """
    size = np.linalg.norm(out[:, :3], axis=1)
    # What meets in no more than a point or an edge may be pushed by nothing.
    there = size > 0.0
    pairs, pushes, out, middle, size = (
        part[there] for part in (pairs, pushes, out, middle, size))
    push = np.linalg.norm(pushes, axis=1)
    return Meetings(
        pairs, push, out[:, 15:18] + middle, out[:, :3] / size[:, None],
        np.array([patch_radius(row) for row in out]),
        np.hstack([out[:, :6], -out[:, :3], out[:, 6:9]]) / size[:, None],
        np.where(push > 0.0, out[:, 11], 0.0))
