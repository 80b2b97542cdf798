# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Errors of steps of one length during contacts, measured after the steps.

A contact may start and end between two accuracy probes, and causes more error than free motion in
many periods. So an interval between two health checks with contacts is repeated with twice as many
steps of half the length, and the difference of the ends counts (Richardson). The first intervals
are all repeated, later one of several, which then represents the ones before. The same holds for
intervals in which connectors around shells may change to another geodesic, or slack connectors may
tighten. Errors of velocities cancel within a period, and errors of a state grow. So an interval of
several shortest periods is repeated period by period; without possible contacts, an interval
shorter than a period is extended to a later health check.

Without vibrations, no force reduces errors of velocities: they displace free bodies. So such an
error is multiplied by the time until shells touch again.
"""

from collections.abc import Callable
import math
from typing import Any

from icofabric_sim.kernels.records import State
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.stepping.contact_scheduler import ContactScheduler
from icofabric_sim.simulation.stepping.motion_rates import MotionRates
from icofabric_sim.simulation.stepping.trajectory import Trajectory
from icofabric_sim.simulation.stepping.trial_steps import TrialSteps

# Number of measured intervals with weight 1, followed by twice as many with weight 2, and so on up
# to the second number. Few intervals dominate the error: the places of kinks in steps are random.
_SAMPLES, _MAX_WEIGHT = 128, 8
# If steps run through contacts, every interval with candidate pairs counts, without error if no
# pair touches. The weight of a measured interval doubles after the errors of this number of
# similar intervals; the second number is for forces that jump without contact, for example when a
# slack connector tightens. The third number is the largest weight. An interval with a much larger
# error halves the weight. Earlier measurements fade by the fourth ratio at each interval. The last
# number is that of pairs in contact for which an interval counts once.
_ALIKE, _ALIKE_AT_ANY_TIME, _MOST_THROUGH, _FADES, _CROWD = 2.0, 8.0, 32, 0.99, 64.0
# A kink in a force leaves an error of order 2.
_RICHARDSON = 4.0 / 3.0


class TouchingErrors:
    """Sum of errors during contacts, and the choice of measured intervals."""

    def __init__(
        self, trajectory: Trajectory, contact: ContactScheduler, rates: MotionRates,
        trials: TrialSteps, distance: Callable[[State, State, float], float],
        slip: Callable[[State, State], float], *, any_time: bool
    ) -> None:
        """
        Measure on the `trajectory` by `trials`, the `distance` of two states and their `slip`.

        The third argument of `distance` is a frequency [rad/s], which weights errors of
        velocities. `slip` [1/s] is the rate at which bodies separate without restoring forces. If
        forces jump, or slack connectors tighten, at `any_time`, every interval counts as one with
        contacts.
        """
        self._always = any_time
        self._trajectory, self._contact, self._rates = trajectory, contact, rates
        self._trials, self._distance, self._slip_of = trials, distance, slip
        # Errors by the end [s] of the last stretch in which shells touched. From there on bodies
        # part at `_slip` [1/s], but for where they go on touching.
        self.total = self._slip = self._since = 0.0
        self._stays = False
        # What the last stretch that was measured erred by [1/s], and its step [s].
        self._rate = self._step = 0.0
        self._runs_through = trajectory.method.runs_through_contacts
        self._interval = 0  # steps from one health check to the next
        self.restart()

    def restart(self) -> None:
        """Discard the interval in progress after a jump; the sum of errors continues."""
        self._every, self._left, self._waiting = 1, _SAMPLES, 0
        # Sums of the errors of measured stretches, and of their squares.
        self._sum = self._squares = self._rate = self._step = 0.0
        # Whether one could not be measured, as there was a search within it.
        self._is_starved = False
        self.begin(math.inf)

    def begin(self, time: float) -> None:
        """Start an interval at `time` [s], whose state is saved; inf: it cannot be measured."""
        self._stays = False
        self._begin(time)

    def _begin(self, time: float) -> None:
        self._start, self._touched, self._is_kept = time, self._always, False

    def estimate(self, time: float) -> float:
        """Return the errors until a present `time` [s]."""
        if self._stays or not self._slip > 0.0:
            return self.total
        return self.total + self._slip * max(time - self._since, 0.0)

    def settle(self, total: float) -> None:
        """Set the `total` of errors at the present time, none of them of velocities."""
        self.total, self._slip = total, 0.0

    def spoil(self) -> None:
        """Exclude the current interval from the error estimate: its step size changed."""
        self._start = math.inf

    def close(self, time: float, rate: float) -> None:
        """End an interval at the health check at `time` [s], before the step size changes."""
        if time > self._start:
            self.end(time, rate, is_last=True)

    def rate_with(self, step: float) -> float:
        """Return the error [1/s] of steps of `step` [s] by the last measurement; inf: none."""
        if not (self._runs_through and self._step > 0.0):
            return math.inf
        return self._rate * max(step / self._step, 1.0) ** 2

    @property
    def is_due(self) -> bool:
        """True if the next interval with contacts is measured."""
        return self._waiting + 1 >= self._every

    @property
    def needs_search(self) -> bool:
        """True if the next interval can be measured only after a search at its start."""
        return self.is_due and self._is_starved

    def prepare(self, step: float, since_check: int, interval: int, count: int) -> int:
        """
        Return the number of steps, up to `count`, after which contacts can be measured.

        Not beyond a health check, one of which is after each `interval` steps: the state of the
        one before is then kept if a measurement is due. Nothing is done where nothing is near.
        """
        trajectory, self._interval = self._trajectory, interval
        if step != trajectory.step:
            self.spoil()
        if self._contact.phase.contacts is None and not self._touched:
            return count
        self._contact.phase.has_touched()
        count = min(count, interval - since_check)
        if since_check + count == interval and self.is_due and not self._is_kept:
            if trajectory.saved_time == self._start:
                self._trials.keep_earlier()
                self._is_kept = True
            else:
                self.spoil()
        return count

    def note(self) -> None:
        """Record contacts of the completed steps."""
        touched = self._contact.phase.has_touched()
        self._touched = self._touched or touched

    def end(self, time: float, rate: float, *, is_last: bool = False) -> None:
        """
        Measure the interval that ends at `time` [s] if due, and start the next one.

        `rate` [1/s] is the error of free motion, which is counted separately; `is_last` means that
        the interval cannot be extended.
        """
        length, step, rate_now = time - self._start, self._trajectory.step, self._rates.fabric.rate
        period = 2.0 * math.pi / rate_now if rate_now > 0.0 else 0.0
        if not is_last and self._always and not self._contact.phase.is_possible and (
                0.0 < length and length + 0.5 * self._interval * step < period):
            # A later health check will judge it.
            return
        if self._touched:
            # Where they lie on each other contacts draw them back: of a row of such stretches the
            # first counts.
            self.total, self._since, self._stays = self.estimate(time), time, True
        else:
            self._stays = False
        self._waiting += self._touched or (
            self._runs_through and self._contact.phase.contacts is not None)
        count = round(length / step) if 0.0 < length < math.inf else 0
        whole = count > 0 and abs(length - count * step) < 1e-6 * step
        if self._runs_through:
            # Pairs must be known from where it began: a search on the way knows others.
            known = self._contact.phase.searched <= self._start
            if self._touched and whole and self._waiting >= self._every:
                self._is_starved = not known
            whole = whole and known
            if not self._touched and self._waiting >= self._every:
                self._waiting = 0
        if self._touched and whole and self._waiting >= self._every:
            windows = max(round(length / period), 1) if period > 0.0 else 1
            slip = 0.0

            def compare(one: State, other: State) -> float:
                nonlocal slip
                if not rate_now > 0.0:
                    slip = self._slip_of(one, other)
                return self._distance(one, other, rate_now)

            error = self._trials.compare_behind(
                self._start, count, min(windows, count), compare)
            if error is not None:
                self._rate, self._step = _RICHARDSON * error / length, step
                added = max(_RICHARDSON * error - rate * length, 0.0)
                self.total += self._waiting * added
                self._slip += self._waiting * _RICHARDSON * slip
                self._waiting = 0
                self._left = max(self._left - 1, 0)
                if self._runs_through:
                    self._sum = _FADES * self._sum + added
                    self._squares = _FADES**2 * self._squares + added * added
                    # In how many that are alike the sum would be as uncertain.
                    alike = self._sum**2 / self._squares if self._squares > 0.0 else math.inf
                    alike *= max(self._contact.phase.touching_pairs / _CROWD, 1.0)
                    wanted = (_ALIKE_AT_ANY_TIME if self._always else _ALIKE) * self._every
                    if alike >= wanted:
                        self._every = min(2 * self._every, _MOST_THROUGH)
                    elif alike < 0.125 * wanted:
                        self._every = max(self._every // 2, 1)
                elif not self._left:
                    self._every = min(2 * self._every, _MAX_WEIGHT)
                    self._left = _SAMPLES * self._every
        self._begin(time)

    def state_tree(self) -> dict[str, Any]:
        """Return measured values and the time of the next measurement."""
        tree: dict[str, Any] = {
            'total': self.total, 'every': self._every, 'left': self._left,
            'waiting': self._waiting, 'start': self._start, 'touched': self._touched,
            'sum': self._sum, 'squares': self._squares, 'starved': self._is_starved,
            'rate': self._rate, 'step': self._step}
        if self._slip > 0.0:
            tree |= {'slip': self._slip, 'since': self._since, 'stays': self._stays}
        if self._is_kept and self._trajectory.saved_time != self._start < math.inf:
            tree['earlier'] = self._trials.earlier_tree()
        return tree

    def load_state(self, tree: StateTree) -> None:
        """Restore the measurements from a checkpoint."""
        self.total = tree.number('total', 0.0, finite=False)
        self._slip, self._since, self._stays = 0.0, 0.0, False
        if 'slip' in tree:
            self._slip = tree.number('slip', 0.0, finite=False)
            self._since, self._stays = tree.number('since'), tree.flag('stays')
        self._every, self._left = tree.count('every', 1, _MOST_THROUGH), tree.count('left')
        self._sum = tree.number('sum', 0.0, finite=False)
        self._squares = tree.number('squares', 0.0, finite=False)
        self._rate = tree.number('rate', 0.0, finite=False)
        self._step = tree.number('step', 0.0)
        self._waiting = tree.count('waiting')
        self._start = tree.number('start', finite=False)
        self._touched, self._is_kept = tree.flag('touched'), 'earlier' in tree
        self._is_starved = tree.flag('starved')
        if self._is_kept:
            self._trials.load_earlier(tree.part('earlier'))
