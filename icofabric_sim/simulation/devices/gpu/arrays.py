# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays of a run on a GPU: constants, loads and state of a scene in device memory."""

from importlib import import_module
from typing import Any

from icofabric_sim.kernels.integrators.tableau import DENSE
from icofabric_sim.kernels.records import Links, Loads, Model, State, Work
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.devices.gpu.kernels import Terms
from icofabric_sim.simulation.devices.gpu.opening import Device
from icofabric_sim.simulation.devices.gpu.records import Fabric
from icofabric_sim.simulation.model.layout import has_jumps, Layout
from icofabric_sim.terms.bending.record import Bending
from icofabric_sim.terms.registry import LAWS, TERMS
from icofabric_sim.terms.shared import LINK_COUNT
from icofabric_sim.terms.twisting.record import Twisting
import numpy as np

wp: Any = import_module('warp')

# Doubles of a body on a device: two poses, velocities, accelerations, and the saved state.
_STATE_ROWS = 2 * 7 + 6 + 6 + 7 + 6
POSE, MOTION = 7, 6
# Further doubles of steps that resolve jumps of slopes.
_START_ROWS, _FORCE_ROWS = 3 * LINK_COUNT, 4 * LINK_COUNT
# Further doubles for contacts: pose at the last search, contact forces, displacement.
_CONTACT_ROWS = POSE + MOTION + 1
# Terms that kernels here and in contact.py compute.
COMPUTED = frozenset({
    'links', 'bending', 'twisting', 'dipole', 'damping', 'drag', 'gravity', 'contacts'})
# Fields of paths, see records.py.
_PATHS = 'start', 'cubic', 'wave', 'rate', 'phase', 'base', 'turn', 'arm', 'first'


def terms_of(model: Model, *, loaded: bool) -> Terms:
    """Return the terms that the kernel of a scene computes."""
    links = model.links
    return Terms(
        linked=links is not None,
        midpoints=links is None or links.attachment is None,
        one_law=links is None or links.variety is None,
        moments=model.bending is not None or model.twisting is not None,
        dipole=model.dipole is not None,
        held=model.supports is not None and model.supports.inverse_mass.shape[1] > 0,
        loaded=loaded,
        laws=() if links is None or links.laws is None else tuple(
            law.name for law in LAWS if getattr(links.laws, law.name) is not None))


def driven_terms(terms: Terms, model: Model, acting: Any) -> Terms:
    """Return the terms of a scene under the loads `acting`, which may move bodies on paths."""
    return terms._replace(
        driven=acting is not None and acting.paths > 0, own_masses=model.masses is not None)


def bytes_of(
    model: Model, layout: Layout, *, kinked: bool = False, touching: bool = False
) -> int:
    """
    Return the approximate memory [bytes] of a run on a device, without its loads.

    `kinked` is for a method that resolves jumps of slopes. `touching` is for shells that may
    touch, without the memory of candidate pairs.
    """
    terms, slots = terms_of(model, loaded=False), layout.slot_count
    each = 8 * _STATE_ROWS + 4 * terms.held * 8 + 2 * (model.masses is not None) * 8
    if kinked and has_jumps(model.links):
        each += 8 * (_START_ROWS + _FORCE_ROWS + 3 * MOTION) + LINK_COUNT
    each += touching * (8 * _CONTACT_ROWS + 4)
    blocks = len(layout.blocks.slot) * (4 + 1 + 4)
    if terms.linked:
        blocks += len(layout.blocks.slot) * 12 * (4 + 1)
        each += 0 if terms.one_law else 3 * 12 * 8
        each += 12 * 8 * _law_row_count(model.links)
        each += sum(
            12 * 8 for moment in (model.bending, model.twisting)
            if moment is not None and moment.variety is not None)
    return slots * each + blocks


def pair_bytes_of(model: Model, layout: Layout, *, touching: bool = False) -> int:
    """Return the approximate memory [bytes] of a run by the embedded pair, with its slopes."""
    spends = model.damping is not None or model.drag is not None
    # A trial state and the initial one; slopes, powers, dissipated energy; errors.
    more = 2 * (POSE + MOTION) + DENSE * (POSE + MOTION) + spends * (DENSE + 2) + 2
    own = model.damping is not None and model.damping.own is not None
    more += own * LINK_COUNT + touching * 2
    return bytes_of(model, layout, touching=touching) + 8 * layout.slot_count * more


def require_room(device: Device, bodies: int, need: int) -> None:
    """Raise ValueError if the device lacks `need` bytes of memory for a fabric."""
    left = device.free_bytes
    if need > left:
        raise ValueError(
            f'{bodies:,} bodies need about {need / 1e9:.3g} GB on {device.name}, and '
            f'{left / 1e9:.3g} GB are left there; take a smaller weave.size, ranks of MPI or '
            'solver.device cpu')


def bytes_moved(model: Model, layout: Layout) -> float:
    """
    Return the bytes that a force evaluation reads and writes for each body, without loads.

    Poses of neighbours are assumed to be cached, so that pose and velocities are read and written
    once.
    """
    terms, blocks = terms_of(model, loaded=False), len(layout.blocks.slot)
    each = 8 * 2 * (POSE + MOTION)
    each += 8 * 4 * terms.held + 8 * 3 * 12 * (terms.linked and not terms.one_law)
    each += sum(
        8 * 12 for moment in (model.bending, model.twisting)
        if moment is not None and moment.variety is not None)
    tables = blocks * (4 + 1 + terms.linked * 12 * (4 + 1))
    return each + tables / max(layout.body_count, 1)


def doubles(values: np.ndarray, device: Device) -> Any:
    """Return a flat array of doubles on the device."""
    return wp.array(
        np.ascontiguousarray(values, dtype=np.float64).ravel(), dtype=wp.float64,
        device=device.handle)


def _vectors(values: np.ndarray, device: Device) -> Any:
    return wp.array(
        np.ascontiguousarray(values, dtype=np.float64).reshape(-1, 3), dtype=wp.vec3d,
        device=device.handle)


def _integers(values: np.ndarray, kind: Any, device: Device) -> Any:
    return wp.array(np.ascontiguousarray(values).ravel(), dtype=kind, device=device.handle)


def _law_row_count(links: Links | None) -> int:
    """Count the rows of laws that replace springs."""
    if links is None or links.laws is None:
        return 0
    return sum(len(law) for law in links.laws if law is not None)


def fabric_of(model: Model, layout: Layout, device: Device) -> Any:
    """
    Copy the constants of a scene to the device.

    Raises NotImplementedError for a term that kernels of a GPU do not compute.
    """
    for term in TERMS:
        if term.name not in COMPUTED and getattr(model, term.name, None) is not None:
            raise NotImplementedError(f'kernels of a GPU do not compute the term {term.name}')
    terms, fabric = terms_of(model, loaded=False), Fabric()
    fabric.slot = _integers(model.blocks.slot, wp.int32, device)
    fabric.alive = _integers(model.blocks.alive, wp.uint8, device)
    fabric.lanes, fabric.stride = LANES, layout.slot_count
    fabric.inverse_mass, fabric.inverse_inertia = model.inverse_mass, model.inverse_inertia
    if model.masses is not None:
        fabric.own_mass = doubles(model.masses.mass, device)
        fabric.own_inertia = doubles(model.masses.inertia, device)
    if model.gravity is not None:
        fabric.gravity = wp.vec3d(*map(float, model.gravity.acceleration))
    if terms.held and model.supports is not None:
        fabric.free_mass = doubles(model.supports.inverse_mass, device)
        fabric.free_inertia = doubles(model.supports.inverse_inertia, device)
    if model.links is not None:
        _put_links(fabric, model.links, device)
    if model.bending is not None:
        fabric.bending = _stiffness(model.bending, device)
        fabric.direction = _vectors(model.bending.direction, device)
    if model.twisting is not None:
        fabric.twisting = _stiffness(model.twisting, device)
    if model.damping is not None:
        given = model.damping.own
        fabric.damping = doubles(
            np.array([model.damping.coefficient]) if given is None else given, device)
    if model.drag is not None:
        fabric.drag_linear, fabric.drag_angular = model.drag.linear, model.drag.angular
    if model.dipole is not None:
        fabric.dipole = wp.vec3d(*map(float, model.dipole.moment))
        fabric.field = wp.vec3d(*map(float, model.dipole.field))
    return fabric


def _stiffness(moment: Bending | Twisting, device: Device) -> Any:
    given = moment.variety
    return doubles(np.array([moment.stiffness]) if given is None else given, device)


def _put_links(fabric: Any, links: Links, device: Device) -> None:
    fabric.place = _integers(links.place, wp.int32, device)
    fabric.present = _integers(links.present, wp.uint8, device)
    fabric.half_width = links.half_width
    fabric.stiffness, fabric.natural_length = links.stiffness, links.natural_length
    if links.attachment is not None:
        fabric.attachment = _vectors(links.attachment, device)
    if links.variety is not None:
        fabric.extension = doubles(links.variety.extension, device)
        fabric.compression = doubles(links.variety.compression, device)
        fabric.natural = doubles(links.variety.natural_length, device)
    if links.laws is not None:
        fabric.laws = doubles(np.vstack([
            row for law in links.laws if law is not None for row in law]), device)


def put_crossings(fabric: Any, slot_count: int, device: Device) -> None:
    """Allocate arrays for steps that resolve jumps of slopes."""
    fabric.start, fabric.forces = (
        wp.zeros(rows * slot_count, dtype=wp.float64, device=device.handle)
        for rows in (_START_ROWS, _FORCE_ROWS))
    fabric.active = wp.zeros(LINK_COUNT * slot_count, dtype=wp.uint8, device=device.handle)
    fabric.found = wp.zeros(1, dtype=wp.int32, device=device.handle)


def put_acting(acting: Any, loads: Loads, device: Device) -> bool:
    """
    Copy loads to the device, with their work so far; return True if arrays were replaced.

    Arrays of `acting` are reused if their lengths agree.
    """
    count, drives = len(loads.force), loads.drives
    varying = np.tile([0.0, 1.0, 0.0, 0.0, 0.0], (count, 1))
    given, anchors = loads.varying, loads.anchors
    if given is not None and len(given.start):
        varying = np.column_stack([
            given.start, given.value, given.slope, given.height, given.rate])
    tables: list[tuple[str, Any, np.ndarray]] = [
        ('start', wp.int32, loads.start), ('wrench', wp.int32, loads.wrench),
        ('lanes', wp.uint8, loads.lanes), ('turning', wp.uint8, loads.turning),
        ('force', wp.vec3d, loads.force), ('torque', wp.vec3d, loads.torque),
        ('point', wp.vec3d, loads.point), ('work', wp.float64, loads.work),
        ('varying', wp.float64, varying)]
    if anchors is not None:
        law = np.column_stack([anchors.extension, anchors.compression, anchors.natural_length])
        tables += [
            ('anchor_start', wp.float64, anchors.start), ('anchor_cubic', wp.vec3d, anchors.cubic),
            ('anchor_arm', wp.vec3d, anchors.arm), ('anchor_law', wp.float64, law)]
    if drives is not None:
        tables += [
            (f'path_{name}', wp.float64, getattr(drives, name)) for name in _PATHS]
        tables.append(('path_moves', wp.uint8, drives.moves))
    paths = 0 if drives is None else len(drives.start)
    is_replaced, acting.paths = paths != acting.paths, paths
    for name, kind, values in tables:
        rows = np.ascontiguousarray(values)
        rows = rows.reshape(-1, 3) if kind is wp.vec3d else rows.ravel()
        present = getattr(acting, name)
        if present is not None and len(present) == len(rows) > 0:
            present.assign(rows)
        elif present is None or len(present) != len(rows):
            setattr(acting, name, wp.array(rows, dtype=kind, device=device.handle))
            is_replaced = True
    return is_replaced


class StateArrays:
    """State and accelerations of all bodies on a device."""

    def __init__(self, slot_count: int, device: Device) -> None:
        """Allocate arrays of `slot_count` slots."""
        zeros = [
            wp.zeros(rows * slot_count, dtype=wp.float64, device=device.handle)
            for rows in (POSE, POSE, MOTION, MOTION)]
        # Two poses: a launch reads one and writes the other.
        self.poses, self.motion, self.acceleration = zeros[:2], zeros[2], zeros[3]
        self.saved_pose, self.saved_motion = (
            wp.zeros_like(self.poses[0]), wp.zeros_like(self.motion))
        self._saved_work: Any = None

    def put(self, state: State, work: Work) -> None:
        """Copy a state to the device; the first pose becomes the present one."""
        copy_rows(state, self.poses[0], self.motion, back=False)
        wp.copy(self.acceleration, seen(work.acceleration), 0, 0, work.acceleration.size)
        # Slots without a body are never written.
        wp.copy(self.poses[1], self.poses[0])

    def take(self, now: int, state: State, work: Work, *, whole: bool) -> None:
        """Copy the state back; `whole` includes the accelerations."""
        copy_rows(state, self.poses[now], self.motion, back=True)
        if whole:
            wp.copy(seen(work.acceleration), self.acceleration, 0, 0, work.acceleration.size)

    def save(self, now: int, done: Any) -> None:
        """Save the state and the work `done` by loads in device memory."""
        wp.copy(self.saved_pose, self.poses[now])
        wp.copy(self.saved_motion, self.motion)
        self._saved_work = None if done is None else wp.clone(done)

    def take_saved(self, saved: State, done: np.ndarray) -> None:
        """Copy the saved state and work back."""
        copy_rows(saved, self.saved_pose, self.saved_motion, back=True)
        if self._saved_work is not None:
            copy_back(done, self._saved_work)


def copy_rows(state: State, pose: Any, motion: Any, *, back: bool) -> None:
    """Copy a state to arrays of poses and velocities on a device, or `back`."""
    slots = state.position.shape[1]
    for target, first, values in (
            (pose, 0, state.position), (pose, 3, state.orientation),
            (motion, 0, state.linear_velocity), (motion, 3, state.angular_velocity)):
        if back:
            wp.copy(seen(values), target, 0, first * slots, values.size)
        else:
            wp.copy(target, seen(values), first * slots, 0, values.size)


def seen(values: np.ndarray) -> Any:
    """Return the memory of a host array as a Warp array."""
    return wp.array(values.reshape(-1), dtype=wp.float64, device='cpu', copy=False)


def copy_back(values: np.ndarray, source: Any) -> None:
    """Copy a device array to a host array."""
    if values.size:
        wp.copy(seen(values), source)
