# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
External body forces: a C function that is called once for each evaluation, for all bodies.

The function gets the time, the number of bodies and two addresses: of (n, 13) doubles, position,
orientation, velocity and spin body by body, and of (n, 6) for its force and torque. It returns 0,
or another number if it failed. After a failure it is not called again and its forces are NaN,
which ends the run.
"""

import ctypes
from typing import Any

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fma, load, Vector
from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.kernels.runtime.team import Team, wait_for_all
from icofabric_sim.terms.shared import add_wrench, State, Supports
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload
import numpy as np

C_FUNCTION: Any = ctypes.CFUNCTYPE(
    ctypes.c_int64, ctypes.c_double, ctypes.c_int64, ctypes.c_void_p, ctypes.c_void_p)


class External(Record):
    """An external function that returns forces on the bodies, see above."""

    address: int  # of the C function
    slots: np.ndarray  # (n,) int32 of the bodies
    numbers: np.ndarray  # (n, 13) argument of the function
    result: np.ndarray  # (n, 6) forces [N] and torques [N m]
    rows: np.ndarray  # (6, s) forces and torques by slots
    status: np.ndarray  # (1,) int64, not 0 once the function has failed
    moment: np.ndarray  # (1,) [s] simulated time of the last call


def call_function(
    address: int, time: float, numbers: np.ndarray, result: np.ndarray
) -> int:
    """Call the function at an address."""
    status = C_FUNCTION(address)(time, len(numbers), numbers.ctypes.data, result.ctypes.data)
    return int(status)


@intrinsic
def _call(typing: Any, address: Any, time: Any, count: Any, numbers: Any, result: Any) -> Any:
    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        whole = ir.IntType(64)
        kind = ir.FunctionType(whole, [ir.DoubleType(), whole, whole, whole])
        return builder.call(builder.inttoptr(args[0], kind.as_pointer()), args[1:])
    return types.int64(types.int64, types.float64, types.int64, types.uintp, types.uintp), generate


emit_call: Any = _call
overload(call_function)(
    lambda address, time, numbers, result: lambda address, time, numbers, result: emit_call(
        address, time, len(numbers), numbers.ctypes.data, result.ctypes.data))


@compiled
def ask_outside(external: External | None, state: State, time: float, team: Team) -> None:
    """
    Write forces and torques of all bodies at `time` [s] and `state` into `external.rows`.

    One thread calls the function; the others wait.
    """
    if external is None:
        return
    if team.member == 0:
        ask_alone(external, state, time)
    wait_for_all(team)


@compiled
def ask_alone(external: External, state: State, time: float) -> None:
    """Write forces and torques of all bodies into `external.rows` by one thread."""
    numbers, result, rows = external.numbers, external.result, external.rows
    count = external.slots.shape[0]
    for b in range(count):
        s = external.slots[b]
        for k in range(3):
            numbers[b, k] = state.position[k, s]
            numbers[b, 7 + k] = state.linear_velocity[k, s]
            numbers[b, 10 + k] = state.angular_velocity[k, s]
        for k in range(4):
            numbers[b, 3 + k] = state.orientation[k, s]
    if external.status[0] == 0:
        external.status[0] = call_function(external.address, time, numbers, result)
        external.moment[0] = time
    failed = external.status[0] != 0
    for b in range(count):
        for k in range(6):
            rows[k, external.slots[b]] = np.nan if failed else result[b, k]


@compiled
def add_external_force(
    external: External | None, supports: Supports | None, inverse_mass: float,
    inverse_inertia: float, state: State, linear: np.ndarray, angular: np.ndarray, s: int,
    given: Vector
) -> Vector:
    """Add the forces of the function to the slopes of a block; return `given` plus their power."""
    if external is None:
        return given
    rows = external.rows
    fx, fy, fz = load(rows, 0, s), load(rows, 1, s), load(rows, 2, s)
    tx, ty, tz = load(rows, 3, s), load(rows, 4, s), load(rows, 5, s)
    add_wrench(
        supports, inverse_mass, inverse_inertia, linear, angular, s, fx, fy, fz, tx, ty, tz)
    v, w = state.linear_velocity, state.angular_velocity
    power = fma(fx, load(v, 0, s), fma(fy, load(v, 1, s), fz * load(v, 2, s)))
    power = fma(tx, load(w, 0, s), fma(ty, load(w, 1, s), fma(tz, load(w, 2, s), power)))
    return given + power
