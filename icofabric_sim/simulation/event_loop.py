# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The event loop of a run: steps, and the wrenches between them, in order of time."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
import logging
import math
from typing import Any, TYPE_CHECKING

from icofabric_sim.kernels.records import Loads, State
from icofabric_sim.scene.initial import InitialState
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.contact.broad_phase import BroadPhase
from icofabric_sim.simulation.contact.friction_state import frequency_of
from icofabric_sim.simulation.errors import ElsewhereError, SimulationError
from icofabric_sim.simulation.inputs.input_types import Target, Value
from icofabric_sim.simulation.inputs.inputs import Inputs
from icofabric_sim.simulation.inputs.pulls import connected_mass
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
    """Where a run stands, what acts on it, and what will."""

    def __init__(
        self, scene: Scene, packed: PackedScene, *,
        on_pause: Callable[[], None], ranks: 'Transport | None' = None,
        device: 'Device | None' = None
    ) -> None:
        """
        Stand at the start of the `scene`; see `compile_scene` and `Driver`.

        `ranks`: processes that take the steps together; `device`: what takes them, if not this
        process.
        """
        self._scene, self._packed = scene, packed
        self.time = 0.0  # [s] that was asked for last
        self.inputs = Inputs(scene)
        # Grows with whatever changes the state that is seen.
        self.changes = 0
        self._stale_loads = False
        # When a step has to end for an input that was taken already [s]; infinite: no step has.
        self._cut_due = math.inf
        parameters = scene.parameters
        # Name of the method in METHODS, and the reason for it.
        self.method = Choice(parameters['solver.method'], 'given as solver.method')
        is_chosen = self.method.name == 'auto'
        loads, half_edge = self._loads(), scene.geometry.half_edge
        apart = None
        if ranks is not None:
            from icofabric_sim.simulation.devices.shared_start import begin_apart
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
            # Any method can, but those with steps of one length err by these.
            required = Choice(
                ADAPTIVE, 'connectors around their shells change to other geodesics, and only '
                'steps that adapt see where')
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
                bent=bool(scene.connectors.tables.tables),
                strain=expected_strain(scene, liveliness, frequency.rate),
                contact='' if packed.contact is None else packed.contact.expected,
                losses=contact_losses(scene),
                loose=0 if scene.connector_count else possible,
                woven=possible if scene.connector_count else 0,
                is_dense=packed.contact is not None and packed.contact.is_dense,
                damped=parameters['contact.damping'] * liveliness * half_edge,
                among=self._methods_for(device))
            # With the room that this method needs.
            loads = self._loads()
        method = facts_of(self.method.name)
        if fixed > 0.0:
            self.inputs.timetable.follow(fixed, method.order, method.stability)
        # Each rank takes its steps by one thread, a device takes all of them, and what implicit
        # steps take most of their time for, to solve, is done by one.
        is_shared = ranks is None and device is None and not method.implicit
        team = ThreadTeam(parameters['solver.threads'], packed, is_shared=is_shared)
        self._setup = RunSetup(
            scene, packed, self.inputs, team,
            None if packed.contact is None else BroadPhase(
                packed.contact, packed.layout, packed.model, team.size),
            Obstruction(parameters['connector.obstruction'], packed), on_pause)
        if method.symplectic and not fixed > 0.0:
            self._warn_of_jumps(runs_through_contacts=method.runs_through_contacts)
        # Makes a method by its name.
        self._method_of: Callable[..., Method] = facts_of
        # The method of the start, and the one that takes over from it once shells are near each
        # other; None: none does.
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
        # Part of their length that connectors are expected to change by in a radian of the fastest
        # vibration, where steps do not follow it; 0 where they do.
        self.strain = 0.0
        if fixed > 0.0 or not method.adaptive:
            self.strain = expected_strain(scene, self._liveliness(frequency.rate), frequency.rate)
        if self.near_method is not None:
            self.method = self._first = self.method._replace(
                reason=f'{self.method.reason}; {self.near_method.name} goes on once shells are '
                'near each other')
        try:
            self.driver = self._make_driver(method, state, loads, frequency)
            self._follow_contacts()
        except SimulationError as error:
            raise ValueError(f'this scene cannot start: {error}') from error

    def _methods_for(self, device: 'Device | None') -> tuple[str, ...]:
        """Names of the methods among which `auto` chooses."""
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
        """Name of the method of steps in which something touches."""
        return (self.near_method or self.method).name

    def is_ready(self) -> bool:
        """Whether nothing need be compiled for steps, whatever comes."""
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
        """Have the method `name` take the steps, where this run has it and another one does."""
        for choice in (self._first, self.near_method):
            if choice is not None and choice.name == name != self.method.name:
                self._change_method(choice, self.driver.trajectory.state)
                return

    def _follow_contacts(self) -> bool:
        """Have another method go on where this one is none for contacts; whether it is so."""
        if not self.driver.is_near_contact:
            return False
        assert self.near_method is not None
        time = self.driver.time
        self._change_method(self.near_method._replace(
            reason=f'{self.near_method.reason}: as of t = {time:.6g} s'),
            self.driver.trajectory.state)
        return True

    def _change_method(self, choice: Choice, state: State) -> None:
        """Go on from a `state` where the present steps have come to, by another method."""
        before, was, now = self.driver, self.method, self.time
        self.method, self.time = choice, before.time
        if self._setup.broad_phase is not None:
            # Methods that run through contacts say otherwise themselves.
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
        """Say where forces are expected to jump, which chosen steps of one length pay for."""
        packed = self._packed
        # contact.mode always says when to look for contacts, not that there will be some; and
        # kernels are compiled ahead with it.
        if (packed.contact is not None and packed.contact.expected and not runs_through_contacts
                and self._scene.parameters['contact.mode'] == 'auto'):
            _LOGGER.warning(
                'solver.method %s has steps of one length, which may add more than '
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
        """Go on to `time` [s], with all wrenches that begin or end by then."""
        self._handle_events(time)
        self._reach(time)

    def take_step(self, most: int, pause: Callable[[], None]) -> None:
        """
        Take at least one step and at most so many; an input that acts ends a step, which counts.

        After `settle_inputs`.
        """
        due = self.inputs.next_time
        self.settle_loads()
        try:
            done = self.driver.advance_steps(most, until=due)
            self._follow_contacts()
            pause()
        except SimulationError:
            self.time = -math.inf  # the last good state may be older
            raise
        finally:
            self.time = max(self.time, self.driver.time)
            self.changes += 1
        if done == 0:
            self._handle_events(due)
            self.settle_inputs()

    def state(self) -> State:
        """
        The state at the present time; after a failure the last good one, whose time it is then.
        """
        with self._at_last_good_state():
            return self.driver.state_at(self.time)

    def apply(self, target: Target, value: Value, time: float) -> None:
        """Let an input act from `time` [s] on, now or later."""
        self.inputs.put(time, target, value)
        if time == self.time:
            self._handle_events(time)

    def jump(self, state: InitialState, rest: np.ndarray | None = None) -> None:
        """
        Go on from another state at the present time.

        Springs of Maxwell arms rest at lengths `rest` [m], (c,), or as in that state.
        """
        self.changes += 1
        self._stale_loads, self._cut_due = False, math.inf
        packed = self._packed.pack(state, rest)
        if self.method.name != self._first.name:
            # As a run that begins there.
            self._change_method(self._first, packed)
        loads = self._loads()
        self.driver.jump(self.time, packed, loads, self._load_rate(loads))
        self._follow_contacts()

    def begin_at(self, time: float) -> None:
        """Move an event loop that has not begun to another `time` [s]; what acts may be new."""
        self.time = time
        self.changes += 1
        self.driver.rebase(time)
        self._stale_loads = True
        self.settle_loads()

    def renew_loads(self) -> None:
        """What acts has changed, without an input."""
        self._stale_loads = True

    def settle_loads(self) -> None:
        """Give the driver what acts now: once, however many wrenches have changed at this time."""
        if self._stale_loads:
            loads = self._loads()
            self._stale_loads = False
            self.driver.set_loads(loads, self._load_rate(loads))

    def state_tree(self) -> dict[str, Any]:
        """All that what is to come depends on, but for the time."""
        return {
            'stale_loads': self._stale_loads,
            'cut_due': self._cut_due,
            'inputs': self.inputs.state_tree(),
            'stepper': self.driver.state_tree(),
        }

    def load_state(self, tree: StateTree, time: float) -> None:
        """Go on from there at `time` [s]; after a ValueError only another `load_state` helps."""
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
        """Have what acts from the present time on begin: time is about to go on."""
        self._cut()
        if self.inputs.pulls_are_next and self.inputs.next_time <= self.time:
            self._pull(self.time)

    def _handle_events(self, until: float) -> None:
        """
        Let happen what does so by `until` [s].

        Steps end at the inputs of that very time once time goes on: so a time that was shown keeps
        its state, whatever begins to act then.
        """
        # Reached before it is taken out: an interrupt on the way loses nothing.
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
        End the step in progress where an input that was taken `before` a time [s] asks for it.

        Where the kernels for that are awaited, it is still due when time goes on.
        """
        if self._cut_due < before:
            self._settle_loads_before(self._cut_due)
            self._end_step(self._cut_due)
            self._cut_due = math.inf
            self._stale_loads = True
            self.changes += 1

    def _pull(self, time: float) -> None:
        """Compute the forces of the pulls at `time` [s], and when they are due again."""
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
        """On a failure, set the time to that of the last good state, which may be earlier."""
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
        """What acts now, for the kernels; `again`: what they had last."""
        # While the method is being chosen: rows without room for Runge-Kutta stages.
        symplectic = self.method.name == 'auto' or facts_of(self.method.name).symplectic
        pack = self.inputs.pack_again if again else self.inputs.pack
        return pack(self._packed.layout, stages=0 if symplectic else 16)
