# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Kernel calls of a method, by a team of threads and in timed batches."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
import math
from time import perf_counter
from typing import Any

from icofabric_sim.kernels.integrators.splitting import NEVER
from icofabric_sim.kernels.lanczos import added_up
from icofabric_sim.kernels.records import Loads, Model, State, Team, Work
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.kernels.runtime.numba_private import is_compiling_disabled
from icofabric_sim.process.interrupts import exit_request
from icofabric_sim.simulation.contact.broad_phase import BroadPhase
from icofabric_sim.simulation.errors import ElsewhereError
from icofabric_sim.simulation.model.stability import Frequency, largest_frequency, with_anchors
from icofabric_sim.simulation.stepping.contact_scheduler import ContactScheduler
from icofabric_sim.simulation.stepping.embedded_control import EmbeddedControl
from icofabric_sim.simulation.stepping.executor import Executor
from icofabric_sim.simulation.stepping.portions import Portions
from icofabric_sim.simulation.stepping.threads import Threads
from icofabric_sim.simulation.stepping.trajectory import Trajectory
from icofabric_sim.terms.contacts.pair import contact_scratch
from icofabric_sim.terms.masses import units_of
import numpy as np

# Steps of a trial, at least, in one call where others take them.
_SHARED_TRIAL = 32
# A kernel that takes steps, and what it is called with for a model in a team.
Kernel = tuple[Any, Callable[[Model, Team], tuple[Any, ...]]]


class MethodCalls:
    """Steps of a given length, of a trajectory or of a trial state."""

    def __init__(self, trajectory: Trajectory, contact: ContactScheduler) -> None:
        """Call the method of the `trajectory`."""
        self._trajectory, self._contact, self._here = trajectory, contact, Threads(trajectory)
        model, method = trajectory.model, trajectory.method
        self.portions = Portions(
            len(model.blocks.slot) * LANES * method.stages
            * (1 if model.links is None else 7))

    def take(
        self, origin: float, index: int, step: float, count: int, since_check: int, interval: int
    ) -> tuple[int, int, int]:
        """
        Take up to `count` steps of `step` [s] from origin + index x step [s] on.

        Returns the status, the number of steps, and the steps since the last health check. Health
        checks follow after each `interval` steps.
        """
        trajectory = self._trajectory
        arguments = (
            origin, index, step, count, since_check, interval, self._contact.phase.watch,
            trajectory.ledger.numbers)
        with trajectory.or_lost():
            status, done, since_check = self.timed(partial(
                self._advance, trajectory.model, *trajectory.for_steps(), arguments))
        trajectory.evaluations.add(self._evaluations(int(done)))
        return status, done, since_check

    def take_trial(
        self, model: Model, loads: Loads, state: State, work: Work, start: float,
        step: float, count: int
    ) -> None:
        """Take `count` steps from `start` [s] on, on a trial `state`, without health checks."""
        trajectory, watch = self._trajectory, self._contact.phase.trial_watch
        for done, portion in self._trial_portions(count):
            arguments = start, done, step, portion, 0, NEVER, watch, trajectory.ledger.numbers
            try:
                trajectory.thread_team.run(partial(
                    self._advance, model, loads, state, trajectory.for_steps()[2], work,
                    arguments))
            except ElsewhereError as error:
                # The trajectory stays where it is, or its user takes it back there.
                trajectory.fail(
                    f'{error}; the last good state, of t = {trajectory.time:.9g} s, is kept')

    def begin_trial(self) -> None:
        """Start trial steps where the state of the trajectory is."""
        trajectory = self._trajectory
        loads, state, _, work = trajectory.for_steps()
        with trajectory.or_lost():
            trajectory.executor.begin_trial(
                trajectory.model, loads, state, work, self._contact.phase.watch)

    def compare_trials(self, start: float, step: float, count: int) -> tuple[float, float]:
        """
        Take `count` steps of `step` [s] from `start` [s] on, and twice as many of half of it.

        Returns the distance of both ends, as `Executor.trial_distance`.
        """
        trajectory, executor = self._trajectory, self._trajectory.executor
        with trajectory.or_lost():
            executor.branch_trial(trajectory.model)
            for which, length, total in (
                    ('half', 0.5 * step, 2 * count), ('ahead', step, count)):
                for done, portion in self._trial_portions(total):
                    executor.take_trial(which, start, done, length, portion)
            return executor.trial_distance()

    def _trial_portions(self, count: int) -> Iterator[tuple[int, int]]:
        """
        Divide `count` trial steps into calls: yield the steps before each call, and its own.

        The block takes them. Ranks and devices receive and return the state of a trial.
        """
        evaluations, done = self._trajectory.evaluations, 0
        least = _SHARED_TRIAL if self._trajectory.executor.is_remote else 1
        while done < count:
            started = perf_counter()
            portion = min(count - done, max(self.portions.count, least))
            yield done, portion
            self.portions.note(portion, perf_counter() - started)
            with evaluations.estimating():
                evaluations.add(self._evaluations(portion))
            done += portion
            exit_request.check()

    # Queries about all bodies.

    @contextmanager
    def _asking(self) -> Iterator[Executor]:
        """Yield the executor that answers queries: this process where only it has all terms."""
        trajectory, executor = self._trajectory, self._trajectory.executor
        loads, state, _, work = trajectory.for_steps()
        with trajectory.or_lost():
            if executor.can_sum(trajectory.model, loads, work):
                executor.hold(trajectory.model, loads, state, work, self._contact.phase.watch)
                yield executor
            else:
                yield self._here

    def refresh(self) -> None:
        """Compute the accelerations of the state."""
        with self._asking() as executor:
            executor.refresh(self._trajectory.time)
            if executor.is_remote:
                self._trajectory.evaluations.add()

    def examine(self) -> None:
        """Write the figures of a health check to the ledger."""
        with self._asking() as executor:
            executor.fill_figures(self._trajectory.time, self._trajectory.ledger.numbers)

    def squares(self) -> float:
        """
        Return the sum of squared forces and torques over masses and inertias [N^2/kg].

        Forces of anchors are included, and the weight in free fall is not, because it does not
        return. Accelerations are those of `refresh`.
        """
        packed, model = self._trajectory.packed, self._trajectory.model
        fall, sums = np.zeros(3), self._sums(2)
        if model.gravity is not None and not packed.held:
            fall = model.gravity.acceleration
        with self._asking() as executor:
            executor.squares(fall, sums)
        mass, inertia = units_of(model.masses, model.inverse_mass, model.inverse_inertia)
        return float(mass * added_up(sums[0]) + inertia * added_up(sums[1]))

    def relative_speed(self) -> float:
        """Return the largest speed [m/s] of a body relative to the mean velocity."""
        sums = self._sums(3)
        with self._asking() as executor:
            executor.velocity_sums(sums)
            mean = np.array([added_up(row) for row in sums])
            return math.sqrt(executor.fastest_square(
                mean / self._trajectory.packed.layout.body_count))

    def frequency(self, *, locate: bool = False) -> Frequency:
        """
        Return the largest frequency of the fabric; `locate` adds the bodies of its vibration.
        """
        trajectory, found = self._trajectory, None
        if not locate:
            with self._asking() as executor:
                found = executor.largest_frequency()
        if found is not None:
            return found
        packed, state = trajectory.packed, trajectory.state
        return with_anchors(
            largest_frequency(packed, state, locate=locate), packed, trajectory.loads, state,
            trajectory.time)

    def _sums(self, rows: int) -> np.ndarray:
        """Return rows of zeros for sums over groups of blocks."""
        blocks, work = self._trajectory.model.blocks, self._trajectory.for_steps()[3]
        return np.zeros((rows, -(-len(blocks.slot) // work.group)))

    def _evaluations(self, steps: int) -> int:
        """Count the force evaluations of the last `steps` steps."""
        method, kinks = self._trajectory.method, self._trajectory.for_steps()[3].kinks
        more = method.count_evaluations()
        if kinks is not None:
            more, kinks.margin[2] = more + int(kinks.margin[2]), 0.0
        return more if method.implicit else more + steps * method.stages

    def count_embedded(self, control: EmbeddedControl) -> int:
        """Return the number of force evaluations of the last steps under an embedded `control`."""
        return control.take_evaluations() + self._trajectory.method.count_evaluations()

    def _advance(
        self, model: Model, loads: Loads, state: State, saved: State, work: Work,
        arguments: tuple[Any, ...], team: Team
    ) -> tuple[int, int, int]:
        trajectory = self._trajectory
        taken: tuple[int, int, int] = trajectory.method.advance(
            model, loads, state, saved, work, team, *arguments)
        return taken

    def timed(self, kernel: Callable[[Team], tuple[int, int, int]]) -> tuple[int, int, int]:
        """Take steps of the trajectory by `kernel`, and measure the time of a step."""
        started, team = perf_counter(), self._trajectory.thread_team
        status, done, since_check = self._contact.counted(lambda: team.run(kernel))
        self.portions.note(int(done), perf_counter() - started)
        return status, done, since_check

    def is_ready(self, kernel: Kernel | None = None, *, touching: bool = True) -> bool:
        """
        Return True if all kernels of steps are compiled, with contacts if `touching`.

        By the `kernel` that takes them, if that is not the method's own.
        """
        if is_compiling_disabled():
            return True
        function, arguments = kernel or self._own_kernel()
        if not hasattr(function, 'is_ready'):
            # Steps in Python, of implicit methods.
            return True
        trajectory, phase = self._trajectory, self._contact.phase
        model, team = trajectory.model, trajectory.thread_team.alone()
        kinds = [(model, team)]
        if touching and isinstance(phase, BroadPhase) and phase.contacts is None:
            if not phase.is_ready():
                return False
            kinds.append((
                model._replace(contacts=phase.nothing()),
                team._replace(scratch=contact_scratch())))
        return all(function.is_ready(*arguments(*kind)) for kind in kinds)

    def _own_kernel(self) -> Kernel:
        trajectory, watch = self._trajectory, self._contact.phase.watch
        return trajectory.method.advance, lambda model, team: (
            model, trajectory.loads, trajectory.state, trajectory.saved, trajectory.work,
            team, trajectory.origin, trajectory.index, trajectory.step, 1, 0, 1, watch,
            trajectory.ledger.numbers)
