# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Where the fabric of a run comes to rest under what acts on it at this moment."""

from collections.abc import Callable
from typing import NamedTuple

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.inputs import Inputs
from icofabric_sim.simulation.model.body_force import BodyForce
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.simulation import Simulation
from icofabric_sim.statics.equilibrium import (
    Equilibrium,
    Progress,
    RESULTANTS,
    seek,
    seek_least_resultants,
)
from icofabric_sim.statics.fabric import StaticFabric
from icofabric_sim.statics.friction import FrictionPath

_TOLERANCE, _STEPS = 1e-10, 2_000


class Present(NamedTuple):
    """What a run is at one moment, independent of how it goes on."""

    scene: Scene
    snapshot: Snapshot
    inputs: Inputs
    body_force: BodyForce | None
    objective: str


def present_of(simulation: Simulation, objective: str = 'energy') -> Present:
    """
    Take the present state of a run, and what acts: received wrenches, and drives where they are.

    `objective`: what a search minimises, as of `solve_equilibrium`.

    Shells and planes push each other as stiffly as in the run, so that what is found is at rest
    there too, and a body force acts as it does at that time. Pulls by hand do not count: they end.
    """
    scene = simulation.scene
    contact = simulation.packed.contact
    if contact is not None and not scene.parameters['contact.stiffness']:
        scene = scene.with_changes({'contact.stiffness': contact.stiffness})
    inputs = Inputs(scene)
    inputs.adopt(simulation.inputs, simulation.time, anew=False)
    inputs.pulls.clear()
    return Present(scene, simulation.snapshot(), inputs, simulation.body_force, objective)


def rest_of(
    present: Present, *, progress: Callable[[Progress], None] | None = None
) -> Equilibrium:
    """
    Find where that fabric comes to rest, from where it is; what is broken stays broken.

    Raises ValueError where nothing could ever be in equilibrium.
    """
    snapshot = present.snapshot
    fabric = StaticFabric(
        present.scene, snapshot.time, broken_since=snapshot.broken_since, inputs=present.inputs,
        body_force=present.body_force, friction=FrictionPath.of(present.scene))
    search = seek_least_resultants if present.objective == RESULTANTS else seek
    return search(fabric, snapshot, _TOLERANCE, _STEPS, progress)
