# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
What follows from a look at the state on the main line: another step, a way back, or the end.
"""

import logging
import math
from typing import Any

from icofabric_sim.broken import Broken
from icofabric_sim.contact_line import ContactLine
from icofabric_sim.contact_watch import ContactWatch
from icofabric_sim.crew import Crew
from icofabric_sim.faults import find_fault, too_fast
from icofabric_sim.integrators.methods import Method
from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.drives import place_driven
from icofabric_sim.kernels.lanes import LANES
from icofabric_sim.kernels.looking import MISSED, MOVED_FAR
from icofabric_sim.kernels.records import Loads, State
from icofabric_sim.memory import Memory
from icofabric_sim.model import PackedScene
from icofabric_sim.obstruction import Obstruction
from icofabric_sim.stability import (
    fastest_motion,
    Frequency,
)
from icofabric_sim.step_choice import Accuracy, checked_step, LONGEST, rounded_down, SHORTEST
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')

# Work between two looks at the state, in evaluations of the forces; a look costs about as much as
# one and a half.
CHECK_INTERVAL = 64
# A fixed step near the limit is looked at more often, at most every so many steps.
SHORTEST_INTERVAL = 8
# Where nothing sets a scale (no connectors, no gravity, no loads, no spin) every step is exact.
FREE_STEP = 2.0**-7
# Below it a step is lost in the time [s] that it is added to, and no run comes to an end.
SHORTEST_STEP = 1e-15
# Order of the differences by which the roughness of the motion is judged: that of the method,
# but no more steps than this between two looks.
LARGEST_DIFFERENCE = 6


class WatchedLine(ContactLine):
    """
    A main line whose steps are as long as its state and its accuracy allow.
    """

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
        load_rate: float,
        half_edge: float,
        crew: Crew,
        watch: ContactWatch | None,
        broken: Broken,
        obstruction: Obstruction,
    ) -> None:
        """
        Start at time `origin` [s] with the `frequency` of the state; `fixed_step` 0: chosen.

        Raises ValueError where a fixed step is too long or far too short.
        """
        # Only where the step follows the accuracy.
        self._differences = 0
        if method.symplectic and not fixed_step > 0.0 and packed.model.links is not None:
            self._differences = min(method.order, LARGEST_DIFFERENCE)
        super().__init__(
            packed, method, state, loads, origin=origin, fixed_step=fixed_step,
            differences=self._differences, energy_limit=energy_limit, half_edge=half_edge,
            crew=crew, watch=watch, broken=broken,
            obstruction=obstruction)
        self.load_rate, self._fabric = load_rate, frequency
        self.accuracy = Accuracy(self, tolerance, half_edge)
        self._since_check = 0
        self.look_interval = max(CHECK_INTERVAL // method.stages, 1)
        if self._differences:
            # Whole windows of the steps by which the roughness of the motion is judged.
            windows = -(-self.look_interval // self._differences)
            self.look_interval = windows * self._differences
        self._returned_to = -math.inf
        # Whether it is the speed of bodies that limits the step.
        self._held_back = False
        self._measured: tuple[int, float] | None = None
        if self.fixed:
            checked_step(fixed_step, self.limit, frequency.rate + packed.velocity_rate)
        else:
            self.accuracy.require_possible(frequency.rate)
        self._start(exact=False)

    def _start(self, *, exact: bool = True) -> None:
        """
        Compute the accelerations, the frequency and the step anew: the state has jumped.
        """
        place_driven(self.model, self.loads, self.state, self.time)
        if self.watch is not None:
            self.watch.stretches.forget()
        self._look_for_contacts(self.time)
        self._refresh()
        for meter in self._meters().values():
            meter.done[:] = 0.0
        self.ledger.restart()
        self.ledger[monitor.OBSTRUCTED_LIMIT] = (
            0.0 if self.obstruction.looks_out else math.inf)
        self._save()
        self.ledger[monitor.OBSTRUCTED_EVERY] = self.obstruction.looks
        self.ledger[monitor.UNTIL_OBSTRUCTED] = 0.0
        self._read_rates(exact=exact)
        # So does the first look of the run.
        self.ledger[monitor.UNTIL_OBSTRUCTED] = 0.0
        self._require_room()
        self.ledger.open(self.state, self._moving(self.state))
        force = self.packed.body_force
        if force is not None:
            place = self.packed.layout.unpack(self.state)
            self._potential_start = force.energy(self.time, place.position, place.orientation)
        self.accuracy.restart()
        self._choose_step()

    def jump(self, time: float, state: State, loads: Loads | None, load_rate: float) -> None:
        """
        Go on from another `state` at `time`, as a run that starts there; a failure is forgotten.
        """
        self._failure = self._measured = None
        self.origin, self.index, self.state = time, 0, state
        self.loads, self.load_rate = loads, load_rate
        self._since_check, self._returned_to = 0, -math.inf
        if not self.fixed:
            # Chosen afresh: the step must not depend on what was before.
            self.step = 0.0
        self._start()
        self._require_safe_step(time)

    def forget(self) -> None:
        """
        Count steps and errors from zero again: a run begins that has no past.
        """
        self.step_count, self.accuracy.total = 0, 0.0
        self.obstruction.found = ''
        self.ledger[monitor.TOLD_LIMIT] = math.inf if self.watch is None else self.watch.told
        if self.watch is not None:
            self.watch.forget()

    def rebase(self, time: float) -> None:
        """
        Move a stepper that has not moved yet to another start `time`.
        """
        self.origin, self.index, self._saved_time = time, 0, time
        self.accuracy.rebase(time)
        if self.watch is not None:
            self.watch.rebase(time)

    def set_loads(self, loads: Loads | None, load_rate: float) -> None:
        """
        Replace the loads at the current state.
        """
        self.ledger.keep_work(self.loads)
        # Nobody goes back to before other loads.
        self.ledger[monitor.REGULAR] = 0.0
        self._measured = None
        self.loads = loads
        self.load_rate = load_rate
        place_driven(self.model, loads, self.state, self.time)
        self._choose_step()

    def error_rate(self) -> float:
        """
        Error that the method adds for each second; measured now if it has not been yet.
        """
        if self.accuracy.is_measured or self._failure is not None:
            return self.accuracy.rate
        if self._measured is None or self._measured[0] != self.step_count:
            before = self.memory()
            self._save()
            rate = self.accuracy.measured(self.step, self._fastest())
            # A question leaves no trace.
            self.recall(Memory(before), self.loads)
            self._measured = self.step_count, rate
        return self._measured[1]

    def error_estimate(self) -> float:
        """
        Errors added since the start, as if none of them had grown or faded.
        """
        return self.accuracy.estimate(self.error_rate())

    def memory(self) -> dict[str, Any]:
        """
        All that the steps to come depend on, body by body.
        """
        memory = {
            **super().memory(),
            'since_check': self._since_check,
            'look_interval': self.look_interval,
            'returned_to': self._returned_to,
            'held_back': self._held_back,
            'load_rate': self.load_rate,
            'frequency': self._fabric.rate,
            'accuracy': self.accuracy.memory(),
        }
        if self._is_in_window:
            difference = self.work.difference
            # Also lanes without a body count, so this is only for processors with as many lanes.
            memory['window'] = difference.reshape(len(difference), -1, LANES).copy()
        return memory

    def recall(self, memory: Memory, loads: Loads | None) -> None:
        """
        Go on from there, with the `loads` that acted then.
        """
        super().recall(memory, loads)
        least, most = (1, CHECK_INTERVAL) if self.fixed else (self.look_interval,) * 2
        self.look_interval = memory.count('look_interval', least, most)
        self._since_check = memory.count('since_check', 0, self.look_interval - 1)
        self._returned_to = memory.number('returned_to', finite=False)
        self._held_back = memory.flag('held_back')
        self.load_rate = memory.number('load_rate', 0.0, finite=False)
        self._fabric = Frequency(memory.number('frequency', 0.0, finite=False), (), 0)
        self.accuracy.recall(memory.part('accuracy'))
        self._measured = None
        if self._is_in_window:
            window, own = memory.array('window'), self.work.difference
            if window.shape == (len(own), own.shape[1] // LANES, LANES):
                own[:] = window.reshape(own.shape)
            else:
                # Of a processor with other lanes: the next look does not judge the roughness.
                self.ledger[monitor.REGULAR] = 0.0

    @property
    def _is_in_window(self) -> bool:
        """
        Whether some, but not all, of the steps of a difference are taken.
        """
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
        factor = self.accuracy.excess()
        if factor is None:
            self._save(time)
            return True
        whole = self.ledger[monitor.REGULAR] >= self.look_interval
        if factor > 1.0 and whole and self._saved_time != self._returned_to:
            self._return_to_saved()
            self._returned_to = self._saved_time
            if self.loads is not None:
                np.copyto(self.loads.work, self.loads.earlier_work)
            self.ledger[monitor.REGULAR] = 0.0
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
        if status & (monitor.RATE_HIGH | monitor.RATE_LOW):
            self._read_rates()
            if not self.fixed:
                if not self.step <= self.limit:
                    _LOGGER.warning(
                        'the fabric changed so fast before t = %.6g s that up to %d steps were '
                        'longer than stable (%.3g s, limit %.3g s): their energy may be wrong; '
                        'give a solver.step below that limit',
                        time, self.look_interval, self.step, self.limit,
                    )
                self._choose_step(probe=True)
            self._require_safe_step(time)

    def _look_again(self, time: float, *, missed: bool) -> None:
        """
        Bodies have moved far: find what can touch now, and follow it with the step.
        """
        if self.watch is None:
            return
        if missed:
            self.watch.miss()
        before = self.watch.rate
        self._look_for_contacts(time)
        longest = self.watch.longest_step
        if not self.fixed and (
                self.watch.rate != before or self._held_back or not self.step <= longest):
            self._follow_contacts()
        self._pace(self.step)
        self._require_safe_step(time)

    def _follow_contacts(self) -> None:
        """
        Choose the step anew: contacts have begun, or are over, or bodies have become fast.
        """
        self._choose_step()

    def _meet_obstruction(self, time: float) -> None:
        """
        Say once that a connector runs into its own shell, or stop.
        """
        self.ledger[monitor.OBSTRUCTED_LIMIT] = math.inf
        self.obstruction.note(time, self.state, self.broken.since)
        if self.obstruction.stops:
            self._return_to_saved()
            self._fail(
                f'{self.obstruction.found}, and connector.obstruction is stop; warn lets it pass '
                f'through. The state of t = {self._saved_time:.9g} s is kept')

    def _fail_here(self, what: str, time: float) -> None:
        """
        Stop because numbers have run away: name where, and go back to the last good state.
        """
        fault = find_fault(self.packed, self.state)
        self._return_to_saved()
        self._fail(
            f'the state of {fault} {what} at t = {time:.9g} s, after steps of {self.step:.6g} s; '
            f'the last good state, of t = {self._saved_time:.9g} s, is kept'
        )

    def _fail_unbalanced(self, time: float) -> None:
        fault = find_fault(self.packed, self.state)
        imbalance = self.ledger.describe_imbalance(time)
        self._return_to_saved()
        self._fail(
            f'{imbalance}; the fastest is {fault}, and steps are {self.step:.6g} s (limit '
            f'{self.limit:.6g} s). Start again with a smaller solver.step, or 0 to have it '
            f'chosen; the last good state, of t = {self._saved_time:.9g} s, is kept'
        )

    def _read_rates(self, *, exact: bool = True) -> None:
        """
        Exact largest frequency, and the cheap bound beside it for later comparison.
        """
        if exact:
            self._fabric = self._largest_frequency()
        ledger = self.ledger
        ledger[monitor.HIGH], ledger[monitor.LOW], ledger[monitor.SPIN_WEIGHT] = math.inf, 0.0, 1.0
        monitor.examine(
            self.model, self.loads, self.state, self.work, self.time, ledger.numbers)
        if self.fixed:
            # Below this the bound proves the step safe. Above it the exact value is computed at
            # every look: the bound may be three times as high, its own growth says nothing.
            ledger[monitor.HIGH] = self.method.stability / self.step - self.packed.velocity_rate
            ledger[monitor.SPIN_WEIGHT] = 0.0
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
            if probe:
                self.accuracy.measure_only(self.step, rate)
            elif self.accuracy.is_new:
                self.accuracy.postpone(self.step, rate)
            return
        if not rate < math.inf:
            self._fail(too_fast(self.time))
        chosen = self.method.chosen
        step = self.step * shorter ** (-1.0 / self.method.order)
        if not rate > 0.0:
            step, rate = FREE_STEP, chosen / FREE_STEP
        cap = chosen / rate
        if self.watch is not None:
            self._held_back = self.watch.longest_step < cap
            cap = min(cap, self.watch.longest_step)
        if not SHORTEST * min(cap, self.accuracy.step) <= step <= LONGEST * cap:
            step = rounded_down(min(cap, self.accuracy.step))
        if probe or self.accuracy.is_new or self.load_rate > self.accuracy.load_rate:
            if not probe:
                self._save()
            step = self.accuracy.choose(step, rounded_down(cap), rate)
        if not step > SHORTEST_STEP:
            self._fail(too_fast(self.time))
        if step != self.step:
            self.origin, self.index, self.step = self.time, 0, step
            self.ledger[monitor.REGULAR] = 0.0
        self._pace(step)
        # Above the first the exact value is computed again once the bound has grown; near the
        # limit of the method at every look.
        ledger = self.ledger
        near = min(1.05 * ledger[monitor.RATE], 0.9 * self.method.stability / step)
        ledger[monitor.HIGH] = max(LONGEST * chosen / step, near)
        ledger[monitor.LOW] = SHORTEST * chosen / step if self.accuracy.step >= cap else 0.0

    def _fastest(self) -> float:
        return fastest_motion(
            self.packed, self.state, self.frequency.rate, self.ledger[monitor.SPIN],
            self.load_rate, None if self.watch is None else self.watch.passing)
