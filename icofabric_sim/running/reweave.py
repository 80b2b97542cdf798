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
Changes of a running scene: built aside in a thread of their own, swapped in between two steps.

What a change does to the run is a column of the table of parameters, see parameters/changes.py.
A rebuilt fabric goes on from the state of the old one, bit for bit, and at its time; where the
motion restarts it begins from the initial state at that time. Wrenches go on where the new scene
has their channel or their body (by number), also those whose hold time runs; the others end, by
name.
"""

from collections.abc import Callable
import threading
import time
from typing import NamedTuple, TYPE_CHECKING

from icofabric_sim.kernels.runtime.compile_notice import KernelsMissing
from icofabric_sim.kernels.runtime.kernel_guard import no_compiling
from icofabric_sim.messages.topics import Outputs
from icofabric_sim.parameters.changes import rebuilds, with_immediate_changes
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.input_types import has_target, PullTarget
from icofabric_sim.simulation.model.body_force import BodyForce
from icofabric_sim.simulation.precompile import compile_elsewhere
from icofabric_sim.simulation.simulation import compile_scene, Simulation

if TYPE_CHECKING:
    from icofabric_sim.simulation.devices.ranks import Ranks

# After a build there is none for so many times as long, at most so long [s]: a slider that sends
# fifty changes a second may not take the processor from the run. The second pair is for a run that
# has no time to wait, as each change costs it some.
_REST, _BUSY_REST = (25.0, 0.3), (80.0, 0.8)
# So often it is built of kernels from another process, before it is compiled in this one.
_TRIES = 3


def lost_wrenches(before: Simulation, scene: Scene) -> list[str]:
    """Names of the wrenches acting in `before` that `scene` has no channel or no body for."""
    pulls = [PullTarget(body) for body in before.inputs.pulls.bodies]
    return [
        str(target) for target in (*before.inputs.acting(), *pulls)
        if not has_target(scene, target)]


class _Wish(NamedTuple):
    """What is wanted, with all that was accepted before."""

    parameters: Parameters
    scene: Scene | None  # of these, where it is built already
    number: int


class _Built(NamedTuple):
    wish: _Wish
    simulation: Simulation
    outputs: Outputs | None  # its messages


class Reweaver:
    """
    Builds the wanted scene; what is wanted while a build is under way becomes one more build.

    Where that cannot be built, what was wanted before it can: a change that is refused takes no
    other with it.
    """

    def __init__(
        self,
        post: Callable[[Callable[[], None]], object],
        on_ready: Callable[[Parameters, Simulation | None, str, int], None],
        body_force: BodyForce | None = None,
        ranks: 'Ranks | None' = None,
        is_touching: Callable[[], bool] = lambda: False,
        has_time: Callable[[], bool] = lambda: True,
    ) -> None:
        """
        `post` brings a call into the runner's thread, where `on_ready` gets each result.

        The result is the simulation, or None and the reason, after the parameters wanted by then:
        their rates may be newer than those in the scene that was built. Then the number of the
        last wish that it answers, with all before; a refusal may follow what could be built. A
        `body_force` goes on, and `ranks` that share the steps share those of the new fabric.
        Where shells of the running fabric touch, which `is_touching` tells, those of the other one
        may from its first step on. `has_time`: the run waits for its pace now and then.
        """
        self._post, self._has_time = post, has_time
        self._on_ready = on_ready
        self._body_force, self._ranks, self._is_touching = body_force, ranks, is_touching
        self._number = 0
        # What is wanted by now; what was not built yet of the wishes up to there; what was built
        # last, and the reason why something newer was not.
        self._newest: _Wish | None = None
        self._open: list[_Wish] = []
        self._built: _Built | None = None
        self._reason = ''
        self.outputs: Outputs | None = None  # messages of what was built last
        self._free_at = 0.0  # time of the next build, where the last one was a moment ago

    def want(self, parameters: Parameters, scene: Scene | None = None) -> int:
        """
        Build the simulation of `parameters`, of their `scene` where there is one.

        From the runner's thread. Returns the number of the wish.
        """
        idle = self._newest is None
        self._number += 1
        self._newest = _Wish(parameters, scene, self._number)
        self._open.append(self._newest)
        if idle:
            self._build(self._free_at - time.monotonic())
        return self._number

    @property
    def wanted(self) -> Parameters | None:
        """What is being built, with all that was accepted meanwhile; None while nothing is."""
        return None if self._newest is None else self._newest.parameters

    def amend(self, parameters: Parameters) -> None:
        """Apply a change of rates to a build under way too, which need not be restarted for it."""
        if self._newest is None:
            return
        before, self._newest = self._newest, self._newest._replace(
            parameters=parameters, scene=None)
        if self._open and self._open[-1] is before:
            self._open[-1] = self._newest

    def _build(self, delay: float = 0.0) -> None:
        """Build the last of what is open after a `delay` [s]."""
        now = self._open[-1]

        def build() -> None:
            wish = now
            simulation: Simulation | None = None
            outputs: Outputs | None = None
            if delay > 0.0:
                time.sleep(delay)
                wish = self._open[-1]
            reason, began = '', time.thread_time()
            try:
                simulation = self._compiled(
                    wish.scene or Scene.from_parameters(wish.parameters))
                # Here, and not in the thread of the run: the longest part of a change of it.
                outputs = Outputs(simulation.scene)
                outputs.weave(simulation.scene.parameters)
                kernels = simulation.prepare_contacts(load=False)
                if kernels is not None and self._is_touching():
                    kernels.wait()
            except Exception as error:  # noqa: BLE001 - reported, the old fabric runs on
                simulation, reason = None, str(error) or type(error).__name__
            share, longest = _REST if self._has_time() else _BUSY_REST
            self._free_at = time.monotonic() + min(
                share * (time.thread_time() - began), longest)
            self._post(lambda: self._finish(wish, simulation, reason, outputs))

        threading.Thread(target=build, name='weave', daemon=True).start()

    def _compiled(self, scene: Scene) -> Simulation:
        """
        Compile a scene; new kernels in another process.

        In this one the run could load no kernel for as long as that takes.
        """
        def make() -> Simulation:
            simulation = compile_scene(scene, body_force=self._body_force, ranks=self._ranks)
            simulation.warm_up()
            return simulation

        if self._body_force is None and self._ranks is None:
            for _ in range(_TRIES):
                try:
                    with no_compiling(loading=True):
                        return make()
                except KernelsMissing:
                    compile_elsewhere(scene)
        return make()

    def _finish(
        self, wish: _Wish, simulation: Simulation | None, reason: str, outputs: Outputs | None
    ) -> None:
        if simulation is None:
            self._reason = reason
            self._open = [other for other in self._open if other.number != wish.number]
        else:
            self._built = _Built(wish, simulation, outputs)
            self._open = [other for other in self._open if other.number > wish.number]
        if self._open and (self._built is None or rebuilds(
                self._built.wish.parameters, self._open[-1].parameters)):
            # At once: a slider that moves on must not keep all of its changes from being seen.
            self._build()
            return
        newest, built, reason = self._newest, self._built, self._reason
        assert newest is not None
        self._newest, self._open, self._built, self._reason = None, [], None, ''
        is_whole = built is not None and not rebuilds(built.wish.parameters, newest.parameters)
        if built is not None:
            self.outputs = built.outputs
            wanted = newest.parameters if is_whole else with_immediate_changes(
                built.wish.parameters, newest.parameters)
            self._on_ready(
                wanted, built.simulation, '', newest.number if is_whole else built.wish.number)
        if not is_whole:
            self._on_ready(newest.parameters, None, reason, newest.number)
