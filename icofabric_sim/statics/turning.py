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
"""Moment against angle of a slab whose two held ends are turned against each other."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from icofabric_sim import checks
from icofabric_sim.scene.scene import require_scene, Scene
from icofabric_sim.simulation.model.as_table import Results
from icofabric_sim.simulation.model.body_force import BodyForce, Force
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.statics.held_motion import BEND, held_motion, HeldMotion, TURNED
from icofabric_sim.statics.slab_path import Break, follow, Rest, Step, tension_range
import numpy as np

KINDS = TURNED


class TurnPoint(NamedTuple):
    """One state of the slab."""

    angle: float  # [rad] of one end against the other
    moment: float  # [N m] derivative of the energy by the angle
    # [N m^2] moment, less that without any angle, for each turn in a unit of length: bending
    # stiffness EI, or twisting stiffness GJ.
    rigidity: float
    energy: float  # [J]
    verdict: str
    residual: float
    obstructed: int  # connectors that lead through a shell of their own, or lie around it
    beyond: int  # connectors beyond the length at which they break
    broken: int  # connectors that have broken so far
    touching: int  # pairs of shells that push each other
    sliding: int  # of these, pairs that slide (contact.friction)
    at_kink: int  # connectors at their natural length, where k_e is not k_c
    # Connectors that are there without any angle, or have come to the other side since.
    past_kink: int
    rest_moment: float  # [N m] without any angle, from natural lengths; NaN: no equilibrium
    end_force: tuple[float, float, float]  # [N] that holds the moved end, world axes
    end_moment: tuple[float, float, float]  # [N m] the same, about the centre of that end
    tension_range: tuple[float, float]  # [N] least and largest of connectors; below 0: they push
    breaks: tuple[Break, ...]  # at this angle, in their order
    snapshot: Snapshot

    def __repr__(self) -> str:
        """Say what was found, without the numbers of the state."""
        return (f'<TurnPoint: angle {self.angle:.6g} rad, moment {self.moment:.6g} N m, '
                f'{self.verdict}>')

    def row(self) -> list[float | str]:
        """All but breaks and the snapshot as plain values, in the order of `TURN_COLUMNS`."""
        return [*self[:14], *self.end_force, *self.end_moment, *self.tension_range]


# Names of columns of a table of states, with units.
TURN_COLUMNS = (
    'angle_rad', 'moment_nm', 'rigidity_nm2', 'energy_j', 'verdict', 'residual', 'obstructed',
    'beyond_break_length', 'broken', 'touching_pairs', 'sliding_pairs', 'at_kink', 'past_kink',
    'rest_moment_nm', 'end_force_x_n', 'end_force_y_n', 'end_force_z_n', 'end_moment_x_nm',
    'end_moment_y_nm', 'end_moment_z_nm', 'least_tension_n', 'largest_tension_n')


def measure_turning(
    scene: Scene, kind: str, angles: Sequence[float], *, axis: int = 0, about: int | None = None,
    body_force: BodyForce | Force | None = None, progress: Callable[[int], None] | None = None
) -> Results[TurnPoint]:
    """
    Equilibria of a slab whose ends along the world's `axis` are turned against each other.

    The bodies of one end are held as they are woven, those of the other end are turned as one
    rigid body by `angles` [rad], which go away from 0 on one side of it. 'twist': about `axis`,
    the distance of the ends kept. 'bend': about the axis `about` across it (None: the next one),
    the centre of the end on an arc of the woven length, so that the middle line of a slab that
    bends evenly keeps its length. All else is as in `measure_curve`.

    `moment` is the derivative of the energy by the angle. In a bend it has the part that the force
    on the end does as the arc brings the ends nearer, so it differs from the component of
    `end_moment`, which is about the centre of the end, in second order of the angle.
    """
    return Results(TURN_COLUMNS, turn_points(
        scene, kind, angles, axis=axis, about=about, body_force=body_force, progress=progress))


def turn_points(
    scene: Scene, kind: str, angles: Sequence[float], *, axis: int = 0, about: int | None = None,
    body_force: BodyForce | Force | None = None, progress: Callable[[int], None] | None = None
) -> Iterator[TurnPoint]:
    """The same, each as soon as it is found."""
    require_scene(scene)
    checks.choice('kind', kind, KINDS)
    steps = check_angles('angles', angles)
    axis = checks.count('axis', axis, 0, 2)
    check_about(kind, axis, about)
    if progress is not None:
        checks.function('progress', progress)
    motion = held_motion(scene, kind, axis, about, body_force)
    rest = Rest(motion)
    for number, step in enumerate(follow(motion, steps, rest)):
        yield turn_point(motion, rest, step)
        if progress is not None:
            progress(number + 1)


def check_angles(name: str, angles: Sequence[float]) -> list[float]:
    """Angles [rad], the argument `name`, which go away from 0; ValueError if not."""
    steps = checks.array(name, angles, ('n',), 'rad')
    size = np.abs(steps)
    if not len(steps) or not size[0] > 0.0 or (np.diff(size) <= 0.0).any() or (
            np.sign(steps) != np.sign(steps[0])).any():
        raise ValueError(
            f'{name} must go away from 0 rad on one side of it, got '
            f'{checks.shown(steps.tolist())}')
    found: list[float] = steps.tolist()
    return found


def check_about(kind: str, axis: int, about: int | None) -> None:
    """Refuse an axis that a bend cannot turn about."""
    if about is None:
        return
    checks.count('about', about, 0, 2)
    if kind != BEND:
        raise ValueError(f'about is of a {BEND} alone: a {kind} has its axis by itself')
    if about == axis:
        raise ValueError(
            f'about must be an axis across {"xyz"[axis]}, along which the ends lie, got '
            f'{"xyz"[about]}')


def turn_point(motion: HeldMotion, rest: Rest, step: Step) -> TurnPoint:
    """What there is to say of a state."""
    found, tally = step.found, rest.tally(step.found)
    force, moment = motion.end_wrench(found.snapshot.position, found.reaction)
    turned = (step.conjugate - rest.conjugate) * motion.length
    return TurnPoint(
        step.amount, step.conjugate, turned / step.amount if step.amount else np.nan,
        float(found.snapshot.energy['total']), found.verdict, found.residual, *tally,
        rest.conjugate, force, moment, tension_range(found), step.breaks, found.snapshot)
