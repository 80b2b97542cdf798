# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
What kernels take: packed constants, the evolving state, the inputs.

A term that a scene lacks is None.
"""

from typing import NamedTuple

import numpy as np


class Connectors(NamedTuple):
    """
    Springs between edge midpoints; the index arrays have shape (c,).
    """

    first: np.ndarray  # int32, the lower body
    second: np.ndarray  # int32
    first_edge: np.ndarray  # int8 edge codes 0-5
    second_edge: np.ndarray
    stiffness: float  # k [N/m]
    natural_length: float  # D [m]
    half_width: float  # centre to edge midpoint, w / 2 [m]


class Adjacency(NamedTuple):
    """
    Connectors of each body: connector[start[b]:start[b + 1]].
    """

    start: np.ndarray  # (n + 1,) int32
    connector: np.ndarray  # (2 c,) int32


class Supports(NamedTuple):
    """
    Inverse masses with held freedoms set to zero.
    """

    inverse_mass: np.ndarray  # (n, 3) [1/kg], world axes
    inverse_inertia: np.ndarray  # (n,) [1/(kg m^2)]


class Loads(NamedTuple):
    """
    Wrenches on single bodies, one row each.
    """

    body: np.ndarray  # (m,) int32
    in_body_axes: np.ndarray  # (m,) bool: force and torque turn with the body
    force: np.ndarray  # (m, 3) [N]
    torque: np.ndarray  # (m, 3) [N m]
    point: np.ndarray  # (m, 3) [m], body axes, from the centre


class Model(NamedTuple):
    """
    Constants of a compiled scene.
    """

    inverse_mass: float  # [1/kg]
    inverse_inertia: float  # [1/(kg m^2)]
    gravity: np.ndarray | None  # (3,) [m/s^2]
    connectors: Connectors | None
    adjacency: Adjacency | None
    supports: Supports | None


class State(NamedTuple):
    """
    Evolving state, world frame, written by kernels.
    """

    position: np.ndarray  # (n, 3) [m]
    orientation: np.ndarray  # (n, 4) x y z w, or (n, 3, 3) direction cosines
    linear_velocity: np.ndarray  # (n, 3) [m/s]
    angular_velocity: np.ndarray  # (n, 3) [rad/s]


class Work(NamedTuple):
    """
    Resultants at the current state, and room for the arms.
    """

    force: np.ndarray  # (n, 3) [N]
    torque: np.ndarray  # (n, 3) [N m] about each centre
    arms: np.ndarray  # (n, 3, 3) [m], see rotations.fill_arms
