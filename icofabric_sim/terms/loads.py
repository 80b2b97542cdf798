# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of wrenches, drives and anchors: their record, and functions that several of them use."""

from typing import Any, TYPE_CHECKING

from icofabric_sim.kernels.rotations import Three
from icofabric_sim.kernels.runtime.compiled import compiled, inlined
from icofabric_sim.kernels.runtime.lanes import (
    bits,
    fma,
    LANES,
    load,
    load_at,
    splat,
    store,
    store_at,
    Vector,
    where,
)
from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.terms.profiles import Varying
from icofabric_sim.terms.registry import LOADS
from icofabric_sim.terms.shared import inverses, State, Supports
import numpy as np


class Loads(Record, parts={
        load.name: load.record for load in LOADS if load.has('record')}):
    """
    Wrenches, each on any number of bodies: a row for every block with such bodies, or no rows.

    The record of each load of the registry is a field, too.
    """

    start: np.ndarray  # (b + 1,) int32: rows start[b] to start[b + 1] act on block b
    wrench: np.ndarray  # (m,) int32, which of the w wrenches; -1 - p: bodies are on path p,
    # or, from the number of paths on, at an anchor
    lanes: np.ndarray  # (m,) uint8, bit l: the wrench acts on lane l
    turning: np.ndarray  # (w,) uint8, all bits: force and torque turn with the bodies, or none
    force: np.ndarray  # (w, 3) [N]
    torque: np.ndarray  # (w, 3) [N m]
    point: np.ndarray  # (w, 3) [m], body axes, from the centre
    work: np.ndarray  # (m LANES,) [J] done so far, written by the drift
    earlier_work: np.ndarray  # (m LANES,) [J] at the start of the step in progress
    # (16, m LANES) [W] at the stages of a Runge-Kutta step; no rows for other methods
    power: np.ndarray
    varying: Varying | None

    if TYPE_CHECKING:
        def __getattr__(self, name: str) -> Any: ...


@compiled
def is_wrench(
    drives: Record | None, anchors: Record | None, tractions: Any, number: int
) -> bool:
    """Check that a row of the loads is a wrench on a point, no drive, anchor or surface force."""
    if tractions is None:
        return is_force(drives, anchors, number)
    else:
        return is_force(drives, anchors, number) and number < tractions.first


@compiled
def is_force(drives: Record | None, anchors: Record | None, number: int) -> bool:
    """Check that a row of the loads is no drive, the first of which is number -1, or anchor."""
    if drives is None and anchors is None:
        return True
    return number >= 0


@inlined
def kick_by(
    supports: Supports | None, inverse_mass: float, inverse_inertia: float, loads: Loads,
    velocity: np.ndarray, spin: np.ndarray, m: int, s: int, h: float, force: Three, torque: Three
) -> None:
    """Add the velocity changes of a force [N] and a torque [N m] of row `m` over `h` [s]."""
    mx, my, mz, inertia = inverses(supports, inverse_mass, inverse_inertia, s)
    step = where(bits(loads.lanes[m]), splat(h), splat(0.0))
    inertia = step * inertia
    store(velocity, 0, s, fma(step * mx, force[0], load(velocity, 0, s)))
    store(velocity, 1, s, fma(step * my, force[1], load(velocity, 1, s)))
    store(velocity, 2, s, fma(step * mz, force[2], load(velocity, 2, s)))
    store(spin, 0, s, fma(inertia, torque[0], load(spin, 0, s)))
    store(spin, 1, s, fma(inertia, torque[1], load(spin, 1, s)))
    store(spin, 2, s, fma(inertia, torque[2], load(spin, 2, s)))


@compiled
def note_power(
    loads: Loads, state: State, m: int, s: int, factor: float, index: int, force: Three,
    torque: Three
) -> None:
    """Store the power [W] of a wrench of row `m` on a block, times the `factor` of its profile."""
    velocity, spin = state.linear_velocity, state.angular_velocity
    power = fma(force[0], load(velocity, 0, s), fma(
        force[1], load(velocity, 1, s), force[2] * load(velocity, 2, s)))
    power = fma(torque[0], load(spin, 0, s), fma(
        torque[1], load(spin, 1, s), fma(torque[2], load(spin, 2, s), power)))
    power = splat(factor) * power
    store(loads.power, index, LANES * m, where(bits(loads.lanes[m]), power, splat(0.0)))


@compiled
def add_row_work(loads: Loads, m: int, h: float, power: Vector) -> None:
    """Add the work [J] of a mean power [W] over `h` [s] to that of the bodies of row `m`."""
    done = load_at(loads.work, LANES * m)
    more = fma(splat(h), power, done)
    store_at(loads.work, LANES * m, where(bits(loads.lanes[m]), more, done))
