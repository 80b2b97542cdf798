# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Prescribed motions that contradict each other: they press two bodies, or a body and a plane, on.

No stiffness of contacts and no step prevents an overlap if neither side has a free degree of
freedom along the contact force.
"""

from collections.abc import Sequence
from typing import NamedTuple

from icofabric_sim.scene.scene import Scene
from icofabric_sim.scene.supports import fixed_freedoms, FREEDOMS
import numpy as np

# Part of a contact force, or torque over a, along free freedoms above which a body can yield.
_YIELDING_RATIO = 1e-6
# Those that move first, in messages.
_KINDS = ('drives', 'moving plane', 'supports', 'plane')


class Prescribed(NamedTuple):
    """Bodies of a support or drive, and the degrees of freedom that it prescribes."""

    name: str  # supports.NAME or drives.NAME
    bodies: np.ndarray  # (m,)
    freedoms: np.ndarray  # (6,) bool


def prescribed_parts(scene: Scene) -> tuple[Prescribed, ...]:
    """Return the drives, then the supports of a scene."""
    parts = [
        Prescribed(f'drives.{name}', drive.bodies, drive.freedoms)
        for name, drive in scene.drives.items()]
    for name in scene.parameters.names('supports'):
        fixed = fixed_freedoms(scene.parameters, name)
        held = np.array([word in fixed for word in FREEDOMS])
        parts.append(Prescribed(
            f'supports.{name}', scene.groups[scene.parameters[f'supports.{name}.group']],
            np.append(held[:3], np.repeat(held[3], 3))))
    return tuple(parts)


def name_conflict(
    parts: Sequence[Prescribed], planes: Sequence[tuple[str, bool]], pair: np.ndarray,
    result: np.ndarray, half_edge: float
) -> str:
    """
    Return which prescribed motions press a pair on, as 'drives.b contradicts supports.a', or ''.

    Parameters
    ----------
    parts
        Supports and drives.
    planes
        Names of the planes, and whether they move.
    pair
        (2,) body numbers; the second one -1 - k: plane k.
    result
        Row of `Contacts.result` of the pair: forces and torques on both.
    half_edge
        a [m], to compare torques with forces.
    """
    names = []
    for body, wrench in zip(pair.tolist(), (
            result[:6], np.append(-result[:3], result[6:9]))):
        if body < 0:
            name, moves = planes[-1 - body]
            names.append(('moving plane' if moves else 'plane', f'planes.{name}'))
            continue
        free, holder = np.ones(6, bool), ''
        for part in parts:
            if body in part.bodies:
                free &= ~part.freedoms
                if not holder or part.freedoms[np.argmax(np.abs(wrench[:3]))]:
                    holder = part.name
        size = np.abs(wrench) / np.repeat([1.0, half_edge], 3)
        if (size[free] > _YIELDING_RATIO * size.max()).any():
            return ''
        names.append((holder.partition('.')[0], holder))
    first, second = sorted(names, key=lambda item: _KINDS.index(item[0]))
    # A drive moves all of its bodies as one.
    return '' if first == second else f'{first[1]} contradicts {second[1]}'
