# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Interfaces of the components of a driver.

`driver.py` holds them all. A step-size controller is a file in `controllers/`, an event a file in
`events/`.
"""

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


class StepController(Protocol):
    """
    Proposes a step, and says by how much the error of those that were taken was too large.

    Beside the class its module has `RANK`, `suits` and `make`, see `controllers`.
    """

    # Whether it is the speed of bodies that limits the step.
    held_back: bool

    def outlook(self) -> tuple[float, float]:
        """Return the step [s] that contacts will ask for, and how many of them to look ahead."""

    def propose(self, *, probe: bool, shorter: float) -> float:
        """
        Return the step [s] to take from the present state on.

        Asked where the state has jumped, loads have changed or contacts have, and at the health
        check when `errors.probe.checks_left` of them have passed; also where the bound of the
        largest frequency is beyond `high` or `low` of the ledger [rad/s], if it has written
        these. `probe`: measure the accuracy anew, the state is saved; `shorter`: how many times
        too large the error of the present step is believed to be.
        """

    def excess(self) -> float | None:
        """
        Return the ratio of the error since the last health check to the tolerance.

        Above 1 the driver rejects them. Asked where the motion has become rougher than
        `ledger.rough_limit`; None: it cannot tell yet.
        """

    def follow_contacts(self) -> bool:
        """Contacts have begun, or are over, or bodies are faster; whether to propose a step."""

    def follow_touching(self) -> bool:
        """A health check has counted what touches; whether to propose a step that runs through."""

    def follow_swing(self) -> None:
        """
        Contacts made more energy swing than `ledger.swing_limit`, in steps that are taken again.
        """

    def follow_jump(self) -> bool:
        """Forces have jumped: nothing from before is reused; whether to propose a step."""


class Pieces(Protocol):
    """A driver, as its parts see it."""

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
        """Take the step that the controller proposes from now on."""

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
        """Return the part of the step in progress at which it first happens; None: not in it."""

    def happen(self) -> None:
        """Change the present state, which is that of the event; the next step restarts."""

    def state_tree(self) -> dict[str, Any]:
        """Return all data that later steps depend on, as entries of the driver's."""

    def load_state(self, tree: StateTree) -> None:
        """Go on from there."""


class Stepping(Protocol):
    """Control of steps, and states between their ends."""

    @property
    def next_step_time(self) -> float:
        """Time [s] at which the step in progress ends."""

    def restart(self) -> None:
        """The state has jumped to where the trajectory is: nothing from before is reused."""

    def settle(self, total: float) -> None:
        """Set the `total` of errors at the present step end."""

    def adopt(self, other: 'Stepping') -> None:
        """Use the error estimate of `other`, whose motion continues after a restart."""

    def forget(self) -> None:
        """Count errors from zero again."""

    def rebase(self, time: float) -> None:
        """Begin at another `time` [s]: nothing has moved yet."""

    def count_until(self, time: float) -> int:
        """Count the steps that lead to `time` [s] at most, as far as that is known; 0: none."""

    def run(self, time: float, count: int) -> None:
        """Call kernels once for up to `count` steps towards `time` [s]."""

    def run_steps(self, count: int, until: float) -> int:
        """Take up to `count` steps that end by `until` [s]; returns how many."""

    def check_within(self, time: float) -> bool:
        """
        Judge the state at `time` [s] within a step as the end of a step.

        False: steps have to be taken anew, by `go_back`.
        """

    def go_back(self) -> None:
        """Return to the saved state; the next steps are shorter, or checked more often."""

    def cut(self, time: float) -> bool:
        """
        End the step in progress at `time` [s]; the next one starts there.

        False: the step led too far, and the run is back at the saved state.
        """

    def state_at(self, time: float) -> State:
        """Return the state at a `time` [s] up to the end of the next step, and note energies."""

    def follow_loads(self) -> None:
        """Other loads act from the present state on."""

    def error_rate(self) -> float:
        """Error that the method adds for each second, measured last."""

    def error_estimate(self, time: float) -> float:
        """Errors added from the start to a present `time` [s], as if none had grown or faded."""

    def is_ready(self, *, touching: bool) -> bool:
        """Return True if the kernels of all steps are compiled, with contacts if `touching`."""

    def state_tree(self, tree: dict[str, Any]) -> None:
        """Add what the steps to come depend on to the `tree` of the driver."""

    def load_time(self, tree: StateTree) -> None:
        """Go on at the time of there, before the trajectory does."""

    def load_state(self, tree: StateTree) -> None:
        """Go on from there, after the trajectory."""
