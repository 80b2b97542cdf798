# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A splitting method whose steps run on a GPU."""

from collections.abc import Iterator
from importlib import import_module
from typing import Any

from icofabric_sim.kernels.monitor import roughness
from icofabric_sim.kernels.records import Loads, Model, State, Work
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.devices.executor import (
    Call,
    Interval,
    RemoteSteps,
    sampled_batches,
)
from icofabric_sim.simulation.devices.gpu.arrays import (
    bytes_of,
    copy_back,
    doubles,
    driven_terms,
    MOTION,
    pair_bytes_of,
    POSE,
    put_acting,
    put_crossings,
    require_room,
    terms_of,
)
from icofabric_sim.simulation.devices.gpu.crossings import crossings, kinked_stages, note
from icofabric_sim.simulation.devices.gpu.kernels import sample, step_kernel
from icofabric_sim.simulation.devices.gpu.launching import launch, load, TURN
from icofabric_sim.simulation.devices.gpu.opening import Device
from icofabric_sim.simulation.devices.gpu.pair import DevicePair
from icofabric_sim.simulation.devices.gpu.records import Acting, Nearness, Stage
from icofabric_sim.simulation.devices.gpu.run import DeviceRun
from icofabric_sim.simulation.devices.refusals import require_method_on_device
from icofabric_sim.simulation.model.layout import has_jumps
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.stepping.ledger import Ledger
from icofabric_sim.simulation.stepping.methods import Method, METHODS
from icofabric_sim.simulation.stepping.step_monitor import differences_of
from icofabric_sim.terms.contacts.force import set_tests, tests_of
import numpy as np

wp: Any = import_module('warp')

# Evaluations of the forces in the longest graph.
_MAX_GRAPH_EVALUATIONS = 64
_STORED_SOURCE, _EVALUATED_SOURCE = 1, 2
_NOTHING_NEAR = Nearness()


class DeviceSteps(DeviceRun, RemoteSteps):
    """Steps of a method on a GPU."""

    def __init__(
        self, device: Device, packed: PackedScene, method: Method, *, given: bool, estimated: bool
    ) -> None:
        """
        Copy the fabric to the device; raise ValueError if memory is insufficient.

        `given` means a given step, whose error is `estimated`.
        """
        self._method, self._stages = method, method.stages
        self._follows_kinks = method.mends_kinks and has_jumps(packed.model.links)
        super().__init__(device, packed, bytes_of(
            packed.model, packed.layout, kinked=self._follows_kinks,
            touching=packed.contact is not None))
        self._differences = differences_of(
            method, packed.model.links, given=given, estimated=estimated)
        if self._follows_kinks:
            slots = packed.layout.slot_count
            put_crossings(self._fabric, slots, device)
            # Velocities before a kick; velocities and accelerations around it.
            self._before = wp.zeros(MOTION * slots, dtype=wp.float64, device=device.handle)
            self._noted = wp.zeros(2 * MOTION * slots, dtype=wp.float64, device=device.handle)
        self._clock.drifts = doubles(np.array(method.drifts), device)
        self._clock.kick_first = int(len(method.kicks) > len(method.drifts))
        self._difference: Any = None
        # Graphs of launches of so many steps, by what acts, by the pose that they begin with, by
        # whether ways are noted, and by the room for pairs.
        self._graphs: dict[tuple[int, bool, int, tuple[bool, int]], Any] = {}
        # Where the saved state belongs here, while it is on the device alone.
        self._saved_for: tuple[State, Loads] | None = None

    @property
    def has_saved(self) -> bool:
        """True if the last saved state is only on the device."""
        return self._saved_for is not None

    def gather_saved(self) -> dict[str, np.ndarray]:
        """Copy the saved state to this process; return the work of loads at that time."""
        if self._saved_for is None:
            return {}
        (saved, loads), self._saved_for = self._saved_for, None
        with self.together():
            self._state.take_saved(saved, loads.earlier_work)
        return {'work': loads.earlier_work.copy()}

    def _forget(self) -> None:
        super()._forget()
        self._saved_for = None

    def bare_steps(self, count: int) -> None:
        """
        Take `count` more steps of the same length on the device, and wait for them.

        For measurements only: without health checks, and without a change of the run.
        """
        with TURN:
            self._steps(0, count)
            wp.synchronize_device(self._device.handle)

    def enter(self) -> None:
        """Copy the state of the call to the device, unless the device holds it already."""
        super().enter()
        self._clock.start.assign(np.array([self._origin, self._step]))

    def take(self, interval: Interval) -> None:
        """Take the steps of an interval, and sample the roughness of the motion."""
        work, differences, self._is_here = self._call.work, self._differences, False
        for first, count, place in sampled_batches(interval, differences, self._stages):
            if place >= 0 and place % differences == 0:
                self._sample(work, 0)
            self._steps(first, count)
            if place >= 0:
                self._sample(work, place % differences + 1)
            if place >= 0 and place % differences + 1 == differences:
                copy_back(work.difference, self._difference)
                book = Ledger.over(self._call.ledger)
                book.roughest = max(book.roughest, roughness(work, self._call.ledger))

    def save(self) -> None:
        """Save the state that was just examined, where it was examined."""
        loads, self._saved_for = self._call.loads, None
        if self._is_examined_there:
            self._state.save(self._now, self._acting.work if len(loads.work) else None)
            self._saved_for = self._call.saved, loads
        else:
            super().save()

    def leave(self) -> None:
        """Copy displacements and overlaps from the device, and the state of a trial."""
        if self._near is not None:
            if self._is_watching and self._call.watch is not None:
                self._near.note_ways(self._call.watch)
            self._near.note_depths(self._contacts)
        if not self._call.of_run:
            self._bring(self._call, whole=True)

    def _put(self, model: Model, loads: Loads, state: State, work: Work) -> None:
        self._state.put(state, work)
        self._now = 0
        # Once something has acted, the kernel without loads is not made beside the other.
        if len(loads.wrench) or self._acting is not None:
            if self._acting is None:
                self._acting = Acting()
            if put_acting(self._acting, loads, self._device):
                # Graphs with loads hold the arrays of the loads before.
                self._graphs = {key: graph for key, graph in self._graphs.items() if not key[1]}
        if model.links is not None:
            # A connector that was broken before the run came here.
            self._fabric.present.assign(model.links.present.ravel())
        if work.difference.size:
            if self._difference is None:
                self._difference = doubles(work.difference, self._device)
            self._difference.assign(work.difference.ravel())

    def _bring(self, call: Call, *, whole: bool) -> None:
        """Copy state and work of loads to this process; `whole` adds data for the next step."""
        _, loads, state, _, work, *_ = call
        self._state.take(self._now, state, work, whole=whole)
        if len(loads.wrench):
            copy_back(loads.work, self._acting.work)
        if whole and self._difference is not None and work.difference.size:
            copy_back(work.difference, self._difference)

    def _steps(self, index: int, count: int) -> None:
        """Take `count` steps from number `index` on, by graphs of launches."""
        loaded, contacts, room = self._acting is not None, self._contacts, 0
        if contacts is not None and self._near is not None and len(contacts.pairs):
            set_tests(contacts, 0, tests_of(contacts, 0) + (
                count * self._method.stages * len(contacts.pairs)))
            room = self._near.room
        seen_by = self._is_watching, room
        longest = max(_MAX_GRAPH_EVALUATIONS // self._method.stages, 1)
        while count:
            # Powers of two: few graphs do for any count.
            length = min(1 << count.bit_length() - 1, longest)
            self._clock.index.assign(np.array([index], np.int64))
            key = length, loaded, self._now, seen_by
            graph = self._graphs.get(key)
            if graph is None:
                graph = self._graphs[key] = self._record(length, loaded, room > 0)
            wp.capture_launch(graph)
            self._now ^= self._flips(length) & 1
            index += length
            count -= length

    def _flips(self, count: int) -> int:
        """Return how often `count` steps move poses from one array to the other."""
        if self._follows_kinks:
            return count * len(self._method.drifts)
        return sum(stage.drift != 0.0 for stage in stages_of(self._method, count))

    def _record(self, count: int, loaded: bool, touching: bool) -> Any:
        """Record the launches of `count` steps as one graph."""
        now, acting = self._now, self._acting if loaded else Acting()
        if self._follows_kinks:
            return self._record_kinked(count, loaded, acting)
        kernel = step_kernel(driven_terms(
            terms_of(self._packed.model, loaded=loaded), self._packed.model,
            acting if loaded else None)._replace(touching=touching))
        near = self._near if touching or self._is_watching else None
        # Nothing can be loaded while launches are recorded.
        load(kernel, self._device.handle)
        if near is not None:
            near.load()
        with wp.ScopedCapture(device=self._device.handle) as capture:
            for stage in stages_of(self._method, count):
                if near is not None and stage.source == _EVALUATED_SOURCE:
                    near.evaluate(
                        self._clock, stage.push_step, stage.push_drifts,
                        self._state.poses[now], touching=touching,
                        watching=self._is_watching)
                launch(
                    kernel, dim=LANES * len(self._packed.layout.blocks.slot),
                    inputs=[
                        self._fabric, acting, _NOTHING_NEAR if near is None else near.near,
                        self._clock, stage, self._state.poses[now], self._state.poses[1 - now],
                        self._state.motion, self._state.acceleration],
                    device=self._device.handle)
                if stage.drift != 0.0:
                    now = 1 - now
        return capture.graph

    def _record_kinked(self, count: int, loaded: bool, acting: Any) -> Any:
        """Record the launches of `count` steps that resolve jumps of slopes as one graph."""
        terms = terms_of(self._packed.model, loaded=loaded)._replace(kept=True)
        kernel = step_kernel(terms)
        more = crossings(midpoints=terms.midpoints)
        for one in (kernel, note, more.foretell, more.account, more.strike):
            load(one, self._device.handle)
        state, method, handle = self._state, self._method, self._device.handle
        now, threads = self._now, LANES * len(self._packed.layout.blocks.slot)

        def launch_on_bodies(one: Any, *inputs: Any) -> None:
            launch(one, dim=threads, inputs=[self._fabric, *inputs], device=handle)

        def take(stage: Any, moved: Any) -> None:
            launch_on_bodies(
                kernel, acting, _NOTHING_NEAR, self._clock, stage, state.poses[now], moved,
                state.motion,
                state.acceleration)

        with wp.ScopedCapture(device=handle) as capture:
            for step in range(count):
                first, *parts, back, forth, last = kinked_stages(method, step)
                wp.copy(self._before, state.motion)
                take(first, state.poses[1 - now])
                launch_on_bodies(
                    note, self._clock, method.kicks[0], 1, self._before, state.motion,
                    self._noted)
                launch_on_bodies(
                    more.foretell, self._clock, method.kicks[0], int(terms.held),
                    state.poses[now], self._noted, state.motion)
                for stage in parts:
                    if stage.keep:
                        wp.copy(self._before, state.motion)
                    take(stage, state.poses[1 - now])
                    if stage.drift != 0.0:
                        now = 1 - now
                launch_on_bodies(
                    note, self._clock, method.kicks[-1], 0, self._before, state.motion,
                    self._noted)
                launch_on_bodies(more.account, self._clock, state.poses[now], self._noted)
                for stage, row in ((back, 12), (forth, 0)):
                    # Each body reads its own pose only: in place.
                    take(stage, state.poses[now])
                    launch_on_bodies(
                        more.strike, row, int(terms.held), state.poses[now], state.motion)
                take(last, state.poses[1 - now])
        return capture.graph

    def _sample(self, work: Work, number: int) -> None:
        """Add the poses at the end of a step to the difference that measures roughness."""
        count = self._difference.shape[0] // POSE
        launch(
            sample, dim=count, inputs=[
                self._fabric.slot, count // LANES, LANES, self._packed.layout.slot_count,
                float(work.weights[number]), int(number == 0), self._state.poses[self._now],
                self._difference], device=self._device.handle)


def stages_of(method: Method, count: int) -> Iterator[Any]:
    """
    Yield the launches of `count` steps of a method.

    Each launch kicks at the positions after the previous drift, and drifts. The first launch only
    drifts, after a kick by stored accelerations if steps start with a kick.
    """
    kicks, drifts = method.kicks, method.drifts
    kick_first, stages = len(kicks) > len(drifts), min(len(kicks), len(drifts))
    first = Stage()
    if kick_first:
        first.source, first.kick = _STORED_SOURCE, kicks[0]
    first.drift = drifts[0]
    yield first
    for evaluation in range(count * stages):
        step, number = divmod(evaluation, stages)
        is_last, ends = evaluation + 1 == count * stages, number + 1 == stages
        stage = Stage()
        stage.source, stage.push_step, stage.push_drifts = _EVALUATED_SOURCE, step, number + 1
        stage.kick = kicks[number + 1] if kick_first else kicks[number]
        if kick_first:
            stage.keep = int(is_last)
            stage.again = kicks[0] if ends and not is_last else 0.0
        if not ends or not kick_first:
            stage.drift, stage.drift_step = drifts[number + 1], step
            stage.drift_drifts = number + 1
            if ends and not is_last:
                stage.second, stage.second_step = drifts[0], step + 1
        elif not is_last:
            stage.drift, stage.drift_step = drifts[0], step + 1
        yield stage


def device_method(
    device: Device, packed: PackedScene, name: str, *, given: bool, estimated: bool,
    later: str = ''
) -> Method:
    """
    Return the method `name` with steps on the device.

    `later` is the method that may take over and needs memory at the same time; empty without one.
    """
    require_method_on_device(name, device.choice)
    method = METHODS[name]
    if later and METHODS[later].embedded is not None:
        touching = packed.contact is not None
        require_room(device, packed.layout.body_count, bytes_of(
            packed.model, packed.layout, kinked=method.mends_kinks, touching=touching
        ) + pair_bytes_of(packed.model, packed.layout, touching=touching))
    if method.embedded is not None and method.embedded.pair is not None:
        pair = DevicePair(device, packed, method.embedded.pair)
        return method._replace(
            advance=pair.advance, executor=pair, embedded=method.embedded._replace(take=pair.take))
    steps = DeviceSteps(device, packed, method, given=given, estimated=estimated)
    return method._replace(advance=steps.advance, executor=steps)
