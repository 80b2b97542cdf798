# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Where the fastest motion of a run is: a connector, a pair that touches, a body that spins."""

from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.stepping.driver import Driver
from icofabric_sim.simulation.stepping.motion_rates import Term
import numpy as np


def fastest_place(driver: Driver) -> str:
    """Name the place of the fastest motion; '' where it cannot be told."""
    kind = driver.rates.fastest_kind()
    if kind is Term.CONTACTS:
        return _deepest_pair(driver)
    if kind is Term.SPIN:
        trajectory = driver.trajectory
        *_, spin = trajectory.packed.layout.unpack(trajectory.state)
        return f'body {int(np.argmax((spin**2).sum(axis=1)))} spins fastest'
    return _stiffest_connector(driver) if kind is Term.FABRIC else ''


def _deepest_pair(driver: Driver) -> str:
    touching = driver.contact.touching(driver.trajectory.state)
    if not len(touching.overlap):
        return 'none touches now'
    deepest = int(np.argmax(touching.overlap))
    return f'deepest: {touching.describe(deepest)}, by {touching.overlap[deepest]:.2g} m'


def _stiffest_connector(driver: Driver) -> str:
    """Name the connector between the bodies that vibrate fastest, the most stretched of them."""
    trajectory, bodies = driver.trajectory, driver.rates.fastest_bodies()
    packed = trajectory.packed
    connectors = packed.connectors
    if not bodies:
        return ''
    said = f'first of all that of body {bodies[0]}'
    if connectors is None:
        return said
    first, second = connectors.first, connectors.second
    ends = np.isin(first, bodies).astype(int) + np.isin(second, bodies)
    ends[(first != bodies[0]) & (second != bodies[0])] = 0
    snapshot = Snapshot(
        0.0, *packed.layout.unpack(trajectory.state), len(first), packed, {},
        trajectory.broken.since)
    ends[~snapshot.intact] = 0
    if not ends.any():
        return said
    strain = np.abs(snapshot.connector_length / connectors.natural_length - 1.0)
    number = int(np.argmax(np.where(ends == ends.max(), strain, -1.0)))
    return f'{said}, at connector {number} between bodies {first[number]} and {second[number]}'
