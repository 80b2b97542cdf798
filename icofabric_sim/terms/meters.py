# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Energies that flow into or out of the bodies, integrated from their powers at Runge-Kutta stages.
"""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import fma, LANES, load, splat, store, Vector
from icofabric_sim.kernels.runtime.record import Record
import numpy as np


class Meter(Record):
    """Energy that flows at the bodies, integrated with the weights of a Runge-Kutta method."""

    power: np.ndarray  # (16, s) [W] at the stages
    done: np.ndarray  # (2, s) [J] so far, and at the start of the step in progress

    @classmethod
    def absent(cls) -> 'Meter':
        """Return the record that stands for None."""
        return cls(np.zeros((16, 0)), np.zeros((2, 0)))


@compiled
def note_flow(meter: Meter | None, index: int, s: int, power: Vector) -> None:
    """Store the power [W] of a block at a stage."""
    if meter is None:
        return
    store(meter.power, index, s, power)


@compiled
def add_power(meter: Meter | None, index: int, s: int, power: Vector) -> None:
    """Add a power [W] of a block to that of a stage."""
    if meter is None:
        return
    store(meter.power, index, s, load(meter.power, index, s) + power)


@compiled
def add_flow(
    meter: Meter | None, slot: np.ndarray, h: float, weights: np.ndarray, first: int, last: int
) -> None:
    """
    Add the energy [J] of a step, the weighted sum of its powers, for blocks first to last.

    The energy at the start of the step is stored too.
    """
    if meter is None:
        return
    step = splat(h)
    for block in range(first, last):
        s = slot[block]
        total, before = splat(0.0), load(meter.done, 0, s)
        for j in range(weights.shape[0]):
            total = fma(splat(weights[j]), load(meter.power, j, s), total)
        store(meter.done, 1, s, before)
        store(meter.done, 0, s, fma(step, total, before))


@compiled
def repeat_flow(meter: Meter | None, slot: np.ndarray, first: int, last: int) -> None:
    """Copy the powers at the end of a step to the start of the next."""
    if meter is None:
        return
    for block in range(first, last):
        s = slot[block]
        store(meter.power, 0, s, load(meter.power, 12, s))


@compiled
def flowed_in(meter: Meter | None, slot: np.ndarray, first: int, last: int) -> float:
    """Return the energy so far [J] at the bodies of blocks first to last."""
    total = 0.0
    if meter is None:
        return total
    for block in range(first, last):
        for s in range(slot[block], slot[block] + LANES):
            total += meter.done[0, s]
    return total


@compiled
def flowed(meter: Meter | None) -> float:
    """Return the energy so far [J] of all bodies."""
    total = 0.0
    if meter is None:
        return total
    for s in range(meter.done.shape[1]):
        total += meter.done[0, s]
    return total
