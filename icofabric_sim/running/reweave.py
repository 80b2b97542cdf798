# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Changes of a running scene: built in a separate thread, swapped in between two steps.

The effect of a change on the run is a column of the table of parameters, see
parameters/changes.py. A rebuilt fabric continues from the state of the old one, bit for bit, at
the same time. If the motion restarts, it starts from the initial state at that time. Wrenches
continue if the new scene has their channel or body (by number), also during their hold time. The
others end and are reported by name.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
import logging
import threading
import time
from typing import NamedTuple, TYPE_CHECKING, TypeVar

from icofabric_sim.kernels.runtime.kernel_guard import no_compiling
from icofabric_sim.messages.topics import Outputs
from icofabric_sim.parameters.changes import rebuilds, with_immediate_changes
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.process.compile_notice import KernelsMissing
from icofabric_sim.running.parameter_change import ParameterChange
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.errors import KernelsAwaited
from icofabric_sim.simulation.inputs.input_types import has_target, PullTarget
from icofabric_sim.simulation.model.body_force import BodyForce
from icofabric_sim.simulation.model.expression_force import with_expressions
from icofabric_sim.simulation.precompile import (
    compile_elsewhere,
    counted_as_compiling,
    MAX_BODY_COUNT,
)
from icofabric_sim.simulation.simulation import compile_scene, measure_forces, Simulation

if TYPE_CHECKING:
    from icofabric_sim.simulation.devices.ranks import Ranks

_LOGGER = logging.getLogger('icofabric_sim')
# Pause after a build: a multiple of its duration, and the longest pause [s]. A slider that sends
# fifty changes a second must not take the processor from the run. The second pair is for a run
# without spare time, which each change slows down.
_PAUSE, _BUSY_PAUSE = (25.0, 0.3), (80.0, 0.8)
# Attempts to build with kernels compiled in another process, before this process compiles.
_MAX_TRIES = 3
# Swaps that may be postponed for missing kernels; a later one compiles them in the run.
_MAX_SWAP_TRIES = 2
Result = TypeVar('Result')


def lost_wrenches(before: Simulation, scene: Scene) -> list[str]:
    """Return the names of the wrenches in `before` that have no channel or body in `scene`."""
    pulls = [PullTarget(body) for body in before.inputs.pulled_bodies]
    return [
        str(target) for target in (*before.inputs.acting(), *pulls)
        if not has_target(scene, target)]


class SwapPostponed(Exception):
    """The swap needs kernels that are not compiled yet; nothing has changed."""


class _Built(NamedTuple):
    change: ParameterChange
    simulation: Simulation
    outputs: Outputs | None  # its message layouts


class Reweaver:
    """
    Builder of the requested scene; requests during a build are combined into one more build.

    If a build fails, the request before it is built, so that one bad change does not discard the
    others.
    """

    def __init__(
        self,
        post: Callable[[Callable[[], None]], object],
        on_ready: Callable[
            [Parameters, Simulation | None, str, list[ParameterChange]], None],
        body_force: BodyForce | None = None,
        ranks: 'Ranks | None' = None,
        has_touched: Callable[[], bool] = lambda: False,
        is_measured: Callable[[], bool] = lambda: False,
        has_time: Callable[[], bool] = lambda: True,
    ) -> None:
        """
        Pass results to `on_ready`, which `post` runs in the runner's thread.

        Its arguments are the requested parameters, whose output rates may be newer than those of
        the built scene; the simulation, or None and the reason; and the changes that are answered.
        A rejection may follow a successful build. If `on_ready` raises SwapPostponed, the scene is
        built again with the kernels for contacts. `body_force` is kept, and `ranks` share the
        steps of the new fabric. The swap waits for the kernels for contacts if shells of the
        running fabric have been near each other (`has_touched`), and for those of measured forces
        while they have receivers (`is_measured`). `has_time`: the run has spare time.
        """
        self._post, self._has_time = post, has_time
        self._on_ready = on_ready
        self._body_force, self._ranks = body_force, ranks
        self._has_touched, self._is_measured = has_touched, is_measured
        # Swaps of the present build that needed missing kernels.
        self._postponed_count = 0
        self._number = 0
        # The latest request; the requests not built yet, and those not answered yet; the last one
        # built, and the reason why a newer one was not.
        self._newest: ParameterChange | None = None
        self._open: list[ParameterChange] = []
        self._unanswered: list[ParameterChange] = []
        self._built: _Built | None = None
        self._reason = ''
        self.outputs: Outputs | None = None  # messages of the last build
        self._free_at = 0.0  # earliest time of the next build

    def want(self, change: ParameterChange) -> None:
        """Build the simulation of a change; call from the runner's thread."""
        idle = self._newest is None
        self._number += 1
        self._newest = replace(change, number=self._number)
        self._open.append(self._newest)
        self._unanswered.append(self._newest)
        if idle:
            self._postponed_count = 0
            self._build(self._free_at - time.monotonic())

    @property
    def wanted(self) -> Parameters | None:
        """
        Return the parameters being built, with all changes accepted meanwhile; None while idle.
        """
        return None if self._newest is None else self._newest.after

    def amend(self, parameters: Parameters) -> None:
        """Apply a change of output rates to a pending build, which need not restart for it."""
        if self._newest is None:
            return
        before, self._newest = self._newest, replace(
            self._newest, after=parameters, scene=None)
        if self._open and self._open[-1] is before:
            self._open[-1] = self._newest

    def _build(self, delay: float = 0.0) -> None:
        """Build the latest request after a `delay` [s]."""
        now = self._open[-1]

        def build() -> None:
            change = now
            simulation: Simulation | None = None
            outputs: Outputs | None = None
            if delay > 0.0:
                time.sleep(delay)
                change = self._open[-1]
            reason, began = '', time.thread_time()
            try:
                simulation = self._compiled(
                    change.scene or Scene.from_parameters(change.after))
                # Here, not in the thread of the run, because it is the longest part of a swap.
                outputs = Outputs(simulation.scene)
                outputs.weave(simulation.scene.parameters)
                self._load_kernels(simulation)
            except Exception as error:  # reported; the old fabric continues
                simulation, reason = None, str(error) or type(error).__name__
            share, longest = _PAUSE if self._has_time() else _BUSY_PAUSE
            self._free_at = time.monotonic() + min(
                share * (time.thread_time() - began), longest)
            self._post(lambda: self._finish(change, simulation, reason, outputs))

        threading.Thread(target=build, name='weave', daemon=True).start()

    @property
    def _compiles_here(self) -> bool:
        """True if this process has to compile all kernels."""
        return self._body_force is not None or self._ranks is not None

    @contextmanager
    def postponing(self) -> Iterator[None]:
        """Raise SwapPostponed instead of compiling in the run, unless that was tried before."""
        if self._compiles_here or self._postponed_count >= _MAX_SWAP_TRIES:
            yield
            return
        try:
            with no_compiling(loading=True):
                yield
        except (KernelsMissing, KernelsAwaited) as error:
            raise SwapPostponed from error

    def _compiled(self, scene: Scene) -> Simulation:
        """Compile a scene, new kernels in another process."""
        def make() -> Simulation:
            simulation = compile_scene(scene, body_force=self._body_force, ranks=self._ranks)
            simulation.warm_up()
            return simulation

        # Their functions are compiled in this process.
        with_expressions(scene, None)
        return self._with_kernels(make, scene)

    def _load_kernels(self, simulation: Simulation) -> None:
        """Load kernels without which the run would soon have to wait, or compile them."""
        is_retry = self._postponed_count > 0
        is_near = is_retry or self._has_touched()
        kernels = simulation.prepare_contacts(load=is_retry)
        if kernels is not None and is_near:
            with counted_as_compiling():
                kernels.wait()
        scene = simulation.scene
        if self._is_measured() and not self._compiles_here and scene.body_count <= MAX_BODY_COUNT:
            if is_near and simulation.packed.contact is not None:
                scene = scene.with_changes({'contact.mode': 'always'})
            self._with_kernels(lambda: measure_forces(scene), scene, is_measured=True)

    def _with_kernels(
        self, work: Callable[[], Result], scene: Scene, *, is_measured: bool = False
    ) -> Result:
        """
        Run `work`, whose missing kernels another process compiles for `scene`.

        Compilation in this process would prevent the run from loading kernels meanwhile.
        """
        for _ in range(0 if self._compiles_here else _MAX_TRIES):
            try:
                with no_compiling(loading=True):
                    return work()
            except KernelsMissing:
                _LOGGER.info(
                    'the old fabric continues until the kernels of the change are compiled')
                compile_elsewhere(scene, is_measured=is_measured)
        return work()

    def _finish(
        self, change: ParameterChange, simulation: Simulation | None, reason: str,
        outputs: Outputs | None
    ) -> None:
        if simulation is None:
            self._reason = reason
            self._open = [other for other in self._open if other.number != change.number]
        else:
            self._built = _Built(change, simulation, outputs)
            self._open = [other for other in self._open if other.number > change.number]
        if self._open and (self._built is None or rebuilds(
                self._built.change.after, self._open[-1].after)):
            # At once, so that a moving slider does not hide all of its changes.
            self._build()
            return
        newest, built, reason = self._newest, self._built, self._reason
        assert newest is not None
        self._newest, self._open, self._built, self._reason = None, [], None, ''
        is_whole = built is not None and not rebuilds(built.change.after, newest.after)
        if built is not None:
            self.outputs = built.outputs
            wanted = newest.after if is_whole else with_immediate_changes(
                built.change.after, newest.after)
            answered = self._answered(newest if is_whole else built.change)
            try:
                self._on_ready(wanted, built.simulation, '', answered)
            except SwapPostponed:
                # The simulation is in an intermediate state, so another one is built.
                self._newest, self._open, self._reason = newest, [built.change], reason
                self._unanswered[:0] = answered
                self._postponed_count += 1
                _LOGGER.info(
                    'the present state needs further kernels: the old fabric continues until they '
                    'are compiled')
                self._build()
                return
        if not is_whole:
            self._on_ready(newest.after, None, reason, self._answered(newest))

    def _answered(self, last: ParameterChange) -> list[ParameterChange]:
        """Remove and return the changes up to `last` that are not answered yet."""
        answered = [change for change in self._unanswered if change.number <= last.number]
        self._unanswered = [
            change for change in self._unanswered if change.number > last.number]
        return answered
