# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Health checks of the state: their times, their limits, and how they end a run."""

import math
from typing import Any

from icofabric_sim.kernels import monitor
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.model.layout import has_jumps
from icofabric_sim.simulation.stepping.charge_meetings import meeting_between
from icofabric_sim.simulation.stepping.faults import find_fault, shorter_steps
from icofabric_sim.simulation.stepping.method_calls import MethodCalls
from icofabric_sim.simulation.stepping.methods import Method
from icofabric_sim.simulation.stepping.motion_rates import MotionRates
from icofabric_sim.simulation.stepping.obstruction import Obstruction
from icofabric_sim.simulation.stepping.trajectory import Trajectory
from icofabric_sim.simulation.stepping.wrap_jumps import jumps_between
import numpy as np

# Work between two health checks, in evaluations of the forces; a check costs about as much as one
# and a half, or as four where the step is as long as the frequency allows.
CHECK_INTERVAL = 64
# The same where a connector in its shell ends the run, so that few are missed that are soon out of
# it again: `dop8` looks after every step.
CLOSE_INTERVAL = 8
# Given steps are checked after so many, unless a period has fewer.
SHORTEST_INTERVAL = 8
# Order of the differences of chosen steps at most, where connectors have kinks.
_LARGEST_KINKED_ORDER = 6
# An energy that does not balance by less of the largest one is due to rounding, not to steps.
_ROUNDING = 1e-11


def differences_of(method: Method, links: Any, *, given: bool, estimated: bool) -> int:
    """
    Return the order of the differences that measure the roughness of the motion; 0: none.

    In fabrics with `links`, the order is the first that a splitting method gets wrong
    (accuracy_probe.py). At kinks of forces, differences of higher order show little else. For
    `given` steps, differences are used only if the error is `estimated`.
    """
    if not (method.symplectic and links is not None) or (given and not estimated):
        return 0
    if has_jumps(links) and method.order > 2 and not given:
        return min(method.order, _LARGEST_KINKED_ORDER)
    return method.order + 1


class StepMonitor:
    """Checks for finite states, energy balance, and connectors in shells."""

    def __init__(
        self, trajectory: Trajectory, rates: MotionRates, calls: MethodCalls,
        obstruction: Obstruction, *, tolerance: float, differences: int
    ) -> None:
        """
        Check the `trajectory`, whose step is given or chosen for the `tolerance` [1/s].

        `differences` is the order of the differences that measure the roughness of the motion.
        """
        self._trajectory, self._rates, self.obstruction = trajectory, rates, obstruction
        self._calls = calls
        self._tolerance, self._differences = tolerance, differences
        # Steps since the last check, and from one to the next.
        self.since_check = 0
        self._longest = CLOSE_INTERVAL if obstruction.stops else CHECK_INTERVAL
        self._most_steps = max(self._longest // trajectory.method.stages, 1)
        # Where the step follows the roughness of the motion there is a whole difference before
        # each check, so that a run goes back to where the motion was known to be smooth.
        self._window = 1 if trajectory.is_given else max(differences, 1)
        self._least_steps = SHORTEST_INTERVAL if (
            trajectory.is_given and not obstruction.stops) else self._window
        self._most_steps = self._in_windows(max(self._most_steps, self._least_steps))
        # Steps that searches for contacts count as the time between two health checks.
        self.search_interval = self._most_steps
        self.interval = self.interval_with(trajectory.step)

    def interval_with(self, step: float) -> int:
        """
        Return the number of steps of `step` [s] between two health checks.

        The number is limited by a shortest period of the fabric and by the cost of a check, unless
        steps are close to the stability limit. Implicit steps may be longer than a period.
        """
        steps, turned = self._most_steps, step * self._rates.fabric.rate
        if not self._trajectory.method.implicit and steps * turned > 2.0 * math.pi:
            steps = self._in_windows(max(int(2.0 * math.pi / turned), self._least_steps))
        return steps

    def _in_windows(self, steps: int) -> int:
        """Return at least `steps`, in whole differences if these limit the step."""
        return -(-steps // self._window) * self._window

    def follow_step(self) -> None:
        """Choose the steps between two health checks for the present step."""
        trajectory, rate = self._trajectory, self._rates.fabric.rate
        step = trajectory.step
        if trajectory.control is not None and not trajectory.is_given and rate > 0.0:
            # The first steps of an adaptive method are not known yet.
            step = trajectory.method.chosen / rate
        self.interval = self.interval_with(step)
        if trajectory.is_given and self._rates.frequency.rate > self._rates.fabric.rate:
            self.interval = min(self.interval, self.search_interval)
        if trajectory.is_given and trajectory.packed.goes_slack:
            # Errors of connectors that tighten are measured from check to check, in whole periods.
            self.interval = self.search_interval
        self.since_check = min(self.since_check, self.interval - 1)

    def restart(self, *, exact: bool) -> None:
        """Examine the present state after a jump; `exact` is as in `examine`."""
        ledger = self._trajectory.ledger
        ledger.obstructed_limit = 0.0 if self.obstruction.is_watching else math.inf
        ledger.obstructed_every = self.obstruction.checks
        ledger.until_obstructed = 0.0
        self.examine(exact=exact)
        # The first health check of the run looks for connectors in shells, too.
        ledger.until_obstructed = 0.0

    def examine(self, *, exact: bool = True) -> None:
        """
        Compute the bound of the largest frequency, for comparison with later ones.

        `exact` also computes the largest frequency itself.
        """
        trajectory, ledger = self._trajectory, self._trajectory.ledger
        if exact:
            self._rates.measure()
        # Any rate is low, so the bound is a close one.
        ledger.high, ledger.low, ledger.spin_weight = math.inf, math.inf, 1.0
        self._calls.examine()
        ledger.low = 0.0
        if self._trajectory.is_given:
            # Below this the bound proves the step safe. Above it the exact value is computed at
            # every check: the bound may be three times as high, its own growth says nothing.
            method, step = trajectory.method, trajectory.step
            ledger.high = method.stability / step - trajectory.packed.velocity_rate
            ledger.spin_weight = 0.0
            # As often in time as with a chosen step, as far as that is affordable.
            ratio = step * self._rates.frequency.rate / method.chosen
            steps = self._longest / method.stages / max(ratio, 1.0)
            shortest = 1 if self.obstruction.stops else SHORTEST_INTERVAL
            self.search_interval = max(int(steps), shortest)
        self.follow_step()

    def judge(self, time: float) -> int:
        """
        Return NOT_FINITE or UNBALANCED if the present state, at `time` [s], is unsound; else 0.

        This is no health check: a sound state leaves the ledger unchanged.
        """
        trajectory = self._trajectory
        model, ledger = trajectory.model, trajectory.ledger
        numbers = ledger.numbers.copy()
        trajectory.place_points()
        status = monitor.examine(
            model, trajectory.loads, trajectory.state, trajectory.work, time, numbers)
        if status & monitor.UNSOUND:
            np.copyto(ledger.numbers, numbers)
        return int(status & monitor.UNSOUND)

    def handle_obstruction(self, time: float) -> None:
        """Report once that a connector runs into its own shell, or stop the run."""
        trajectory, obstruction = self._trajectory, self.obstruction
        trajectory.ledger.obstructed_limit = math.inf
        obstruction.note(time, trajectory.state, trajectory.broken.since)
        if obstruction.stops:
            trajectory.return_to_saved()
            trajectory.fail(
                f'{obstruction.found}, and connector.obstruction is stop; warn lets it pass '
                f'through. The state of t = {trajectory.saved_time:.9g} s is kept')

    def fail_unfinite(self, time: float) -> None:
        """
        Stop because values are not finite: name the body, and return to the last sound state.
        """
        trajectory = self._trajectory
        fault = find_fault(trajectory.packed, trajectory.state)
        step, way_out = trajectory.step, self.way_out()
        trajectory.return_to_saved()
        trajectory.fail(
            f'the state of {fault} is no longer finite at t = {time:.9g} s, after steps of '
            f'{step:.6g} s. Start again: {way_out}; the last good state, of t = '
            f'{trajectory.saved_time:.9g} s, is kept')

    def fail_unbalanced(self, time: float) -> None:
        """Stop because the energy does not balance, and return to the last sound state."""
        trajectory = self._trajectory
        balance = trajectory.ledger.balance
        jumps = jumps_between(
            trajectory.packed, trajectory.half_edge, trajectory.saved, trajectory.state,
            trajectory.broken.since)
        explained = sum(jump.energy for jump in jumps)
        if jumps and not abs(balance.error - explained) > balance.limit * balance.scale:
            others = f' ({len(jumps):,} connectors do so)' if len(jumps) > 1 else ''
            imbalance = trajectory.ledger.describe_imbalance(time)
            apart = 'contact.mode auto' if trajectory.ledger.deepest_limit == math.inf else (
                'a larger contact.stiffness')
            trajectory.return_to_saved()
            trajectory.fail(
                f'connector.obstruction is wrap, {jumps[0]}{others}: {imbalance}. No step makes '
                f'that less. Start again: {apart} keeps shells apart; the last good state, of '
                f't = {trajectory.saved_time:.9g} s, is kept')
        fault = find_fault(trajectory.packed, trajectory.state)
        imbalance, way_out = trajectory.ledger.describe_imbalance(time), self.way_out()
        meeting = None if trajectory.control is not None else meeting_between(
            trajectory.packed, trajectory.saved, trajectory.state, time - trajectory.saved_time,
            trajectory.step)
        if not self._trajectory.is_given and abs(balance.error) < _ROUNDING * balance.scale:
            way_out = (
                f'a solver.energy_limit of {_ROUNDING:g} or more, as this is the rounding of many '
                'steps, which shorter ones only make more of')
        elif trajectory.model.wrapping is not None and (
                trajectory.ledger.deepest_limit == math.inf):
            way_out += (
                '; contact.mode auto keeps shells apart: where they pass through each other the '
                'forces of connectors around them jump')
        if meeting is not None:
            imbalance = f'{meeting}: {imbalance}'
            way_out += '; solver.method dop8 without a solver.step shortens single steps'
            if trajectory.ledger.deepest_limit == math.inf:
                way_out += ', and contact.mode auto keeps shells apart'
        trajectory.return_to_saved()
        trajectory.fail(
            f'{imbalance}; the fastest is {fault}, and steps are {trajectory.step:.6g} s (limit '
            f'{self._rates.limit:.6g} s). Start again: {way_out}; the last good state, of t = '
            f'{trajectory.saved_time:.9g} s, is kept')

    def way_out(self) -> str:
        """Return a remedy that shortens steps."""
        if self._trajectory.is_given:
            return 'give a smaller solver.step, or 0 to have it chosen'
        return shorter_steps(self._trajectory.step, self._tolerance, self._rates.fastest_term())

    def state_tree(self) -> dict[str, Any]:
        """Return the time and the data of the next health check, as entries."""
        tree: dict[str, Any] = {
            'since_check': self.since_check, 'look_interval': self.interval,
            'search_interval': self.search_interval}
        if self.obstruction.found:
            tree['obstruction'] = self.obstruction.found
        if self._is_in_window:
            difference = self._trajectory.work.difference
            # Also lanes without a body count, so this is only for processors with as many lanes.
            tree['window'] = difference.reshape(len(difference), -1, LANES).copy()
        return tree

    def load_state(self, tree: StateTree) -> None:
        """Restore the health checks from a checkpoint."""
        longest = max(CHECK_INTERVAL, self._most_steps)
        self.interval = tree.count('look_interval', 1, longest)
        # Earlier versions had one of both.
        self.search_interval = tree.count('search_interval', 1, longest) if (
            'search_interval' in tree) else self.interval
        self.since_check = tree.count('since_check', 0, self.interval - 1)
        self.obstruction.found = tree.text('obstruction') if 'obstruction' in tree else ''
        if self._is_in_window:
            own = self._trajectory.work.difference
            # Earlier versions began a difference after each health check.
            window = tree.array('window') if 'window' in tree else np.zeros(0)
            if window.shape == (len(own), own.shape[1] // LANES, LANES):
                own[:] = window.reshape(own.shape)
            else:
                # Of a processor with other lanes: the next check does not judge the roughness.
                self._trajectory.ledger.regular = 0.0

    @property
    def _is_in_window(self) -> bool:
        """True if some but not all steps of a difference are taken."""
        if self._differences < 1:
            return False
        if self._trajectory.method.stages < 4:
            return self.since_check > self.interval - self._differences
        return int(self._trajectory.ledger.regular) % self._differences != 0
