# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Stress-strain curves of a slab between two held ends, or with all outer faces held."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from icofabric_sim import checks
from icofabric_sim.checks import renamed_attributes
from icofabric_sim.scene.radial import check_radius
from icofabric_sim.scene.scene import require_scene, Scene
from icofabric_sim.simulation.model.as_table import Results
from icofabric_sim.simulation.model.body_force import BodyForce, Force
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.statics.held_motion import (
    check_along,
    held_motion,
    HeldMotion,
    HYDROSTATIC,
    INFLATION,
    PUSH,
    STRAINED,
)
from icofabric_sim.statics.slab_path import (
    Break,
    follow_path,
    InitialEquilibrium,
    Step,
    tension_range,
)
import numpy as np

KINDS = STRAINED


@renamed_attributes(
    beyond='beyond_break_length', touching='contact_pairs', sliding='sliding_pairs')
class CurvePoint(NamedTuple):
    """State of the slab at one strain."""

    # Displacement of the end over the distance of the ends, or of all faces over their distance
    # from the centre.
    strain: float
    # [Pa] force on the end along its displacement over the woven cross section, or the pressure
    # (inflation: tension) on all faces.
    stress: float
    energy: float  # [J]
    verdict: str
    residual: float
    obstructed: int  # connectors that pass through the shell they are attached to, or wrap over it
    beyond_break_length: int  # connectors beyond the length at which they break
    broken: int  # connectors that have broken so far
    contact_pairs: int  # pairs of shells in contact
    sliding_pairs: int  # of these, sliding pairs (contact.friction)
    at_kink: int  # connectors at their natural length with k_e other than k_c
    # Connectors at their kink at strain 0, or past their natural length since. If there are any,
    # the response depends on their initial distance from the kink.
    past_kink: int
    # [Pa] stress at strain 0, where other forces act or natural and woven lengths differ; NaN: no
    # equilibrium.
    rest_stress: float
    # Strains xx, yy, zz of the middle third between the ends: slopes of displacements over woven
    # positions. NaN if all its bodies have the same position along that axis.
    middle_strain: tuple[float, float, float]
    end_force: tuple[float, float, float]  # [N] on the moved end, world axes
    tension_range: tuple[float, float]  # [N] smallest and largest; negative: compression
    end_moment: tuple[float, float, float]  # [N m] on the moved end about its centre
    breaks: tuple[Break, ...]  # at this strain, in order
    snapshot: Snapshot

    def __repr__(self) -> str:
        """Return a summary without the state."""
        return (f'<CurvePoint: strain {self.strain:.6g}, stress {self.stress:.6g} Pa, '
                f'{self.verdict}>')

    def row(self) -> list[float | str]:
        """Return the values in the order of `CURVE_COLUMNS`, without breaks and snapshot."""
        return [*self[:13], *self.middle_strain, *self.end_force, *self.tension_range,
                *self.end_moment]


# Names of columns of a table of curves, with units.
CURVE_COLUMNS = (
    'strain', 'stress_pa', 'energy_j', 'verdict', 'residual', 'obstructed', 'beyond_break_length',
    'broken', 'contact_pairs', 'sliding_pairs', 'at_kink', 'past_kink', 'rest_stress_pa',
    'middle_strain_xx', 'middle_strain_yy', 'middle_strain_zz', 'end_force_x_n', 'end_force_y_n',
    'end_force_z_n', 'least_tension_n', 'largest_tension_n', 'end_moment_x_nm', 'end_moment_y_nm',
    'end_moment_z_nm')


def measure_curve(
    scene: Scene, kind: str, strains: Sequence[float], *, axis: int = 0,
    along: Sequence[float] | None = None, body_force: BodyForce | Force | None = None,
    progress: Callable[[int], None] | None = None
) -> Results[CurvePoint]:
    """
    Compute the stress-strain curve of a slab: equilibria at prescribed strains.

    For a pull, push or shear, the bodies at both ends along the world's `axis` are held as woven,
    and one end is displaced along the axis or perpendicular to it; all other bodies are free. For
    hydrostatic compression or inflation all bodies that lack a neighbour are displaced towards the
    centre or away from it.

    Parameters
    ----------
    scene : Scene
        Slab, flat or radial. Loads, supports and drives of the scene are left out; planes and
        connector groups are used. The ends of a radial weave are its first and last row, column or
        level.
    kind : str
        'pull', 'push', 'shear', 'hydrostatic' or 'inflation'.
    strains : sequence of float
        Displacements over the length between the ends, or over the distance from the centre;
        positive and rising.
    axis : int
        World axis from end to end.
    along : sequence of three floats, optional
        Direction of the displacement, world frame. Shear: any direction perpendicular to the axis
        (default: the next axis). Pull: any direction with a positive component along the axis (an
        oblique pull). Push: the same, displaced in the opposite direction.
    body_force : BodyForce or function, optional
        Steady forces on the bodies, also in the initial equilibrium; see `solve_equilibrium`.
    progress : function, optional
        Called with the number of states found.

    Returns
    -------
    Results of CurvePoint
        One for each strain; fewer if no equilibrium is found.

    Notes
    -----
    Each search starts from the previous equilibrium. If connectors are beyond their break lengths,
    the one farthest beyond breaks for good, and the search is repeated until none is (the
    quasi-static order of de Arcangelis, Redner and Herrmann 1985, J. Phys. Lett. 46, L585).

    Each point has the number of connectors past their kink. If it is 0, a change of 1e-9 in angle
    or stiffness changes `stress - rest_stress` by less than 1e-6 of its value. Lateral strains
    are in `middle_strain`.
    """
    return Results(CURVE_COLUMNS, curve_points(
        scene, kind, strains, axis=axis, along=along, body_force=body_force, progress=progress))


def curve_points(
    scene: Scene, kind: str, strains: Sequence[float], *, axis: int = 0,
    along: Sequence[float] | None = None, body_force: BodyForce | Force | None = None,
    progress: Callable[[int], None] | None = None
) -> Iterator[CurvePoint]:
    """Yield the points of `measure_curve`, each when found."""
    require_scene(scene)
    checks.choice('kind', kind, KINDS)
    steps = check_strains('strains', kind, strains)
    axis = checks.count('axis', axis, 0, 2)
    if progress is not None:
        checks.function('progress', progress)
    motion = held_motion(
        scene, kind, axis, body_force=body_force, along=check_along(kind, axis, along))
    rest = InitialEquilibrium(motion)
    for number, step in enumerate(follow_path(motion, steps, rest)):
        yield curve_point(motion, kind, rest, step)
        if progress is not None:
            progress(number + 1)


def check_strains(name: str, kind: str, strains: Sequence[float]) -> list[float]:
    """Return the strains of a load case; raise ValueError unless positive and rising."""
    steps: list[float] = checks.array(name, strains, ('n',)).tolist()
    if not steps or not steps[0] > 0.0 or sorted(set(steps)) != steps:
        raise ValueError(f'{name} must rise from above 0, got {checks.shown(steps)}')
    if kind in (PUSH, HYDROSTATIC) and steps[-1] >= 1.0:
        raise ValueError(f'{name} of a {kind} must be below 1, got {steps[-1]:g}')
    return steps


def curve_point(motion: HeldMotion, kind: str, rest: InitialEquilibrium, step: Step) -> CurvePoint:
    """Return the point of a curve for one step of a path."""
    found, counts = step.found, rest.count_state(step.found)
    force, moment = motion.end_wrench(found.snapshot.position, found.reaction)
    stress, rest_stress = (
        conjugate / strained_volume(motion, kind, amount) for conjugate, amount in (
            (step.conjugate, step.amount), (rest.conjugate, 0.0)))
    return CurvePoint(
        step.amount, stress, float(found.snapshot.energy['total']), found.verdict,
        found.residual, *counts, rest_stress,
        _middle_strain(motion.scene, motion.axis, found.snapshot), force, tension_range(found),
        moment, step.breaks, found.snapshot)


def strained_volume(motion: HeldMotion, kind: str, strain: float) -> float:
    """
    Return the volume [m^3] that relates dE/dstrain [J] to stress [Pa].

    For a pull, push or shear it is the volume of the woven slab between its ends. For all faces it
    is three times the volume that the slab's connectors represent, compressed or inflated: the
    work of a pressure. Six connectors represent the volume of one body in the periodic fabric;
    volumes of a radial weave grow from level to level. So the bulk modulus at small strains equals
    that of the periodic fabric for a slab of any size.
    """
    scene = motion.scene
    if kind in (HYDROSTATIC, INFLATION):
        place = _place_volumes(scene)
        volume = float(place[scene.connectors.bodies].sum()) / 12.0 or float(place[0]) / 6.0
        return 3.0 * (1.0 + (strain if kind == INFLATION else -strain)) ** 2 * volume
    return motion.length * cross_section(scene, motion.axis)


def cross_section(scene: Scene, axis: int) -> float:
    """Return the woven cross section [m^2] normal to an axis: volume over length."""
    pitch = float(scene.geometry.pitch)
    if scene.weave.kind == 'radial':
        # The cross section of rows is a plane through the axis of the cylinder.
        place = np.full(1, 2.0 * pitch**3 * scene.body_count) if axis == 0 else (
            _place_volumes(scene))
        return float(place.sum()) / ((float(np.ptp(scene.weave.grid[:, axis])) + 1.0) * pitch)
    length = float(np.ptp(scene.position[:, axis])) + pitch
    return scene.body_count * 2.0 * pitch**3 / length


def _place_volumes(scene: Scene) -> np.ndarray:
    """Return the volumes [m^3] per body, (n,), which grow from level to level if radial."""
    pitch = float(scene.geometry.pitch)
    place = np.full(scene.body_count, 2.0 * pitch**3)
    if scene.weave.kind == 'radial':
        radius = check_radius(scene.parameters, scene.geometry)
        place[:len(scene.weave.grid)] *= 1.0 + scene.weave.grid[:, 2] * pitch / radius
    return place


def _middle_strain(
    scene: Scene, axis: int, snapshot: Snapshot
) -> tuple[float, float, float]:
    """Return normal strains of the middle third along `axis`, fitted to displacements."""
    along = scene.position[:, axis]
    reach = max(float(np.ptp(along)) / 6.0, float(scene.geometry.pitch))
    middle = np.abs(along - 0.5 * (along.min() + along.max())) <= 1.001 * reach
    place, moved = (values[middle] - values[middle].mean(axis=0) for values in (
        scene.position, snapshot.position - scene.position))
    spread = (place**2).sum(axis=0)
    flat = spread < 1e-9 * spread.max()
    x, y, z = np.where(
        flat, np.nan, (place * moved).sum(axis=0) / np.where(flat, 1.0, spread)).tolist()
    return x, y, z
