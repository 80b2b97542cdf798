# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Records and compiled functions that several terms use."""

from typing import Any

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fma, load, splat, store, Vector
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
