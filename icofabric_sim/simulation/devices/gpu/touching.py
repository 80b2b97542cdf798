# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Candidate pairs for contact on a GPU: pairs from searches in this process, and displacements.

Searches, their reach and all tests of contacts stay in this process (simulation/contact/). The
device stores the pairs, evaluates them wherever forces are evaluated, and records displacements of
bodies, as kernels on the processor do.
"""

from importlib import import_module
from typing import Any

from icofabric_sim.geometry.icosahedron import vertices
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.devices.gpu.arrays import doubles, seen
from icofabric_sim.simulation.devices.gpu.contact import (
    add_up,
    fold_pushes,
    fold_ways,
    note_ways,
    one_of_each,
    PUSH_SIZE,
    SHARE,
    touch,
)
from icofabric_sim.simulation.devices.gpu.launching import launch, load
from icofabric_sim.simulation.devices.gpu.opening import Device
from icofabric_sim.simulation.devices.gpu.records import Nearness
from icofabric_sim.simulation.model.layout import Layout
from icofabric_sim.terms.contacts.record import Contacts, Watch
from icofabric_sim.terms.contacts.shape import CORNERS, EDGE_WAYS, NEIGHBOURS, NORMALS
import numpy as np

wp: Any = import_module('warp')

# Smallest length of the arrays of pairs.
_FEWEST = 64


class DeviceContacts:
    """Candidate pairs and displacements of bodies on a device."""

    def __init__(self, layout: Layout, fabric: Any, device: Device) -> None:
        """Allocate arrays for the bodies of `fabric`, which is in device memory."""
        self._layout, self._fabric, self._device = layout, fabric, device
        self._blocks = len(layout.blocks.slot)
        slots = layout.slot_count
        near = self.near = Nearness()
        near.normals, near.corners, near.vertices, near.edges = (
            wp.array(np.ascontiguousarray(rows).reshape(-1, 3), dtype=wp.vec3d,
                     device=device.handle)
            for rows in (NORMALS, CORNERS, one_of_each(vertices(1.0)), EDGE_WAYS))
        near.neighbours = self._integers(NEIGHBOURS)
        near.reference, near.rows = self._zeros(7 * slots), self._zeros(6 * slots)
        near.frame, near.ways = self._zeros(7), self._zeros(slots)
        near.count = self._integers(np.zeros(1))
        self._shares = self._zeros(-(-slots // SHARE))
        self._squares: Any = None
        self._contacts: Contacts | None = None
        self._frame = np.full(7, np.nan)
        self.room = 0  # for pairs

    def put(self, contacts: Contacts | None, watch: Watch, *, anew: bool) -> None:
        """
        Copy the result of the last search to the device.

        This happens if `anew`, or if a check in this process has changed the reference frame.
        """
        if anew or not np.array_equal(self._frame, watch.frame):
            self._frame = watch.frame.copy()
            self.near.radius = float(watch.radius)
            self.near.frame.assign(watch.frame)
            slots = self._layout.slot_count
            for first, values in ((0, watch.reference), (3, watch.turned)):
                wp.copy(self.near.reference, seen(values), first * slots, 0, values.size)
        if contacts is not None and contacts is not self._contacts:
            self._put_pairs(contacts)
        self._contacts = contacts

    def _put_pairs(self, contacts: Contacts) -> None:
        near, count = self.near, len(contacts.pairs)
        near.half_edge, near.stiffness = contacts.half_edge, contacts.stiffness
        if count > self.room or not self.room:
            self.room = max(_FEWEST, 1 << max(count - 1, 1).bit_length())
            near.pairs = self._integers(np.zeros(2 * self.room))
            near.pushes = self._zeros(PUSH_SIZE * self.room)
            near.depths = self._zeros(2 * self.room)
            near.entry = self._integers(np.zeros(2 * self.room))
            near.start = self._integers(np.zeros(self._layout.slot_count + 1))
            near.planes = doubles(contacts.planes, self._device)
        near.depths.zero_()
        entry = np.zeros(2 * self.room, np.int32)
        entry[:len(contacts.entry)] = contacts.entry
        pairs = np.zeros(2 * self.room, np.int32)
        pairs[:2 * count] = contacts.pairs.ravel()
        acting = np.bincount(contacts.slot, minlength=self._layout.slot_count)
        near.count.assign(np.array([count], np.int32))
        near.pairs.assign(pairs)
        near.entry.assign(entry)
        near.start.assign(np.concatenate([[0], np.cumsum(acting)]).astype(np.int32))

    def evaluate(
        self, clock: Any, step: int, drifts: int, pose: Any, *, touching: bool, watching: bool
    ) -> None:
        """
        Launch the evaluations before forces at a `pose`, after `drifts` drifts.

        `touching` means that there are pairs; `watching`, that displacements are recorded.
        """
        handle = self._device.handle
        if watching:
            launch(
                note_ways, dim=LANES * self._blocks,
                inputs=[self._fabric, self.near, clock, step, drifts, pose], device=handle)
        if touching:
            launch(
                touch, dim=self.room, inputs=[self._fabric, self.near, pose], device=handle)
            launch(
                add_up, dim=self._layout.slot_count, inputs=[self._fabric, self.near],
                device=handle)

    def load(self) -> None:
        """Load the kernels, because loading is impossible while launches are recorded."""
        for kernel in (note_ways, touch, add_up):
            load(kernel, self._device.handle)

    def forget_ways(self) -> None:
        """Reset the recorded displacements."""
        self.near.ways.zero_()

    def note_ways(self, watch: Watch) -> None:
        """Add the largest squared displacement [m^2] to `watch`, and reset that on the device."""
        count = self._layout.slot_count
        launch(
            fold_ways, dim=len(self._shares), inputs=[self.near.ways, count, self._shares],
            device=self._device.handle)
        watch.far[0] = max(watch.far[0], self._shares.numpy().max(initial=0.0))

    def note_depths(self, contacts: Contacts | None) -> None:
        """
        Write the deepest overlaps, of the last evaluation and since the last call, as kernels do.
        """
        if contacts is None or not len(contacts.pairs):
            return
        last, largest = self.near.depths.numpy().reshape(-1, 2)[:len(contacts.pairs)].max(axis=0)
        contacts.deepest[0] = last
        contacts.deepest[1] = max(contacts.deepest[1], largest)
        self.near.depths.zero_()

    def note_pushes(self, contacts: Contacts) -> None:
        """Write the contact forces of each block, for the energy oscillation in a step."""
        if self._squares is None:
            self._squares = self._zeros(self._blocks)
        launch(
            fold_pushes, dim=self._blocks, inputs=[self._fabric, self.near, self._squares],
            device=self._device.handle)
        contacts.pushes[:] = self._squares.numpy()

    def _zeros(self, count: int) -> Any:
        return wp.zeros(count, dtype=wp.float64, device=self._device.handle)

    def _integers(self, values: np.ndarray) -> Any:
        return wp.array(
            np.ascontiguousarray(values, np.int32).ravel(), dtype=wp.int32,
            device=self._device.handle)
