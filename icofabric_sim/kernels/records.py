# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Records that kernels take: packed constants, the evolving state, the inputs.

Arrays have their slots last: slot s of a body is its index in all of them (layout.py). Bodies that
are computed together are therefore adjacent. A term that a scene lacks is None and not compiled.
If its class has a method `absent`, the term is compiled and skipped at run time.
"""

from typing import Any, TYPE_CHECKING

from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.terms.registry import LAWS, TERMS
from icofabric_sim.terms.shared import Blocks, Links, State, Supports
import numpy as np


class Connectors(Record):
    """
    Springs between edge midpoints, one by one; the arrays have shape (c,), or (1,) for all alike.
    """

    first: np.ndarray  # int32, the lower body
    second: np.ndarray  # int32
    first_edge: np.ndarray  # int8 edge codes 0-5
    second_edge: np.ndarray
    extension: np.ndarray  # k_e [N/m]
    compression: np.ndarray  # k_c [N/m]
    natural_length: np.ndarray  # D [m]
    half_width: float  # centre to attachment point, w / 2 for edge midpoints [m]
    attachment: np.ndarray | None  # (6, 3) the points in body axes [m]; None: on the axes


class Laws(Record, parts={law.name: law.record for law in LAWS}):
    """Laws that replace springs, those of the registry; None: no connector follows it."""


class Shells(Record):
    """Faces of a shell relative to its attachment points, if these are not edge midpoints."""

    normals: np.ndarray  # (20, 3) outward unit normals, body axes
    depth: np.ndarray  # (6, 20) [m] of each point below each face; exactly 0 on it
    # Additional depth in individually sized shells [m], by slots (s,) and by bodies (n,).
    deeper: np.ndarray | None = None
    deeper_of_bodies: np.ndarray | None = None
    on_face: float = 0.0  # [m] a point this close to a face lies on it


class Wrapping(Record):
    """The shell that connectors wrap, and their paths over its edges, see kernels/wrap/path.py."""

    # (6, p, 3) of each attachment point: outward unit normals, body axes, of the 20 faces and of
    # planes through the point and an edge; (6, p) their heights over the centre [m]
    normals: np.ndarray
    heights: np.ndarray
    height: float  # of the faces over the centre [m]
    corners: np.ndarray  # (12, 3) [m], body axes
    points: np.ndarray  # (6, 3) attachment points [m], body axes
    shells: Shells | None  # None: these are the midpoints of the named edges
    # (6, q) int32, planes of each attachment point over which a connector is straight
    start: np.ndarray
    # (6, w, 10) for each path from an attachment point: a corner and the direction of its last
    # edge, the coordinate of the unfolded attachment point along that edge and its distance from
    # the edge, and the range of coordinates through which the path leads [m].
    ways: np.ndarray
    faces: np.ndarray  # (6, w, 2) int32, planes before and after the last edge of a path


class Moments(Record):
    """Bending and twisting by connectors; stiffnesses have shape (c,), or (1,) for all alike."""

    bodies: np.ndarray  # (c, 2) int32
    bending: np.ndarray  # [N m/rad]
    twisting: np.ndarray  # [N m/rad]
    # (c, 3) in the weave, from the first end, unit vectors: in body axes, or world axes where
    # woven orientations differ. The energy then takes rotations since then for orientations.
    direction: np.ndarray
    woven: np.ndarray | None  # (n, 4) woven orientations, where they differ


class Breakage(Record):
    """
    Lengths at which the connectors at each body break (eq 3), and arrays to detect the moment.

    Rows are (12, s), as those of a `Variety`.
    """

    longest: np.ndarray  # L_e [m], infinite: never
    shortest: np.ndarray  # L_c [m], 0: never
    length: np.ndarray  # [m] at the start of the step in progress, then at its end
    rate: np.ndarray  # [m/s] likewise
    excess: np.ndarray  # [m] beyond a limit within the last step, about; below 0: not reached
    moving: np.ndarray  # (18 s,) velocities [m/s] of the attachment points


class Masses(Record):
    """Masses and inertias of bodies that are not all alike."""

    mass: np.ndarray  # (1, s) [kg]
    inertia: np.ndarray  # (1, s) [kg m^2]
    largest_mass: float  # [kg]
    largest_inertia: float  # [kg m^2]


class Varying(Record):
    """
    Time profiles of the wrenches of a scene.

    A wrench is multiplied by s(t) = value + slope (t - start) + height sin(rate (t - start)).
    """

    start: np.ndarray  # (w,) [s]
    value: np.ndarray  # (w,)
    slope: np.ndarray  # (w,) [1/s]
    height: np.ndarray  # (w,)
    rate: np.ndarray  # (w,) [rad/s]
    peak: np.ndarray  # (w,) the largest |s|; not for kernels

    @classmethod
    def absent(cls) -> 'Varying':
        """Return the record that stands for None."""
        return cls(*(np.zeros(0) for _ in range(6)))


class Tractions(Record):
    """
    Surface forces, summed over the faces of each body, see kernels/tractions.py.

    A row for every block that a surface force acts on, with the numbers of all lanes adjacent.
    """

    first: int  # rows of the loads whose wrench is this or later are surface forces
    place: np.ndarray  # (m,) int64 number of a row of the loads among the r rows here
    # (6 LANES r,) force [N] and torque about the centre [N m] that turn with the body, body axes
    turning: np.ndarray | None
    # (12 LANES r,) force [N] of fixed direction, world axes, and first moments [N m]: the sum of
    # p F_k over the faces, p in body axes, for the world axes k = x, y, z
    fixed: np.ndarray | None
    # (45 LANES r,) [N], [N m] without friction: sums of n n F (xx, xy, xz, yy, yz, zz of body
    # axes, each along the three of the world) and of (p x n) n F (two body axes, one of the world)
    sliding: np.ndarray | None
    kept: np.ndarray  # (6 LANES r,) [N], [N m] wrench of the last kick, world axes
    force: np.ndarray  # (LANES r,) [N] bound of the force on each body; not for kernels
    moment: np.ndarray  # (LANES r,) [N m] bound of the torque


class Drives(Record):
    """Paths of driven bodies, see kernels/drives.py; world frame."""

    start: np.ndarray  # (p,) [s] start of the present interval of each path
    cubic: np.ndarray  # (p, 4, 6) [m], [rad], and by powers of [s]
    wave: np.ndarray  # (p, 6) [m], [rad]
    rate: np.ndarray  # (p,) [rad/s]
    phase: np.ndarray  # (p,) [rad]
    base: np.ndarray  # (p, 3) [m] middle of the bodies without displacement
    turn: np.ndarray  # (p, 4) x y z w: their rotation without displacement
    arm: np.ndarray  # (3, s) [m] from the middle to each body at the start
    first: np.ndarray  # orientations at the start, in the form of the state
    # (p, 4) uint8: whether they move along x, y, z, and turn; other freedoms stay free
    moves: np.ndarray


class SecondDerivatives(Record):
    """Second derivatives of the energy in blocks, of bodies or of pairs."""

    slots: np.ndarray  # (m,) or (m, 2)
    values: np.ndarray  # (m, 6, 6) or (m, 12, 12)


class Anchors(Record):
    """Connectors from bodies to points of the world, see kernels/anchors.py."""

    first: int  # paths of drives, whose numbers come before
    start: np.ndarray  # (a,) [s] start of the present interval of each point's path
    cubic: np.ndarray  # (a, 4, 3) [m], and by powers of [s], world frame
    arm: np.ndarray  # (a, 3) [m] from the centre to the end of the body, body axes
    extension: np.ndarray  # (a,) k_e [N/m]
    compression: np.ndarray  # (a,) k_c [N/m]
    natural_length: np.ndarray  # (a,) D [m]


class Loads(Record):
    """
    Wrenches, each on any number of bodies: a row for every block with such bodies, or no rows.
    """

    start: np.ndarray  # (b + 1,) int32: rows start[b] to start[b + 1] act on block b
    wrench: np.ndarray  # (m,) int32, which of the w wrenches; -1 - p: bodies are on path p,
    # or, from the number of paths on, at an anchor
    lanes: np.ndarray  # (m,) uint8, bit l: the wrench acts on lane l
    turning: np.ndarray  # (w,) uint8, all bits: force and torque turn with the bodies, or none
    force: np.ndarray  # (w, 3) [N]
    torque: np.ndarray  # (w, 3) [N m]
    point: np.ndarray  # (w, 3) [m], body axes, from the centre
    work: np.ndarray  # (m LANES,) [J] done so far, written by the drift
    earlier_work: np.ndarray  # (m LANES,) [J] at the start of the step in progress
    # (16, m LANES) [W] at the stages of a Runge-Kutta step; no rows for other methods
    power: np.ndarray
    varying: Varying | None
    tractions: Tractions | None
    drives: Drives | None
    anchors: Anchors | None


class Meter(Record):
    """Energy that flows at the bodies, integrated with the weights of a Runge-Kutta method."""

    power: np.ndarray  # (16, s) [W] at the stages
    done: np.ndarray  # (2, s) [J] so far, and at the start of the step in progress

    @classmethod
    def absent(cls) -> 'Meter':
        """Return the record that stands for None."""
        return cls(np.zeros((16, 0)), np.zeros((2, 0)))


class External(Record):
    """An external function that returns forces on the bodies, see kernels/external.py."""

    address: int  # of the C function
    slots: np.ndarray  # (n,) int32 of the bodies
    numbers: np.ndarray  # (n, 13) argument of the function
    result: np.ndarray  # (n, 6) forces [N] and torques [N m]
    rows: np.ndarray  # (6, s) forces and torques by slots
    status: np.ndarray  # (1,) int64, not 0 once the function has failed
    moment: np.ndarray  # (1,) [s] simulated time of the last call


class Contacts(Record):
    """
    Candidate pairs for contact before the next search: two bodies, or a body and a plane.

    Each pair is evaluated once; forces are summed at the bodies in the order of the pairs.
    """

    stiffness: float  # K [N/m]
    half_edge: float  # a [m]
    pairs: np.ndarray  # (p, 2) int32 slots, that of the lower body first; -1 - k: plane k
    planes: np.ndarray  # (k, 4) unit normal and offset [m]
    # (p, 19) for K = 1 N/m: force on the first [N], torques on both [N m], delta^2 / 2 [m^2],
    # delta and the deepest overlap [m], the axis (3) that last separated them, contact point (3),
    # squared contact area [m^4]
    result: np.ndarray
    start: np.ndarray  # (b + 1,) int32: entries start[b] to start[b + 1] act on block b
    slot: np.ndarray  # (e,) int32 of the body that an entry acts on, rising
    entry: np.ndarray  # (e,) int32: twice the number of the pair, 1 more: on its second body
    turns: np.ndarray  # int32, places of the blocks, by their first slots over LANES
    rows: np.ndarray  # (6, s) forces [N] and torques [N m]
    pushes: np.ndarray  # (b,) [J/s^2] their squares on each block, see contact/stiffness.py
    # (8 t,) [m] deepest overlap in the last evaluation, in all since the caller set it to zero,
    # and in the stages of a step with drives, for each thread
    deepest: np.ndarray
    tests: np.ndarray  # (8 t,) number of pairs tested so far
    latest: np.ndarray  # int64 (8 t,), the batch of pairs that each thread took last, -1: none
    earlier: np.ndarray  # int64, for each batch the one that its thread had taken before
    # (t, 8, 3) position and matrix of the first body, for each thread, in separate cache lines
    first: np.ndarray
    second: np.ndarray  # (t, 8, 3) and of the second
    aside: np.ndarray  # (p, 19) as result, for health checks
    scratch: Any  # scratch arrays for health checks, see contact/surface.py
    # Addresses of `touch_some` (contact/forces.py) and `found_gap` (contact/pair.py) for these
    # contacts; 0 as long as no bodies are near (runtime/outlined.py).
    touch_address: int
    gap_address: int
    sleep: 'Sleep'
    losses: 'ContactLosses | None' = None
    half_edges: np.ndarray | None = None  # (s,) [m] of each slot, if they differ


class Sleep(Record):
    """
    Pairs known to be apart until bodies have moved a certain distance, and the awake pairs.

    See kernels/contact/sleeping.py.
    """

    blocks: Blocks  # blocks whose motion is measured; without blocks no pair sleeps
    radius: float  # of the sphere around a body [m]
    free: bool  # the common motion of all bodies is subtracted
    position: np.ndarray  # (3, s) [m] at the last evaluation
    orientation: np.ndarray  # likewise, in the form of the state
    # (8 t,): [0] the path length so far [m], negative before the first evaluation; [2] to [4] the
    # position of the first body at the last evaluation [m]; [8 k + 1] the square of the largest
    # displacement since then in the blocks of thread k [m^2]
    path: np.ndarray
    until: np.ndarray  # (p,) [m] path length up to which a pair is apart; 0: now; -1: may touch
    looked: np.ndarray  # (p,) likewise for health checks, each of which starts from 0
    axis: np.ndarray  # (p, 3) the axis that last separated a pair
    # (p,) int32: pairs evaluated last, those of a batch at the start of the batch, then -1
    awake: np.ndarray


class ContactLosses(Record):
    """Dissipation of contacts, see kernels/contact/losses.py."""

    damping: float  # c [s/m]
    friction: float  # mu
    friction_stiffness: float  # k of the springs that stick [N/m]
    lag: float  # tau [s] of the dashpots parallel to them
    power: np.ndarray  # (p,) [W] dissipated by each pair in the last evaluation
    spent: np.ndarray  # (1, s) [W] by bodies: that of a pair counts at its first body
    # Stretches [m] of friction, (p, 4) each, no rows without friction: x, y, z in the world and
    # the rotation about the normal times the radius of the contact, see contact/losses.py. At the
    # state, and there without pairs that are apart; at the start of the step in progress; of the
    # stage in progress; at the last sound state.
    stretch: np.ndarray
    held: np.ndarray
    start: np.ndarray
    stage: np.ndarray
    saved: np.ndarray
    slopes: np.ndarray  # (16, p, 4) [m/s] at the stages
    # (6, s) velocity [m/s] and spin [rad/s] that bodies gained in the kick before their drift.
    # Added once more they give the velocities at the start of the next step. For the leapfrog.
    lead: np.ndarray
    # Forces and torques for K = 1 N/m by which losses have changed the force of each pair, (p, 9),
    # and the changes on the bodies, (6, s) [N], [N m].
    changes: np.ndarray
    lost: np.ndarray


class Gyration(Record):
    """Anisotropic inertias, see kernels/gyration.py."""

    # (3, s) principal moments of inertia about the body axes, over the smallest of the body
    moments: np.ndarray


class Model(Record, parts={
        term.name: term.record for term in TERMS if term.has('record')}):
    """Constants of a compiled scene; the record of each term of the registry is a field, too."""

    inverse_mass: float  # [1/kg] of all bodies, or of the lightest: see `masses`
    inverse_inertia: float  # [1/(kg m^2)] likewise; of the smallest principal moment
    blocks: Blocks
    links: Links | None
    supports: Supports | None
    shells: Shells | None = None
    wrapping: Wrapping | None = None
    contacts: Contacts | None = None
    masses: Masses | None = None
    gyration: Gyration | None = None

    if TYPE_CHECKING:
        def __getattr__(self, name: str) -> Any: ...


class Work(Record):
    """
    Quantities that depend on the state: attachment points, and accelerations at the end of a call.
    """

    # Attachment points [m], (18 s,): coordinate k of edge e of slot s at (3 e + k) stride + s,
    # where the stride is the number of slots; empty without links.
    points: np.ndarray
    acceleration: np.ndarray  # (6, s) linear [m/s^2], angular [rad/s^2]; without loads
    # Difference of the last positions and orientations at step ends, (7 or 12, m LANES) for m
    # blocks spread over the fabric, and its weights, see monitor.sample.
    difference: np.ndarray
    weights: np.ndarray
    # Sums of a health check, of each group of blocks and of all blocks (kernels/figures.py).
    figures: np.ndarray  # (g + 1, FIGURE_COUNT)
    group: int  # number of blocks in a group
    # Velocities of the attachment points [m/s], laid out like `points`; empty without damping.
    speeds: np.ndarray
    spent: Meter | None  # energy dissipated by forces
    given: Meter | None  # work of external forces
    trail: 'Trail | None'  # for Runge-Kutta methods
    breakage: Breakage | None  # if connectors can break
    external: External | None
    kinks: 'Kinks | None' = None  # for methods that keep their order if slopes jump


class Kinks(Record):
    """
    Connectors whose slope jumps at their natural length, within one step; see kernels/kinks.py.

    Rows by connectors at each body, as those of a `Variety`. Between steps only a state is stored
    in which no connector was near its kink: the state saves work, and changes no bit.
    """

    extension: np.ndarray  # (12, s) k_e [N/m]
    compression: np.ndarray  # (12, s) k_c [N/m]
    natural_length: np.ndarray  # (12, s) D [m]
    slope: np.ndarray  # (12, s) [N/m] of the side on which the step began
    # (48, s) [N] coefficients of powers of the time, as a fraction of the step, of the tension
    # that crossings add; after the stages (24, s) [N s] the remaining impulses at the end and half
    # a step before
    forces: np.ndarray
    start: np.ndarray  # (36, s) [m] stretch, h times its rate, h^2 / 2 times its derivative
    active: np.ndarray  # (b, 12) uint8: some lane has a crossing there
    before: np.ndarray  # (6, s) velocities [m/s] and spins [rad/s] before a kick
    rates: np.ndarray  # (18 s,) velocities [m/s] of the attachment points
    seconds: np.ndarray  # (18 s,) accelerations [m/s^2] of the attachment points
    found: np.ndarray  # (8 t,) whether a thread has found crossings in this step
    ranges: np.ndarray  # (8 t,) [m] results of each thread, see kernels/kinks.py
    # (3,) k_e and k_c [N/m] and natural length [m] if all connectors are alike; else zeros
    uniform: np.ndarray
    # (2,) stiffness [N/m] and natural length [m] of all connectors in this step; 0: not alike
    alike: np.ndarray
    # (3,) least distance [m] of a connector from its kink in the stored state, 0: no state is
    # stored; 1 or -1 if all were longer, or all shorter, than the natural length; and the number
    # of steps with crossings, each of which evaluates the forces once more
    margin: np.ndarray
    kept_position: np.ndarray  # (3, s) [m]
    kept_orientation: np.ndarray  # (4, s) or (9, s)


class Trail(Record):
    """Slopes and states of the last Runge-Kutta step."""

    slopes: np.ndarray  # (16, r, s), see kernels/rhs.py
    stage: State  # the stage in progress, then the end of the step
    start: State
    errors: np.ndarray  # one for each thread
    probable: np.ndarray  # probable errors of steps, likewise
    speeds: np.ndarray  # [m/s] of the fastest point, likewise
    ways: np.ndarray  # squares of the largest displacements [m^2] before the step, likewise


class Nearby(Record):
    """
    Pairs of bodies with close spheres, and arrays to find them; see kernels/contact/search.py.

    n bodies are numbered; the arrays hold at most p pairs.
    """

    slots: np.ndarray  # (n,) int32, indices of the bodies in all other arrays
    half_edge: float  # a [m]
    radius: float  # of the sphere around a body [m]
    free: bool  # a motion that all have in common counts for nothing
    planes: np.ndarray  # (k, 4) unit normals and offsets [m]
    counts: np.ndarray  # (2,) int64: pairs, and which of the two lists holds them
    pairs: np.ndarray  # (2, p, 2) int32 bodies, the lower number first, sorted
    codes: np.ndarray  # (2, p) int32 the axis that showed a gap last
    gaps: np.ndarray  # (p,) [m] lower bounds of the gaps
    known: np.ndarray  # (p,) bool, the widest gap of the pair has been found
    to_planes: np.ndarray  # (k, n) [m] distances from planes
    axes: np.ndarray  # (n, 9) world components of the body axes
    reference: np.ndarray  # (n, 3) [m] positions of the bodies when the list was made
    velocity: np.ndarray  # (3,) [m/s] that all bodies have in common
    heads: np.ndarray  # (h,) int32, a power of two
    cubes: np.ndarray  # (3, n) int64
    following: np.ndarray  # (n,) int32
    half_edges: np.ndarray | None = None  # (n,) [m], where they differ


class Watch(Record):
    """
    Positions from which bodies may move a limited distance before the next neighbour search.

    See kernels/contact/displacement.py and kernels/contact/rebuild_check.py.
    """

    reference: np.ndarray  # (3, s) [m]
    turned: np.ndarray  # orientations at these positions, in the form of the state
    frame: np.ndarray  # (7,) their time [s], velocity [m/s] and half acceleration of all bodies
    radius: float  # of the sphere around a body [m]
    limits: np.ndarray  # (LIMIT_COUNT,) see kernels/contact/displacement.py
    far: np.ndarray  # (8 t,) [m^2] largest squared displacement in the blocks of each thread
    nearby: Nearby


class Sweep(Record):
    """The order in which a thread visits its blocks, see traversal_order.py."""

    drifts: np.ndarray  # (b,) uint32, the thread's blocks in the order of drifts
    pushes: np.ndarray  # (b,) uint32, the same blocks in the order of kicks
    ahead: np.ndarray  # (t,) int32, number of drifted blocks before each tile is kicked
    border: int  # number of drifted blocks before other threads kick


class Team(Record):
    """Threads that share a call; each takes a run of blocks."""

    member: int
    size: int
    flags: np.ndarray  # int64, see kernels/runtime/team.py
    sweep: Sweep
    scratch: Any  # scratch arrays for contacts, see contact/surface.py; None without contacts
