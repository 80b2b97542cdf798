# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Read-only quantities of a run."""

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

# Approximate angle [rad] of the vibration of a contact in a step.
_CONTACT_ANGLE = 0.2


class SimulationStatus:
    """
    Status of a run: each quantity is computed on access, without effect on the run.

    Errors are the larger of position error over a and orientation error in rad.
    """

    def __init__(self, event_loop: EventLoop, packed: PackedScene) -> None:
        """Read from the event loop of one simulation."""
        self._event_loop, self._packed = event_loop, packed

    def __repr__(self) -> str:
        """Return number of steps, method and step size."""
        return (f'<SimulationStatus: {counted(self.step_count, "step")} of {self.method_name}, '
                f'now of {self.step:.6g} s>')

    def __reduce__(self) -> NoReturn:
        """Raise TypeError: a status cannot be pickled or copied."""
        raise TypeError(
            'a SimulationStatus cannot be pickled or copied: it reads from its Simulation; '
            'simulation.snapshot() and simulation.checkpoint() can')

    @property
    def _driver(self) -> Driver:
        """Driver of the present method, replaced when the method changes."""
        return self._event_loop.driver

    @property
    def _trajectory(self) -> Trajectory:
        """Trajectory of the present driver."""
        return self._event_loop.driver.trajectory

    def touching(self) -> Touching:
        """Return the contacts of shells with shells and planes at the present time."""
        driver = self._driver
        state = self._event_loop.state()
        return driver.contact.phase.touching(state, driver.trajectory.stretches())

    def fastest_place(self) -> str:
        """
        Return the bodies, connectors or pairs with the fastest motion, as text.

        The text is empty if the location is unknown. The result is that of the last step. Do not
        call this method during an advance.
        """
        return fastest_place(self._driver)

    # The method and its steps.

    @property
    def method_name(self) -> str:
        """Name of the method in METHODS."""
        return self._event_loop.method.name

    @property
    def touching_method(self) -> str:
        """Name of the method for steps after the first contact."""
        return self._event_loop.touching_method

    @property
    def method_reason(self) -> str:
        """Sentence on the choice of the method."""
        return self._event_loop.method.reason

    @property
    def step(self) -> float:
        """Present step [s]."""
        return self._trajectory.step

    @property
    def step_count(self) -> int:
        """Steps taken so far."""
        return self._trajectory.step_count

    @property
    def evaluation_count(self) -> int:
        """
        Force evaluations of the whole fabric for the steps of the trajectory.

        The count includes all stages of rejected and repeated steps and iterations of implicit
        steps. An evaluation that compiled code repeats at the start of a call counts once. So the
        count depends neither on the calls of `advance_to` nor on the number of threads or ranks.
        On a GPU, a step across kinks of connectors counts as any other.
        """
        return self._trajectory.evaluations.trajectory

    @property
    def estimation_count(self) -> int:
        """
        Other force evaluations, which do not change completed steps.

        They measure errors, which may determine steps; repeat steps to test whether shells passed
        through each other; and show states between steps. Checkpoints do not include the last
        ones.
        """
        return self._trajectory.evaluations.outside

    @property
    def shown_count(self) -> int:
        """Evaluations of `estimation_count` for states between steps."""
        return self._trajectory.evaluations.shown

    @property
    def stage_count(self) -> int:
        """Force evaluations per step."""
        return self._trajectory.method.stages

    @property
    def usual_evaluation_rate(self) -> float:
        """Force evaluations per simulated second [1/s] with the present step."""
        return self.stage_count / self.step

    @property
    def contact_evaluation_rate(self) -> float:
        """Force evaluations [1/s] with the step size of contacts; 0 if contacts are impossible."""
        contact = self._driver.contact
        rate = math.sqrt(contact.phase.least_rate) + contact.phase.velocity_rate
        return self.stage_count * rate / _CONTACT_ANGLE

    @property
    def rank_count(self) -> int:
        """Number of MPI processes that share the steps; 1: this process alone."""
        return self._trajectory.executor.rank_count

    @property
    def device(self) -> str:
        """Name of the GPU that computes the steps; empty without one."""
        return self._trajectory.executor.device

    @property
    def device_bytes(self) -> int:
        """Approximate memory [bytes] of the run on the GPU without its loads; 0 without a GPU."""
        return self._trajectory.executor.device_bytes

    @property
    def halo_bytes(self) -> int:
        """Bytes that the rank with the largest halo receives per force evaluation."""
        return self._trajectory.executor.halo_bytes

    @property
    def next_step_time(self) -> float:
        """Time [s] at which the step in progress ends, unless an input ends the step before."""
        return self._driver.stepping.next_step_time

    @property
    def largest_frequency(self) -> float:
        """Largest frequency [rad/s] of the fabric in the configuration evaluated last."""
        return self._driver.rates.frequency.rate

    @property
    def stability_limit(self) -> float:
        """Longest stable step [s] in the configuration evaluated last."""
        return self._driver.rates.limit

    @property
    def fastest_term(self) -> str:
        """Fastest motion or vibration, with its parameters and its rate [rad/s]."""
        return self._driver.rates.fastest_term()

    @property
    def thread_count(self) -> int:
        """Number of threads that share a step."""
        return self._trajectory.thread_team.size

    @property
    def busy_thread_count(self) -> int:
        """Number of threads with bodies."""
        return self._trajectory.thread_team.busy

    # Errors and energy.

    @property
    def error_rate(self) -> float:
        """Error per simulated second [1/s], measured last; NaN: not estimated."""
        return self._driver.stepping.error_rate() if (
            self._driver.errors.is_estimated) else math.nan

    @property
    def error_estimate(self) -> float:
        """
        Sum of added errors since the start, without amplification.

        The value is NaN if errors are not estimated (`solver.error_estimate`).
        """
        if not self._driver.errors.is_estimated:
            return math.nan
        return self._driver.stepping.error_estimate(self._event_loop.time)

    @property
    def error_estimate_lacks(self) -> str:
        """Sentence on errors that the estimate may not cover; empty without such errors."""
        if not self._driver.errors.is_estimated:
            return 'errors were not estimated, as solver.error_estimate is false'
        found = []
        if self._event_loop.strain > WILD:
            found.append(
                'a connector that nearly collapses within a step may add more error than steps '
                'of fixed size detect: use solver.method dop8 without solver.step')
        if self._packed.model.wrapping is not None:
            # Windows are not measured if shells may touch.
            blind = self._driver.contact.phase.is_possible and not self._trajectory.is_given
            found.append(
                'forces jump where connectors around shells change to another geodesic, and '
                'the tolerance is not kept' + (
                    '; the estimate was up to 40 times too small in tests, because errors are '
                    'not measured if shells may touch' if blind else ''))
            if self.obstruction:
                found.append(
                    'shells pass through each other, where connectors have no valid geodesic: '
                    'their lengths jump, and in a test errors were 10,000 times the estimate; '
                    'contact.mode auto keeps shells apart')
        if (self._packed.external is not None and self._trajectory.is_given and self.step_count > 0
                and not self.error_estimate > 0.0):
            found.append(
                'a body force alone moves the bodies, without a rotation or vibration by whose '
                'period the error of a given solver.step is measured, so the estimate stays 0: '
                'without solver.step the error of every step is controlled')
        if self._trajectory.is_given and (self.broken_count or self._packed.goes_slack):
            found.append(
                'bodies move freely where connectors have broken, or are far softer on one side '
                'of their natural length: errors of velocity persist, and the final error was up '
                'to 90 times the estimate in tests; without solver.step errors are far smaller')
        if self._driver.contact.rounding:
            found.append(self._driver.contact.rounding)
        if self.deepest_overlap > 0.0 or self.contact_count:
            found.append(
                'a contact that begins and ends between two force evaluations within a step is '
                'not detected')
        return '; '.join(found)

    @property
    def balance(self) -> EnergyBalance:
        """Errors of the energy balance at the health checks."""
        return self._trajectory.ledger.balance

    # Contacts, breaks, connectors in shells.

    @property
    def contact_count(self) -> int:
        """Pairs of shells, and of shells and planes, in contact at the last health check."""
        return int(self._trajectory.ledger.touching)

    @property
    def has_contacts(self) -> bool:
        """True if steps test for contacts: shells are near each other or near a plane."""
        return self._driver.contact.phase.contacts is not None

    @property
    def contact_tests(self) -> int:
        """Pairs tested in all steps so far, without tests for snapshots between steps."""
        return self._driver.contact.phase.tests

    @property
    def deepest_overlap(self) -> float:
        """Deepest overlap [m] of shells in contact at any health check so far."""
        return self._trajectory.ledger.deepest_ever

    @property
    def proximity(self) -> Overlap | None:
        """First two shells whose overlap exceeded the intended one; None without any."""
        return self._driver.contact.phase.found

    @property
    def broken_count(self) -> int:
        """Number of connectors and anchors that have broken so far."""
        trajectory = self._trajectory
        anchors = trajectory.anchor_breaks
        return trajectory.broken.count + (0 if anchors is None else int(anchors.broken.sum()))

    @property
    def obstruction(self) -> str:
        """Sentence on the first connector found inside its own shell; empty without any."""
        return self._driver.monitor.obstruction.found

    @property
    def obstructed_ends(self) -> int:
        """Ends of connectors inside their own shells at the last health check."""
        return int(self._trajectory.ledger.obstructed)

    # What acts.

    @property
    def active_loads(self) -> dict[str | int, Wrench]:
        """Active wrenches by channel name or body number."""
        return {
            target.number if isinstance(target, BodyTarget) else target.name: wrench
            for target, wrench in self._event_loop.inputs.acting().items()}

    @property
    def waiting_loads(self) -> int:
        """Number of wrenches that start or end at a later time, without messages."""
        return self._event_loop.inputs.waiting_count
