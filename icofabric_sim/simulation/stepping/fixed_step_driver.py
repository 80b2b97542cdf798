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
The driver of steps of one length: which are taken, and what is checked between them.

Steps end at origin + k h. Only inputs cut a step short; a state between two steps comes from a
side step on a copy, so outputs never touch the sequence. How long the steps are, `step_choice.py`
says.
"""

from collections.abc import Callable
import math
from typing import Any

from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.contact.rebuild_check import MISSED
from icofabric_sim.kernels.meters import flowed
from icofabric_sim.kernels.records import State
from icofabric_sim.simulation.stepping.faults import too_fast
from icofabric_sim.simulation.stepping.step_monitor import MonitoredTrajectory

# Above it steps cannot be counted in doubles.
_MOST_STEPS = 2.0**53


class FixedStepDriver(MonitoredTrajectory):
    """Takes steps of one length, until the step-size controller chooses another."""

    def __init__(
        self, *arguments: Any, on_pause: Callable[[], None] = lambda: None, **choices: Any
    ) -> None:
        """
        See `MonitoredTrajectory`.

        `on_pause` is called between two compiled calls, at a step end; what it raises ends the
        advance there.
        """
        self._on_pause = on_pause
        super().__init__(*arguments, **choices)

    @property
    def next_step_time(self) -> float:
        """Time [s] at which the step in progress ends."""
        return self.time + self.step

    def warm_up(self) -> None:
        """Make every kernel that a step needs ready, without taking one."""
        self._side_state(self.time + 0.5 * self.step)

    def advance(self, time: float) -> None:
        """Take whole steps up to the last step end not after `time`."""
        if self._failure is not None:
            raise self._failure
        while True:
            remaining = self._steps_until(time)
            if remaining <= 0:
                self._look_within(time)
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
        """Advance to `time` and end the step in progress there; the next step starts there."""
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
        The state at `time`, from a trial step; after a failure the last good one.

        Valid until the next call of any method.
        """
        if self._failure is None:
            self.advance(time)
        return self._side_state(time)

    def _look_within(self, time: float) -> None:
        """
        Refuse a state at `time` [s] within a step in which shells may pass through each other.

        So states within a step are judged as its end will be.
        """
        rest = time - self.time
        if rest > 0.0 and self._is_far(rest):
            self._refuse_passing(self.state, self.trial_steps(rest, 1), self.time, time)

    def _side_state(self, time: float) -> State:
        """The state at a `time` [s] from the last step end to the next."""
        rest = time - self.time
        self._note_work(self.state, self.time, self._stretch(), self.loads)
        self._present_spent = flowed(self.work.spent)
        self._present_given = flowed(self.work.given)
        if self._failure is not None or not rest > 0.0:
            return self.state
        loads = self._scratch_loads()
        state = self.trial_steps(rest, 1, loads)
        self._note_work(state, time, self._stretch(self._model_aside), self.loads, loads)
        self._present_spent += self._spent_aside
        self._present_given += self._given_aside
        self._require_outside()
        return state

    def _steps_until(self, time: float) -> int:
        count = (time - self.origin) / self.step
        if not count < _MOST_STEPS:
            reason = '' if self.fixed else f'; {too_fast(self.time, self._fastest_term())}'
            self._fail(
                f'steps of {self.step:.6g} s never come to t = {time:.9g} s: that would take '
                f'{count:.3g} of them{reason}')
        last = int(count)
        while self.origin + (last + 1) * self.step <= time:
            last += 1
        while last > 0 and self.origin + last * self.step > time:
            last -= 1
        return last - self.index

    def _run(self, count: int) -> int:
        due = self.step_size.looks_left * self.look_interval - self._since_check
        return self._call(self.step, min(count, due, self.portions.count))

    def _prepare_touching(self, step: float, since_check: int, count: int) -> int:
        """
        How many of `count` steps to take, so that what touches within them can be judged.

        Not beyond a health check, whose predecessor is then kept if that is due. Nothing is done
        where nothing is near.
        """
        if self.touching is None or self.watch is None:
            return count
        if step != self.step:
            self.touching.spoil()
        if self.watch.contacts is None and not self.touching.touched:
            return count
        self.watch.has_touched()
        count = min(count, self.look_interval - since_check)
        if since_check + count == self.look_interval and self.touching.is_due:
            if self._saved_time == self.touching.start:
                self.keep_behind()
            else:
                self.touching.spoil()
        return count

    def _call(self, step: float, count: int) -> int:
        start, self.ledger.saved_at = self.index, -1.0
        before, far = self._since_check, self._is_far(step)
        if far:
            # One by one, each from a state to go back to.
            count = 1
            self._save()
        # A step of another length is cut to end at an input.
        origin, index = (self.origin, self.index) if step == self.step else (self.time, 0)
        count = self._prepare_touching(step, before, count)
        status, done, self._since_check = self._advance(
            self.loads, self.state, self.work, origin, index, step, count, before,
            self.look_interval)
        self._require_outside()
        if self.touching is not None and self.watch is not None:
            self.touching.note(self.watch.has_touched())
        saved_at = int(self.ledger.saved_at)
        if step == self.step:
            self.index += done
            time, saved_time = self.time, self._time_of(start + saved_at)
        else:
            self.ledger.regular = 0.0
            time = saved_time = self.time + step
        if saved_at >= 0:
            self._saved_time = saved_time
        self.step_count += done
        self.step_size.looks_left -= (before + done) // self.look_interval
        if far and status & MISSED and not status & monitor.NOT_FINITE:
            self._refuse_passing(self._saved, self.state, self._saved_time, time)
            # Nothing was missed, so the state is as good as any.
            status &= ~MISSED
            if self._since_check == 0 and not status & monitor.UNSOUND:
                self._save(time)
        # An unsound state must not be saved: the run ends below.
        rougher = status & monitor.ROUGHER and not status & monitor.UNSOUND
        if rougher and not self._settle_roughness(time):
            return int(done)
        if self.touching is not None and self._since_check == 0:
            if saved_at >= 0 and not status & monitor.UNSOUND:
                self.touching.end(saved_time, self.step_size.estimated_rate)
            else:
                self.touching.begin(time)
        if status:
            self._respond(status, time)
        if self._since_check == 0 and (
            self.step_size.looks_left <= 0 or status & monitor.LIVELIER
        ):
            self._choose_step(probe=True)
        return int(done)
