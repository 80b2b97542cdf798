# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Hysteresis: quasi-static loading and unloading of a slab, and the energy dissipated."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from icofabric_sim import checks
from icofabric_sim.checks import renamed_attributes
from icofabric_sim.scene.scene import require_scene, Scene
from icofabric_sim.simulation.model.as_table import Results
from icofabric_sim.simulation.model.body_force import BodyForce, Force
from icofabric_sim.statics.held_motion import check_along, held_motion, STRAINED, TURNED
from icofabric_sim.statics.moment_curve import (
    check_about,
    check_angles,
    moment_curve_point,
    MomentCurvePoint,
)
from icofabric_sim.statics.slab_path import follow_path, InitialEquilibrium, Step
from icofabric_sim.statics.stress_strain import check_strains, curve_point, CurvePoint
import numpy as np

KINDS = (*STRAINED, *TURNED)


@renamed_attributes(
    work='loading_work', regained='unloading_work', lost='loop_area',
    released='released_energy', left='energy_gain')
class Cycle(NamedTuple):
    """One cycle of loading and unloading; energies are NaN if the cycle ended early."""

    loading_work: float  # [J] external work of loading
    unloading_work: float  # [J] work returned in unloading
    loop_area: float  # [J] `loading_work` less `unloading_work`
    released_energy: float  # [J] decrease of energy at breaks
    energy_gain: float  # [J] increase of the slab's energy over the cycle
    broken: int  # connectors that broke in the cycle
    points: tuple[CurvePoint | MomentCurvePoint, ...]

    def __repr__(self) -> str:
        """Return a summary without the states."""
        return (f'<Cycle: {self.loading_work:.6g} J loading work, loop of {self.loop_area:.6g} J, '
                f'{self.broken:,} broken, {len(self.points):,} states>')

    def row(self) -> list[float]:
        """Return all fields but the states as plain values, in the order of `CYCLE_COLUMNS`."""
        return list(self[:-1])


# Names of columns of a table of cycles, with units.
CYCLE_COLUMNS = (
    'loading_work_j', 'unloading_work_j', 'loop_area_j', 'released_energy_j', 'energy_gain_j',
    'broken')


def measure_cycles(
    scene: Scene, kind: str, amounts: Sequence[float], *, count: int = 1, axis: int = 0,
    about: int | None = None, along: Sequence[float] | None = None,
    body_force: BodyForce | Force | None = None, progress: Callable[[int], None] | None = None
) -> Results[Cycle]:
    """
    Load a slab through `amounts` and unload it through the same amounts to 0, `count` times.

    Parameters
    ----------
    scene
        The slab, as in `measure_curve`.
    kind
        'pull', 'push', 'shear', 'hydrostatic' or 'inflation' (strains, as in `measure_curve`), or
        'bend' or 'twist' (angles, as in `measure_moment_curve`).
    amounts
        Strains, or angles [rad], of the loading path.
    count
        Number of cycles. Broken connectors stay broken.
    axis
        World axis from end to end.
    about
        Axis of a bend, as in `measure_moment_curve`.
    along
        Direction of the displacement (3,), world frame, as in `measure_curve`.
    body_force
        Steady forces on the bodies, as in `measure_curve`.
    progress
        Called with the number of states found.

    Returns
    -------
    Results of Cycle
        One for each cycle. The last one ends early if an equilibrium is not found.

    Notes
    -----
    The work is the sum over the steps of mean force times displacement. A step leads from the
    state after the breaks of the previous step to the state before its own breaks. So the area of
    a loop without breaks, friction and snap-through is 0 up to round-off, and the error with
    breaks is of second order in the step size. For exact steps `loop_area` equals
    `released_energy` plus `energy_gain`, or exceeds this sum if the slab snaps through or contacts
    slide.
    """
    if progress is not None:
        checks.function('progress', progress)
    run = CycleRun(
        scene, kind, amounts, count=count, axis=axis, about=about, along=along,
        body_force=body_force)
    for number, _ in enumerate(run.points()):
        if progress is not None:
            progress(number + 1)
    return run.cycles()


class CycleRun:
    """Run that yields the states of cycles one by one."""

    def __init__(
        self, scene: Scene, kind: str, amounts: Sequence[float], *, count: int = 1,
        axis: int = 0, about: int | None = None, along: Sequence[float] | None = None,
        body_force: BodyForce | Force | None = None
    ) -> None:
        """Check the arguments of `measure_cycles`."""
        require_scene(scene)
        checks.choice('kind', kind, KINDS)
        there = (check_angles('amounts', amounts) if kind in TURNED else
                 check_strains('amounts', kind, amounts))
        self._kind, axis = kind, checks.count('axis', axis, 0, 2)
        if kind in TURNED:
            check_about(kind, axis, about)
        elif about is not None:
            raise ValueError(f'about applies to a bend only: leave it out for a {kind}')
        self._once = [*there, *there[-2::-1], 0.0]
        self._turning = len(there)
        self.path = self._once * checks.count('count', count, 1)
        self._motion = held_motion(
            scene, kind, axis, about, body_force, check_along(kind, axis, along))
        self._rest = InitialEquilibrium(self._motion)
        self._found: list[tuple[Step, CurvePoint | MomentCurvePoint]] = []

    def points(self) -> Iterator[CurvePoint | MomentCurvePoint]:
        """Yield the states one by one, each when found."""
        for step in follow_path(self._motion, self.path, self._rest):
            point = (
                moment_curve_point(self._motion, self._rest, step) if self._kind in TURNED else
                curve_point(self._motion, self._kind, self._rest, step))
            self._found.append((step, point))
            yield point

    def cycles(self) -> Results[Cycle]:
        """Return the cycles of the states found so far."""
        size, cycles = len(self._once), Results[Cycle](CYCLE_COLUMNS, number='cycle')
        amount, force = 0.0, self._rest.conjugate
        energy = float(self._rest.found.snapshot.energy['total'])
        for first in range(0, len(self._found), size):
            part = self._found[first:first + size]
            points = tuple(point for _, point in part)
            breaks = [each for point in points for each in point.breaks]
            works = []
            for step, _ in part:
                works.append(0.5 * (force + step.before_breaks) * (step.amount - amount))
                amount, force = step.amount, step.conjugate
            there, back = sum(works[:self._turning]), -sum(works[self._turning:])
            left = points[-1].energy - energy
            energy = points[-1].energy
            if len(part) < size or not part[-1][0].found.converged:
                there = back = left = np.nan
            cycles.append(Cycle(
                there, back, there - back, sum(each.released_energy for each in breaks), left,
                len(breaks), points))
        return cycles
