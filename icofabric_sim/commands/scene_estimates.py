# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Estimates from a scene before compilation: bounding box, contact, period, cost."""

import math

from icofabric_sim.geometry.icosahedron import circumscribed_radius
from icofabric_sim.scene.scene import Scene
from icofabric_sim.scene.shell_gaps import smallest_gap
from icofabric_sim.scene.summary import Row, vector
from icofabric_sim.simulation.contact.setup import pack_contact
import numpy as np

# Leapfrog steps in a period of the fastest vibration at solver.tolerance of about 1e-6, and ns for
# each body and step on one thread (docs/performance.md); contact and fields add to it.
_STEPS_A_PERIOD, _NANOSECONDS = 60.0, 20.0
# Larger edges [m] are probably in millimetres.
_MAX_EDGE_M = 0.5
# Largest number of listed members of a group.
_MAX_LISTED = 8


def estimate_rows(scene: Scene) -> list[Row]:
    """Return bounding box, smallest gap, group members, contact, fastest period, expected cost."""
    rows = [('box', _box(scene)), ('gap', _gap(scene))]
    rows += [(f'group {name}', members(bodies)) for name, bodies in scene.groups.items()]
    rows.append(('contact', _contact(scene)))
    frequency = frequency_bound(scene)
    if frequency > 0.0:
        period = 2.0 * math.pi / frequency
        rows.append((
            'period', f'the fastest vibration of connectors has a period of at least {period:.3g} '
                      's'))
        steps = _STEPS_A_PERIOD / period
        cost = 1e-9 * _NANOSECONDS * steps * scene.body_count
        rows.append((
            'cost', f'about {cost:.1g} s of computing for each simulated second, on one '
            'thread and without contact'))
    rows += hints(scene)
    return rows


def _box(scene: Scene) -> str:
    radius = circumscribed_radius(1.0) * scene.body_half_edges[:, None]
    low, high = (scene.position - radius).min(axis=0), (scene.position + radius).max(axis=0)
    return f'{vector(low, "m")} to {vector(high, "m")}, bounding box of the shells'


def _gap(scene: Scene) -> str:
    found = smallest_gap(
        scene.body_half_edges, scene.initial.position, scene.initial.orientation)
    if found is None:
        return 'only one shell'
    gap, (one, other) = found
    if gap < 0.0:
        return f'none: shells {one} and {other} overlap by {-gap:.3g} m at the start'
    return f'{gap:.6g} m at least between shells, smallest between {one} and {other}'


def members(bodies: np.ndarray) -> str:
    """Return numbers of bodies as ranges."""
    parts = np.split(bodies, np.flatnonzero(np.diff(bodies) > 1) + 1)
    said = [f'{part[0]}' if len(part) == 1 else f'{part[0]} to {part[-1]}' for part in parts]
    more = f', ... ({len(bodies):,} bodies)' if len(said) > _MAX_LISTED else ''
    return ', '.join(said[:_MAX_LISTED]) + more


def _contact(scene: Scene) -> str:
    setup = pack_contact(scene, np.array(scene.parameters['gravity']))
    mode = scene.parameters['contact.mode']
    if setup is None:
        return f'{mode}: never computed'
    own = '' if scene.parameters['contact.stiffness'] else ' (automatic)'
    text = (f'{mode}: stiffness {setup.stiffness:.4g} N/m{own}, damping {setup.damping:g} s/m, '
            f'friction {setup.friction:g}')
    if setup.names:
        text += f', planes {", ".join(setup.names)}'
    return f'{text}; {setup.expected}' if setup.expected else text


def frequency_bound(scene: Scene) -> float:
    """
    Return an upper bound of the angular frequencies [rad/s] of straight, unstrained connectors.

    With mass-weighted coordinates x of both bodies and the gradient g of a connector's length:
    (g1.x1 + g2.x2)^2 <= 2 (g1.x1)^2 + 2 (g2.x2)^2, and g^2 <= 1/m + r^2/I of a body.
    """
    if not scene.connector_count:
        return 0.0
    laws = scene.connectors.laws
    stiffness = np.broadcast_to(
        np.maximum(laws.extension, laws.compression), (scene.connector_count,))
    arm = np.linalg.norm(scene.connectors.attachment, axis=1).max()
    compliance = 1.0 / scene.masses.mass + arm**2 / scene.masses.inertia
    each = np.zeros(scene.body_count)
    for side in scene.connectors.bodies.T:
        np.add.at(each, side, stiffness)
    return float(np.sqrt(2.0 * (compliance * each).max()))


def hints(scene: Scene) -> list[Row]:
    """Return hints about values that may be in other units."""
    found: list[Row] = []
    edge = scene.shell.edge_length
    if edge >= _MAX_EDGE_M:
        found.append(('hint', f'shell.edge_length is {edge:g} m; lengths are in m: did you mean '
                              f'{edge / 1000:g}?'))
    for name in scene.parameters.names('initial'):
        turn = float(np.linalg.norm(scene.parameters[f'initial.{name}.rotation']))
        if turn > 2.0 * math.pi:
            found.append((
                'hint', f'initial.{name}.rotation is a rotation by {turn:g} rad; angles are in '
                        'rad: '
                f'did you mean degrees, {math.radians(turn):.4g} rad?'))
    gravity = float(np.linalg.norm(scene.parameters['gravity']))
    if gravity > 1000.0:
        found.append(('hint', f'gravity is {gravity:g} m/s^2; did you mean {gravity / 1000:g}?'))
    return found
