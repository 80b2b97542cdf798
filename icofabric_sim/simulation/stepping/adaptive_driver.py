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
The driver of an adaptive method: every step is as long as its own error allows.

The stepper is one step ahead of the time that was asked for: a state in between comes from the
dense output of that step, so outputs do not touch the sequence. An input gives up the step in
progress, and takes one to its own time instead.
"""

from collections.abc import Callable
import math
from time import perf_counter
from typing import Any

from icofabric_sim.kernels.drives import place_driven
from icofabric_sim.kernels.integrators import dop853, embedded
from icofabric_sim.kernels.integrators.embedded import (
    adaptive_pair,
    dense_state,
    dense_sum,
    DOP8,
    prepare_dense,
)
from icofabric_sim.kernels.integrators.splitting import NEVER
from icofabric_sim.kernels.records import Loads, Meter, Model, State, Team, Trail
from icofabric_sim.simulation.contact.broad_phase import BroadPhase
from icofabric_sim.simulation.state_tree import StateTree
from icofabric_sim.simulation.stepping.embedded_control import EmbeddedControl
from icofabric_sim.simulation.stepping.faults import too_fast
from icofabric_sim.simulation.stepping.fixed_step_driver import FixedStepDriver
import numpy as np

# Where a tolerance leaves more than this for each radian of the fastest motion, steps are so long
# that the estimate of their error may be too small by three times; it is then kept smaller.
_LOOSE, _LOOSE_AIM = 1e-6, 0.3
# The first step after a jump, in radians of the fastest motion; the error then decides.
_FIRST_STEP = 0.5
# The shortest, in parts of that.
_SHORTEST_PART = 1e-9
# The longest where shells may touch, likewise. A contact that begins and ends between two of the
# times at which a step asks for forces, up to 0.27 of it apart, is not seen; so it is not deeper
# than about a hundredth of the way that bodies swing.
_LONGEST_STEP = 1.0
# Squared radians of a contact in which a kink may lie, beside the tolerance for a radian; at most.
_KINK, _LARGEST_KINK = 1e3, 1e-4
# Steps for which contacts are known ahead; part of a way that a look reaches after a step led too
# far.
_AHEAD, _FARTHER = 6.0, 1.5
# Rounding of forces of contacts as it shows in the estimate of the error, or somewhat more.
_NOISE = float(np.finfo(float).eps)
# No limit of a length [s], and no wish for an accuracy: as large as a checkpoint may hold.
ANY = 1e300
# Slopes of a step that states within it need, but for those that dense output adds to them.
_SLOPES = [
    k for k in range(len(dop853.STAGES) + 1)
    if any(len(row) > k and row[k] for row in (*dop853.DENSE_STAGES, *dop853.DENSE))]


class AdaptiveDriver(FixedStepDriver):
    """Takes steps each with its own length."""

    def __init__(self, *arguments: Any, origin: float, **choices: Any) -> None:
        """See `FixedStepDriver`."""
        self.control = EmbeddedControl()
        self.control.start = origin
        super().__init__(*arguments, origin=origin, **choices)

    def _start(self, *, exact: bool = True) -> None:
        # The sum of errors goes on.
        total = self.error_estimate(self.origin)
        self.control = EmbeddedControl()
        self.control.start, self.control.total = self.origin, total
        self._has_dense = False
        super()._start(exact=exact)

    @property
    def time(self) -> float:
        """Time [s] at which the step in progress begins."""
        return self.control.start

    @property
    def _trail(self) -> Trail:
        trail = self.work.trail
        assert trail is not None
        return trail

    @property
    def end(self) -> float:
        """Time [s] at which it ends; the same where none is in progress."""
        return self.control.start + self.control.length

    def forget(self) -> None:
        """Count steps and errors from zero again: a run begins that has no past."""
        super().forget()
        # Nor is anything left of the step in progress.
        self.control.total = self.control.rate = 0.0

    def rebase(self, time: float) -> None:
        """Move a stepper that has not moved yet to another start `time`."""
        super().rebase(time)
        self.control.start = time

    def set_loads(self, loads: Loads | None, load_rate: float) -> None:
        """Replace the loads at the current state."""
        self.ledger.keep_work(self.loads)
        self.loads, self.load_rate = loads, load_rate
        place_driven(self.model, loads, self.state, self.time)
        self.control.has_last = 0.0
        self.control.next = min(self.control.next, self._first_step())

    def warm_up(self) -> None:
        """Make every kernel that a step needs ready, without taking one."""
        before, loads = self.state_tree(), self.loads
        try:
            self.state_at(self.time + 0.5 * self.step)
        finally:
            self.load_state(StateTree(before), loads)

    def advance(self, time: float) -> None:
        """
        Take steps until one ends after `time`; none from a state that is set for just that time.

        So a look at a state does not begin a step that an input at the same time would change.
        """
        if self._failure is not None:
            raise self._failure
        while self.end < time or (self.end == time and self.control.length > 0.0):
            if self.watch is not None:
                self.watch.announce()
            # Not beyond a look, which saves the state: its time is that of the call's end.
            due = self.look_interval - self._since_check
            self._take(time, min(due, self.portions.count))
            self._on_pause()

    def advance_steps(self, count: int, *, until: float = math.inf) -> int:
        """Go to the end of the step in progress, if that is by `until`; returns how many steps."""
        if self._failure is not None:
            raise self._failure
        if self.control.length == 0.0:
            self._take(self.end, 1)
        if self.end > until:
            return 0
        self._take(self.end, 1)
        return 1

    def cut(self, time: float) -> None:
        """Advance to `time` and end a step there; the next step starts there."""
        self.advance(time)
        rest = time - self.time
        # The part of the step in progress up to there stays counted.
        estimate = self.error_estimate(time)
        self._give_up_step()
        self.control.total = estimate
        if rest > 0.0:
            self._call(rest, 1)
        self.control.start = time

    def state_at(self, time: float) -> State:
        """The state at `time` from dense output; after a failure the last good one."""
        if self._failure is None:
            self.advance(time)
        rest, length = time - self.time, self.control.length
        if self._failure is None and rest > 0.0 and length > 0.0:
            self._prepare_dense()
        work = self._work_within(rest, length)
        self._present_spent = self._flow(self.work.spent, rest, length)
        self._present_given = self._flow(self.work.given, rest, length)
        state = self._state_within(rest, length)
        self._present_work = work + self._moving(state)
        self._note_anchors(
            state, self.time + min(max(rest, 0.0), length), self._stretch_within(rest, length))
        return state

    def _state_within(self, rest: float, length: float) -> State:
        """The state up to there; slopes for dense output are in place."""
        trail = self._trail
        if self._failure is not None or not length > 0.0:
            return self.state
        if not rest > 0.0:
            return trail.start
        return self._dense(rest / length)

    def _stretch_within(self, rest: float, length: float) -> np.ndarray | None:
        """Stretches of friction up to there."""
        losses = self._losses
        if losses is None or self._failure is not None or not length > 0.0:
            return self._stretch()
        if not rest > 0.0:
            return losses.start
        found = dense_sum(
            DOP8, losses.slopes.reshape(len(losses.slopes), -1), losses.start.ravel(),
            losses.stretch.ravel(), length, rest / length)
        return np.asarray(found).reshape(losses.stretch.shape)

    def _prepare_dense(self) -> None:
        """Have the slopes that states within the step in progress need."""
        trail, length = self._trail, self.control.length
        if not self._has_dense:
            loads, watch = self._scratch_loads(), self._watching(aside=True)
            self.thread_team.run(lambda team: prepare_dense(
                DOP8, self.model, loads, self.work, team, trail, watch, self.time, length))
            self._has_dense = True
            self._require_outside()

    def _dense(self, part: float) -> State:
        """State at a part of the step in progress."""
        self._prepare_dense()
        trail, length = self._trail, self.control.length
        if self._side is None:
            # Slots without a body are never written.
            self._side = (self.packed.layout.like(self.state), np.zeros((6, 0)))
            for row, source in zip(self._side[0], self.state):
                np.copyto(row, source)
        target = self._side[0]
        self.thread_team.run(lambda team: dense_state(
            DOP8, self.model, self.loads, self.state, team, trail, self.time, length, part,
            target))
        return target

    def _work_within(self, rest: float, length: float) -> float:
        """Work [J] of the present loads up to `rest` [s] into the step in progress."""
        if self.loads is None:
            return 0.0
        return self._flow_within(
            self.loads.power, self.loads.earlier_work, self.loads.work, rest, length)

    def _flow(self, meter: Meter | None, rest: float, length: float) -> float:
        """Energy [J] that a meter shows up to there."""
        if meter is None:
            return 0.0
        return self._flow_within(meter.power, meter.done[1], meter.done[0], rest, length)

    def _flow_within(
        self, power: np.ndarray, before: np.ndarray, after: np.ndarray, rest: float, length: float
    ) -> float:
        """
        Energy [J] that flowed with `power` (16, m), by the dense output that states come from.
        """
        if self._failure is not None or not length > 0.0:
            return _total(after)
        if not rest > 0.0:
            return _total(before)
        rates = np.array([_total(row) for row in power])
        return dense_sum(DOP8, rates, _total(before), _total(after), length, rest / length)

    def error_rate(self) -> float:
        """Error of the last step for each second."""
        return self.control.rate

    def error_estimate(self, time: float) -> float:
        """Errors of all steps up to a present `time` [s], as if none had grown or faded."""
        left = min(max(self.end - time, 0.0), self.control.length)
        return self.control.total - self.control.rate * left

    @property
    def next_step_time(self) -> float:
        """Time [s] at which the step in progress ends."""
        return self.end if self.control.length > 0.0 else self.time + self.step

    def state_tree(self) -> dict[str, Any]:
        """All that the steps to come depend on, body by body."""
        tree, gather = super().state_tree(), self.packed.layout.gather
        tree['control'] = self.control.numbers.copy()
        # Where the last call was to lead says nothing of the next.
        tree['control'][embedded.GOAL] = 0.0
        if self.control.length > 0.0:
            trail = self._trail
            tree['start'] = self._by_body(trail.start)
            tree['slopes'] = gather(trail.slopes[_SLOPES])
            if 'loads' in tree and self.loads is not None:
                rows = self._rows_by_body(self.loads)
                tree['loads']['power'] = self.loads.power[:, rows][_SLOPES]
            for name, meter in self._meters().items():
                tree[f'{name}_power'] = gather(meter.power[_SLOPES])
        return tree

    def load_state(self, tree: StateTree, loads: Loads | None) -> None:
        """Go on from there, with the `loads` that acted then."""
        numbers = tree.array('control', (embedded.CONTROL_COUNT,)).copy()
        if not (np.isfinite(numbers).all() and numbers.min() >= 0.0):
            raise ValueError('control holds a negative number or one that is not finite')
        self.control, self._has_dense = EmbeddedControl(numbers), False
        super().load_state(tree, loads)
        control = self.control
        if self._failure is None and not control.next > 0.0 < control.shortest:
            raise ValueError('control has no length for the next step')
        if control.length > 0.0:
            trail, layout = self._trail, self.packed.layout
            self._take_back(trail.start, tree.part('start'))
            shape = (layout.body_count, len(_SLOPES), trail.slopes.shape[1])
            slopes = tree.array('slopes', shape)
            trail.slopes[:] = 0.0
            for k, number in enumerate(_SLOPES):
                trail.slopes[number][:, layout.slot] = slopes[:, k].T
            if loads is not None and len(loads.wrench):
                rows = self._rows_by_body(loads)
                power = tree.part('loads').array('power', (len(_SLOPES), len(rows)))
                for number, values in zip(_SLOPES, power):
                    loads.power[number, rows] = values
            for name, meter in self._meters().items():
                power = tree.array(f'{name}_power', (layout.body_count, len(_SLOPES)))
                for number, values in zip(_SLOPES, power.T):
                    meter.power[number, layout.slot] = values

    def _kernel(self) -> tuple[Any, Callable[[Model, Team], tuple[Any, ...]]]:
        return adaptive_pair, lambda model, team: (
            DOP8, model, self.loads, self.state, self._saved, self.work, team,
            self.control.numbers, 1, 0, self.look_interval, self._watching(), self.ledger.numbers)

    def _choose_step(self, *, probe: bool = False, shorter: float = 1.0) -> None:
        """Only where the motion begins: later the error decides."""
        first = self._first_step()
        control, rate = self.control, self._fastest()
        if control.next == 0.0:
            control.next = first
        tolerance = self.step_size.tolerance
        control.tolerance = tolerance * (
            _LOOSE_AIM if tolerance > _LOOSE * rate else 1.0)
        control.shortest = first * _SHORTEST_PART
        # Whether anything is near must not matter: steps do not depend on looks.
        control.longest = ANY if self.watch is None or not rate > 0.0 else (
            _LONGEST_STEP / rate)
        control.kinked = self._kinked_rate(rate)
        # Around shells the shortest way may change to the other side.
        rate = rate or 1.0 / self._output_period
        control.spare = 0.0 if self.model.wrapping is None else 2.0 * math.pi / rate
        size, fastest = self.half_edge**-2, rate**-2
        control.scales[:] = size, 4.0 if self.state.orientation.ndim == 2 else 0.5, (
            size * fastest), fastest
        self._follow_contacts()
        self._pace(self.step or first)
        self.ledger.high, self.ledger.low = math.inf, 0.0
        self.step_size.looks_left = NEVER
        self.step = self.step or first

    def _kinked_rate(self, rate: float) -> float:
        """Square [1/s^2] of the fastest motion where forces may have kinks; 0: they have none."""
        links = self.model.links
        varied = links is not None and (links.tables is not None or (
            links.variety is not None
            and not np.array_equal(links.variety.extension, links.variety.compression)))
        if self.watch is None and self.model.wrapping is None and not varied:
            return 0.0
        # With whatever may touch: estimates must not depend on looks either.
        return rate * rate + (0.0 if self.watch is None else self.watch.least_rate)

    def _outlook(self, watch: BroadPhase) -> tuple[float, float]:
        # What is near need not touch: the steps are as long as the motion allows until then.
        step, steps = super()._outlook(watch)
        return (step, steps) if self.fixed else (
            max(step, self.control.next), _AHEAD)

    def _follow_contacts(self) -> None:
        """
        Errors and ways decide; but at first touch forces have a kink.

        In a step of length h with a kink a velocity v errs by about (w h)^2 v, w the frequency of
        the contact: at the length below by less than the part of a that the tolerance allows in
        a few hundred radians of it. And the last bits of positions make noise in large forces.
        """
        control = self.control
        control.kink = control.floor = control.resume = 0.0
        if self.watch is None:
            return
        # Whatever was seen so far: steps must not depend on looks.
        rate = math.sqrt(self.watch.least_rate)
        part = min(_KINK * control.tolerance / rate, _LARGEST_KINK)
        control.kink = math.sqrt(part) / rate
        # A step that short is always taken: it must not count as too short before.
        control.shortest = min(control.shortest, control.kink)
        # A step of a contact, as far as that can be known before.
        control.resume = _FIRST_STEP / rate
        if self.watch.rate > 0.0:
            noise = self.watch.setup.stiffness * self.model.inverse_mass * self._extent()
            # As errors of velocities count.
            control.floor = _NOISE * noise * math.sqrt(control.scales[2])

    def _extent(self) -> float:
        """Largest coordinate [m] of a body."""
        return float(np.abs(self.state.position[:, self.packed.layout.slot]).max(initial=0.0))

    def _first_step(self) -> float:
        rate = self._fastest()
        if not rate < math.inf:
            self._fail(too_fast(self.time, self._fastest_term()))
        return _FIRST_STEP / rate if rate > 0.0 else self._output_period

    def _take(self, goal: float, count: int) -> int:
        """Take up to `count` steps until one ends after `goal`; returns the status of the last."""
        control, status = self.control, embedded.TOO_FAR
        control.goal = goal
        self._has_dense = False
        while status & embedded.TOO_FAR and count > 0:
            before = int(control.length > 0.0)
            self.ledger.saved_at = -1.0
            status, done = self._call_pair(count)
            count -= done
            self._require_outside()
            # The step in progress does not count yet.
            self.step_count += done + before - int(control.length > 0.0)
            self.step = control.length or self.step
            if self.ledger.saved_at == done:
                self._saved_time = self.end
            if status & embedded.TOO_FAR and self.watch is not None:
                # Before anybody asks for a state: that of dense output is gone.
                self._look_for_contacts(self.end, way=_FARTHER * self.watch.way)
                self._pace(self.step)
                if self.watch.watch.frame[0] != self.end:
                    # So fast that there was no look: the same step would be asked for for ever.
                    self._fail(too_fast(self.end, self._fastest_term()))
        if status & embedded.TOO_SHORT:
            self._fail(
                f'no step from t = {self.end:.9g} s on is short enough for solver.tolerance '
                f'{self.step_size.tolerance:g}: steps of {control.shortest:.3g} s still '
                f'err too much, and the fastest motion is that of {self._fastest_term()}; allow a '
                'larger tolerance, or slow that down')
        if status & ~embedded.TOO_FAR:
            self._respond(status, self.end)
        return int(status)

    def _call_pair(self, count: int) -> tuple[int, int]:
        """Let kernels take up to `count` steps; returns the status and how many they took."""
        watch, started = self._watching(), perf_counter()
        status, done, self._since_check = self._counted(
            lambda team: adaptive_pair(
                DOP8, self.model, self.loads, self.state, self._saved, self.work, team,
                self.control.numbers, count, self._since_check, self.look_interval, watch,
                self.ledger.numbers))
        self.portions.note(int(done), perf_counter() - started)
        return int(status), int(done)

    def _give_up_step(self) -> None:
        """Go back to where the step in progress began."""
        trail = self._trail
        if self.control.length > 0.0:
            for target, source in zip(self.state, trail.start):
                np.copyto(target, source)
            if self.loads is not None:
                np.copyto(self.loads.work, self.loads.earlier_work)
            for meter in self._meters().values():
                np.copyto(meter.done[0], meter.done[1])
            losses = self._losses
            if losses is not None:
                np.copyto(losses.stretch, losses.start)
            control = self.control
            control.total -= control.rate * control.length
            if self._saved_time > self.time:
                self._save()
        self.control.length = self.control.has_last = 0.0
        self._has_dense = False

    def _save(self, time: float | None = None) -> None:
        # The work of loads at the start of a step is kept by the steps themselves.
        for target, source in zip(self._saved, self.state):
            np.copyto(target, source)
        self._save_stretches()
        self._saved_time = self.time if time is None else time

    def _return_to_saved(self) -> None:
        super()._return_to_saved()
        self.control.start, self.control.length = self._saved_time, 0.0


def _total(values: np.ndarray) -> float:
    # Where numbers run away the next look ends the run.
    return math.fsum(values) if np.isfinite(values).all() else math.nan
