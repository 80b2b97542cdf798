# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
An embedded Runge-Kutta pair whose steps all ranks take: code of the first rank.

What the step control asks of the bodies (pair_control.py) are orders to the ranks.
"""

from functools import partial
from typing import Any

from icofabric_sim.kernels.breakage import is_breaking, note_lengths
from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.integrators.bodies import LEFT_REGION
from icofabric_sim.kernels.integrators.tableau import Pair
from icofabric_sim.kernels.records import Model
from icofabric_sim.simulation.devices.near_pairs import team_of_one
from icofabric_sim.simulation.devices.pair_control import DistantBodies, Mean
from icofabric_sim.simulation.devices.pair_steps import (
    ALL,
    END,
    PairArrays,
    PairPart,
)
from icofabric_sim.simulation.devices.shared_contacts import note_look
from icofabric_sim.simulation.devices.sharing import Sharing
from icofabric_sim.simulation.devices.transport import Transport
from icofabric_sim.simulation.devices.window import exchange_of, pair_bytes_of
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.terms.contacts.displacement import LATE
from icofabric_sim.terms.contacts.record import Contacts
import numpy as np

_NO_BLOCKS = np.zeros(0, np.int64)


class SharedPair(Sharing, DistantBodies):
    """
    Steps of an embedded pair that all ranks of a transport take; created on the first rank.
    """

    _stores_powers, _arrays_of = True, PairArrays

    def __init__(self, transport: Transport, packed: PackedScene, pair: Pair) -> None:
        """Divide the fabric; raise ValueError if ranks are too many or lack memory."""
        contact = packed.contact
        Sharing.__init__(self, transport, packed, partial(
            pair_bytes_of, touching=contact is not None,
            spends=contact is not None and contact.spends))
        DistantBodies.__init__(self, pair)
        self._present = np.zeros(0)  # the connectors that ranks know, as Links.present
        self._has_stepped = False  # whether steps were taken since ranks got the state

    def enter(self) -> None:
        """Send fabric, candidate pairs, loads and state to all ranks, as far as changed."""
        links = self._call.model.links
        if links is not None and self._call.work.breakage is not None and not np.array_equal(
                links.present, self._present):
            # Connectors have broken, or a run begins in which they are whole.
            self._own, self._present = None, links.present.copy()
        super().enter()

    def leave(self) -> None:
        """Gather the state of a trial."""
        if not self._call.of_run:
            self._gather(self._now, self._call.model.contacts, of_run=False, whole=False)

    def _send_windows(self, model: Model, arrays: PairArrays) -> PairPart:
        own = PairPart(
            self.transport, model, exchange_of(self.packed.layout, self.parts[0], _NO_BLOCKS),
            self._pair)
        own.make_ready(arrays)
        self._cut_windows(model, arrays, self._pair)
        return own

    def _order(self, what: str, *words: Any) -> np.ndarray | None:
        """Let all ranks execute a part of a step; return the result of this rank."""
        contacts = self._call.model.contacts
        found: np.ndarray | None = self._do(what, *words, of_run=self._call.of_run)
        if contacts is not None:
            contacts.tests[0] += self._own.take_touches() * len(contacts.pairs)
        return found

    def _asked(self, what: str, *words: Any) -> np.ndarray:
        """Let all ranks execute a part of a step; return the results of all ranks, (r, n)."""
        own = self._order(what, *words)
        assert own is not None
        found = np.empty((self.transport.size, len(own)))
        found[0] = own
        for rank in self.others:
            self.receive(found[rank], rank)
        return found

    def have_state(self, slopes: range = range(0)) -> None:
        """Gather the state of all ranks, and some slopes."""
        if not self._is_here or slopes:
            self._gather(
                self._now, self._call.model.contacts, of_run=self._call.of_run, whole=False,
                which=(slopes, False))
            self._is_here = True

    # What the control asks.

    def begin(self) -> None:
        """Store lengths of connectors that can break, at the start of a step."""
        model, work = self._call.model, self._call.work
        if work.breakage is not None:
            self.have_state()
            note_lengths(
                model, work.breakage, self._call.state, work, team_of_one(), 0,
                len(model.blocks.slot))

    def may_break(self, h: float) -> bool:
        """Check if a connector may have broken within the step of `h` [s] that has just ended."""
        model, work, state = self._call.model, self._call.work, self._call.state
        if work.breakage is None:
            return False
        self.have_state()
        last = len(model.blocks.slot)
        place_all(model, state, work, 0, last)
        return bool(is_breaking(
            model, work.breakage, state, work, work.trail, team_of_one(), h, 0, last))

    def repeat_slope(self) -> None:
        """Copy the last slope of a step to the first of the next."""
        self._order('repeat_slope')

    def find_slope(self, index: int, of_stage: bool, time: float) -> None:
        """Write slope number `index` at a `time` [s]: of the stage in progress, or the state."""
        self._order('find_slope', of_stage, int(index), float(time))

    def try_step(self, pair: Pair, time: float, h: float, is_judged: bool) -> None:
        """Compute the other slopes of a step from `time` [s], and its end."""
        if is_judged and self._call.of_run and self._call.watch is not None:
            self._call.watch.far[0] = 0.0
        self._order('try_step', float(time), float(h), is_judged)

    def largest_error(
        self, pair: Pair, scales: np.ndarray, smooth: float, h: float
    ) -> tuple[float, float]:
        """Return the error rate of a step, and the probable one."""
        watch = self._call.watch
        found = self._asked('find_errors', scales.copy(), smooth)
        # The maximum of numpy keeps what is no number; none of them is.
        largest, probable, of_paths, touched, far = (
            float(number) for number in found.max(axis=0))
        if touched:
            largest = max(largest, of_paths)
        if self._call.of_run and watch is not None:
            watch.far[0] = max(watch.far[0], far)
            if far > watch.limits[LATE] and largest < LEFT_REGION:
                largest = LEFT_REGION
        return pair.estimate_ratio * largest, pair.probable_ratio * probable

    def accept_step(self, pair: Pair, h: float, keeps_start: bool) -> None:
        """Let the bodies be where the step of `h` [s] ends."""
        self._order('accept_step', float(h), keeps_start)
        # Steps of a given length leave nothing behind of where they began.
        self._is_here, self._has_stepped = False, self._has_stepped or (
            self._call.of_run and keeps_start)

    def _quickest(self, mean: Mean, time: float) -> tuple[float, float]:
        """Return the result of `fastest_points` over all ranks."""
        speed, moved = (float(number) for number in self._asked(
            'find_speeds', mean, time).max(axis=0))
        return speed, moved

    def exchange(self, *, is_guarded: bool, is_searched: bool) -> None:
        """Collect displacements and overlaps from all ranks."""
        contacts = self._call.model.contacts
        if contacts is not None:
            contacts.deepest[0] = 0.0
        for found in self._asked('look'):
            note_look(contacts, self._call.watch, found)

    def _scatter(self, now: PairArrays, contacts: Contacts | None, *, of_run: bool) -> None:
        """Send each rank the state of its bodies; `contacts` are those of the whole fabric."""
        super()._scatter(now, contacts, of_run=of_run)
        self._has_stepped = self._has_stepped and not of_run

    def _which(self, *, whole: bool) -> tuple[Any, ...]:
        """
        Return the arguments of `exchanged` by which ranks send their states.

        Data from before the last step on the ranks are here already.
        """
        with_start = whole and self._has_stepped
        return (ALL if with_start else END), with_start
