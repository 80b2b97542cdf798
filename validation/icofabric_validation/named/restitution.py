# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The restitution of a damped collision in one point, by its equation."""

import math
from typing import Final

from icofabric_sim.geometry.icosahedron import inscribed_radius
from icofabric_validation.named.loose_bodies import A, VERTICES
import numpy as np
from scipy.optimize import brentq

TIP: Final = float(np.linalg.norm(VERTICES[0]))  # from the centre to a vertex [m]
# Overlap delta of a vertex that points straight into the floor, over the depth of its tip. delta
# is four times the mean over the overlap, a pyramid, of the lesser depth: of the floor, 1 - z at
# the height z above the tip, or of the face, C z (1 - s) at the part s of the way from the axis,
# C the cosine between vertex and normal. So it is 24 times the integral of
# s z^2 min(1 - z, C z (1 - s)) over 0 < s, z < 1, which is C / (1 + C).
_COSINE = inscribed_radius(A) / TIP
VERTEX_SHARE: Final = _COSINE / (1.0 + _COSINE)


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
