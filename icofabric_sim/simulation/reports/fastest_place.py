# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Location of the fastest motion of a run: a connector, a contact, or a spinning body."""

from icofabric_sim.scene.connector_laws import strain_of
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.stepping.driver import Driver
from icofabric_sim.simulation.stepping.motion_rates import Term
import numpy as np


def fastest_place(driver: Driver) -> str:
    """Return the location of the fastest motion; empty if unknown."""
    kind = driver.rates.fastest_kind()
    if kind is Term.CONTACTS:
        return _deepest_pair(driver)
    if kind is Term.SPIN:
        trajectory = driver.trajectory
        *_, spin = trajectory.packed.layout.unpack(trajectory.state)
        return f'body {int(np.argmax((spin**2).sum(axis=1)))} spins fastest'
    return _stiffest_connector(driver) if kind is Term.FABRIC else ''


def _deepest_pair(driver: Driver) -> str:
    touching = driver.contact.phase.touching(
        driver.trajectory.state, driver.trajectory.stretches())
    if not len(touching.overlap):
        return 'no pair in contact now'
    deepest = int(np.argmax(touching.overlap))
    return f'deepest: {touching.describe(deepest)}, by {touching.overlap[deepest]:.2g} m'


def _stiffest_connector(driver: Driver) -> str:
    """Return the most strained connector of the bodies that vibrate fastest."""
    trajectory, bodies = driver.trajectory, driver.rates.fastest_bodies()
    packed = trajectory.packed
    connectors = packed.connectors
    if not bodies:
        return ''
    text = f'mostly that of body {bodies[0]}'
    if connectors is None:
        return text
    first, second = connectors.first, connectors.second
    ends = np.isin(first, bodies).astype(int) + np.isin(second, bodies)
    ends[(first != bodies[0]) & (second != bodies[0])] = 0
    snapshot = Snapshot(
        0.0, *packed.layout.unpack(trajectory.state), len(first), packed, {},
        trajectory.broken.since)
    ends[~snapshot.intact] = 0
    if not ends.any():
        return text
    strain = np.abs(strain_of(snapshot.connector_length, connectors.natural_length))
    number = int(np.argmax(np.where(ends == ends.max(), strain, -1.0)))
    return f'{text}, at connector {number} between bodies {first[number]} and {second[number]}'
