# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Operations on a run: pauses, resets, checkpoints, re-weaves, and recording.

All are executed between two steps, in the thread of the run, and published as events before any
state that they changed, so that a bag can be simulated again.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import Future
import logging
from pathlib import Path
import threading
from typing import Any, TYPE_CHECKING

from icofabric_sim.checks import counted
from icofabric_sim.messages.schedule import nanoseconds_not_before, seconds
from icofabric_sim.parameters.changes import (
    changed_names,
    rebuilds,
    require_changeable,
    with_immediate_changes,
)
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.running.broadcast import Broadcast
from icofabric_sim.running.equilibrium_solve import EquilibriumSolve
from icofabric_sim.running.parameter_change import ParameterChange
from icofabric_sim.running.rate_limited_log import RateLimitedLog
from icofabric_sim.running.real_time_factor import RealTimeFactor
from icofabric_sim.running.received_inputs import ReceivedInputs
from icofabric_sim.running.reweave import lost_wrenches, Reweaver, SwapPostponed
from icofabric_sim.running.run_events import do_event, is_jump, replace_simulation
from icofabric_sim.running.run_records import is_initial, Status
from icofabric_sim.running.run_state import RunState
from icofabric_sim.running.time_advance import TimeAdvance
from icofabric_sim.simulation.errors import SimulationError
from icofabric_sim.simulation.inputs.input_types import has_target
from icofabric_sim.simulation.simulation import Simulation

if TYPE_CHECKING:
    from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint

_LOGGER = logging.getLogger('icofabric_sim')


class RunChanges:
    """Operations on a run, executed in its thread."""

    def __init__(
        self,
        state: RunState,
        time: TimeAdvance,
        inputs: ReceivedInputs,
        broadcast: Broadcast,
        real_time: RealTimeFactor,
        *,
        post: Callable[[Callable[[], Any]], object],
        fresh_status: Callable[[], Status],
        on_rebuilt: Callable[[Parameters, str], None],
    ) -> None:
        """
        Change `state`; `post` runs a call in the thread of the run.

        `fresh_status` returns the status of the run for a bag being closed; see `Runner` for other
        parameters.
        """
        self._state, self._time, self._inputs = state, time, inputs
        self._broadcast, self._real_time = broadcast, real_time
        self._post, self._fresh_status, self.on_rebuilt = post, fresh_status, on_rebuilt
        self._reweaver = Reweaver(
            post, self._swap, state.simulation.body_force, state.simulation.ranks,
            has_touched=lambda: state.simulation.status.contact_tests > 0,
            is_measured=broadcast.is_measured, has_time=real_time.has_spare_time)
        # A slider sends fifty changes a second.
        self._log = RateLimitedLog(_LOGGER.info)
        self.equilibrium = EquilibriumSolve(state, time, broadcast, post)

    @property
    def wanted(self) -> Parameters | None:
        """
        Return the parameters being built, with all changes accepted meanwhile; None while idle.
        """
        return self._reweaver.wanted

    def pause(self, paused: bool) -> int:
        """Stop or resume simulated time; return the time [ns]."""
        state = self._state
        if paused or state.paused:
            self._time.end_requests('ended by a pause' if paused else 'the run was resumed')
        state.paused = paused
        self._broadcast.event(state.now, 'pause' if paused else 'resume')
        self._real_time.restart(state.now)
        return state.now

    def reset(self, wanted: bool | None) -> int:
        """
        Reset to the initial state, and to time 0 if requested or configured; return the time [ns].
        """
        state = self._state
        self._time.end_requests('ended by a reset')
        dropped = self._inputs.drop_waiting('the run was reset before their stamps')
        ended = self._fresh_status()
        time_reset = state.parameters['reset_time'] if wanted is None else wanted
        facts = {'time_reset': time_reset, 'dropped': dropped}
        self._broadcast.event(state.now, 'reset', **facts)
        do_event(state.simulation, state.now, 'reset', facts)
        if is_jump('reset', facts):
            state.now = 0
            self._broadcast.time_jumped(ended)
        state.failure = ''
        self._time.restart_motion()
        self._real_time.restart(state.now)
        self._time.show_after('reset')
        return state.now

    def clear_loads(self) -> int:
        """Clear all wrenches, and drop waiting ones; return the time [ns]."""
        state = self._state
        state.require_sound('no wrench can be cleared')
        self._broadcast.event(state.now, 'loads_cleared', dropped=self._inputs.clear())
        return state.now

    def save(self, choose: Callable[[Parameters], Path], saved: 'Future[Any]') -> None:
        """
        Take a checkpoint for the file returned by `choose`; `saved` completes when it is written.
        """
        state = self._state
        try:
            state.require_sound('no checkpoint can be taken')
            path, checkpoint = choose(state.parameters), state.simulation.checkpoint()
            self._broadcast.checkpoint(state.now, taken=checkpoint)
        except Exception as error:  # passed to the caller
            saved.set_exception(error)
            return
        # A slow disk does not block the run.
        threading.Thread(
            target=self._write, args=(checkpoint, path, state.now, saved), name='checkpoint'
        ).start()

    def restore(self, choose: Callable[[Parameters], Path]) -> int:
        """Continue from the checkpoint returned by `choose`; return its time [ns]."""
        from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
        state = self._state
        path = choose(state.parameters)
        checkpoint, ended = Checkpoint.load(path), self._fresh_status()
        state.simulation.restore(checkpoint)
        self._time.end_requests('ended by a restored checkpoint')
        dropped = self._inputs.drop_waiting('a checkpoint was restored before their stamps')
        self._broadcast.event(
            state.now, 'checkpoint_restored', path=str(path), of=state.simulation.time,
            dropped=dropped)
        state.now, state.failure = nanoseconds_not_before(state.simulation.time), ''
        self._time.restart_motion()
        self._time.stand_on_nanoseconds()
        self._broadcast.time_jumped(ended)
        self._real_time.restart(state.now)
        self._broadcast.start(state.now, cleared=True, whole=False)
        return state.now

    def set_body_state(self, body: int, parts: Mapping[str, Any]) -> int:
        """Set the state of one body, see entities.py; return the time [ns]."""
        state = self._state
        state.require_sound('no state can be set')
        before = state.simulation.checkpoint()
        try:
            do_event(state.simulation, state.now, 'state_set', {'body': body, **parts})
        except (SimulationError, ValueError) as error:
            state.simulation.restore(before)
            raise ValueError(f'the state of body {body} is invalid: {error}') from error
        self._time.restart_motion()
        self._broadcast.event(state.now, 'state_set', body=body, **parts)
        self._time.show_after('state_set')
        return state.now

    def set_recording(self, on: bool) -> str:
        """Open a new bag, or close the present one; return a sentence on the result."""
        state, recorders = self._state, self._broadcast.recorders()
        if not recorders:
            raise RuntimeError(
                'recording is not available: start with a folder for the bag in record.path')
        if on:
            state.require_sound('no recording can begin')
        else:
            self._broadcast.event(state.now, 'record', on=False)
        status = self._fresh_status()
        said = [sink.switch(on, state.simulation, state.parameters, status) for sink in recorders]
        if on:
            self._broadcast.start(
                state.now, whole=is_initial(state.simulation), only=recorders)
            self._broadcast.event(state.now, 'record', on=True)
        return ', '.join(said)

    def change(self, change: ParameterChange) -> None:
        """Set other parameters, at once or after a build."""
        state = self._state
        change = change.compared_with(self._reweaver.wanted or state.parameters)
        require_changeable(change.names)
        # Output rates, real-time factor and duration change at once, also during a build.
        rates = with_immediate_changes(state.parameters, change.after)
        if rates is not state.parameters:
            self._take_rates(rates)
            self._broadcast.describe(state.now)
        if change.rebuilds:
            self._reweaver.want(change)
        else:
            self._reweaver.amend(change.after)
            change.outcome.set_result('')

    def _write(
        self, checkpoint: 'Checkpoint', path: Path, time: int, saved: 'Future[Any]'
    ) -> None:
        try:
            checkpoint.save(path)
        except Exception as error:  # passed to the caller
            _LOGGER.error('%s', error)
            saved.set_exception(error)
            return
        saved.set_result(str(path))
        self._post(lambda: self._broadcast.event(
            self._state.now, 'checkpoint_saved', path=str(path), of=seconds(time)))

    def _take_rates(self, parameters: Parameters) -> None:
        self._state.parameters = parameters
        self._broadcast.set_rates(parameters)
        self._real_time.set_target(parameters['real_time_factor'], self._state.now)

    def _swap(
        self, wanted: Parameters, simulation: Simulation | None, reason: str,
        answered: list[ParameterChange]
    ) -> None:
        """Swap in another simulation, or report the error, as the outcome of `answered`."""
        try:
            reason = self._taken(wanted, simulation, reason)
        except SwapPostponed:
            answered = []
            raise
        except BaseException as error:
            reason = str(error)
            raise
        finally:
            for change in answered:
                change.outcome.set_result(reason)

    def _taken(self, wanted: Parameters, simulation: Simulation | None, reason: str) -> str:
        """Swap in another simulation, or return the reason why not."""
        state = self._state
        if simulation is not None and not rebuilds(
                state.parameters, simulation.scene.parameters):
            # Changed and changed back during the build: the motion continues untouched.
            self.on_rebuilt(wanted, '')
            return ''
        restarts = False
        if simulation is not None:
            try:
                with self._reweaver.postponing():
                    restarts = replace_simulation(
                        state.simulation, simulation, state.now, state.parameters, wanted)
                self._broadcast.set_scene(simulation, self._reweaver.outputs)
            except SwapPostponed:
                raise
            except Exception as error:  # the old fabric continues after any error
                simulation, reason = None, str(error) or type(error).__name__
        if simulation is None:
            _LOGGER.error('the change could not be built, the old fabric continues: %s', reason)
            self._broadcast.event(state.now, 'change_refused', reason=reason)
            self.on_rebuilt(wanted, reason)
            return reason
        self._tell_of_change(wanted, simulation, restarts)
        self._time.follow(simulation)
        state.failure = ''
        self._real_time.forget_speed()
        self._take_rates(wanted)
        self._time.show_after('reweave')
        self.on_rebuilt(wanted, '')
        return ''

    def _tell_of_change(
        self, wanted: Parameters, simulation: Simulation, restarts: bool
    ) -> None:
        state = self._state
        lost = lost_wrenches(state.simulation, simulation.scene)
        if lost:
            _LOGGER.warning(
                'wrenches ended with the change, because their targets no longer exist: %s',
                ', '.join(lost))
        dropped = self._inputs.drop_waiting(
            'the weave has changed, and their targets no longer exist',
            lambda target: not has_target(simulation.scene, target))
        self._broadcast.event(
            state.now, 'reweave', restarts=restarts, lost=lost, dropped=dropped,
            changed=sorted(changed_names(state.parameters, wanted)))
        self._log.log(
            'change', f'the changed fabric has been running since t = {seconds(state.now):.9g} s: '
            f'{counted(simulation.scene.body_count, "body")}, step {simulation.status.step:.3g} s')
