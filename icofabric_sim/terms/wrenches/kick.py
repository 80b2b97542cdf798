# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Effect of wrenches on velocities and slopes."""

from icofabric_sim.kernels.runtime.compiled import inlined
from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.terms.loads import is_wrench, kick_by, Loads, note_power
from icofabric_sim.terms.profiles import factor_of, Varying
from icofabric_sim.terms.shared import State, Supports
from icofabric_sim.terms.wrenches.force import wrench_of
import numpy as np


@inlined
def kick_row(
    drives: Record | None, anchors: Record | None, tractions: Record | None,
    varying: Varying | None, supports: Supports | None, inverse_mass: float,
    inverse_inertia: float, loads: Loads, state: State, m: int, s: int, time: float,
    h: float, known: int, factor: float
) -> tuple[int, float]:
    """
    Add h F / M and h N / Lambda of row `m` to velocities of a block, times its profile's factor.

    The force acts at its point, the torque adds to the moment of the force. Return the number of
    the wrench and the `factor` of its profile at `time` [s].
    """
    if is_wrench(drives, anchors, tractions, loads.wrench[m]):
        if loads.wrench[m] != known:
            known = np.int64(loads.wrench[m])  # type: ignore[assignment]
            factor = factor_of(varying, known, time)
        force, torque = wrench_of(loads, state.orientation, loads.wrench[m], s)
        kick_by(
            supports, inverse_mass, inverse_inertia, loads, state.linear_velocity,
            state.angular_velocity, m, s, h * factor, force, torque)
    return known, factor


kick_row_again = kick_row


@inlined
def add_row_slope(
    drives: Record | None, anchors: Record | None, tractions: Record | None,
    varying: Varying | None, supports: Supports | None, inverse_mass: float,
    inverse_inertia: float, loads: Loads, state: State, linear: np.ndarray,
    angular: np.ndarray, m: int, s: int, time: float, index: int, known: int, factor: float
) -> tuple[int, float]:
    """Add the accelerations of row `m` to slopes, and store its power [W]."""
    if is_wrench(drives, anchors, tractions, loads.wrench[m]):
        if loads.wrench[m] != known:
            known = np.int64(loads.wrench[m])  # type: ignore[assignment]
            factor = factor_of(varying, known, time)
        force, torque = wrench_of(loads, state.orientation, loads.wrench[m], s)
        kick_by(
            supports, inverse_mass, inverse_inertia, loads, linear, angular, m, s, factor, force,
            torque)
        note_power(loads, state, m, s, factor, index, force, torque)
    return known, factor
