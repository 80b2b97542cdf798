# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Health checks of a state on a GPU: the device computes sums, this process evaluates them.

The results are written to the ledger as by `examine` of kernels/monitor.py, and the same functions
evaluate them.
"""

from importlib import import_module
import math
from typing import Any

from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.records import Loads, Model
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.devices.gpu.arrays import StateArrays, terms_of
from icofabric_sim.simulation.devices.gpu.launching import launch
from icofabric_sim.simulation.devices.gpu.monitor import (
    BOUND,
    EXTENT,
    FIGURES,
    figures_kernel,
    fold,
    fold_blocks,
    fold_work,
    HEIGHT,
    KINETIC,
    LINKED,
    obstructed,
    SHARE,
    SPIN,
    SUMMED,
    TENSIONS,
)
from icofabric_sim.simulation.devices.gpu.opening import Device
from icofabric_sim.simulation.stepping.ledger import Ledger
import numpy as np

wp: Any = import_module('warp')

# Most values of a figure that this process sums.
_HOST_SUM_COUNT = 1024


class HealthCheck:
    """Health checks of a run on a device."""

    def __init__(self, model: Model, fabric: Any, device: Device) -> None:
        """Prepare checks of the bodies of `fabric`, which is in device memory."""
        self._model, self._fabric, self._device = model, fabric, device
        self._blocks = len(model.blocks.slot)
        # Arrays of partial sums, from long to short.
        self._folded: list[Any] = []
        count = self._blocks
        while not self._folded or count > _HOST_SUM_COUNT:
            count = -(-count // SHARE)
            self._folded.append(
                wp.zeros(FIGURES * count, dtype=wp.float64, device=device.handle))
        self._work: Any = None

    @staticmethod
    def can_examine(model: Model, loads: Loads, ledger: np.ndarray) -> bool:
        """
        Return True if the device has all values that the next check needs.

        Moments, dipoles and anchors are checked in this process. So are connectors in shells
        unless they are attached at edge midpoints.
        """
        return (
            model.bending is None and model.twisting is None and model.dipole is None
            and model.contacts is None and loads.anchors is None
            and loads.drives is None and len(model.blocks.slot) > 0
            and (model.shells is None or Ledger.over(ledger).until_obstructed > 1.0))

    def examine(
        self, state: StateArrays, now: int, loads: Loads, acting: Any, ledger: np.ndarray,
        spent: Any = None
    ) -> int:
        """
        Return the status bits of the state, as `examine` of kernels/monitor.py.

        `spent` (s,) [J] is the dissipated energy by slots, on the device.
        """
        figures, book = self._figures(state, now), Ledger.over(ledger)
        book.spin = math.sqrt(figures[SPIN])
        rate = math.sqrt(figures[BOUND] + book.contact_rate)
        book.rate = rate + book.spin_weight * book.spin
        book.kinetic = figures[KINETIC]
        book.linked = book.stored = figures[LINKED]
        book.contact = book.deepest = book.touching = 0.0
        book.bent = book.field = book.anchored = 0.0
        book.spent = 0.0 if spent is None else _sum(self._fold(spent, 1)[0])
        book.height, book.tensions = figures[HEIGHT], figures[TENSIONS]
        book.extent = figures[EXTENT]
        work, size = self._worked(loads, acting)
        book.worked = abs(book.earlier_work) + size
        book.work = book.earlier_work + work
        status = int(monitor.balance(ledger))
        if status != monitor.NOT_FINITE:
            status |= int(monitor.judge_balance(ledger, rate))
        if not book.rate <= book.high:
            status |= monitor.RATE_HIGH
        if book.rate < book.low:
            status |= monitor.RATE_LOW
        if book.kinetic > book.lively:
            status |= monitor.KINETIC_HIGH
        book.until_obstructed -= 1.0
        if book.until_obstructed <= 0.0:
            book.until_obstructed = book.obstructed_every
            book.obstructed = self._obstructed(state, now)
            if book.obstructed > book.obstructed_limit:
                status |= monitor.OBSTRUCTING
        return status

    def _obstructed(self, state: StateArrays, now: int) -> float:
        """Return the number of connectors inside shells that they are attached to."""
        if self._model.links is None:
            return 0.0
        room = state.poses[1 - now]
        launch(
            obstructed, dim=LANES * self._blocks,
            inputs=[self._fabric, state.poses[now], room], device=self._device.handle)
        return _sum(self._fold(room, 1)[0])

    def _figures(self, state: StateArrays, now: int) -> list[float]:
        """Return sums and maxima over all bodies."""
        handle, room = self._device.handle, state.poses[1 - now]
        terms = terms_of(self._model, loaded=False)
        kernel = figures_kernel(
            linked=terms.linked, midpoints=terms.midpoints, one_law=terms.one_law,
            own_masses=self._model.masses is not None, laws=terms.laws)
        launch(
            kernel, dim=LANES * self._blocks,
            inputs=[self._fabric, state.poses[now], state.motion, room], device=handle)
        return [
            _sum(row) if figure < SUMMED else float(row.max())
            for figure, row in enumerate(self._fold(room, FIGURES))]

    def _fold(self, room: Any, figures: int) -> np.ndarray:
        """
        Return the first figures of all bodies, (figures, few), for a final sum in this process.
        """
        handle, count = self._device.handle, -(-self._blocks // SHARE)
        launch(
            fold_blocks, dim=figures * count,
            inputs=[self._fabric, self._blocks, count, room, self._folded[0]], device=handle)
        for values, folded in zip(self._folded, self._folded[1:]):
            shares = -(-count // SHARE)
            launch(
                fold, dim=figures * shares, inputs=[count, shares, values, folded], device=handle)
            count = shares
        last: np.ndarray = self._folded[-1].numpy()[:figures * count].reshape(figures, count)
        return last

    def _worked(self, loads: Loads, acting: Any) -> tuple[float, float]:
        """Return the work of the present loads [J], and the sum of its magnitudes."""
        count = len(loads.work)
        if not count:
            return 0.0, 0.0
        shares = -(-count // SHARE)
        if self._work is None or self._work.size != 2 * shares:
            self._work = wp.zeros(2 * shares, dtype=wp.float64, device=self._device.handle)
        launch(
            fold_work, dim=shares, inputs=[count, acting, self._work],
            device=self._device.handle)
        work, size = self._work.numpy().reshape(2, shares)
        return _sum(work), _sum(size)


def _sum(values: np.ndarray) -> float:
    """Return the exactly rounded sum; NaN if any value is not finite."""
    if not np.isfinite(values).all():
        return math.nan
    return math.fsum(values)
