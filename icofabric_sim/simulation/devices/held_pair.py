# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Data of a fabric on a rank other than the first, for steps of an embedded pair."""

from icofabric_sim.kernels.integrators.tableau import Pair, SLOPE_COUNT
from icofabric_sim.kernels.records import Loads, State, Trail, Work
from icofabric_sim.simulation.devices.held import Held
from icofabric_sim.simulation.devices.pair_steps import PairArrays, PairPart
from icofabric_sim.simulation.devices.transport import Transport
from icofabric_sim.simulation.devices.window import resting, Window
from icofabric_sim.simulation.model.layout import aligned_empty
from icofabric_sim.terms.meters import Meter
import numpy as np


class HeldPair(Held):
    """A window with its states, of the run and of trial steps."""

    def __init__(self, transport: Transport, window: Window, pair: Pair) -> None:
        """Prepare to allocate a state when it is first needed."""
        super().__init__(
            transport, window, PairPart(transport, window.model, window.exchange, pair))
        self._points = aligned_empty(
            (0 if window.model.links is None else 18 * window.slot_count,))
        self._points[:] = 0.0
        # By whether it is the run's.
        self._states: dict[bool, tuple[State, Work]] = {}
        self._acting: dict[bool, Loads] = {}

    def loads(self, loads: Loads) -> None:
        """Use these loads from now on."""
        self._acting = {True: loads, False: loads._replace(
            work=np.zeros_like(loads.work), earlier_work=np.zeros_like(loads.earlier_work),
            power=np.zeros_like(loads.power))}

    def _arrays(self, of_run: bool) -> PairArrays:
        if of_run not in self._states:
            self._states[of_run] = self._room()
        state, work = self._states[of_run]
        return PairArrays(
            self._acting[of_run], state, work, self._contacts.get(of_run),
            self._watch if of_run else None)

    def _room(self) -> tuple[State, Work]:
        window, count = self._window, self._window.slot_count
        has_arms = window.model.maxwell is not None
        state, stage, start = (resting(count, has_arms=has_arms) for _ in range(3))
        slopes = aligned_empty((SLOPE_COUNT, 25 if has_arms else 13, count))
        speeds = aligned_empty((len(self._points) if window.model.damping is not None else 0,))
        slopes[:] = 0.0
        speeds[:] = 0.0
        spent = None
        if window.spends:
            spent = Meter(aligned_empty((SLOPE_COUNT, count)), aligned_empty((2, count)))
            spent.power[:] = spent.done[:] = 0.0
        # The points are placed anew in each evaluation, so both states share them.
        return state, Work(
            self._points, aligned_empty((6, 0)), aligned_empty((7, 0)), np.ones(1),
            window.figures_room(), window.group, speeds, spent, given=None,
            trail=Trail(slopes, stage, start, *np.zeros((4, 1))), breakage=None, external=None)
