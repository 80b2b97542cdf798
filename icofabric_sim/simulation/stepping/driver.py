# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The driver of a trajectory: the loop over steps, and the components that it holds.

pieces.py has the interfaces of the components.
"""

from collections.abc import Callable
from functools import partial
import logging
import math
from typing import Any, TypeVar

from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.records import Loads, State
from icofabric_sim.kernels.runtime.kernel_guard import is_compiler_free, no_compiling
from icofabric_sim.process.compile_notice import KernelsMissing
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.errors import KernelsAwaited, SimulationError
from icofabric_sim.simulation.model.stability import Frequency
from icofabric_sim.simulation.stepping.accuracy_probe import AccuracyProbe
from icofabric_sim.simulation.stepping.contact_scheduler import ContactScheduler
from icofabric_sim.simulation.stepping.controllers import make_controller
from icofabric_sim.simulation.stepping.embedded_control import EmbeddedControl
from icofabric_sim.simulation.stepping.embedded_stepping import EmbeddedStepping
from icofabric_sim.simulation.stepping.events import why_events
from icofabric_sim.simulation.stepping.method_calls import MethodCalls
from icofabric_sim.simulation.stepping.methods import Method
from icofabric_sim.simulation.stepping.motion_rates import MotionRates
from icofabric_sim.simulation.stepping.pieces import StepChoice, StepController, Stepping
from icofabric_sim.simulation.stepping.shown_energies import ShownEnergies
from icofabric_sim.simulation.stepping.step_errors import StepErrors
from icofabric_sim.simulation.stepping.step_monitor import differences_of, StepMonitor
from icofabric_sim.simulation.stepping.table_watch import TableWatch
from icofabric_sim.simulation.stepping.touching_errors import TouchingErrors
from icofabric_sim.simulation.stepping.trajectory import RunSetup, Start, Trajectory
from icofabric_sim.simulation.stepping.trial_steps import TrialSteps
from icofabric_sim.simulation.stepping.uniform_stepping import UniformStepping
from icofabric_sim.terms.contacts.rebuild_check import MISSED, MOVED_FAR
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')
Result = TypeVar('Result')

# Error of velocities over a that steps may add, as a multiple of the tolerance.
_SPEED_ERROR_RATIO = 100.0
# Relative change of the largest frequency at which the accuracy is measured again.
_FREQUENCY_CHANGE_RATIO = 0.1
# Largest ratio of added errors to their estimate (docs/decisions/accuracy.md).
_MAX_ERROR_RATIO = 3.0


class Driver:
    """Loop over the steps of a trajectory; queries for states never change the steps."""

    def __init__(
        self, setup: RunSetup, method: Method, start: Start, *, leaves_contacts: bool,
        takes_steps: bool = True
    ) -> None:
        """
        Start a run, or continue it by another method.

        `leaves_contacts`: another driver continues once shells are near each other.
        `takes_steps` is False for a driver that only reports if its kernels are compiled.

        Raises ValueError if `solver.step` is too long or far too short.
        """
        parameters, packed, broad_phase = setup.scene.parameters, setup.packed, setup.broad_phase
        tolerance, fixed_step = parameters['solver.tolerance'], parameters['solver.step']
        estimates_errors = parameters['solver.error_estimate']
        is_given, self._on_pause = fixed_step > 0.0, setup.on_pause
        is_adaptive = method.adaptive and not is_given
        # The kernel accepts or rejects steps, also given ones if it has to locate events.
        is_embedded = is_adaptive or (method.adaptive and bool(why_events(setup.scene)))
        differences = differences_of(
            method, packed.model.links, given=is_given, estimated=estimates_errors)
        self.trajectory = Trajectory(
            setup, method, start, differences=differences,
            control=EmbeddedControl(start.time) if is_embedded else None)
        self.contact = ContactScheduler(self.trajectory, broad_phase)
        self.calls = MethodCalls(self.trajectory, self.contact)
        self.rates = MotionRates(
            self.trajectory, self.contact, self.calls, start, setup.inputs.pulse_step)
        self.trials = TrialSteps(self.trajectory, self.contact, self.calls)
        self.shown = ShownEnergies(self.trajectory, self.contact)
        probe = AccuracyProbe(
            self.trajectory, self.trials, self.rates, tolerance, differences=differences)
        # Wrapped connectors change to another geodesic at any time, and slack ones tighten.
        any_time = packed.model.wrapping is not None or (is_given and packed.goes_slack)
        has_jumps = any_time or broad_phase.is_possible
        # Errors in contacts limit the chosen steps of methods that run through them.
        follows = broad_phase.is_possible and method.runs_through_contacts and not is_given
        is_needed = has_jumps and not is_adaptive and (estimates_errors or follows)
        self.errors = StepErrors(
            probe, None if not is_needed else TouchingErrors(
                self.trajectory, self.contact, self.rates, self.trials, probe.distance,
                probe.slip, any_time=any_time), is_estimated=estimates_errors)
        self.monitor = StepMonitor(
            self.trajectory, self.rates, self.calls, setup.obstruction, tolerance=tolerance,
            differences=differences)
        self.controller: StepController = make_controller(self, StepChoice(
            method, fixed_step, is_embedded, 1.0 / parameters['publish_rate']))
        self.stepping: Stepping = (
            EmbeddedStepping(self, fixed_step) if is_embedded else UniformStepping(self))
        # Error of velocities over a [1/s] that adaptive steps may add.
        self._allowed_speed = _SPEED_ERROR_RATIO * tolerance if is_adaptive else 0.0
        # Roll back a step whose kernel is not compiled, and raise KernelsAwaited.
        self.awaits_kernels = False
        self._leaves_contacts, self._tables = leaves_contacts, TableWatch(packed)
        if takes_steps:
            self._start(exact=False)
            self.rates.require_stable(start.time)

    @property
    def time(self) -> float:
        """Time [s] of the trajectory, from which the next step, or that in progress, begins."""
        return self.trajectory.time

    @property
    def is_near_contact(self) -> bool:
        """True if shells are near each other, so that another driver has to continue."""
        return self._leaves_contacts and self.contact.phase.contacts is not None

    def advance(self, time: float) -> None:
        """
        Take steps up to `time` [s], or until `is_near_contact`.

        States up to there are available afterwards.
        """
        self.trajectory.require_sound()
        evaluations = self.trajectory.evaluations
        while True:
            while not self.is_near_contact and (count := self.stepping.count_until(time)) > 0:
                # Shells that overlap at the start are reported when the motion begins.
                self.contact.phase.announce()
                self._or_back(partial(self.stepping.run, time, self._until_check(count)))
                self._watch_tables()
                self._on_pause()
            with evaluations.showing():
                is_sound = self.is_near_contact or self.stepping.check_within(time)
            if is_sound:
                tables = self._tables
                if tables.is_watching and self.trajectory.control is not None and (
                        not tables.found and tables.is_suspect()):
                    # The run may end within this step.
                    with evaluations.showing():
                        state = self.stepping.state_at(time)
                    self._report_beyond_table(state, time, may_stop=False)
                return
            self._or_back(self.stepping.go_back)

    def advance_steps(self, count: int, *, until: float = math.inf) -> int:
        """
        Take up to `count` whole steps that end by `until` [s], and return their number.

        It may be less than `count`; it is 0 if the next step would end later.
        """
        self.trajectory.require_sound()
        done = self._or_back(partial(self.stepping.run_steps, self._until_check(count), until))
        self._watch_tables()
        return done

    def _until_check(self, count: int) -> int:
        """Return `count`, or the number of steps up to the next check of tables."""
        if not self._tables.is_watching:
            return count
        if self.trajectory.control is not None:
            return min(count, 1)
        return min(count, max(self.monitor.interval - self.monitor.since_check, 1))

    def _watch_tables(self) -> None:
        """
        Warn, or stop the run, if a connector is beyond its table at a health check.

        Adaptive steps are checked at their beginning, as their end may never be reached.
        """
        tables, trajectory = self._tables, self.trajectory
        if not tables.is_watching:
            return
        if trajectory.executor.is_remote:
            # Each rank sees the lengths of its own connectors only. A run that stops does so at
            # the step at which one process stops.
            is_due = self.monitor.since_check == 0 or (
                trajectory.control is not None and tables.may_stop)
        elif trajectory.control is not None:
            is_due = tables.was_suspect()
        else:
            is_due = self.monitor.since_check == 0 and tables.was_suspect()
        if is_due:
            state, trail = trajectory.state, trajectory.work.trail
            if trajectory.control is not None and trajectory.control.length > 0.0 and (
                    trail is not None):
                state = trail.start
            self._report_beyond_table(state, self.time)

    def _report_beyond_table(self, state: State, time: float, *, may_stop: bool = True) -> None:
        tables, trajectory = self._tables, self.trajectory
        text, stops = tables.describe(time, state, trajectory.broken.since)
        if stops and may_stop:
            if trajectory.saved_time > time:
                # The step in progress may end after the requested time.
                self.stepping.cut(time)
            trajectory.return_to_saved()
            trajectory.fail(
                f'{text}, and connector.law_beyond is stop; extrapolate continues it straight. '
                f'The state of t = {trajectory.saved_time:.9g} s is kept')
        if text and not tables.found and not stops:
            tables.found = text
            _LOGGER.warning(
                '%s: the law continues straight there (connector.law_beyond)', text)

    def cut(self, time: float) -> bool:
        """
        Advance to `time` and end the step in progress there; the next step starts there.

        Return False if `is_near_contact` stopped the advance before.
        """
        while True:
            self.advance(time)
            if self.is_near_contact:
                return False
            if self._or_back(partial(self.stepping.cut, time)):
                return True

    def state_at(self, time: float) -> State:
        """
        Return the state at `time` [s]; after a failure the last good one.

        The state is valid until the next call of any method.
        """
        if self.trajectory.failure is None:
            self.advance(time)
        with self.trajectory.evaluations.showing():
            return self.stepping.state_at(time)

    def jump(self, time: float, state: State, loads: Loads, load_rate: float) -> None:
        """Restart from another `state` at `time` [s]; a failure before is cleared."""
        trajectory = self.trajectory
        trajectory.failure = None
        self.errors.jump(time)
        trajectory.begin_at(time)
        trajectory.state, trajectory.loads = state, loads
        self.rates.load_rate = load_rate
        self.monitor.since_check = 0
        if not self.trajectory.is_given:
            # The step must not depend on the motion before.
            trajectory.step = 0.0
        self._start()
        self.rates.require_stable(time)

    def adopt(self, other: 'Driver') -> None:
        """Use the errors of the steps of `other`, whose motion this driver continues."""
        self.stepping.adopt(other.stepping)

    def continue_from(self, before: 'Driver') -> None:
        """Continue the energy balance and counts of `before`, in whose state this one began."""
        before.trajectory.ledger.keep_work(before.trajectory.loads)
        self.trajectory.ledger.continue_from(before.trajectory.ledger)
        self.trajectory.step_count = before.trajectory.step_count
        self.trajectory.evaluations.continue_from(before.trajectory.evaluations)
        # Each overlap is reported once.
        self.trajectory.ledger.reported_limit = before.trajectory.ledger.reported_limit
        self.stepping.settle(before.stepping.error_estimate(before.time))
        self.awaits_kernels = before.awaits_kernels
        self._tables.found = before._tables.found

    def set_loads(self, loads: Loads, load_rate: float) -> None:
        """Replace the loads at the current state."""
        trajectory = self.trajectory
        trajectory.ledger.keep_work(trajectory.loads)
        trajectory.loads, self.rates.load_rate = loads, load_rate
        trajectory.place_driven()
        self._allow_rounding()
        self.stepping.follow_loads()

    def _allow_rounding(self) -> None:
        """Allow for rounding of what loads move between two health checks."""
        trajectory = self.trajectory
        # The work of the loads is not read, so it stays with ranks or the GPU.
        loads, *_ = trajectory.for_steps()
        trajectory.ledger.allow_rounding(
            loads, trajectory.model, self.monitor.interval * trajectory.step)

    def set_last_forces(self, forces: np.ndarray) -> None:
        """
        Replace the forces (p, 3) [N] of the last p wrenches, where a step begins; steps stay.
        """
        trajectory = self.trajectory
        trajectory.loads.force[len(trajectory.loads.force) - len(forces):] = forces
        # Differences of the motion across a jump of the forces do not measure the step.
        trajectory.ledger.regular = 0.0
        self.errors.spoil()

    def whole_steps(self, duration: float) -> float:
        """
        Return the length [s] of the whole steps within a `duration` [s], at least one step.

        Return `duration` if a step is longer than twice of it, or if steps differ in length.
        """
        step = self.trajectory.step
        if self.trajectory.control is not None or not 0.0 < step <= 2.0 * duration:
            return duration
        return max(math.floor(duration / step), 1) * step

    def forget(self) -> None:
        """Count steps and errors from zero, as at the start of a run."""
        self.trajectory.step_count = 0
        self.trajectory.evaluations.forget()
        self.errors.forget()
        self.monitor.obstruction.found = self._tables.found = ''
        self.contact.forget()
        self.stepping.forget()

    def rebase(self, time: float) -> None:
        """Move a driver that has not moved yet to another start `time`."""
        self.trajectory.begin_at(time)
        self.trajectory.note_saved(time)
        self.errors.rebase(time)
        self.contact.phase.rebase(time)
        self.stepping.rebase(time)

    def warm_up(self) -> None:
        """Compile or load every kernel of a step without advancing the trajectory."""
        before, loads = self.state_tree(), self.trajectory.loads
        try:
            self.state_at(self.time + 0.5 * self.trajectory.step)
        except SimulationError:
            if self.trajectory.packed.body_force is not None:
                raise
            # The run reports the failure when it takes this step.
            self.trajectory.failure = None
        finally:
            self._roll_back(before, loads)

    def is_ready(self) -> bool:
        """Return True if the kernels of all steps of this driver are compiled."""
        return self.stepping.is_ready(touching=not self._leaves_contacts)

    def await_no_kernels(self) -> None:
        """Compile missing kernels in this thread from now on."""
        self.awaits_kernels = False

    def _or_back(self, work: Callable[[], Result]) -> Result:
        """
        Run `work`, which takes steps; roll back if they need kernels that are not compiled.

        Raises KernelsAwaited then. A second try loads kernels from disk, unless another thread
        compiles. Any other exception, except a failed run, restores the state before.
        """
        def is_touching() -> bool:
            return self.contact.phase.contacts is not None

        if not self.awaits_kernels:
            return work()
        before, loads = self.state_tree(), self.trajectory.loads
        was_touching, needs_contacts = is_touching(), False
        for may_load in (lambda: False, lambda: was_touching or not is_touching()):
            try:
                with no_compiling(loading=may_load):
                    result = work()
                if was_touching or not is_touching():
                    return result
                # The next step would need them, and a state that is shown before it.
                needs_contacts = True
            except KernelsMissing:
                needs_contacts = is_touching() and not was_touching
            except SimulationError:
                raise  # with the last good state
            except BaseException:
                self._roll_back(before, loads)
                raise
            self._roll_back(before, loads)
            if needs_contacts or not is_compiler_free():
                break
        raise KernelsAwaited(needs_contacts)

    def _roll_back(self, before: dict[str, Any], loads: Loads) -> None:
        """Restore the state `before`, but keep the counts of evaluations."""
        evaluations = self.trajectory.evaluations
        # Restoring evaluates the forces once.
        total = evaluations.total + 1
        self.load_state(StateTree(before), loads)
        evaluations.restore_total(total)

    def state_tree(self) -> dict[str, Any]:
        """Return everything that later steps depend on, by body."""
        tree = {
            **self.trajectory.state_tree(),
            **self.contact.state_tree(),
            **self.shown.state_tree(),
            **self.monitor.state_tree(),
            **self.errors.state_tree(),
            'held_back': self.controller.held_back,
            'load_rate': self.rates.load_rate,
            'frequency': self.rates.fabric.rate,
        }
        if self._tables.found:
            tree['beyond_table'] = self._tables.found
        self.stepping.state_tree(tree)
        return tree

    def load_state(self, tree: StateTree, loads: Loads) -> None:
        """Restore a state, with the `loads` of its time."""
        step = tree.number('step', 0.0)
        if self.trajectory.is_given and step != self.trajectory.step:
            raise ValueError(
                f'step must be solver.step {self.trajectory.step!r} s, got {step!r} s')
        self.stepping.load_time(tree)
        self.trajectory.load_state(tree, loads)
        self.contact.load_state(tree)
        self.trajectory.load_accelerations(tree)
        self.shown.load_state(tree)
        self.controller.held_back = tree.flag('held_back')
        self.rates.load_rate = tree.number('load_rate', 0.0, finite=False)
        self.rates.fabric = Frequency(tree.number('frequency', 0.0, finite=False), (), 0)
        self.errors.load_state(tree)
        self.monitor.load_state(tree)
        self._tables.found = tree.text('beyond_table') if 'beyond_table' in tree else ''
        self.stepping.load_state(tree)
        self.trajectory.evaluations.load_state(
            tree.part('evaluations') if 'evaluations' in tree else None)

    def choose_step(self, *, probe: bool = False, shorter: float = 1.0) -> None:
        """
        Use the step that the controller proposes.

        `probe` measures the accuracy again; the state must have been saved. `shorter` is the
        estimated ratio of the error to the allowed one.
        """
        step = self.controller.propose(probe=probe, shorter=shorter)
        if step != self.trajectory.step:
            if self.monitor.since_check:
                self.errors.spoil()
            else:
                self.errors.close_stretch(self.trajectory.time)
            self.trajectory.set_step(step)
            self.trajectory.ledger.regular = 0.0
            self.monitor.follow_step()
        self._pace_contacts()

    def respond(self, status: int, time: float) -> None:
        """React to a `status` of the kernels at `time` [s]."""
        checks = self.monitor
        if status & monitor.NOT_FINITE:
            checks.fail_unfinite(time)
        if status & monitor.UNBALANCED:
            if not self._is_explained(time):
                self.contact.refuse_conflict(time)
                checks.fail_unbalanced(time)
            # Kernels do not save where the energy does not balance.
            self.trajectory.save(time)
        if status & monitor.OBSTRUCTING:
            checks.handle_obstruction(time)
        if status & (monitor.TOO_DEEP | monitor.DEEP):
            self.contact.handle_overlap(time, stop=bool(status & monitor.TOO_DEEP))
        if status & (MOVED_FAR | MISSED):
            self._search_again(time, missed=bool(status & MISSED))
            if status & MISSED and checks.since_check == 0:
                # Kernels do not save where a contact may be behind.
                self.trajectory.save(time)
        if status & (monitor.RATE_HIGH | monitor.RATE_LOW):
            before = self.rates.fabric.rate
            checks.examine()
            if not self.trajectory.is_given:
                step, limit = self.trajectory.step, self.rates.limit
                if not step <= limit:
                    _LOGGER.warning(
                        'the fabric changed so fast before t = %.6g s that up to %d steps were '
                        'longer than stable (limit %.3g s): their energy may be wrong; %s',
                        time, checks.interval, limit, checks.way_out(),
                    )
                # Only the bound may have grown.
                changed = abs(self.rates.fabric.rate - before) > _FREQUENCY_CHANGE_RATIO * before
                self.choose_step(probe=changed)
            self.rates.require_stable(time)

    def _is_explained(self, time: float) -> bool:
        """Return True if errors within the tolerance explain the energy error at `time` [s]."""
        if not self._allowed_speed > 0.0:
            return False
        errors = _MAX_ERROR_RATIO * self.stepping.error_estimate(time)
        return self.trajectory.ledger.allow(errors, self.rates.frequency.rate)

    def _search_again(self, time: float, *, missed: bool) -> None:
        """Find the candidate pairs after bodies have moved far, and adapt the step to them."""
        contact, trajectory = self.contact, self.trajectory
        if not contact.phase.is_possible:
            return
        if missed:
            contact.phase.miss(self.monitor.way_out())
        before = contact.phase.rate
        contact.search(time, *self.controller.outlook())
        changed = contact.phase.rate != before or self.controller.held_back or (
            not trajectory.step <= contact.phase.longest_step)
        if not self.trajectory.is_given and changed and self.controller.follow_contacts():
            self.choose_step()
        self._pace_contacts()
        if missed and self.trajectory.is_given and not trajectory.step <= self.rates.limit:
            trajectory.return_to_saved()
        self.rates.require_stable(time)

    def _pace_contacts(self) -> None:
        # Kernels search only if contacts do not limit the step.
        self.contact.pace(self.trajectory.step, alone=not self.controller.held_back)

    def _start(self, *, exact: bool = True) -> None:
        """Compute accelerations, frequency and step of a state that was set, not stepped to."""
        trajectory, ledger = self.trajectory, self.trajectory.ledger
        self.stepping.restart()
        trajectory.place_driven()
        self.contact.phase.forget_friction()
        self.contact.calm()
        if self.contact.phase.is_possible:
            self.contact.search(trajectory.time, *self.controller.outlook())
        self.calls.refresh()
        trajectory.clear_meters()
        ledger.restart()
        trajectory.save()
        self.monitor.restart(exact=exact)
        self.contact.require_room()
        ledger.open(
            self.shown.moving(), self.calls.squares(), self.rates.frequency.rate,
            self._allowed_speed)
        self.shown.restart()
        self.errors.probe.restart()
        # No interval of the error estimate contains the jump.
        self.errors.spoil()
        self.choose_step()
        self._allow_rounding()
        self.errors.restart_touching(trajectory.saved_time)
        self._watch_tables()
