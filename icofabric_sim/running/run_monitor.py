# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Extremes of a run, sampled at its output times, so that they do not depend on its speed."""

from typing import NamedTuple

from icofabric_sim.messages import topics
from icofabric_sim.messages.topics import Topic
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.running.run_records import Status
from icofabric_sim.scene.connector_laws import strain_of
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.reports.divergence import Companion
from icofabric_sim.simulation.simulation import Simulation
import numpy as np


class Extreme(NamedTuple):
    """Largest value with its time and body or connector."""

    value: float
    time: float  # [s]
    number: int  # body or connector, -1: none yet


NOTHING = Extreme(0.0, 0.0, -1)


class Momentum(NamedTuple):
    """Momenta of the fabric, with the sums of the magnitudes of their parts as scales."""

    linear: np.ndarray  # (3,) [kg m/s]
    angular: np.ndarray  # (3,) [kg m^2/s] about the origin
    linear_scale: float
    angular_scale: float


class RunMonitor:
    """Sink of the runner that computes extremes instead of storing messages."""

    is_bag = True  # repeats for late subscribers are not needed

    def __init__(self, simulation: Simulation, *, with_growth: bool = False) -> None:
        """Sample the initial state; `with_growth` starts a second run, see divergence.py."""
        self._simulation = simulation
        self.companion = Companion(simulation) if with_growth else None
        self.first = self.last = simulation.snapshot()
        self.stretch, self.compression, self.displacement = NOTHING, NOTHING, NOTHING
        self.energy_scale = 0.0
        self.count = 0
        self.look(self.first)

    def wants(self, topic: Topic) -> bool:
        """Return whether to be called, i.e. at the times of poses."""
        return topic is topics.POSES

    def send(self, topic: Topic, nanoseconds: int, data: bytes) -> None:
        """Sample the present state."""
        self.look(self._simulation.snapshot())
        if self.companion is not None:
            self.companion.look()

    def send_input(self, topic: str, type_name: str, nanoseconds: int, data: bytes) -> None:
        """Ignore inputs."""

    def time_jumped_back(
        self, simulation: Simulation, parameters: Parameters, ended: Status
    ) -> None:
        """Do nothing: time does not jump in a run without a graph."""

    def look(self, snapshot: Snapshot) -> None:
        """Sample a state."""
        self.last = snapshot
        self.count += 1
        if snapshot.connector_count and len(snapshot.connector_length):
            natural = self._simulation.scene.connectors.natural_length
            strain = strain_of(snapshot.connector_length, natural)
            if snapshot.broken_since is not None:
                strain[~snapshot.intact] = 0.0
            high, low = int(np.argmax(strain)), int(np.argmin(strain))
            if strain[high] > self.stretch.value:
                self.stretch = Extreme(float(strain[high]), snapshot.time, high)
            if strain[low] < self.compression.value:
                self.compression = Extreme(float(strain[low]), snapshot.time, low)
        distance = np.linalg.norm(snapshot.position - self.first.position, axis=1)
        body = int(np.argmax(distance))
        if distance[body] > self.displacement.value:
            self.displacement = Extreme(float(distance[body]), snapshot.time, body)
        energy, first = snapshot.energy, self.first.energy
        # Magnitudes, because the zero of energies of a table, of weight or of charges is
        # arbitrary.
        exchanged = energy['kinetic'] + sum(abs(energy[name] - first[name]) for name in (
            'connectors', 'gravity', 'contact', 'field'))
        self.energy_scale = max(self.energy_scale, exchanged)

    def momentum(self, snapshot: Snapshot) -> Momentum:
        """
        Return the momenta of a state: sums of M R' and R x M R' + I omega (eqs 8, 10 and 43).
        """
        linear = snapshot.packed.masses.mass[:, None] * snapshot.linear_velocity
        orbital, spin = np.cross(snapshot.position, linear), snapshot.spin_momentum
        return Momentum(
            linear.sum(axis=0),
            (orbital + spin).sum(axis=0),
            float(np.linalg.norm(linear, axis=1).sum()),
            float((np.linalg.norm(orbital, axis=1) + np.linalg.norm(spin, axis=1)).sum()))
