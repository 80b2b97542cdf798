# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Event loop of a run: steps, and the inputs between them, in order of time."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
import logging
import math
from typing import Any, TYPE_CHECKING

from icofabric_sim.kernels.integrators.tableau import SLOPE_COUNT
from icofabric_sim.kernels.records import Loads, State
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.contact.broad_phase import BroadPhase, NoContacts
from icofabric_sim.simulation.contact.friction_state import frequency_of
from icofabric_sim.simulation.errors import ElsewhereError, SimulationError
from icofabric_sim.simulation.inputs.input_types import Target, Value
from icofabric_sim.simulation.inputs.inputs import Inputs
from icofabric_sim.simulation.inputs.pulls import connected_mass
from icofabric_sim.simulation.model.body_force import set_profiles
from icofabric_sim.simulation.model.packing import (
    expected_liveliness,
    expected_strain,
    load_rate,
    PackedScene,
)
from icofabric_sim.simulation.model.stability import Frequency, largest_frequency, with_anchors
from icofabric_sim.simulation.stepping.driver import Driver
from icofabric_sim.simulation.stepping.faults import stiffest_term, too_fast
from icofabric_sim.simulation.stepping.method_needs import (
    ADAPTIVE,
    contact_losses,
    is_damped,
    required_method,
    why_not_implicit,
)
from icofabric_sim.simulation.stepping.method_selection import (
    Choice,
    choose_method,
    for_damping,
    method_near_contact,
)
from icofabric_sim.simulation.stepping.methods import facts_of, Method, METHODS
from icofabric_sim.simulation.stepping.obstruction import Obstruction
from icofabric_sim.simulation.stepping.thread_team import ThreadTeam
from icofabric_sim.simulation.stepping.trajectory import RunSetup, Start
from icofabric_sim.simulation.stepping.uniform_stepping import latest_end
import numpy as np

if TYPE_CHECKING:
    from icofabric_sim.simulation.devices.gpu.opening import Device
    from icofabric_sim.simulation.devices.transport import Transport

_LOGGER = logging.getLogger('icofabric_sim')


class EventLoop:
    """State of a run, its present and later inputs, and the driver of its steps."""

    def __init__(
        self, scene: Scene, packed: PackedScene, *,
        on_pause: Callable[[], None], ranks: 'Transport | None' = None,
        device: 'Device | None' = None
    ) -> None:
        """
        Start at the initial state of the `scene`; see `compile_scene` and `Driver`.

        `ranks` are processes that share the steps; `device` is a GPU that computes them.
        """
        self._scene, self._packed = scene, packed
        self.time = 0.0  # [s] requested last
        self.inputs = Inputs(scene)
        # Counts all changes of the visible state.
        self.changes = 0
        self._stale_loads = False
        # Time [s] at which an applied input ends a step; infinite: none.
        self._cut_due = math.inf
        parameters = scene.parameters
        # Name of the method in METHODS, and the reason for it.
        self.method = Choice(parameters['solver.method'], 'given as solver.method')
        is_chosen = self.method.name == 'auto'
        loads, half_edge = self._loads(), scene.geometry.half_edge
        apart = None
        if ranks is not None:
            from icofabric_sim.simulation.devices.shared_method import begin_apart
            try:
                apart = begin_apart(ranks, packed, scene.initial, loads, half_edge=half_edge)
            except ElsewhereError as error:
                raise ValueError(f'this scene cannot start: {error}') from error
        if apart is None:
            unpacked, state = None, packed.pack(scene.initial)
            frequency = with_anchors(
                largest_frequency(packed, state), packed, loads, state, self.time)
        else:
            unpacked, frequency = apart
            state = unpacked.state
        if not frequency.rate < math.inf:
            fastest = stiffest_term(packed, anchored=bool(scene.anchors))
            raise ValueError(f'this scene cannot start: {too_fast(self.time, fastest)}')
        fixed = parameters['solver.step']
        required = required_method(scene, outside=packed.external is not None)
        if self.method.name == 'auto' and required is None and packed.model.wrapping is not None:
            # Any method works, but fixed steps have errors at these changes.
            required = Choice(
                ADAPTIVE, 'connectors around their shells change to other geodesics, and only '
                'adaptive steps resolve these changes')
        if self.method.name == 'auto' and required is not None:
            stiff = None
            if is_damped(scene) and not fixed > 0.0 and not (
                    why_not_implicit(scene, outside=packed.external is not None)):
                contact = packed.contact
                stiff = for_damping(
                    parameters['solver.tolerance'], frequency.rate, packed.velocity_rate,
                    scene.body_count,
                    touching=0.0 if contact is None or not contact.expected else (
                        frequency_of(packed.model, contact)))
            self.method = stiff or required
            loads = self._loads()
        elif self.method.name == 'auto':
            liveliness = self._liveliness(frequency.rate)
            possible = 0 if packed.contact is None else scene.body_count
            self.method = choose_method(
                parameters['solver.tolerance'],
                liveliness,
                fixed_ratio=fixed * frequency.rate if fixed > 0.0 else None,
                kinks=scene.connectors.laws.kink_count(scene.connector_count),
                bent=scene.connectors.curves.has_corners,
                strain=expected_strain(scene, liveliness, frequency.rate),
                contact='' if packed.contact is None else packed.contact.expected,
                losses=contact_losses(scene),
                loose=0 if len(scene.woven) else possible,
                woven=possible if len(scene.woven) else 0,
                is_dense=packed.contact is not None and packed.contact.is_dense,
                damped=parameters['contact.damping'] * liveliness * half_edge,
                among=self._methods_for(device))
            # With the arrays that this method needs.
            loads = self._loads()
        method = facts_of(self.method.name)
        if fixed > 0.0:
            self.inputs.timetable.follow(fixed, method.order, method.stability)
        # A rank has one thread, a device computes whole steps, and the linear solves that dominate
        # implicit steps are serial.
        is_shared = ranks is None and device is None and not method.implicit
        team = ThreadTeam(parameters['solver.threads'], packed, is_shared=is_shared)
        self._setup = RunSetup(
            scene, packed, self.inputs, team,
            NoContacts() if packed.contact is None else BroadPhase(
                packed.contact, packed.layout, packed.model, team.size),
            Obstruction(parameters['connector.obstruction'], packed), on_pause)
        if method.symplectic and not fixed > 0.0:
            self._warn_of_jumps(runs_through_contacts=method.runs_through_contacts)
        # Returns a method by its name.
        self._method_of: Callable[..., Method] = facts_of
        # The initial method, and the method once shells are near each other; None: the same.
        self._first, self.near_method = self.method, None
        if is_chosen and not fixed > 0.0:
            self.near_method = method_near_contact(
                self.method, is_possible=packed.contact is not None,
                is_expected=bool(contact_losses(scene)) or (
                    packed.contact is not None and bool(packed.contact.expected)))
        is_estimated = parameters['solver.error_estimate']
        if ranks is not None:
            from icofabric_sim.simulation.devices.shared_method import shared_method
            self._method_of = partial(
                shared_method, ranks, packed, given=fixed > 0.0, estimated=is_estimated,
                half_edge=half_edge)
            method = self._method_of(self.method.name, unpacked=unpacked)
        elif device is not None:
            from icofabric_sim.simulation.devices.gpu.steps import device_method
            self._method_of = partial(
                device_method, device, packed, given=fixed > 0.0, estimated=is_estimated)
            method = self._method_of(
                self.method.name, later='' if self.near_method is None else self.near_method.name)
        elif method.implicit:
            from icofabric_sim.simulation.stepping.implicit import implicit_method
            method = implicit_method(scene, packed, self.method.name)
        # Expected relative change of connector lengths within a radian of the fastest vibration;
        # 0 if steps adapt to it.
        self.strain = 0.0
        if fixed > 0.0 or not method.adaptive:
            self.strain = expected_strain(scene, self._liveliness(frequency.rate), frequency.rate)
        if self.near_method is not None:
            self.method = self._first = self.method._replace(
                reason=f'{self.method.reason}; {self.near_method.name} takes over once shells '
                'are near each other')
        try:
            self.driver = self._make_driver(method, state, loads, frequency)
            self._follow_contacts()
        except SimulationError as error:
            raise ValueError(f'this scene cannot start: {error}') from error

    def _methods_for(self, device: 'Device | None') -> tuple[str, ...]:
        """Return the names of the methods from which `auto` chooses."""
        if device is None:
            return tuple(METHODS)
        from icofabric_sim.simulation.devices.refusals import methods_on_device
        return methods_on_device(self._scene)

    def _make_driver(
        self, method: Method, state: State, loads: Loads, frequency: Frequency, *,
        takes_steps: bool = True
    ) -> Driver:
        """Return a driver that takes the steps of a method from the present time on."""
        return Driver(
            self._setup, method,
            Start(self.time, state, loads, self._load_rate(loads), frequency),
            leaves_contacts=(
                self.near_method is not None and self.method.name == self._first.name),
            takes_steps=takes_steps)

    @property
    def touching_method(self) -> str:
        """Name of the method for steps with contacts."""
        return (self.near_method or self.method).name

    def is_ready(self) -> bool:
        """Return True if all kernels for steps are compiled."""
        if not self.driver.is_ready():
            return False
        if self.near_method is None or self.method.name != self._first.name:
            return True
        before, self.method = self.method, self.near_method
        try:
            return self._make_driver(
                facts_of(self.method.name), self.driver.trajectory.state, self._loads(again=True),
                self.driver.rates.frequency, takes_steps=False).is_ready()
        finally:
            self.method = before

    def take_method(self, name: str) -> None:
        """Switch to the method `name` if it is another method of this run."""
        for choice in (self._first, self.near_method):
            if choice is not None and choice.name == name != self.method.name:
                self._change_method(choice, self.driver.trajectory.state)
                return

    def _follow_contacts(self) -> bool:
        """
        Switch to the method for contacts if shells are near each other; return True if switched.
        """
        if not self.driver.is_near_contact:
            return False
        assert self.near_method is not None
        time = self.driver.time
        self._change_method(self.near_method._replace(
            reason=f'{self.near_method.reason}: as of t = {time:.6g} s'),
            self.driver.trajectory.state)
        return True

    def _change_method(self, choice: Choice, state: State) -> None:
        """Continue by another method from a `state` that the present steps have reached."""
        before, was, now = self.driver, self.method, self.time
        self.method, self.time = choice, before.time
        # Methods that run through contacts change this flag themselves.
        self._setup.broad_phase.counts_listed = True
        try:
            after = self._make_driver(
                self._method_of(choice.name), state, self._loads(again=True),
                before.rates.frequency)
        except BaseException:
            self.method = was
            raise
        finally:
            self.time = now
        after.continue_from(before)
        self.driver = after
        self.changes += 1

    def _warn_of_jumps(self, *, runs_through_contacts: bool) -> None:
        """Warn if jumps of forces are expected, at which steps of fixed length lose accuracy."""
        packed = self._packed
        # contact.mode always does not imply that contacts are expected; it also serves to compile
        # kernels ahead.
        if (packed.contact is not None and packed.contact.expected and not runs_through_contacts
                and self._scene.parameters['contact.mode'] == 'auto'):
            _LOGGER.warning(
                'solver.method %s has steps of one length, whose errors may exceed '
                'solver.tolerance where shells touch, and %s; solver.method dop8 or auto '
                'shortens steps there', self.method.name, packed.contact.expected)
        if packed.model.wrapping is not None:
            _LOGGER.warning(
                'solver.method %s has steps of one length, and solver.tolerance may ask for '
                'hundreds of times as many where connectors around their shells change to other '
                'geodesics (connector.obstruction wrap), as forces jump there; solver.method dop8 '
                'or auto finds these moments', self.method.name)

    def _liveliness(self, frequency: float) -> float:
        strongest = self.inputs.pack_strongest(self._packed.layout)
        return expected_liveliness(self._scene, self._packed.model, strongest, frequency)

    def advance(self, time: float) -> None:
        """Advance to `time` [s], with all inputs that start or end by then."""
        self._handle_events(time)
        self._reach(time)

    def take_step(self, most: int, pause: Callable[[], None]) -> None:
        """
        Take at least one step and at most `most`; an input ends a step, which counts.

        Call `settle_inputs` before.
        """
        due = self.inputs.next_time
        self.settle_loads()
        try:
            done = self.driver.advance_steps(most, until=due)
            self._follow_contacts()
            pause()
        except SimulationError:
            self.time = -math.inf  # the last sound state may be older
            raise
        finally:
            self.time = max(self.time, self.driver.time)
            self.changes += 1
        if done == 0:
            self._handle_events(due)
            self.settle_inputs()

    def state(self) -> State:
        """
        Return the state at the present time; after a failure, the last sound state at its time.
        """
        with self._at_last_good_state():
            return self.driver.state_at(self.time)

    def apply(self, target: Target, value: Value, time: float) -> None:
        """Apply an input from `time` [s] on, now or later."""
        self.inputs.put(time, target, value)
        if time == self.time:
            self._handle_events(time)

    def jump(self, state: InitialState, rest: np.ndarray | None = None) -> None:
        """
        Continue from another state at the present time.

        The springs of Maxwell arms have rest lengths `rest` [m], (c,), or are relaxed.
        """
        self.changes += 1
        self._stale_loads, self._cut_due = False, math.inf
        packed = self._packed.pack(state, rest)
        if self.method.name != self._first.name:
            # Like a run that starts from this state.
            self._change_method(self._first, packed)
        loads = self._loads()
        self.driver.jump(self.time, packed, loads, self._load_rate(loads))
        self._follow_contacts()

    def begin_at(self, time: float) -> None:
        """Move an unstarted event loop to another `time` [s], possibly with other loads."""
        self.time = time
        self.changes += 1
        self.driver.rebase(time)
        self._stale_loads = True
        self.settle_loads()

    def renew_loads(self) -> None:
        """Pack the loads again before the next step, after a change other than an input."""
        self._stale_loads = True

    def settle_loads(self) -> None:
        """Pass changed loads to the driver, once for all changes at the present time."""
        if self._stale_loads:
            loads = self._loads()
            self._stale_loads = False
            self.driver.set_loads(loads, self._load_rate(loads))

    def state_tree(self) -> dict[str, Any]:
        """Return the state that the future of the run depends on, without the time."""
        return {
            'stale_loads': self._stale_loads,
            'cut_due': self._cut_due,
            'inputs': self.inputs.state_tree(),
            'stepper': self.driver.state_tree(),
        }

    def load_state(self, tree: StateTree, time: float) -> None:
        """
        Continue from a state tree at `time` [s]; after a ValueError, only another call helps.
        """
        self.changes += 1
        self.inputs.load_state(tree.part('inputs'), time)
        self._stale_loads = tree.flag('stale_loads')
        self._cut_due = tree.number('cut_due', finite=False)
        if self._cut_due not in (time, math.inf):
            raise ValueError(
                f'cut_due must be its time {time!r} s or infinite, got {self._cut_due!r}')
        self.driver.load_state(tree.part('stepper'), self._loads(again=True))
        start, end = self.driver.time, self.driver.stepping.next_step_time
        if not start <= latest_end(time) or not time <= end:
            raise ValueError(
                f'its time {time!r} s is not in the step in progress, {start!r} to {end!r} s')
        self.time = time

    def settle_inputs(self) -> None:
        """Apply inputs at the present time, before time advances."""
        self._cut()
        if self.inputs.pulls_are_next and self.inputs.next_time <= self.time:
            self._pull(self.time)

    def _handle_events(self, until: float) -> None:
        """
        Apply all inputs until `until` [s].

        Steps end at the inputs of that time once time advances. So the state shown at a time does
        not change by inputs that start at this time.
        """
        # Advance before the input leaves the queue, so that an interrupt loses no input.
        while (time := self.inputs.next_time) <= until:
            self._cut(before=time)
            self._reach(time)
            if self.inputs.pulls_are_next:
                if time == until:
                    break
                self._cut()
                self._pull(time)
                continue
            if self.inputs.apply_next():
                self._cut_due = time
            self.changes += 1
        self._cut(before=until)

    def _cut(self, *, before: float = math.inf) -> None:
        """
        End the step in progress if an input `before` a time [s] requires it.

        While kernels for this are still compiling, the cut remains due.
        """
        if self._cut_due < before:
            self._settle_loads_before(self._cut_due)
            self._end_step(self._cut_due)
            self._cut_due = math.inf
            self._stale_loads = True
            self.changes += 1

    def _pull(self, time: float) -> None:
        """Compute the drag forces at `time` [s] and the time of their next update."""
        self._settle_loads_before(time)
        self._end_step(time)
        pulls, driver, layout = self.inputs.pulls, self.driver, self._packed.layout
        state = driver.state_at(time)

        def motion(body: int) -> tuple[np.ndarray, np.ndarray]:
            slot = layout.slot[body]
            return state.position[:, slot].copy(), state.linear_velocity[:, slot].copy()

        held = pulls.compute(
            time, motion, driver.rates.frequency.rate,
            lambda body: connected_mass(
                self._scene, driver.trajectory.broken.since, body))
        if held < math.inf:
            pulls.due = time + driver.whole_steps(held)
        if pulls.is_packed and not self._stale_loads:
            driver.set_last_forces(pulls.repack())
        else:
            self._stale_loads = True
        self.changes += 1

    def _end_step(self, time: float) -> None:
        """End the step in progress at `time` [s]."""
        with self._at_last_good_state():
            while not self.driver.cut(time):
                self._follow_contacts()
            self._follow_contacts()

    @contextmanager
    def _at_last_good_state(self) -> Iterator[None]:
        """On a failure, set the time to that of the last sound state, which may be earlier."""
        try:
            yield
        except SimulationError:
            self.time = self.driver.time
            self.changes += 1
            raise

    def _reach(self, time: float) -> None:
        try:
            with self._at_last_good_state():
                self._settle_loads_before(time)
                self.driver.advance(time)
                while self._follow_contacts():
                    self.driver.advance(time)
        except BaseException:
            self.time = max(self.time, self.driver.time)
            self.changes += 1
            raise
        if time != self.time:
            self.time = time
            self.changes += 1

    def _settle_loads_before(self, time: float) -> None:
        if time > self.driver.time:
            self.settle_loads()

    def _load_rate(self, loads: Loads) -> float:
        return load_rate(loads, self._packed.model, self._scene.geometry.cube_width)

    def _loads(self, *, again: bool = False) -> Loads:
        """Return the present loads for the kernels; `again` returns the loads packed last."""
        # During the choice of the method: rows without Runge-Kutta stages.
        symplectic = self.method.name == 'auto' or facts_of(self.method.name).symplectic
        pack = self.inputs.pack_again if again else self.inputs.pack
        loads = pack(self._packed.layout, stages=0 if symplectic else SLOPE_COUNT)
        packed = self._packed
        if packed.body_force is not None and packed.external is not None:
            set_profiles(
                packed.body_force, packed.external, self.inputs.expression_profiles())
        return loads
