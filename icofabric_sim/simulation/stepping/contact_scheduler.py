# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Validity of the neighbour list: searches, contact frequency, and reasons to stop a run."""

from collections.abc import Callable
import logging
import math
from typing import Any, NoReturn

from icofabric_sim.kernels.records import State
from icofabric_sim.simulation.checkpoints.state_tree import StateTree
from icofabric_sim.simulation.contact.broad_phase import (
    BroadPhase,
    NoContacts,
    Overlap,
)
from icofabric_sim.simulation.stepping.trajectory import Trajectory

_LOGGER = logging.getLogger('icofabric_sim')
# Halvings of the time in which a contact began.
_HALVINGS = 40


class ContactScheduler:
    """Searches for the candidate pairs of a trajectory; none if contacts are impossible."""

    def __init__(self, trajectory: Trajectory, phase: BroadPhase | NoContacts) -> None:
        """Find contacts of the `trajectory` by the broad `phase`."""
        self._trajectory, self.phase = trajectory, phase
        # Sentence on contacts that are too far from the origin for the tolerance; '': none are.
        self.rounding = ''
        trajectory.ledger.deepest_limit = phase.deepest
        self.report_overlaps()

    def report_overlaps(self) -> None:
        """Report overlaps from now on, once."""
        self._trajectory.ledger.reported_limit = self.phase.reported

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

    def counted(self, work: Callable[[], Any]) -> Any:
        """Call `work`, which takes steps, and count the pairs of shells that the steps test."""
        before = self.phase.evaluated
        try:
            return work()
        finally:
            self.phase.tests += self.phase.evaluated - before

    def search(
        self, time: float, step: float, steps: float, *, displacement: float = 0.0
    ) -> None:
        """
        Find candidate pairs from the present state on at `time` [s], for `steps` of `step` [s].

        The search also covers a `displacement` [m] of bodies, up to the longest reach.
        """
        if not self.phase.is_possible:
            return
        ledger = self._trajectory.ledger
        before = ledger.contact_rate
        self.phase.search(
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
        self.search(time, step, steps, displacement=factor * self.phase.displacement)
        return self.phase.searched == time

    def pace(self, step: float, *, alone: bool) -> None:
        """
        Choose for a `step` [s] how often displacements are checked.

        `alone`: kernels may search by themselves, as the step need not follow.
        """
        self.phase.pace(step, self._trajectory.method.stages, alone=alone)

    def calm(self, time: float = math.inf) -> bool:
        """
        End searches for accelerating bodies if their time has passed; return True if ended now.
        """
        phase = self.phase
        if not phase.is_wary or time < phase.wary_until:
            return False
        phase.calm()
        return True

    def forget(self) -> None:
        """Reset searches and reports to the beginning of a run."""
        self.report_overlaps()
        self.rounding = ''
        self.phase.forget()

    def require_room(self) -> None:
        """Raise for large initial overlaps; record smaller ones."""
        phase, trajectory = self.phase, self._trajectory
        ledger = trajectory.ledger
        if ledger.deepest > ledger.deepest_limit:
            trajectory.fail(
                f'{phase.note(trajectory.time, trajectory.state)}; move them apart, or set '
                'contact.mode never')
        if ledger.deepest > ledger.reported_limit:
            self._note(phase.note(trajectory.time, trajectory.state))

    def handle_overlap(self, time: float, *, stop: bool) -> None:
        """Report once that an overlap exceeds the intended one, or stop the run."""
        phase, trajectory = self.phase, self._trajectory
        found = phase.note(time, trajectory.state)
        if not stop:
            self._note(found)
            phase.announce()
            return
        self.refuse_conflict(time)
        trajectory.return_to_saved()
        trajectory.fail(
            f'{found}, which is more than a fifth of the inscribed radius '
            f'({trajectory.ledger.deepest_limit:.3g} m): they might pass through each other. '
            f'Give a larger contact.stiffness than {phase.stiffness:.4g} N/m; the last '
            f'good state, of t = {trajectory.saved_time:.9g} s, is kept')

    def refuse_conflict(self, time: float) -> None:
        """Stop the run if prescribed motions press bodies on that cannot yield, at `time` [s]."""
        trajectory = self._trajectory
        text, number = self.phase.find_conflict(trajectory.state)
        if not text:
            return
        since = self._touched_since(number, time)
        found = self.phase.note(time, trajectory.state)
        trajectory.return_to_saved()
        trajectory.fail(
            f'{text} from t = {since}: {found}, and neither is free to yield. Change one of the '
            'motions, or leave a degree of freedom along the contact free; with contact.mode '
            f'never they pass through each other. The last good state, of t = '
            f'{trajectory.saved_time:.9g} s, is kept')

    def _touched_since(self, number: int, time: float) -> str:
        """
        Return when the present contact of a pair began, on the segments of paths of a `time` [s].
        """
        trajectory = self._trajectory
        drives = trajectory.loads.drives
        early = 0.0 if drives is None else float(drives.start.max())
        touches = [
            self.phase.depth_of(number, trajectory.state_at_paths(moment)) > 0.0
            for moment in (early, time)]
        if touches != [False, True]:
            return f'{min(early, time):.9g} s or before'
        late = time
        for _ in range(_HALVINGS):
            middle = 0.5 * (early + late)
            if self.phase.depth_of(number, trajectory.state_at_paths(middle)) > 0.0:
                late = middle
            else:
                early = middle
        return f'{late:.6g} s'

    def _note(self, found: Overlap | None) -> None:
        self._trajectory.ledger.reported_limit = math.inf
        self.phase.found = self.phase.found or found

    def refuse_passing(self, before: State, after: State, start: float, end: float) -> None:
        """
        Stop `before` a step in which shells may pass through each other, and keep that state.

        The state is the present one or the saved one.
        """
        found = self.phase.passing_by(before, after, start, end, long=True)
        if found:
            if before is self._trajectory.state:
                self._trajectory.save()
            self.stop_passing(found)

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
        return {'watch': self.phase.state_tree()} if isinstance(self.phase, BroadPhase) else {}

    def load_state(self, tree: StateTree) -> None:
        """Restore the last search from a checkpoint."""
        if isinstance(self.phase, BroadPhase):
            self.phase.load_state(tree.part('watch'))
            self._compute_found()

    def _compute_found(self) -> None:
        """Evaluate only the listed pairs from now on."""
        self._trajectory.set_contacts(self.phase.contacts)
        self._trajectory.ledger.contact_rate = self._judged_rate

    @property
    def _judged_rate(self) -> float:
        """Rate [1/s^2] that health checks add to the bound of the squared frequency."""
        return self.phase.rate if self.phase.counts_listed else 0.0
