# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Methods whose steps all ranks take, and the start of their runs."""

from icofabric_sim.kernels.records import Loads
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.simulation.devices.leader import SharedSteps
from icofabric_sim.simulation.devices.pair_leader import SharedPair
from icofabric_sim.simulation.devices.refusals import require_shareable_method
from icofabric_sim.simulation.devices.transport import Transport
from icofabric_sim.simulation.devices.unpacked import Unpacked
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.model.stability import Frequency
from icofabric_sim.simulation.stepping.methods import facts_of, Method


def shared_method(
    transport: Transport, packed: PackedScene, name: str, *, given: bool, estimated: bool,
    half_edge: float,
    unpacked: Unpacked | None = None
) -> Method:
    """
    Return the method `name` with steps that all ranks take; raise ValueError if unsupported.

    `unpacked` is the initial state of the run if it is not packed.
    """
    require_shareable_method(name)
    method = facts_of(name)
    if method.embedded is not None and method.embedded.pair is not None:
        if unpacked is not None:
            # What steps of a pair need is on the first rank, too.
            unpacked.put()
        pair = SharedPair(transport, packed, method.embedded.pair)
        return method._replace(
            advance=pair.advance, executor=pair,
            embedded=method.embedded._replace(take=pair.take))
    steps = SharedSteps(
        transport, packed, method, given=given, estimated=estimated, half_edge=half_edge,
        unpacked=unpacked)
    return method._replace(
        advance=steps.advance, count_evaluations=steps.count_evaluations, executor=steps)


def begin_apart(
    transport: Transport, packed: PackedScene, initial: InitialState, loads: Loads, *,
    half_edge: float
) -> tuple[Unpacked, Frequency] | None:
    """
    Return the state of a run and its largest frequency, before its method is known.

    No process has the state as a whole. The result is None if a term requires sums in a single
    process.
    """
    if loads.anchors is not None or loads.drives is not None or packed.model.maxwell is not None:
        return None
    unpacked = Unpacked(packed.layout, initial)
    # No step is taken.
    none = facts_of('leapfrog')._replace(kicks=(), drifts=())
    steps = SharedSteps(
        transport, packed, none, given=True, estimated=False, half_edge=half_edge,
        unpacked=unpacked)
    steps.hold(packed.model, loads, unpacked.state, packed.layout.room(packed.model.links), None)
    frequency = steps.largest_frequency()
    return None if frequency is None else (unpacked, frequency)
