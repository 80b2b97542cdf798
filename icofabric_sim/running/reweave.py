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

from collections.abc import Callable
from dataclasses import replace
import threading
import time
from typing import NamedTuple, TYPE_CHECKING

from icofabric_sim.kernels.runtime.kernel_guard import no_compiling
from icofabric_sim.messages.topics import Outputs
from icofabric_sim.parameters.changes import rebuilds, with_immediate_changes
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.process.compile_notice import KernelsMissing
from icofabric_sim.running.parameter_change import ParameterChange
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.inputs.input_types import has_target, PullTarget
from icofabric_sim.simulation.model.body_force import BodyForce
from icofabric_sim.simulation.precompile import compile_elsewhere
from icofabric_sim.simulation.simulation import compile_scene, Simulation

if TYPE_CHECKING:
    from icofabric_sim.simulation.devices.ranks import Ranks

# Pause after a build: a multiple of its duration, and the longest pause [s]. A slider that sends
# fifty changes a second must not take the processor from the run. The second pair is for a run
# without spare time, which each change slows down.
_PAUSE, _BUSY_PAUSE = (25.0, 0.3), (80.0, 0.8)
# Attempts to build with kernels compiled in another process, before this process compiles.
_MAX_TRIES = 3


def lost_wrenches(before: Simulation, scene: Scene) -> list[str]:
    """Return the names of the wrenches in `before` that have no channel or body in `scene`."""
    pulls = [PullTarget(body) for body in before.inputs.pulled_bodies]
    return [
        str(target) for target in (*before.inputs.acting(), *pulls)
        if not has_target(scene, target)]


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
        is_touching: Callable[[], bool] = lambda: False,
        has_time: Callable[[], bool] = lambda: True,
    ) -> None:
        """
        Pass results to `on_ready`, which `post` runs in the runner's thread.

        Its arguments are the requested parameters, whose output rates may be newer than those of
        the built scene; the simulation, or None and the reason; and the changes that are answered.
        A rejection may follow a successful build. `body_force` is kept, and `ranks` share the
        steps of the new fabric. If shells of the running fabric are in contact (`is_touching`),
        the swap waits for the kernels for contacts. `has_time`: the run has spare time.
        """
        self._post, self._has_time = post, has_time
        self._on_ready = on_ready
        self._body_force, self._ranks, self._is_touching = body_force, ranks, is_touching
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
                kernels = simulation.prepare_contacts(load=False)
                if kernels is not None and self._is_touching():
                    kernels.wait()
            except Exception as error:  # reported; the old fabric continues
                simulation, reason = None, str(error) or type(error).__name__
            share, longest = _PAUSE if self._has_time() else _BUSY_PAUSE
            self._free_at = time.monotonic() + min(
                share * (time.thread_time() - began), longest)
            self._post(lambda: self._finish(change, simulation, reason, outputs))

        threading.Thread(target=build, name='weave', daemon=True).start()

    def _compiled(self, scene: Scene) -> Simulation:
        """
        Compile a scene, new kernels in another process.

        Compilation in this process would prevent the run from loading kernels meanwhile.
        """
        def make() -> Simulation:
            simulation = compile_scene(scene, body_force=self._body_force, ranks=self._ranks)
            simulation.warm_up()
            return simulation

        if self._body_force is None and self._ranks is None:
            for _ in range(_MAX_TRIES):
                try:
                    with no_compiling(loading=True):
                        return make()
                except KernelsMissing:
                    compile_elsewhere(scene)
        return make()

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
            last = newest if is_whole else built.change
            self._on_ready(wanted, built.simulation, '', self._answered(last))
        if not is_whole:
            self._on_ready(newest.after, None, reason, self._answered(newest))

    def _answered(self, last: ParameterChange) -> list[ParameterChange]:
        """Remove and return the changes up to `last` that are not answered yet."""
        answered = [change for change in self._unanswered if change.number <= last.number]
        self._unanswered = [
            change for change in self._unanswered if change.number > last.number]
        return answered
