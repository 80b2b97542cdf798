# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Continuation of a recorded run with a simulation."""

from collections.abc import Callable
from pathlib import Path

from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.running.replay.resimulation import resimulate_to
from icofabric_sim.simulation.simulation import Simulation


def simulate_from(
    path: Path, fabric: str, time: int, on_time: Callable[[int], None] = lambda time: None
) -> tuple[Simulation, Parameters]:
    """
    Simulate the recorded run of `fabric` in the bag `path` again up to `time` [ns].

    Returns the simulation at that time and the parameters in force. Raises ValueError (mostly
    BagError) if the run cannot be repeated, and exceptions of `on_time`, which can cancel.
    """
    with RecordedRun(path, fabric) as run:
        simulation = resimulate_to(run, time, on_time=on_time)
        parameters = run.parameters_at(time)
    simulation.warm_up()
    return simulation, parameters
