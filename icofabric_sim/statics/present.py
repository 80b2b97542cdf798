# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Equilibrium of a running simulation under its present loads."""

from collections.abc import Callable
from typing import NamedTuple

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.inputs.inputs import Inputs
from icofabric_sim.simulation.model.body_force import BodyForce
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.simulation import Simulation
from icofabric_sim.statics.equilibrium import (
    Equilibrium,
    find_equilibrium,
    Progress,
    RESULTANTS,
    seek_least_resultants,
)
from icofabric_sim.statics.fabric import StaticFabric
from icofabric_sim.statics.friction import FrictionPath

_TOLERANCE, _MAX_STEPS = 1e-10, 2_000


class PresentState(NamedTuple):
    """State and inputs of a run at one time, independent of its further course."""

    scene: Scene
    snapshot: Snapshot
    inputs: Inputs
    body_force: BodyForce | None
    objective: str


def capture_run_state(simulation: Simulation, objective: str = 'energy') -> PresentState:
    """
    Return the present state of a run with its inputs: received wrenches and drives.

    `objective` is that of `solve_equilibrium`.

    Contacts have the stiffness of the run, so that the equilibrium found is one of the run too. A
    body force has its present value. Interactive drag forces are left out, because they are
    temporary.
    """
    scene = simulation.scene
    contact = simulation.packed.contact
    if contact is not None and not scene.parameters['contact.stiffness']:
        scene = scene.with_changes({'contact.stiffness': contact.stiffness})
    inputs = Inputs(scene)
    inputs.adopt(simulation.inputs, simulation.time, anew=False)
    inputs.pulls.clear()
    return PresentState(scene, simulation.snapshot(), inputs, simulation.body_force, objective)


def solve_run_equilibrium(
    present: PresentState, *, progress: Callable[[Progress], None] | None = None
) -> Equilibrium:
    """
    Find the equilibrium that follows from a present state; broken connectors stay broken.

    Raises ValueError if no equilibrium can exist.
    """
    snapshot = present.snapshot
    fabric = StaticFabric(
        present.scene, snapshot.time, broken_since=snapshot.broken_since, inputs=present.inputs,
        body_force=present.body_force, friction=FrictionPath.of(present.scene))
    search = seek_least_resultants if present.objective == RESULTANTS else find_equilibrium
    return search(fabric, snapshot, _TOLERANCE, _MAX_STEPS, progress)
