# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Power that contacts dissipate."""

from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import Vector
from icofabric_sim.terms.contacts.losses import add_taken, losses_of
from icofabric_sim.terms.contacts.record import Contacts


@compiled
def add_velocity_force(contacts: Contacts | None, s: int, spent: Vector) -> Vector:
    """Add the power [W] that contacts dissipate at a block; their forces are in the wrench."""
    return add_taken(losses_of(contacts), s, spent)
