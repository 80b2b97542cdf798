# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Effect of anchors on velocities and slopes, and the work of their points."""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import bits, LANES, splat, store, Vector, where
from icofabric_sim.terms.anchors.force import add_damping, anchor_of, power_of, pull_of
from icofabric_sim.terms.anchors.record import Anchors
from icofabric_sim.terms.loads import add_row_work, kick_by, Loads
from icofabric_sim.terms.meters import add_power, Meter
from icofabric_sim.terms.shared import State, Supports
import numpy as np


@compiled
def kick_row(
    anchors: Anchors | None, supports: Supports | None, inverse_mass: float,
    inverse_inertia: float, loads: Loads, state: State, m: int, s: int, time: float, h: float
) -> None:
    """
    Kick the bodies of row `m` over `h` if the row is an anchor; add the work of its point.

    The work is h F . dA/dt at the time of the kick, as for a driven body (terms/drives).
    """
    if anchors is None:
        return
    else:
        a = anchor_of(anchors, loads.wrench[m])
        if a < 0:
            return
        pull = pull_of(anchors, state, a, s, time)
        kick_by(
            supports, inverse_mass, inverse_inertia, loads, state.linear_velocity,
            state.angular_velocity, m, s, h, pull[:3], pull[3:])
        add_row_work(loads, m, h, power_of(anchors, pull, a, time))


kick_row_again = kick_row


@compiled
def add_row_slope(
    anchors: Anchors | None, supports: Supports | None, inverse_mass: float,
    inverse_inertia: float, loads: Loads, state: State, linear: np.ndarray, angular: np.ndarray,
    m: int, s: int, time: float, index: int, meter: Meter | None
) -> None:
    """
    Add the accelerations and power of row `m` to slopes if the row is an anchor.

    The power that its damping dissipates is added to `meter`.
    """
    if anchors is None:
        return
    else:
        a = anchor_of(anchors, loads.wrench[m])
        if a < 0:
            return
        pull, lost = add_damping(
            anchors.damping, anchors, state, a, s, time, pull_of(anchors, state, a, s, time))
        kick_by(
            supports, inverse_mass, inverse_inertia, loads, linear, angular, m, s, 1.0, pull[:3],
            pull[3:])
        add_row_loss(anchors.damping, loads, meter, index, m, s, lost)
        store(loads.power, index, LANES * m, where(
            bits(loads.lanes[m]), power_of(anchors, pull, a, time), splat(0.0)))


@compiled
def add_row_loss(
    damping: np.ndarray | None, loads: Loads, meter: Meter | None, index: int, m: int, s: int,
    lost: Vector
) -> None:
    """Add the dissipated power [W] of row `m` to the meter, if anchors are damped."""
    if damping is None:
        return
    else:
        add_power(meter, index, s, where(bits(loads.lanes[m]), lost, splat(0.0)))
