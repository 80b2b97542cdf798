# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Data of a fabric on a rank other than the first, for splitting steps: window and states."""


from icofabric_sim.kernels.records import Loads, State, Work
from icofabric_sim.simulation.devices.beside import (
    AHEAD,
    HALF,
    meter_room,
    squares_apart,
)
from icofabric_sim.simulation.devices.executor import Interval
from icofabric_sim.simulation.devices.held import Held
from icofabric_sim.simulation.devices.part_iteration import PartIteration
from icofabric_sim.simulation.devices.part_steps import Arrays, PartSteps, Weights
from icofabric_sim.simulation.devices.shared_contacts import look_at
from icofabric_sim.simulation.devices.transport import Transport
from icofabric_sim.simulation.devices.window import resting, Window
from icofabric_sim.simulation.model.layout import (
    aligned_empty,
    aligned_zeros,
    copied_state,
    kinks_room,
)
import numpy as np


class HeldPart(Held):
    """Window of a rank with the states of a run and of its trials."""

    def __init__(self, transport: Transport, window: Window, weights: Weights) -> None:
        """Allocate both states."""
        super().__init__(
            transport, window, PartSteps(transport, window.model, window.exchange, weights))
        self._states = _states_of(window, weights)  # by whether it is the run's
        # Of trial steps that are judged where they are, once there are some.
        self._beside: dict[str, tuple[State, Work]] = {}
        self._loads: Loads | None = None
        self._works: dict[bool, np.ndarray] = {}
        self._iteration: PartIteration | None = None

    def loads(self, loads: Loads | None) -> None:
        """Use these loads."""
        self._loads = loads
        if loads is not None:
            self._works = {True: loads.work, False: np.zeros_like(loads.work)}

    def scatter(self, of_run: bool, frame: np.ndarray | None) -> None:
        """Receive the state from the first rank."""
        super().scatter(of_run, frame)
        self._steps.roughest = 0.0

    def _sampled(self) -> list[np.ndarray]:
        """Return differences of the motion in the samples of this rank."""
        return list(self._steps.difference)

    def _reported(self, whole: bool) -> list[np.ndarray]:
        """Return the largest roughness; `whole`: and differences of the motion."""
        return [np.array([self._steps.take_roughest()]), *(self._sampled() if whole else [])]

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

    def begin_iteration(self) -> None:
        """Start an iteration for the largest frequency; send its first sums."""
        self._iteration = self._steps.iteration(self._arrays(True))
        self._rows.receive(self._transport, [self._iteration.start], 0)
        self._answer(self._iteration.bound())
        self._answer(self._iteration.square())

    def iterate(self, name: str, *numbers: float) -> None:
        """Continue the iteration; send the sums, if any."""
        self._answer(getattr(self._iteration, name)(*numbers))

    def end_iteration(self) -> None:
        """Discard the vectors of the iteration."""
        self._iteration = None

    def _arrays(self, of_run: bool, beside: str = '') -> Arrays:
        """Return the arrays that steps change."""
        state, work = self._beside[beside] if beside else self._states[of_run]
        loads = self._loads
        return Arrays(
            None if loads is None else loads._replace(work=self._works[of_run]), state, work,
            self._contacts.get(of_run), self._watch if of_run else None)


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
