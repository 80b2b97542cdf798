# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Changes of the motion by the events of a run, and the outputs sent after them.

The run, `icofabric verify` and `~/continue` all use these functions, so that a bag is interpreted
in the same way.
"""

from collections.abc import Mapping
from enum import Enum
from typing import Any

from icofabric_sim.messages.schedule import seconds
from icofabric_sim.parameters.changes import restarts_motion
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.running.entities import checked_parts, set_body_state, STATE_PARTS
from icofabric_sim.simulation.simulation import Simulation
import numpy as np

# A paused run pauses again at the end of an advance.
_RUNS_AFTER = {
    'pause': False, 'resume': True, 'advance': True, 'advanced': False, 'advance_ended': False}
# The present state is sent with them instead of the outputs due at that time.
_SHOW_INSTEAD = ('failed', 'advanced')


class Shown(Enum):
    """Outputs after an event, besides those due by the schedules."""

    NOTHING = 'nothing'
    PRESENT = 'the present state'
    ANEW = 'the scene and the present state, after earlier markers are removed'


def do_event(
    simulation: Simulation, nanoseconds: int, name: str, facts: Mapping[str, Any]
) -> None:
    """
    Apply the event `name` to the motion; many events do not affect it.

    The `simulation` is at the time of the event, or has failed before. Raises SimulationError if
    it fails, and KeyError, TypeError or ValueError for invalid `facts`. Re-weaves are applied by
    `replace_simulation`.
    """
    if name == 'reset' and facts.get('time_reset'):
        simulation.reset_time()
    elif name == 'reset':
        simulation.reset(time=seconds(nanoseconds))
    elif name == 'state_set':
        parts = {part: facts[part] for part in STATE_PARTS if part in facts}
        set_body_state(simulation, int(facts['body']), checked_parts(parts))
    elif name == 'equilibrium':
        still = np.zeros((simulation.scene.body_count, 3))
        simulation.set_state(
            position=np.array(facts['position'], dtype=float),
            orientation=np.array(facts['orientation'], dtype=float),
            linear_velocity=still, angular_velocity=still, relaxed=True)
    elif name == 'failed':
        simulation.advance_to(seconds(int(facts['target'])))


def replace_simulation(
    previous: Simulation, built: Simulation, nanoseconds: int, before: Parameters,
    after: Parameters,
) -> bool:
    """
    Continue with `built` from the state of `previous`; return whether the motion restarts.

    `before` and `after` are the parameters in force before and after the change. Raises ValueError
    or SimulationError if `built` cannot continue from that state.
    """
    restarts = restarts_motion(before, after)
    built.continue_from(previous, keep_motion=not restarts)
    # A failed run is at a time before its last output.
    built.advance_to(seconds(nanoseconds))
    return restarts


def is_jump(name: str, facts: Mapping[str, Any]) -> bool:
    """Return whether time jumps at an event, which ends a bag and starts the next one."""
    return name == 'checkpoint_restored' or (name == 'reset' and bool(facts.get('time_reset')))


def runs_after(name: str, *, running: bool) -> bool:
    """Return whether time runs after an event; `running` is the state before it."""
    return _RUNS_AFTER.get(name, running)


def shows_instead(name: str) -> bool:
    """Return whether an event precedes and replaces the outputs due at its time."""
    return name in _SHOW_INSTEAD


def shown_after(name: str, *, running: bool) -> Shown:
    """Return the outputs after an event; after a failure only if the state is finite."""
    if name in ('reset', 'reweave', 'checkpoint_restored'):
        return Shown.ANEW
    if name in ('step', 'advanced', 'failed', 'equilibrium') or (
            name == 'state_set' and not running):
        return Shown.PRESENT
    return Shown.NOTHING
