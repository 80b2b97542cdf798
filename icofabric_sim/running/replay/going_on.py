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
