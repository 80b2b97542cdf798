# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Start of a run whose state no process has as a whole, and its largest frequency."""

from icofabric_sim.kernels.records import Loads
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.simulation.devices.leader import SharedSteps
from icofabric_sim.simulation.devices.shared_state import SharedState
from icofabric_sim.simulation.devices.transport import Transport
from icofabric_sim.simulation.devices.unpacked import Unpacked
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.model.stability import Frequency
from icofabric_sim.simulation.stepping.methods import facts_of


def begin_apart(
    transport: Transport, packed: PackedScene, initial: InitialState, loads: Loads, *,
    half_edge: float
) -> tuple[Unpacked, Frequency] | None:
    """
    Return the state and its largest frequency, before the method of the steps is known.

    The result is None if a term requires sums in a single process.
    """
    if loads.anchors is not None or loads.drives is not None or packed.model.maxwell is not None:
        return None
    unpacked = Unpacked(packed.layout, initial)
    # No step is taken.
    none = facts_of('leapfrog')._replace(kicks=(), drifts=())
    steps = SharedSteps(
        transport, packed, none, given=True, estimated=False, half_edge=half_edge,
        unpacked=unpacked)
    state = SharedState(steps)
    state.hold(packed.model, loads, unpacked.state, packed.layout.room(packed.model.links), None)
    frequency = state.largest()
    return None if frequency is None else (unpacked, frequency)
