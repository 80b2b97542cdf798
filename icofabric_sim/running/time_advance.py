# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Advance of simulated time: to the next output, by solver steps, or to a failure.

Between two calls of the simulation the time is a whole number of nanoseconds, and the simulation
is exactly there. Every input therefore acts at a time that a ROS time stamp holds exactly.
"""

from contextlib import suppress
import logging
import math
import time as wall

from icofabric_sim.kernels.runtime.kernel_guard import is_compiler_free
from icofabric_sim.messages.schedule import NANOSECONDS, nanoseconds_not_before, seconds
from icofabric_sim.running.broadcast import Broadcast
from icofabric_sim.running.real_time_factor import RealTimeFactor
from icofabric_sim.running.received_inputs import ReceivedInputs
from icofabric_sim.running.run_events import Shown, shown_after
from icofabric_sim.running.run_state import RunState
from icofabric_sim.running.stall import StallWatch
from icofabric_sim.running.time_requests import AdvanceRequest, StepRequest, TimeRequests
from icofabric_sim.simulation.errors import Interrupted, KernelsAwaited, SimulationError
from icofabric_sim.simulation.simulation import Simulation

_LOGGER = logging.getLogger('icofabric_sim')
# Wall time of one call of the simulation [s], i.e. the delay of an immediate input, a pause or a
# stop.
RESPONSE = 0.01
# Time limit [s] of a call that takes longer, because the motion has become faster.
_MAX_CALL_S = 0.1
# Waits for kernels beyond this wall time [s] are logged.
_LOGGED_WAIT_S = 0.5


class TimeAdvance:
    """Advance of one run, in its thread; only `stop` is thread-safe."""

    def __init__(
        self, state: RunState, inputs: ReceivedInputs, broadcast: Broadcast,
        real_time: RealTimeFactor
    ) -> None:
        """Advance `state`; outputs go to `broadcast`."""
        self._state, self._inputs, self._broadcast, self._real_time = (
            state, inputs, broadcast, real_time)
        self.requests = TimeRequests()
        self.stopping = False
        self._patient_until = math.inf
        self._held_for_contacts = True
        # Start of the wait (wall clock), and its reason until that is logged.
        self._held_since, self._held_why, self._held_at = 0.0, '', -1
        # None: the caller waits for the end of the run.
        self.stall: StallWatch | None = None

    def stop(self) -> None:
        """Stop the simulation at the end of a step."""
        self.stopping = True

    def follow(self, simulation: Simulation) -> None:
        """Advance this simulation from now on."""
        kernels = self._state.simulation.contact_kernels
        if kernels is not None and self._state.simulation is not simulation:
            kernels.give_up()
        self._state.simulation = simulation
        simulation.should_stop = (
            lambda: self.stopping or wall.monotonic() > self._patient_until)
        # Those that have acted while it was built.
        self._inputs.record_acted()
        self.restart_motion()

    def prepare_contacts(self) -> None:
        """Let a live run respond while the first contact waits for the compiler."""
        if self.stall is not None:
            self._state.simulation.prepare_contacts()

    def advance(self, end: int | None = None) -> None:
        """
        Advance to the next output, or for a short time if that is sooner; at most to `end` [ns].

        Outputs due at that end are left to the caller.
        """
        state, started, before = self._state, wall.perf_counter(), self._state.now
        target = self._next_target(self.requests.next_time() if end is None else end)
        try:
            if not self._reaches(target):
                state.catch_up()
                target = state.now
                self._advance_to(target)
            state.now = target
            computed = wall.perf_counter() - started
            self._real_time.record_steps(target - before, computed)
            if state.now > before:
                self._log_resumed()
            # Interrupted before its first step, it has already sent this time.
            if state.now > before and state.now != end:
                self._broadcast.due(state.now)
            if not self._broadcast.owes:
                self.requests.answer(state.now)
            self._check_stall()
        except SimulationError as error:
            self.fail(str(error), target)
        except Interrupted as stop:
            state.catch_up()
            if isinstance(stop, KernelsAwaited):
                self._hold(stop.is_for_contacts)
            if before < state.now != end and not state.failure:
                # It may coincide with an output.
                self._broadcast.owe(state.now)

    def begin_steps(self, request: StepRequest) -> None:
        """Queue a request for solver steps, or answer why they are not possible."""
        state = self._state
        if state.failure:
            request.future.set_exception(RuntimeError(state.failure))
        elif not state.paused:
            request.future.set_exception(RuntimeError(
                'steps are taken only while paused: call ~/pause with data: true first'))
        else:
            request.begin(state.parameters['step_count'])
            self.requests.add(request)

    def begin_advance(self, request: AdvanceRequest) -> None:
        """
        Queue an advance, or wait for its end while time runs, or answer why it is impossible.
        """
        state = self._state
        if request.duration is None:
            request.duration = round(state.parameters['advance_duration'] * NANOSECONDS)
        if state.failure or state.finished:
            request.future.set_exception(RuntimeError(
                state.failure or f'not advanced: {self._over()}'))
        elif state.paused:
            self.requests.add(request)
        else:
            request.begin(state.now)
            self.requests.wait(request)

    def take_advance(self, request: AdvanceRequest) -> None:
        """
        Advance a paused run for a short time; the rest follows after pending commands.

        As fast as possible, because the caller waits.
        """
        state = self._state
        if state.finished:
            self.end_requests(self._over())
            return
        if request.is_shown:
            self._answer(request)
            return
        if not request.has_begun:
            request.begin(state.now)
            self._broadcast.event(state.now, 'advance', to=request.end)
        self.advance(request.end)
        if state.failure or state.is_held:
            return
        if state.now >= request.end:
            # Shown once, as after steps, whether or not an output is due.
            self._broadcast.event(state.now, 'advanced')
            self.show_after('advanced')
            self._real_time.restart(state.now)
            self._answer(request)
        elif state.finished:
            self.end_requests(self._over())

    def end_with_the_run(self) -> None:
        """Answer all requests for a time beyond the duration, once that is reached."""
        if self._state.finished:
            self.end_requests(self._over())

    def end_requests(self, reason: str) -> None:
        """Answer all requests for a time with the `reason` why it is not reached."""
        state, current = self._state, self.requests.current
        if current is not None and current.is_shown:
            self.requests.finish(state.now)
        elif isinstance(current, AdvanceRequest) and current.has_begun:
            self._broadcast.event(state.now, 'advance_ended')
            self._real_time.restart(state.now)
        self.requests.end(reason, state.now)

    def restart_motion(self) -> None:
        """Restart stall detection, and end a wait for kernels, e.g. after a reset."""
        self._state.is_held = False
        if self.stall is not None:
            simulation = self._state.simulation
            self.stall.begin(
                simulation.status.usual_evaluation_rate, simulation.scene.body_count,
                1.0 / simulation.scene.parameters['publish_rate'],
                simulation.status.contact_evaluation_rate)

    def take_steps(self, request: StepRequest) -> None:
        """Take steps for a short time; the rest follows after pending commands."""
        if request.is_shown:
            self._answer(request)
            return
        state, end = self._state, wall.perf_counter() + RESPONSE
        simulation, target = state.simulation, state.now
        try:
            while not request.done:
                # Round-off must not put it before the end of the step.
                target = nanoseconds_not_before(simulation.status.next_step_time) + 1
                with self._inputs.recorded():
                    request.taken += simulation.advance_steps(1)
                if wall.perf_counter() > end:
                    break
            state.catch_up()
            self._log_resumed()
            # Inputs between two portions also act at a whole number of nanoseconds.
            self._advance_to(state.now)
            if request.done:
                self._real_time.restart(state.now)
                self._broadcast.event(state.now, 'step', count=request.taken)
                self.show_after('step')
                self._answer(request)
        except SimulationError as error:
            self.fail(str(error), target)
        except KernelsAwaited as error:
            self._hold(error.is_for_contacts)
        except Interrupted:
            state.catch_up()

    def _answer(self, request: StepRequest | AdvanceRequest) -> None:
        """Answer the completed request after its state is sent."""
        request.is_shown = True
        if not self._broadcast.owes:
            self.requests.finish(self._state.now)

    def _check_stall(self) -> None:
        """Stop simulated time in a stall, with a reason: a stopped clock gives none."""
        if self.stall is None:
            return
        state = self._state
        status = state.simulation.status
        reason = self.stall.note(
            seconds(state.now), status.step_count, status.stage_count,
            lambda: status.fastest_term)
        if reason:
            state.failure = reason
            _LOGGER.error('the simulation has stopped: %s', reason)
            self._inputs.drop_waiting('the simulation has stopped')
            self._broadcast.event(state.now, 'stalled', reason=reason)
            self.end_requests(reason)

    def stand_on_nanoseconds(self) -> None:
        """Move the simulation to the time of the run if it stopped between two nanoseconds."""
        state = self._state
        try:
            self._advance_to(state.now)
        except SimulationError as error:
            self.fail(str(error), state.now)
        except Interrupted:
            pass

    def is_held(self) -> bool:
        """
        Resume simulated time if its kernels are ready; return whether it still waits for them.

        It waits for kernels of steps, or of outputs that are due now and are sent here.
        """
        state = self._state
        if not state.is_held and not self._broadcast.owes:
            return False
        kernels = state.simulation.contact_kernels
        if not state.is_held:
            self._note_hold(
                'the kernels that measure reactions and contacts are not ready yet; they are '
                'compiled once per machine')
        if self._held_why and wall.monotonic() - self._held_since > _LOGGED_WAIT_S:
            _LOGGER.info(
                'simulated time is waiting at t = %.9g s: %s', seconds(state.now), self._held_why)
            self._held_why = ''
        if state.is_held and (kernels is None or kernels.are_ready or (
                not self._held_for_contacts and is_compiler_free())):
            # At least for an attempt.
            state.is_held = False
            self._real_time.restart(state.now)
        if self._broadcast.owes:
            self._settle()
        return state.is_held or self._broadcast.owes

    def _settle(self) -> None:
        """Send the deferred outputs of the present time, unless they need missing kernels."""
        state = self._state
        try:
            if not state.failure:
                self._advance_to(state.now)
            self._broadcast.settle(state.now)
        except SimulationError as error:
            self.fail(str(error), state.now)
        except Interrupted:
            return
        self._real_time.restart(state.now)

    def _log_resumed(self) -> None:
        """Log that time runs again, if the wait was logged."""
        if self._held_at >= 0 and not self._held_why:
            _LOGGER.info('simulated time has resumed')
        self._held_at = -1

    def waits(self) -> str:
        """Return what simulated time waits for, or ''; thread-safe."""
        kernels = self._state.simulation.contact_kernels
        what, since = 'kernels of measured forces', self._broadcast.waits_for()
        if self._state.is_held and kernels is not None:
            what = 'the kernels for contacts' if self._held_for_contacts else 'kernels'
            since = kernels.seconds
        elif not since or not self._broadcast.owes:
            return ''
        return f'compiling {what}, for {since:.0f} s so far'

    def _hold(self, for_contacts: bool) -> None:
        """
        Wait for the kernels of the next step, for contacts or those that load slowly.

        Operations that need none of them continue.
        """
        state, self._held_for_contacts = self._state, for_contacts
        state.catch_up()
        self.stand_on_nanoseconds()
        if state.failure:
            return
        state.is_held = True
        if state.simulation.contact_kernels is not None:
            state.simulation.contact_kernels.hurry()
        self._note_hold(
            'shells are near each other for the first time, and the kernels for contacts are not '
            'ready yet; they are compiled once per machine' if for_contacts else
            'the compiler is running, and a kernel has to be loaded')

    def _note_hold(self, why: str) -> None:
        """Record start and reason of a wait; the same wait is recorded once."""
        if self._held_at != self._state.now:
            self._held_at, self._held_since, self._held_why = (
                self._state.now, wall.monotonic(), why)

    def fail(self, reason: str, target: int) -> None:
        """Stop simulated time: the simulation failed before reaching `target` [ns]."""
        state = self._state
        state.catch_up()
        state.failure = reason
        _LOGGER.error('the simulation has stopped: %s', reason)
        self._inputs.drop_waiting('the simulation has stopped')
        self._broadcast.event(state.now, 'failed', reason=reason, target=target)
        with suppress(SimulationError, Interrupted):
            if math.isfinite(state.simulation.snapshot().position.sum()):
                self.show_after('failed')
        self.end_requests(reason)

    def show_after(self, event: str) -> None:
        """Send the outputs that follow an event, see run_events.py."""
        shown = shown_after(event, running=not self._state.paused)
        if shown is Shown.ANEW:
            self._broadcast.start(self._state.now, cleared=True)
        elif shown is Shown.PRESENT:
            self._broadcast.emit(self._state.now)

    def _reaches(self, target: int) -> bool:
        """
        Advance to `target` [ns]; return False if interrupted before, at the end of a step.

        A wrench may make the motion a thousand times faster than when the target was chosen;
        pending commands must not wait for all of it.
        """
        self._patient_until = wall.monotonic() + _MAX_CALL_S
        try:
            self._advance_to(target)
        except KernelsAwaited:
            raise
        except Interrupted:
            return False
        finally:
            self._patient_until = math.inf
        return True

    def _advance_to(self, time: int) -> None:
        """Advance the simulation to `time` [ns], and record the inputs that act by then."""
        with self._inputs.recorded():
            self._state.simulation.advance_to(seconds(time))

    def _over(self) -> str:
        return (f'the duration of {self._state.parameters["duration"]:g} s has passed; reset '
                'with reset_time: true, or set a longer duration')

    def _next_target(self, end: int | None) -> int:
        state = self._state
        times = [state.now + self._real_time.chunk(RESPONSE, state.simulation.status.step)]
        times += self._broadcast.next_times(state.now)
        if state.end > state.now:
            times.append(state.end)
        if end is not None:
            times.append(end)
        return max(min(times), state.now)
