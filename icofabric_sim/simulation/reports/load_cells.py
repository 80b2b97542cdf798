# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Reactions of supports, drives, anchors and planes, and contact forces.

A held or driven body obeys M a = F + R. F are all other forces (connectors with their moments and
damping, weight, fields, drag, loads, anchors, contacts), and a is the acceleration that the
support or path prescribes. The reaction is R = M a - F, and Lambda alpha - N for torques. The
right-hand side of Runge-Kutta methods computes F in a model without supports.
"""

from dataclasses import dataclass
from typing import Any

from icofabric_sim.checks import renamed_attributes
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.kernels.loads import place_driven
from icofabric_sim.kernels.records import Loads, State
from icofabric_sim.kernels.rhs import find_slopes, place_blocks
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.scene.masses import turned_axes
from icofabric_sim.scene.planes import make_planes
from icofabric_sim.scene.scene import Scene
from icofabric_sim.scene.supports import fixed_freedoms
from icofabric_sim.simulation.contact.broad_phase import BroadPhase
from icofabric_sim.simulation.inputs.anchor_breaks import AnchorBreaks
from icofabric_sim.simulation.model.anchor_stiffness import motion_of_points
from icofabric_sim.simulation.model.as_table import AsTable
from icofabric_sim.simulation.model.layout import aligned_empty, copy_state
from icofabric_sim.simulation.model.packing import pack_supports, PackedScene
from icofabric_sim.simulation.model.shared_kinds import BESIDE_DRIVES, TERMS, without
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.stepping.driver import Driver
from icofabric_sim.terms.body_force.external_force import ask_alone
from icofabric_sim.terms.contacts.force import contact_look
from icofabric_sim.terms.contacts.losses import lose_some
from icofabric_sim.terms.contacts.record import Contacts
import numpy as np


@dataclass(frozen=True)
class PathDifferenceSettings:
    """Tunables of accelerations of paths, central differences of their velocities."""

    # Half the interval: time [s], and angle [rad] of the fastest wave or spin. The relative error
    # is at most 2e-7, and 0 for a cubic.
    max_time_s: float = 1e-4
    max_angle: float = 1e-3


_SETTINGS = PathDifferenceSettings()


@renamed_attributes(
    first='wrench_on_first', second='wrench_on_second', push='normal_force')
@dataclass(frozen=True, repr=False, eq=False)
class ContactForces(AsTable):
    """
    Contacts of one state, with all forces and torques between the two bodies.

    Forces and torques about the centres are exact. The line of action of a normal force need not
    pass through `point`, the centre of depth of the overlap, at which friction acts: the force is
    the gradient of the energy of the overlap.
    """

    bodies: np.ndarray  # (m, 2) int32; the second one -1 - k: plane k
    point: np.ndarray  # (m, 3) [m] centre of depth of the overlap, world
    force: np.ndarray  # (m, 3) [N] on the first body, damping and friction included, world
    overlap: np.ndarray  # (m,) [m]
    planes: tuple[str, ...]  # names
    # (m, 6) force [N] and torque about its centre [N m] on the first body, and on the second; the
    # torque is 0 on a plane, which has no centre.
    wrench_on_first: np.ndarray
    wrench_on_second: np.ndarray
    # (m,) normal force N and friction T [N], and margin 1 - T / (mu N) of the friction cone: 1
    # without friction, 0 if the contact is about to slide, NaN if N is 0. None: not of an
    # equilibrium with friction.
    normal_force: np.ndarray | None = None
    friction: np.ndarray | None = None
    margin: np.ndarray | None = None

    def __post_init__(self) -> None:
        """Set torques on planes to 0."""
        self.wrench_on_second[self.bodies[:, 1] < 0, 3:] = 0.0

    def __repr__(self) -> str:
        """Return the number of contacts in words."""
        planes = int(np.count_nonzero(self.bodies[:, 1] < 0))
        return (f'<ContactForces: {len(self.bodies) - planes:,} pairs of shells and '
                f'{planes:,} of a shell and a plane touch>')

    def table(self) -> dict[str, list[Any]]:
        """Return the contacts as plain values: a list for each column, named with its unit."""
        cones = {
            'normal_force_n': self.normal_force, 'friction_n': self.friction,
            'margin': self.margin}
        return {
            'contact': list(range(len(self.bodies))),
            'first': self.bodies[:, 0].tolist(),
            'second': [
                other if other >= 0 else f'planes.{self.planes[-1 - other]}'
                for other in self.bodies[:, 1].tolist()],
            **_columns('point', 'm', self.point), **_columns('force', 'n', self.force),
            'overlap_m': self.overlap.tolist(),
            **_columns('torque', 'nm', self.wrench_on_first[:, 3:]),
            **_columns('torque_on_second', 'nm', self.wrench_on_second[:, 3:]),
            **{name: [value if value == value else None for value in part.tolist()]
               for name, part in cones.items() if part is not None}}

    @property
    def smallest_margin(self) -> float:
        """
        Smallest margin of contacts with a normal force; NaN without such contacts or friction.
        """
        known = np.zeros(0) if self.margin is None else self.margin[np.isfinite(self.margin)]
        return float(known.min()) if len(known) else float('nan')

    def arrows(self) -> np.ndarray:
        """Return points [m] and forces [N] on shells (k, 2, 3), as `contact_arrows`."""
        return contact_arrows(self.bodies, self.point, self.force)

    def resultants(self, body_count: int) -> np.ndarray:
        """
        Sum the contact forces and torques on each body.

        Parameters
        ----------
        body_count
            Bodies of the scene, n.

        Returns
        -------
        (n, 6) forces [N] and torques about the centres [N m], world frame.
        """
        wrenches = np.zeros((body_count, 6))
        np.add.at(wrenches, self.bodies[:, 0], self.wrench_on_first)
        shells = self.bodies[:, 1] >= 0
        np.add.at(wrenches, self.bodies[shells, 1], self.wrench_on_second[shells])
        return wrenches


def contact_arrows(bodies: np.ndarray, point: np.ndarray, force: np.ndarray) -> np.ndarray:
    """
    Return points and forces of contacts on shells.

    Parameters
    ----------
    bodies
        (m, 2) numbers; the second one -1 - k: plane k.
    point
        (m, 3) [m].
    force
        (m, 3) [N] on the first bodies.

    Returns
    -------
    (k, 2, 3) points [m] and forces [N]: those on first bodies, followed by those on second bodies.
    """
    arrows = np.stack([point, force], axis=1)
    shells = bodies[:, 1] >= 0
    return np.concatenate([arrows, np.stack([point[shells], -force[shells]], axis=1)])


@dataclass(frozen=True, repr=False, eq=False)
class Reactions(AsTable):
    """
    Reactions of supports, drives, anchors and planes on bodies, in this order; world frame.

    The sum of reactions, weight, fields, drag and loads is the rate of change of the momentum. If
    two supports hold the same degree of freedom of a body, the reaction counts for the first one.
    """

    names: tuple[str, ...]  # supports.NAME, drives.NAME, anchors.NAME, planes.NAME
    # (k, 3) [m] mean of the present centres of its bodies; of an anchor its point in the world, of
    # a plane the foot of the perpendicular from the origin at the start, moved with the plane
    point: np.ndarray
    force: np.ndarray  # (k, 3) [N] on all of its bodies
    torque: np.ndarray  # (k, 3) [N m] about that point
    # (n, 6) forces [N] and torques about its centre [N m] of supports and drives on each body, 0
    # along what is free.
    on_bodies: np.ndarray

    def __repr__(self) -> str:
        """Return the names of the supports, drives, anchors and planes."""
        return f'<Reactions: {", ".join(self.names) or "nothing bears"}>'

    def table(self) -> dict[str, list[Any]]:
        """Return the reactions as plain values: a list for each column, named with its unit."""
        return {
            'name': list(self.names), **_columns('point', 'm', self.point),
            **_columns('force', 'n', self.force), **_columns('torque', 'nm', self.torque)}


def _columns(name: str, unit: str, vectors: np.ndarray) -> dict[str, list[float]]:
    """Return the components of vectors (k, 3) by column name."""
    return {f'{name}_{axis}_{unit}': vectors[:, number].tolist()
            for number, axis in enumerate('xyz')}


class LoadCells:
    """
    Measurement of reactions and contacts of one run, without effect on the run.

    The measurement needs about 2 kB for each body.
    """

    def __init__(self, scene: Scene, packed: PackedScene) -> None:
        """Prepare the measurement for a `scene`."""
        self._scene, self._packed = scene, packed
        self._held = held_by_name(scene)
        model, layout = packed.model, packed.layout
        if model.supports is not None:
            model = model._replace(supports=pack_supports(packed.masses, None, layout))
        # Without the gyroscopic term, slopes of spins are torques over inertia.
        self._model = model._replace(contacts=None, gyration=None)
        # Masses and inertias of the six freedoms of each body.
        self._masses = np.repeat(np.column_stack(packed.masses), 3, axis=1)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of supports, drives, anchors and planes."""
        return names_of(self._scene.parameters)

    def contacts(self, driver: Driver, state: State) -> ContactForces:
        """
        Return the contacts in the `state` that the driver evaluated last, near its last search.
        """
        phase = driver.contact.phase
        planes = phase.setup.names if isinstance(phase, BroadPhase) else ()
        contacts = phase.contacts
        if contacts is None:
            empty = np.zeros((0, 3))
            return ContactForces(
                np.zeros((0, 2), np.int32), empty, empty, np.zeros(0), planes,
                np.zeros((0, 6)), np.zeros((0, 6)))
        assert isinstance(phase, BroadPhase)
        contact_look(contacts, state.position, state.orientation)
        which, found = contacts.aside[:, 9] > 0.0, contacts.aside.copy()
        _lose(contacts, found, state, driver.shown.stretches)
        found, bodies = found[which], phase.bodies[which]
        place = state.position[:, self._packed.layout.slot].T
        other = np.where(bodies[:, 1] >= 0, bodies[:, 1], bodies[:, 0])
        push = phase.setup.stiffness * found[:, :9]
        return ContactForces(
            bodies, found[:, 15:18] + 0.5 * (place[bodies[:, 0]] + place[other]), push[:, :3],
            found[:, 11].copy(), planes, push[:, :6],
            np.concatenate([-push[:, :3], push[:, 6:9]], axis=1))

    def reactions(
        self, driver: Driver, state: State, time: float, anchored: np.ndarray,
        displaced: np.ndarray
    ) -> Reactions:
        """
        Return the reactions in the `state` at `time` [s] that the driver evaluated last.

        `anchored` (a, 3) [m] are the world points of the anchors, `displaced` (k, 3) [m] the
        displacements of planes.
        """
        touching, packed = self.contacts(driver, state), self._packed
        loads = driver.trajectory.loads
        with driver.trajectory.evaluations.showing():
            driver.trajectory.evaluations.add()
        force = self._forces(loads, state, time)
        force += touching.resultants(len(force))
        inertial = self._inertial(self._path_acceleration(loads, state, time), state)
        position = packed.layout.gather(state.position)
        on_bodies, rows = np.zeros_like(force), []
        for mine in self._held.values():
            part = np.where(mine, inertial - force, 0.0)
            on_bodies += part
            rows.append(resultant(part, position, np.any(mine, axis=1)))
        for end, pull in zip(anchored, self._pulls(
                loads, state, time, anchored, driver.trajectory.anchor_breaks)):
            rows.append((end, pull, np.zeros(3)))
        for number, (plane, moved) in enumerate(zip(
                make_planes(self._scene.parameters), displaced)):
            mine, foot = touching.bodies[:, 1] == -1 - number, plane[3] * plane[:3] + moved
            push = touching.force[mine]
            moment = np.cross(position[touching.bodies[mine, 0]] - foot, push)
            moment += touching.wrench_on_first[mine, 3:]
            rows.append((foot, push.sum(axis=0), moment.sum(axis=0)))
        point, total, torque = (
            np.array([row[k] for row in rows]).reshape(-1, 3) for k in range(3))
        return Reactions(self.names, point, total, torque, on_bodies)

    def _pulls(
        self, loads: Loads, state: State, time: float, anchored: np.ndarray,
        breaks: AnchorBreaks | None
    ) -> np.ndarray:
        """Return the forces [N] of the anchors on their bodies, (a, 3); 0 for broken anchors."""
        anchors = list(self._scene.anchors.values())
        if not anchors:
            return np.zeros((0, 3))
        now = self._packed.layout.unpack(state)
        bodies = [anchor.body for anchor in anchors]
        axes = cosines_from_quaternions(now.orientation[bodies]).reshape(-1, 3, 3)
        arm = np.einsum('ai,aij->aj', np.array([anchor.arm for anchor in anchors]), axes)
        along = anchored - now.position[bodies] - arm
        length = np.linalg.norm(along, axis=1)
        extension, compression, natural = np.array([anchor.law for anchor in anchors]).T
        stretch = length - natural
        tension = np.where(stretch > 0.0, extension, compression) * stretch
        if loads.anchors is not None and loads.anchors.damping is not None:
            speed = motion_of_points(loads.anchors, np.arange(len(anchors)), time)[1]
            speed = speed - now.linear_velocity[bodies] - np.cross(
                now.angular_velocity[bodies], arm)
            tension += loads.anchors.damping * (
                (speed * along).sum(axis=1) / np.where(length > 0.0, length, np.inf))
        if breaks is not None:
            tension[breaks.broken] = 0.0
        # An anchor of zero length has no direction.
        return np.asarray(along * (tension / np.where(length > 0.0, length, np.inf))[:, None])

    def _inertial(self, acceleration: np.ndarray, state: State) -> np.ndarray:
        """Return the forces and torques (n, 6) that cause an `acceleration` (n, 6)."""
        moments = self._packed.principal_inertia
        if moments is None:
            return self._masses * acceleration
        _, orientation, _, spin = self._packed.layout.unpack(state)
        axes = turned_axes(self._packed.principal_axes, cosines_from_quaternions(orientation))
        own, turning = (
            np.einsum('bij,bj->bi', axes, values) for values in (spin, acceleration[:, 3:]))
        torque = moments * turning + np.cross(own, moments * own)
        return np.hstack([
            self._masses[:, :3] * acceleration[:, :3], np.einsum('bi,bij->bj', torque, axes)])

    def _forces(self, loads: Loads, state: State, time: float) -> np.ndarray:
        """
        Return the forces [N] and torques [N m] on all bodies (n, 6), without contacts and paths.
        """
        packed, layout = self._packed, self._packed.layout
        work = layout.room(
            packed.model.links, state, damped=packed.model.damping is not None,
            metered=packed.spends)
        work = work._replace(breakage=packed.breakage)
        if packed.external is not None:
            work = work._replace(given=layout.meter(), external=packed.external)
        power = aligned_empty((1, LANES * len(loads.wrench)))
        loads = loads._replace(power=power, lanes=np.where(
            _is_path(loads), 0, loads.lanes).astype(loads.lanes.dtype))
        there = layout.like(state)
        copy_state(state, there)
        slope = np.zeros((layout.slope_rows(state), layout.slot_count))
        last = len(self._model.blocks.slot)
        place_blocks(self._model, loads, there, work, time, 0, last)
        if work.external is not None:
            ask_alone(work.external, there, time)
        find_slopes(self._model, loads, there, work, time, slope, 0, 0, last)
        row = 12 if layout.cosines else 7
        return layout.gather(slope[row:row + 6]) * self._masses

    def _path_acceleration(self, loads: Loads, state: State, time: float) -> np.ndarray:
        """
        Return accelerations [m/s^2], [rad/s^2] prescribed by paths, (n, 6); 0 for other bodies.
        """
        layout, drives = self._packed.layout, loads.drives
        if drives is None:
            return np.zeros((layout.body_count, 6))
        rate = max(
            float(np.abs(drives.rate).max(initial=0.0)),
            float(np.abs(state.angular_velocity).max(initial=0.0)))
        span = _SETTINGS.max_time_s
        if rate > 0.0:
            span = min(span, _SETTINGS.max_angle / rate)
        ends = []
        for moment in (time - span, time + span):
            there = layout.like(state)
            copy_state(state, there)
            place_driven(
                without(self._model, *TERMS), without(loads, *BESIDE_DRIVES), there, moment)
            ends.append(np.concatenate([
                layout.gather(there.linear_velocity), layout.gather(there.angular_velocity)],
                axis=1))
        return np.asarray((ends[1] - ends[0]) / (2.0 * span))


def held_by_name(scene: Scene) -> dict[str, np.ndarray]:
    """Return degrees of freedom (n, 6) that each support and drive holds; each only once."""
    held = {}
    taken = np.zeros((scene.body_count, 6), bool)
    for name in scene.parameters.names('supports'):
        mine = np.zeros_like(taken)
        fixed = fixed_freedoms(scene.parameters, name)
        bodies = scene.groups[scene.parameters[f'supports.{name}.group']]
        for axis, word in enumerate(('tx', 'ty', 'tz')):
            mine[bodies, axis] = word in fixed
        mine[bodies, 3:] = 'rotation' in fixed
        held[f'supports.{name}'] = mine & ~taken
        taken |= mine
    for name, drive in scene.drives.items():
        mine = np.zeros_like(taken)
        mine[drive.bodies] = drive.freedoms
        held[f'drives.{name}'] = mine & ~taken
        taken |= mine
    return held


def _lose(
    contacts: Contacts, pushes: np.ndarray, state: State, stretches: np.ndarray | None
) -> None:
    """
    Add damping and friction to contact results `pushes` (p, 19) of a `state`.

    The law is that of the steps, with `stretches` (p, 4) [m] of the friction springs, on copies.
    """
    losses = contacts.losses
    if losses is None:
        return
    if stretches is None or stretches.shape != losses.stretch.shape:
        stretches = losses.stretch
    aside = losses._replace(
        power=losses.power.copy(), stretch=np.array(stretches), held=losses.held.copy(),
        slopes=losses.slopes.copy())
    lose_some(
        aside, contacts._replace(result=pushes, losses=aside), state, 0, 0, len(contacts.pairs))


def tensions_of(scene: Scene, snapshot: Snapshot) -> np.ndarray:
    """
    Return the tensions [N] of the connectors, (c,), by laws, dampers and Maxwell arms.

    The tension of a broken connector is 0. That of a damped connector wrapped over a shell is NaN.
    """
    connectors, length = scene.connectors, snapshot.connector_length
    if not len(length):
        return length
    laws, damping = connectors.laws, connectors.damping
    stretch = length - laws.natural_length
    tension = connectors.curves.replace(
        'tension', np.where(stretch > 0.0, laws.extension, laws.compression) * stretch, length,
        laws.extension, laws.natural_length)
    if np.any(damping):
        ends, bodies = snapshot.connector_ends, connectors.bodies
        arm = ends - snapshot.position[bodies]
        moving = snapshot.linear_velocity[bodies] + np.cross(
            snapshot.angular_velocity[bodies], arm)
        along = ends[:, 1] - ends[:, 0]
        rate = ((moving[:, 1] - moving[:, 0]) * along).sum(axis=1) / np.where(
            length > 0.0, length, np.inf)
        if snapshot.packed.model.wrapping is not None:
            # The ends of a wrapped connector do not determine the rate of its length.
            rate = np.where((snapshot.obstructed != 0) & (damping > 0.0), np.nan, rate)
        tension = tension + damping * rate
    return np.where(snapshot.intact, tension + snapshot.maxwell_tension, 0.0)


def names_of(parameters: Parameters) -> tuple[str, ...]:
    """Return the names of supports, drives, anchors and planes of a scene."""
    return tuple(
        f'{section}.{name}' for section in ('supports', 'drives', 'anchors', 'planes')
        for name in parameters.names(section))


def _is_path(loads: Loads) -> np.ndarray:
    """Return which rows of the loads put bodies on a path, (m,) bool."""
    if loads.drives is None:
        return np.zeros(len(loads.wrench), bool)
    number = -1 - loads.wrench
    return np.asarray((number >= 0) & (number < len(loads.drives.start)))


def resultant(
    wrench: np.ndarray, position: np.ndarray, mine: np.ndarray
) -> tuple[np.ndarray, Any, Any]:
    """
    Return the mean position [m] of the chosen bodies, and the sum of their wrenches about it.
    """
    if not mine.any():
        return np.zeros(3), np.zeros(3), np.zeros(3)
    point = position[mine].mean(axis=0)
    force = wrench[mine, :3]
    torque = wrench[mine, 3:] + np.cross(position[mine] - point, force)
    return point, force.sum(axis=0), torque.sum(axis=0)
