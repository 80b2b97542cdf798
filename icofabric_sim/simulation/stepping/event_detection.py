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
The driver of a fabric whose connectors break: its steps end where one does.

A step in which a connector reaches its limit is given up: the moment is found in its dense
output, and a step is taken that ends there. It stays the step in progress, from which states
before the break come; the connector breaks when the next step begins. So neither outputs nor the
pieces in which a run is asked for touch the sequence.
"""

from typing import Any

from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.breakage import doubt_of, TOGETHER
from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.integrators import embedded
from icofabric_sim.kernels.records import Breakage, Connectors, Loads, State
from icofabric_sim.kernels.wrap.rates import measure_runs
from icofabric_sim.simulation.model.link_places import link_places
from icofabric_sim.simulation.state_tree import StateTree
from icofabric_sim.simulation.stepping.adaptive_driver import AdaptiveDriver, ANY
from icofabric_sim.simulation.stepping.broken import connector_numbers
from icofabric_sim.simulation.stepping.event_location import first_crossing, Moment
import numpy as np

_NONE = np.zeros(0, np.int64)


class BreakageLocatingDriver(AdaptiveDriver):
    """
    Takes steps, with what breaks between them.

    A given step rules as elsewhere, but for those that end where a connector breaks.
    """

    def __init__(self, *arguments: Any, fixed_step: float, **choices: Any) -> None:
        """See `FixedStepDriver`."""
        self._given_step = fixed_step
        # What breaks where the step in progress ends.
        self._due = _NONE
        super().__init__(*arguments, fixed_step=fixed_step, **choices)
        # Connector by its place in the rows of the limits.
        packed = self.packed
        assert packed.model.links is not None
        places = link_places(
            packed.layout, packed.model.links, self._connectors, slice(None))
        self._numbers = np.zeros(self._limits.excess.shape, np.int32)
        self._numbers[places.link, places.slot] = np.arange(
            places.link.shape[1], dtype=np.int32)
        self._place = places

    def state_tree(self) -> dict[str, Any]:
        """All that the steps to come depend on, body by body."""
        tree = super().state_tree()
        if len(self._due):
            tree['due'] = self._due.astype(float)
        return tree

    def load_state(self, tree: StateTree, loads: Loads | None) -> None:
        """Go on from there, with the `loads` that acted then."""
        super().load_state(tree, loads)
        self._due = _NONE
        if 'due' in tree:
            self._due = connector_numbers(tree.array('due'), self.packed)

    def set_loads(self, loads: Loads | None, load_rate: float) -> None:
        """Replace the loads at the current state."""
        super().set_loads(loads, load_rate)
        self._keep_given_step()

    @property
    def _limits(self) -> Breakage:
        assert self.work.breakage is not None
        return self.work.breakage

    @property
    def _connectors(self) -> Connectors:
        assert self.packed.connectors is not None
        return self.packed.connectors

    def _start(self, *, exact: bool = True) -> None:
        self._due = _NONE
        super()._start(exact=exact)

    def _choose_step(self, *, probe: bool = False, shorter: float = 1.0) -> None:
        super()._choose_step(probe=probe, shorter=shorter)
        self._keep_given_step()

    def _keep_given_step(self) -> None:
        if self.fixed:
            # Every error is right, and no step is longer.
            control = self.control
            control.tolerance = ANY
            control.longest = control.next = self.step = self._given_step

    def _give_up_step(self) -> None:
        super()._give_up_step()
        self._due = _NONE

    def _take(self, goal: float, count: int) -> int:
        if len(self._due):
            self._break(self._due)
        # A look that was due at the end of a step that was given up is made at the next.
        status = super()._take(goal, max(count, 1))
        if status & embedded.BREAKING:
            self._settle()
            self._since_check = min(self._since_check, self.look_interval - 1)
        if self.fixed:
            self.step = self._given_step
        return status

    def _settle(self) -> None:
        """Find what breaks first in the step in progress, if anything does, and end it there."""
        found = self._first_break()
        if found is None:
            return
        part, connectors = found
        control, following = self.control, self.control.next
        rest = control.length * part
        if not self.time + rest > self.time:
            # Already where the step begins.
            self._give_up_step()
            self._break(connectors)
            return
        if part < 1.0:
            self._give_up_step()
            control.next = rest
            super()._take(self.time, 1)
            control.next = following
            if control.length != rest:
                # Refused, and a shorter one taken: it breaks in a later step.
                return
        self._due = connectors

    def _break(self, connectors: np.ndarray) -> None:
        """
        Break connectors in the present state, which begins anew: nothing from before is reused.
        """
        before = self._stored_energy()
        self.broken.add(connectors, self.end)
        self.ledger.lost += before - self._stored_energy()
        self._due = _NONE
        control = self.control
        control.has_last = 0.0
        control.next = min(control.next, self._first_step())
        self._keep_given_step()
        # Nobody goes back to before it.
        self._save(self.end)

    def _stored_energy(self) -> float:
        """Energy [J] in the connectors of the present state."""
        numbers = self.ledger.numbers.copy()
        place_all(self.model, self.state, self.work, 0, len(self.model.blocks.slot))
        monitor.examine(
            self.model, self.loads, self.state, self.work, self.end, numbers)
        return float(numbers[monitor.STORED])

    def _first_break(self) -> tuple[float, np.ndarray] | None:
        """
        Part of the step in progress at which connectors break first, and their numbers.

        All that have reached their limit by then, or nearly: see `TOGETHER`.
        """
        limits = self._limits
        link, slot = np.nonzero(limits.excess > 0.0)
        seen = np.unique(self._numbers[link, slot])
        link, slot = self._place.link[0, seen], self._place.slot[0, seen]
        longest, shortest = limits.longest[link, slot], limits.shortest[link, slot]
        close = TOGETHER * np.concatenate([np.where(longest < np.inf, longest, 0.0), shortest])
        length = self.control.length

        def look(part: float) -> Moment:
            if part == 0.0:
                state = self._trail.start
            else:
                state = self.state if part == 1.0 else self._dense(part)
            now, rate = self._lengths(state, seen)
            return Moment(
                part, np.concatenate([now - longest, shortest - now]),
                length * np.concatenate([rate, -rate]))

        moment = first_crossing(look, close, doubt_of(self.model.wrapping))
        if moment is None:
            return None
        reached = moment.reached(close)
        return moment.x, seen[reached[:len(seen)] | reached[len(seen):]]

    def _lengths(self, state: State, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lengths [m] of some connectors in a state, and their rates [m/s]."""
        wrapping, connectors = self.model.wrapping, self._connectors
        if wrapping is not None:
            length, rate = np.zeros((2, len(chosen)))
            measure_runs(
                wrapping, state, *self._place.slot[:, chosen], connectors.first_edge[chosen],
                connectors.second_edge[chosen], np.ones(len(chosen), np.uint8), length, rate)
            return length, rate
        place_all(self.model, state, self.work, 0, len(self.model.blocks.slot))
        points = self.work.points.reshape(6, 3, -1)
        ends = []
        for edges, slot in zip(
                (connectors.first_edge, connectors.second_edge), self._place.slot):
            s = slot[chosen]
            x = points[edges[chosen], :, s].T
            (sx, sy, sz), (ox, oy, oz) = x - state.position[:, s], state.angular_velocity[:, s]
            turning = np.array([oy * sz - oz * sy, oz * sx - ox * sz, ox * sy - oy * sx])
            ends.append((x, state.linear_velocity[:, s] + turning))
        (x0, v0), (x1, v1) = ends
        u, v = x1 - x0, v1 - v0
        length = np.sqrt((u * u).sum(axis=0))
        return length, (u * v).sum(axis=0) / np.maximum(length, 1e-300)
