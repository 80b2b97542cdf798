# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
State of a run on a GPU, for all methods.

The run, its driver and all checks are in this process. The state stays on the device. It is copied
to this process when the trajectory needs it, and for health checks of quantities that the device
does not sum (health.py).
"""

from abc import abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from icofabric_sim.kernels.records import Loads, Model, State, Work
from icofabric_sim.simulation.devices.executor import Call, Remote
from icofabric_sim.simulation.devices.gpu.arrays import (
    doubles,
    fabric_of,
    require_room,
    StateArrays,
)
from icofabric_sim.simulation.devices.gpu.health import HealthCheck
from icofabric_sim.simulation.devices.gpu.launching import named_failure, TURN
from icofabric_sim.simulation.devices.gpu.opening import Device
from icofabric_sim.simulation.devices.gpu.records import Clock
from icofabric_sim.simulation.devices.gpu.touching import DeviceContacts
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.terms.contacts.record import Contacts
import numpy as np

wp: Any = import_module('warp')


class DeviceRun(Remote):
    """Executor of a run on a GPU."""

    def __init__(self, device: Device, packed: PackedScene, need: int) -> None:
        """Copy the fabric to the device; raise ValueError if fewer than `need` bytes are free."""
        self._device, self._packed = device, packed
        self.device, self.device_bytes = device.name, need
        require_room(device, packed.layout.body_count, need)
        self._fabric = fabric_of(packed.model, packed.layout, device)
        self._state = StateArrays(packed.layout.slot_count, device)
        self._now = 0  # which of the two poses is the present one
        self._health = HealthCheck(packed.model, self._fabric, device)
        self._is_examined_there = False
        self._spent_sum: Any = None  # dissipated energy (s,) [J], if any
        self._acting: Any = None  # loads
        # Candidate pairs, once displacements are checked.
        self._near: DeviceContacts | None = None
        self._contacts: Contacts | None = None
        self._is_watching = False
        self._clock = Clock()
        self._clock.start = doubles(np.zeros(2), device)
        self._clock.index = wp.zeros(1, dtype=wp.int64, device=device.handle)

    @contextmanager
    def together(self) -> Iterator[None]:
        """Exclude other threads; raise any failure as DeviceError, and discard the state then."""
        with TURN, named_failure(self.device, self._forget):
            yield

    def _forget(self) -> None:
        self._is_out = self._is_stale = False

    @abstractmethod
    def _put(self, model: Model, loads: Loads, state: State, work: Work) -> None:
        """Copy state and loads to the device."""

    @abstractmethod
    def _bring(self, call: Call, *, whole: bool) -> None:
        """Copy state and work of loads to this process; `whole` adds data for the next step."""

    def _gather_run(self) -> None:
        """Gather the state of the run, with all data of the next step."""
        with self.together():
            self._bring(self._run, whole=True)

    def enter(self) -> None:
        """Copy the state of the call to the device, unless the device holds it already."""
        model, loads, state, _, work, watch, _, of_run = self._call
        if not of_run:
            self.gather()
        self._is_here = not (of_run and self._is_out)
        if self._is_here:
            self._put(model, loads, state, work)
        self._contacts = model.contacts
        if watch is not None:
            if self._near is None:
                self._near = DeviceContacts(self._packed.layout, self._fabric, self._device)
            # The state may have been here for a search.
            self._near.put(self._contacts, watch, anew=self._is_here)
        # Displacements in trials are not used.
        self._is_watching = watch is not None and of_run
        if of_run:
            self._run = self._call
            self._is_out = self._is_stale = True

    def have_state(self) -> None:
        """Copy the state at the end of the last step to this process."""
        if not self._is_here:
            self._bring(self._call, whole=False)
            self._is_here = True

    def exchange(self, *, is_guarded: bool, is_searched: bool) -> None:
        """Copy displacements and overlaps, and the impulses of contacts, from the device."""
        near, watch = self._near, self._call.watch
        assert near is not None and watch is not None
        if is_searched:
            near.note_ways(watch)
            near.note_depths(self._contacts)
        if is_guarded and self._contacts is not None:
            near.note_pushes(self._contacts)

    def follow_search(self) -> None:
        """Copy the reference of displacements to the device."""
        assert self._near is not None and self._call.watch is not None
        self._near.put(self._contacts, self._call.watch, anew=False)

    def examine(self, time: float, ledger: np.ndarray) -> int:
        """Return the status of a health check at `time` [s], on the device if it can."""
        model, loads, *_ = self._call
        self._is_examined_there = self._health.can_examine(model, loads, ledger)
        if self._is_examined_there:
            return int(self._health.examine(
                self._state, self._now, loads, self._acting, ledger, self._spent_sum))
        return super().examine(time, ledger)
