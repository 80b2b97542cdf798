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
"""
What the events of a run mean: what each does to the motion, and what the run shows after it.

The run itself, `icofabric verify` and `~/continue` all do events by these functions, so a record
means what was done.
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

# A pause goes on once an advance has come to its end.
_RUNS_AFTER = {
    'pause': False, 'resume': True, 'advance': True, 'advanced': False, 'advance_ended': False}
# The present state is shown with them in place of what is due at that time.
_SHOW_INSTEAD = ('failed', 'advanced')


class Shown(Enum):
    """What a run sends after an event, beside what is due by the clock."""

    NOTHING = 'nothing'
    PRESENT = 'the present state'
    ANEW = 'the scene and the present state, after earlier markers are removed'


def do_event(
    simulation: Simulation, nanoseconds: int, name: str, facts: Mapping[str, Any]
) -> None:
    """
    Do to the motion what the event `name` of that time means; many events do not touch it.

    The `simulation` stands at that time, or has failed before it. Raises SimulationError where it
    fails, and KeyError, TypeError or ValueError where the `facts` do not fit it. Another weave
    is done by `replace_simulation`.
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
    Have `built` go on where `previous` stands, at that time; returns whether the motion restarts.

    `before` and `after` are the parameters in force on either side of the change. Raises
    ValueError or SimulationError where `built` cannot go on from there.
    """
    restarts = restarts_motion(before, after)
    built.take_over(previous, keep_motion=not restarts)
    # A failed run stands before the time that was seen of it.
    built.advance_to(seconds(nanoseconds))
    return restarts


def is_jump(name: str, facts: Mapping[str, Any]) -> bool:
    """Whether the time jumps at an event: a bag ends with it, and the next one begins."""
    return name == 'checkpoint_restored' or (name == 'reset' and bool(facts.get('time_reset')))


def runs_after(name: str, *, running: bool) -> bool:
    """Whether simulated time goes on after an event, where it was `running` before or not."""
    return _RUNS_AFTER.get(name, running)


def shows_instead(name: str) -> bool:
    """Whether an event comes before what is due at its time, and replaces that."""
    return name in _SHOW_INSTEAD


def shown_after(name: str, *, running: bool) -> Shown:
    """What a run sends after an event; a failed one only where its state is finite."""
    if name in ('reset', 'reweave', 'checkpoint_restored'):
        return Shown.ANEW
    if name in ('step', 'advanced', 'failed', 'equilibrium') or (
            name == 'state_set' and not running):
        return Shown.PRESENT
    return Shown.NOTHING
