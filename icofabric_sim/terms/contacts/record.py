# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Candidate pairs for contact, and arrays of their forces and losses."""

from typing import Any

from icofabric_sim.kernels.runtime.record import Record
from icofabric_sim.terms.shared import Blocks
import numpy as np


class Sleep(Record):
    """
    Pairs known to be apart until bodies have moved a certain distance, and the awake pairs.

    See sleeping.py.
    """

    # Blocks whose motion is measured, carriers of planes too; without blocks no pair sleeps.
    blocks: Blocks
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
    """Dissipation of contacts, see losses.py."""

    damping: float  # c [s/m]
    friction: float  # mu
    friction_stiffness: float  # k of the springs that stick [N/m]
    lag: float  # tau [s] of the dashpots parallel to them
    power: np.ndarray  # (p,) [W] dissipated by each pair in the last evaluation
    spent: np.ndarray  # (1, s) [W] by bodies: that of a pair counts at its first body
    # Stretches [m] of friction, (p, 4) each, no rows without friction: x, y, z in the world and
    # the rotation about the normal times the radius of the contact, see losses.py. At the
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


class Contacts(Record):
    """
    Candidate pairs for contact before the next search: two bodies, or a body and a plane.

    Each pair is evaluated once; forces are summed at the bodies in the order of the pairs.
    """

    stiffness: float  # K [N/m]
    half_edge: float  # a [m]
    pairs: np.ndarray  # (p, 2) int32 slots, that of the lower body first; -1 - k: plane k
    planes: np.ndarray  # (k, 4) unit normal and offset [m] at the start
    # (p, 19) for K = 1 N/m: force on the first [N], torques on both [N m], delta^2 / 2 [m^2],
    # delta and the deepest overlap [m], the axis (3) that last separated them, contact point (3),
    # squared contact area [m^4]
    result: np.ndarray
    start: np.ndarray  # (b + 1,) int32: entries start[b] to start[b + 1] act on block b
    slot: np.ndarray  # (e,) int32 of the body that an entry acts on, rising
    entry: np.ndarray  # (e,) int32: twice the number of the pair, 1 more: on its second body
    turns: np.ndarray  # int32, places of the blocks, by their first slots over LANES
    rows: np.ndarray  # (6, s) forces [N] and torques [N m]
    pushes: np.ndarray  # (b,) [J/s^2] their squares on each block, see stiffness.py
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
    scratch: Any  # scratch arrays for health checks, see surface.py
    # Addresses of `touch_some` (forces.py) and `found_gap` (pair.py) for these
    # contacts; 0 as long as no bodies are near (runtime/outlined.py).
    touch_address: int
    gap_address: int
    sleep: Sleep
    losses: ContactLosses | None = None
    half_edges: np.ndarray | None = None  # (s,) [m] of each slot, if they differ
    carriers: np.ndarray | None = None  # (k,) int32 slots of `Platens`, -1: a plane at rest


class Nearby(Record):
    """
    Pairs of bodies with close spheres, and arrays to find them; see search.py.

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
    carriers: np.ndarray | None = None  # (k,) int32 as in `Contacts`


class Watch(Record):
    """
    Positions from which bodies may move a limited distance before the next neighbour search.

    See displacement.py and rebuild_check.py.
    """

    reference: np.ndarray  # (3, s) [m]
    turned: np.ndarray  # orientations at these positions, in the form of the state
    frame: np.ndarray  # (7,) their time [s], velocity [m/s] and half acceleration of all bodies
    radius: float  # of the sphere around a body [m]
    limits: np.ndarray  # (LIMIT_COUNT,) see displacement.py
    far: np.ndarray  # (8 t,) [m^2] largest squared displacement in the blocks of each thread
    nearby: Nearby
    carried: np.ndarray | None = None  # uint8 by slots over LANES, bit l: lane l is a carrier
