# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Dissipation of a contact: damping along the depth, and Coulomb friction that sticks.

Both laws use the results of `touch_pair` for a pair A and B, or of `touch_plane`; a plane B does
not turn and its arm is 0. Velocities and arms are in the world frame, arms from the bodies'
centres to the contact point. Both act with opposite forces at one point, or along the gradient of
delta, so the pair's momentum and angular momentum are conserved.

Damping multiplies the normal force by 1 + c d(delta)/dt, and never pulls (K. H. Hunt and F. R. E.
Crossley, J. Appl. Mech. 42, 440, 1975). It takes the power c K delta (d(delta)/dt)^2 >= 0, and
its force begins with 0 at first touch as the normal force does. Slow motion on a light contact
hardly dissipates by this law alone, and may last for ever if a load does work. If c d(delta)/dt is
below a thousandth, a dashpot behind a slider takes over that yields at a thousandth of the normal
force (`effective_damping`).

Friction is a slider behind a spring of stiffness k and a parallel dashpot k tau (P. A. Cundall
and O. D. L. Strack, Geotechnique 29, 47, 1979, with the dashpot). With the slip v along the
surface and the stretch s of the spring

    force = k q,   q = s + tau v, limited to length mu N / k,   ds/dt = (q - s) / tau

While q is shorter the bodies stick: ds/dt = v, they do not creep, and oscillations decay. At the
limit they slide, and s follows q with the rate 1 / tau, at any speed. The dissipated power, the
power taken less the gain of the spring, k q . v - k s . ds/dt = k q . (v - ds/dt) + k tau
(ds/dt)^2, is never negative: v - ds/dt has the direction of q. A fourth number is the rotation
about the normal, times the radius of the contact patch. A face therefore resists spinning, and the
four share one limit. The stretch is part of the state of a pair.
"""

import math
from typing import Any

from icofabric_sim.kernels.runtime.compiled import compiled
import numpy as np

Three = tuple[float, float, float]
Four = tuple[float, float, float, float]
# Lever arm, in radii, of the spinning friction of a disc under uniform pressure.
_SPUN = 2.0 / 3.0
# Fraction of the normal force at which the slider yields that damps slow motion; and the time
# constant [s] of the dashpot behind it over the lag of friction: small, so that the force changes
# smoothly when delta stops growing.
SLIDER_RATIO = 1e-3
_DASHPOT_RATIO = 0.02
# Squared rate [m^2/s^2] below which a contact is at rest; above it no power overflows.
_SMALLEST_SQUARE_RATE = 1e-100


@compiled
def depth_rate(out: np.ndarray, va: Any, wa: Any, vb: Any, wb: Any) -> float:
    """
    Return the rate of delta [m/s] from velocities and spins (3,) of both bodies; 0 if apart.

    The force for K = 1 is -delta grad delta, so its power is -delta d(delta)/dt.
    """
    if not out[10] > 0.0:
        return 0.0
    power = (
        out[0] * (va[0] - vb[0]) + out[1] * (va[1] - vb[1]) + out[2] * (va[2] - vb[2])
        + out[3] * wa[0] + out[4] * wa[1] + out[5] * wa[2]
        + out[6] * wb[0] + out[7] * wb[1] + out[8] * wb[2])
    return -power / out[10]


@compiled
def effective_damping(damping: float, rate: float, depth: float, lag: float) -> float:
    """
    Return the damping [s/m] at a depth delta [m] and its rate [m/s]; 0 if `damping` c is 0.

    (c^4 + s^4)^(1/4) with s = r / sqrt(rate^2 + (r delta / T)^2), r = SLIDER_RATIO and
    T = _DASHPOT_RATIO tau for the `lag` tau [s]: close to c if c rate is above a few r.
    """
    if not damping > 0.0:
        return 0.0
    yield_rate = SLIDER_RATIO / _DASHPOT_RATIO * depth / lag
    square_rate = rate * rate + yield_rate * yield_rate
    if not square_rate > _SMALLEST_SQUARE_RATE:
        return damping
    square = SLIDER_RATIO**2 / square_rate
    return math.sqrt(math.sqrt(damping**4 + square * square))


@compiled
def damping_factor(damping: float, rate: float) -> float:
    """Return the factor of the normal force, for a damping [s/m] and the rate of delta [m/s]."""
    return max(0.0, 1.0 + damping * rate)


@compiled
def slip(
    out: np.ndarray, va: Any, wa: Any, arm_a: Any, vb: Any, wb: Any, arm_b: Any
) -> tuple[Three, Three]:
    """
    Return the unit normal of the contact, from A to B, and B's velocity over A along it [m/s].

    The normal is the direction of the force on B; without a force there is no slip.
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
    """Return the component of a vector perpendicular to a unit normal."""
    across = v[0] * n[0] + v[1] * n[1] + v[2] * n[2]
    return v[0] - across * n[0], v[1] - across * n[1], v[2] - across * n[2]


@compiled
def patch_radius(out: np.ndarray) -> float:
    """
    Return the lever arm [m] of friction against a rotation about the normal.

    out[18] is the squared contact area [m^4].
    """
    return _SPUN * math.sqrt(math.sqrt(out[18]) / math.pi)


@compiled
def within(stretch: Four, limit: float) -> Four:
    """Return a stretch [m], shortened to a limit."""
    x, y, z, u = stretch
    length = math.sqrt(x * x + y * y + z * z + u * u)
    if not length > limit:
        return stretch
    factor = limit / length
    return factor * x, factor * y, factor * z, factor * u


@compiled
def pull(stretch: Four, slip: Four, lag: float, n: Three, limit: float) -> Four:
    """Return the acting stretch q [m], for a `lag` tau [s]: the force on A is k q."""
    x, y, z = along((stretch[0], stretch[1], stretch[2]), n)
    return within((
        x + lag * slip[0], y + lag * slip[1], z + lag * slip[2],
        stretch[3] + lag * slip[3]), limit)


@compiled
def stretch_rate(stretch: Four, q: Four, lag: float, spin: Three) -> Four:
    """
    Return the rate of a stretch [m/s], if q acts and the pair turns with an angular velocity.
    """
    s, w, rate = stretch, spin, 1.0 / lag
    return (
        rate * (q[0] - s[0]) + (w[1] * s[2] - w[2] * s[1]),
        rate * (q[1] - s[1]) + (w[2] * s[0] - w[0] * s[2]),
        rate * (q[2] - s[2]) + (w[0] * s[1] - w[1] * s[0]),
        rate * (q[3] - s[3]))
