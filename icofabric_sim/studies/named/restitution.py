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
"""The restitution of a damped collision in one point, by its equation."""

import math

from icofabric_sim.kernels.contact.many import touch_planes
from icofabric_sim.kernels.contact.pair import contact_scratch, OUT_SIZE
from icofabric_sim.studies.named.loose_bodies import A, UP, VERTICES
import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

TIP = float(np.linalg.norm(VERTICES[0]))  # from the centre to a vertex [m]


def depth_share(rotation: Rotation) -> float:
    """
    Overlap delta of a vertex in the floor over the depth of its tip, of a body turned like this.
    """
    depth = 1e-4 * A
    touching, out = np.zeros(1, bool), np.zeros((1, OUT_SIZE))
    touch_planes(
        A, UP, 0.0, ((TIP - depth) * UP)[None], np.ascontiguousarray(rotation.as_matrix())[None],
        contact_scratch(), touching, out)
    return float(out[0, 10]) / depth


def restitution(damping: float, speed: float) -> float:
    """
    Speed after over speed before: u - ln(1 + u) = -e u - ln(1 - e u), u = damping x rate of delta.
    """
    u = damping * speed
    if u == 0.0:
        return 1.0
    whole = u - math.log1p(u)
    # With e u = 1 - x, x in (0, 1): the right side rises from 0 to infinity as x falls.
    x = brentq(lambda x: x - 1.0 - math.log(x) - whole, 1e-300, 1.0, xtol=1e-16, rtol=1e-14)
    return float((1.0 - x) / u)


def damping_for(wanted: float, speed: float) -> float:
    """The damping c [s/m] of a restitution at this rate of delta [m/s]."""
    return float(brentq(
        lambda u: restitution(u, 1.0) - wanted, 1e-6, 100.0, xtol=1e-14)) / speed
