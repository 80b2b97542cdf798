# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The driver of a trajectory: the loop over steps, and what holds its pieces together.

Which pieces there are, and what they are to each other: pieces.py.
"""

from collections.abc import Callable
from functools import partial
import logging
import math
from typing import Any, TypeVar

from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.contact.rebuild_check import MISSED, MOVED_FAR
from icofabric_sim.kernels.records import Loads, State
from icofabric_sim.kernels.runtime.kernel_guard import is_compiler_free, no_compiling
from icofabric_sim.process.compile_notice import KernelsMissing
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.contact.broad_phase import BroadPhase
from icofabric_sim.simulation.errors import KernelsAwaited, SimulationError
from icofabric_sim.simulation.inputs.anchor_breaks import AnchorBreaks
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.model.stability import Frequency
from icofabric_sim.simulation.stepping.accuracy_probe import AccuracyProbe
from icofabric_sim.simulation.stepping.contact_scheduler import ContactScheduler
from icofabric_sim.simulation.stepping.controllers import make_controller
from icofabric_sim.simulation.stepping.embedded_control import EmbeddedControl
from icofabric_sim.simulation.stepping.embedded_stepping import EmbeddedStepping
from icofabric_sim.simulation.stepping.method_calls import MethodCalls
from icofabric_sim.simulation.stepping.methods import Method
from icofabric_sim.simulation.stepping.motion_rates import MotionRates
from icofabric_sim.simulation.stepping.obstruction import Obstruction
from icofabric_sim.simulation.stepping.pieces import StepChoice, StepController, Stepping
from icofabric_sim.simulation.stepping.shown_energies import ShownEnergies
from icofabric_sim.simulation.stepping.step_errors import StepErrors
from icofabric_sim.simulation.stepping.step_monitor import differences_of, StepMonitor
from icofabric_sim.simulation.stepping.table_watch import TableWatch
from icofabric_sim.simulation.stepping.thread_team import ThreadTeam
from icofabric_sim.simulation.stepping.touching_errors import TouchingErrors
from icofabric_sim.simulation.stepping.trajectory import Trajectory
from icofabric_sim.simulation.stepping.trial_steps import TrialSteps
from icofabric_sim.simulation.stepping.uniform_stepping import UniformStepping
from icofabric_sim.simulation.stepping.whole_state import WholeState
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')
Result = TypeVar('Result')

# Velocities over a that a chosen step may be wrong by, beside the tolerance for a second.
_BESIDE_TOLERANCE = 100.0
# A change of the largest frequency, in parts of it, with which the accuracy is measured anew.
_CHANGED = 0.1
# Errors that were added are at most so many times their estimate (docs/decisions/accuracy.md).
_ESTIMATED_WITHIN = 3.0


class Driver:
    """Takes a trajectory through time; a state that is asked for never changes its steps."""

    def __init__(
        self,
        packed: PackedScene,
        method: Method,
        state: State,
        loads: Loads,
        frequency: Frequency,
        *,
        origin: float,
        fixed_step: float,
        tolerance: float,
        energy_limit: float,
        estimates_errors: bool,
        output_period: float,
        load_rate: float,
        half_edge: float,
        has_events: bool,
        thread_team: ThreadTeam,
        broad_phase: BroadPhase | None,
        obstruction: Obstruction,
        anchor_breaks: AnchorBreaks | None = None,
        pulse_step: Callable[[], float] = lambda: math.inf,
        leaves_contacts: bool = False,
        begins: bool = True,
        on_pause: Callable[[], None] = lambda: None,
    ) -> None:
        """
        Start at time `origin` [s] with the `frequency` of the state; `fixed_step` 0: chosen.

        Not `estimates_errors`: only what chooses steps is measured.
        `output_period` [s] is the step where nothing in the scene sets a scale. `has_events`:
        steps have to end where something happens. `anchor_breaks`: anchors that can break; None:
        none can. `pulse_step` returns the longest step [s] within what acts. `leaves_contacts`:
        another driver goes on once shells are near each other. Not `begins`: no step will be
        taken. `on_pause` is called between two compiled calls, at a step end; what it raises ends
        the advance there.

        Raises ValueError where a fixed step is too long or far too short.
        """
        self._is_given, self._on_pause = fixed_step > 0.0, on_pause
        # Whether the error estimate of the embedded pair chooses the steps; and whether its kernel
        # accepts or refuses them, which locates events with a given step, too.
        is_adaptive = method.adaptive and not self._is_given
        is_embedded = is_adaptive or (method.adaptive and has_events)
        differences = differences_of(
            method, packed.model.links, given=self._is_given, estimated=estimates_errors)
        self.trajectory = Trajectory(
            packed, method, state, loads, origin=origin, step=fixed_step,
            differences=differences,
            energy_limit=energy_limit, half_edge=half_edge, thread_team=thread_team,
            control=EmbeddedControl(origin) if is_embedded else None,
            anchor_breaks=anchor_breaks)
        self.contact = ContactScheduler(self.trajectory, broad_phase)
        self.calls = MethodCalls(self.trajectory, self.contact)
        self._whole = WholeState(self.trajectory, self.calls)
        self.rates = MotionRates(
            self.trajectory, self.contact, self._whole, frequency, load_rate, pulse_step)
        self.trials = TrialSteps(self.trajectory, self.contact, self.calls)
        self.shown = ShownEnergies(self.trajectory, self.contact)
        probe = AccuracyProbe(
            self.trajectory, self.trials, self.rates, tolerance, differences=differences)
        # Bands around shells change to another geodesic at any time, and slack connectors tighten.
        any_time = packed.model.wrapping is not None or (self._is_given and packed.goes_slack)
        has_jumps = any_time or broad_phase is not None
        # Chosen steps that run through contacts follow what these add.
        follows = broad_phase is not None and method.runs_through_contacts and not self._is_given
        is_needed = has_jumps and not is_adaptive and (estimates_errors or follows)
        self.errors = StepErrors(
            probe, None if not is_needed else TouchingErrors(
                self.trajectory, self.contact, self.rates, self.trials, probe.distance,
                probe.slip, any_time=any_time), is_estimated=estimates_errors)
        self.monitor = StepMonitor(
            self.trajectory, self.rates, self._whole, obstruction, given=self._is_given,
            tolerance=tolerance, differences=differences)
        choice = StepChoice(method, fixed_step, is_embedded, output_period)
        self.controller: StepController = make_controller(self, choice)
        self._stepping: Stepping
        if is_embedded:
            self._stepping = EmbeddedStepping(self, fixed_step)
        else:
            self._stepping = UniformStepping(self)
        # What the tolerance may add to velocities over a [1/s], where each step keeps to it.
        self._allowed_speed = _BESIDE_TOLERANCE * tolerance if is_adaptive else 0.0
        # Whether a step whose kernel is not compiled is taken back, with KernelsAwaited.
        self.awaits_kernels = False
        self._leaves_contacts = leaves_contacts
        links = packed.model.links
        self._tables = None if links is None or links.tables is None else TableWatch(packed)
        if begins:
            self._start(exact=False)
            self._require_stable(origin)

    @property
    def time(self) -> float:
        """Time [s] of the trajectory, from which the next step, or that in progress, begins."""
        return self.trajectory.time

    @property
    def next_step_time(self) -> float:
        """Time [s] at which the step in progress ends."""
        return self._stepping.next_step_time

    @property
    def is_given(self) -> bool:
        """Whether the step was given by `solver.step`."""
        return self._is_given

    @property
    def is_near_contact(self) -> bool:
        """Whether shells are near each other, and another driver is to go on from here."""
        return self._leaves_contacts and self.contact.contacts is not None

    def advance(self, time: float) -> None:
        """
        Take steps as far as `time` [s] asks for: a state up to there can be shown then.

        Or until it `is_near_contact`.
        """
        self.trajectory.require_sound()
        evaluations = self.trajectory.evaluations
        while True:
            while not self.is_near_contact and (count := self._stepping.count_until(time)) > 0:
                # What overlaps from the start is reported when the motion begins.
                self.contact.announce()
                self._or_back(partial(self._stepping.run, time, self._until_check(count)))
                self._watch_tables()
                self._on_pause()
            with evaluations.showing():
                is_sound = self.is_near_contact or self._stepping.check_within(time)
            if is_sound:
                if self._tables is not None and self.trajectory.control is not None and (
                        not self._tables.found and self._tables.is_suspect()):
                    # The run may end within this step.
                    with evaluations.showing():
                        state = self._stepping.state_at(time)
                    self._report_beyond_table(state, time, may_stop=False)
                return
            self._or_back(self._stepping.go_back)

    def advance_steps(self, count: int, *, until: float = math.inf) -> int:
        """
        Take whole steps, at least none and at most `count`, that end by `until`; returns how many.

        May return early; 0 says that the next step would end later.
        """
        self.trajectory.require_sound()
        done = self._or_back(partial(self._stepping.run_steps, self._until_check(count), until))
        self._watch_tables()
        return done

    def _until_check(self, count: int) -> int:
        """Return `count` steps, or as many as lead to where tables are looked at next."""
        if self._tables is None or not self._tables.is_watching:
            return count
        if self.trajectory.control is not None:
            return min(count, 1)
        return min(count, max(self.monitor.interval - self.monitor.since_check, 1))

    def _watch_tables(self) -> None:
        """
        Warn, or stop the run, if a connector is beyond its table: at health checks.

        Of adaptive steps where each begins: its end may never be reached.
        """
        tables, trajectory = self._tables, self.trajectory
        if tables is None or not tables.is_watching:
            return
        if trajectory.method.holder is not None:
            # Ranks note the pieces of their own connectors only. A run that stops does so at the
            # step at which one process stops.
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
        assert tables is not None
        text, stops = tables.describe(time, state, trajectory.broken.since)
        if stops and may_stop:
            if trajectory.saved_time > time:
                # At the end of the step in progress, which may lie beyond what was asked for.
                self._stepping.cut(time)
            trajectory.return_to_saved()
            trajectory.fail(
                f'{text}, and connector.law_beyond is stop; extrapolate lets it go on straight. '
                f'The state of t = {trajectory.saved_time:.9g} s is kept')
        if text and not tables.found and not stops:
            tables.found = text
            _LOGGER.warning(
                '%s: the law goes on straight there (connector.law_beyond)', text)

    def cut(self, time: float) -> bool:
        """
        Advance to `time` and end the step in progress there; the next step starts there.

        False where it is not, as it `is_near_contact`.
        """
        while True:
            self.advance(time)
            if self.is_near_contact:
                return False
            if self._or_back(partial(self._stepping.cut, time)):
                return True

    def state_at(self, time: float) -> State:
        """
        The state at `time`; after a failure the last good one.

        Valid until the next call of any method.
        """
        if self.trajectory.failure is None:
            self.advance(time)
        with self.trajectory.evaluations.showing():
            return self._stepping.state_at(time)

    def jump(self, time: float, state: State, loads: Loads, load_rate: float) -> None:
        """
        Go on from another `state` at `time`, as a run that starts there; a failure is forgotten.
        """
        trajectory = self.trajectory
        trajectory.failure = None
        self.errors.jump(time)
        trajectory.begin_at(time)
        trajectory.state, trajectory.loads = state, loads
        self.rates.load_rate = load_rate
        self.monitor.since_check = 0
        if not self._is_given:
            # Chosen afresh: the step must not depend on what was before.
            trajectory.step = 0.0
        self._start()
        self._require_stable(time)

    def adopt(self, other: 'Driver') -> None:
        """The motion goes on from that of `other`, after a jump: its steps erred alike."""
        self._stepping.adopt(other._stepping)

    def continue_from(self, before: 'Driver') -> None:
        """Take over the books of `before`, from whose state this one has just started."""
        before.trajectory.ledger.keep_work(before.trajectory.loads)
        self.trajectory.ledger.continue_from(before.trajectory.ledger)
        self.trajectory.step_count = before.trajectory.step_count
        self.trajectory.evaluations.continue_from(before.trajectory.evaluations)
        # What was reported once is not reported again.
        self.trajectory.ledger.reported_limit = before.trajectory.ledger.reported_limit
        self._stepping.settle(before.error_estimate(before.time))
        self.awaits_kernels = before.awaits_kernels
        if self._tables is not None and before._tables is not None:
            self._tables.found = before._tables.found

    def set_loads(self, loads: Loads, load_rate: float) -> None:
        """Replace the loads at the current state."""
        trajectory = self.trajectory
        trajectory.ledger.keep_work(trajectory.loads)
        trajectory.loads, self.rates.load_rate = loads, load_rate
        trajectory.place_driven()
        self._allow_rounding()
        self._stepping.follow_loads()

    def _allow_rounding(self) -> None:
        """Allow for rounding of what loads move between two health checks."""
        trajectory = self.trajectory
        # What has acted so far has no part in it, so ranks need not bring it here.
        loads, *_ = trajectory.for_steps()
        trajectory.ledger.allow_rounding(
            loads, trajectory.model, self.monitor.interval * trajectory.step)

    def set_last_forces(self, forces: np.ndarray) -> None:
        """
        Replace the forces (p, 3) [N] of the last p wrenches, where a step begins; steps stay.
        """
        trajectory = self.trajectory
        trajectory.loads.force[len(trajectory.loads.force) - len(forces):] = forces
        # Differences of the motion across a jump of the forces say nothing of the step.
        trajectory.ledger.regular = 0.0
        self.errors.spoil()

    def whole_steps(self, duration: float) -> float:
        """
        Return the time [s] of the most whole steps within a `duration` [s], of one up to twice it.

        The duration itself where steps are longer, or are not all of one length.
        """
        step = self.trajectory.step
        if self.trajectory.control is not None or not 0.0 < step <= 2.0 * duration:
            return duration
        return max(math.floor(duration / step), 1) * step

    def forget(self) -> None:
        """Count steps and errors from zero again: a run begins that has no past."""
        self.trajectory.step_count = 0
        self.trajectory.evaluations.forget()
        self.errors.forget()
        self.monitor.obstruction.found = ''
        if self._tables is not None:
            self._tables.found = ''
        self.contact.forget()
        self._stepping.forget()

    def rebase(self, time: float) -> None:
        """Move a driver that has not moved yet to another start `time`."""
        self.trajectory.begin_at(time)
        self.trajectory.note_saved(time)
        self.errors.rebase(time)
        self.contact.rebase(time)
        self._stepping.rebase(time)

    def warm_up(self) -> None:
        """Make every kernel that a step needs ready, without taking one."""
        before, loads = self.state_tree(), self.trajectory.loads
        try:
            self.state_at(self.time + 0.5 * self.trajectory.step)
        except SimulationError:
            if self.trajectory.packed.body_force is not None:
                raise
            # That no such step leads anywhere is said once the run comes to it.
            self.trajectory.failure = None
        finally:
            self._roll_back(before, loads)

    def is_ready(self) -> bool:
        """
        Whether nothing need be compiled for steps: up to an input, and once something touches.

        Not for those that another driver is to take.
        """
        return self._stepping.is_ready(touching=not self._leaves_contacts)

    def await_no_kernels(self) -> None:
        """Compile from now on what is missing."""
        self.awaits_kernels = False

    def _or_back(self, work: Callable[[], Result]) -> Result:
        """
        Do `work`, which takes steps; where these need the kernels that are awaited, go back.

        Raises KernelsAwaited then. Other kernels are loaded by a second try, where they are on
        disk and no other thread compiles. What fails otherwise leaves the state as it was.
        """
        def is_touching() -> bool:
            return self.contact.contacts is not None

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
                raise  # the last good state is kept
            except BaseException:
                self._roll_back(before, loads)
                raise
            self._roll_back(before, loads)
            if needs_contacts or not is_compiler_free():
                break
        raise KernelsAwaited(needs_contacts)

    def _roll_back(self, before: dict[str, Any], loads: Loads) -> None:
        """Go back to the state `before`; evaluations that were made since then stay counted."""
        evaluations = self.trajectory.evaluations
        # One more is made on the way.
        total = evaluations.total + 1
        self.load_state(StateTree(before), loads)
        evaluations.restore_total(total)

    def error_rate(self) -> float:
        """Error that the method adds for each second, measured last."""
        return self._stepping.error_rate()

    def error_estimate(self, time: float) -> float:
        """Errors added from the start to a present `time` [s], as if none had grown or faded."""
        return self._stepping.error_estimate(time)

    def state_tree(self) -> dict[str, Any]:
        """All that the steps to come depend on, body by body."""
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
        if self._tables is not None and self._tables.found:
            tree['beyond_table'] = self._tables.found
        self._stepping.state_tree(tree)
        return tree

    def load_state(self, tree: StateTree, loads: Loads) -> None:
        """Go on from there, with the `loads` that acted then."""
        step = tree.number('step', 0.0)
        if self._is_given and step != self.trajectory.step:
            raise ValueError(
                f'step must be solver.step {self.trajectory.step!r} s, got {step!r} s')
        self._stepping.load_time(tree)
        self.trajectory.load_state(tree, loads)
        self.contact.load_state(tree)
        self.trajectory.load_accelerations(tree)
        self.shown.load_state(tree)
        self.controller.held_back = tree.flag('held_back')
        self.rates.load_rate = tree.number('load_rate', 0.0, finite=False)
        self.rates.fabric = Frequency(tree.number('frequency', 0.0, finite=False), (), 0)
        self.errors.load_state(tree)
        self.monitor.load_state(tree)
        if self._tables is not None:
            self._tables.found = tree.text('beyond_table') if 'beyond_table' in tree else ''
        self._stepping.load_state(tree)
        self.trajectory.evaluations.load_state(
            tree.part('evaluations') if 'evaluations' in tree else None)

    def choose_step(self, *, probe: bool = False, shorter: float = 1.0) -> None:
        """
        Take the step that the controller proposes from now on.

        `probe` measures the accuracy anew; the state must have been saved. `shorter`: how many
        times too large the error is believed to be.
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
        """Do what a `status` of the kernels at `time` [s] asks for."""
        checks = self.monitor
        if status & monitor.NOT_FINITE:
            checks.fail_unfinite(time)
        if status & monitor.UNBALANCED:
            if not self._is_explained(time):
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
            if not self._is_given:
                step, limit = self.trajectory.step, self.rates.limit
                if not step <= limit:
                    _LOGGER.warning(
                        'the fabric changed so fast before t = %.6g s that up to %d steps were '
                        'longer than stable (limit %.3g s): their energy may be wrong; %s',
                        time, checks.interval, limit, checks.way_out(),
                    )
                # The bound alone may have grown.
                changed = abs(self.rates.fabric.rate - before) > _CHANGED * before
                self.choose_step(probe=changed)
            self._require_stable(time)

    def _is_explained(self, time: float) -> bool:
        """Whether errors within the tolerance explain at `time` [s] that energy is missing."""
        if not self._allowed_speed > 0.0:
            return False
        errors = _ESTIMATED_WITHIN * self.error_estimate(time)
        return self.trajectory.ledger.allow(errors, self.rates.frequency.rate)

    def _search_contacts(self, time: float) -> None:
        """Find what can touch from the present state on, of `time` [s]."""
        if self.contact.is_possible:
            self.contact.search(time, *self.controller.outlook())

    def _search_again(self, time: float, *, missed: bool) -> None:
        """Bodies have moved far: find what can touch now, and follow it with the step."""
        contact, trajectory = self.contact, self.trajectory
        if not contact.is_possible:
            return
        if missed:
            contact.miss(self.monitor.way_out())
        before = contact.rate
        self._search_contacts(time)
        changed = contact.rate != before or self.controller.held_back or (
            not trajectory.step <= contact.longest_step)
        if not self._is_given and changed and self.controller.follow_contacts():
            self.choose_step()
        self._pace_contacts()
        if missed and self._is_given and not trajectory.step <= self.rates.limit:
            trajectory.return_to_saved()
        self._require_stable(time)

    def _pace_contacts(self) -> None:
        # Kernels search by themselves only where the step need not follow.
        self.contact.pace(self.trajectory.step, alone=not self.controller.held_back)

    def _require_stable(self, time: float) -> None:
        if self._is_given:
            self.rates.require_stable(time)

    def _start(self, *, exact: bool = True) -> None:
        """Compute the accelerations, the frequency and the step anew: the state has jumped."""
        trajectory, ledger = self.trajectory, self.trajectory.ledger
        self._stepping.restart()
        trajectory.place_driven()
        self.contact.forget_friction()
        self.contact.calm()
        self._search_contacts(trajectory.time)
        self._whole.refresh()
        trajectory.clear_meters()
        ledger.restart()
        trajectory.save()
        self.monitor.restart(exact=exact)
        self.contact.require_room()
        ledger.open(
            self.shown.moving(), self._whole.squares(), self.rates.frequency.rate,
            self._allowed_speed)
        self.shown.restart()
        self.errors.probe.restart()
        # No stretch leads across the jump.
        self.errors.spoil()
        self.choose_step()
        self._allow_rounding()
        self.errors.restart_touching(trajectory.saved_time)
        self._watch_tables()
