# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of a run, to be read only."""

import math
from typing import NoReturn

from icofabric_sim.checks import counted
from icofabric_sim.simulation.contact.broad_phase import Overlap, Touching
from icofabric_sim.simulation.event_loop import EventLoop
from icofabric_sim.simulation.inputs.input_types import BodyTarget, Wrench
from icofabric_sim.simulation.model.packing import PackedScene
from icofabric_sim.simulation.reports.fastest_place import fastest_place
from icofabric_sim.simulation.stepping.driver import Driver
from icofabric_sim.simulation.stepping.ledger import EnergyBalance
from icofabric_sim.simulation.stepping.method_selection import WILD
from icofabric_sim.simulation.stepping.trajectory import Trajectory

# Radians of the vibration of a contact in a step, about.
_CONTACT_ANGLE = 0.2


class SimulationStatus:
    """
    How a run stands: each figure is read when it is asked for, and none of them changes the run.

    Errors are the larger of position over a and orientation in rad.
    """

    def __init__(self, event_loop: EventLoop, packed: PackedScene) -> None:
        """Read from the event loop of one simulation."""
        self._event_loop, self._packed = event_loop, packed

    def __repr__(self) -> str:
        """Say how the run steps."""
        return (f'<SimulationStatus: {counted(self.step_count, "step")} of {self.method_name}, '
                f'now of {self.step:.6g} s>')

    def __reduce__(self) -> NoReturn:
        """Refuse to be pickled or copied."""
        raise TypeError(
            'a SimulationStatus cannot be pickled or copied: it reads from its Simulation; '
            'simulation.snapshot() and simulation.checkpoint() can')

    @property
    def _driver(self) -> Driver:
        """Driver of the present method; a change of the method replaces it."""
        return self._event_loop.driver

    @property
    def _trajectory(self) -> Trajectory:
        """Trajectory of the present driver."""
        return self._event_loop.driver.trajectory

    def touching(self) -> Touching:
        """The pairs of shells, and of shells and planes, that touch at the present time."""
        driver = self._driver
        return driver.contact.touching(self._event_loop.state())

    def fastest_place(self) -> str:
        """
        Name the bodies, connectors or pairs whose motion is the fastest one.

        '' where they cannot be told. As of the last step; not beside an advance.
        """
        return fastest_place(self._driver)

    # The method and its steps.

    @property
    def method_name(self) -> str:
        """Name of the method in METHODS."""
        return self._event_loop.method.name

    @property
    def touching_method(self) -> str:
        """Name of the method by which steps are taken from the first contact on."""
        return self._event_loop.touching_method

    @property
    def method_reason(self) -> str:
        """Sentence on why this method was chosen."""
        return self._event_loop.method.reason

    @property
    def step(self) -> float:
        """Step [s] in use."""
        return self._trajectory.step

    @property
    def step_count(self) -> int:
        """Steps taken so far."""
        return self._trajectory.step_count

    @property
    def evaluation_count(self) -> int:
        """
        Evaluations of the forces of the whole fabric that the trajectory took.

        All stages of its steps, also of those that were refused or taken again, and iterations of
        implicit ones. What a call of compiled code evaluates again, where the call before has
        ended, counts once. So the count is the same in pieces or in one go, for any number of
        threads or ranks. On a GPU a step in which connectors cross kinks counts as any other.
        """
        return self._trajectory.evaluations.trajectory

    @property
    def estimation_count(self) -> int:
        """
        All other evaluations of the forces, which change no step that was taken.

        Measurements of errors, which may choose steps; steps repeated to judge whether shells have
        passed through each other; and states shown between steps, which checkpoints do not count.
        """
        return self._trajectory.evaluations.outside

    @property
    def shown_count(self) -> int:
        """Those of `estimation_count` for states shown between steps."""
        return self._trajectory.evaluations.shown

    @property
    def stage_count(self) -> int:
        """Evaluations of the forces in a step."""
        return self._trajectory.method.stages

    @property
    def usual_evaluation_rate(self) -> float:
        """Evaluations of the forces for each simulated second [1/s] with the present step."""
        return self.stage_count / self.step

    @property
    def contact_evaluation_rate(self) -> float:
        """Evaluations [1/s] with a step as short as contacts need; 0: none are possible."""
        contact = self._driver.contact
        rate = math.sqrt(contact.least_rate) + contact.velocity_rate
        return self.stage_count * rate / _CONTACT_ANGLE

    @property
    def rank_count(self) -> int:
        """Processes of MPI that take the steps together; 1: this one alone."""
        holder = self._trajectory.method.holder
        return 1 if holder is None else holder.rank_count

    @property
    def device(self) -> str:
        """Name of the device that takes the steps; '' where this process or ranks of MPI do."""
        holder = self._trajectory.method.holder
        return '' if holder is None else holder.device

    @property
    def device_bytes(self) -> int:
        """Bytes that the run takes on that device, about, but for its loads; 0 without one."""
        holder = self._trajectory.method.holder
        return 0 if holder is None else holder.device_bytes

    @property
    def halo_bytes(self) -> int:
        """Bytes that the rank with the largest halo receives in an evaluation of the forces."""
        holder = self._trajectory.method.holder
        return 0 if holder is None else holder.halo_bytes

    @property
    def next_step_time(self) -> float:
        """Time [s] at which the step in progress ends, unless an input ends it before."""
        return self._driver.stepping.next_step_time

    @property
    def largest_frequency(self) -> float:
        """Largest frequency [rad/s] of the fabric in the configuration evaluated last."""
        return self._driver.rates.frequency.rate

    @property
    def stability_limit(self) -> float:
        """Longest stable step [s] in that configuration."""
        return self._driver.rates.limit

    @property
    def fastest_term(self) -> str:
        """What moves or vibrates fastest, with its parameters and its rate [rad/s]."""
        return self._driver.rates.fastest_term()

    @property
    def thread_count(self) -> int:
        """Threads that share a step."""
        return self._trajectory.thread_team.size

    @property
    def busy_thread_count(self) -> int:
        """Threads of them that have bodies."""
        return self._trajectory.thread_team.busy

    # Errors and energy.

    @property
    def error_rate(self) -> float:
        """Error that the method adds for each second [1/s], measured last; NaN: not estimated."""
        return self._driver.stepping.error_rate() if (
            self._driver.errors.is_estimated) else math.nan

    @property
    def error_estimate(self) -> float:
        """
        Errors added since the start, as if none of them had grown.

        NaN where they are not estimated (`solver.error_estimate`).
        """
        if not self._driver.errors.is_estimated:
            return math.nan
        return self._driver.stepping.error_estimate(self._event_loop.time)

    @property
    def error_estimate_lacks(self) -> str:
        """Sentence on errors of this run that the estimate may not cover; '': it covers all."""
        if not self._driver.errors.is_estimated:
            return 'errors were not estimated, as solver.error_estimate is false'
        found = []
        if self._event_loop.strain > WILD:
            found.append(
                'a connector that all but collapses within a step may add more than is seen by '
                'steps that do not adapt: solver.method dop8 without solver.step follows it')
        if self._packed.model.wrapping is not None:
            # Windows are not measured where shells may touch.
            blind = self._driver.contact.is_possible and not self._trajectory.is_given
            found.append(
                'where connectors around shells change to another geodesic the force jumps, and '
                'the tolerance is not kept' + (
                    '; the estimate was up to 40 times too small in tests, as it is not measured '
                    'where shells may touch' if blind else ''))
            if self.obstruction:
                found.append(
                    'shells pass through each other, where no way around them is right: lengths '
                    'of connectors jump there, by which errors grew to 10,000 times the estimate '
                    'in a test; contact.mode auto keeps shells apart')
        if (self._packed.external is not None and self._trajectory.is_given and self.step_count > 0
                and not self.error_estimate > 0.0):
            found.append(
                'a body force alone moves the bodies, and nothing turns or vibrates by whose '
                'period the error of a given solver.step is measured, so the estimate stays 0: '
                'without solver.step every step is judged')
        if self._trajectory.is_given and (self.broken_count or self._packed.goes_slack):
            found.append(
                'bodies fly where connectors have broken, or are far softer on one side of their '
                'natural length: nothing takes an error of velocity back there, and the error at '
                'the end was up to 90 times the estimate in tests; without solver.step far less '
                'is added')
        if self._driver.contact.rounding:
            found.append(self._driver.contact.rounding)
        if self.deepest_overlap > 0.0 or self.contact_count:
            found.append(
                'a contact that begins and ends between two evaluations of the forces within a '
                'step is not seen')
        return '; '.join(found)

    @property
    def balance(self) -> EnergyBalance:
        """How well the energy balanced at the health checks."""
        return self._trajectory.ledger.balance

    # Contacts, breaks, connectors in shells.

    @property
    def contact_count(self) -> int:
        """Pairs of shells, and shells and planes, that touched at the last health check."""
        return int(self._trajectory.ledger.touching)

    @property
    def has_contacts(self) -> bool:
        """Whether steps look for contacts: shells are near each other, or near a plane."""
        return self._driver.contact.contacts is not None

    @property
    def contact_tests(self) -> int:
        """Pairs tested in all steps so far; tests for snapshots in between do not count."""
        return self._driver.contact.tests

    @property
    def deepest_overlap(self) -> float:
        """Deepest overlap [m] of shells in contact at any health check so far."""
        return self._trajectory.ledger.deepest_ever

    @property
    def proximity(self) -> Overlap | None:
        """The first two shells that overlapped by more than contact is meant for, if any."""
        return self._driver.contact.found

    @property
    def broken_count(self) -> int:
        """Connectors and anchors that have broken so far."""
        trajectory = self._trajectory
        anchors = trajectory.anchor_breaks
        return trajectory.broken.count + (0 if anchors is None else int(anchors.broken.sum()))

    @property
    def obstruction(self) -> str:
        """Sentence on the first connector that was seen in its own shell; '': none was."""
        return self._driver.monitor.obstruction.found

    @property
    def obstructed_ends(self) -> int:
        """Ends of connectors that were in their own shells at the last health check."""
        return int(self._trajectory.ledger.obstructed)

    # What acts.

    @property
    def active_loads(self) -> dict[str | int, Wrench]:
        """Wrenches that act now, by channel name or body number."""
        return {
            target.number if isinstance(target, BodyTarget) else target.name: wrench
            for target, wrench in self._event_loop.inputs.acting().items()}

    @property
    def waiting_loads(self) -> int:
        """Wrenches that are to begin or to end at a later time, messages left out."""
        return self._event_loop.inputs.waiting_count
