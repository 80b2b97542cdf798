# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Snapshots: immutable copies of the state at the time that was asked for.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from icofabric_sim.kernels.connectors import connector_ends
from icofabric_sim.kernels.rotations import fill_arms
from icofabric_sim.model import PackedScene
import numpy as np


@dataclass(frozen=True)
class Snapshot:
    """
    State of a fabric at one time, world frame; derived values are computed when first read.
    """

    time: float  # [s]
    position: np.ndarray  # (n, 3) [m]
    orientation: np.ndarray  # (n, 4) unit quaternions x y z w, body to world
    linear_velocity: np.ndarray  # (n, 3) [m/s]
    angular_velocity: np.ndarray  # (n, 3) [rad/s]
    connector_count: int
    packed: PackedScene
    ledger: Mapping[str, float]  # [J] work in, and energy less work at the start

    @cached_property
    def intact(self) -> np.ndarray:
        """
        Which connectors are unbroken, (c,) bool.
        """
        return np.ones(self.connector_count, dtype=bool)

    @cached_property
    def break_time(self) -> np.ndarray:
        """
        Times of breakage [s], (c,); NaN while unbroken.
        """
        return np.full(self.connector_count, np.nan)

    @cached_property
    def connector_ends(self) -> np.ndarray:
        """
        World positions [m] of the ends of every connector, (c, 2, 3).
        """
        connectors = self.packed.connectors
        if connectors is None:
            return np.zeros((0, 2, 3))
        arms = np.empty((len(self.position), 3, 3))
        fill_arms(self.orientation, connectors.half_width, arms)
        ends = np.empty((len(connectors.first), 2, 3))
        connector_ends(connectors, self.position, arms, ends)
        return ends

    @cached_property
    def connector_length(self) -> np.ndarray:
        """
        Lengths [m] of the connectors, (c,).
        """
        ends = self.connector_ends
        return np.sqrt(((ends[:, 1] - ends[:, 0]) ** 2).sum(axis=1))

    @cached_property
    def energy(self) -> dict[str, float]:
        """
        Energies [J]: kinetic, connectors, gravity (zero at the origin), contact; and their sum.

        Beside them `work_in` by loads, what is `dissipated`, and the `balance_error`: the sum,
        less the work done, beside what it was at the start.
        """
        model = self.packed.model
        mass, inertia = 1.0 / model.inverse_mass, 1.0 / model.inverse_inertia
        energy = {
            'kinetic': 0.5 * mass * float((self.linear_velocity**2).sum())
            + 0.5 * inertia * float((self.angular_velocity**2).sum()),
            'connectors': 0.0,
            'gravity': 0.0,
            'contact': 0.0,
        }
        connectors = self.packed.connectors
        if connectors is not None:
            stretch = self.connector_length - connectors.natural_length
            energy['connectors'] = 0.5 * connectors.stiffness * float((stretch**2).sum())
        if model.gravity is not None:
            energy['gravity'] = -mass * float((self.position @ model.gravity).sum())
        energy['total'] = sum(energy.values())
        energy['work_in'], energy['dissipated'] = self.ledger['work_in'], 0.0
        energy['balance_error'] = energy['total'] - self.ledger['work_in'] - self.ledger['start']
        return energy
