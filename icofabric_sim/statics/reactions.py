# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Reactions of supports, drives, anchors and planes at rest, by name."""

from icofabric_sim.scene.planes import make_planes
from icofabric_sim.simulation.reports.load_cells import (
    ContactForces,
    held_by_name,
    names_of,
    Reactions,
    resultant,
)
from icofabric_sim.statics.fabric import Configuration
import numpy as np


def reactions_of(
    here: Configuration, force: np.ndarray, contacts: ContactForces | None
) -> Reactions:
    """
    Return the reactions that hold a configuration, in the form of `simulation.reactions()`.

    `force` (n, 6) acts on all degrees of freedom and includes the forces of `contacts`.
    """
    fabric, scene, position = here.fabric, here.fabric.scene, here.position
    on_bodies, rows = np.zeros((scene.body_count, 6)), []
    for mine in held_by_name(scene).values():
        part = np.where(mine, -force, 0.0)
        on_bodies += part
        rows.append(resultant(part, position, np.any(mine, axis=1)))
    directions = fabric.anchors.directions(position, here.axes)
    for (_, _, along), end, tension in zip(
            directions, fabric.anchors.points, here.anchor_state.tension):
        # An anchor of zero length has no direction.
        pull = np.where(np.isfinite(along), along, 0.0) * tension
        rows.append((end, pull, np.zeros(3)))
    for number, (plane, moved) in enumerate(zip(
            make_planes(scene.parameters), fabric.displaced)):
        foot = plane[3] * plane[:3] + moved
        bodies, wrenches = np.zeros(0, np.int64), np.zeros((0, 6))
        if contacts is not None:
            mine = contacts.bodies[:, 1] == -1 - number
            bodies, wrenches = contacts.bodies[mine, 0], contacts.wrench_on_first[mine]
        push = wrenches[:, :3]
        moment = np.cross(position[bodies] - foot, push) + wrenches[:, 3:]
        rows.append((foot, push.sum(axis=0), moment.sum(axis=0)))
    point, force, torque = (
        np.array([row[k] for row in rows]).reshape(-1, 3) for k in range(3))
    return Reactions(names_of(scene.parameters), point, force, torque, on_bodies)
