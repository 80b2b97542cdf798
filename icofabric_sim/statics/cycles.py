# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""A slab that is loaded and unloaded again, step by step, and the energy that it loses by that."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from icofabric_sim import checks
from icofabric_sim.scene.scene import require_scene, Scene
from icofabric_sim.simulation.model.as_table import Results
from icofabric_sim.simulation.model.body_force import BodyForce, Force
from icofabric_sim.statics.held_motion import check_along, held_motion, STRAINED, TURNED
from icofabric_sim.statics.slab_path import follow, Rest, Step
from icofabric_sim.statics.stretching import check_strains, curve_point, CurvePoint
from icofabric_sim.statics.turning import check_about, check_angles, turn_point, TurnPoint
import numpy as np

KINDS = (*STRAINED, *TURNED)


class Cycle(NamedTuple):
    """One way there and back; energies are NaN where it ended early."""

    work: float  # [J] put in on the way there
    regained: float  # [J] on the way back
    lost: float  # [J] the area of the loop: work less what was regained
    released: float  # [J] by which the energy fell at breaks
    left: float  # [J] that the slab has more at the end than at the beginning
    broken: int  # connectors that broke in it
    points: tuple[CurvePoint | TurnPoint, ...]

    def __repr__(self) -> str:
        """Say what was found, without its states."""
        return (f'<Cycle: {self.work:.6g} J put in, {self.lost:.6g} J lost, '
                f'{self.broken:,} broken, {len(self.points):,} states>')

    def row(self) -> list[float]:
        """All but the states as plain values, in the order of `CYCLE_COLUMNS`."""
        return list(self[:-1])


# Names of columns of a table of cycles, with units.
CYCLE_COLUMNS = ('work_j', 'regained_j', 'lost_j', 'released_j', 'left_j', 'broken')


def measure_cycles(
    scene: Scene, kind: str, amounts: Sequence[float], *, count: int = 1, axis: int = 0,
    about: int | None = None, along: Sequence[float] | None = None,
    body_force: BodyForce | Force | None = None, progress: Callable[[int], None] | None = None
) -> Results[Cycle]:
    """
    Load a slab through `amounts`, back through the same to 0, and so on `count` times.

    `kind`, `amounts` and `along`: strains of a pull, push, shear, hydrostatic pressure or
    inflation as in `measure_curve`, or angles [rad] of a bend or twist as in `measure_turning`.
    What breaks is gone for all that follows. A `body_force` acts as it does in `measure_curve`.

    The work is the sum over the steps of mean force times path, each step from the state after
    the breaks of the last one to that before its own; so the area of a loop without breaks is 0 to
    rounding, and that of one with breaks has an error of second order in the steps. In exact
    steps `lost` is `released` and `left` together, or more, where the slab snaps on its way.
    Ends early where no equilibrium is found.
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
    """Cycles as they are found."""

    def __init__(
        self, scene: Scene, kind: str, amounts: Sequence[float], *, count: int = 1,
        axis: int = 0, about: int | None = None, along: Sequence[float] | None = None,
        body_force: BodyForce | Force | None = None
    ) -> None:
        """Judge the arguments of `measure_cycles`."""
        require_scene(scene)
        checks.choice('kind', kind, KINDS)
        there = (check_angles('amounts', amounts) if kind in TURNED else
                 check_strains('amounts', kind, amounts))
        self._kind, axis = kind, checks.count('axis', axis, 0, 2)
        if kind in TURNED:
            check_about(kind, axis, about)
        elif about is not None:
            raise ValueError(f'about is of a bend alone: leave it out for a {kind}')
        self._once = [*there, *there[-2::-1], 0.0]
        self._turning = len(there)
        self.path = self._once * checks.count('count', count, 1)
        self._motion = held_motion(
            scene, kind, axis, about, body_force, check_along(kind, axis, along))
        self._rest = Rest(self._motion)
        self._found: list[tuple[Step, CurvePoint | TurnPoint]] = []

    def points(self) -> Iterator[CurvePoint | TurnPoint]:
        """Each state as soon as it is found."""
        for step in follow(self._motion, self.path, self._rest):
            point = (
                turn_point(self._motion, self._rest, step) if self._kind in TURNED else
                curve_point(self._motion, self._kind, self._rest, step))
            self._found.append((step, point))
            yield point

    def cycles(self) -> Results[Cycle]:
        """What the states found so far make."""
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
                there, back, there - back, sum(each.released for each in breaks), left,
                len(breaks), points))
        return cycles
