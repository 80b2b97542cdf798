# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes of many shells without connectors, on a floor, in a box or between six walls."""

from typing import Any, Literal

from icofabric_sim.geometry.icosahedron import circumscribed_radius
from icofabric_sim.scene.scene import Scene
from icofabric_validation.named.loose_bodies import A, GRAVITY

# Gap between the outermost bodies and the planes [m].
_GAP = 0.004


def crowd(
    size: tuple[int, int, int], *, within: Literal['floor', 'box', 'walls'],
    parameters: dict[str, Any]
) -> Scene:
    """
    Return a scene of half as many bodies as grid positions, with random velocities.

    The bodies have weight above a floor or in an open box, and none between six walls.
    """
    values: dict[str, Any] = {
        'weave.size': list(size), 'weave.connected': False, 'weave.connector_length': 0.027,
        'shell.edge_length': 2.0 * A, 'initial_random.seed': 1, 'solver.threads': 1, **parameters}
    place = Scene.from_parameters(values).position
    room = circumscribed_radius(A) + _GAP
    if within != 'walls':
        values |= {'planes.floor.normal': [0.0, 0.0, 1.0],
                   'planes.floor.offset': float(place[:, 2].min() - room),
                   'gravity': [0.0, 0.0, -GRAVITY]}
    for axis, name in enumerate({'floor': '', 'box': 'xy', 'walls': 'xyz'}[within]):
        for side, word in ((1.0, 'low'), (-1.0, 'high')):
            edge = place[:, axis].min() if side > 0.0 else -place[:, axis].max()
            values[f'planes.{word}_{name}.normal'] = [
                side if k == axis else 0.0 for k in range(3)]
            values[f'planes.{word}_{name}.offset'] = float(edge - room)
    return Scene.from_parameters(values)
