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
The state of a run: trial states beside it, and a good one to come back to.

Nothing here decides which steps are taken; see `stepper.py`.
"""

from collections.abc import Callable
from functools import partial
import math
from time import perf_counter
from typing import Any

from icofabric_sim.kernels.anchors import look_at_anchors
from icofabric_sim.kernels.contact.forces import touch_all
from icofabric_sim.kernels.contact.losses import losses_of
from icofabric_sim.kernels.contact.pair import contact_scratch
from icofabric_sim.kernels.drives import energy_of_drives
from icofabric_sim.kernels.flows import keep_accelerations, place_all
from icofabric_sim.kernels.integrators.splitting import NEVER
from icofabric_sim.kernels.meters import flowed
from icofabric_sim.kernels.records import (
    ContactLosses,
    Loads,
    Meter,
    Model,
    State,
    Team,
    Watch,
    Work,
)
from icofabric_sim.kernels.runtime.interrupts import leaving
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.contact.broad_phase import BroadPhase
from icofabric_sim.simulation.errors import SimulationError
from icofabric_sim.simulation.model.layout import aligned_empty
from icofabric_sim.simulation.model.packing import acting_lanes, PackedScene
from icofabric_sim.simulation.state_tree import StateTree
from icofabric_sim.simulation.stepping.broken import Broken
from icofabric_sim.simulation.stepping.ledger import Ledger
from icofabric_sim.simulation.stepping.methods import Method
from icofabric_sim.simulation.stepping.obstruction import Obstruction
from icofabric_sim.simulation.stepping.portions import Portions
from icofabric_sim.simulation.stepping.thread_team import ThreadTeam
import numpy as np


class Trajectory:
    """A state that moves in steps, what is looked at on the way, and the last good state."""

    def __init__(
        self,
        packed: PackedScene,
        method: Method,
        state: State,
        loads: Loads | None,
        *,
        origin: float,
        fixed_step: float,
        differences: int,
        energy_limit: float,
        half_edge: float,
        thread_team: ThreadTeam,
        watch: BroadPhase | None,
        broken: Broken,
        obstruction: Obstruction,
    ) -> None:
        """
        Stand with `state` at time `origin` [s]; `fixed_step` 0: chosen.

        `differences`: order of the differences by which the roughness of the motion is judged.
        """
        self.packed, self.model, self.method = packed, packed.model, method
        self.state, self.loads = state, loads
        self.thread_team, self.watch, self.broken = thread_team, watch, broken
        self.obstruction = obstruction
        self.work = packed.layout.room(
            packed.model.links, None if method.symplectic else state, differences=differences,
            damped=packed.model.damping is not None, metered=packed.spends)
        # Which alone looks out for it.
        self.work = self.work._replace(breakage=packed.breakage)
        if packed.external is not None:
            self.work = self.work._replace(
                given=packed.layout.meter(), external=packed.external)
        self.origin, self.index = origin, 0
        self.step, self.fixed = fixed_step, fixed_step > 0.0
        self.step_count = 0
        self.portions = Portions(
            len(packed.model.blocks.slot) * LANES * method.stages
            * (1 if packed.model.links is None else 7))
        self.half_edge = half_edge
        self.ledger = Ledger(packed, energy_limit)
        self.ledger.inverse_size = half_edge**-2
        self.ledger.deepest_limit = math.inf if watch is None else watch.deepest
        self.ledger.told_limit = math.inf if watch is None else watch.told
        self._saved = packed.layout.like(state)
        self._saved_time = origin
        self._side: tuple[State, np.ndarray] | None = None
        self._behind: State | None = None
        self._stretch_behind: np.ndarray | None = None
        self._model_aside: Model = self.model
        # Whether shells touched in the last accuracy probe.
        self.touched_ahead = False
        # [J] by the last run aside
        self._spent_aside = self._given_aside = 0.0
        self._present_work = self._present_spent = self._present_given = 0.0
        self._potential_start = 0.0
        # Energy [J] of the anchors in the state that was shown last.
        self.anchor_energy = 0.0
        # And of the contacts, and the springs of friction in them.
        self.contact_energy = self._held_energy = 0.0
        self._failure: SimulationError | None = None

    @property
    def time(self) -> float:
        """Time [s] of the state."""
        return self._time_of(self.index)

    def _time_of(self, index: int) -> float:
        return self.origin + index * self.step if index else self.origin

    def work_at_state(self) -> float:
        """Work [J] of all loads up to the state that was shown last."""
        return self.ledger.earlier_work + self._present_work

    def spent_at_state(self) -> float:
        """Energy [J] spent up to the state that was shown last."""
        return self._present_spent - self._held_energy

    def given_at_state(self) -> float:
        """Work [J] of a body force up to the state that was shown last."""
        return self._present_given

    @property
    def potential_start(self) -> float:
        """Potential energy [J] of a body force where the balance begins."""
        return self._potential_start

    def trial_steps(
        self, step: float, count: int, loads: Loads | None = None, *,
        start: float | None = None, model: Model | None = None
    ) -> State:
        """
        Where `count` steps of length `step` lead; the trajectory stays where it is.

        `start` [s] and `model`: those of its state, where it is on its way aside.
        """
        if self._side is None:
            self._side = (
                self.packed.layout.like(self.state), aligned_empty(self.work.acceleration.shape))
        state, acceleration = self._side
        for target, source in zip(state, self.state):
            np.copyto(target, source)
        np.copyto(acceleration, self.work.acceleration)
        loads = loads or self._scratch_loads()
        work = self._scratch_work()._replace(acceleration=acceleration)
        self._model_aside = model or self._scratch_model()
        self._take_trial_steps(
            loads, state, work, self.time if start is None else start, step, count)
        self._spent_aside, self._given_aside = flowed(work.spent), flowed(work.given)
        return state

    def compare_ahead(
        self, step: float, count: int, windows: int, compare: Callable[[State, State], None]
    ) -> int:
        """
        Take so many windows of `count` steps, and come back; the state must be saved.

        After each `compare` gets where they lead, and where twice as many of half the length do
        from the beginning of the window. Returns the number of windows: fewer where a body force
        fails in what lies ahead. Whether the run itself ever comes there is not known, so that
        is no failure of the run.
        """
        model, time = self._scratch_model(), self.time
        if self.watch is not None:
            self.watch.has_touched()
        try:
            for done in range(windows):
                half = self.trial_steps(
                    0.5 * step, 2 * count, start=time, model=self._scratch_model(model))
                self._model_aside = model
                self._take_trial_steps(
                    self._scratch_loads(), self.state, self._scratch_work(), time, step, count)
                if self._take_failure() is not None:
                    return done
                compare(self.state, half)
                time += count * step
        finally:
            self.touched_ahead = self.watch is not None and self.watch.has_touched()
            self._restore()
        return windows

    def keep_behind(self) -> None:
        """Keep the saved state aside, for `compare_behind`: the next health check replaces it."""
        losses = self._losses
        if self._behind is None:
            self._behind = self.packed.layout.like(self.state)
        for target, source in zip(self._behind, self._saved):
            np.copyto(target, source)
        self._stretch_behind = None if losses is None else losses.saved.copy()

    def compare_behind(
        self, start: float, count: int, compare: Callable[[State, State], float]
    ) -> float | None:
        """
        Repeat the last `count` steps with twice as many of half the length, and come back.

        From the state of `start` [s], which `keep_behind` has kept. Returns what `compare` finds
        for the two ends; None where a body force fails.
        """
        assert self._behind is not None
        now = [row.copy() for row in self.state]
        acceleration, model = self.work.acceleration.copy(), self._scratch_model()
        losses = losses_of(model.contacts)
        if losses is not None and self._stretch_behind is not None:
            np.copyto(losses.stretch, self._stretch_behind)
        try:
            for target, source in zip(self.state, self._behind):
                np.copyto(target, source)
            self._refresh(start)
            half = self.trial_steps(0.5 * self.step, 2 * count, start=start, model=model)
            failed = self._take_failure() is not None
        finally:
            for target, source in zip(self.state, now):
                np.copyto(target, source)
            self._refresh()
            np.copyto(self.work.acceleration, acceleration)
        return None if failed else compare(self.state, half)

    def _take_trial_steps(
        self, loads: Loads | None, state: State, work: Work, start: float, step: float, count: int
    ) -> None:
        """Take steps from `start` [s] on that nobody looks at on the way, in portions."""
        done = 0
        while done < count:
            portion = min(count - done, self.portions.count)
            self._advance(loads, state, work, start, done, step, portion, 0, NEVER, aside=True)
            done += portion
            leaving.check()

    def state_tree(self) -> dict[str, Any]:
        """All that the steps to come depend on, body by body."""
        tree: dict[str, Any] = {
            'origin': self.origin,
            'index': self.index,
            'step': self.step,
            'step_count': self.step_count,
            'saved_time': self._saved_time,
            'state': self._by_body(self.state),
            'saved': self._by_body(self._saved),
            'ledger': self.ledger.state_tree(),
        }
        if self._failure is not None:
            tree['failure'] = str(self._failure)
        if self._keeps_accelerations:
            tree['acceleration'] = self.packed.layout.gather(self.work.acceleration)
        if self.loads is not None and len(self.loads.wrench):
            rows = self._rows_by_body(self.loads)
            tree['loads'] = {
                'work': self.loads.work[rows], 'earlier_work': self.loads.earlier_work[rows]}
        for name, meter in self._meters().items():
            tree[name] = self.packed.layout.gather(meter.done)
        if self.work.given is not None:
            tree['potential_start'] = self._potential_start
        if self.watch is not None:
            tree['watch'] = self.watch.state_tree()
        if self.broken.count:
            tree['broken'] = self.broken.state_tree()
        if self.obstruction.found:
            tree['obstruction'] = self.obstruction.found
        return tree

    def load_state(self, tree: StateTree, loads: Loads | None) -> None:
        """Go on from there, with the `loads` that acted then."""
        layout = self.packed.layout
        self.origin = tree.number('origin', 0.0)
        self._failure = SimulationError(tree.text('failure')) if 'failure' in tree else None
        self.index, self.step_count = tree.count('index'), tree.count('step_count')
        step = tree.number('step', 0.0)
        if self.fixed and step != self.step:
            raise ValueError(f'step must be solver.step {self.step!r} s, got {step!r} s')
        self.step = step
        # A run that has ended may have failed to find one.
        if self._failure is None and not self.time + step > self.time:
            raise ValueError(f'step {step!r} s leads nowhere from t = {self.time!r} s')
        self._saved_time = tree.number('saved_time', 0.0)
        self.obstruction.found = (
            tree.text('obstruction') if 'obstruction' in tree else '')
        self.broken.load_state(tree.part('broken') if 'broken' in tree else None)
        for name, state in (('state', self.state), ('saved', self._saved)):
            self._take_back(state, tree.part(name))
        self.ledger.load_state(tree.part('ledger'))
        if self.watch is not None:
            self.watch.load_state(tree.part('watch'))
            self._follow_watch()
        self._refresh()
        if self._keeps_accelerations:
            self.work.acceleration[:, layout.slot] = tree.array(
                'acceleration', (layout.body_count, 6)).T
        self.loads = loads
        if loads is not None and len(loads.wrench):
            part, rows = tree.part('loads'), self._rows_by_body(loads)
            loads.work[rows] = part.array('work', rows.shape)
            loads.earlier_work[rows] = part.array('earlier_work', rows.shape)
        for name, meter in self._meters().items():
            meter.done[:, layout.slot] = tree.array(name, (layout.body_count, 2)).T
        if self.work.given is not None:
            self._potential_start = tree.number('potential_start')

    @property
    def _keeps_accelerations(self) -> bool:
        """
        Whether a step begins with a kick, for which its forces are known from the one before.
        """
        return len(self.method.kicks) > len(self.method.drifts)

    def _by_body(self, state: State) -> dict[str, Any]:
        return {
            name: self.packed.layout.gather(values) for name, values in state._asdict().items()}

    def _take_back(self, state: State, tree: StateTree) -> None:
        """
        Write a remembered state; slots without a body are at rest at the origin, as at the start.
        """
        layout = self.packed.layout
        for name, target in state._asdict().items():
            rows = target.shape[:-1]
            values = tree.array(name, (layout.body_count, *rows))
            empty = np.zeros(rows)
            if name == 'orientation':
                empty = np.eye(3) if layout.cosines else np.array([0.0, 0.0, 0.0, 1.0])
            target[:] = empty[..., None]
            target[..., layout.slot] = np.moveaxis(values, 0, -1)

    def _rows_by_body(self, loads: Loads) -> np.ndarray:
        """
        Places of the wrenches on bodies among the work of the loads, by body and then by wrench.

        Whatever the layout: lanes on which a wrench does not act are left out.
        """
        layout = self.packed.layout
        body = np.zeros(layout.slot_count, np.int64)
        body[layout.slot] = np.arange(layout.body_count)
        row, lane = acting_lanes(loads)
        block = np.repeat(layout.blocks.slot, np.diff(loads.start))
        order = np.lexsort((loads.wrench[row], body[block[row] + lane]))
        return (LANES * row + lane)[order]

    def _note_work(
        self, state: State, time: float, stretches: np.ndarray | None, *parts: Loads | None
    ) -> None:
        done = sum(math.fsum(part.work) for part in parts if part is not None)
        self._present_work = done + self._moving(state)
        self._note_anchors(state, time, stretches)

    def _note_anchors(self, state: State, time: float, stretches: np.ndarray | None) -> None:
        self.contact_energy = self._held_energy = 0.0
        if self.watch is not None:
            energy, self._held_energy = self.watch.energies(state, stretches)
            self.contact_energy = energy + self._held_energy
        if self.loads is not None and self.loads.anchors is not None:
            _, energy = look_at_anchors(self.model, self.loads, state, time)
            self.anchor_energy = float(energy)

    def _moving(self, state: State) -> float:
        """Kinetic energy [J] of driven bodies."""
        if self.loads is None or self.loads.drives is None:
            return 0.0
        return float(energy_of_drives(self.model, self.loads, state))

    def _scratch_loads(self) -> Loads | None:
        """The same loads, with room of their own for what they do."""
        if self.loads is None:
            return None
        return self.loads._replace(work=np.zeros_like(self.loads.work))

    def _scratch_model(self, model: Model | None = None) -> Model:
        """The same constants, with room of their own for what contacts remember."""
        model = model or self.model
        losses = losses_of(model.contacts)
        if losses is None or model.contacts is None:
            return model
        copies: dict[str, Any] = {
            name: value.copy() for name, value in losses._asdict().items()
            if isinstance(value, np.ndarray)}
        return model._replace(
            contacts=model.contacts._replace(losses=losses._replace(**copies)))

    @property
    def _losses(self) -> ContactLosses | None:
        return losses_of(self.model.contacts)

    def _stretch(self, model: Model | None = None) -> np.ndarray | None:
        """
        Stretches of friction at the state, or where a `model` aside has gone.
        """
        losses = losses_of((model or self.model).contacts)
        return None if losses is None else losses.stretch

    def _scratch_work(self) -> Work:
        """The same room, with meters of its own."""
        spent, given = (
            None if meter is None else self.packed.layout.meter()
            for meter in (self.work.spent, self.work.given))
        return self.work._replace(spent=spent, given=given)

    def _meters(self) -> dict[str, Meter]:
        meters = {'spent': self.work.spent, 'given': self.work.given}
        return {name: meter for name, meter in meters.items() if meter is not None}

    def _require_outside(self) -> None:
        """Stop if a body force has failed."""
        reason = self._take_failure()
        if reason is None:
            return
        self._return_to_saved()
        self._failure = SimulationError(
            f'{reason}; the last good state, of t = {self._saved_time:.9g} s, is kept')
        raise self._failure

    def _take_failure(self) -> str | None:
        """Why a body force has failed since this was asked last; None if it has not."""
        packed = self.packed
        if packed.external is None or packed.body_force is None or not packed.external.status[0]:
            return None
        reason = packed.body_force.explain(packed.external)
        packed.external.status[0] = 0
        return reason

    def _advance(
        self, loads: Loads | None, state: State, work: Work, origin: float, index: int,
        step: float, count: int, since_check: int, interval: int, *, aside: bool = False
    ) -> tuple[int, int, int]:
        watch, started = self._watching(aside=aside), perf_counter()
        model = self._model_aside if aside else self.model

        def advance(team: Team) -> tuple[int, int, int]:
            return self.method.advance(
                model, loads, state, self._saved, work, team, origin, index, step, count,
                since_check, interval, watch, self.ledger.numbers)

        status, done, since_check = (
            self.thread_team.run(advance) if aside else self._counted(advance))
        self.portions.note(int(done), perf_counter() - started)
        return status, done, since_check

    def _counted(self, advance: Callable[[Team], Any]) -> Any:
        """Take steps of the trajectory, and count the pairs of shells that they look at."""
        watch = self.watch
        if watch is None:
            return self.thread_team.run(advance)
        before = watch.evaluated
        try:
            return self.thread_team.run(advance)
        finally:
            watch.tests += watch.evaluated - before

    def has_contact_kernels(self) -> bool:
        """Whether steps with contacts could be taken at once: nothing need be compiled."""
        watch = self.watch
        if watch is None or watch.contacts is not None:
            return True
        kernel, arguments = self._kernel()
        if not hasattr(kernel, 'is_ready'):
            # In plain Python nothing ever is.
            return True
        model = self.model._replace(contacts=watch.nothing())
        team = self.thread_team.alone()._replace(scratch=contact_scratch())
        return bool(kernel.is_ready(*arguments(model, team)))

    def _kernel(self) -> tuple[Any, Callable[[Model, Team], tuple[Any, ...]]]:
        """The kernel that takes steps, and what it is called with."""
        advance = self.method.advance
        given = advance.args if isinstance(advance, partial) else ()
        kernel = advance.func if isinstance(advance, partial) else advance
        return kernel, lambda model, team: (
            *given, model, self.loads, self.state, self._saved, self.work, team, self.origin,
            self.index, self.step, 1, 0, 1, self._watching(), self.ledger.numbers)

    def _watching(self, *, aside: bool = False) -> Watch | None:
        """What kernels look out for; `aside`: nobody asks what they saw."""
        if self.watch is None:
            return None
        return self.watch.aside if aside else self.watch.watch

    def _follow_watch(self) -> None:
        """Compute the contacts that the watch knows of from now on, and no others."""
        if self.watch is not None:
            self.model = self.model._replace(contacts=self.watch.contacts)
            self.thread_team.meet(self.watch.contacts is not None)
            self.ledger.contact_rate = self.watch.rate

    def _refresh(self, time: float | None = None) -> None:
        """Accelerations of the state as it is; `time` [s] where that is not the present."""
        last = len(self.model.blocks.slot)
        place_all(self.model, self.state, self.work, 0, last)
        if self.model.contacts is not None:
            touch_all(
                self.model.contacts, self.state.position, self.state.orientation,
                self.thread_team.alone())
        keep_accelerations(
            self.model, self.state, self.work, self.time if time is None else time, 0, last)

    def _save(self, time: float | None = None) -> None:
        for target, source in zip(self._saved, self.state):
            np.copyto(target, source)
        if self.loads is not None:
            np.copyto(self.loads.earlier_work, self.loads.work)
        self._save_stretches()
        self._saved_time = self.time if time is None else time

    def _restore(self) -> None:
        for target, source in zip(self.state, self._saved):
            np.copyto(target, source)
        losses = self._losses
        if losses is not None:
            np.copyto(losses.stretch, losses.saved)
        self._refresh()

    def _save_stretches(self) -> None:
        losses = self._losses
        if losses is not None:
            np.copyto(losses.saved, losses.stretch)

    def _return_to_saved(self) -> None:
        self._restore()
        self.origin, self.index = self._saved_time, 0
