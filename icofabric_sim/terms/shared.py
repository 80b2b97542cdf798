# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Records and compiled functions that several terms use."""

from typing import Any

from icofabric_sim.kernels.rotations import axes_of_lanes, Nine, on_axes
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import bits, fma, load, splat, store, Vector, where
from icofabric_sim.kernels.runtime.record import Record
import numpy as np

# Lower bound of squared lengths [m^2]: shorter vectors have no direction.
SMALLEST_SQUARE = 1e-300

EDGE_COUNT = 6
# Connectors that meet at each edge of a weave.
LINKS_PER_EDGE = 2
LINK_COUNT = EDGE_COUNT * LINKS_PER_EDGE

# Force [N] and torque [N m], or accelerations, of a block.
Six = tuple[Vector, Vector, Vector, Vector, Vector, Vector]


class Blocks(Record):
    """Runs of LANES slots that are computed together, in the order of computation."""

    slot: np.ndarray  # (b,) int32, first slot
    alive: np.ndarray  # (b,) uint8, bit l: lane l holds a body
    reach: int  # connectors lead to blocks at most this much earlier or later


class Supports(Record):
    """Inverse masses of all bodies, with held freedoms set to zero."""

    inverse_mass: np.ndarray  # (3, s) [1/kg], world axes
    inverse_inertia: np.ndarray  # (1, s) [1/(kg m^2)]

    @classmethod
    def absent(cls) -> 'Supports':
        """Return the record that stands for None."""
        return cls(np.zeros((3, 0)), np.zeros((1, 0)))


class Variety(Record):
    """Laws of the connectors at each body, if they are not one symmetric law; (12, s) each."""

    extension: np.ndarray  # k_e [N/m]
    compression: np.ndarray  # k_c [N/m]
    natural_length: np.ndarray  # D [m]


class Links(Record):
    """
    Connectors seen from each body: two at each of its six edges.

    The neighbours of a block's lanes are adjacent too, so one index serves all lanes.
    """

    place: np.ndarray  # (b, 12) int32, where the x of lane 0's partner is in the flat points
    present: np.ndarray  # (b, 12) uint8, bit l: lane l has this connector
    stiffness: float  # k [N/m]; of many laws the largest
    natural_length: float  # D [m]; of many laws the longest
    half_width: float  # centre to the farthest attachment point, w / 2 for edge midpoints [m]
    attachment: np.ndarray | None  # (6, 3) the points in body axes [m]; None: on the axes
    # Individual springs, k and D of other laws; of tables the largest slopes.
    variety: Variety | None
    laws: Any  # `Laws` of terms/laws.py; None: all are springs


class Connectors(Record):
    """
    Springs between edge midpoints, one by one; the arrays have shape (c,), or (1,) for all alike.
    """

    first: np.ndarray  # int32, the lower body
    second: np.ndarray  # int32
    first_edge: np.ndarray  # int8 edge codes 0-5
    second_edge: np.ndarray
    extension: np.ndarray  # k_e [N/m]
    compression: np.ndarray  # k_c [N/m]
    natural_length: np.ndarray  # D [m]
    half_width: float  # centre to attachment point, w / 2 for edge midpoints [m]
    attachment: np.ndarray | None  # (6, 3) the points in body axes [m]; None: on the axes


class State(Record):
    """Evolving state, world frame, written by kernels."""

    position: np.ndarray  # (3, s) [m]
    orientation: np.ndarray  # (4, s) x y z w, or (3, 3, s) direction cosines
    linear_velocity: np.ndarray  # (3, s) [m/s]
    angular_velocity: np.ndarray  # (3, s) [rad/s]
    # (12, s) [m] rest lengths of the springs of Maxwell arms; None without arms.
    rest: np.ndarray | None = None

    def rows(self) -> list[Any]:
        """Return the arrays that are not None, in the order of the fields."""
        return [array for array in self if array is not None]


class Trail(Record):
    """Slopes and states of the last Runge-Kutta step."""

    slopes: np.ndarray  # (16, r, s), see kernels/rhs.py
    stage: State  # the stage in progress, then the end of the step
    start: State
    errors: np.ndarray  # one for each thread
    probable: np.ndarray  # probable errors of steps, likewise
    speeds: np.ndarray  # [m/s] of the fastest point, likewise
    ways: np.ndarray  # squares of the largest displacements [m^2] before the step, likewise


@compiled
def inverses(
    supports: Supports | None, inverse_mass: float, inverse_inertia: float, s: int
) -> tuple[Vector, Vector, Vector, Vector]:
    """Return inverse masses along x, y, z [1/kg] and inverse inertias [1/(kg m^2)] of a block."""
    if supports is None:
        mass = splat(inverse_mass)
        return mass, mass, mass, splat(inverse_inertia)
    else:
        return (
            load(supports.inverse_mass, 0, s), load(supports.inverse_mass, 1, s),
            load(supports.inverse_mass, 2, s), load(supports.inverse_inertia, 0, s))


@compiled
def add_wrench(
    supports: Supports | None, inverse_mass: float, inverse_inertia: float, linear: np.ndarray,
    angular: np.ndarray, s: int, fx: Vector, fy: Vector, fz: Vector, tx: Vector, ty: Vector,
    tz: Vector
) -> None:
    """
    Add the accelerations of forces [N] and torques [N m] to slopes; none along held freedoms.
    """
    mx, my, mz, inertia = inverses(supports, inverse_mass, inverse_inertia, s)
    store(linear, 0, s, fma(mx, fx, load(linear, 0, s)))
    store(linear, 1, s, fma(my, fy, load(linear, 1, s)))
    store(linear, 2, s, fma(mz, fz, load(linear, 2, s)))
    store(angular, 0, s, fma(inertia, tx, load(angular, 0, s)))
    store(angular, 1, s, fma(inertia, ty, load(angular, 1, s)))
    store(angular, 2, s, fma(inertia, tz, load(angular, 2, s)))


@compiled
def partner_slot(links: Links, stride: int, block: int, link: int) -> int:
    """
    Return the slot of lane 0's partner; a connector ends at the edge opposite to its first edge.
    """
    slot: int = links.place[block, link] - 3 * ((link >> 1) ^ 1) * stride
    return slot


@compiled
def stiffness_of(
    uniform: float, variety: np.ndarray | None, present: int, link: int, s: int
) -> Vector:
    """Return the stiffness [N m/rad] of a connector against a moment, 0 without a connector."""
    if variety is None:
        return where(bits(present), splat(uniform), splat(0.0))
    else:
        return where(bits(present), load(variety, link, s), splat(0.0))


@compiled
def since_woven(woven: np.ndarray | None, orientation: np.ndarray, s: int) -> Nine:
    """
    Return the rotation of each body since the woven state, by columns, in world components.

    Columns are the body axes, or, if `woven` orientations differ, the turned world axes.
    """
    if woven is None:
        return axes_of_lanes(orientation, s)
    else:
        e = axes_of_lanes(orientation, s)
        a = (load(woven, 0, s), load(woven, 1, s), load(woven, 2, s))
        b = (load(woven, 3, s), load(woven, 4, s), load(woven, 5, s))
        c = (load(woven, 6, s), load(woven, 7, s), load(woven, 8, s))
        x = on_axes(e, a[0], b[0], c[0])
        y = on_axes(e, a[1], b[1], c[1])
        z = on_axes(e, a[2], b[2], c[2])
        return x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2]


@compiled
def coefficient_of(
    own: np.ndarray | None, coefficient: float, link: int, s: int
) -> Vector:
    """Return the coefficient of a connector at each body of a block, individual or common."""
    if own is None:
        return splat(coefficient)
    else:
        return load(own, link, s)
