# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Causes of failures: the body and the connector that error messages name."""

from collections.abc import Mapping

from icofabric_sim.kernels.records import State
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.model.stability import Frequency
import numpy as np


def too_fast(time: float, fastest: str) -> str:
    """Return a message that the motion of `fastest` at `time` [s] is too fast for any step."""
    return (
        f'the motion at t = {time:.9g} s is too fast for any step, first of all that of '
        f'{fastest}; look for a huge stiffness, load, spin or stretch')


def shorter_steps(step: float, tolerance: float, fastest: str) -> str:
    """Return a message on the origin of a chosen `step` [s], and on a remedy that shortens it."""
    return (
        f'steps of {step:.6g} s are chosen for solver.tolerance {tolerance:g} per second, and the '
        f'fastest motion is that of {fastest}: a smaller solver.tolerance makes steps shorter')


def stiffest_term(packed: PackedScene, *, anchored: bool = False) -> str:
    """Name the term of the fabric's fastest vibration, with its parameters."""
    model = packed.model
    mass, inertia = model.inverse_mass, model.inverse_inertia
    terms = {}
    if model.links is not None:
        square = model.links.half_width**2
        width = mass + square * inertia
        terms['the connectors (connector.stiffness, or their table)'] = (
            model.links.stiffness * width)
        if model.maxwell is not None:
            terms['the arms of connectors (connector.maxwell_stiffness)'] = (
                model.maxwell.stiffness * width)
        if model.bending is not None:
            terms['bending connectors (connector.bending_stiffness)'] = (
                model.bending.stiffness * (inertia + mass / max(square, 1e-300)))
        if model.twisting is not None:
            terms['twisting connectors (connector.twisting_stiffness)'] = (
                model.twisting.stiffness * inertia)
    if model.ties is not None:
        ties = model.ties
        terms['custom connectors (connectors.NAME.stiffness)'] = float((
            np.maximum(ties.extension, ties.compression)
            * (mass + (ties.point**2).sum(axis=1) * inertia)).max())
    if model.dipole is not None:
        terms['dipoles in the field (charge.dipole, field.electric)'] = (
            model.dipole.largest * inertia)
    if model.coulomb is not None:
        terms['charges and dipoles on each other (charge.mutual)'] = 0.0
    if not terms and anchored:
        return 'anchors (connector.stiffness)'
    return max(terms, key=lambda name: terms[name], default='free bodies')


def fastest_term(rates: Mapping[str, float]) -> str:
    """Return the name and value of the largest of `rates` [rad/s]."""
    name = max(rates, key=lambda key: rates[key])
    rate = f'{rates[name]:.4g}' if rates[name] < np.inf else 'more than 1e308'
    return f'{name}, up to {rate} rad/s'


def unsafe_step(step: float, limit: float, frequency: Frequency, time: float) -> str:
    """Return a message that a fixed step has exceeded the stability limit [s]."""
    bodies = ', '.join(str(body) for body in frequency.bodies)
    return (
        f'solver.step {step!r} s has become unsafe at t = {time:.9g} s: the fabric has '
        f'stretched or turned so that bodies {bodies} move at up to {frequency.rate:.6g} '
        f'rad/s, and the stability limit is now {limit:.6g} s; start again with a '
        'smaller step, or with 0 to have it chosen')


def find_fault(packed: PackedScene, state: State) -> str:
    """Return the body that is not finite or else the fastest, and its most strained connector."""
    position, orientation, velocity, spin = packed.layout.unpack(state)
    with np.errstate(all='ignore'):
        speed = packed.masses.mass * (velocity**2).sum(axis=1)
        speed += packed.masses.inertia * (spin**2).sum(axis=1)
        speed += 0.0 * (position.sum(axis=1) + orientation.sum(axis=1))
        speed[~np.isfinite(speed)] = np.inf
        body = int(np.argmax(speed))
        name = f'body {body}'
        connectors = packed.connectors
        if connectors is None:
            return name
        length = Snapshot(
            0.0, position, orientation, velocity, spin, len(connectors.first), packed, {}
        ).connector_length
        mine = np.flatnonzero((connectors.first == body) | (connectors.second == body))
        if not len(mine):
            return name
        strain = np.abs(length - connectors.natural_length)[mine]
        strain[~np.isfinite(strain)] = np.inf
        return f'{name}, at connector {int(mine[np.argmax(strain)])}'
