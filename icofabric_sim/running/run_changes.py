# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
What changes a run from outside: resets, checkpoints, another weave; and what is recorded of it.

All of it happens between two steps, in the thread of the run, and is told as an event before any
state that it changed: so a record can be simulated again.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import Future
import logging
from pathlib import Path
import threading
from typing import Any, TYPE_CHECKING

from icofabric_sim.messages.schedule import nanoseconds_not_before, seconds
from icofabric_sim.parameters.changes import (
    changed_names,
    rebuilds,
    require_changeable,
    with_rates,
)
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.running.broadcast import Sink
from icofabric_sim.running.reweave import lost_wrenches, Reweaver
from icofabric_sim.running.run_events import do_event, is_jump, replace_simulation
from icofabric_sim.running.run_records import begins_anew, Status
from icofabric_sim.running.time_line import TimeLine
from icofabric_sim.simulation.errors import SimulationError
from icofabric_sim.simulation.input_types import has_target
from icofabric_sim.simulation.simulation import Simulation

if TYPE_CHECKING:
    from icofabric_sim.simulation.checkpoint import Checkpoint

_LOGGER = logging.getLogger('icofabric_sim')


class ChangingRun(TimeLine):
    """A run whose state, scene and record are changed on the way."""

    def __init__(
        self,
        simulation: Simulation,
        sinks: list[Sink],
        parameters: Parameters | None,
        report: Callable[[Status], bytes] | None,
        full_name: Callable[[str], str],
        on_rebuilt: Callable[[Parameters, str], None],
    ) -> None:
        """See `Runner`."""
        super().__init__(simulation, sinks, parameters, report, full_name)
        self.on_rebuilt = on_rebuilt
        self._reweaver = Reweaver(self.post, self._swap, simulation.body_force)

    def _reset(self, wanted: bool | None) -> int:
        self._steps.end('ended by a reset')
        dropped = self.inputs.drop_waiting('a reset came before')
        ended = self._fresh_status()
        time_reset = self.parameters['reset_time'] if wanted is None else wanted
        facts = {'time_reset': time_reset, 'dropped': dropped}
        self._broadcast.event(self.now, 'reset', **facts)
        do_event(self.simulation, self.now, 'reset', facts)
        if is_jump('reset', facts):
            self.now = 0
            self._broadcast.time_jumped(ended)
        self.failure = ''
        self._pace.restart(self.now)
        self._show_after('reset')
        return self.now

    def _save(self, path: Path, saved: 'Future[Any]') -> None:
        try:
            self._require_sound('no checkpoint can be taken')
            checkpoint = self.simulation.checkpoint()
            self._broadcast.checkpoint(self.now, taken=checkpoint)
        except Exception as error:  # noqa: BLE001 - the one who asked gets it
            saved.set_exception(error)
            return
        # A slow disk does not hold up the run.
        threading.Thread(
            target=self._write, args=(checkpoint, path, self.now, saved), name='checkpoint'
        ).start()

    def _write(
        self, checkpoint: 'Checkpoint', path: Path, time: int, saved: 'Future[Any]'
    ) -> None:
        try:
            checkpoint.save(path)
        except Exception as error:  # noqa: BLE001 - the one who asked gets it
            _LOGGER.error('%s', error)
            saved.set_exception(error)
            return
        saved.set_result(str(path))
        self.post(lambda: self._broadcast.event(
            self.now, 'checkpoint_saved', path=str(path), of=seconds(time)))

    def _restore(self, path: Path) -> int:
        from icofabric_sim.simulation.checkpoint import Checkpoint
        checkpoint, ended = Checkpoint.load(path), self._fresh_status()
        self.simulation.restore(checkpoint)
        self._steps.end('ended by a checkpoint that was restored')
        dropped = self.inputs.drop_waiting('a checkpoint was restored before')
        self._broadcast.event(
            self.now, 'checkpoint_restored', path=str(path), of=self.simulation.time,
            dropped=dropped)
        self.now, self.failure = nanoseconds_not_before(self.simulation.time), ''
        self._stand_on_nanoseconds()
        self._broadcast.time_jumped(ended)
        self._pace.restart(self.now)
        self._broadcast.start(self.now, cleared=True, whole=False)
        return self.now

    def _set_body_state(self, body: int, parts: Mapping[str, Any]) -> int:
        self._require_sound('no state can be set')
        before = self.simulation.checkpoint()
        try:
            do_event(self.simulation, self.now, 'state_set', {'body': body, **parts})
        except (SimulationError, ValueError) as error:
            self.simulation.restore(before)
            raise ValueError(f'body {body} cannot be there or move like that: {error}') from error
        self._broadcast.event(self.now, 'state_set', body=body, **parts)
        self._show_after('state_set')
        return self.now

    def _set_recording(self, on: bool) -> str:
        recorders = self._broadcast.recorders()
        if not recorders:
            raise RuntimeError(
                'there is nothing to record with: start with a folder for the bag in record.path')
        if on:
            self._require_sound('no recording can begin')
        else:
            self._broadcast.event(self.now, 'record', on=False)
        status = self._fresh_status()
        said = [sink.switch(on, self.simulation, self.parameters, status) for sink in recorders]
        if on:
            self._broadcast.start(
                self.now, whole=begins_anew(self.simulation), only=recorders)
            self._broadcast.event(self.now, 'record', on=True)
        return ', '.join(said)

    def _change(self, parameters: Parameters) -> None:
        before = self._reweaver.wanted or self.parameters
        require_changeable(changed_names(before, parameters))
        # Rates, pace and duration act at once, also while another fabric is being built.
        rates = with_rates(self.parameters, parameters)
        if rates is not self.parameters:
            self._take_rates(rates)
            self._broadcast.describe(self.now)
        if rebuilds(before, parameters):
            _LOGGER.info('building the changed fabric beside the running one')
            self._reweaver.want(parameters)
        else:
            self._reweaver.amend(parameters)

    def _take_rates(self, parameters: Parameters) -> None:
        self.parameters = parameters
        self._broadcast.set_rates(parameters)
        self._pace.set_factor(parameters['real_time_factor'], self.now)

    def _swap(self, wanted: Parameters, simulation: Simulation | None, reason: str) -> None:
        if simulation is not None and not rebuilds(self.parameters, simulation.scene.parameters):
            # Changed and changed back while it was built: the motion need not be touched.
            self.on_rebuilt(wanted, '')
            return
        restarts = False
        if simulation is not None:
            try:
                restarts = replace_simulation(
                    self.simulation, simulation, self.now, self.parameters, wanted)
            except (SimulationError, ValueError) as error:
                simulation, reason = None, str(error)
        if simulation is None:
            _LOGGER.error('the change could not be built, the old fabric runs on: %s', reason)
            self._broadcast.event(self.now, 'change_refused', reason=reason)
            self.on_rebuilt(wanted, reason)
            return
        self._tell_of_change(wanted, simulation, restarts)
        self.simulation, self.failure = simulation, ''
        self._follow_simulation()
        self._pace.forget_speed()
        self._broadcast.set_scene(simulation)
        self._take_rates(wanted)
        self._show_after('reweave')
        self.on_rebuilt(wanted, '')

    def _tell_of_change(
        self, wanted: Parameters, simulation: Simulation, restarts: bool
    ) -> None:
        lost = lost_wrenches(self.simulation, simulation.scene)
        if lost:
            _LOGGER.warning(
                'wrenches ended with the change, which leaves no place for them: %s',
                ', '.join(lost))
        dropped = self.inputs.drop_waiting(
            'the weave changed before, and has no place for it',
            lambda target: not has_target(simulation.scene, target))
        self._broadcast.event(
            self.now, 'reweave', restarts=restarts, lost=lost, dropped=dropped,
            changed=sorted(changed_names(self.parameters, wanted)))
        _LOGGER.info('the changed fabric is in place at t = %.9g s: %d bodies, step %.3g s',
                     seconds(self.now), simulation.scene.body_count, simulation.step)
