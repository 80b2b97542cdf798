# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Steps of an embedded Runge-Kutta pair on a GPU.

What the step control asks of the bodies (pair_control.py) are a few launches. State, slopes and
dissipated energies stay on the device and are copied to this process when the trajectory needs
them.
"""

from importlib import import_module
from typing import Any

from icofabric_sim.kernels.integrators.bodies import LEFT_REGION
from icofabric_sim.kernels.integrators.tableau import DENSE, FIRST, LAST, Pair
from icofabric_sim.kernels.records import Loads, Model, State, Work
from icofabric_sim.kernels.rhs import path_error
from icofabric_sim.kernels.rotations import rows_of
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.devices.executor import Call
from icofabric_sim.simulation.devices.gpu.arrays import (
    copy_back,
    copy_rows,
    doubles,
    driven_terms,
    MOTION,
    pair_bytes_of,
    POSE,
    put_acting,
    seen,
    terms_of,
)
from icofabric_sim.simulation.devices.gpu.launching import launch
from icofabric_sim.simulation.devices.gpu.monitor import SHARE
from icofabric_sim.simulation.devices.gpu.opening import Device
from icofabric_sim.simulation.devices.gpu.paths import place_driven
from icofabric_sim.simulation.devices.gpu.records import Acting, Nearness
from icofabric_sim.simulation.devices.gpu.run import DeviceRun
from icofabric_sim.simulation.devices.gpu.slopes import (
    add_flow,
    combine,
    find_quickest,
    fold_largest,
    judge,
    Losses,
    slope_kernel,
    STATE_ROW_COUNT,
)
from icofabric_sim.simulation.devices.pair_control import DistantBodies, Mean
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.terms.contacts.displacement import LATE
from icofabric_sim.terms.contacts.force import set_tests, tests_of
import numpy as np

wp: Any = import_module('warp')

# Most values of an error that this process folds.
_HOST_FOLD_COUNT = 1024
_NOTHING_NEAR = Nearness()


class DevicePair(DeviceRun, DistantBodies):
    """Steps of an embedded pair on a GPU."""

    def __init__(self, device: Device, packed: PackedScene, pair: Pair) -> None:
        """Copy the fabric to the device; raise ValueError if memory is insufficient."""
        DistantBodies.__init__(self, pair)
        DeviceRun.__init__(self, device, packed, pair_bytes_of(
            packed.model, packed.layout, touching=packed.contact is not None))
        model, slots = packed.model, packed.layout.slot_count
        self._threads = LANES * len(packed.layout.blocks.slot)
        self._losses = Losses(model.damping is not None, model.drag is not None)
        # The stage in progress, and the start of the step.
        self._stage: tuple[Any, Any]
        self._start: tuple[Any, Any]
        self._stage, self._start = (
            (self._zeros(POSE * slots), self._zeros(MOTION * slots)) for _ in range(2))
        self._slopes = self._zeros((DENSE, STATE_ROW_COUNT * slots))
        spends = any(self._losses)
        self._spent = self._zeros((DENSE, slots if spends else 0))
        # [J] in total, and at the start of the step in progress.
        self._done = [self._zeros(slots if spends else 0) for _ in range(2)]
        self._spent_sum = self._done[0] if spends else None
        self._power, self._earlier = self._zeros((DENSE, 0)), self._zeros(0)
        self._weights = [doubles(row, device) for row in pair.stage_weights]
        self._errors_by = [
            doubles(row, device) for row in (pair.higher_error, pair.lower_error)]
        self._errors = [self._zeros((2, self._threads))]
        while self._errors[-1].shape[1] > _HOST_FOLD_COUNT:
            self._errors.append(self._zeros((2, -(-self._errors[-1].shape[1] // SHARE))))
        self._idle = Acting()  # empty loads
        self._kernel: Any = None
        self._has_stepped = False  # whether steps were taken since the last copy
        # True if a state was saved in the present call.
        self._saves = False
        # The clock has the time of the evaluated slope.
        self._clock.drifts, self._clock.kick_first = self._zeros(1), 1
        self._speeds: list[Any] = []

    def _zeros(self, shape: Any) -> Any:
        return wp.zeros(shape, dtype=wp.float64, device=self._device.handle)

    def _forget(self) -> None:
        super()._forget()
        self._saves = False

    def enter(self) -> None:
        """Copy the state of the call to the device, unless the device holds it already."""
        super().enter()
        terms = terms_of(self._packed.model, loaded=self._acting is not None)
        self._kernel = slope_kernel(
            driven_terms(terms, self._packed.model, self._acting)._replace(
                touching=self._is_touching), self._losses)

    def leave(self) -> None:
        """Copy a state that was saved, and that of a trial."""
        if self._saves:
            # After the run knows the time of the saved state.
            copy_rows(
                self._call.saved, self._state.saved_pose, self._state.saved_motion, back=True)
            self._gather_flows(self._call)
            self._saves = False
        if not self._call.of_run:
            self._bring(self._call, whole=False)

    # What the control asks.

    def begin(self) -> None:
        """Do nothing: connectors do not break."""

    def may_break(self, h: float) -> bool:
        """Return False: connectors do not break."""
        return False

    def find_slope(self, index: int, of_stage: bool, time: float) -> None:
        """Write slope number `index` at a `time` [s]: of the stage in progress, or the state."""
        pose, motion = self._stage if of_stage else (self._state.poses[0], self._state.motion)
        self._slope(pose, motion, int(index), float(time))

    def _slope(self, pose: Any, motion: Any, index: int, time: float) -> None:
        if self._acting is not None and self._acting.paths:
            self._launch(place_driven, self._acting, time, pose, motion)
        self._evaluate(pose, time, touching=self._is_touching)
        self._launch(
            self._kernel, self._idle if self._acting is None else self._acting,
            _NOTHING_NEAR if self._near is None else self._near.near, time, index, pose, motion,
            self._slopes, self._spent, self._power)

    def _evaluate(self, pose: Any, time: float, *, touching: bool) -> None:
        """Evaluate contacts at a `pose` before forces, or only record displacements."""
        if self._near is None or not (touching or self._is_watching):
            return
        self._clock.start.assign(np.array([time, 0.0]))
        self._near.evaluate(
            self._clock, 0, 0, pose, touching=touching, watching=self._is_watching)
        if touching and self._contacts is not None:
            set_tests(
                self._contacts, 0, tests_of(self._contacts, 0) + len(self._contacts.pairs))

    @property
    def _is_touching(self) -> bool:
        """True if there are candidate pairs."""
        return self._contacts is not None and len(self._contacts.pairs) > 0

    def _forget_ways(self) -> None:
        watch = self._call.watch
        if self._is_watching and watch is not None and self._near is not None:
            self._near.forget_ways()
            watch.far[0] = 0.0

    def have_state(self, slopes: range = range(0)) -> None:
        """Copy the state and some slopes to this process."""
        super().have_state()
        trail = self._call.work.trail
        assert trail is not None
        for index in slopes:
            copy_back(trail.slopes[index], self._slopes[index])

    def _quickest(self, mean: Mean, time: float) -> tuple[float, float]:
        """
        Return the largest speed and displacement, as `fastest_points` of contacts/clearance.py.
        """
        assert self._near is not None
        if not self._speeds:
            self._speeds = [self._zeros(values.shape) for values in self._errors]
        self._launch(
            find_quickest, self._near.near, time, self._pair.stage_count, wp.vec3d(*mean),
            self._slopes, self._state.poses[0], self._speeds[0])
        speed, moved = self._largest(self._speeds)
        return speed, moved

    def _largest(self, rows: list[Any]) -> list[float]:
        """
        Return the largest value of each row of the first array; the others hold partial results.
        """
        for values, folded in zip(rows, rows[1:]):
            launch(
                fold_largest, dim=folded.shape, inputs=[values.shape[1], values, folded],
                device=self._device.handle)
        return [
            float(np.where(np.isnan(row), np.inf, row).max(initial=0.0))
            for row in rows[-1].numpy()]

    def _launch(self, kernel: Any, *inputs: Any) -> None:
        launch(
            kernel, dim=self._threads, inputs=[self._fabric, *inputs], device=self._device.handle)

    def try_step(self, pair: Pair, time: float, h: float, is_judged: bool) -> None:
        """Compute the other slopes of a step from `time` [s], and its end."""
        if is_judged:
            self._forget_ways()
        if self._call.loads.drives is not None:
            # Later contacts belong to this step.
            self._has_touched()
        for index, weights in enumerate(self._weights, start=1):
            is_end = index == len(self._weights)
            self._launch(
                combine, weights, float(h), int(is_end), self._slopes, self._state.poses[0],
                self._state.motion, *self._stage)
            if not is_end:
                self._slope(*self._stage, index, float(time + self._pair.nodes[index] * h))
        # Forces will be evaluated at the end, too.
        self._evaluate(self._stage[0], float(time + h), touching=False)

    def largest_error(
        self, pair: Pair, scales: np.ndarray, smooth: float, h: float
    ) -> tuple[float, float]:
        """Return the error rate of a step, and the probable one."""
        model, loads, watch = self._call.model, self._call.loads, self._call.watch
        self._launch(
            judge, *self._errors_by, wp.vec4d(*scales.tolist()), smooth, self._slopes,
            self._errors[0])
        largest, probable = self._largest(self._errors)
        if loads.drives is not None and self._has_touched():
            trail = self._call.work.trail
            assert trail is not None
            for index in range(pair.stage_count):
                copy_back(trail.slopes[index], self._slopes[index])
                copy_back(loads.power[index], self._power[index])
            rows = rows_of(trail.start.orientation).shape[0]
            largest = max(largest, path_error(
                loads.drives, model, loads, trail.slopes, rows, pair.higher_error,
                pair.lower_error, scales[2], 0, len(model.blocks.slot)))
        if self._is_watching and watch is not None and self._near is not None:
            self._near.note_ways(watch)
            if watch.far[0] > watch.limits[LATE] and largest < LEFT_REGION:
                largest = LEFT_REGION
        return pair.estimate_ratio * largest, pair.probable_ratio * probable

    def _has_touched(self) -> bool:
        """Return True if any pair has touched since the last call."""
        contacts = self._contacts
        if self._near is None or contacts is None:
            return False
        before, contacts.deepest[1] = contacts.deepest[1], 0.0
        self._near.note_depths(contacts)
        touched = contacts.deepest[1] > 0.0
        contacts.deepest[1] = max(before, contacts.deepest[1])
        return bool(touched)

    def accept_step(self, pair: Pair, h: float, keeps_start: bool) -> None:
        """Let the bodies be where the step of `h` [s] ends."""
        self._is_here = False
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
                launch(
                    add_flow, dim=done.size,
                    inputs=[self._weights[-1], float(h), power, keeps, done, before],
                    device=self._device.handle)
        # Steps of a given length do not store their start.
        self._has_stepped = self._has_stepped or keeps_start

    def repeat_slope(self) -> None:
        """Copy the last slope of a step to the first slope of the next."""
        for rows in (self._slopes, self._spent, self._power):
            if rows.size:
                wp.copy(rows[FIRST], rows[LAST])

    def save(self) -> None:
        """Save the state that was just examined on the device."""
        self._state.save(0, None)
        self._saves = True

    # Copies between this process and the device.

    def _put(self, model: Model, loads: Loads, state: State, work: Work) -> None:
        """Copy the state, its slope, loads and dissipated energies to the device."""
        copy_rows(state, self._state.poses[0], self._state.motion, back=False)
        for target in (self._state.poses[1], self._stage[0], self._start[0]):
            # Slots without a body are never written.
            wp.copy(target, self._state.poses[0])
        assert work.trail is not None
        wp.copy(self._slopes[LAST], seen(work.trail.slopes[LAST]))
        if work.spent is not None and self._done[0].size:
            for target, values in zip(self._done, work.spent.done):
                wp.copy(target, seen(values))
            wp.copy(self._spent[LAST], seen(work.spent.power[LAST]))
        if len(loads.wrench) or self._acting is not None:
            self._put_loads(loads)
        if model.links is not None:
            # Connectors may have broken before the run used the device.
            self._fabric.present.assign(model.links.present.ravel())
        self._has_stepped = False

    def _put_loads(self, loads: Loads) -> None:
        # After the first loads, the kernel without loads is no longer used.
        if self._acting is None:
            self._acting = Acting()
        put_acting(self._acting, loads, self._device)
        count = len(loads.work)
        if self._earlier.size != count:
            self._power, self._earlier = self._zeros((DENSE, count)), self._zeros(count)
        if count:
            wp.copy(self._earlier, seen(loads.earlier_work))
            wp.copy(self._power[LAST], seen(loads.power[LAST]))

    def _bring(self, call: Call, *, whole: bool) -> None:
        """
        Copy state and work to this process; `whole` adds the data for states within the step.

        Data from before the last copy to the device are in this process already.
        """
        _, loads, state, _, work, *_ = call
        trail = work.trail
        self._gather_flows(call)
        assert trail is not None
        copy_rows(state, self._state.poses[0], self._state.motion, back=True)
        with_start = whole and self._has_stepped
        if with_start:
            copy_rows(trail.start, *self._start, back=True)
        for index in range(DENSE) if with_start else (LAST,):
            copy_back(trail.slopes[index], self._slopes[index])
            if work.spent is not None and self._done[0].size:
                copy_back(work.spent.power[index], self._spent[index])
            if len(loads.work) and self._earlier.size:
                copy_back(loads.power[index], self._power[index])

    def _gather_flows(self, call: Call) -> None:
        """Copy dissipated energies and the work of loads to this process."""
        loads, work = call.loads, call.work
        if work.spent is not None and self._done[0].size:
            for values, source in zip(work.spent.done, self._done):
                copy_back(values, source)
        if len(loads.work) and self._earlier.size:
            copy_back(loads.work, self._acting.work)
            copy_back(loads.earlier_work, self._earlier)
