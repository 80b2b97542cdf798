# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Stiffness of contacts, and the energy that oscillates within a leapfrog step because of them.

The energy of a pair is U = K delta^2 / 2. In mass-scaled coordinates its second derivatives are
about _CURVED K |grad delta|^2 at most, and the evaluation of the pair has that gradient. K |grad
delta|^2 is the squared frequency of the isolated pair if delta is linear, as below an apex. Of
1,350 poses of all kinds two tilted faces were above, at 1.78 and 2.49. Steps through contacts are
at most 1.4 over the root of the bound, where 2 is the limit, and so allow twice the stiffness. A
face that rocks on a face has most of its stiffness in grad delta, as its torques have long arms.
The form of a pair is at most its largest eigenvalue times the kinetic form of its two bodies: so
the sum for a body bounds its frequency.

A leapfrog with steps h conserves, for smooth forces, not H but H + h^2 (v . V'' v / 12 -
F . F / 24), all mass-scaled (Hairer, Lubich and Wanner 2006, IX.8). H therefore oscillates by
h^2 |F|^2 / 24 in the middle of a collision, and by up to twice that at its start.
"""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import bits, fma, lane, LANES, load, splat, where
from icofabric_sim.terms.contacts.laws import patch_radius
from icofabric_sim.terms.contacts.losses import arms_of
from icofabric_sim.terms.contacts.record import Contacts
from icofabric_sim.terms.shared import Blocks
import numpy as np

_CURVED = 1.75
# Largest factor of h^2 |F|^2 in the oscillating energy, see above.
_SWINGS = 1.0 / 12.0


@compiled
def largest_stiffness(
    contacts: Contacts, position: np.ndarray, inverse_mass: float, inverse_inertia: float,
    most: float, friction: float, sums: np.ndarray
) -> float:
    """
    Return a bound of what contacts add to the squared frequency of a body [1/s^2].

    In the state that `contact_look` has examined. `most` [1/s^2] bounds the term of one pair
    without friction, `friction` [N/m] is the stiffness of its springs; `sums` holds one number of
    each slot.
    """
    for s in range(sums.shape[0]):
        sums[s] = 0.0
    largest = 0.0
    for p in range(contacts.pairs.shape[0]):
        out = contacts.aside[p]
        if not out[9] > 0.0:
            continue
        s, t = contacts.pairs[p, 0], contacts.pairs[p, 1]
        bodies = 1.0 if t < 0 else 2.0
        turning = out[3] * out[3] + out[4] * out[4] + out[5] * out[5]
        if t >= 0:
            turning += out[6] * out[6] + out[7] * out[7] + out[8] * out[8]
        pushing = out[0] * out[0] + out[1] * out[1] + out[2] * out[2]
        slope = (bodies * inverse_mass * pushing + inverse_inertia * turning) / (out[10] * out[10])
        stiffness = min(_CURVED * contacts.stiffness * slope, most)
        if friction > 0.0:
            # The slip of a body is dx + theta x arm, and the rotation about the normal.
            arm_a, arm_b = arms_of(position, s, t, out)
            square = patch_radius(out) ** 2
            around = arm_a[0] ** 2 + arm_a[1] ** 2 + arm_a[2] ** 2 + square
            if t >= 0:
                around += arm_b[0] ** 2 + arm_b[1] ** 2 + arm_b[2] ** 2 + square
            stiffness += friction * (bodies * inverse_mass + inverse_inertia * around)
        sums[s] += stiffness
        largest = max(largest, sums[s])
        if t >= 0:
            sums[t] += stiffness
            largest = max(largest, sums[t])
    return largest


@compiled
def note_pushes(
    contacts: Contacts | None, blocks: Blocks, inverse_mass: float, inverse_inertia: float,
    first: int, last: int
) -> None:
    """Store |F|^2, mass-scaled [J/s^2], of the contact forces on blocks first to last."""
    if contacts is not None:
        for block in range(first, last):
            s, forces, torques = blocks.slot[block], splat(0.0), splat(0.0)
            for k in range(3):
                force, torque = load(contacts.rows, k, s), load(contacts.rows, k + 3, s)
                forces, torques = fma(force, force, forces), fma(torque, torque, torques)
            # Forces on carriers of planes move no body.
            square = where(bits(blocks.alive[block]), fma(
                splat(inverse_mass), forces, splat(inverse_inertia) * torques), splat(0.0))
            total = 0.0
            for i in range(LANES):
                total += lane(square, i)
            contacts.pushes[block] = total


@compiled
def swing_of(contacts: Contacts | None, h: float) -> float:
    """
    Return the energy [J] that oscillates in steps of `h` [s] by contact forces of the last step.

    After `note_pushes` for all blocks.
    """
    if contacts is None:
        return 0.0
    else:
        total = 0.0
        for block in range(contacts.pushes.shape[0]):
            total += contacts.pushes[block]
        return _SWINGS * h * h * total
