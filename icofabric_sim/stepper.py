# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
The main line of steps: which steps are taken, and what is looked at between them.

Steps end at origin + k h. Only inputs cut a step short; a state between two steps comes from a
side step on a copy, so outputs never touch the sequence. The step is chosen from the largest
frequency of the fabric in its present configuration, which is watched as the fabric stretches and
turns.
"""

from collections.abc import Callable
import logging
import math

from icofabric_sim.integrators.methods import Method
from icofabric_sim.kernels.monitor import examine, MOVED_FAR, NOT_FINITE, RATE_HIGH, RATE_LOW
from icofabric_sim.kernels.records import Loads, Model, State, Work
from icofabric_sim.kernels.wrenches import compute_wrenches
from icofabric_sim.proximity import ProximityWatch
from icofabric_sim.stability import Frequency, largest_frequency
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')

# Work between two looks at the state, in evaluations of the wrenches; a look costs about four, so
# 6 % in all.
CHECK_INTERVAL = 64
# A fixed step near the limit is looked at more often, at most every so many steps.
SHORTEST_INTERVAL = 8
# Step times frequency, in parts of what the method chooses: too long (shorten it), too short
# (lengthen it). The leapfrog chooses 0.2, where the phase of the fastest motion is wrong by
# 0.2^2 / 24 = 0.17 %; slower motions are better by the square of the ratio.
LONGEST, SHORTEST = 1.25, 0.4
# Work for one compiled call, in bodies and connectors: 25 to 50 ms, so that an interrupt is soon
# heard.
_CALL_WORK = 1_500_000
# Where nothing sets a scale (no connectors, no gravity, no loads, no spin) every step is exact.
_FREE_STEP = 2.0**-7


class SimulationError(RuntimeError):
    """
    The run cannot go on; time, bodies and reason are in the message, the last state is kept.
    """


# A fixed step below this part of the limit (or of a second) would never come to an end.
_SHORTEST_FIXED = 1e-9


class Stepper:
    """
    State on the main line, and its steps.
    """

    def __init__(
        self,
        model: Model,
        method: Method,
        state: State,
        loads: Loads | None,
        *,
        origin: float,
        fixed_step: float,
        load_rate: float,
        watch: ProximityWatch | None,
        on_pause: Callable[[], None] = lambda: None,
    ) -> None:
        """
        Start at time `origin` [s]; `fixed_step` 0 chooses the step.

        `on_pause` is called between two compiled calls, at a step end; what it raises ends the
        advance there. Raises ValueError where a fixed step is too long or far too short.
        """
        self._on_pause = on_pause
        count = len(state.position)
        self.model, self.method, self.state, self.loads = model, method, state, loads
        self.work = Work(np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3, 3)))
        self.origin, self.index = origin, 0
        self.step = fixed_step
        self.fixed = fixed_step > 0.0
        self.watch = watch
        self.step_count = 0
        self.load_rate = load_rate
        self.frequency = Frequency(0.0, (), 0)
        self._since_check = 0
        self._interval = max(CHECK_INTERVAL // method.stages, 1)
        self._readings = np.zeros(4)
        self._high = self._low = 0.0
        self._failure: SimulationError | None = None
        self._start()
        if self.fixed and not fixed_step >= _SHORTEST_FIXED * min(self.limit, 1.0):
            raise ValueError(
                f'solver.step {fixed_step!r} s is too short to come to an end with: the stability '
                f'limit is {self.limit:.6g} s; choose a longer one, or 0 to have it chosen'
            )
        if self.fixed and not fixed_step <= self.limit:
            raise ValueError(
                f'solver.step {fixed_step!r} s is beyond the stability limit '
                f'{self.limit:.6g} s of the method in this scene (largest frequency '
                f'{self.frequency.rate:.6g} rad/s); choose a smaller one, or 0 to have it chosen'
            )

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

    def _start(self) -> None:
        """
        Compute the wrenches, the frequency and the step anew: the state has jumped.
        """
        self._refresh()
        if self.watch is not None:
            self.watch.look(self.time, self.state.position)
        self._read_rates()
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
        self.origin, self.index = time, 0

    def set_loads(self, loads: Loads | None, load_rate: float) -> None:
        """
        Replace the loads at the current state.
        """
        self.loads = loads
        self.load_rate = load_rate
        self._refresh()
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
        try:
            if rest > 0.0:
                self._call(rest, 1)
        except SimulationError:
            self.origin, self.index = time, 0
            raise
        self.origin, self.index = time, 0

    def state_at(self, time: float) -> State:
        """
        Copy of the state at `time`, from a side step off the main line; after a failure the last.
        """
        if self._failure is None:
            self.advance(time)
        state = State(*(array.copy() for array in self.state))
        rest = time - self.time
        if rest > 0.0:
            work = Work(
                self.work.force.copy(), self.work.torque.copy(), np.empty_like(self.work.arms)
            )
            self.method.advance(
                self.model,
                self.loads,
                state,
                work,
                rest,
                1,
                0,
                2,
                *self._watching(),
                0.0,
                0.0,
                0.0,
                math.inf,
            )
        return state

    def _steps_until(self, time: float) -> int:
        last = int((time - self.origin) / self.step)
        while self.origin + (last + 1) * self.step <= time:
            last += 1
        while last > 0 and self.origin + last * self.step > time:
            last -= 1
        return last - self.index

    def _watching(self) -> tuple[np.ndarray | None, np.ndarray]:
        return (None if self.watch is None else self.watch.reference), self._readings

    def _run(self, count: int) -> int:
        connectors = self.model.connectors
        size = len(self.state.position) + (0 if connectors is None else len(connectors.first))
        done = self._call(self.step, min(count, max(1, _CALL_WORK // size)))
        return done

    def _call(self, step: float, count: int) -> int:
        reach = math.inf if self.watch is None else self.watch.reach
        status, done, self._since_check = self.method.advance(
            self.model,
            self.loads,
            self.state,
            self.work,
            step,
            count,
            self._since_check,
            self._interval,
            *self._watching(),
            self._high,
            self._low,
            0.0 if self.fixed else 1.0,
            reach,
        )
        if step == self.step:
            self.index += done
        self.step_count += done
        if status:
            time = self.time if step == self.step else self.time + step
            self._respond(status, time)
        return int(done)

    def _respond(self, status: int, time: float) -> None:
        if status & NOT_FINITE:
            self._fail(
                f'the state of body {int(self._readings[3])} is no longer finite at '
                f't = {time:.9g} s, after steps of {self.step:.6g} s'
            )
        if status & MOVED_FAR and self.watch is not None:
            self.watch.look(time, self.state.position)
            self.watch.announce()
        if status & (RATE_HIGH | RATE_LOW):
            self._read_rates()
            if not self.fixed:
                if not self.step <= self.limit:
                    _LOGGER.warning(
                        'the fabric changed so fast before t = %.6g s that up to %d steps were '
                        'longer than stable (%.3g s, limit %.3g s): their energy may be wrong; '
                        'give a solver.step below that limit',
                        time, self._interval, self.step, self.limit,
                    )
                self._choose_step()
            self._require_safe_step(time)

    def _require_safe_step(self, time: float) -> None:
        if not self.fixed or self.step <= self.limit:
            return
        frequency = largest_frequency(
            self.model, self.state.position, self.state.orientation, locate=True
        )
        bodies = ', '.join(str(body) for body in frequency.bodies)
        self._fail(
            f'solver.step {self.step!r} s has become unsafe at t = {time:.9g} s: the fabric has '
            f'stretched or turned so that bodies {bodies} move at up to {frequency.rate:.6g} '
            f'rad/s, and the stability limit is now {self.limit:.6g} s; start again with a '
            'smaller step, or with 0 to have it chosen'
        )

    def _fail(self, message: str) -> None:
        self._failure = SimulationError(message)
        raise self._failure

    def _refresh(self) -> None:
        compute_wrenches(self.model, self.loads, self.state, self.work)

    def _read_rates(self) -> None:
        """
        Exact largest frequency, and the cheap bound beside it for later comparison.
        """
        self.frequency = largest_frequency(self.model, self.state.position, self.state.orientation)
        examine(self.model, self.state, self.work, *self._watching(), math.inf, 0.0, 1.0, math.inf)
        if self.fixed:
            # Below this the bound proves the step safe. Above it the exact value is computed at
            # every look: the bound may be three times as high, its own growth says nothing.
            self._high = self.method.stability / self.step
            self._low = 0.0
            # As often in time as with a chosen step, as far as that is affordable.
            ratio = self.step * self.frequency.rate / self.method.chosen
            steps = CHECK_INTERVAL / self.method.stages / max(ratio, 1.0)
            self._interval = max(int(steps), SHORTEST_INTERVAL)

    def _choose_step(self) -> None:
        """
        Choose the step for the largest frequency, seen from a body that spins.

        The step is kept while it is about right.
        """
        if self.fixed:
            return
        rate = self.frequency.rate + float(self._readings[2])
        velocity = self.state.linear_velocity
        spread = float(np.linalg.norm(np.ptp(velocity, axis=0)))
        if self.model.connectors is None:
            rate += self.load_rate
            if self.watch is not None:
                # Free bodies take any step; the watch must see them before they have passed.
                rate += spread / self.watch.limit
        else:
            # Loads, weight and speed turn and stretch the fabric before it can answer.
            size = 2.0 * self.model.connectors.half_width
            rate = max(rate, self.load_rate + self._weight_rate(size), spread / size)
        if not rate < math.inf:
            self._fail(f'the motion at t = {self.time:.9g} s is too fast for any step: its rate '
                       'is no longer finite; look for a huge stiffness, load, spin or stretch')
        step, chosen = self.step, self.method.chosen
        if not rate > 0.0:
            step, rate = _FREE_STEP, chosen / _FREE_STEP
        elif not SHORTEST <= step * rate / chosen <= LONGEST:
            step = _rounded_down(chosen / rate)
        if step != self.step:
            self.origin, self.index, self.step = self.time, 0, step
        # Above the first the exact value is computed again once the bound has grown; near the
        # limit of the method at every look.
        near = min(1.05 * float(self._readings[0]), 0.9 * self.method.stability / step)
        self._high = max(LONGEST * chosen / step, near)
        self._low = SHORTEST * chosen / step

    def _weight_rate(self, size: float) -> float:
        """
        Rate [rad/s] at which gravity moves a body by its `size` [m] past one that is held.
        """
        if self.model.gravity is None or self.model.supports is None:
            return 0.0
        return math.sqrt(float(np.linalg.norm(self.model.gravity)) / size)


def _rounded_down(step: float) -> float:
    """
    Nearest number below with a mantissa of 12 bits.

    So the last bits of the frequency hardly ever decide about the step.
    """
    mantissa, exponent = math.frexp(step)
    return math.ldexp(math.floor(mantissa * 4096.0) / 4096.0, exponent)
