# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Equilibrium solve for a paused fabric: computed in a thread, result applied between two steps.

The result is an event with all positions and orientations, so that a replay does not solve again.
"""

from collections.abc import Callable
from concurrent.futures import Future
import math
import threading
from typing import Any, TYPE_CHECKING

from icofabric_sim.checks import counted
from icofabric_sim.messages.schedule import seconds
from icofabric_sim.running.broadcast import Broadcast
from icofabric_sim.running.run_events import do_event
from icofabric_sim.running.run_state import RunState
from icofabric_sim.running.time_advance import TimeAdvance
from icofabric_sim.simulation.errors import SimulationError
import numpy as np

if TYPE_CHECKING:
    from icofabric_sim.statics.equilibrium import Equilibrium
    from icofabric_sim.statics.present import PresentState

_UNCHANGED = 'the fabric is unchanged'


class EquilibriumSolve:
    """Equilibrium solver of a run; one solve at a time."""

    def __init__(
        self, state: RunState, time: TimeAdvance, broadcast: Broadcast,
        post: Callable[[Callable[[], Any]], object]
    ) -> None:
        """Change `state`; `post` runs a call in the thread of the run."""
        self._state, self._time, self._broadcast, self._post = state, time, broadcast, post
        self._is_solving = False

    def start(self, found: 'Future[Any]') -> None:
        """Start to solve from the thread of the run; `found` gets a sentence or an exception."""
        try:
            self._require_paused()
            # Imported here, because a run seldom needs it.
            from icofabric_sim.statics.present import capture_run_state
            present = capture_run_state(
                self._state.simulation, self._state.parameters['equilibrium.objective'])
        except Exception as error:  # noqa: BLE001 - passed to the caller
            found.set_exception(error)
            return
        self._is_solving = True
        threading.Thread(
            target=self._solve, args=(present, found), name='equilibrium', daemon=True).start()

    def _require_paused(self) -> None:
        self._state.require_sound('no equilibrium can be solved')
        if self._is_solving:
            raise RuntimeError('an equilibrium is already being solved')
        if not self._state.paused or self._time.requests.current is not None:
            raise RuntimeError(f'the fabric is moving; pause it first (~/pause); {_UNCHANGED}')

    def _solve(self, present: 'PresentState', found: 'Future[Any]') -> None:
        from icofabric_sim.statics.present import solve_run_equilibrium
        try:
            result = solve_run_equilibrium(present)
            if not result.converged:
                raise RuntimeError(f'{result.verdict}: {result.reason}; {_UNCHANGED}')
        except Exception as error:  # passed to the caller
            self._is_solving = False
            found.set_exception(error)
            return
        self._post(lambda: self._finish(present, result, found))

    def _finish(
        self, present: 'PresentState', result: 'Equilibrium', found: 'Future[Any]'
    ) -> None:
        """Set the fabric to the equilibrium, in the thread of the run."""
        self._is_solving = False
        try:
            found.set_result(self._apply(present, result))
        except Exception as error:  # passed to the caller
            found.set_exception(error)

    def _apply(self, present: 'PresentState', result: 'Equilibrium') -> str:
        state = self._state
        self._require_paused()
        # Compared with the state at the start of the solve.
        if state.simulation.snapshot() is not present.snapshot:
            raise RuntimeError(
                f'the fabric or its loads have changed during the solve; {_UNCHANGED}')
        is_least = present.objective == 'resultants'
        facts = {
            'verdict': result.verdict, 'residual': result.residual,
            'mechanism_count': result.mechanism_count,
            **({} if result.contacts is None else {'contacts': result.contacts.table()}),
            **({'unbalanced_wrench': result.unbalanced_wrench.tolist()} if is_least else {}),
            'position': result.snapshot.position.tolist(),
            'orientation': result.snapshot.orientation.tolist()}
        before = state.simulation.checkpoint()
        try:
            do_event(state.simulation, state.now, 'equilibrium', facts)
        except (SimulationError, ValueError) as error:
            state.simulation.restore(before)
            raise ValueError(
                f'the equilibrium cannot be set: {error}; {_UNCHANGED}') from error
        self._time.restart_motion()
        self._broadcast.event(state.now, 'equilibrium', **facts)
        self._time.show_after('equilibrium')
        what = _resultants_text(result) if is_least else _contacts_text(result)
        return (f'{result.verdict}, residual {result.residual:.2g}{what}, '
                f't = {seconds(state.now):.9f} s')


def _resultants_text(result: 'Equilibrium') -> str:
    """Return the largest unbalanced force and moment, and the bodies on which they act."""
    force, moment = (
        np.linalg.norm(part, axis=1) for part in np.split(result.unbalanced_wrench, 2, 1))
    return (f', the largest resultants left are {force.max():.3g} N on body {np.argmax(force)} '
            f'and {moment.max():.3g} N m on body {np.argmax(moment)}')


def _contacts_text(result: 'Equilibrium') -> str:
    """Return the number of contacts, the largest force, and the largest resultant on a shell."""
    contacts = result.contacts
    if contacts is None or not len(contacts.bodies):
        return ''
    forces = np.linalg.norm(contacts.force, axis=1)
    sums = np.linalg.norm(
        contacts.resultants(len(result.snapshot.position))[:, :3], axis=1)
    return (f', {counted(len(forces), "contact")}, largest force {forces.max():.3g} N, on '
            f'body {contacts.bodies[np.argmax(forces), 0]}, largest resultant '
            f'{sums.max():.3g} N, on body {np.argmax(sums)}' + (
                '' if math.isnan(result.friction_needed) else
                f', smallest friction margin {contacts.smallest_margin:.3g}'))
