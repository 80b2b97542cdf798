# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Restitution of a damped collision at one point, from its equation."""

import math
from typing import Final

from icofabric_sim.geometry.icosahedron import inscribed_radius
from icofabric_validation.named.loose_bodies import A, VERTICES
import numpy as np
from scipy.optimize import brentq

TIP: Final = float(np.linalg.norm(VERTICES[0]))  # from the centre to a vertex [m]
# Overlap delta of a vertex that points straight into the floor, over the depth of its tip. The
# overlap is a pyramid, and delta is four times the mean of the smaller depth over it. At height z
# above the tip and fraction s of the distance from the axis to a face, the depth is 1 - z in the
# floor and C z (1 - s) in the face, with C the cosine between vertex and normal. The mean is 24
# times the integral of s z^2 min(1 - z, C z (1 - s)) over 0 < s, z < 1, which is C / (1 + C).
_COSINE = inscribed_radius(A) / TIP
VERTEX_SHARE: Final = _COSINE / (1.0 + _COSINE)


def restitution_of(damping: float, speed: float) -> float:
    """
    Return the speed ratio e of u - ln(1 + u) = -e u - ln(1 - e u), u = damping x rate of delta.
    """
    u = damping * speed
    if u == 0.0:
        return 1.0
    whole = u - math.log1p(u)
    # With e u = 1 - x, x in (0, 1), the right side rises from 0 to infinity as x falls.
    x = brentq(lambda x: x - 1.0 - math.log(x) - whole, 1e-300, 1.0, xtol=1e-16, rtol=1e-14)
    return float((1.0 - x) / u)


def damping_for(restitution: float, speed: float) -> float:
    """Return the damping c [s/m] for a restitution at this rate of delta [m/s]."""
    return float(brentq(
        lambda u: restitution_of(u, 1.0) - restitution, 1e-6, 100.0, xtol=1e-14)) / speed
