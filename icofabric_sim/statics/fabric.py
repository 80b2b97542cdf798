# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Potential energy, forces and Hessian of a scene at one time, without motion.

Vectors are (n, 6): displacements [m] and rotation vectors [rad] of the bodies, world frame, or
forces [N] and torques about the centres [N m]. A motion (dx, dtheta) moves a configuration to
x + dx, exp(dtheta) R.
"""

from collections.abc import Mapping
from copy import copy
from dataclasses import replace
from functools import cached_property
import math
from typing import Any

from icofabric_sim import checks
from icofabric_sim.geometry.rotations import cosines_from_quaternions, rotate_quaternions
from icofabric_sim.kernels.conjugate import add_own_blocks, add_pair_blocks
from icofabric_sim.kernels.flows import keep_accelerations, place_all
from icofabric_sim.kernels.hessian import hessian_times
from icofabric_sim.kernels.loads import place_driven
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.contact.setup import pack_contact
from icofabric_sim.simulation.inputs.inputs import Inputs
from icofabric_sim.simulation.model.body_force import BodyForce
from icofabric_sim.simulation.model.expression_force import with_expressions
from icofabric_sim.simulation.model.layout import aligned_zeros
from icofabric_sim.simulation.model.link_places import link_places
from icofabric_sim.simulation.model.packing import pack_scene, pack_supports, PackedScene
from icofabric_sim.simulation.model.shared_kinds import (
    BESIDE_ACCELERATIONS,
    BESIDE_CONNECTORS,
    BESIDE_DRIVES,
    TERMS,
    without,
)
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.model.ties import tie_blocks
from icofabric_sim.simulation.reports.load_cells import ContactForces
from icofabric_sim.statics.charges import largest_repulsion
from icofabric_sim.statics.contacts import ContactState, StaticContacts
from icofabric_sim.statics.friction import ContactFriction, FrictionPath
from icofabric_sim.statics.loads import (
    Acting,
    AnchorPull,
    AnchorState,
    DeadLoads,
    turned_potential,
)
from icofabric_sim.statics.own_force import OwnForce
from icofabric_sim.statics.sides import ACTUAL, lever_of
from icofabric_sim.statics.tangent import Stretched, TangentLaws
from icofabric_sim.statics.wrapped import find_wrapped, length_gradients, Wrapped
from icofabric_sim.terms.coulomb.tangent import add_coulomb_product
from icofabric_sim.terms.gravity.record import Gravity
import numpy as np


class StaticFabric:
    """Data of a fabric that is independent of the configuration."""

    def __init__(
        self, scene: Scene, time: float = 0.0, *, only: np.ndarray | None = None,
        contact: bool = True, load_factor: float = 1.0, broken_since: np.ndarray | None = None,
        inputs: Inputs | None = None, friction: FrictionPath | None = None,
        anchors_broken_since: np.ndarray | None = None, body_force: BodyForce | None = None
    ) -> None:
        """
        Hold loads, drives, planes and points of anchors at `time` [s].

        - `only`: connectors that forces and the Hessian include, by number; None: all.
        - `contact`: include contacts, if the scene has them.
        - `load_factor`: factor of weight, electric fields, loads, tractions and the body force.
        - `broken_since`: as in snapshots (c,); broken connectors are left out.
        - `anchors_broken_since`: likewise (a,).
        - `inputs`: inputs that replace the loads and paths of the scene; changed by this call.
        - `friction`: friction springs on a path of states; None: no friction.
        - `body_force`: body force of the user, in addition to loads by expressions, see
          own_force.py.
        """
        if not 0.0 <= time < math.inf:
            raise ValueError(f'time must be finite and not negative [s], got {time!r}')
        self.scene, self.time = scene, time
        self.packed = pack_scene(scene)
        self.intact: np.ndarray | None = None
        if broken_since is not None and not np.isnan(broken_since).all():
            self.intact, self.broken_since = np.isnan(broken_since), broken_since
            only = np.flatnonzero(self.intact)
        self.counted = np.ones(scene.connector_count, bool)
        if only is not None:
            self.counted[:] = False
            self.counted[only] = True
            self.packed = _with_connectors(self.packed, only)
        if load_factor != 1.0:
            self.packed = _with_factor(self.packed, load_factor)
        self.layout, model = self.packed.layout, self.packed.model
        inputs = inputs or Inputs(scene)
        if anchors_broken_since is not None and inputs.anchor_breaks is not None:
            inputs.anchor_breaks.since[:] = anchors_broken_since
        self.anchors_broken_since = (
            None if inputs.anchor_breaks is None else inputs.anchor_breaks.since.copy())
        while inputs.next_time <= time:
            inputs.apply_next()
        loads = inputs.pack(self.layout)
        self.loads = DeadLoads(inputs.packed_rows(), time, scene.body_count, load_factor)
        self.anchors = AnchorPull(
            loads.anchors, tuple(anchor.body for anchor in scene.anchors.values()),
            inputs.anchor_points(time), time)
        self.displaced = inputs.plane_displacements(time)  # (k, 3) [m] of the planes
        self.friction = None if friction is None else replace(friction, displaced=self.displaced)
        state = self.layout.pack(scene.initial)
        place_driven(
            without(model, *TERMS), without(loads, *BESIDE_DRIVES), state, time)
        position, orientation, _, _ = self.layout.unpack(state)
        force = with_expressions(scene, body_force)
        self.own_force = None if force is None else OwnForce(
            force, self.layout, position, orientation, self.half_edge, time, load_factor,
            inputs.expression_profiles())
        self.start = Configuration(self, position, orientation)
        self.free = np.ones((scene.body_count, 6), bool)
        if scene.supports is not None:
            self.free[:, :3] = ~scene.supports.translation
            self.free[:, 3:] = ~scene.supports.rotation[:, None]
        for drive in scene.drives.values():
            self.free[drive.bodies] &= ~drive.freedoms
        # Without supports, because forces on held degrees of freedom give the reactions.
        self.model = model._replace(supports=None)
        self.springs = without(self.model, 'bending', 'twisting', *BESIDE_CONNECTORS)
        self.laws = TangentLaws(self.packed)
        self.lever = lever_of(scene.geometry.connector_angle)
        self.work = self.layout.room(model.links)
        self.room = np.zeros_like(self.work.points), np.zeros((3, self.layout.slot_count))
        setup = pack_contact(scene, np.zeros(3), moving=False) if contact else None
        if setup is not None and scene.platens:
            planes = setup.planes.copy()
            planes[:, 3] += (planes[:, :3] * self.displaced).sum(axis=1)
            setup = setup._replace(planes=planes)
        self.contacts = None if setup is None else StaticContacts(setup, scene.body_count)
        # Configuration whose attachment points are in the buffers.
        self.placed: Configuration | None = None
        # Slots without a body stay 0.
        self.product = aligned_zeros((6, self.layout.slot_count))
        # [N] force of a connector by the round-off of its length.
        connectors = self.packed.connectors
        self.rounding = 0.0 if connectors is None else 1e-14 * float(
            max(connectors.extension.max(), connectors.compression.max())
            * np.max(scene.connectors.woven_length))
        if setup is not None:
            # And force of shells face to face by the round-off of their positions.
            self.rounding = max(
                self.rounding, 1e-15 * setup.stiffness * scene.geometry.half_edge)
        # [N] largest force of charges and dipoles on a body at the start.
        self.repulsion = largest_repulsion(self.model.coulomb, position, self.layout.slot)
        # Square roots of masses and inertias, (6,), or (n, 6) if they differ. In coordinates
        # scaled by them the eigenvalues of the Hessian are squared frequencies.
        masses = self.packed.masses
        self.root = np.sqrt(np.repeat(np.column_stack(masses), 3, axis=1))
        if masses.all_equal:
            self.root = self.root[0]
        # Without supports, because forces on held degrees of freedom give the reactions.
        unheld = self.model if masses.all_equal else self.model._replace(
            supports=pack_supports(masses, None, self.layout))
        self.unheld = without(unheld, *BESIDE_ACCELERATIONS)

    def without_contacts(self) -> 'StaticFabric':
        """Return a copy of the fabric without contacts."""
        bare = copy(self)
        bare.contacts = bare.friction = bare.placed = None
        # Separate buffers: each fabric tracks only the configuration placed in its own.
        bare.work = bare.layout.room(bare.model.links)
        bare.room = np.zeros_like(bare.work.points), np.zeros_like(self.room[1])
        bare.start = Configuration(bare, self.start.position, self.start.orientation)
        return bare

    @property
    def relative_charge(self) -> np.ndarray:
        """Charges of the bodies relative to the largest, (n,)."""
        charge = np.broadcast_to(self.scene.electric.charge, self.scene.body_count)
        largest = float(np.abs(charge).max(initial=0.0))
        return charge / largest if largest > 0.0 else charge

    def require_steady(self, time: float | None) -> None:
        """Raise ValueError if the body force changes with time and no `time` [s] is given."""
        if self.own_force is not None and time is None:
            self.own_force.require_steady(self.start.position, self.start.orientation)

    def configuration(self, name: str, snapshot: Snapshot) -> 'Configuration':
        """Return the configuration of a snapshot, which is the argument `name`."""
        check_snapshot(name, snapshot, self.scene)
        return Configuration(self, snapshot.position.copy(), snapshot.orientation.copy())

    @property
    def half_edge(self) -> float:
        """Half edge a [m]."""
        return self.scene.geometry.half_edge


def check_snapshot(name: str, snapshot: Snapshot | None, scene: Scene) -> None:
    """Raise TypeError or ValueError unless `snapshot` fits the scene; None passes."""
    if snapshot is None:
        return
    checks.instance(
        name, snapshot, Snapshot, 'simulation.snapshot() makes one, and results have a .snapshot')
    given, wanted = (*np.shape(snapshot.position), 0)[0], scene.body_count
    if given != wanted:
        raise ValueError(f'{name} has {given:,} bodies, the scene {wanted:,}')
    if snapshot.connector_count != scene.connector_count:
        raise ValueError(
            f'{name} has {snapshot.connector_count:,} connectors, the scene '
            f'{scene.connector_count:,}')
    checks.array(f'position of {name}', snapshot.position, (wanted, 3), 'm', row='body')
    checks.quaternions(f'orientation of {name}', snapshot.orientation, (wanted, 4), row='body')
    if snapshot.broken_since is not None:
        checks.array(
            f'broken_since of {name}', snapshot.broken_since, (scene.connector_count,), 's',
            finite=False)
    if snapshot.anchors_broken_since is not None:
        checks.array(
            f'anchors_broken_since of {name}', snapshot.anchors_broken_since,
            (len(scene.anchors),), 's', finite=False)


def _with_factor(packed: PackedScene, factor: float) -> PackedScene:
    """Return a packed scene with weight and electric fields times a factor."""
    model = packed.model
    if model.gravity is not None:
        model = model._replace(gravity=Gravity(factor * model.gravity.acceleration))
    if model.dipole is not None:
        model = model._replace(dipole=model.dipole._replace(field=factor * model.dipole.field))
    gravity, force = (
        None if part is None else factor * part for part in (packed.gravity, packed.field_force))
    return replace(packed, model=model, gravity=gravity, field_force=force)


def _with_connectors(packed: PackedScene, only: np.ndarray) -> PackedScene:
    model, connectors, last = packed.model, packed.connectors, packed.woven.stop
    assert connectors is not None
    if model.ties is not None:
        model = model._replace(ties=model.ties._replace(present=np.isin(
            model.ties.number, only[only >= last] - last).astype(np.uint8)))
    if model.links is not None:
        places = link_places(packed.layout, model.links, connectors, only[only < last])
        present = np.zeros_like(model.links.present)
        np.bitwise_or.at(
            present, (places.block, places.link), (1 << places.lane).astype(np.uint8))
        model = model._replace(links=model.links._replace(present=present))
    return replace(packed, model=model)


class Configuration:
    """Poses of the bodies; energy, forces and derivatives are computed when first used."""

    def __init__(
        self, fabric: StaticFabric, position: np.ndarray, orientation: np.ndarray,
        side: str = ACTUAL
    ) -> None:
        """
        Store positions (n, 3) [m] and quaternions x y z w (n, 4).

        `side`: stiffness of connectors at their kink in second derivatives, see sides.py.
        """
        self.fabric, self.position, self.orientation = fabric, position, orientation
        self.side = side

    def on(self, side: str) -> 'Configuration':
        """Return the configuration with another side of connectors at their kink."""
        return self._alike(side)

    def with_slope(
        self, slope: np.ndarray, bodies: np.ndarray, blocks: np.ndarray
    ) -> 'Configuration':
        """
        Return the configuration with other stiffnesses `slope` [N/m], (c,), in the Hessian.

        `blocks` (p, 12, 12) of pairs of `bodies` (p, 2) are added to those of contacts; of a body
        paired with itself only the first 6 x 6 entries are used.
        """
        there = self._alike(self.side)
        there.__dict__['slope'] = slope
        if len(bodies):
            own, before = self.contact_blocks
            there.__dict__['contact_blocks'] = (
                np.concatenate([own, bodies]), np.concatenate([before, blocks]))
        return there

    def anew(self) -> 'Configuration':
        """Return the configuration with second derivatives of contacts to be recomputed."""
        there = self._alike(self.side)
        there.__dict__.pop('contact_blocks', None)
        return there

    def _alike(self, side: str) -> 'Configuration':
        there = Configuration(self.fabric, self.position, self.orientation, side)
        # Copy the cached values that do not depend on the side.
        for name in (
                'snapshot', 'energy', 'force', 'contact_state', 'contact_blocks', 'acting', 'axes',
                'tension', 'stretched', 'anchor_state', 'state', 'first_touches', 'wrapped',
                'free_ends', 'friction', 'friction_blocks', 'own_wrench', 'own_force_blocks'):
            if name in self.__dict__:
                there.__dict__[name] = self.__dict__[name]
        return there

    @cached_property
    def stretched(self) -> Stretched:
        """Lengths of the connectors, and the included ones at their kinks."""
        fabric = self.fabric
        found = fabric.laws.stretched(
            self.snapshot.connector_length, self.snapshot.connector_ends, fabric.lever)
        return found._replace(
            at_kink=found.at_kink & fabric.counted, rounded=found.rounded & fabric.counted)

    @property
    def at_kink(self) -> np.ndarray:
        """Numbers of the connectors at their kink."""
        return np.flatnonzero(self.stretched.at_kink)

    @property
    def anchors_at_kink(self) -> tuple[str, ...]:
        """Names of the anchors at their kink."""
        names = tuple(self.fabric.scene.anchors)
        return tuple(names[a] for a in np.flatnonzero(self.anchor_state.here.at_kink))

    @property
    def kink_jumps(self) -> np.ndarray:
        """k_e - k_c [N/m] of the connectors and anchors at their kink, (j,)."""
        jumps = [self.fabric.laws.jump(self.at_kink)]
        if self.anchor_state.here.at_kink.any():
            jumps.append(self.anchor_state.jump[self.anchor_state.here.at_kink])
        return np.concatenate(jumps)

    @cached_property
    def first_touches(self) -> int:
        """Number of pairs of shells, or shells and planes, at first touch."""
        contacts = self.fabric.contacts
        return 0 if contacts is None else contacts.first_touches(self.position, self.axes)

    @cached_property
    def slope(self) -> np.ndarray:
        """Tangent stiffnesses of the connectors [N/m], (c,)."""
        return self.fabric.laws.slope(self.stretched, self.side)

    @cached_property
    def anchor_slope(self) -> np.ndarray:
        """Tangent stiffnesses of the anchors [N/m], (a,)."""
        return self.fabric.anchors.slope(self.anchor_state, self.side)

    def moved(self, motion: np.ndarray) -> 'Configuration':
        """Return the configuration displaced and rotated by a vector (n, 6)."""
        return Configuration(
            self.fabric, self.position + motion[:, :3],
            rotate_quaternions(motion[:, 3:], self.orientation))

    @cached_property
    def snapshot(self) -> Snapshot:
        """Snapshot of the configuration at rest."""
        fabric, zero = self.fabric, np.zeros_like(self.position)
        books: Mapping[str, float] = {
            'work_in': 0.0, 'spent': 0.0, 'start': 0.0,
            'potential': 0.0 if fabric.own_force is None else fabric.own_force.energy(
                self.position, self.orientation),
            'anchors': self.anchor_state.energy,
            'contact': 0.0 if self.contact_state is None else self.contact_state.energy}
        arrays = self.position, self.orientation, zero, zero.copy()
        for array in arrays:
            array.flags.writeable = False
        return Snapshot(
            fabric.time, *arrays, fabric.scene.connector_count, fabric.packed, books,
            None if fabric.intact is None else fabric.broken_since,
            anchors_broken_since=fabric.anchors_broken_since)

    @cached_property
    def energy(self) -> float:
        """Potential energy [J] of the fabric and of the dead loads."""
        friction = 0.0 if self.friction is None else self.friction.energy
        return float(self.snapshot.energy['total']) + self.acting.energy + friction

    @cached_property
    def force(self) -> np.ndarray:
        """Forces and torques (n, 6) on all degrees of freedom, including held ones."""
        fabric = self.fabric
        work = fabric.work
        keep_accelerations(
            fabric.unheld, self._placed(), work, fabric.time, 0, len(fabric.layout.blocks.slot))
        force = fabric.layout.gather(work.acceleration) * fabric.root**2
        force += self.anchor_state.wrench + self.acting.wrench
        if self.own_wrench is not None:
            force += self.own_wrench
        if self.contact_state is not None:
            force += self.contact_state.wrench
        if self.friction is not None:
            force += self.friction.wrench
        return np.asarray(force)

    @cached_property
    def contact_state(self) -> ContactState | None:
        """Contacts without friction; None without contact."""
        contacts = self.fabric.contacts
        return None if contacts is None else contacts.act(self.position, self.axes)

    @cached_property
    def custom_blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """Second derivatives of custom connectors, in the form of `contact_blocks`."""
        fabric = self.fabric
        custom, first = fabric.packed.custom, fabric.packed.woven.stop
        if custom is None:
            return np.zeros((0, 2), np.int64), np.zeros((0, 12, 12))
        counted, rounded = fabric.counted[first:], self.stretched.rounded[first:]
        return custom.bodies, tie_blocks(
            custom, self.position, self.axes, self.slope[first:] * counted,
            np.where(counted & ~rounded, self.tension[first:], 0.0))

    @property
    def contact_forces(self) -> ContactForces | None:
        """Force, torques and point of each contact; None without contact."""
        contacts, friction, path = self.fabric.contacts, self.friction, self.fabric.friction
        return None if contacts is None else contacts.forces(
            self.position, self.axes,
            None if friction is None or path is None else (
                friction.pairs, friction.wrenches, path.sizes(friction), path.coefficient))

    @cached_property
    def friction(self) -> ContactFriction | None:
        """Friction; None without friction."""
        friction = self.fabric.friction
        return None if friction is None else friction.act(self.position, self.axes)

    @cached_property
    def friction_blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """Second derivatives of friction by pairs, in the form of `contact_blocks`."""
        friction = self.fabric.friction
        if friction is None or not len(friction.pairs):
            return np.zeros((0, 2), np.int64), np.zeros((0, 12, 12))
        return friction.blocks(self.position, self.axes)

    @cached_property
    def acting(self) -> Acting:
        """Loads in this configuration."""
        return self.fabric.loads.act(self.position, self.axes)

    @cached_property
    def own_wrench(self) -> np.ndarray | None:
        """Forces and torques (n, 6) of the user's body force; None without a body force."""
        own = self.fabric.own_force
        return None if own is None else own.wrench(self.position, self.orientation)

    @cached_property
    def own_force_blocks(self) -> np.ndarray | None:
        """Derivatives (n, 6, 6) of the user's body force, see own_force.py; None without one."""
        own = self.fabric.own_force
        return None if own is None else own.blocks(self.position, self.orientation)

    @cached_property
    def axes(self) -> np.ndarray:
        """Body axes as rows, (n, 3, 3)."""
        return cosines_from_quaternions(self.orientation)

    @cached_property
    def tension(self) -> np.ndarray:
        """Tensions of the connectors [N], (c,); 0 of broken ones."""
        tension = self.fabric.laws.tension(self.snapshot.connector_length)
        intact = self.fabric.intact
        return tension if intact is None else np.where(intact, tension, 0.0)

    @cached_property
    def force_scale(self) -> float:
        """
        Largest force [N] of a connector, an anchor, a load, charges, weight or body force.

        If none of them acts: the largest reaction, which then balances only moments of connectors,
        or the largest torque over a.
        """
        fabric = self.fabric
        weight = 0.0 if self.own_wrench is None else float(
            np.linalg.norm(self.own_wrench[:, :3], axis=1).max())
        if fabric.model.gravity is not None:
            size = float(np.linalg.norm(fabric.model.gravity.acceleration))
            weight = max(weight, size * float(fabric.packed.masses.mass.max()))
        pulls = [*np.abs(self.tension), *np.abs(self.anchor_state.tension)]
        if self.contact_state is not None:
            pulls.append(self.contact_state.largest_force)
        scale = max(
            fabric.loads.largest_force, weight, fabric.repulsion, max(pulls, default=0.0))
        if scale > 10.0 * fabric.rounding:
            return scale
        held = np.abs(np.where(fabric.free, 0.0, self.force))
        held[:, 3:] /= fabric.half_edge
        twist = 0.0 if self.own_wrench is None else float(
            np.linalg.norm(self.own_wrench[:, 3:], axis=1).max())
        return max(
            scale, float(held.max(initial=0.0)),
            max(fabric.loads.largest_torque, twist) / fabric.half_edge)

    @cached_property
    def contact_blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """Second derivatives of contacts: bodies (m, 2), and blocks (m, 12, 12)."""
        fabric = self.fabric
        if fabric.contacts is None or self.contact_state is None:
            return np.zeros((0, 2), np.int64), np.zeros((0, 12, 12))
        return fabric.contacts.blocks(self.contact_state, self.position, self.axes)

    @cached_property
    def wrapped(self) -> Wrapped:
        """Connectors wrapped over shells."""
        fabric, snapshot = self.fabric, self.snapshot
        model = fabric.packed.model
        if model.wrapping is None:
            return Wrapped(np.zeros(0, np.int64), np.zeros((0, 2, 3)), np.zeros((0, 12, 12)))
        assert fabric.packed.connectors is not None
        return find_wrapped(
            model.wrapping, fabric.packed.connectors, fabric.scene.connectors.bodies,
            np.flatnonzero((snapshot.obstructed != 0) & fabric.counted), self.position,
            self.orientation)

    @cached_property
    def free_ends(self) -> np.ndarray:
        """
        World points [m] between which connectors are straight and free, (c, 2, 3).

        They are attachment points, or the points where wrapped connectors leave their shells. To
        first order, lengths change as if these points were fixed on the bodies.
        """
        if not len(self.wrapped.of):
            return self.snapshot.connector_ends
        ends = self.snapshot.connector_ends.copy()
        ends[self.wrapped.of] = self.wrapped.ends
        return ends

    @cached_property
    def wrapped_blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """Second derivatives of wrapped connectors, in the form of `contact_blocks`."""
        wrapped = self.wrapped
        if not len(wrapped.of):
            return np.zeros((0, 2), np.int64), np.zeros((0, 12, 12))
        rounded = self.stretched.rounded[wrapped.of]
        pull = np.where(rounded, 0.0, self.tension[wrapped.of])
        # First derivatives by the points where they leave the shells.
        gradient = np.hstack(list(length_gradients(
            wrapped.ends, self.position[self.fabric.scene.connectors.bodies[wrapped.of]])))
        blocks = pull[:, None, None] * wrapped.second
        blocks += self.slope[wrapped.of, None, None] * (
            gradient[:, :, None] * gradient[:, None, :])
        return self.fabric.scene.connectors.bodies[wrapped.of], blocks

    @cached_property
    def pair_blocks(self) -> tuple[np.ndarray, np.ndarray]:
        """Second derivatives of contacts, wrapped and custom connectors and friction by pairs."""
        bodies, blocks = zip(
            self.contact_blocks, self.wrapped_blocks, self.friction_blocks, self.custom_blocks)
        return np.concatenate(bodies), np.concatenate(blocks)

    def times(self, motion: np.ndarray, *, pairs: bool = True) -> np.ndarray:
        """
        Return the Hessian times a vector, (n, 6) both, on all degrees of freedom.

        `pairs` includes contacts, friction, wrapped and custom connectors and mutual forces of
        charges.
        """
        layout, product = self.fabric.layout, self.fabric.product
        self.multiply(layout.spread(motion), product, pairs=pairs)
        return layout.gather(product)

    def multiply(
        self, vector: np.ndarray, product: np.ndarray, *, pairs: bool = True
    ) -> None:
        """Write the Hessian times a vector to `product`, both (6, s) and 0 in empty slots."""
        fabric = self.fabric
        points, turns = fabric.room
        self._placed()
        hessian_times(
            self.connectors, self.state, fabric.work.points, points, turns, 1.0, 1.0, None,
            vector, product)
        for slots, blocks in self.own_blocks:
            add_own_blocks(slots, blocks, vector, product)
        if pairs:
            bodies, blocks = self.pair_blocks
            if len(bodies):
                add_pair_blocks(fabric.layout.slot[bodies], blocks, vector, product)
            if fabric.model.coulomb is not None:
                self._add_mutual(vector, product)

    def mutual_hessian(self) -> np.ndarray:
        """Return the Hessian (6 n, 6 n) of charges and dipoles that act on each other."""
        layout, product = self.fabric.layout, self.fabric.product
        columns = []
        for unit in np.eye(6 * len(self.position)):
            product[:] = 0.0
            self._add_mutual(layout.spread(unit.reshape(-1, 6)), product)
            columns.append(layout.gather(product).ravel())
        return np.array(columns)

    def _add_mutual(self, vector: np.ndarray, product: np.ndarray) -> None:
        model, state = self.fabric.model, self.state
        add_coulomb_product(
            model.coulomb, model.blocks, state.position, state.orientation, None, 1.0, 1.0,
            vector, product)

    @cached_property
    def own_blocks(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Slots (m,) and second derivatives (m, 6, 6) of anchors, dead loads and body forces."""
        slot, found = self.fabric.layout.slot, []
        anchored = self.fabric.anchors.blocks(
            self.anchor_state, self.position, self.axes, self.anchor_slope)
        if anchored:
            found.append((
                slot[[body for body, _ in anchored]], np.array([block for _, block in anchored])))
        if self._turning is not None:
            turning = np.zeros((len(slot), 6, 6))
            turning[:, 3:, 3:] = self._turning
            found.append((slot, turning))
        if self.own_force_blocks is not None:
            blocks = self.own_force_blocks
            found.append((slot, 0.5 * (blocks + np.swapaxes(blocks, 1, 2))))
        return found

    @cached_property
    def _turning(self) -> np.ndarray | None:
        """Second derivatives along rotations, of dead loads and of dipoles."""
        turning, dipole = self.acting.turning, self.fabric.model.dipole
        if dipole is None:
            return turning
        arm = np.einsum('i,nij->nj', dipole.moment, self.axes)
        own = turned_potential(np.broadcast_to(dipole.field, arm.shape), arm)
        return own if turning is None else turning + own

    @cached_property
    def tangent(self) -> Any:
        """Model with the tangent stiffnesses of connectors, without supports."""
        return self.fabric.laws.model(
            self.stretched, self.slope, self.wrapped.of)._replace(supports=None)

    @cached_property
    def connectors(self) -> Any:
        """Return the model with the laws of connectors alone."""
        return without(self.tangent, *BESIDE_CONNECTORS)

    @cached_property
    def anchor_state(self) -> AnchorState:
        return self.fabric.anchors.act(self.position, self.axes, self.fabric.lever)

    @cached_property
    def state(self) -> Any:
        """Packed state at rest, for the kernels."""
        zero = np.zeros_like(self.position)
        return self.fabric.layout.pack(
            InitialState(self.position, self.orientation, zero, zero))

    def _placed(self) -> Any:
        """Return the state, with its attachment points in the buffers shared by configurations."""
        fabric = self.fabric
        if fabric.placed is not self:
            place_all(
                fabric.springs, self.state, fabric.work, 0, len(fabric.layout.blocks.slot))
            fabric.placed = self
        return self.state
