# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Interfaces of the components of a driver.

`driver.py` holds them all. A step-size controller is a file in `controllers/`, an event a file in
`events/`.
"""

from abc import abstractmethod
from typing import Any, NamedTuple, Protocol

from icofabric_sim.kernels.records import State
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.stepping.contact_scheduler import ContactScheduler
from icofabric_sim.simulation.stepping.method_calls import MethodCalls
from icofabric_sim.simulation.stepping.methods import Method
from icofabric_sim.simulation.stepping.motion_rates import MotionRates
from icofabric_sim.simulation.stepping.shown_energies import ShownEnergies
from icofabric_sim.simulation.stepping.step_errors import StepErrors
from icofabric_sim.simulation.stepping.step_monitor import StepMonitor
from icofabric_sim.simulation.stepping.trajectory import Trajectory
from icofabric_sim.simulation.stepping.trial_steps import TrialSteps


class StepChoice(NamedTuple):
    """Properties of a run that select its step-size controller."""

    method: Method
    given: float  # `solver.step` [s]; 0: the step is chosen
    embedded: bool  # the kernel accepts or refuses each step by its error estimate
    output_period: float  # [s], the step where nothing in the scene sets a scale


class StepController:
    """
    Controller that proposes steps, and estimates errors of completed steps.

    The defaults are those of steps that do not follow contacts. The module of the class also has
    `RANK`, `suits` and `make`, see `controllers`.
    """

    # Whether it is the speed of bodies that limits the step.
    held_back: bool

    @abstractmethod
    def outlook(self) -> tuple[float, float]:
        """Return the step [s] for contacts, and the number of such steps that a search covers."""

    @abstractmethod
    def propose(self, *, probe: bool, shorter: float) -> float:
        """
        Return the step [s] from the present state on.

        The driver calls this after jumps of the state and changes of loads or contacts, and at the
        health check after `errors.probe.checks_left` checks. It also calls this if the bound of
        the largest frequency leaves the range from `low` to `high` of the ledger [rad/s], if set.
        `probe` measures the accuracy again; the state is saved. `shorter` is the estimated ratio
        of the error of the present step to the allowed one.
        """

    def excess(self) -> float | None:
        """
        Return the ratio of the error since the last health check to the tolerance.

        Above 1 the driver rejects them. Asked where the motion has become rougher than
        `ledger.rough_limit`; None: it cannot tell yet, or accepts any.
        """
        return None

    def follow_contacts(self) -> bool:
        """React to a change of candidate pairs or speeds; return True to propose a step."""
        return False

    def follow_touching(self) -> bool:
        """React to the number of contacts at a health check; return True to propose a step."""
        return False

    def follow_swing(self) -> None:
        """
        React to an energy oscillation above `ledger.swing_limit`, in steps that are repeated.
        """

    @abstractmethod
    def follow_jump(self) -> bool:
        """
        React to a jump of forces, after which no earlier data hold; return True to propose a step.
        """


class Pieces(Protocol):
    """A driver, as seen by its components."""

    trajectory: Trajectory
    contact: ContactScheduler
    rates: MotionRates
    calls: MethodCalls
    trials: TrialSteps
    shown: ShownEnergies
    errors: StepErrors
    monitor: StepMonitor
    controller: StepController

    def choose_step(self, *, probe: bool = False, shorter: float = 1.0) -> None:
        """Use the step that the controller proposes from now on."""

    def respond(self, status: int, time: float) -> None:
        """React to a `status` of the kernels at `time` [s]."""


class EventLocator(Protocol):
    """
    Locator of an event that may end a step, at the first event in the step.

    Beside the class its module has `why` and `make`, see `events`.
    """

    # Bit of the status with which kernels report a step that has to be searched; 0: search each.
    status: int
    # Whether it happens where the step in progress ends.
    is_due: bool

    def find(self) -> float | None:
        """Return the fraction of the step in progress at which the event first happens, if any."""

    def happen(self) -> None:
        """Change the present state, which is that of the event; the next step restarts."""

    def state_tree(self) -> dict[str, Any]:
        """Return all data that later steps depend on, as entries of the driver's."""

    def load_state(self, tree: StateTree) -> None:
        """Restore the event from a checkpoint."""


class Stepping:
    """
    Control of steps, and states between their ends.

    The methods that return nothing do nothing where other components have the data.
    """

    @property
    @abstractmethod
    def next_step_time(self) -> float:
        """Time [s] at which the step in progress ends."""

    def restart(self) -> None:
        """Restart after a jump of the state, without earlier data."""

    @abstractmethod
    def settle(self, total: float) -> None:
        """Set the `total` of errors at the present step end."""

    def adopt(self, other: 'Stepping') -> None:
        """Use the error estimate of `other`, whose motion continues after a restart."""

    def forget(self) -> None:
        """Reset the sum of errors."""

    def rebase(self, time: float) -> None:
        """Move an unstarted motion to another `time` [s]."""

    @abstractmethod
    def count_until(self, time: float) -> int:
        """Return an upper bound of the number of steps to `time` [s]; 0: none."""

    @abstractmethod
    def run(self, time: float, count: int) -> None:
        """Call kernels once for up to `count` steps towards `time` [s]."""

    @abstractmethod
    def run_steps(self, count: int, until: float) -> int:
        """Take up to `count` steps that end by `until` [s]; return their number."""

    def check_within(self, time: float) -> bool:
        """
        Check the state at `time` [s] within a step like the end of a step.

        Return False if steps have to be repeated by `go_back`.
        """
        return True

    def go_back(self) -> None:
        """Return to the saved state; the next steps are shorter, or checked more often."""

    @abstractmethod
    def cut(self, time: float) -> bool:
        """
        End the step in progress at `time` [s], where the next one starts.

        Return False if the step led too far, and the run is back at the saved state.
        """

    @abstractmethod
    def state_at(self, time: float) -> State:
        """
        Return the state at a `time` [s] up to the end of the next step, and store its energies.
        """

    @abstractmethod
    def follow_loads(self) -> None:
        """React to other loads from the present state on."""

    @abstractmethod
    def error_rate(self) -> float:
        """Error that the method adds per second, measured last."""

    @abstractmethod
    def error_estimate(self, time: float) -> float:
        """
        Return the errors from the start to a present `time` [s], without amplification or decay.
        """

    @abstractmethod
    def is_ready(self, *, touching: bool) -> bool:
        """Return True if the kernels of all steps are compiled, with contacts if `touching`."""

    def state_tree(self, tree: dict[str, Any]) -> None:
        """Add the data that later steps depend on to the `tree` of the driver."""

    def load_time(self, tree: StateTree) -> None:
        """Restore the time from a checkpoint, before the trajectory."""

    def load_state(self, tree: StateTree) -> None:
        """Restore the stepping from a checkpoint, after the trajectory."""
