# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
What contact loses: damping along the depth, and Coulomb friction that sticks.

Both take what `touch_pair` wrote for a pair A and B, or `touch_plane`; for a plane B stands still
and its arm is 0. Velocities and arms are of the world, arms from the bodies' centres to the
contact point. Both act with opposite forces at one point, or along the gradient of delta: the
pair's momentum and angular momentum stay what they are.

Damping multiplies the push by 1 + c d(delta)/dt, and never pulls (K. H. Hunt and F. R. E.
Crossley, J. Appl. Mech. 42, 440, 1975). It takes the power c K delta (d(delta)/dt)^2 >= 0, and
its force begins with 0 at first touch as the push does.

Friction is the force k s of a spring between the surfaces, with a stretch s along them of at most
limit = mu N / k (P. A. Cundall and O. D. L. Strack, Geotechnique 29, 47, 1979). Its stretch
follows the slip; from 0.9 of the limit on the part of the slip that would stretch it further is
lost more and more, at the limit all (as P. Dupont and others, IEEE Trans. Autom. Control 47, 787,
2002): the bodies stick without creeping below 0.9 mu N, and slide at mu N. What is neither stored
in the spring nor given back is lost, never gained. The stretch is part of the state of a pair.
"""

import math
from typing import Any

from icofabric_sim.kernels.compiled import compiled
import numpy as np

# Part of the limit up to which a stretch is elastic.
ELASTIC = 0.9
Three = tuple[float, float, float]


@compiled
def depth_rate(out: np.ndarray, va: Any, wa: Any, vb: Any, wb: Any) -> float:
    """
    Rate of delta [m/s] by the velocities and angular velocities (3,) of both bodies; 0 if apart.

    The push for K = 1 is -delta grad delta, so its power is -delta d(delta)/dt.
    """
    if not out[10] > 0.0:
        return 0.0
    power = (
        out[0] * (va[0] - vb[0]) + out[1] * (va[1] - vb[1]) + out[2] * (va[2] - vb[2])
        + out[3] * wa[0] + out[4] * wa[1] + out[5] * wa[2]
        + out[6] * wb[0] + out[7] * wb[1] + out[8] * wb[2])
    return -power / out[10]


@compiled
def damping_factor(damping: float, rate: float) -> float:
    """
    What the push is multiplied by, for a damping c [s/m] and the rate of delta [m/s].
    """
    return max(0.0, 1.0 + damping * rate)


@compiled
def slip(
    out: np.ndarray, va: Any, wa: Any, arm_a: Any, vb: Any, wb: Any, arm_b: Any
) -> tuple[Three, Three]:
    """
    Unit normal of the contact, from A to B, and velocity of B over A along it [m/s].

    The normal is the direction of the push on B; nothing slips where nothing pushes.
    """
    push = math.sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2])
    if not push > 0.0:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    n = -out[0] / push, -out[1] / push, -out[2] / push
    v = (
        vb[0] + wb[1] * arm_b[2] - wb[2] * arm_b[1]
        - (va[0] + wa[1] * arm_a[2] - wa[2] * arm_a[1]),
        vb[1] + wb[2] * arm_b[0] - wb[0] * arm_b[2]
        - (va[1] + wa[2] * arm_a[0] - wa[0] * arm_a[2]),
        vb[2] + wb[0] * arm_b[1] - wb[1] * arm_b[0]
        - (va[2] + wa[0] * arm_a[1] - wa[1] * arm_a[0]))
    return n, along(v, n)


@compiled
def along(v: Three, n: Three) -> Three:
    """
    The part of a vector at right angles to a unit normal.
    """
    across = v[0] * n[0] + v[1] * n[1] + v[2] * n[2]
    return v[0] - across * n[0], v[1] - across * n[1], v[2] - across * n[2]


@compiled
def held(stretch: Three, n: Three, limit: float) -> Three:
    """
    What is left of a stretch [m] with another normal and limit [m]: never longer.

    The force on A is the stiffness k times it, that on B the opposite.
    """
    s = along(stretch, n)
    length = math.sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2])
    if not length > limit:
        return s
    factor = limit / length
    return factor * s[0], factor * s[1], factor * s[2]


@compiled
def stretch_rate(stretch: Three, velocity: Three, spin: Three, limit: float) -> Three:
    """
    Rate of a held stretch [m/s], for the slip, and the mean angular velocity of both bodies.

    The second turns the spring with the pair. Power lost: stiffness times stretch times the part
    of the slip that is left out, never negative.
    """
    s, v, w = stretch, velocity, spin
    length = math.sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2])
    lost = 0.0
    if length > ELASTIC * limit:
        outward = (v[0] * s[0] + v[1] * s[1] + v[2] * s[2]) / length
        x = min(1.0, (length / limit - ELASTIC) / (1.0 - ELASTIC)) if limit > 0.0 else 1.0
        lost = x * x * (3.0 - 2.0 * x) * max(0.0, outward) / length
    return (
        v[0] - lost * s[0] + (w[1] * s[2] - w[2] * s[1]),
        v[1] - lost * s[1] + (w[2] * s[0] - w[0] * s[2]),
        v[2] - lost * s[2] + (w[0] * s[1] - w[1] * s[0]))
