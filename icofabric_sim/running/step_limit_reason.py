# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Description of the limit of a run's step, and of its start time."""

import time as wall

from icofabric_sim.kernels.runtime.kernel_guard import is_compiler_free, no_compiling
from icofabric_sim.messages.schedule import seconds
from icofabric_sim.process.compile_notice import KernelsMissing
from icofabric_sim.running.run_records import step_limit
from icofabric_sim.simulation.simulation import Simulation
from icofabric_sim.simulation.stepping.methods import facts_of

# A step above this ratio of the stability limit is limited by stability, including the safety
# factor.
_LIMIT_RATIO = 0.5
# The search for the place takes at most one part in this number of the wall time.
_MAX_SEARCH_SHARE = 200.0


class StepLimit:
    """Monitor of the step limit of one run; use in its thread."""

    def __init__(self) -> None:
        """Create a monitor without a known limit."""
        self._known: tuple[str, str] | None = None
        self._since = 0
        self._place, self._place_since, self._looked = '', 0, 0.0

    def describe(self, simulation: Simulation, now: int, *, with_place: bool = True) -> str:
        """
        Return a sentence on the limit at time `now` [ns]: kind, cause and start time.

        The place of the fastest motion needs an eigenvalue search and is optional.
        """
        status = simulation.status
        term = status.fastest_term
        known = _kind(simulation), term.rpartition(', up to')[0]
        is_other = known != self._known or now < self._since
        if is_other:
            self._known, self._since = known, now
        where = ''
        if 'contacts' in term:
            where = f', {status.contact_count} of which touched at the last health check'
        place = self._place_of(simulation, now, anew=is_other) if with_place else ''
        return (
            f'{known[0]}; fastest: {term}{where}; since t = {seconds(self._since):.6g} s{place}')

    def _place_of(self, simulation: Simulation, now: int, *, anew: bool) -> str:
        """Return the place of the fastest motion and its start time."""
        began = wall.perf_counter()
        if anew:
            # The known place belongs to another limit.
            self._place, self._place_since = '', now
        if began >= self._looked:
            try:
                with no_compiling(loading=is_compiler_free()):
                    place = simulation.status.fastest_place()
            except KernelsMissing:
                # A later report has it, see `Simulation.prepare_contacts`.
                place = ''
            # The overlap does not identify the place.
            same = place.partition(', by ')[0] == self._place.partition(', by ')[0]
            if anew or not same or now < self._place_since:
                self._place_since = now
            self._place, ended = place, wall.perf_counter()
            self._looked = ended + _MAX_SEARCH_SHARE * (ended - began)
        return self._place and f'; {self._place}, since t = {seconds(self._place_since):.6g} s'


def _kind(simulation: Simulation) -> str:
    parameters, status = simulation.scene.parameters, simulation.status
    tolerance = f'solver.tolerance {parameters["solver.tolerance"]:g}'
    if parameters['solver.step'] > 0.0:
        return 'solver.step, which is fixed'
    if facts_of(status.method_name).adaptive:
        return f'accuracy (the error of each step, {tolerance})'
    if status.step > _LIMIT_RATIO * step_limit(simulation):
        return 'stability'
    return f'accuracy ({tolerance})'
