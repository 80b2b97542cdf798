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
"""What follows from a health check of the state: another step, a way back, or the end."""

import logging
import math
from typing import Any

from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.contact.rebuild_check import MISSED, MOVED_FAR
from icofabric_sim.kernels.drives import place_driven
from icofabric_sim.kernels.records import Loads, State
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.contact.broad_phase import BroadPhase
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.model.stability import fastest_motion, Frequency
from icofabric_sim.simulation.state_tree import StateTree
from icofabric_sim.simulation.stepping.broken import Broken
from icofabric_sim.simulation.stepping.contact_scheduling import ContactScheduledTrajectory
from icofabric_sim.simulation.stepping.faults import (
    fastest_term,
    find_fault,
    shorter_steps,
    stiffest_term,
    too_fast,
)
from icofabric_sim.simulation.stepping.methods import Method
from icofabric_sim.simulation.stepping.obstruction import Obstruction
from icofabric_sim.simulation.stepping.step_size_control import (
    checked_step,
    LONGEST,
    rounded_down,
    SHORTEST,
    StepSizeController,
)
from icofabric_sim.simulation.stepping.thread_team import ThreadTeam
from icofabric_sim.simulation.stepping.touching_errors import TouchingErrors
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')

# Work between two looks at the state, in evaluations of the forces; a look costs about as much as
# one and a half.
CHECK_INTERVAL = 64
# A fixed step near the limit is looked at more often, at most every so many steps.
SHORTEST_INTERVAL = 8
# Order of the differences by which the roughness of the motion is judged: that of the method,
# but no more steps than this between two looks.
LARGEST_DIFFERENCE = 6


# Velocities over a that a chosen step may be wrong by, beside the tolerance for a second.
_BESIDE_TOLERANCE = 100.0


class MonitoredTrajectory(ContactScheduledTrajectory):
    """A trajectory whose steps are as long as its state and its accuracy allow."""

    def __init__(
        self,
        packed: PackedScene,
        method: Method,
        state: State,
        loads: Loads | None,
        frequency: Frequency,
        *,
        origin: float,
        fixed_step: float,
        tolerance: float,
        energy_limit: float,
        output_period: float,
        load_rate: float,
        half_edge: float,
        thread_team: ThreadTeam,
        watch: BroadPhase | None,
        broken: Broken,
        obstruction: Obstruction,
    ) -> None:
        """
        Start at time `origin` [s] with the `frequency` of the state; `fixed_step` 0: chosen.

        `output_period` [s] is the step where nothing in the scene sets a scale.

        Raises ValueError where a fixed step is too long or far too short.
        """
        # Only where the step follows the accuracy.
        self._differences = 0
        if method.symplectic and not fixed_step > 0.0 and packed.model.links is not None:
            self._differences = min(method.order, LARGEST_DIFFERENCE)
        super().__init__(
            packed, method, state, loads, origin=origin, fixed_step=fixed_step,
            differences=self._differences, energy_limit=energy_limit, half_edge=half_edge,
            thread_team=thread_team, watch=watch, broken=broken,
            obstruction=obstruction)
        self.load_rate, self._fabric = load_rate, frequency
        self._output_period = output_period
        self.step_size = StepSizeController(self, tolerance, half_edge)
        self.touching = None if watch is None or (method.adaptive and not fixed_step > 0.0) else (
            TouchingErrors(self, self.step_size.distance))
        self._since_check = 0
        self.look_interval = max(CHECK_INTERVAL // method.stages, 1)
        if self._differences:
            # Whole windows of the steps by which the roughness of the motion is judged.
            windows = -(-self.look_interval // self._differences)
            self.look_interval = windows * self._differences
        self._returned_to = -math.inf
        # Whether it is the speed of bodies that limits the step.
        self._held_back = False
        if self.fixed:
            checked_step(fixed_step, self.limit, frequency.rate + packed.velocity_rate)
        else:
            self.step_size.require_possible(frequency.rate)
        self._start(exact=False)
        self._require_safe_step(origin)

    def _start(self, *, exact: bool = True) -> None:
        """Compute the accelerations, the frequency and the step anew: the state has jumped."""
        place_driven(self.model, self.loads, self.state, self.time)
        if self.watch is not None:
            self.watch.stretches.forget()
        self._look_for_contacts(self.time)
        self._refresh()
        for meter in self._meters().values():
            meter.done[:] = 0.0
        self.ledger.restart()
        self.ledger.obstructed_limit = (
            0.0 if self.obstruction.looks_out else math.inf)
        self._save()
        self.ledger.obstructed_every = self.obstruction.looks
        self.ledger.until_obstructed = 0.0
        self._read_rates(exact=exact)
        # So does the first look of the run.
        self.ledger.until_obstructed = 0.0
        self._require_room()
        self.ledger.open(
            self._moving(self.state), self.packed.layout.gather(self.work.acceleration),
            self.frequency.rate,
            _BESIDE_TOLERANCE * self.step_size.tolerance if self.method.adaptive and (
                not self.fixed) else 0.0)
        force = self.packed.body_force
        if force is not None:
            place = self.packed.layout.unpack(self.state)
            self._potential_start = force.energy(self.time, place.position, place.orientation)
        self.step_size.restart()
        self._choose_step()
        if self.touching is not None:
            self.touching.restart()
            self.touching.begin(self._saved_time)

    def jump(self, time: float, state: State, loads: Loads | None, load_rate: float) -> None:
        """
        Go on from another `state` at `time`, as a run that starts there; a failure is forgotten.
        """
        self._failure = None
        self.step_size.close(time)
        self.origin, self.index, self.state = time, 0, state
        self.loads, self.load_rate = loads, load_rate
        self._since_check, self._returned_to = 0, -math.inf
        if not self.fixed:
            # Chosen afresh: the step must not depend on what was before.
            self.step = 0.0
        self._start()
        self._require_safe_step(time)

    def forget(self) -> None:
        """Count steps and errors from zero again: a run begins that has no past."""
        self.step_count, self.step_size.total = 0, 0.0
        if self.touching is not None:
            self.touching.total = 0.0
        self.obstruction.found = ''
        self.ledger.told_limit = math.inf if self.watch is None else self.watch.told
        if self.watch is not None:
            self.watch.forget()

    def rebase(self, time: float) -> None:
        """Move a stepper that has not moved yet to another start `time`."""
        self.origin, self.index, self._saved_time = time, 0, time
        self.step_size.rebase(time)
        if self.touching is not None:
            self.touching.begin(time)
        if self.watch is not None:
            self.watch.rebase(time)

    def set_loads(self, loads: Loads | None, load_rate: float) -> None:
        """Replace the loads at the current state."""
        self.ledger.keep_work(self.loads)
        # Nobody goes back to before other loads.
        self.ledger.regular = 0.0
        self.loads = loads
        self.load_rate = load_rate
        if self.touching is not None:
            self.touching.spoil()
        place_driven(self.model, loads, self.state, self.time)
        self._choose_step()

    def error_rate(self) -> float:
        """Error that the method adds for each second, measured last."""
        return self.step_size.rate

    def error_estimate(self, time: float) -> float:
        """Errors added from the start to a present `time` [s], as if none had grown or faded."""
        touching = 0.0 if self.touching is None else self.touching.total
        return self.step_size.estimate(time) + touching

    def state_tree(self) -> dict[str, Any]:
        """All that the steps to come depend on, body by body."""
        tree = {
            **super().state_tree(),
            'since_check': self._since_check,
            'look_interval': self.look_interval,
            'returned_to': self._returned_to,
            'held_back': self._held_back,
            'load_rate': self.load_rate,
            'frequency': self._fabric.rate,
            'accuracy': self.step_size.state_tree(),
        }
        if self.touching is not None:
            tree['touching'] = self.touching.state_tree()
        if self._is_in_window:
            difference = self.work.difference
            # Also lanes without a body count, so this is only for processors with as many lanes.
            tree['window'] = difference.reshape(len(difference), -1, LANES).copy()
        return tree

    def load_state(self, tree: StateTree, loads: Loads | None) -> None:
        """Go on from there, with the `loads` that acted then."""
        super().load_state(tree, loads)
        least, most = (1, CHECK_INTERVAL) if self.fixed else (self.look_interval,) * 2
        self.look_interval = tree.count('look_interval', least, most)
        self._since_check = tree.count('since_check', 0, self.look_interval - 1)
        self._returned_to = tree.number('returned_to', finite=False)
        self._held_back = tree.flag('held_back')
        self.load_rate = tree.number('load_rate', 0.0, finite=False)
        self._fabric = Frequency(tree.number('frequency', 0.0, finite=False), (), 0)
        self.step_size.load_state(tree.part('accuracy'))
        if self.touching is not None:
            self.touching.load_state(tree.part('touching'))
        if self._is_in_window:
            window, own = tree.array('window'), self.work.difference
            if window.shape == (len(own), own.shape[1] // LANES, LANES):
                own[:] = window.reshape(own.shape)
            else:
                # Of a processor with other lanes: the next look does not judge the roughness.
                self.ledger.regular = 0.0

    @property
    def _is_in_window(self) -> bool:
        """Whether some, but not all, of the steps of a difference are taken."""
        if not self._differences:
            return False
        first = self.look_interval - self._differences if self.method.stages < 4 else 0
        taken = self._since_check - first
        return taken > 0 and taken % self._differences != 0

    def _settle_roughness(self, time: float) -> bool:
        """
        The motion became rougher: measure anew, and go back if the error was too large.

        Whether the run goes on from here; else it is back at the last look.
        """
        factor = self.step_size.excess()
        if factor is None:
            self._save(time)
            return True
        whole = self.ledger.regular >= self.look_interval
        if factor > 1.0 and whole and self._saved_time != self._returned_to:
            # What was shown of the way there stays counted.
            self.step_size.close(time)
            self._return_to_saved()
            if self.touching is not None:
                self.touching.begin(self._saved_time)
            self._returned_to = self._saved_time
            if self.loads is not None:
                np.copyto(self.loads.work, self.loads.earlier_work)
            self.ledger.regular = 0.0
            self._choose_step(probe=True, shorter=factor)
            return False
        self._save(time)
        if time == self.time:
            self._choose_step(probe=True)
        return True

    def _respond(self, status: int, time: float) -> None:
        if status & monitor.NOT_FINITE:
            self._fail_here('is no longer finite', time)
        if status & monitor.UNBALANCED:
            self._fail_unbalanced(time)
        if status & monitor.OBSTRUCTING:
            self._meet_obstruction(time)
        if status & (monitor.TOO_DEEP | monitor.DEEP):
            self._meet_overlap(time, stop=bool(status & monitor.TOO_DEEP))
        if status & (MOVED_FAR | MISSED):
            self._look_again(time, missed=bool(status & MISSED))
            if status & MISSED and self._since_check == 0:
                # Kernels do not save where a contact may be behind.
                self._save(time)
        if status & (monitor.RATE_HIGH | monitor.RATE_LOW):
            self._read_rates()
            if not self.fixed:
                if not self.step <= self.limit:
                    _LOGGER.warning(
                        'the fabric changed so fast before t = %.6g s that up to %d steps were '
                        'longer than stable (limit %.3g s): their energy may be wrong; %s',
                        time, self.look_interval, self.limit, self._way_out(),
                    )
                self._choose_step(probe=True)
            self._require_safe_step(time)

    def _look_again(self, time: float, *, missed: bool) -> None:
        """Bodies have moved far: find what can touch now, and follow it with the step."""
        if self.watch is None:
            return
        if missed:
            self.watch.miss(self._way_out())
        before = self.watch.rate
        self._look_for_contacts(time)
        longest = self.watch.longest_step
        if not self.fixed and (
                self.watch.rate != before or self._held_back or not self.step <= longest):
            self._follow_contacts()
        self._pace(self.step)
        if missed and self.fixed and not self.step <= self.limit:
            self._return_to_saved()
        self._require_safe_step(time)

    def _follow_contacts(self) -> None:
        """Choose the step anew: contacts have begun, or are over, or bodies have become fast."""
        self._choose_step()

    def _meet_obstruction(self, time: float) -> None:
        """Say once that a connector runs into its own shell, or stop."""
        self.ledger.obstructed_limit = math.inf
        self.obstruction.note(time, self.state, self.broken.since)
        if self.obstruction.stops:
            self._return_to_saved()
            self._fail(
                f'{self.obstruction.found}, and connector.obstruction is stop; warn lets it pass '
                f'through. The state of t = {self._saved_time:.9g} s is kept')

    def _fail_here(self, what: str, time: float) -> None:
        """Stop because numbers have run away: name where, and go back to the last good state."""
        fault = find_fault(self.packed, self.state)
        self._return_to_saved()
        self._fail(
            f'the state of {fault} {what} at t = {time:.9g} s, after steps of {self.step:.6g} s; '
            f'the last good state, of t = {self._saved_time:.9g} s, is kept'
        )

    def _fail_unbalanced(self, time: float) -> None:
        fault = find_fault(self.packed, self.state)
        imbalance, way_out = self.ledger.describe_imbalance(time), self._way_out()
        self._return_to_saved()
        self._fail(
            f'{imbalance}; the fastest is {fault}, and steps are {self.step:.6g} s (limit '
            f'{self.limit:.6g} s). Start again: {way_out}; the last good state, of t = '
            f'{self._saved_time:.9g} s, is kept'
        )

    def _way_out(self) -> str:
        """Say what makes steps shorter."""
        if self.fixed:
            return 'give a smaller solver.step, or 0 to have it chosen'
        return shorter_steps(self.step, self.step_size.tolerance, self._fastest_term())

    def _fastest_term(self) -> str:
        """Name what moves or vibrates fastest, with its parameters."""
        rates = {
            stiffest_term(self.packed, anchored=self.loads is not None and (
                self.loads.anchors is not None)): self._fabric.rate,
            'spinning bodies': self.ledger.spin,
            'bodies under loads and drives': self.load_rate,
            'what takes energy from velocities (damping, drag, magnetic field)': (
                self.packed.velocity_rate)}
        if self.watch is not None:
            stiffness = self.watch.setup.stiffness
            rates[f'contacts (contact.stiffness {stiffness:.4g} N/m)'] = math.sqrt(self.watch.rate)
        return fastest_term(rates)

    def _read_rates(self, *, exact: bool = True) -> None:
        """Exact largest frequency, and the cheap bound beside it for later comparison."""
        if exact:
            self._fabric = self._largest_frequency()
        ledger = self.ledger
        ledger.high, ledger.low, ledger.spin_weight = math.inf, 0.0, 1.0
        monitor.examine(
            self.model, self.loads, self.state, self.work, self.time, ledger.numbers)
        if self.fixed:
            # Below this the bound proves the step safe. Above it the exact value is computed at
            # every look: the bound may be three times as high, its own growth says nothing.
            ledger.high = self.method.stability / self.step - self.packed.velocity_rate
            ledger.spin_weight = 0.0
            # As often in time as with a chosen step, as far as that is affordable.
            ratio = self.step * self.frequency.rate / self.method.chosen
            steps = CHECK_INTERVAL / self.method.stages / max(ratio, 1.0)
            self.look_interval = max(int(steps), SHORTEST_INTERVAL)

    def _choose_step(self, *, probe: bool = False, shorter: float = 1.0) -> None:
        """
        Choose the step: stable, and as accurate as asked; it is kept while it is about right.

        `probe` measures the accuracy anew; the state must have been saved. `shorter`: how many
        times too large the error is believed to be.
        """
        rate = self._fastest()
        if self.fixed:
            self._pace(self.step)
            if probe or self.step_size.is_new or self.load_rate > self.step_size.load_rate:
                if not probe:
                    self._save()
                self.step_size.measure_only(self.step, rate, jumped=not probe)
            return
        if not rate < math.inf:
            self._fail(too_fast(self.time, self._fastest_term()))
        chosen = self.method.chosen
        step = self.step * shorter ** (-1.0 / self.method.order)
        if not rate > 0.0:
            # Every step is exact.
            step, rate = self._output_period, chosen / self._output_period
        cap = chosen / rate
        if self.watch is not None:
            self._held_back = self.watch.longest_step < cap
            cap = min(cap, self.watch.longest_step)
        if not SHORTEST * min(cap, self.step_size.step) <= step <= LONGEST * cap:
            step = rounded_down(min(cap, self.step_size.step))
        if probe or self.step_size.is_new or self.load_rate > self.step_size.load_rate:
            if not probe:
                self._save()
            step = self.step_size.choose(step, rounded_down(cap), rate, jumped=not probe)
        if not self.time + step > self.time:
            # It would be lost in the time that it is added to.
            self._fail(too_fast(self.time, self._fastest_term()))
        if step != self.step:
            self.origin, self.index, self.step = self.time, 0, step
            self.ledger.regular = 0.0
            if self.touching is not None and self._since_check:
                self.touching.spoil()
        self._pace(step)
        # Above the first the exact value is computed again once the bound has grown; near the
        # limit of the method at every look.
        ledger = self.ledger
        near = min(1.05 * ledger.rate, 0.9 * self.method.stability / step)
        ledger.high = max(LONGEST * chosen / step, near)
        ledger.low = SHORTEST * chosen / step if self.step_size.step >= cap else 0.0

    @property
    def fabric_rate(self) -> float:
        """Largest frequency [rad/s] of the fabric alone."""
        return self._fabric.rate

    def _fastest(self) -> float:
        """
        Rate [rad/s] of the fastest motion; 0 where nothing turns, vibrates or is accelerated.
        """
        watch = self.watch
        rate = fastest_motion(
            self.packed, self.state, self.frequency.rate, self.ledger.spin,
            self.load_rate, *((None, 0.0) if watch is None else (watch.passing, watch.fall)))
        return rate if rate > 0.0 else self._acceleration_rate()

    def _acceleration_rate(self) -> float:
        """Rate [rad/s] at which forces move bodies at rest by a, or turn them by a radian."""
        self._refresh()
        acceleration = self.packed.layout.gather(self.work.acceleration)
        linear, angular = np.linalg.norm(acceleration.reshape(-1, 2, 3), axis=2).max(
            axis=0, initial=0.0)
        return math.sqrt(max(float(linear) / self.half_edge, float(angular)))
