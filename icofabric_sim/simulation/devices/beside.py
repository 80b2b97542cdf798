# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Trial steps on all ranks beside a run: names, arrays and differences."""

from icofabric_sim.kernels.records import Blocks, State
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.devices.slot_rows import SlotRows
from icofabric_sim.simulation.model.layout import aligned_zeros
from icofabric_sim.terms.meters import Meter
import numpy as np

# Steps of the length that is judged, and those of half of it.
AHEAD, HALF = 'ahead', 'half'


def meter_room(slot_count: int) -> Meter:
    """Return a meter of dissipated energy for splitting steps."""
    return Meter(np.zeros((16, 0)), aligned_zeros((2, slot_count)))


def squares_apart(one: State, other: State, rows: SlotRows) -> np.ndarray:
    """
    Return the largest squared distance [m^2] and squared difference of orientations, (2,).

    The two states are compared at the slots of `rows`.
    """
    with np.errstate(over='ignore', invalid='ignore'):
        return np.array([
            ((rows.of(first) - rows.of(second)) ** 2).sum(axis=0).max()
            for first, second in (
                (one.position, other.position), (one.orientation, other.orientation))])


def bodies_of(blocks: Blocks, first: int, last: int) -> np.ndarray:
    """Return the slots of the bodies in blocks first to last."""
    lanes = np.arange(LANES)
    there = blocks.alive[first:last, None] >> lanes & 1 > 0
    return (blocks.slot[first:last, None] + lanes)[there]


def bounds_of_state(state: State, bodies: np.ndarray) -> np.ndarray:
    """Return largest and minus least velocities [m/s] and the largest coordinate [m], (7,)."""
    velocity, place = state.linear_velocity[:, bodies], state.position[:, bodies]
    return np.concatenate([
        velocity.max(axis=1), (-velocity).max(axis=1), [np.abs(place).max()]])


def fastest_square(state: State, bodies: np.ndarray, velocity: np.ndarray) -> float:
    """Return the largest squared velocity relative to `velocity` (3,) [m^2/s^2]."""
    apart = state.linear_velocity[:, bodies] - velocity[:, None]
    return float((apart**2).sum(axis=0).max(initial=0.0))
