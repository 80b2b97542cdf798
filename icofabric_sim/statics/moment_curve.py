# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Moment-angle curves of a slab whose held ends are rotated against each other."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from icofabric_sim import checks
from icofabric_sim.checks import renamed_attributes
from icofabric_sim.scene.scene import require_scene, Scene
from icofabric_sim.simulation.model.as_table import Results
from icofabric_sim.simulation.model.body_force import BodyForce, Force
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.statics.held_motion import BEND, held_motion, HeldMotion, TURNED
from icofabric_sim.statics.slab_path import (
    Break,
    follow_path,
    InitialEquilibrium,
    Step,
    tension_range,
)
import numpy as np

KINDS = TURNED


@renamed_attributes(
    beyond='beyond_break_length', touching='contact_pairs', sliding='sliding_pairs')
class MomentCurvePoint(NamedTuple):
    """State of the slab at one angle."""

    angle: float  # [rad] between the ends
    moment: float  # [N m] derivative of the energy with respect to the angle
    # [N m^2] moment less `rest_moment`, over curvature or twist per length: bending stiffness EI,
    # or torsional stiffness GJ.
    rigidity: float
    energy: float  # [J]
    verdict: str
    residual: float
    obstructed: int  # connectors that pass through the shell they are attached to, or wrap over it
    beyond_break_length: int  # connectors beyond the length at which they break
    broken: int  # connectors that have broken so far
    contact_pairs: int  # pairs of shells in contact
    sliding_pairs: int  # of these, sliding pairs (contact.friction)
    at_kink: int  # connectors at their natural length with k_e other than k_c
    # Connectors at their kink at angle 0, or that have crossed their natural length since then.
    past_kink: int
    rest_moment: float  # [N m] at angle 0, from natural lengths; NaN: no equilibrium
    end_force: tuple[float, float, float]  # [N] on the moved end, world axes
    end_moment: tuple[float, float, float]  # [N m] on the moved end about its centre
    tension_range: tuple[float, float]  # [N] smallest and largest; negative: compression
    breaks: tuple[Break, ...]  # at this angle, in order
    snapshot: Snapshot

    def __repr__(self) -> str:
        """Return a summary without the state."""
        return (f'<MomentCurvePoint: angle {self.angle:.6g} rad, moment {self.moment:.6g} N m, '
                f'{self.verdict}>')

    def row(self) -> list[float | str]:
        """Return values in the order of `MOMENT_CURVE_COLUMNS`, without breaks and snapshot."""
        return [*self[:14], *self.end_force, *self.end_moment, *self.tension_range]


# Names of columns of a table of states, with units.
MOMENT_CURVE_COLUMNS = (
    'angle_rad', 'moment_nm', 'rigidity_nm2', 'energy_j', 'verdict', 'residual', 'obstructed',
    'beyond_break_length', 'broken', 'contact_pairs', 'sliding_pairs', 'at_kink', 'past_kink',
    'rest_moment_nm', 'end_force_x_n', 'end_force_y_n', 'end_force_z_n', 'end_moment_x_nm',
    'end_moment_y_nm', 'end_moment_z_nm', 'least_tension_n', 'largest_tension_n')


def measure_moment_curve(
    scene: Scene, kind: str, angles: Sequence[float], *, axis: int = 0, about: int | None = None,
    body_force: BodyForce | Force | None = None, progress: Callable[[int], None] | None = None
) -> Results[MomentCurvePoint]:
    """
    Compute the moment-angle curve of a slab in bending or torsion.

    The bodies of one end are held as woven, and those of the other end rotate as one rigid body.
    Other conditions are as in `measure_curve`.

    Parameters
    ----------
    scene
        Slab, as in `measure_curve`.
    kind
        'twist': rotation about `axis` at a constant distance of the ends. 'bend': rotation about
        the lateral axis `about`, with the centre of the end on an arc of the woven length, so that
        the centre line of a uniformly bent slab keeps its length.
    angles
        Angles [rad], of one sign and with rising magnitude.
    axis
        World axis from end to end.
    about
        World axis of a bend, perpendicular to `axis`; None: the next axis.
    body_force
        Steady forces on the bodies, as in `measure_curve`.
    progress
        Called with the number of states found.

    Returns
    -------
    Results of MomentCurvePoint
        One for each angle; fewer if no equilibrium is found.

    Notes
    -----
    `moment` is the derivative of the energy with respect to the angle. In a bend it includes the
    work of the end force, because the arc brings the ends closer. It differs from the component
    of `end_moment`, about the centre of the end, by a term of second order in the angle.
    """
    return Results(MOMENT_CURVE_COLUMNS, moment_curve_points(
        scene, kind, angles, axis=axis, about=about, body_force=body_force, progress=progress))


def moment_curve_points(
    scene: Scene, kind: str, angles: Sequence[float], *, axis: int = 0, about: int | None = None,
    body_force: BodyForce | Force | None = None, progress: Callable[[int], None] | None = None
) -> Iterator[MomentCurvePoint]:
    """Yield the points of `measure_moment_curve`, each when found."""
    require_scene(scene)
    checks.choice('kind', kind, KINDS)
    steps = check_angles('angles', angles)
    axis = checks.count('axis', axis, 0, 2)
    check_about(kind, axis, about)
    if progress is not None:
        checks.function('progress', progress)
    motion = held_motion(scene, kind, axis, about, body_force)
    rest = InitialEquilibrium(motion)
    for number, step in enumerate(follow_path(motion, steps, rest)):
        yield moment_curve_point(motion, rest, step)
        if progress is not None:
            progress(number + 1)


def check_angles(name: str, angles: Sequence[float]) -> list[float]:
    """Return the angles [rad]; raise ValueError unless of one sign and rising magnitude."""
    steps = checks.array(name, angles, ('n',), 'rad')
    size = np.abs(steps)
    if not len(steps) or not size[0] > 0.0 or (np.diff(size) <= 0.0).any() or (
            np.sign(steps) != np.sign(steps[0])).any():
        raise ValueError(
            f'{name} must be nonzero, of one sign and of rising magnitude [rad], got '
            f'{checks.shown(steps.tolist())}')
    found: list[float] = steps.tolist()
    return found


def check_about(kind: str, axis: int, about: int | None) -> None:
    """Raise ValueError unless `about` is a lateral axis of a bend, or None."""
    if about is None:
        return
    checks.count('about', about, 0, 2)
    if kind != BEND:
        raise ValueError(f'about applies to a {BEND} only: leave it out for a {kind}')
    if about == axis:
        raise ValueError(
            f'about must be an axis perpendicular to {"xyz"[axis]}, which leads from end to end, '
            f'got {"xyz"[about]}')


def moment_curve_point(
    motion: HeldMotion, rest: InitialEquilibrium, step: Step
) -> MomentCurvePoint:
    """Return the point of a curve for one step of a path."""
    found, counts = step.found, rest.count_state(step.found)
    force, moment = motion.end_wrench(found.snapshot.position, found.reaction)
    turned = (step.conjugate - rest.conjugate) * motion.length
    return MomentCurvePoint(
        step.amount, step.conjugate, turned / step.amount if step.amount else np.nan,
        float(found.snapshot.energy['total']), found.verdict, found.residual, *counts,
        rest.conjugate, force, moment, tension_range(found), step.breaks, found.snapshot)
