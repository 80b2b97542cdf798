# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Packing of a scene into the constants that kernels take."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
import math
from typing import Any, NamedTuple

from icofabric_sim.kernels.records import Breakage, Loads, Model, Moments, State
from icofabric_sim.kernels.records import Supports as PackedSupports
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.scene.attachments import has_own_attachments
from icofabric_sim.scene.connector_laws import ConnectorCurves, ConnectorLaws
from icofabric_sim.scene.custom_connectors import CustomConnectors
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.scene.masses import BodyMasses
from icofabric_sim.scene.maxwell import MaxwellArms
from icofabric_sim.scene.paths import PathPiece
from icofabric_sim.scene.profiles import Piece, STEADY_PROFILE
from icofabric_sim.scene.scene import Scene, SceneConnectors
from icofabric_sim.scene.supports import Supports
from icofabric_sim.simulation.contact.setup import ContactSetup, pack_contact
from icofabric_sim.simulation.inputs.driving import DrivePack
from icofabric_sim.simulation.model.arms import carried_lengths, lengths_of, pack_arms
from icofabric_sim.simulation.model.body_force import BodyForce
from icofabric_sim.simulation.model.connector_moments import pack_moments
from icofabric_sim.simulation.model.damping import pack_damping
from icofabric_sim.simulation.model.electric import pack_coulomb, pack_dipole, pack_magnet
from icofabric_sim.simulation.model.layout import (
    aligned_empty,
    aligned_zeros,
    Layout,
    make_layout,
    make_links,
    pieces,
)
from icofabric_sim.simulation.model.link_places import link_places, LinkPlaces, pack_breakage
from icofabric_sim.simulation.model.shells import pack_own_shells
from icofabric_sim.simulation.model.ties import pack_ties
from icofabric_sim.simulation.model.tractions import pack_tractions, TractionPack, TractionRow
from icofabric_sim.simulation.model.unbalanced import unbalanced_rate
from icofabric_sim.simulation.model.wrapping import pack_wrapping
from icofabric_sim.terms.anchors.record import Anchors, Waves
from icofabric_sim.terms.body_force.external_force import External
from icofabric_sim.terms.drag.record import Drag
from icofabric_sim.terms.drives.record import Drives
from icofabric_sim.terms.gravity.record import Gravity
from icofabric_sim.terms.gyration import Gyration
from icofabric_sim.terms.masses import Masses
from icofabric_sim.terms.profiles import Varying
from icofabric_sim.terms.registry import TERMS
from icofabric_sim.terms.shared import Connectors, LINK_COUNT
import numpy as np

# Runge-Kutta methods need 1.7 kB more for each body: larger fabrics do not use them.
_MAX_RUNGE_KUTTA_BODIES = 50_000

_ZERO_VECTOR = np.zeros(3)
# Stiffness on one side of the natural length over that on the other up to which a connector is
# slack there: the period is 10 times as long or more.
_SLACK_STIFFNESS_RATIO = 1e-2
# Terms with a velocity-dependent force that takes no energy, or only in some scenes.
_OFTEN_LOSSLESS = ('ties', 'wrapping', 'contacts', 'magnet')


class WrenchRow(NamedTuple):
    """A wrench on some bodies, and the profile that scales it."""

    bodies: np.ndarray  # (m,) int32
    in_body_axes: bool
    force: np.ndarray  # (3,) [N]
    torque: np.ndarray  # (3,) [N m]
    point: np.ndarray = _ZERO_VECTOR  # (3,) [m], body axes
    piece: Piece = STEADY_PROFILE.pieces[0]  # at times of the run
    normal: np.ndarray = _ZERO_VECTOR  # (3,) body axes: only the force component along it acts


class AnchorPack(NamedTuple):
    """Bodies, arms, paths and laws of all anchors for the kernels."""

    bodies: tuple[int, ...]
    arms: tuple[np.ndarray, ...]
    pieces: tuple[PathPiece, ...]  # at times of the run
    laws: np.ndarray  # (a, 4) k_e [N/m], k_c [N/m], D [m], damping [N s/m]
    waving: bool  # a point has a sine motion at some time
    damped: bool


@dataclass(frozen=True)
class ConnectorList:
    """List of the connectors of a scene, built on first access and left out of pickles."""

    connectors: SceneConnectors
    half_width: float
    # (6 + 2 m, 3) attachment points in body axes [m]; None: on the axes
    points: np.ndarray | None

    @cached_property
    def listed(self) -> Connectors:
        """Connectors in the form that kernels take."""
        bodies, edges = self.connectors.bodies, self.connectors.edges
        return Connectors(
            bodies[:, 0], bodies[:, 1], edges[:, 0], edges[:, 1], *self.connectors.laws,
            self.half_width, self.points)

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields without the list."""
        return {name: value for name, value in vars(self).items() if name != 'listed'}


@dataclass(frozen=True)
class PackedScene:
    """A scene as arrays: for the kernels of motion, and connector by connector."""

    model: Model
    layout: Layout
    connector_list: ConnectorList | None
    laws: ConnectorLaws | None  # of the connectors
    moments: Moments | None
    curves: ConnectorCurves
    gravity: np.ndarray | None  # (3,) [m/s^2]
    field_force: np.ndarray | None  # (3,) [N] of a uniform electric field on every body
    # Largest rate [1/s] at which forces that depend on velocities change these.
    velocity_rate: float
    breakage: Breakage | None
    body_force: BodyForce | None
    external: External | None
    contact: ContactSetup | None
    masses: BodyMasses
    held: bool  # by supports
    anchors_damped: bool
    arms: MaxwellArms | None  # of connectors
    principal_inertia: np.ndarray | None  # (n, 3) [kg m^2] of bodies that are not isotropic
    principal_axes: np.ndarray | None  # (n, 3, 3) in body axes, by rows; None: the body axes
    woven: slice  # numbers of the connectors of the weave
    custom: CustomConnectors | None  # the others

    @cached_property
    def goes_slack(self) -> bool:
        """
        True if a connector is so soft on one side of its natural length that bodies move freely.
        """
        laws = self.laws
        if laws is None:
            return False
        soft = np.minimum(laws.extension, laws.compression)
        stiff = np.maximum(laws.extension, laws.compression)
        return bool((soft <= _SLACK_STIFFNESS_RATIO * stiff).any())

    @property
    def connectors(self) -> Connectors | None:
        """List of single connectors; None without connectors."""
        return None if self.connector_list is None else self.connector_list.listed

    def __getstate__(self) -> dict[str, Any]:
        """
        Return the fields without compiled code and addresses, which are valid in one process.
        """
        return {**vars(self), 'body_force': None, 'external': None}

    @property
    def spends(self) -> bool:
        """True if forces dissipate energy."""
        model = self.model
        return self.anchors_damped or (
            model.ties is not None and model.ties.damping is not None) or (
            self.contact is not None and self.contact.spends) or any(
            getattr(model, term.name) is not None for term in TERMS
            if term.has('velocity_force') and term.name not in _OFTEN_LOSSLESS)

    def pack(self, initial: InitialState, rest: np.ndarray | None = None) -> State:
        """
        Return the state for kernels from that of the bodies.

        The springs of Maxwell arms are relaxed, or have rest lengths `rest` [m], (c,).
        """
        state, places = self.layout.pack(initial), self._arm_places
        if places is None or self.connectors is None:
            return state
        rows = aligned_zeros((LINK_COUNT, self.layout.slot_count))
        rows[places.link, places.slot] = (
            lengths_of(self.connectors, self.model, initial) if rest is None else rest)[self.woven]
        return state._replace(rest=rows)

    def carry(
        self, previous: 'PackedScene', rest: np.ndarray | None, initial: InitialState
    ) -> np.ndarray | None:
        """
        Return rest lengths [m] of Maxwell springs after a change of the scene.

        `rest` (c,) are those of the `previous` scene.
        """
        arms, before, after = previous.arms, previous.connectors, self.connectors
        if self.arms is None or after is None:
            return None
        length = lengths_of(after, self.model, initial)
        if arms is None or rest is None or before is None:
            return length
        held = np.broadcast_to(arms.stiffness > 0.0, rest.shape)
        return carried_lengths(before, rest, held, after, length)

    def rest_lengths(self, state: State) -> np.ndarray | None:
        """Return the rest lengths [m] of the springs of Maxwell arms, (c,); None without arms."""
        places = self._arm_places
        if places is None or state.rest is None:
            return None
        # Equal at either end; 0 of custom connectors.
        woven = state.rest[places.link[0], places.slot[0]]
        more = 0 if self.custom is None else len(self.custom.bodies)
        return np.append(woven, np.zeros(more))

    @cached_property
    def _arm_places(self) -> LinkPlaces | None:
        """Indices of the connectors in the rows of a state; None without Maxwell arms."""
        if self.model.maxwell is None or self.model.links is None or self.connectors is None:
            return None
        return link_places(self.layout, self.model.links, self.connectors, self.woven)


def pack_scene(
    scene: Scene, *, cosines: bool = False, body_force: BodyForce | None = None
) -> PackedScene:
    """Return the constants of the scene; a term that the scene lacks is None."""
    # Eq 43: one number stands for the inertia tensor.
    masses = scene.masses
    # Bounds use the lightest body.
    mass, inertia = float(masses.mass.min()), float(masses.inertia.min())
    gravity, electric = np.array(scene.parameters['gravity']), scene.electric
    # On equal charges a uniform field is an acceleration like gravity.
    fall = gravity + electric.force / mass
    grid = scene.weave.grid
    layout = make_layout(
        grid, scene.body_count, cosines=cosines, carriers=len(scene.platens))
    connector_list = links = supports = damping = maxwell = breakage = None
    woven = scene.woven
    if scene.connector_count:
        connector_list = list_connectors(scene)
    if len(woven):
        layout, links = make_links(
            layout, grid, scene.weave.connections, laws=woven.laws, half_width=_half_width(scene),
            attachment=woven.attachment if has_own_attachments(scene.parameters) else None,
            curves=woven.curves)
        damping = pack_damping(woven, layout, links)
        maxwell = pack_arms(woven, layout, links)
        if woven.limits is not None:
            breakage = pack_breakage(
                layout, links, list_connectors(scene, woven).listed, woven.limits)
    drag = Drag(scene.parameters['drag.linear'], scene.parameters['drag.angular'])
    # Carriers of planes differ from bodies, see terms/platens.
    uniform = masses.all_equal and not scene.platens
    if scene.supports is not None or not uniform:
        supports = pack_supports(masses, scene.supports, layout)
    resisting = pack_moments(scene, layout, links)
    terms: dict[str, Any] = {
        'ties': pack_ties(scene.custom, layout),
        'wrapping': None if links is None else pack_wrapping(
            scene.parameters, scene.geometry.half_edge),
        'bending': resisting.bending,
        'twisting': resisting.twisting,
        'damping': damping,
        'maxwell': maxwell,
        'gravity': Gravity(fall) if fall.any() else None,
        'drag': drag if any(drag) else None,
        'magnet': pack_magnet(electric, masses, layout),
        'dipole': pack_dipole(electric),
        'coulomb': pack_coulomb(electric, layout)}
    model = Model(
        inverse_mass=1.0 / mass,
        inverse_inertia=1.0 / inertia,
        blocks=layout.blocks,
        links=links,
        supports=supports,
        shells=pack_own_shells(scene, layout),
        masses=None if uniform else Masses(
            _spread_masses(masses.mass, layout), _spread_masses(masses.inertia, layout),
            float(masses.mass.max()), float(masses.inertia.max())),
        gyration=_pack_gyration(scene, layout),
        **terms)
    external = None
    if body_force is not None:
        external = body_force.prepare(layout, np.hstack(scene.initial))
    return PackedScene(
        model, layout, connector_list, None if connector_list is None else scene.connectors.laws,
        resisting.moments, scene.connectors.curves,
        gravity if gravity.any() else None, electric.force if electric.force.any() else None,
        velocity_rate(model) + _own_rate(scene, model), breakage, body_force, external,
        pack_contact(scene, fall), masses, scene.supports is not None, scene.anchors_damped,
        scene.connectors.arms,
        scene.principal_inertia, scene.principal_axes, slice(0, len(woven)), scene.custom)


def _spread_masses(values: np.ndarray, layout: Layout) -> np.ndarray:
    """Return masses or inertias (1, s), 0 where no body is."""
    return layout.spread(np.broadcast_to(values, layout.body_count)[:, None])


def _pack_gyration(scene: Scene, layout: Layout) -> Gyration | None:
    if scene.principal_inertia is None:
        return None
    tilted = scene.principal_axes
    return Gyration(
        layout.spread(
            scene.principal_inertia / scene.principal_inertia.min(axis=1, keepdims=True),
            empty=1.0),
        None if tilted is None else layout.spread(tilted.reshape(-1, 9)))


def pack_supports(
    masses: BodyMasses, supports: Supports | None, layout: Layout
) -> PackedSupports:
    """Return inverse masses of bodies, 0 along supported freedoms, and of carriers of planes."""
    count = layout.body_count
    mass = np.broadcast_to(1.0 / masses.mass[:, None], (count, 3))
    inertia = np.broadcast_to(1.0 / masses.inertia, count)
    if supports is not None:
        mass = np.where(supports.translation, 0.0, mass)
        inertia = np.where(supports.rotation, 0.0, inertia)
    packed = PackedSupports(layout.spread(mass), layout.spread(inertia[:, None]))
    packed.inverse_mass[:, layout.carriers] = -1.0
    return packed


def velocity_rate(model: Model) -> float:
    """
    Return a bound [1/s] of the rates at which forces that depend on velocities change velocities.

    These forces are damping, drag and magnetic forces; the creep rate of Maxwell arms is included.

    The power of damping is the sum of c (n . du)^2 over the connectors, where du = du_2 - du_1 is
    the relative velocity of their ends. (n . du)^2 <= 2 (n . du_1)^2 + 2 (n . du_2)^2, and (n .
    du_i)^2 <= (1/M + s^2/Lambda) times twice the kinetic energy of body i. A body has up to 12
    connectors at the distance s from its centre; for connectors wrapped over shells, s is at most
    the distance of a corner.
    """
    rate, mass, inertia = 0.0, model.inverse_mass, model.inverse_inertia
    if model.damping is not None and model.links is not None:
        square = model.links.half_width**2
        if model.wrapping is not None:
            square = max(square, float((model.wrapping.corners[0]**2).sum()))
        rate += 2 * LINK_COUNT * model.damping.coefficient * (mass + square * inertia)
    if model.maxwell is not None:
        rate += model.maxwell.rate
    if model.drag is not None:
        rate += max(model.drag.linear * mass, model.drag.angular * inertia)
    if model.magnet is not None:
        magnet = model.magnet
        own = np.maximum(np.abs(magnet.charge) * mass, np.abs(magnet.second) * inertia)
        own = own + np.linalg.norm(magnet.moment, axis=0) * (mass * inertia) ** 0.5
        rate += float(own.max()) * float(np.linalg.norm(magnet.field))
    return rate


def _own_rate(scene: Scene, model: Model) -> float:
    """
    Return a bound [1/s] of the rates at which damping of anchors and custom connectors acts.

    The bound is that of `velocity_rate`, with the points of each.
    """
    ends = [(anchor.body, anchor.arm, anchor.damping) for anchor in scene.anchors.values()]
    if scene.custom is not None:
        ends += [
            (body, point, 2.0 * damping) for pair, points, damping in zip(
                scene.custom.bodies.tolist(), scene.custom.points, scene.custom.damping.tolist())
            for body, point in zip(pair, points)]
    rates: dict[int, float] = {}
    for body, arm, damping in ends:
        rates[body] = rates.get(body, 0.0) + damping * (
            model.inverse_mass + float(arm @ arm) * model.inverse_inertia)
    return max(rates.values(), default=0.0)


def list_connectors(scene: Scene, connectors: SceneConnectors | None = None) -> ConnectorList:
    """Return the connectors of a scene, by default all, in the form that kernels take."""
    connectors = scene.connectors if connectors is None else connectors
    given = has_own_attachments(scene.parameters) or len(connectors) > len(scene.woven)
    return ConnectorList(
        connectors, _half_width(scene), connectors.attachment if given else None)


def _half_width(scene: Scene) -> float:
    """Return the distance [m] of the farthest attachment point from the centre."""
    if has_own_attachments(scene.parameters):
        return float(np.linalg.norm(scene.woven.attachment, axis=1).max())
    scale: float = scene.parameters['connector.attachment_scale']
    return 0.5 * scene.geometry.cube_width * scale


def pack_loads(
    rows: Iterable[WrenchRow],
    layout: Layout,
    *,
    stages: int = 0,
    varying: bool = False,
    tractions: TractionPack | None = None,
    drives: DrivePack | None = None,
    anchors: AnchorPack | None = None,
) -> Loads:
    """
    Pack wrenches for the kernels: a row for every block with loaded bodies.

    Rows follow the order of the blocks, and within a block the order of `rows`. `stages` is the
    number of slopes of a Runge-Kutta step; `varying` allows factors other than 0 and 1. No wrench
    acts on bodies whose degrees of freedom are all prescribed by `drives`: reactions of the drives
    balance such wrenches.
    """
    parts, members = _without_turned(list(rows), drives)
    count = len(layout.blocks.slot)
    blocks, wrenches = [np.zeros(0, np.int32)], [np.zeros(0, np.int32)]
    lanes = [np.zeros(0, np.uint8)]
    surfaces: Sequence[TractionRow] = () if tractions is None else tractions.rows
    members += [(len(parts) + number, row.sums.bodies) for number, row in enumerate(surfaces)]
    if drives is not None:
        driven = np.zeros(layout.body_count, bool)
        for row in drives.rows:
            if row.moves.all():
                driven[row.bodies] = True
        members = [(number, bodies[~driven[bodies]]) for number, bodies in members]
        members += [(-1 - path, row.bodies) for path, row in enumerate(drives.rows)]
    paths = 0 if drives is None else len(drives.rows)
    first_plane = paths - len(layout.carriers)
    if anchors is not None:
        members += [
            (-1 - paths - number, np.array([body], np.int32))
            for number, body in enumerate(anchors.bodies)]
    for number, bodies in members:
        slots = layout.slot[bodies]
        if first_plane <= -1 - number < paths:
            slots = layout.carriers[-1 - number - first_plane, None]
        block, bits = layout.block_at(slots), np.zeros(count, np.uint8)
        np.bitwise_or.at(bits, block, (1 << slots % LANES).astype(np.uint8))
        own = np.flatnonzero(bits).astype(np.int32)
        blocks.append(own)
        lanes.append(bits[own])
        wrenches.append(np.full(len(own), number, np.int32))
    block, wrench = np.concatenate(blocks), np.concatenate(wrenches)
    order = np.argsort(block, kind='stable')
    start = np.zeros(count + 1, np.int32)
    np.cumsum(np.bincount(block, minlength=count), out=start[1:])

    def column(field: str) -> np.ndarray:
        return np.array([getattr(part, field) for part in parts], dtype=float).reshape(-1, 3)

    def room(*rows: int) -> np.ndarray:
        array = aligned_empty((*rows, LANES * len(block)))
        array[:] = 0.0
        return array

    packed: dict[str, Any] = {
        'tractions': None if tractions is None else pack_tractions(
            tractions, layout, len(parts), block[order], wrench[order],
            np.concatenate(lanes)[order]),
        'drives': None if drives is None else _pack_drives(drives, layout),
        'anchors': None if anchors is None else _pack_anchors(anchors, paths)}
    return Loads(
        start=start,
        wrench=wrench[order],
        lanes=np.concatenate(lanes)[order],
        turning=np.array([255 if part.in_body_axes else 0 for part in parts], dtype=np.uint8),
        force=column('force'),
        torque=column('torque'),
        point=column('point'),
        work=room(),
        earlier_work=room(),
        power=room(stages),
        varying=_varying(
            [part.piece for part in parts] + [row.piece for row in surfaces]) if varying else None,
        **packed)


def _without_turned(
    rows: list[WrenchRow], drives: DrivePack | None
) -> tuple[list[WrenchRow], list[tuple[int, np.ndarray]]]:
    """
    Return the wrenches, and the bodies of each by its number.

    Torques on bodies with driven rotation and free translation are left out: reactions of the
    drives balance them.
    """
    turned = [row.bodies for row in (() if drives is None else drives.rows)
              if row.moves[3] and not row.moves.all()]
    if not turned:
        return rows, [(number, row.bodies) for number, row in enumerate(rows)]
    parts: list[WrenchRow] = []
    members: list[tuple[int, np.ndarray]] = []
    for row in rows:
        mine = np.isin(row.bodies, np.concatenate(turned))
        for bodies, part in (
                (row.bodies[~mine], row),
                (row.bodies[mine], row._replace(torque=_ZERO_VECTOR, point=_ZERO_VECTOR))):
            if len(bodies):
                members.append((len(parts), bodies))
                parts.append(part)
    return parts, members


def _varying(pieces: list[Piece]) -> Varying:
    table = np.array(pieces, dtype=float).reshape(-1, len(Piece._fields))
    start, value, slope, height, rate, peak = np.ascontiguousarray(table.T)
    return Varying(start, value, slope, height, rate, peak)


def _pack_drives(drives: DrivePack, layout: Layout) -> Drives:
    def column(field: str, *shape: int) -> np.ndarray:
        values = [getattr(row.piece, field) for row in drives.rows]
        return np.array(values, dtype=float).reshape(len(values), *shape)

    return Drives(
        start=column('start'),
        cubic=column('cubic', 4, 6),
        wave=column('wave', 6),
        rate=column('rate'),
        phase=column('phase'),
        base=column('shift', 3) + np.array([row.middle for row in drives.rows]),
        turn=column('turn', 4),
        arm=layout.spread(drives.arm),
        first=layout.pack(drives.start).orientation,
        moves=np.array([row.moves for row in drives.rows], dtype=np.uint8),
    )


def _pack_anchors(anchors: AnchorPack, paths: int) -> Anchors:
    waves, laws = np.array([piece.wave for piece in anchors.pieces])[:, :3], anchors.laws
    return Anchors(
        first=paths,
        start=np.array([piece.start for piece in anchors.pieces]),
        cubic=np.ascontiguousarray(
            np.array([piece.cubic for piece in anchors.pieces], dtype=float)[:, :, :3]),
        arm=np.array(anchors.arms),
        extension=laws[:, 0].copy(),
        compression=laws[:, 1].copy(),
        natural_length=laws[:, 2].copy(),
        waves=None if not anchors.waving else Waves(
            waves.copy(), np.array([piece.rate for piece in anchors.pieces]),
            np.array([piece.phase for piece in anchors.pieces])),
        damping=laws[:, 3].copy() if anchors.damped else None,
    )


def acting_lanes(loads: Loads) -> tuple[np.ndarray, np.ndarray]:
    """Return row and lane of every body under a wrench."""
    row, lane = np.nonzero(
        np.unpackbits(loads.lanes[:, None], axis=1, count=LANES, bitorder='little'))
    return row, lane


def load_rate(loads: Loads, model: Model, size: float) -> float:
    """Return the rate [rad/s] of loads: `force_rate`, or the larger rate of factors and paths."""
    # Steps must also resolve the factors and paths.
    own = 0.0 if loads.varying is None else float(loads.varying.rate.max(initial=0.0))
    if loads.drives is not None:
        own = max(own, float(loads.drives.rate.max()))
    if loads.anchors is not None and loads.anchors.waves is not None:
        own = max(own, float(loads.anchors.waves.rate.max()))
    return max(force_rate(loads, model, size), own)


def force_rate(loads: Loads, model: Model, size: float) -> float:
    """
    Return the rate [rad/s] at which loads alone would move a free body by `size` [m] or turn it.

    The rate is infinite if a load overflows.
    """
    if not (loads.wrench >= 0).any():
        return 0.0
    with np.errstate(over='ignore', invalid='ignore'):
        force = np.linalg.norm(loads.force, axis=1)
        moment = np.linalg.norm(loads.torque, axis=1)
        moment += np.linalg.norm(loads.point, axis=1) * force
        square = force * (model.inverse_mass / size) + moment * model.inverse_inertia
        block = np.repeat(np.arange(len(loads.start) - 1), np.diff(loads.start))
        row, lane = acting_lanes(loads)
        wrenches = loads.wrench[row] >= 0
        row, lane = row[wrenches], lane[wrenches]
        wrench = loads.wrench[row]
        plain = np.full(len(row), True)
        if loads.tractions is not None:
            plain = wrench < loads.tractions.first
        rates = np.zeros(len(row))
        rates[plain] = square[wrench[plain]]
        if loads.tractions is not None:
            at = LANES * loads.tractions.place[row[~plain]] + lane[~plain]
            rates[~plain] = (
                loads.tractions.force[at] * (model.inverse_mass / size)
                + loads.tractions.moment[at] * model.inverse_inertia)
        if loads.varying is not None:
            rates *= loads.varying.peak[wrench]
        largest = np.bincount(LANES * block[row] + lane, rates).max()
    if not largest < np.inf:
        return np.inf
    return float(np.sqrt(largest))


def expected_liveliness(
    scene: Scene, model: Model, loads: Loads, frequency: float
) -> float:
    """
    Estimate the largest speed over a, or spin, [1/s] of a run.

    Initial velocities, loads, weight, pre-stress, drives and anchors contribute. Loads and weight
    accelerate bodies until the fabric responds or the run ends. The response takes as many radians
    of the fastest vibration as the fabric has bodies in a row.
    """
    initial, half_edge = scene.initial, scene.geometry.half_edge
    speed = _fastest(initial.linear_velocity) / half_edge
    spin = _fastest(initial.angular_velocity)
    duration = scene.parameters['duration'] or np.inf
    answer = float(np.ptp(scene.weave.grid, axis=0).max() + 1) if len(scene.weave.grid) else 1.0
    if frequency > 0.0:
        duration = min(duration, answer / frequency)
    rate = load_rate(loads, model, half_edge)
    acceleration = rate * rate if rate < 1e150 else 0.0
    if model.gravity is not None and scene.supports is not None:
        acceleration += float(np.linalg.norm(model.gravity.acceleration)) / half_edge
    growth = acceleration * duration if duration < np.inf else 0.0
    # Connectors and anchors that do not balance as woven let go of energy within a radian, a
    # displaced start within a period; neither gives more than motion through a body's own size in
    # that time.
    released = unbalanced_rate(scene) / frequency if frequency > 0.0 else 0.0
    displaced = _farthest_apart(initial.position, scene.position) / half_edge * frequency
    for drive in scene.drives.values():
        fastest, turning = drive.path.fastest
        speed, spin = max(speed, fastest / half_edge), max(spin, turning)
    for path in (*scene.platens.values(), *(anchor.path for anchor in scene.anchors.values())):
        speed = max(speed, path.fastest[0] / half_edge)
    return max(speed, spin, growth, float(min(max(displaced, released), frequency)))


def _fastest(velocity: np.ndarray) -> float:
    """Return the largest speed or spin of bodies, (n, 3)."""
    return math.sqrt(max(
        float((velocity[piece]**2).sum(axis=1).max()) for piece in pieces(len(velocity))))


def _farthest_apart(one: np.ndarray, other: np.ndarray) -> float:
    """Return the largest difference of a coordinate."""
    if one is other:
        return 0.0
    return max(
        float(np.abs(one[piece] - other[piece]).max()) for piece in pieces(len(one)))


def expected_strain(scene: Scene, liveliness: float, frequency: float) -> float:
    """
    Return the relative change of connector lengths within a radian of the fastest vibration.

    `liveliness` [1/s] is the speed over a. The result is 0 for a fabric that is too large for
    Runge-Kutta methods.
    """
    lengths = scene.woven.laws.natural_length
    # Tabulated laws have one length for each connector: none without connectors.
    if not (frequency > 0.0 and 0 < scene.body_count <= _MAX_RUNGE_KUTTA_BODIES and len(lengths)):
        return 0.0
    length = float(lengths.min())
    return liveliness * scene.geometry.half_edge / (length * frequency)
