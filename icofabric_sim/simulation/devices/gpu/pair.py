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
Steps of the embedded Runge-Kutta pair of `dop8`, taken on a device.

Which steps are tried, accepted and refused is decided here, by the code of a single process
(pair_control.py): what it calls for all bodies is a few launches. State, slopes and what was spent
stay on the device, and come here where the trajectory is asked for them.
"""

from functools import partial
from importlib import import_module
from typing import Any

from icofabric_sim.kernels.contact.clearance import CLEAR
from icofabric_sim.kernels.contact.landing import NEVER_MEET
from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.integrators import embedded
from icofabric_sim.kernels.integrators.splitting import NEVER
from icofabric_sim.kernels.monitor import examine, SAVED_AT, UNSOUND
from icofabric_sim.kernels.probable_error import SMOOTH_RATIO
from icofabric_sim.kernels.records import Loads, Model, State, Team, Work
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.devices.gpu.arrays import (
    copy_back,
    doubles,
    fabric_of,
    MOTION,
    pair_bytes_of,
    POSE,
    put_acting,
    require_room,
    seen,
    StateArrays,
    terms_of,
)
from icofabric_sim.simulation.devices.gpu.health import HealthCheck
from icofabric_sim.simulation.devices.gpu.launching import named_failure, TURN
from icofabric_sim.simulation.devices.gpu.monitor import SHARE
from icofabric_sim.simulation.devices.gpu.opening import Device
from icofabric_sim.simulation.devices.gpu.records import Acting
from icofabric_sim.simulation.devices.gpu.slopes import (
    add_flow,
    combine,
    fold_largest,
    judge,
    Losses,
    ROWS,
    slope_kernel,
)
from icofabric_sim.simulation.devices.pair_control import (
    adaptive_steps,
    fixed_steps,
    idle_pieces,
    nothing,
    Steps,
)
from icofabric_sim.simulation.model.packing import PackedScene
import numpy as np

wp: Any = import_module('warp')

# Slopes of a step that are kept: of its beginning, its stages and its end.
SLOPES = 13
_FIRST, _LAST = 0, 12
# Values of an error that are folded here.
_FEW = 1024
_Run = tuple[Loads, State, Work]


class DevicePair:
    """Steps of the pair of `dop8`, taken on a device."""

    def __init__(self, device: Device, packed: PackedScene) -> None:
        """Put the fabric on the device; ValueError where it lacks memory."""
        self._device, self._packed, self._pair = device, packed, embedded.DOP8
        require_room(device, packed.layout.body_count, self.device_bytes)
        model, slots = packed.model, packed.layout.slot_count
        self._fabric = fabric_of(model, packed.layout, device)
        self._threads = LANES * len(packed.layout.blocks.slot)
        self._losses = Losses(model.damping is not None, model.drag is not None)
        # The state, the stage in progress, and where the step begins.
        self._state = StateArrays(slots, device)
        self._stage: tuple[Any, Any]
        self._start: tuple[Any, Any]
        self._stage, self._start = (
            (self._zeros(POSE * slots), self._zeros(MOTION * slots)) for _ in range(2))
        self._slopes = self._zeros((SLOPES, ROWS * slots))
        spends = any(self._losses)
        self._spent = self._zeros((SLOPES, slots if spends else 0))
        # [J] so far, and when the step in progress began.
        self._done = [self._zeros(slots if spends else 0) for _ in range(2)]
        self._power, self._earlier = self._zeros((SLOPES, 0)), self._zeros(0)
        self._weights = [doubles(row, device) for row in (*self._pair.stages, self._pair.step)]
        self._errors_by = [
            doubles(row, device) for row in (self._pair.error_5, self._pair.error_3)]
        self._errors = [self._zeros((2, self._threads))]
        while self._errors[-1].shape[1] > _FEW:
            self._errors.append(self._zeros((2, -(-self._errors[-1].shape[1] // SHARE))))
        # What acts, and what stands for it where nothing does.
        self._acting: Any = None
        self._idle = Acting()
        self._kernel: Any = None
        self._health = HealthCheck(model, self._fabric, device)
        # Whether the state of the run is on the device, and whether only there; and whether steps
        # were taken since it came there.
        self._is_out = self._is_stale = self._has_stepped = False
        self._run: _Run | None = None
        # Whether a state was saved in the present call.
        self._has_saved = False

    def _zeros(self, shape: Any) -> Any:
        return wp.zeros(shape, dtype=wp.float64, device=self._device.handle)

    @property
    def rank_count(self) -> int:
        """One process takes the steps."""
        return 1

    @property
    def halo_bytes(self) -> int:
        """Nothing travels between processes."""
        return 0

    @property
    def device(self) -> str:
        """Name of the device."""
        return self._device.name

    @property
    def device_bytes(self) -> int:
        """Bytes that the run takes there, about, but for its loads."""
        return pair_bytes_of(self._packed.model, self._packed.layout)

    @property
    def has_saved(self) -> bool:
        """The state that was saved last is here."""
        return False

    def take_saved(self) -> dict[str, np.ndarray]:
        """Have nothing to do: it is here already."""
        return {}

    def take_over(self) -> None:
        """Have the whole state of the run here, where it may be looked at and changed."""
        is_stale, self._is_out, self._is_stale = self._is_stale, False, False
        if is_stale and self._run is not None:
            with TURN, named_failure(self.device, self._forget):
                self._gather(self._run, whole=True)

    def _forget(self) -> None:
        """The state there is lost."""
        self._is_out = self._is_stale = self._has_saved = False

    def take(
        self, model: Model, loads: Loads, state: State, saved: State, work: Work, team: Team,
        control: np.ndarray, count: int, since_check: int, check_interval: int,
        watch: None, ledger: np.ndarray
    ) -> tuple[int, int, int]:
        """Take steps as `adaptive_pair` does, on the device."""
        steps = adaptive_steps(
            model, loads, state, saved, work, team, control, count, since_check, check_interval,
            watch, ledger)
        return self._take(
            steps, model, (loads, state, work), saved, of_run=check_interval < NEVER,
            adapts=True)

    def advance(
        self, model: Model, loads: Loads, state: State, saved: State, work: Work, team: Team,
        origin: float, index: int, h: float, count: int, since_check: int, check_interval: int,
        watch: None, ledger: np.ndarray
    ) -> tuple[int, int, int]:
        """Take steps as `fixed_pair` does, on the device."""
        steps = fixed_steps(
            model, loads, state, saved, work, team, origin, index, h, count, since_check,
            check_interval, watch, ledger)
        return self._take(
            steps, model, (loads, state, work), saved, of_run=check_interval < NEVER,
            adapts=False)

    def _take(
        self, steps: Steps, model: Model, now: _Run,
        saved: State, *, of_run: bool, adapts: bool
    ) -> tuple[int, int, int]:
        if not of_run:
            self.take_over()
        with TURN, named_failure(self.device, self._forget):
            if not (of_run and self._is_out):
                self._put(model, *now)
            if of_run:
                self._run = now
                self._is_out = self._is_stale = True
            # As in compiled code, where what is too large is infinite.
            with np.errstate(all='ignore'):
                status, done, since_check = steps(self._pieces(now, adapts=adapts))
            if self._has_saved:
                # Not before the run knows when that was.
                self._copy_rows(
                    saved, self._state.saved_pose, self._state.saved_motion, back=True)
                self._gather_flows(now)
                self._has_saved = False
            if not of_run:
                self._gather(now, whole=False)
            return int(status), int(done), int(since_check)

    def _pieces(self, now: _Run, *, adapts: bool) -> dict[str, Any]:
        """What the step control calls, by its names there."""
        return {
            **idle_pieces(), 'note_lengths': nothing, 'is_breaking': lambda *_: False,
            'tests_of': lambda *_: 0, 'set_tests': nothing,
            'foresee': lambda *_: NEVER_MEET, 'land': lambda *_: NEVER_MEET,
            'find_clear': lambda *_: CLEAR, 'repeat_slope': self._repeat,
            'slope_at': self._slope_at, 'try_step': self._try_step,
            'largest_error': self._largest_error,
            'add_work': partial(self._accept, keeps_start=adapts),
            'look': partial(self._look, now)}

    # What the step control calls, with the arguments of there.

    def _slope_at(
        self, model: Model, loads: Loads, state: State, work: Work, trail: Any, index: int,
        *rest: Any
    ) -> None:
        self._slope(self._state.poses[0], self._state.motion, int(index), float(rest[2]))

    def _slope(self, pose: Any, motion: Any, index: int, time: float) -> None:
        self._launch(
            self._kernel, self._idle if self._acting is None else self._acting, time, index, pose,
            motion, self._slopes, self._spent, self._power)

    def _launch(self, kernel: Any, *inputs: Any) -> None:
        wp.launch(
            kernel, dim=self._threads, inputs=[self._fabric, *inputs], device=self._device.handle)

    def _try_step(
        self, pair: Any, model: Model, loads: Loads, state: State, work: Work, trail: Any,
        team: Team, watch: None, time: float, h: float, first: int, last: int
    ) -> None:
        for index, weights in enumerate(self._weights, start=1):
            is_end = index == len(self._weights)
            self._launch(
                combine, weights, float(h), int(is_end), self._slopes, self._state.poses[0],
                self._state.motion, *self._stage)
            if not is_end:
                self._slope(*self._stage, index, float(time + self._pair.nodes[index] * h))

    def _largest_error(
        self, pair: Any, model: Model, trail: Any, control: np.ndarray, *rest: Any
    ) -> tuple[float, float]:
        h, kinked = float(rest[3]), float(control[embedded.KINKED])
        smooth = SMOOTH_RATIO * kinked * h * h if kinked > 0.0 else 1e300
        scales = control[embedded.SCALES:embedded.SCALES + 4].tolist()
        self._launch(
            judge, *self._errors_by, wp.vec4d(*scales), smooth, self._slopes, self._errors[0])
        for values, folded in zip(self._errors, self._errors[1:]):
            wp.launch(
                fold_largest, dim=folded.shape, inputs=[values.shape[1], values, folded],
                device=self._device.handle)
        found = self._errors[-1].numpy()
        largest, probable = (
            float(np.where(np.isnan(row), np.inf, row).max(initial=0.0)) for row in found)
        return embedded._ESTIMATE * largest, probable

    def _accept(
        self, loads: Loads, h: float, weights: np.ndarray, first: int, last: int, *,
        keeps_start: bool
    ) -> None:
        here = self._state.poses[0], self._state.motion
        if keeps_start:
            for target, source in zip(self._start, here):
                wp.copy(target, source)
        for target, source in zip(here, self._stage):
            wp.copy(target, source)
        flows = [(self._spent, 1, *self._done)]
        if self._acting is not None:
            flows.append((self._power, int(keeps_start), self._acting.work, self._earlier))
        for power, keeps, done, before in flows:
            if done.size:
                wp.launch(
                    add_flow, dim=done.size,
                    inputs=[self._weights[-1], float(h), power, keeps, done, before],
                    device=self._device.handle)
        # Steps of a given length leave nothing behind of where they began.
        self._has_stepped = self._has_stepped or keeps_start

    def _repeat(self, *_: Any) -> None:
        """The last slope of a step is the first of the next."""
        for rows in (self._slopes, self._spent, self._power):
            if rows.size:
                wp.copy(rows[_FIRST], rows[_LAST])

    def _look(
        self, now: _Run, model: Model, loads: Loads, state: State, saved: State, work: Work,
        team: Team, since_check: int, check_interval: int, watch: None, ledger: np.ndarray,
        done: int, time: float, *rest: Any
    ) -> tuple[int, int]:
        """As `look` of embedded.py does."""
        if since_check < check_interval:
            return 0, since_check
        if self._health.can_examine(model, loads, ledger):
            status = self._health.examine(
                self._state, 0, loads, self._acting, ledger,
                self._done[0] if self._done[0].size else None)
        else:
            self._gather(now, whole=False)
            place_all(model, state, work, 0, len(model.blocks.slot))
            status = examine(model, loads, state, work, time, ledger)
        if not status & UNSOUND:
            ledger[SAVED_AT] = done
            self._state.save(0, None)
            self._has_saved = True
        return int(status), 0

    # Between here and there.

    def _put(self, model: Model, loads: Loads, state: State, work: Work) -> None:
        """Have the state, its slope, what acts and what was spent on the device."""
        self._copy_rows(state, self._state.poses[0], self._state.motion, back=False)
        for target in (self._state.poses[1], self._stage[0], self._start[0]):
            # Slots without a body are never written.
            wp.copy(target, self._state.poses[0])
        assert work.trail is not None
        wp.copy(self._slopes[_LAST], seen(work.trail.slopes[_LAST]))
        if work.spent is not None and self._done[0].size:
            for target, values in zip(self._done, work.spent.done):
                wp.copy(target, seen(values))
            wp.copy(self._spent[_LAST], seen(work.spent.power[_LAST]))
        if len(loads.wrench) or self._acting is not None:
            self._put_loads(loads)
        if model.links is not None:
            # A connector that was broken before the run came here.
            self._fabric.present.assign(model.links.present.ravel())
        self._kernel = slope_kernel(
            terms_of(self._packed.model, loaded=self._acting is not None), self._losses)
        self._has_stepped = False

    def _put_loads(self, loads: Loads) -> None:
        # Once something has acted, the kernel without loads is not made beside the other.
        if self._acting is None:
            self._acting = Acting()
        put_acting(self._acting, loads, self._device)
        count = len(loads.work)
        if self._earlier.size != count:
            self._power, self._earlier = self._zeros((SLOPES, count)), self._zeros(count)
        if count:
            wp.copy(self._earlier, seen(loads.earlier_work))
            wp.copy(self._power[_LAST], seen(loads.power[_LAST]))

    def _gather(self, now: _Run, *, whole: bool) -> None:
        """
        Have state and work here; `whole`: with all that states within the step need.

        Of a step that was taken since they came there: what was before is here.
        """
        loads, state, work = now
        trail = work.trail
        self._gather_flows(now)
        assert trail is not None
        self._copy_rows(state, self._state.poses[0], self._state.motion, back=True)
        with_start = whole and self._has_stepped
        if with_start:
            self._copy_rows(trail.start, *self._start, back=True)
        for index in range(SLOPES) if with_start else (_LAST,):
            copy_back(trail.slopes[index], self._slopes[index])
            if work.spent is not None and self._done[0].size:
                copy_back(work.spent.power[index], self._spent[index])
            if len(loads.work) and self._earlier.size:
                copy_back(loads.power[index], self._power[index])

    def _gather_flows(self, now: _Run) -> None:
        """Have here what was spent, and what the loads have done."""
        loads, _, work = now
        if work.spent is not None and self._done[0].size:
            for values, source in zip(work.spent.done, self._done):
                copy_back(values, source)
        if len(loads.work) and self._earlier.size:
            copy_back(loads.work, self._acting.work)
            copy_back(loads.earlier_work, self._earlier)

    def _copy_rows(self, state: State, pose: Any, motion: Any, *, back: bool) -> None:
        slots = self._packed.layout.slot_count
        for target, first, values in (
                (pose, 0, state.position), (pose, 3, state.orientation),
                (motion, 0, state.linear_velocity), (motion, 3, state.angular_velocity)):
            if back:
                wp.copy(seen(values), target, 0, first * slots, values.size)
            else:
                wp.copy(target, seen(values), first * slots, 0, values.size)
