# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The leapfrog of the package without health checks, and a leapfrog for springs alone."""

from collections.abc import Callable
from typing import Any, NamedTuple

from icofabric_sim.kernels import flows, monitor
from icofabric_sim.kernels.records import State, Work
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.model.packing import pack_loads, PackedScene
from icofabric_sim.simulation.simulation import Simulation
from icofabric_sim.simulation.stepping.methods import METHODS
from icofabric_sim.simulation.stepping.thread_team import ThreadTeam
from icofabric_validation.benchmarks.instructions import loop_instructions
from icofabric_validation.benchmarks.step_speed import STEP
import numpy as np

# Takes a number of steps from a state, with work arrays.
Kernel = Callable[[State, Work, int], None]
_NEVER = 2**62


class Instructions(NamedTuple):
    """Machine instructions in the loop of a kernel."""

    kernel: str
    package: int | None
    springs_only: int | None
    leanest: int | None

    def difference(self) -> float | None:
        """Relative excess of instructions over the springs-only kernel."""
        if self.package is None or self.springs_only is None:
            return None
        return self.package / self.springs_only - 1.0


def count_instructions(packed: PackedScene, scene: Scene, other: Any) -> list[Instructions]:
    """Count instructions in the loops of the two flows, of the package and of `other`."""
    model, (state, work) = packed.model, fresh(packed, scene)
    slot, last = model.blocks.slot, len(model.blocks.slot)
    masses = model.inverse_mass, model.inverse_inertia
    assert model.links is not None
    order = np.arange(last, dtype=np.uint32)
    return [
        Instructions(
            'push',
            loop_instructions(
                flows.push, model, None, state, work, None, 0.0, 0.0, 0.0, 0.0, False, order, 0,
                last),
            loop_instructions(
                other.push, model.links, slot, *masses, state, work.points, work.acceleration,
                0.0, 0.0, False, 0, last),
            loop_instructions(
                other.push_once, model.links, slot, *masses, state, work.points, 0.0, 0, last)),
        Instructions(
            'drift',
            loop_instructions(flows.drift, model, None, state, work, 0.0, 0.0, order, 0, last),
            *[loop_instructions(
                other.drift, model.links.half_width, slot, state, work.points, 0.0, 0,
                last)] * 2),
    ]


def fresh(packed: PackedScene, scene: Scene) -> tuple[State, Work]:
    """Return the initial state with its accelerations."""
    state, work = packed.layout.pack(scene.initial), packed.layout.room(packed.model.links)
    last = len(packed.model.blocks.slot)
    flows.place_all(packed.model, state, work, 0, last)
    flows.keep_accelerations(packed.model, state, work, 0.0, 0, last)
    return state, work


def require_same_motion(bare: Simulation, kernels: list[Kernel]) -> None:
    """Raise RuntimeError unless the kernels give the same state up to round-off."""
    ends = []
    for run in kernels:
        state, work = fresh(bare.packed, bare.scene)
        run(state, work, 100)
        ends.append(bare.packed.layout.gather(state.position))
    moved = np.abs(ends[0] - bare.scene.initial.position).max()
    if not np.abs(ends[0] - ends[1]).max() < 1e-9 * moved:
        raise RuntimeError('springs_only.py does not move the bodies as the package does')


def package_kernel(packed: PackedScene) -> Kernel:
    """Return the kernel of the package without health checks."""
    ledger = np.zeros(monitor.LEDGER_COUNT)
    ledger[monitor.OBSTRUCTED_LIMIT] = np.inf
    team = ThreadTeam(1, packed).team(0)
    advance, loads = METHODS['leapfrog'].advance, pack_loads((), packed.layout)

    def run(state: State, work: Work, count: int) -> None:
        # Without health checks nothing is saved.
        status, done, _ = advance(
            packed.model, loads, state, state, work, team, 0.0, 0, STEP, count, 0, _NEVER, None,
            ledger)
        assert status == 0 and done == count
    return run


def springs_kernel(packed: PackedScene, other: Any) -> Kernel:
    """Return the springs-only kernel: kick, drift, kick."""
    model = packed.model

    def run(state: State, work: Work, count: int) -> None:
        other.leapfrog(
            model.links, model.blocks.slot, model.blocks.reach, model.inverse_mass,
            model.inverse_inertia, state, work.points, work.acceleration, STEP, count)
    return run


def leanest_kernel(packed: PackedScene, other: Any) -> Kernel:
    """Return the springs-only kernel with one kick per step."""
    model = packed.model

    def run(state: State, work: Work, count: int) -> None:
        other.leapfrog_once(
            model.links, model.blocks.slot, model.blocks.reach, model.inverse_mass,
            model.inverse_inertia, state, work.points, STEP, count)
    return run
