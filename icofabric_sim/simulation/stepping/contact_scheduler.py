# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Validity of the neighbour list: searches, contact frequency, and reasons to stop a run."""

from collections.abc import Callable
import logging
import math
from typing import Any, NoReturn

from icofabric_sim.kernels.records import Contacts, State, Watch
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.contact.broad_phase import (
    BroadPhase,
    NOTHING_TOUCHES,
    Overlap,
    Touching,
)
from icofabric_sim.simulation.stepping.trajectory import Trajectory
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')


class ContactScheduler:
    """Searches for the candidate pairs of a trajectory; none without a broad phase."""

    def __init__(self, trajectory: Trajectory, broad_phase: BroadPhase | None) -> None:
        """Find contacts of the `trajectory` by the `broad_phase`."""
        self._trajectory, self.broad_phase = trajectory, broad_phase
        # Sentence on contacts that are too far from the origin for the tolerance; '': none are.
        self.rounding = ''
        self._set_limits(math.inf if broad_phase is None else broad_phase.deepest)

    def _set_limits(self, deepest: float) -> None:
        self._trajectory.ledger.deepest_limit = deepest
        self.report_overlaps()

    def report_overlaps(self) -> None:
        """Report overlaps from now on, once."""
        phase = self.broad_phase
        self._trajectory.ledger.reported_limit = math.inf if phase is None else phase.reported

    @property
    def is_possible(self) -> bool:
        """True if shells can touch."""
        return self.broad_phase is not None

    @property
    def contacts(self) -> Contacts | None:
        """Candidate pairs until the next search; None: no pair."""
        return None if self.broad_phase is None else self.broad_phase.contacts

    @property
    def rate(self) -> float:
        """Upper bound of the contribution of contacts to the squared frequency [1/s^2]."""
        return 0.0 if self.broad_phase is None else self.broad_phase.rate

    @property
    def least_rate(self) -> float:
        """Bound of the rate of a single contact, present or not [1/s^2]."""
        return 0.0 if self.broad_phase is None else self.broad_phase.least_rate

    @property
    def searched(self) -> float:
        """Time [s] of the last search; never: -inf."""
        return -math.inf if self.broad_phase is None else self.broad_phase.searched

    def count_only_touching(self) -> None:
        """Let only pairs in contact contribute to the frequency: steps run through contacts."""
        if self.broad_phase is not None:
            self.broad_phase.counts_listed = False
            self.list_by_few_axes()

    def list_by_few_axes(self) -> None:
        """Search faster with additional pairs in the list, on which steps do not depend."""
        if self.broad_phase is not None:
            self.broad_phase.lists_by_few_axes = True

    def note_rounding(self, extent: float, noise: float) -> None:
        """
        Warn once that round-off `extent` [m] from the origin causes a `noise` [1/s] of contacts.
        """
        if not self.rounding:
            self.rounding = (
                f'shells that may touch are up to {extent:.4g} m from the origin, where places '
                f'are rounded to {math.ulp(extent):.2g} m: while they are near each other, errors '
                f'below {noise:.2g} per second are not asked for; move the scene nearer to the '
                'origin, or give a smaller contact.stiffness or a larger solver.tolerance')
            _LOGGER.warning('%s', self.rounding)

    def count_touching(self) -> None:
        """Count pairs in contact at a health check, with their stiffness, for the frequency."""
        if self.broad_phase is not None:
            self.broad_phase.count_touching(self._trajectory.state)

    @property
    def touching_pairs(self) -> int:
        """Number of pairs in contact at the last health check that counted them."""
        return 0 if self.broad_phase is None else self.broad_phase.touching_pairs

    @property
    def velocity_rate(self) -> float:
        """Rate [1/s] at which dissipative contact forces change velocities."""
        return 0.0 if self.broad_phase is None else self.broad_phase.velocity_rate

    @property
    def stiffness(self) -> float:
        """Stiffness [N/m] of a contact."""
        return 0.0 if self.broad_phase is None else self.broad_phase.setup.stiffness

    @property
    def longest_step(self) -> float:
        """Longest step [s] in which no body leaves the region that the neighbour list covers."""
        return math.inf if self.broad_phase is None else self.broad_phase.longest_step

    @property
    def found(self) -> Overlap | None:
        """First two shells whose overlap exceeded the intended one, if any."""
        return None if self.broad_phase is None else self.broad_phase.found

    @property
    def tests(self) -> int:
        """Number of pairs of shells tested in the steps of the trajectory."""
        return 0 if self.broad_phase is None else self.broad_phase.tests

    @property
    def search_time(self) -> float:
        """Time [s] of the last search."""
        return -math.inf if self.broad_phase is None else self.broad_phase.search_time

    def has_left(self, state: State, time: float) -> bool:
        """Return True if a body has left the region that the neighbour list covers."""
        return self.broad_phase is not None and self.broad_phase.has_left(state, time)

    def watching(self, *, trial: bool = False) -> Watch | None:
        """Return the limits that kernels check; displacements of a `trial` step are discarded."""
        if self.broad_phase is None:
            return None
        return self.broad_phase.trial_watch if trial else self.broad_phase.watch

    def counted(self, work: Callable[[], Any]) -> Any:
        """Call `work`, which takes steps, and count the pairs of shells that the steps test."""
        phase = self.broad_phase
        if phase is None:
            return work()
        before = phase.evaluated
        try:
            return work()
        finally:
            phase.tests += phase.evaluated - before

    def has_touched(self) -> bool:
        """Return True if shells have touched since the last call, also in trials."""
        return self.broad_phase is not None and self.broad_phase.has_touched()

    def energies(self, state: State, stretches: np.ndarray | None) -> tuple[float, float]:
        """
        Return energies [J] of contacts and of friction springs in a state near the last search.
        """
        return (0.0, 0.0) if self.broad_phase is None else (
            self.broad_phase.energies(state, stretches))

    def touching(self, state: State) -> Touching:
        """Return the pairs in contact in a state near the last search."""
        return NOTHING_TOUCHES if self.broad_phase is None else self.broad_phase.touching(
            state, self._trajectory.stretches())

    def announce(self) -> None:
        """Warn once of an overlap."""
        if self.broad_phase is not None:
            self.broad_phase.announce()

    def search(
        self, time: float, step: float, steps: float, *, displacement: float = 0.0
    ) -> None:
        """
        Find candidate pairs from the present state on at `time` [s], for `steps` of `step` [s].

        The search also covers a `displacement` [m] of bodies, up to the longest reach.
        """
        if self.broad_phase is None:
            return
        ledger = self._trajectory.ledger
        before = ledger.contact_rate
        self.broad_phase.search(
            time, self._trajectory.state, step, steps, displacement=displacement)
        self._compute_found()
        # The bound that was found at the last health check, with the contacts of now.
        spin = ledger.spin_weight * ledger.spin
        fabric = max((ledger.rate - spin) ** 2 - before, 0.0)
        ledger.rate = math.sqrt(fabric + self._judged_rate) + spin

    def search_farther(self, time: float, step: float, steps: float, factor: float) -> bool:
        """
        Search at `time` [s] for `factor` times the displacement of a rejected step.

        Return False if bodies are too fast for a search.
        """
        phase = self.broad_phase
        if phase is None:
            return True
        self.search(time, step, steps, displacement=factor * phase.displacement)
        return bool(phase.watch.frame[0] == time)

    def make_room(self) -> None:
        """Enlarge the list for all pairs near the present state; listed pairs remain."""
        if self.broad_phase is not None:
            self.broad_phase.make_room(self._trajectory.state)

    def miss(self, way_out: str) -> None:
        """Search farther from now on; `way_out` is a remedy that shortens steps."""
        if self.broad_phase is not None:
            self.broad_phase.miss(way_out)

    def pace(self, step: float, *, alone: bool) -> None:
        """
        Choose for a `step` [s] how often displacements are checked.

        `alone`: kernels may search by themselves, as the step need not follow.
        """
        if self.broad_phase is not None:
            self.broad_phase.pace(step, self._trajectory.method.stages, alone=alone)

    @property
    def stride(self) -> int:
        """Number of steps between two checks of displacements by kernels."""
        return 1 if self.broad_phase is None else self.broad_phase.stride

    def follow_speeds(self, step: float, until: float) -> None:
        """Search for bodies that accelerate in steps of `step` [s], until the time `until` [s]."""
        if self.broad_phase is not None:
            self.broad_phase.be_wary(step, until)

    def calm(self, time: float = math.inf) -> bool:
        """
        End searches for accelerating bodies if their time has passed; return True if ended now.
        """
        phase = self.broad_phase
        if phase is None or not phase.is_wary or time < phase.wary_until:
            return False
        phase.calm()
        return True

    def forget_displacements(self) -> None:
        """Discard displacements recorded before the last search."""
        if self.broad_phase is not None:
            self.broad_phase.forget_displacements()

    def forget_friction(self) -> None:
        """Release all friction springs: the state has jumped."""
        if self.broad_phase is not None:
            self.broad_phase.stretches.forget()

    def forget(self) -> None:
        """Reset searches and reports to the beginning of a run."""
        self.report_overlaps()
        self.rounding = ''
        if self.broad_phase is not None:
            self.broad_phase.forget()

    def take_over(self, found: Overlap | None) -> None:
        """Continue after another run of the same motion, which has warned of `found`."""
        if self.broad_phase is not None:
            self.broad_phase.take_over(found)

    def rebase(self, time: float) -> None:
        """Move an unstarted motion to another `time` [s]."""
        if self.broad_phase is not None:
            self.broad_phase.rebase(time)

    def require_room(self) -> None:
        """Raise for large initial overlaps; record smaller ones."""
        phase, trajectory = self.broad_phase, self._trajectory
        if phase is None:
            return
        ledger = trajectory.ledger
        if ledger.deepest > ledger.deepest_limit:
            trajectory.fail(
                f'{phase.note(trajectory.time, trajectory.state)}; move them apart, or set '
                'contact.mode never')
        if ledger.deepest > ledger.reported_limit:
            self._note(phase, phase.note(trajectory.time, trajectory.state))

    def handle_overlap(self, time: float, *, stop: bool) -> None:
        """Report once that an overlap exceeds the intended one, or stop the run."""
        phase, trajectory = self.broad_phase, self._trajectory
        if phase is None:
            return
        found = phase.note(time, trajectory.state)
        if not stop:
            self._note(phase, found)
            phase.announce()
            return
        trajectory.return_to_saved()
        trajectory.fail(
            f'{found}, which is more than a fifth of the inscribed radius '
            f'({trajectory.ledger.deepest_limit:.3g} m): they might pass through each other. '
            f'Give a larger contact.stiffness than {phase.setup.stiffness:.4g} N/m; the last '
            f'good state, of t = {trajectory.saved_time:.9g} s, is kept')

    def _note(self, phase: BroadPhase, found: Overlap | None) -> None:
        self._trajectory.ledger.reported_limit = math.inf
        phase.found = phase.found or found

    def refuse_passing(self, before: State, after: State, start: float, end: float) -> None:
        """
        Stop `before` a step in which shells may pass through each other, and keep that state.

        The state is the present one or the saved one.
        """
        found = self.passing(before, after, start, end, long=True)
        if found:
            if before is self._trajectory.state:
                self._trajectory.save()
            self.stop_passing(found)

    def passing(
        self, before: State, after: State, start: float, end: float, *, long: bool
    ) -> str:
        """
        Return a text on shells that may pass through each other in a step; empty without any.

        If `long`, steps may be so long that listed pairs pass between two evaluations, too.
        """
        phase = self.broad_phase
        return '' if phase is None else phase.passing_by(before, after, start, end, long=long)

    def stop_passing(self, found: str) -> NoReturn:
        """Stop a run with a given step at the saved state; `found` is the reason."""
        trajectory = self._trajectory
        trajectory.return_to_saved()
        trajectory.return_work()
        trajectory.fail(
            f'{found}. Start again with a smaller solver.step than {trajectory.step!r} s, or 0 to '
            'have it chosen; contact.mode never lets shells pass through each other. The last '
            f'good state, of t = {trajectory.saved_time:.9g} s, is kept')

    def state_tree(self) -> dict[str, Any]:
        """Return the last search and reports as an entry; none if contacts are impossible."""
        return {} if self.broad_phase is None else {'watch': self.broad_phase.state_tree()}

    def load_state(self, tree: StateTree) -> None:
        """Restore the last search from a checkpoint."""
        if self.broad_phase is not None:
            self.broad_phase.load_state(tree.part('watch'))
            self._compute_found()

    def _compute_found(self) -> None:
        """Evaluate only the listed pairs from now on."""
        self._trajectory.set_contacts(self.contacts)
        self._trajectory.ledger.contact_rate = self._judged_rate

    @property
    def _judged_rate(self) -> float:
        """Rate [1/s^2] that health checks add to the bound of the squared frequency."""
        phase = self.broad_phase
        return self.rate if phase is not None and phase.counts_listed else 0.0
