# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Transition from a replay to a simulation: the run is simulated again to a time and continues.
"""

from collections.abc import Mapping
from concurrent.futures import Future
from pathlib import Path
import threading
from typing import Any, TYPE_CHECKING

from icofabric_sim.ros.start import StopSignals

if TYPE_CHECKING:
    from icofabric_sim.parameters.validation import Parameters
    from icofabric_sim.ros.process import Presence
    from icofabric_sim.simulation.simulation import Simulation

# Parameters of the recorded node that do not apply to the new simulation.
_RECORDED_NODE_PARAMETERS = ('record.path', 'record.storage', 'publish_clock')


class ReplayContinuation:
    """Recorded run that is simulated again to continue it."""

    def __init__(self, path: Path, fabric: str, paused: bool) -> None:
        """Prepare the run of `fabric` in the bag `path`; it will start paused if `paused`."""
        self._path, self._fabric, self._paused = path, fabric, paused
        self._simulation: 'Simulation | None' = None
        self._parameters: 'Parameters | None' = None
        self.reached = 0  # [ns] recorded time simulated so far
        self.is_cancelled = False  # true cancels the simulation

    def build(self, time: int) -> 'Future[None]':
        """Simulate the recorded run again up to `time` [ns] in a new thread."""
        future: Future[None] = Future()

        def work() -> None:
            try:
                self._build(time)
            except BaseException as error:  # noqa: BLE001 - passed on in the answer
                future.set_exception(error)
            else:
                future.set_result(None)

        threading.Thread(target=work, name='rebuilding', daemon=True).start()
        return future

    def _build(self, time: int) -> None:
        # Imported here because it loads the compiler, which a replay does not need.
        from icofabric_sim.running.replay.continuation import simulate_from

        self._simulation, self._parameters = simulate_from(
            self._path, self._fabric, time, self._note)

    def _note(self, time: int) -> None:
        if self.is_cancelled:
            raise RuntimeError('the replay has ended')
        self.reached = time

    def run(
        self, options: Mapping[str, Any], rate: float, signals: StopSignals,
        presence: 'Presence',
    ) -> int:
        """
        Run the simulation under the node name of the replay; return the exit status at its end.

        The simulation keeps the real-time factor of the replay (`rate`). `presence` has kept the
        ROS participant in the graph since the node of the replay ended.
        """
        from icofabric_sim.ros.fabric import FabricNode, run_node

        assert self._simulation is not None and self._parameters is not None
        parameters = self._parameters.with_changes({
            **{name: options[name] for name in _RECORDED_NODE_PARAMETERS},
            'duration': 0.0,  # the recorded duration may have passed
            'real_time_factor': rate,
            'start_paused': self._paused,
        })
        return run_node(
            FabricNode(parameters, simulation=self._simulation, presence=presence), signals)
