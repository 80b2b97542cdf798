# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
The main line of steps: which steps are taken, and what is looked at between them.

Steps end at origin + k h. Only inputs cut a step short; a state between two steps comes from a
side step on a copy, so outputs never touch the sequence. How long the steps are, `step_choice.py`
says.
"""

from collections.abc import Callable
import logging
import math

from icofabric_sim.crew import Crew
from icofabric_sim.faults import find_fault, too_fast, unsafe_step
from icofabric_sim.integrators.methods import Method
from icofabric_sim.integrators.splitting import NEVER
from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.flows import keep_accelerations, place_all
from icofabric_sim.kernels.lanes import LANES
from icofabric_sim.kernels.records import Loads, State, Watch, Work
from icofabric_sim.layout import aligned_empty
from icofabric_sim.ledger import Ledger
from icofabric_sim.model import PackedScene
from icofabric_sim.proximity import ProximityWatch
from icofabric_sim.stability import fastest_motion, Frequency, largest_frequency
from icofabric_sim.step_choice import Accuracy, checked_step, LONGEST, rounded_down, SHORTEST
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')

# Work between two looks at the state, in evaluations of the forces; a look costs about as much as
# one and a half.
CHECK_INTERVAL = 64
# A fixed step near the limit is looked at more often, at most every so many steps.
SHORTEST_INTERVAL = 8
# Work for one compiled call, in bodies and connectors: 10 to 50 ms, so that an interrupt is soon
# heard.
_CALL_WORK = 8_000_000
# Where nothing sets a scale (no connectors, no gravity, no loads, no spin) every step is exact.
FREE_STEP = 2.0**-7
# Order of the differences by which the roughness of the motion is judged: that of the method,
# but no more steps than this between two looks.
LARGEST_DIFFERENCE = 6


class SimulationError(RuntimeError):
    """
    The run cannot go on; time, bodies and reason are in the message, the last good state is kept.
    """


class Stepper:
    """
    State on the main line, and its steps.
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
        watch: ProximityWatch | None,
        on_pause: Callable[[], None] = lambda: None,
    ) -> None:
        """
        Start at time `origin` [s] with the `frequency` of the state; `fixed_step` 0: chosen.

        `on_pause` is called between two compiled calls, at a step end; what it raises ends the
        advance there. Raises ValueError where a fixed step is too long or far too short.
        """
        self._on_pause, self.crew = on_pause, crew
        self.packed, self.model, self.method = packed, packed.model, method
        self.state, self.loads = state, loads
        # Only where the step follows the accuracy.
        differences = 0
        if method.symplectic and not fixed_step > 0.0 and packed.model.links is not None:
            differences = min(method.order, LARGEST_DIFFERENCE)
        self.work = packed.layout.room(
            packed.model.links, None if method.symplectic else state, differences=differences)
        self.half_edge = half_edge
        self.origin, self.index = origin, 0
        self.step = fixed_step
        self.fixed = fixed_step > 0.0
        self.watch = watch
        self.step_count = 0
        self.load_rate = load_rate
        self.frequency = frequency
        self.accuracy = Accuracy(self, tolerance, half_edge)
        self.ledger = Ledger(packed, energy_limit)
        self._saved = packed.layout.like(state)
        self._saved_time = origin
        self._side: tuple[State, np.ndarray] | None = None
        self._since_check = 0
        self.look_interval = max(CHECK_INTERVAL // method.stages, 1)
        if differences:
            # Whole windows of the steps by which the roughness of the motion is judged.
            self.look_interval = -(-self.look_interval // differences) * differences
        self.ledger[monitor.INVERSE_SIZE] = half_edge**-2
        self._returned_to = -math.inf
        self._present_work = 0.0
        self._measured: tuple[int, float] | None = None
        self._failure: SimulationError | None = None
        if self.fixed:
            checked_step(fixed_step, self.limit, frequency.rate)
        else:
            self.accuracy.require_possible(frequency.rate)
        self._start(exact=False)

    @property
    def time(self) -> float:
        """
        Time [s] of the state on the main line.
        """
        return self.origin + self.index * self.step if self.index else self.origin

    @property
    def limit(self) -> float:
        """
        Stability limit of the step [s] in the configuration looked at last.
        """
        rate = self.frequency.rate
        return self.method.stability / rate if rate > 0.0 else math.inf

    def _start(self, *, exact: bool = True) -> None:
        """
        Compute the accelerations, the frequency and the step anew: the state has jumped.
        """
        self._refresh()
        if self.watch is not None:
            self.watch.look(self.time, self.state.position)
        self.ledger.restart()
        self._save()
        self._read_rates(exact=exact)
        self.ledger.open(self.state)
        self.accuracy.restart()
        self._choose_step()

    def jump(self, time: float, state: State, loads: Loads | None, load_rate: float) -> None:
        """
        Go on from another `state` at `time`, as a run that starts there; a failure is forgotten.
        """
        self._failure = None
        self.origin, self.index, self.state = time, 0, state
        self.loads, self.load_rate = loads, load_rate
        self._since_check = 0
        if not self.fixed:
            # Chosen afresh: the step must not depend on what was before.
            self.step = 0.0
        self._start()
        self._require_safe_step(time)

    def rebase(self, time: float) -> None:
        """
        Move a stepper that has not moved yet to another start `time`.
        """
        self.origin, self.index, self._saved_time = time, 0, time

    def set_loads(self, loads: Loads | None, load_rate: float) -> None:
        """
        Replace the loads at the current state.
        """
        self.ledger.keep_work(self.loads)
        # Nobody goes back to before other loads.
        self.ledger[monitor.REGULAR] = 0.0
        self.loads = loads
        self.load_rate = load_rate
        self._choose_step()

    def advance(self, time: float) -> None:
        """
        Take whole steps up to the last step end not after `time`.
        """
        if self._failure is not None:
            raise self._failure
        while True:
            remaining = self._steps_until(time)
            if remaining <= 0:
                return
            if self.watch is not None:
                # What overlaps from the start is told when the motion begins.
                self.watch.announce()
            self._run(remaining)
            self._on_pause()

    def advance_steps(self, count: int, *, until: float = math.inf) -> int:
        """
        Take whole steps, at least none and at most `count`, that end by `until`; returns how many.

        May return early; 0 says that the next step would end later.
        """
        if self._failure is not None:
            raise self._failure
        if until < math.inf:
            count = min(count, self._steps_until(until))
        return self._run(count) if count > 0 else 0

    def cut(self, time: float) -> None:
        """
        Advance to `time` and end the step in progress there; the next step starts there.
        """
        self.advance(time)
        rest = time - self.time
        if rest > 0.0:
            try:
                self._call(rest, 1)
            finally:
                if self._failure is None:
                    self.origin, self.index = time, 0
        else:
            self.origin, self.index = time, 0

    def state_at(self, time: float) -> State:
        """
        The state at `time`, from a side step off the main line; after a failure the last good one.

        Valid until the next call of any method.
        """
        if self._failure is None:
            self.advance(time)
        rest = time - self.time
        self._note_work(self.loads)
        if self._failure is not None or not rest > 0.0:
            return self.state
        loads = self._scratch_loads()
        state = self.run_aside(rest, 1, loads)
        self._note_work(self.loads, loads)
        return state

    def work_at_state(self) -> float:
        """
        Work [J] of all loads up to the state that `state_at` has shown last.
        """
        return self.ledger[monitor.EARLIER_WORK] + self._present_work

    def _note_work(self, *parts: Loads | None) -> None:
        self._present_work = sum(math.fsum(part.work) for part in parts if part is not None)

    def _scratch_loads(self) -> Loads | None:
        """
        The same loads, with room of their own for what they do.
        """
        if self.loads is None:
            return None
        return self.loads._replace(work=np.zeros_like(self.loads.work))

    def run_aside(self, step: float, count: int, loads: Loads | None = None) -> State:
        """
        Where `count` steps of length `step` lead; the main line stays where it is.
        """
        if self._side is None:
            self._side = (
                self.packed.layout.like(self.state), aligned_empty(self.work.acceleration.shape))
        state, acceleration = self._side
        for target, source in zip(state, self.state):
            np.copyto(target, source)
        np.copyto(acceleration, self.work.acceleration)
        loads = loads or self._scratch_loads()
        work = self.work._replace(acceleration=acceleration)
        self._advance(loads, state, work, step, count, 0, NEVER, math.inf)
        return state

    def run_and_return(self, step: float, count: int, look: Callable[[State], None]) -> None:
        """
        Take steps, show the state that they lead to, and come back; the state must be saved.
        """
        loads = self._scratch_loads()
        self._advance(loads, self.state, self.work, step, count, 0, NEVER, math.inf)
        look(self.state)
        self._restore()

    def error_rate(self) -> float:
        """
        Error that the method adds for each second; measured now if it has not been yet.
        """
        if self.accuracy.is_measured or self._failure is not None:
            return self.accuracy.rate
        if self._measured is None or self._measured[0] != self.step_count:
            self._save()
            rate = self.accuracy.measured(self.step, self._fastest())
            self._measured = self.step_count, rate
        return self._measured[1]

    def error_estimate(self) -> float:
        """
        Errors added since the start, as if none of them had grown or faded.
        """
        return self.accuracy.estimate(self.error_rate())

    @property
    def next_step_time(self) -> float:
        """
        Time [s] at which the step in progress ends.
        """
        return self.time + self.step

    def _steps_until(self, time: float) -> int:
        last = int((time - self.origin) / self.step)
        while self.origin + (last + 1) * self.step <= time:
            last += 1
        while last > 0 and self.origin + last * self.step > time:
            last -= 1
        return last - self.index

    def _run(self, count: int) -> int:
        due = self.accuracy.looks_left * self.look_interval - self._since_check
        return self._call(self.step, min(count, due, self._call_count()))

    def _call_count(self) -> int:
        """
        Steps of one compiled call, so that it takes 10 to 50 ms.
        """
        size = len(self.model.blocks.slot) * LANES * (1 if self.model.links is None else 7)
        return max(1, _CALL_WORK // (size * self.method.stages))

    def _call(self, step: float, count: int) -> int:
        reach = math.inf if self.watch is None else self.watch.reach
        start, self.ledger[monitor.SAVED_AT] = self.time, -1.0
        before = self._since_check
        status, done, self._since_check = self._advance(
            self.loads, self.state, self.work, step, count, before, self.look_interval, reach)
        if step == self.step:
            self.index += done
        else:
            self.ledger[monitor.REGULAR] = 0.0
        self.step_count += done
        saved_at = int(self.ledger[monitor.SAVED_AT])
        if saved_at >= 0:
            self._saved_time = start + saved_at * step
        self.accuracy.looks_left -= (before + done) // self.look_interval
        time = self.time if step == self.step else self.time + step
        # An unsound state must not be saved: the run ends below.
        rougher = status & monitor.ROUGHER and not status & monitor.UNSOUND
        if rougher and not self._settle_roughness(time):
            return int(done)
        if status:
            self._respond(status, time)
        if self._since_check == 0 and (
            self.accuracy.looks_left <= 0 or status & monitor.LIVELIER
        ):
            self._choose_step(probe=True)
        return int(done)

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

    def _advance(
        self, loads: Loads | None, state: State, work: Work, step: float, count: int,
        since_check: int, interval: int, reach: float,
    ) -> tuple[int, int, int]:
        watch = None if self.watch is None else Watch(self.watch.reference, reach)
        return self.crew.run(
            lambda team: self.method.advance(
                self.model, loads, state, self._saved, work, team, step, count, since_check,
                interval, watch, self.ledger.numbers))

    def _respond(self, status: int, time: float) -> None:
        if status & monitor.NOT_FINITE:
            self._fail_here('is no longer finite', time)
        if status & monitor.UNBALANCED:
            self._fail_unbalanced(time)
        if status & monitor.MOVED_FAR and self.watch is not None:
            self.watch.look(time, self.state.position)
            self.watch.announce()
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

    def _require_safe_step(self, time: float) -> None:
        if not self.fixed or self.step <= self.limit:
            return
        frequency = largest_frequency(self.packed, self.state, locate=True)
        self._fail(unsafe_step(self.step, self.limit, frequency, time))

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

    def _fail(self, message: str) -> None:
        self._failure = SimulationError(message)
        raise self._failure

    def _return_to_saved(self) -> None:
        self._restore()
        self.origin, self.index = self._saved_time, 0

    def _refresh(self) -> None:
        """
        Accelerations of the state as it is.
        """
        last = len(self.model.blocks.slot)
        place_all(self.model, self.state, self.work, 0, last)
        keep_accelerations(self.model, self.work, 0, last)

    def _save(self, time: float | None = None) -> None:
        for target, source in zip(self._saved, self.state):
            np.copyto(target, source)
        if self.loads is not None:
            np.copyto(self.loads.earlier_work, self.loads.work)
        self._saved_time = self.time if time is None else time

    def _restore(self) -> None:
        for target, source in zip(self.state, self._saved):
            np.copyto(target, source)
        self._refresh()

    def _read_rates(self, *, exact: bool = True) -> None:
        """
        Exact largest frequency, and the cheap bound beside it for later comparison.
        """
        if exact:
            self.frequency = largest_frequency(self.packed, self.state)
        ledger = self.ledger
        ledger[monitor.HIGH], ledger[monitor.LOW], ledger[monitor.SPIN_WEIGHT] = math.inf, 0.0, 1.0
        monitor.examine(self.model, self.loads, self.state, self.work, ledger.numbers)
        if self.fixed:
            # Below this the bound proves the step safe. Above it the exact value is computed at
            # every look: the bound may be three times as high, its own growth says nothing.
            ledger[monitor.HIGH] = self.method.stability / self.step
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
        if not SHORTEST * min(cap, self.accuracy.step) <= step <= LONGEST * cap:
            step = rounded_down(min(cap, self.accuracy.step))
        if probe or self.accuracy.is_new or self.load_rate > self.accuracy.load_rate:
            if not probe:
                self._save()
            step = self.accuracy.choose(step, rounded_down(cap), rate)
        if step != self.step:
            self.origin, self.index, self.step = self.time, 0, step
            self.ledger[monitor.REGULAR] = 0.0
        # Above the first the exact value is computed again once the bound has grown; near the
        # limit of the method at every look.
        ledger = self.ledger
        near = min(1.05 * ledger[monitor.RATE], 0.9 * self.method.stability / step)
        ledger[monitor.HIGH] = max(LONGEST * chosen / step, near)
        ledger[monitor.LOW] = SHORTEST * chosen / step if self.accuracy.step >= cap else 0.0

    def _fastest(self) -> float:
        return fastest_motion(
            self.packed, self.state, self.frequency.rate, self.ledger[monitor.SPIN],
            self.load_rate, None if self.watch is None else self.watch.limit)
