# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Trial steps: the result of other steps of a trajectory, which remains unchanged."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import math
from typing import Any

from icofabric_sim.kernels.integrators.embedded import ANY
from icofabric_sim.kernels.integrators.splitting import NEVER
from icofabric_sim.kernels.records import Loads, Model, State, Team, Trail, Work
from icofabric_sim.process.interrupts import exit_request
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.contact.friction_state import carried, contact_losses
from icofabric_sim.simulation.model.layout import aligned_empty, copied_state, copy_state
from icofabric_sim.simulation.stepping.contact_scheduler import ContactScheduler
from icofabric_sim.simulation.stepping.embedded_control import EmbeddedControl
from icofabric_sim.simulation.stepping.ledger import Ledger
from icofabric_sim.simulation.stepping.method_calls import MethodCalls
from icofabric_sim.simulation.stepping.trajectory import Trajectory
from icofabric_sim.terms.meters import flowed
import numpy as np


class TrialSteps:
    """Trial steps of a trajectory, with copies of all data that steps change."""

    def __init__(
        self, trajectory: Trajectory, contact: ContactScheduler, calls: MethodCalls
    ) -> None:
        """Try steps of the `trajectory` by `calls` of its method."""
        self._trajectory, self._contact, self._calls = trajectory, contact, calls
        self._room: tuple[State, np.ndarray] | None = None
        self._earlier: State | None = None
        # What was stretched then, (p, 4), of pairs (p, 2): the list of pairs may change until now.
        self._earlier_stretch: tuple[np.ndarray, np.ndarray] | None = None
        # With what contacts remember where the last trial ended.
        self.model: Model = trajectory.model
        # [J] that flowed in the last trial.
        self.spent = self.given = 0.0
        # Whether shells touched in the last accuracy probe.
        self.touched = False

    def take(
        self, step: float, count: int, loads: Loads | None = None, *,
        start: float | None = None, model: Model | None = None
    ) -> State:
        """
        Return the state after `count` steps of length `step`, without changing the trajectory.

        `start` [s] and `model` are the initial time and constants if not the present ones.
        """
        trajectory = self._trajectory
        state, acceleration = self._make_room()
        copy_state(trajectory.state, state)
        np.copyto(acceleration, trajectory.work.acceleration)
        loads = loads or self.copy_loads()
        work = self._copy_work()._replace(acceleration=acceleration)
        self.model = model or self._copy_model()
        self._calls.take_trial(
            self.model, loads, state, work, trajectory.time if start is None else start, step,
            count)
        self.spent, self.given = flowed(work.spent), flowed(work.given)
        return state

    def take_embedded(
        self, step: float, count: int, start: float, source: State, trail: Trail
    ) -> State | None:
        """
        Return the state after `count` steps of the embedded pair of length `step` [s].

        The steps start from `source` at `start` [s], with arrays of slopes in `trail`. They use
        the kernel of the trajectory, so that no other kernel is compiled. The result is None on
        overflow.
        """
        trajectory = self._trajectory
        state, acceleration = self._make_room()
        copy_state(source, state)
        np.copyto(acceleration, trajectory.work.acceleration)
        control, present = EmbeddedControl(start), trajectory.control
        assert present is not None
        control.scales[:] = present.scales
        control.next = control.shortest = control.longest = control.close = step
        control.tolerance = control.goal = ANY
        ledger = trajectory.ledger.numbers.copy()
        Ledger.over(ledger).deepest_limit = math.inf
        loads = self.copy_loads()
        loads = loads._replace(
            power=np.zeros_like(loads.power), earlier_work=np.zeros_like(loads.earlier_work))
        work = self._copy_work()._replace(acceleration=acceleration, trail=trail)
        if work.breakage is not None:
            # Where connectors begin a step is noted there.
            work = work._replace(breakage=work.breakage._replace(
                **{name: value.copy() for name, value in work.breakage._asdict().items()}))
        model, watch = self._copy_model(), self._contact.phase.trial_watch

        def advance(team: Team) -> tuple[int, int, int]:
            assert trajectory.method.embedded is not None
            return trajectory.method.embedded.take(
                model, loads, state, trajectory.saved, work, team, control.numbers, count, 0,
                NEVER, watch, ledger)

        # Where a connector may have broken the kernel returns early.
        while count > 0:
            _, done, _ = trajectory.thread_team.run(advance)
            with trajectory.evaluations.estimating():
                trajectory.evaluations.add(self._calls.count_embedded(control))
            exit_request.check()
            if not done:
                return None
            count -= int(done)
        return state

    def _make_room(self) -> tuple[State, np.ndarray]:
        if self._room is None:
            self._room = (
                self._trajectory.packed.layout.like(self._trajectory.state),
                aligned_empty(self._trajectory.work.acceleration.shape))
        return self._room

    def errors_ahead(
        self, step: float, counts: Sequence[int], distance: Callable[[State, State], float],
        joined: Callable[[float, float], float]
    ) -> list[float]:
        """
        Return errors of windows of `counts` steps by `distance`; the state must be saved.

        Fewer where a body force fails. `joined`: the same of the largest squares of distances
        [m^2] and of differences of quaternions, which is all that is known where states are
        elsewhere.
        """
        found: list[float] = []
        trajectory = self._trajectory
        if not trajectory.executor.tries_steps or trajectory.model.contacts is not None:
            done = self.compare_ahead(
                step, counts, lambda one, other: found.append(distance(one, other)))
            return found[:done]
        time, self.touched = trajectory.time, False
        self._calls.begin_trial()
        for count in counts:
            found.append(joined(*self._calls.compare_trials(time, step, count)))
            time += count * step
        with trajectory.evaluations.estimating():
            # As one process does where it takes the state back, so that counts are the same.
            trajectory.evaluations.add()
        return found

    def compare_ahead(
        self, step: float, counts: Sequence[int], compare: Callable[[State, State], None]
    ) -> int:
        """
        Take windows of `counts` steps, and restore the state, which must be saved.

        After each `compare` gets where they lead, and where twice as many of half the length do
        from the beginning of the window. Returns the number of windows: fewer where a body force
        fails in what lies ahead. Whether the run itself ever comes there is not known, so that
        is no failure of the run.
        """
        trajectory = self._trajectory
        model, time = self._copy_model(), trajectory.time
        with self._restoring(trajectory.saved):
            self._contact.phase.has_touched()
            try:
                for done, count in enumerate(counts):
                    half = self.take(
                        0.5 * step, 2 * count, start=time, model=self._copy_model(model))
                    self.model = model
                    self._calls.take_trial(
                        model, self.copy_loads(), trajectory.state, self._copy_work(), time, step,
                        count)
                    if trajectory.take_force_failure() is not None:
                        return done
                    compare(trajectory.state, half)
                    time += count * step
            finally:
                self.touched = self._contact.phase.has_touched()
        return len(counts)

    @contextmanager
    def _restoring(self, state: State) -> Iterator[None]:
        """Return to a `state` and to the present accelerations after the block."""
        trajectory = self._trajectory
        # Friction knows more of them than the state does: the run goes on as if nothing was tried.
        acceleration = trajectory.work.acceleration.copy()
        try:
            yield
        finally:
            copy_state(state, trajectory.state)
            np.copyto(trajectory.work.acceleration, acceleration)
            with trajectory.evaluations.estimating():
                trajectory.refresh_places()

    def retrace(
        self, count: int, rest: float, visit: Callable[[State, State, float, float], None]
    ) -> None:
        """
        Repeat `count` steps from the saved state, followed by one of `rest` [s], and return.

        `visit` gets the states before and after each step, and their times [s].
        """
        trajectory = self._trajectory
        layout, time = trajectory.packed.layout, trajectory.saved_time
        model = self._copy_model()
        losses = contact_losses(model.contacts)
        if losses is not None:
            np.copyto(losses.stretch, losses.saved)
        before, after = (layout.like(trajectory.state) for _ in range(2))
        copy_state(trajectory.saved, after)
        with self._restoring(copied_state(trajectory.state)):
            for step in [trajectory.step] * count + [rest] * (rest > 0.0):
                for target in (trajectory.state, before):
                    copy_state(after, target)
                self._refresh(time, model)
                state = self.take(step, 1, start=time, model=model)
                if trajectory.take_force_failure() is not None:
                    return
                copy_state(state, after)
                visit(before, after, time, time + step)
                time += step

    def _refresh(self, time: float, model: Model, step: float | None = None) -> None:
        with self._trajectory.evaluations.estimating():
            self._trajectory.refresh(time, model, step)

    def keep_earlier(self) -> None:
        """Store the saved state for `compare_behind`, before the next health check replaces it."""
        trajectory = self._trajectory
        losses, contacts = trajectory.losses, trajectory.model.contacts
        if self._earlier is None:
            self._earlier = trajectory.packed.layout.like(trajectory.state)
        copy_state(trajectory.saved, self._earlier)
        self._earlier_stretch = None
        if losses is not None and contacts is not None and len(losses.saved):
            self._earlier_stretch = losses.saved.copy(), contacts.pairs.copy()

    def compare_behind(
        self, start: float, count: int, windows: int, compare: Callable[[State, State], float]
    ) -> float | None:
        """
        Repeat the last `count` steps with twice as many of half the length.

        From the state of `start` [s], which `keep_earlier` has kept, in `windows`, each from
        where the steps themselves led. Returns the sum of what `compare` finds for their ends;
        None where a body force fails.
        """
        assert self._earlier is not None
        trajectory, step = self._trajectory, self._trajectory.step
        now, model = copied_state(trajectory.state), self._copy_model()
        losses = contact_losses(model.contacts)
        if losses is not None and model.contacts is not None and len(losses.stretch):
            losses.stretch[:] = 0.0 if self._earlier_stretch is None else carried(
                *self._earlier_stretch, model.contacts.pairs)
        ends = np.linspace(0.0, count, windows + 1).round().astype(int).tolist()
        kept = trajectory.packed.layout.like(trajectory.state)
        found, failed = 0.0, False
        with self._restoring(now):
            copy_state(self._earlier, trajectory.state)
            for first, last in zip(ends[:-1], ends[1:]):
                time, beside = start + first * step, self._copy_model(model)
                self._refresh(time, beside, 0.5 * step)
                half = self.take(0.5 * step, 2 * (last - first), start=time, model=beside)
                copy_state(half, kept)
                reached = now
                if last < count:
                    self._refresh(time, model)
                    reached = self.take(step, last - first, start=time, model=model)
                failed = failed or trajectory.take_force_failure() is not None
                copy_state(reached, trajectory.state)
                if failed:
                    break
                found += compare(trajectory.state, kept)
        return None if failed else found

    def earlier_tree(self) -> dict[str, Any]:
        """Return the state of `keep_earlier`, by body."""
        assert self._earlier is not None
        return self._trajectory.by_body(self._earlier)

    def load_earlier(self, tree: StateTree) -> None:
        """Restore the state of `keep_earlier` without contacts."""
        if self._earlier is None:
            self._earlier = self._trajectory.packed.layout.like(self._trajectory.state)
        self._trajectory.take_back(self._earlier, tree)
        self._earlier_stretch = None

    def copy_loads(self) -> Loads:
        """Return the same loads with separate work."""
        loads = self._trajectory.loads
        return loads._replace(work=np.zeros_like(loads.work)) if len(loads.wrench) else loads

    def _copy_model(self, model: Model | None = None) -> Model:
        """Return the same constants with a copy of friction springs."""
        model = model or self._trajectory.model
        losses = contact_losses(model.contacts)
        if losses is None or model.contacts is None:
            return model
        copies: dict[str, Any] = {
            name: value.copy() for name, value in losses._asdict().items()
            if isinstance(value, np.ndarray)}
        return model._replace(
            contacts=model.contacts._replace(losses=losses._replace(**copies)))

    def _copy_work(self) -> Work:
        """Return the same arrays with new meters."""
        work, layout = self._trajectory.work, self._trajectory.packed.layout
        if work.spent is None and work.given is None:
            return work
        spent, given = (
            None if meter is None else layout.meter() for meter in (work.spent, work.given))
        return work._replace(spent=spent, given=given)
