# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Data of a fabric on a rank other than the first, for splitting steps: window and states."""

from functools import cached_property
from typing import Any

from icofabric_sim.kernels.records import Loads, State, Work
from icofabric_sim.simulation.devices.beside import (
    AHEAD,
    bodies_of,
    bounds_of_state,
    fastest_square,
    HALF,
    meter_room,
    squares_apart,
)
from icofabric_sim.simulation.devices.executor import Interval
from icofabric_sim.simulation.devices.held_window import Surroundings
from icofabric_sim.simulation.devices.near_pairs import NearPairs
from icofabric_sim.simulation.devices.part_iteration import PartIteration
from icofabric_sim.simulation.devices.part_steps import Arrays, PartSteps, Weights
from icofabric_sim.simulation.devices.saved_part import SavedPart
from icofabric_sim.simulation.devices.shared_contacts import look_at, remembered_by, wake
from icofabric_sim.simulation.devices.slot_rows import SlotRows, tables_of
from icofabric_sim.simulation.devices.transport import Transport
from icofabric_sim.simulation.devices.window import resting, Window
from icofabric_sim.simulation.model.layout import (
    aligned_empty,
    aligned_zeros,
    copied_state,
    kinks_room,
)
import numpy as np


class HeldPart:
    """Window of a rank with the states of a run and of its trials."""

    def __init__(self, transport: Transport, window: Window, weights: Weights) -> None:
        """Allocate both states."""
        self._transport = transport
        slot, exchange = window.model.blocks.slot, window.exchange
        self._steps = PartSteps(transport, window.model, exchange, weights)
        self._rows = SlotRows(slot[exchange.first:exchange.last])
        self._states = _states_of(window, weights)  # by whether it is the run's
        # Of trial steps that are judged where they are, once there are some.
        self._beside: dict[str, tuple[State, Work]] = {}
        self._blocks = window.model.blocks
        self._loads: Loads | None = None
        self._works: dict[bool, np.ndarray] = {}
        self._around = Surroundings(window)
        self._saved = SavedPart(self._rows)
        self._iteration: PartIteration | None = None

    def contacts(self, near: NearPairs | None) -> None:
        """Use these candidate pairs."""
        self._around.take_pairs(near)

    def loads(self, loads: Loads | None) -> None:
        """Use these loads."""
        self._loads = loads
        if loads is not None:
            self._works = {True: loads.work, False: np.zeros_like(loads.work)}

    def watch(self, frame: np.ndarray) -> None:
        """Record displacements from the present poses."""
        self._around.watch_from(self._states[True][0], frame)

    def scatter(self, of_run: bool, frame: np.ndarray | None) -> None:
        """Receive the state from the first rank."""
        loads, state, work, contacts, watch = self._arrays(of_run)
        tables = tables_of(state, work, contacts, whole=True)
        if watch is not None:
            tables += [watch.reference, watch.turned]
            watch.frame[:] = frame
            watch.far[0] = 0.0
        self._rows.receive(self._transport, tables, 0)
        more = [] if loads is None else [loads.work]
        more += remembered_by(contacts)
        if of_run:
            more += list(self._steps.difference)
        self._transport.wait([self._transport.receive(row, 0) for row in more])
        if contacts is not None:
            wake(contacts, slice(None), remembered_by(contacts))
        self._steps.roughest = 0.0

    def take(self, interval: Interval) -> None:
        """Take the steps of an interval."""
        arrays = self._arrays(interval.is_checked, interval.beside)
        self._steps.take(arrays, interval)
        if interval.is_watched:
            requests = [self._transport.send(look_at(arrays.contacts, arrays.watch), 0)]
            if interval.is_guarded and arrays.contacts is not None:
                own = self._steps.blocks
                requests.append(self._transport.send(arrays.contacts.pushes[own], 0))
            self._transport.wait(requests)

    def begin_trial(self) -> None:
        """Start trial steps at the state of the run."""
        if AHEAD not in self._beside:
            # Only one kind of trials goes on at a time.
            self._beside = {AHEAD: _copied(*self._states[True]), HALF: self._states[False]}
        _copy(self._states[True], self._beside[AHEAD])

    def branch_trial(self) -> None:
        """Start trial steps of half the length at the state of the others."""
        _copy(self._beside[AHEAD], self._beside[HALF])

    def trial_distance(self) -> None:
        """Send the distance of both trials to the first rank."""
        (ahead, _), (half, _) = self._beside[AHEAD], self._beside[HALF]
        self._answer(squares_apart(ahead, half, self._rows))

    def bounds(self) -> None:
        """Send the bounds of velocities and positions of the run to the first rank."""
        self._answer(bounds_of_state(self._states[True][0], self._bodies))

    @cached_property
    def _bodies(self) -> np.ndarray:
        """Slots of the bodies of this rank."""
        own = self._steps.blocks
        return bodies_of(self._blocks, own.start, own.stop)

    def _answer(self, numbers: np.ndarray) -> None:
        self._transport.wait([self._transport.send(numbers, 0)])

    def examine(self, time: float, limit: float, inside: bool) -> None:
        """Send the figures of a health check to the first rank."""
        figures = self._steps.examine(self._arrays(True), time, limit, inside=inside)
        self._answer(figures)

    def refresh(self, time: float) -> None:
        """Compute the accelerations of the run at `time` [s]."""
        self._steps.refresh(self._arrays(True), time)

    def squares(self, fall: np.ndarray) -> None:
        """Send sums of squared accelerations to the first rank."""
        self._answer(self._steps.squares(self._arrays(True).work, fall))

    def velocity_sums(self) -> None:
        """Send sums of velocities to the first rank."""
        self._answer(self._steps.velocity_sums(self._arrays(True)))

    def fastest_square(self, velocity: np.ndarray) -> None:
        """Send the largest squared velocity relative to `velocity` to the first rank."""
        self._answer(fastest_square(self._states[True][0], self._bodies, velocity))

    def begin_iteration(self) -> None:
        """Start an iteration for the largest frequency; send its first sums."""
        self._iteration = self._steps.iteration(self._arrays(True))
        self._rows.receive(self._transport, [self._iteration.start], 0)
        self._answer(self._iteration.bound())
        self._answer(self._iteration.square())

    def iterate(self, name: str, *numbers: float) -> None:
        """Continue the iteration; send the sums, if any."""
        found = getattr(self._iteration, name)(*numbers)
        if found is not None:
            self._answer(found)

    def end_iteration(self) -> None:
        """Discard the vectors of the iteration."""
        self._iteration = None

    def save(self) -> None:
        """Save the state and the work of loads."""
        loads, state, work, *_ = self._arrays(True)
        self._saved.save(state, work, None if loads is None else loads.work)

    def give_saved(self) -> None:
        """Send the saved state to the first rank."""
        self._saved.give(self._transport)

    def gather(self, of_run: bool, whole: bool) -> None:
        """Send the state to the first rank."""
        loads, state, work, contacts, watch = self._arrays(of_run)
        requests = self._rows.send(
            self._transport, tables_of(state, work, contacts, whole=whole), 0)
        more: list[Any] = [] if loads is None else [loads.work]
        more += [*remembered_by(contacts), look_at(contacts, watch)]
        if of_run:
            more.append(np.array([self._steps.take_roughest()]))
            if whole:
                more += list(self._steps.difference)
        requests += [self._transport.send(row, 0) for row in more]
        self._transport.wait(requests)

    def _arrays(self, of_run: bool, beside: str = '') -> Arrays:
        """Return the arrays that steps change."""
        state, work = self._beside[beside] if beside else self._states[of_run]
        loads = self._loads
        return Arrays(
            None if loads is None else loads._replace(work=self._works[of_run]), state, work,
            self._around.contacts.get(of_run), self._around.watch if of_run else None)


def _states_of(window: Window, weights: Weights) -> dict[bool, tuple[State, Work]]:
    states = {}
    points = np.zeros(0)
    if window.model.links is not None:
        points = aligned_zeros((18 * window.slot_count,))
    changes = np.array([
        (-1.0) ** k for k in range(weights.differences + 1)]) * weights.pascal
    # Nothing of them is kept from step to step.
    kinks = kinks_room(
        window.model.links, window.slot_count, len(window.model.blocks.slot)
    ) if weights.mends_kinks else None
    for of_run in (True, False):
        acceleration = aligned_zeros((6, window.slot_count))
        spent = None
        if window.spends:
            spent = meter_room(window.slot_count)
        # The points are placed anew in each evaluation, so both states share them.
        states[of_run] = resting(window.slot_count), Work(
            points, acceleration, aligned_empty((7, 0)), changes, window.figures_room(),
            window.group, aligned_empty((0,)), spent, given=None, trail=None, breakage=None,
            external=None, kinks=kinks)
    return states


def _copied(state: State, work: Work) -> tuple[State, Work]:
    """Return arrays for the same state and for the quantities computed from it."""
    spent = None if work.spent is None else meter_room(state.position.shape[1])
    acceleration = aligned_zeros(work.acceleration.shape)
    return copied_state(state), work._replace(acceleration=acceleration, spent=spent)


def _copy(source: tuple[State, Work], target: tuple[State, Work]) -> None:
    for (values, there) in zip(source[0].rows(), target[0].rows()):
        np.copyto(there, values)
    np.copyto(target[1].acceleration, source[1].acceleration)
