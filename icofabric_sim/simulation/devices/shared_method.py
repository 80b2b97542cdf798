# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Methods whose steps all ranks take."""

from icofabric_sim.simulation.devices.leader import SharedSteps
from icofabric_sim.simulation.devices.pair_leader import SharedPair
from icofabric_sim.simulation.devices.refusals import require_shareable_method
from icofabric_sim.simulation.devices.shared_state import SharedState
from icofabric_sim.simulation.devices.shared_trials import SharedTrials
from icofabric_sim.simulation.devices.transport import Transport
from icofabric_sim.simulation.devices.unpacked import Unpacked
from icofabric_sim.simulation.model.packing import PackedScene
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
            advance=pair.advance, holder=pair.holder,
            embedded=method.embedded._replace(take=pair.take))
    steps = SharedSteps(
        transport, packed, method, given=given, estimated=estimated, half_edge=half_edge,
        unpacked=unpacked)
    return method._replace(
        advance=steps.advance, count_evaluations=steps.count_evaluations, holder=steps.holder,
        beside=SharedTrials(steps),
        elsewhere=SharedState(steps))
