# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Effect of surface forces on velocities and slopes."""

from icofabric_sim.kernels.rotations import axes_of_lanes, Three
from icofabric_sim.kernels.runtime.compiled import inlined
from icofabric_sim.kernels.runtime.lanes import LANES, store_at
from icofabric_sim.terms.loads import kick_by, Loads, note_power
from icofabric_sim.terms.profiles import factor_of, Varying
from icofabric_sim.terms.shared import State, Supports
from icofabric_sim.terms.tractions.record import Tractions
from icofabric_sim.terms.tractions.sums import three_at, traction_wrench
import numpy as np


@inlined
def kick_row(
    tractions: Tractions | None, varying: Varying | None, supports: Supports | None,
    inverse_mass: float, inverse_inertia: float, loads: Loads, state: State, m: int, s: int,
    time: float, h: float, known: int, factor: float
) -> tuple[int, float]:
    """
    Kick the bodies of row `m` over `h` [s], and store the wrench, a sum of many numbers.

    Return the number of the wrench and the `factor` of its profile at `time` [s].
    """
    if tractions is None:
        return known, factor
    else:
        if loads.wrench[m] >= tractions.first:
            if loads.wrench[m] != known:
                known = np.int64(loads.wrench[m])  # type: ignore[assignment]
                factor = factor_of(varying, known, time)
            force, torque = wrench_of_row(tractions, state.orientation, m, s)
            at = 6 * LANES * tractions.place[m]
            for k in range(3):
                store_at(tractions.kept, at + k * LANES, force[k])
                store_at(tractions.kept, at + (k + 3) * LANES, torque[k])
            kick_by(
                supports, inverse_mass, inverse_inertia, loads, state.linear_velocity,
                state.angular_velocity, m, s, h * factor, force, torque)
        return known, factor


@inlined
def kick_row_again(
    tractions: Tractions | None, varying: Varying | None, supports: Supports | None,
    inverse_mass: float, inverse_inertia: float, loads: Loads, state: State, m: int, s: int,
    time: float, h: float, known: int, factor: float
) -> tuple[int, float]:
    """Kick the bodies of row `m` directly after `kick_row`, at the same orientations."""
    if tractions is None:
        return known, factor
    else:
        if loads.wrench[m] >= tractions.first:
            if loads.wrench[m] != known:
                known = np.int64(loads.wrench[m])  # type: ignore[assignment]
                factor = factor_of(varying, known, time)
            at = 6 * LANES * tractions.place[m]
            kick_by(
                supports, inverse_mass, inverse_inertia, loads, state.linear_velocity,
                state.angular_velocity, m, s, h * factor, three_at(tractions.kept, at),
                three_at(tractions.kept, at + 3 * LANES))
        return known, factor


@inlined
def add_row_slope(
    tractions: Tractions | None, varying: Varying | None, supports: Supports | None,
    inverse_mass: float, inverse_inertia: float, loads: Loads, state: State, linear: np.ndarray,
    angular: np.ndarray, m: int, s: int, time: float, index: int, known: int, factor: float
) -> tuple[int, float]:
    """Add the accelerations of row `m` to slopes, and store its power [W]."""
    if tractions is None:
        return known, factor
    else:
        if loads.wrench[m] >= tractions.first:
            if loads.wrench[m] != known:
                known = np.int64(loads.wrench[m])  # type: ignore[assignment]
                factor = factor_of(varying, known, time)
            force, torque = wrench_of_row(tractions, state.orientation, m, s)
            kick_by(
                supports, inverse_mass, inverse_inertia, loads, linear, angular, m, s, factor,
                force, torque)
            note_power(loads, state, m, s, factor, index, force, torque)
        return known, factor


@inlined
def wrench_of_row(
    tractions: Tractions, orientation: np.ndarray, m: int, s: int
) -> tuple[Three, Three]:
    """
    Return force [N] and torque about the centre [N m] of row `m` on a block, world frame.

    The factor of its profile is not included.
    """
    return traction_wrench(
        tractions.turning, tractions.fixed, tractions.sliding, tractions.place[m],
        axes_of_lanes(orientation, s))
