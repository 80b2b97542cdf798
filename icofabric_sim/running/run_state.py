# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""State of a run, shared by its parts and changed only by its thread."""

from dataclasses import dataclass

from icofabric_sim.messages.schedule import NANOSECONDS, nanoseconds_not_before
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.simulation.simulation import Simulation


@dataclass
class RunState:
    """One simulation in time; `now` is always a whole number of nanoseconds."""

    simulation: Simulation
    parameters: Parameters  # in force; output rates, duration etc. may differ from the scene's
    now: int  # [ns]
    paused: bool
    failure: str = ''  # why simulated time has stopped; '': it has not
    is_held: bool = False  # the next step waits for its kernels

    @property
    def end(self) -> int:
        """Return the time [ns] at which the `duration` has passed; 0 without one."""
        duration = self.parameters['duration']
        return max(1, round(duration * NANOSECONDS)) if duration > 0.0 else 0

    @property
    def finished(self) -> bool:
        """Return whether the `duration` has passed."""
        return 0 < self.end <= self.now

    def catch_up(self) -> None:
        """Set `now` to the time reached by the simulation, also after an interrupted call."""
        self.now = max(self.now, nanoseconds_not_before(self.simulation.time))

    def require_sound(self, what: str) -> None:
        """Raise RuntimeError if the simulation has failed; `what` names the rejected action."""
        if self.failure:
            raise RuntimeError(
                f'{what}: the simulation has stopped ({self.failure}); reset it first')
