# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Arguments of Warp kernels: the arrays of kernels/records.py, flat and in device memory.

Row k of slot s is at k stride + s, where the stride is the number of slots.
"""

from importlib import import_module
from typing import Any

wp: Any = import_module('warp')


@wp.struct
class Fabric:
    """Constants of a compiled scene."""

    # (b,) first slot of each block, bits of the lanes that hold a body, and lanes.
    slot: wp.array(dtype=wp.int32)
    alive: wp.array(dtype=wp.uint8)
    lanes: wp.int32
    stride: wp.int32
    # [1/kg], [1/(kg m^2)]; the largest if bodies differ
    inverse_mass: wp.float64
    inverse_inertia: wp.float64
    own_mass: wp.array(dtype=wp.float64)  # (s,) [kg], if bodies differ
    own_inertia: wp.array(dtype=wp.float64)  # (s,) [kg m^2]
    gravity: wp.vec3d  # [m/s^2]
    # (3 s,) and (s,), inverse masses [1/kg] and inertias [1/(kg m^2)] with held freedoms at zero.
    free_mass: wp.array(dtype=wp.float64)
    free_inertia: wp.array(dtype=wp.float64)
    # (12 b,) index of the x of lane 0's partner among attachment points, and bits of the lanes
    # that have this connector.
    place: wp.array(dtype=wp.int32)
    present: wp.array(dtype=wp.uint8)
    half_width: wp.float64  # centre to attachment point [m]
    attachment: wp.array(dtype=wp.vec3d)  # (6,) [m], body axes
    stiffness: wp.float64  # k [N/m]
    natural_length: wp.float64  # D [m]
    # (12 s,) k_e, k_c [N/m] and D [m] of each connector, if laws differ.
    extension: wp.array(dtype=wp.float64)
    compression: wp.array(dtype=wp.float64)
    natural: wp.array(dtype=wp.float64)
    # Rows of the records of laws that replace springs, (12 s,) each, one law after another.
    laws: wp.array(dtype=wp.float64)
    # Arrays of steps that resolve jumps of slopes, see crossings.py; (36 s,), (48 s,), (12 s,),
    # (1,) as in Kinks of kernels/records.py, but `active` by bodies.
    start: wp.array(dtype=wp.float64)
    forces: wp.array(dtype=wp.float64)
    active: wp.array(dtype=wp.uint8)
    found: wp.array(dtype=wp.int32)
    # kappa_b and kappa_t [N m/rad], (1,), or (12 s,) if connectors differ.
    bending: wp.array(dtype=wp.float64)
    twisting: wp.array(dtype=wp.float64)
    direction: wp.array(dtype=wp.vec3d)  # (12,) of connectors in the weave, body axes
    damping: wp.array(dtype=wp.float64)  # c [N s/m], (1,) or (12 s,)
    drag_linear: wp.float64  # [N s/m]
    drag_angular: wp.float64  # [N m s/rad]
    dipole: wp.vec3d  # p [C m], body axes
    field: wp.vec3d  # E [V/m]


@wp.struct
class Acting:
    """Wrenches, paths and anchors: a row for every block of each."""

    start: wp.array(dtype=wp.int32)  # (b + 1,) rows start[b] to start[b + 1] act on block b
    wrench: wp.array(dtype=wp.int32)  # (m,) number; -1 - p: a path, or an anchor after all paths
    lanes: wp.array(dtype=wp.uint8)  # (m,) bits of the loaded lanes
    turning: wp.array(dtype=wp.uint8)  # (w,) not 0: force and torque turn with the bodies
    force: wp.array(dtype=wp.vec3d)  # (w,) [N]
    torque: wp.array(dtype=wp.vec3d)  # (w,) [N m]
    point: wp.array(dtype=wp.vec3d)  # (w,) [m], body axes
    work: wp.array(dtype=wp.float64)  # (m lanes,) [J]
    # (5 w,) start [s], value, slope [1/s], height, rate [rad/s] of the factor of each wrench.
    varying: wp.array(dtype=wp.float64)
    # Paths, as in Drives of kernels/records.py, flat.
    paths: wp.int32
    path_start: wp.array(dtype=wp.float64)
    path_cubic: wp.array(dtype=wp.float64)
    path_wave: wp.array(dtype=wp.float64)
    path_rate: wp.array(dtype=wp.float64)
    path_phase: wp.array(dtype=wp.float64)
    path_base: wp.array(dtype=wp.float64)
    path_turn: wp.array(dtype=wp.float64)
    path_arm: wp.array(dtype=wp.float64)
    path_first: wp.array(dtype=wp.float64)
    path_moves: wp.array(dtype=wp.uint8)
    anchor_start: wp.array(dtype=wp.float64)  # (a,) [s] start of the segment of its path
    anchor_cubic: wp.array(dtype=wp.vec3d)  # (4 a,) [m] and by powers of [s]
    anchor_arm: wp.array(dtype=wp.vec3d)  # (a,) [m] from the centre, body axes
    anchor_law: wp.array(dtype=wp.float64)  # (3 a,) k_e, k_c [N/m], D [m]


@wp.struct
class Nearness:
    """Candidate pairs, arrays for their forces, and displacements of bodies."""

    half_edge: wp.float64  # a [m]
    stiffness: wp.float64  # K [N/m]
    radius: wp.float64  # of the sphere around a body [m]
    # A shell of half edge 1: normals and corners of its faces, neighbouring faces, one of each
    # pair of opposite vertices, and half of the edges.
    normals: wp.array(dtype=wp.vec3d)  # (20,)
    corners: wp.array(dtype=wp.vec3d)  # (60,)
    neighbours: wp.array(dtype=wp.int32)  # (60,)
    vertices: wp.array(dtype=wp.vec3d)  # (6,)
    edges: wp.array(dtype=wp.vec3d)  # (15,) directions
    planes: wp.array(dtype=wp.float64)  # (4 k,) unit normals and offsets [m]
    count: wp.array(dtype=wp.int32)  # (1,) pairs; arrays may be longer
    pairs: wp.array(dtype=wp.int32)  # (2 p,) slots; -1 - k: plane k
    pushes: wp.array(dtype=wp.float64)  # (10 p,), see contact.py
    # (2 p,) [m] overlap in the last evaluation, and the largest since the last query
    depths: wp.array(dtype=wp.float64)
    start: wp.array(dtype=wp.int32)  # (s + 1,) entries start[s] to start[s + 1] act on slot s
    entry: wp.array(dtype=wp.int32)  # (e,) twice the number of the pair, 1 more: on its second
    rows: wp.array(dtype=wp.float64)  # (6 s,) forces [N] and torques [N m]
    reference: wp.array(dtype=wp.float64)  # (7 s,) poses at the last search
    frame: wp.array(dtype=wp.float64)  # (7,) time [s], common velocity and acceleration
    ways: wp.array(dtype=wp.float64)  # (s,) [m^2] largest squared displacements since a check


@wp.struct
class Clock:
    """Time of a step, read on the device because it is unknown while launches are recorded."""

    start: wp.array(dtype=wp.float64)  # (2,) origin [s] and step [s]
    index: wp.array(dtype=wp.int64)  # (1,) number of the first step of the sequence
    drifts: wp.array(dtype=wp.float64)  # (d,) of the method, over the step
    kick_first: wp.int32  # 1: a step starts and ends with a kick


@wp.struct
class Stage:
    """Work of one launch: kicks at one time over two parts of a step, and up to two drifts."""

    # 0: no kick, 1: by stored accelerations, 2: by evaluated ones.
    source: wp.int32
    keep: wp.int32  # not 0: store the accelerations
    kick: wp.float64  # kick length over the step
    again: wp.float64
    push_step: wp.int32  # relative to the step of the clock
    push_drifts: wp.int32  # drifts of the step before the kick
    drift: wp.float64
    drift_step: wp.int32
    drift_drifts: wp.int32
    drift_later: wp.float64  # over the step, after these drifts
    second: wp.float64  # the first drift of the next step
    second_step: wp.int32
    # Fraction of the step at which connectors keep their initial slope; negative: they do not.
    step_part: wp.float64
    if_found: wp.int32  # not 0: only after crossings that need a correction
