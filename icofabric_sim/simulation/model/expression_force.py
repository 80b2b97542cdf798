# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Loads of a scene by expressions of place and time, F(r, t) of eqs 15, 40 and 47, as a body force.

The body force is one compiled function that adds up all these loads for one body. Each has a
profile, whose present segment is a row: s(t) = value + slope (t - start) + height sin(rate (t -
start)). Its numbers are start, value, slope, height, rate, and the start of the motion, from which
expressions count the time.
"""

from collections.abc import Callable
from functools import lru_cache, reduce
import math
import pickle
from typing import Any

from icofabric_sim.scene.expression_loads import PointLoad, SurfaceLoad
from icofabric_sim.scene.expressions import Expression, SCALAR_FUNCTIONS
from icofabric_sim.scene.profiles import STEADY_PROFILE
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.model.body_force import BodyForce, SummedForce
import numba
import numpy as np

# Returns force [N] and torque about the centre [N m] for time, position, orientation and body.
Wrench = Callable[..., Any]
# Division by zero gives a number that is not finite, and the message then names the load.
_compiled: Any = numba.njit(error_model='numpy')
_NO_WRENCH = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def with_expressions(scene: Scene, body_force: BodyForce | None) -> BodyForce | None:
    """Return the body force of a caller with the loads by expressions of a scene."""
    if not scene.expression_loads:
        return body_force
    own = _force_of(pickle.dumps((
        scene.body_count,
        [load._replace(profile=STEADY_PROFILE) for load in scene.expression_loads])))
    return own if body_force is None else SummedForce(body_force, own)


@lru_cache(maxsize=8)
def _force_of(pickled: bytes) -> BodyForce:
    """Return the body force of pickled loads; scenes with equal loads share compiled code."""
    count, loads = pickle.loads(pickled)
    total = reduce(_sum, [
        _scaled(number, _point_wrench(load, count) if isinstance(load, PointLoad) else (
            _surface_wrench(load, count))) for number, load in enumerate(loads)])

    def force(  # type: ignore[no-untyped-def]
        time, position, orientation, linear_velocity, angular_velocity, body, profiles
    ):
        fx, fy, fz, tx, ty, tz = total(time, position, orientation, body, profiles)
        return (fx, fy, fz), (tx, ty, tz)

    names = dict.fromkeys(load.expression.name for load in loads)
    own = BodyForce(_compiled(force), compiled=True)
    own.label, own.profile_count = ' and '.join(names), len(loads)
    own.compile()
    return own


def _function(expression: Expression) -> Any:
    return _compiled(expression.function({
        name: _compiled(function) if name in ('min', 'max', 'where') else function
        for name, function in SCALAR_FUNCTIONS.items()}))


@_compiled
def _turned(q: np.ndarray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return world components of a vector in body axes, of the quaternion x y z w."""
    tx = 2.0 * (q[1] * z - q[2] * y)
    ty = 2.0 * (q[2] * x - q[0] * z)
    tz = 2.0 * (q[0] * y - q[1] * x)
    return (
        x + q[3] * tx + q[1] * tz - q[2] * ty, y + q[3] * ty + q[2] * tx - q[0] * tz,
        z + q[3] * tz + q[0] * ty - q[1] * tx)


def _sum(one: Wrench, other: Wrench) -> Wrench:
    def both(time, position, orientation, body, profiles):  # type: ignore[no-untyped-def]
        a = one(time, position, orientation, body, profiles)
        b = other(time, position, orientation, body, profiles)
        return a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3], a[4] + b[4], a[5] + b[5]

    summed: Wrench = _compiled(both)
    return summed


def _scaled(number: int, wrench: Wrench) -> Wrench:
    """Return a wrench times its profile; not evaluated while that is zero."""
    def scaled(time, position, orientation, body, profiles):  # type: ignore[no-untyped-def]
        row = profiles[number]
        after = time - row[0]
        s = row[1] + row[2] * after + row[3] * math.sin(row[4] * after)
        if row[1] == 0.0 and row[2] == 0.0 and row[3] == 0.0:
            return _NO_WRENCH
        a = wrench(time - row[5], position, orientation, body)
        return s * a[0], s * a[1], s * a[2], s * a[3], s * a[4], s * a[5]

    compiled: Wrench = _compiled(scaled)
    return compiled


def _point_wrench(load: PointLoad, count: int) -> Wrench:
    """Return the wrench of a force at a point, about the centre, world frame."""
    function, message = _function(load.expression), f'{load.expression.name} is not finite'
    acts = np.zeros(count, bool)
    acts[load.bodies] = True
    px, py, pz = load.point.tolist()
    factor, in_body_axes = load.factor, load.in_body_axes

    def wrench(time, position, orientation, body):  # type: ignore[no-untyped-def]
        if not acts[body]:
            return _NO_WRENCH
        x, y, z = _turned(orientation, px, py, pz)
        fx, fy, fz = function(
            position[0] + x, position[1] + y, position[2] + z, time, 0.0, 0.0, 0.0)
        fx, fy, fz = factor * fx, factor * fy, factor * fz
        if not math.isfinite(fx + fy + fz):
            raise ValueError(message)
        if in_body_axes:
            fx, fy, fz = _turned(orientation, fx, fy, fz)
        return fx, fy, fz, y * fz - z * fy, z * fx - x * fz, x * fy - y * fx

    compiled: Wrench = _compiled(wrench)
    return compiled


def _surface_wrench(load: SurfaceLoad, count: int) -> Wrench:
    """Return the wrench of forces over faces or edges, about the centre, world frame."""
    function, message = _function(load.expression), f'{load.expression.name} is not finite'
    used = np.flatnonzero(load.mask.any(axis=0))
    # Row of each body in the mask, or -1.
    row = np.full(count, -1)
    row[load.bodies] = np.arange(len(load.bodies))
    mask, points, directions = load.mask[:, used], load.points[used], load.directions[used]
    weights, coordinates = load.weights, load.coordinates
    follower, sliding = load.woven is None, load.normals is not None
    woven = np.zeros((1, 4)) if load.woven is None else load.woven
    normals = np.zeros((1, 3)) if load.normals is None else load.normals[used]
    component_count = directions.shape[1]

    def wrench(time, position, orientation, body):  # type: ignore[no-untyped-def]
        if row[body] < 0:
            return _NO_WRENCH
        fx = fy = fz = tx = ty = tz = 0.0
        for j in range(len(points)):
            if not mask[row[body], j]:
                continue
            for k in range(len(weights)):
                x, y, z = _turned(orientation, points[j, k, 0], points[j, k, 1], points[j, k, 2])
                factors = function(
                    position[0] + x, position[1] + y, position[2] + z, time,
                    coordinates[k, 0], coordinates[k, 1], coordinates[k, 0])
                gx = gy = gz = 0.0
                for c in range(component_count):
                    factor = weights[k] * factors[c]
                    gx += factor * directions[j, c, 0]
                    gy += factor * directions[j, c, 1]
                    gz += factor * directions[j, c, 2]
                if follower:
                    gx, gy, gz = _turned(orientation, gx, gy, gz)
                else:
                    gx, gy, gz = _turned(woven[row[body]], gx, gy, gz)
                if sliding:
                    nx, ny, nz = _turned(orientation, normals[j, 0], normals[j, 1], normals[j, 2])
                    along = gx * nx + gy * ny + gz * nz
                    gx, gy, gz = along * nx, along * ny, along * nz
                fx, fy, fz = fx + gx, fy + gy, fz + gz
                tx += y * gz - z * gy
                ty += z * gx - x * gz
                tz += x * gy - y * gx
        if not math.isfinite(fx + fy + fz):
            raise ValueError(message)
        return fx, fy, fz, tx, ty, tz

    compiled: Wrench = _compiled(wrench)
    return compiled
