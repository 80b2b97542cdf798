# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Trajectory of a run: its state and time, and a saved state to return to.

The steps are chosen elsewhere; see `driver.py`.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import math
from typing import Any, NamedTuple, NoReturn

from icofabric_sim.kernels.flows import keep_accelerations, place_all
from icofabric_sim.kernels.loads import place_driven
from icofabric_sim.kernels.records import Loads, Model, State, Work
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.contact.broad_phase import BroadPhase, NoContacts
from icofabric_sim.simulation.contact.friction_state import contact_losses
from icofabric_sim.simulation.errors import ElsewhereError, SimulationError
from icofabric_sim.simulation.inputs.inputs import Inputs
from icofabric_sim.simulation.model.layout import copied_state, copy_state, has_jumps
from icofabric_sim.simulation.model.packing import acting_lanes, PackedScene
from icofabric_sim.simulation.model.shared_kinds import (
    BESIDE_ACCELERATIONS,
    BESIDE_CONNECTORS,
    BESIDE_DRIVES,
    TERMS,
    Without,
    without,
)
from icofabric_sim.simulation.model.stability import Frequency
from icofabric_sim.simulation.stepping.broken import Broken
from icofabric_sim.simulation.stepping.embedded_control import EmbeddedControl
from icofabric_sim.simulation.stepping.evaluations import Evaluations
from icofabric_sim.simulation.stepping.ledger import Ledger
from icofabric_sim.simulation.stepping.methods import KINK_ORDER, Method
from icofabric_sim.simulation.stepping.obstruction import Obstruction
from icofabric_sim.simulation.stepping.thread_team import ThreadTeam
from icofabric_sim.terms.contacts.force import touch_all
from icofabric_sim.terms.contacts.losses import touch_ahead
from icofabric_sim.terms.contacts.record import ContactLosses, Contacts
from icofabric_sim.terms.meters import Meter
import numpy as np

# Of what contacts lose: what a look at the forces would change.
_REMEMBERED = 'stretch', 'slopes', 'lost'


class RunSetup(NamedTuple):
    """Objects that all drivers of a run share."""

    scene: Scene
    packed: PackedScene
    inputs: Inputs
    thread_team: ThreadTeam
    broad_phase: BroadPhase | NoContacts
    obstruction: Obstruction
    # Called between two kernel calls, at the end of a step; an exception ends the advance there.
    on_pause: Callable[[], None]


class Start(NamedTuple):
    """State in which a driver starts, and the loads of that time."""

    time: float  # [s]
    state: State
    loads: Loads
    load_rate: float  # [rad/s]
    frequency: Frequency  # largest one of the fabric in this state


class Trajectory:
    """State that advances in steps, its loads, and the state that was saved last."""

    def __init__(
        self, setup: RunSetup, method: Method, start: Start, *, differences: int,
        control: EmbeddedControl | None
    ) -> None:
        """
        Begin at `start`; `control` belongs to steps that the kernel accepts or rejects.

        `differences` is the order of the differences that measure the roughness of the motion.
        """
        packed, state = setup.packed, start.state
        self.packed, self.model, self.method = packed, packed.model, method
        self.executor = method.executor
        self._state, self._loads = state, start.loads
        # Unit of errors of positions: a [m].
        self.thread_team, self.half_edge = setup.thread_team, setup.scene.geometry.half_edge
        self.broken = Broken(packed)
        # Of the inputs, which pack the loads; None: no anchor can break.
        self.anchor_breaks = setup.inputs.anchor_breaks
        # None if no expression ends or limits steps.
        self.changing = setup.inputs if setup.inputs.limits_steps else None
        # For evaluations of a state, which do not depend on the method.
        self._room_of: Without[Work] = Without('trail', 'breakage', 'external', 'kinks')
        self._forces_of: Without[Model] = Without(*BESIDE_ACCELERATIONS)
        self._springs = without(packed.model, 'bending', 'twisting', *BESIDE_CONNECTORS)
        self._work = packed.layout.room(
            packed.model.links, None if method.symplectic else state, differences=differences,
            damped=packed.model.damping is not None, metered=packed.spends)
        # Only this room has limits at which connectors break.
        self._work = self._work._replace(breakage=packed.breakage)
        if method.mends_kinks and packed.model.wrapping is None:
            self._work = self._work._replace(kinks=packed.layout.kinks(packed.model.links))
        if packed.external is not None:
            self._work = self._work._replace(
                given=packed.layout.meter(), external=packed.external)
        self.control = control
        # Steps of one length end at origin + index x step; 0: the step is not known yet.
        parameters = setup.scene.parameters
        self.origin, self.index, self.step = start.time, 0, parameters['solver.step']
        self.is_given = self.step > 0.0  # by `solver.step`
        self.step_count = 0
        self.evaluations = Evaluations()
        self.ledger = Ledger(packed, parameters['solver.energy_limit'])
        self.ledger.inverse_size = self.half_edge**-2
        self._saved = packed.layout.like(state)
        # Times [s] of the saved state, and of the one that is here: a device may have a later one.
        self._saved_time = self._saved_here = start.time
        # Energies that had flowed at a saved state, by name, when that was, and by which loads.
        self._flows: dict[str, np.ndarray] = {}
        self._flows_at: tuple[float, Loads | None] = math.nan, None
        self.failure: SimulationError | None = None

    @property
    def state(self) -> State:
        """Present state, for reading or modification."""
        self._take_over()
        return self._state

    @state.setter
    def state(self, state: State) -> None:
        self._take_over()
        self._state = state

    @property
    def saved(self) -> State:
        """State that was saved last."""
        if self.executor.has_saved:
            with self.or_lost():
                self._flows |= self.executor.gather_saved()
            self._saved_here = self._saved_time
        return self._saved

    @property
    def saved_time(self) -> float:
        """Time [s] of the saved state."""
        return self._saved_time

    @saved_time.setter
    def saved_time(self, time: float) -> None:
        self._saved_time = time
        if not self.executor.has_saved:
            self._saved_here = time

    @property
    def loads(self) -> Loads:
        """Loads, with the work that they have done."""
        self._take_over()
        return self._loads

    @loads.setter
    def loads(self, loads: Loads) -> None:
        self._take_over()
        self._loads = loads

    @property
    def work(self) -> Work:
        """Quantities computed from the state."""
        self._take_over()
        return self._work

    @work.setter
    def work(self, work: Work) -> None:
        self._take_over()
        self._work = work

    def for_steps(self) -> tuple[Loads, State, State, Work]:
        """
        Return loads, state, storage of the saved state, and work arrays, wherever the state is.

        Steps that continue the trajectory modify them.
        """
        return self._loads, self._state, self._saved, self._work

    def _take_over(self) -> None:
        if self.executor.is_remote:
            with self.or_lost():
                was_elsewhere = self.executor.gather()
            if was_elsewhere:
                # To go on from, should those who had it fail from here on.
                _ = self.saved

    @contextmanager
    def or_lost(self) -> Iterator[None]:
        """End the run if ranks or the device fail."""
        try:
            yield
        except ElsewhereError as error:
            self._lose_steps(error)

    def _lose_steps(self, error: ElsewhereError) -> NoReturn:
        """End the run at its saved state: later steps of ranks or a device are lost."""
        if self.executor.put_begun(self._saved):
            # Nothing has flowed by then.
            self._flows_at = math.nan, None
        # A later one was lost with them.
        self.saved_time = self._saved_here
        self.return_to_saved()
        self.fail(
            f'{error}; the last good state, of t = {self.saved_time:.9g} s, is kept')

    @property
    def velocity_spread(self) -> float:
        """Largest difference of the velocities of bodies [m/s], over all axes."""
        with self.or_lost():
            bounds = self.executor.bounds()
        if bounds is None:
            velocity = self.state.linear_velocity[:, self.packed.layout.slot]
            return float(np.linalg.norm(np.ptp(velocity, axis=1)))
        return float(np.linalg.norm(bounds[:3] + bounds[3:6]))

    @property
    def extent(self) -> float:
        """Largest coordinate of a body [m]."""
        with self.or_lost():
            bounds = self.executor.bounds()
        return float(np.abs(self.state.position).max()) if bounds is None else float(bounds[6])

    @property
    def order(self) -> int:
        """Order of the error of steps of one length."""
        if not has_jumps(self.model.links):
            return self.method.order
        return min(self.method.order, KINK_ORDER if self._work.kinks is not None else 2)

    @property
    def time(self) -> float:
        """Time [s] of the state, or of the start of a step in progress."""
        return self.time_of(self.index) if self.control is None else self.control.start

    def time_of(self, index: int) -> float:
        """Return the time [s] after `index` steps."""
        return self.origin + index * self.step if index else self.origin

    def begin_at(self, time: float) -> None:
        """Count steps of one length from `time` [s] on."""
        self.origin, self.index = time, 0

    def set_step(self, step: float) -> None:
        """Take steps of `step` [s] from the present time on."""
        self.begin_at(self.time)
        self.step = step

    def save(self, time: float | None = None) -> None:
        """Save the state, at the present or at a given `time` [s]."""
        with self.or_lost():
            is_saved = self.executor.save_run(self._saved)
        if not is_saved:
            copy_state(self.state, self.saved)
            # Under an embedded control each step keeps the work of loads where it begins.
            if self.control is None:
                np.copyto(self.loads.earlier_work, self.loads.work)
            self._save_stretches()
        self.note_saved(self.time if time is None else time)

    def note_saved(self, time: float) -> None:
        """Store the energies that have flowed until the present state, saved at `time` [s]."""
        self.saved_time, self._flows_at = time, (time, self._loads)
        if self.executor.has_saved:
            # What had flowed comes with it.
            return
        for name, values in self._flowing().items():
            kept = self._flows.get(name)
            if kept is None or kept.shape != values.shape:
                self._flows[name] = values.copy()
            else:
                np.copyto(kept, values)

    def restore(self) -> None:
        """Restore the saved state, but not its time."""
        copy_state(self.saved, self.state)
        losses = self.losses
        if losses is not None:
            np.copyto(losses.stretch, losses.saved)
        self.refresh()

    def return_to_saved(self) -> None:
        """Continue from the saved state, at its time."""
        self.restore()
        self._return_flows()
        self.begin_at(self.saved_time)
        if self.control is not None:
            self.control.start, self.control.length = self.saved_time, 0.0

    def _return_flows(self) -> None:
        """
        Restore meters if they are known, which requires that the kernel call ended at that state.
        """
        time, loads = self._flows_at
        if time == self.saved_time and loads is self.loads:
            for name, values in self._flowing().items():
                np.copyto(values, self._flows[name])

    def _flowing(self) -> dict[str, np.ndarray]:
        """Return the present work of the loads and readings of meters."""
        return {'work': self.loads.work} | {
            name: meter.done for name, meter in self.meters().items()}

    def return_work(self) -> None:
        """Restore the work of loads at the saved state."""
        _ = self.saved  # with which the work comes
        np.copyto(self.loads.work, self.loads.earlier_work)

    def refresh(
        self, time: float | None = None, model: Model | None = None, step: float | None = None
    ) -> None:
        """
        Compute the accelerations of the state, of the present or of a `time` [s].

        A trial has another `model`, with its friction springs, and another `step` [s].
        """
        model = model or self.model
        last = len(model.blocks.slot)
        self.evaluations.add()
        self.place_points()
        losses = contact_losses(model.contacts)
        if self._loses(model) and losses is not None:
            losses.lead[:] = 0.0
            touch_ahead(
                losses, model.contacts, self.state, model.inverse_mass, model.inverse_inertia,
                0.0, self.step if step is None else step, self.thread_team.alone())
        elif model.contacts is not None:
            touch_all(
                model.contacts, self.state.position, self.state.orientation,
                self.thread_team.alone())
        keep_accelerations(
            self._forces_of(model), self.state, self._room_of(self.work),
            self.time if time is None else time, 0, last)

    def place_points(self, state: State | None = None) -> None:
        """Compute the attachment points of the present state, or of a given one."""
        place_all(
            self._springs, self.state if state is None else state, self._room_of(self.work), 0,
            len(self._springs.blocks.slot))

    def refresh_places(self, *, anew: bool = False) -> None:
        """
        Refresh, but keep friction springs, and accelerations unless `anew`.
        """
        losses, acceleration = self.losses, self.work.acceleration.copy()
        kept = {} if losses is None else {
            name: getattr(losses, name).copy() for name in _REMEMBERED}
        self.refresh()
        if not anew:
            np.copyto(self.work.acceleration, acceleration)
        for name, values in kept.items():
            np.copyto(getattr(losses, name), values)

    def _loses(self, model: Model) -> bool:
        """Return True if contacts dissipate in steps that begin with earlier forces."""
        return self.method.symplectic and contact_losses(model.contacts) is not None

    def set_contacts(self, contacts: Contacts | None) -> None:
        """Evaluate only these contacts from now on."""
        self.model = self.model._replace(contacts=contacts)
        self.thread_team.prepare_contacts(contacts is not None)

    @property
    def losses(self) -> ContactLosses | None:
        """Friction and damping of the evaluated contacts, if any."""
        return contact_losses(self.model.contacts)

    def stretches(self, model: Model | None = None) -> np.ndarray | None:
        """Return the stretches of friction springs of the state, or of the `model` of a trial."""
        losses = contact_losses((model or self.model).contacts)
        return None if losses is None else losses.stretch

    def place_driven(self) -> None:
        """Set driven bodies to the poses of their paths."""
        if self._loads.drives is not None:
            place_driven(
                without(self.model, *TERMS), without(self.loads, *BESIDE_DRIVES), self.state,
                self.time)

    def state_at_paths(self, time: float) -> State:
        """Return a copy of the state with driven bodies on their present paths at `time` [s]."""
        state = copied_state(self.state)
        if self._loads.drives is not None:
            place_driven(
                without(self.model, *TERMS), without(self.loads, *BESIDE_DRIVES), state, time)
        return state

    def clear_meters(self) -> None:
        """Reset all meters."""
        if self._work.spent is not None or self._work.given is not None:
            for meter in self.meters().values():
                meter.done[:] = 0.0

    def meters(self) -> dict[str, Meter]:
        """Return meters of energy dissipated by velocities and of a body force, by name."""
        meters = {'spent': self.work.spent, 'given': self.work.given}
        return {name: meter for name, meter in meters.items() if meter is not None}

    def fail(self, message: str) -> NoReturn:
        """End the run: no step is taken until the state jumps."""
        self.failure = SimulationError(message)
        raise self.failure

    def require_sound(self) -> None:
        """Raise the failure that has ended the run, if any."""
        if self.failure is not None:
            raise self.failure

    def require_body_force(self) -> None:
        """End the run at its saved state if a body force has failed."""
        reason = self.take_force_failure()
        if reason is None:
            return
        self.return_to_saved()
        self.fail(f'{reason}; the last good state, of t = {self.saved_time:.9g} s, is kept')

    def take_force_failure(self) -> str | None:
        """Return why a body force has failed since the last call; None without failure."""
        packed = self.packed
        if packed.external is None or packed.body_force is None or not packed.external.status[0]:
            return None
        reason = packed.body_force.explain(packed.external)
        packed.external.status[0] = 0
        return reason

    def state_tree(self) -> dict[str, Any]:
        """Return the data that later steps depend on, by body."""
        tree: dict[str, Any] = {
            'origin': self.origin,
            'index': self.index,
            'step': self.step,
            'step_count': self.step_count,
            'evaluations': self.evaluations.state_tree(),
            'saved_time': self.saved_time,
            'state': self.by_body(self.state),
            'saved': self.by_body(self.saved),
            'ledger': self.ledger.state_tree(),
        }
        if self.failure is not None:
            tree['failure'] = str(self.failure)
        if self._keeps_accelerations:
            tree['acceleration'] = self.packed.layout.gather_moving(self.work.acceleration)
        if self.losses is not None and self._loses(self.model):
            tree['contact_losses'] = self.packed.layout.gather_moving(self.losses.lost)
        if len(self.loads.wrench):
            rows = self.rows_by_body(self.loads)
            tree['loads'] = {
                'work': self.loads.work[rows], 'earlier_work': self.loads.earlier_work[rows]}
        for name, meter in self.meters().items():
            tree[name] = self.packed.layout.gather_moving(meter.done)
        if self.broken.count:
            tree['broken'] = self.broken.state_tree()
        return tree

    def load_state(self, tree: StateTree, loads: Loads) -> None:
        """Restore the trajectory, with the `loads` of that time; accelerations follow."""
        slots = self.packed.layout.moving_slots
        self.origin = tree.number('origin', 0.0)
        self.failure = SimulationError(tree.text('failure')) if 'failure' in tree else None
        self.index, self.step_count = tree.count('index'), tree.count('step_count')
        self.step = step = tree.number('step', 0.0)
        # A run that has ended may have failed to find one.
        if self.failure is None and not self.time + step > self.time:
            raise ValueError(f'step {step!r} s leads nowhere from t = {self.time!r} s')
        # What had flowed until then is not known.
        self.saved_time, self._flows_at = tree.number('saved_time', 0.0), (math.nan, None)
        self.broken.load_state(tree.part('broken') if 'broken' in tree else None)
        for name, state in (('state', self.state), ('saved', self.saved)):
            self.take_back(state, tree.part(name))
        self.ledger.load_state(tree.part('ledger'))
        self.loads = loads
        if len(loads.wrench):
            part, rows = tree.part('loads'), self.rows_by_body(loads)
            loads.work[rows] = part.array('work', rows.shape)
            loads.earlier_work[rows] = part.array('earlier_work', rows.shape)
        for name, meter in self.meters().items():
            meter.done[:, slots] = tree.array(name, (len(slots), 2)).T

    def load_accelerations(self, tree: StateTree) -> None:
        """Restore the accelerations, after the contacts."""
        # Also where there are no bodies: what was there may not be finite.
        self.refresh_places(anew=True)
        slots, losses = self.packed.layout.moving_slots, self.losses
        if losses is not None and self._loses(self.model):
            losses.lost[:, slots] = tree.array('contact_losses', (len(slots), 6)).T
        if self._keeps_accelerations:
            self.work.acceleration[:, slots] = tree.array('acceleration', (len(slots), 6)).T

    def by_body(self, state: State) -> dict[str, Any]:
        """Return the arrays of a state by name, bodies first."""
        gather = self.packed.layout.gather_moving
        return {
            name: gather(values) for name, values in state._asdict().items()
            if values is not None}

    def take_back(self, state: State, tree: StateTree) -> None:
        """Write a state from a checkpoint; slots without a body are at rest at the origin."""
        layout, slots = self.packed.layout, self.packed.layout.moving_slots
        for name, target in state._asdict().items():
            if target is None:
                continue
            rows = target.shape[:-1]
            values = tree.array(name, (len(slots), *rows))
            empty = np.zeros(rows)
            if name == 'orientation':
                empty = np.eye(3) if layout.cosines else np.array([0.0, 0.0, 0.0, 1.0])
            target[:] = empty[..., None]
            target[..., slots] = np.moveaxis(values, 0, -1)

    def rows_by_body(self, loads: Loads) -> np.ndarray:
        """
        Return indices of loaded lanes in the work of the loads, by body and by wrench.

        The order does not depend on the layout: lanes without a wrench are left out.
        """
        layout, slots = self.packed.layout, self.packed.layout.moving_slots
        body = np.zeros(layout.slot_count, np.int64)
        body[slots] = np.arange(len(slots))
        row, lane = acting_lanes(loads)
        block = np.repeat(layout.blocks.slot, np.diff(loads.start))
        order = np.lexsort((loads.wrench[row], body[block[row] + lane]))
        return (LANES * row + lane)[order]

    @property
    def _keeps_accelerations(self) -> bool:
        """
        True if a step begins with a kick by the forces of the step before.
        """
        return len(self.method.kicks) > len(self.method.drifts)

    def _save_stretches(self) -> None:
        losses = self.losses
        if losses is not None:
            np.copyto(losses.saved, losses.stretch)
