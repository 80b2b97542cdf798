# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The package as a contestant: one for each method of METHODS, by the public interface."""

from collections.abc import Iterator
from typing import Any

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.errors import SimulationError
from icofabric_sim.simulation.simulation import compile_scene, Simulation
from icofabric_sim.simulation.stepping.methods import METHODS
from icofabric_validation.benchmarks.scenes import axes_from_quaternions, Motion, scene_parameters
from icofabric_validation.benchmarks.solver import Solver, StepSolver, ToleranceSolver, Unusable

TOOL = 'icofabric_sim'
Size = tuple[int, int, int]
Changes = dict[str, Any] | None


class _Own(Solver):
    """A simulation that is compiled again for every setting."""

    tool = TOOL

    def __init__(self, size: Size, method: str, changes: Changes) -> None:
        self._size, self._method, self._changes = size, method, changes
        self._simulation: Simulation | None = None

    def motion(self) -> Motion:
        now = self._running.snapshot()
        return Motion(now.position.copy(), axes_from_quaternions(now.orientation))

    def close(self) -> None:
        self._simulation = None

    def _compile(self, **solver: Any) -> None:
        try:
            self._simulation = _compile(self._size, self._changes, method=self._method, **solver)
        except ValueError as error:
            raise Unusable(str(error)) from error

    @property
    def _running(self) -> Simulation:
        assert self._simulation is not None
        return self._simulation


class OwnSteps(_Own, StepSolver):
    """A method with a fixed step."""

    def __init__(self, size: Size, method: str, changes: Changes, frequency: float) -> None:
        """Create a solver; `frequency` [rad/s] is the largest one of the fabric at the start."""
        super().__init__(size, method, changes)
        facts = METHODS[method]
        self.label, self.order, self.evaluations = method, facts.order, facts.stages
        self.longest = facts.stability / frequency

    def start(self, step: float) -> None:
        self._compile(step=step)

    def advance(self, count: int) -> None:
        try:
            self._running.advance_steps(count)
        except SimulationError as error:
            raise Unusable(str(error)) from error


class OwnTolerance(_Own, ToleranceSolver):
    """A method, or the automatic choice, with a tolerance."""

    def __init__(self, size: Size, method: str, changes: Changes) -> None:
        """Create a solver; `method` is a key of METHODS or 'auto'."""
        super().__init__(size, method, changes)
        self.label = f'{method}, tolerance'
        self.order = METHODS[method].order if method in METHODS else 0

    def start(self, tolerance: float, duration: float) -> None:
        self._duration = duration
        self._compile(tolerance=tolerance)

    def finish(self) -> None:
        try:
            self._running.advance_to(self._duration)
        except SimulationError as error:
            raise Unusable(str(error)) from error


def solvers(size: Size, changes: Changes = None) -> Iterator[Solver]:
    """Yield every method, by tolerance if its steps are adaptive or by step, and `auto`."""
    frequency = _compile(size, changes).status.largest_frequency
    for name, facts in METHODS.items():
        if not facts.adaptive:
            yield OwnSteps(size, name, changes, frequency)
        else:
            yield OwnTolerance(size, name, changes)
    yield OwnTolerance(size, 'auto', changes)


def _compile(size: Size, changes: Changes, **solver: Any) -> Simulation:
    alone = {**solver, 'threads': 1}
    simulation = compile_scene(Scene.from_parameters(scene_parameters(size, alone, changes)))
    simulation.warm_up()
    return simulation
