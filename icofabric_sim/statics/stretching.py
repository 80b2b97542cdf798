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
"""Stress against strain of a slab between two held ends, or with all its outer faces held."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from icofabric_sim import checks
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
from icofabric_sim.statics.slab_path import Break, follow, Rest, Step, tension_range
import numpy as np

KINDS = STRAINED


class CurvePoint(NamedTuple):
    """One state of the slab."""

    # Displacement of the end over the distance of the ends; of all faces: over the distance from
    # the centre.
    strain: float
    # [Pa] force on the end along its displacement, over the woven cross section; of all faces:
    # the pressure, or of an inflation the tension.
    stress: float
    energy: float  # [J]
    verdict: str
    residual: float
    obstructed: int  # connectors that lead through a shell of their own, or lie around it
    beyond: int  # connectors beyond the length at which they break
    broken: int  # connectors that have broken so far
    touching: int  # pairs of shells that push each other
    sliding: int  # of these, pairs that slide (contact.friction)
    at_kink: int  # connectors at their natural length, where k_e is not k_c
    # Connectors that are there without any strain, or have come to the other side since: where
    # there are some the response depends on how far from it they were.
    past_kink: int
    rest_stress: float  # [Pa] without any strain, from natural lengths; NaN: no equilibrium
    # Strains xx, yy, zz of the middle third between the ends: slopes of its bodies' displacements
    # over their woven places. NaN where all of them have the same place along that axis.
    middle_strain: tuple[float, float, float]
    end_force: tuple[float, float, float]  # [N] that holds the moved end, world axes
    tension_range: tuple[float, float]  # [N] least and largest of connectors; below 0: they push
    end_moment: tuple[float, float, float]  # [N m] the same, about the centre of that end
    breaks: tuple[Break, ...]  # at this strain, in their order
    snapshot: Snapshot

    def __repr__(self) -> str:
        """Say what was found, without the numbers of the state."""
        return (f'<CurvePoint: strain {self.strain:.6g}, stress {self.stress:.6g} Pa, '
                f'{self.verdict}>')

    def row(self) -> list[float | str]:
        """All but breaks and the snapshot as plain values, in the order of `CURVE_COLUMNS`."""
        return [*self[:13], *self.middle_strain, *self.end_force, *self.tension_range,
                *self.end_moment]


# Names of columns of a table of curves, with units.
CURVE_COLUMNS = (
    'strain', 'stress_pa', 'energy_j', 'verdict', 'residual', 'obstructed', 'beyond_break_length',
    'broken', 'touching_pairs', 'sliding_pairs', 'at_kink', 'past_kink', 'rest_stress_pa',
    'middle_strain_xx', 'middle_strain_yy', 'middle_strain_zz', 'end_force_x_n', 'end_force_y_n',
    'end_force_z_n', 'least_tension_n', 'largest_tension_n', 'end_moment_x_nm', 'end_moment_y_nm',
    'end_moment_z_nm')


def measure_curve(
    scene: Scene, kind: str, strains: Sequence[float], *, axis: int = 0,
    along: Sequence[float] | None = None, body_force: BodyForce | Force | None = None,
    progress: Callable[[int], None] | None = None
) -> Results[CurvePoint]:
    """
    Equilibria of a slab whose end is displaced by `strains`, rising from above 0.

    The bodies at either end along the world's `axis` are held as they are woven, one end displaced
    along the axis (pull, push) or across it (shear); all others are free. Or all bodies that lack
    a neighbour are displaced towards the centre (hydrostatic) or away from it (inflation). Loads,
    supports and drives of the scene are left out; its planes and connector groups count, and so
    does a steady `body_force` of the user (see `solve_equilibrium`), also before anything moves.
    Each search begins where the last one ended. Of the connectors beyond their break lengths the
    one that is farthest beyond breaks for good, and the search goes on, until none is (the
    quasi-static order of de Arcangelis, Redner and Herrmann 1985, J. Phys. Lett. 46, L585). Ends
    early where no equilibrium is found.

    Parameters
    ----------
    scene : Scene
        The slab, flat or radial. Ends of a radial weave are its first and last row, column or
        level.
    kind : str
        'pull', 'push', 'shear', 'hydrostatic' or 'inflation'.
    strains : sequence of float
        Displacements over the length between the ends, or over the distance from the centre.
    axis : int
        World axis from end to end.
    along : sequence of three floats, optional
        Direction of the displacement, world frame: of a shear any one across the axis (default:
        the next axis; an opposite one is the other sign), of a pull any one with a part along
        the axis above 0 (an oblique pull), of a push the same, displaced against it.
    body_force : BodyForce or function, optional
        Steady forces that act on the bodies.
    progress : function, optional
        Called with the number of states found.

    Returns
    -------
    Results of CurvePoint
        One for each strain.

    Notes
    -----
    Each point says how many connectors are past their kink: where none is, a change of 1e-9 in
    angle or stiffness changes `stress - rest_stress` by less than 1e-6 of itself. What happens
    across is in `middle_strain`.
    """
    return Results(CURVE_COLUMNS, curve_points(
        scene, kind, strains, axis=axis, along=along, body_force=body_force, progress=progress))


def curve_points(
    scene: Scene, kind: str, strains: Sequence[float], *, axis: int = 0,
    along: Sequence[float] | None = None, body_force: BodyForce | Force | None = None,
    progress: Callable[[int], None] | None = None
) -> Iterator[CurvePoint]:
    """The same, each as soon as it is found."""
    require_scene(scene)
    checks.choice('kind', kind, KINDS)
    steps = check_strains('strains', kind, strains)
    axis = checks.count('axis', axis, 0, 2)
    if progress is not None:
        checks.function('progress', progress)
    motion = held_motion(
        scene, kind, axis, body_force=body_force, along=check_along(kind, axis, along))
    rest = Rest(motion)
    for number, step in enumerate(follow(motion, steps, rest)):
        yield curve_point(motion, kind, rest, step)
        if progress is not None:
            progress(number + 1)


def check_strains(name: str, kind: str, strains: Sequence[float]) -> list[float]:
    """Strains of a kind, the argument `name`, which rise from above 0; ValueError if not."""
    steps: list[float] = checks.array(name, strains, ('n',)).tolist()
    if not steps or not steps[0] > 0.0 or sorted(set(steps)) != steps:
        raise ValueError(f'{name} must rise from above 0, got {checks.shown(steps)}')
    if kind in (PUSH, HYDROSTATIC) and steps[-1] >= 1.0:
        raise ValueError(f'{name} of a {kind} must be below 1, got {steps[-1]:g}')
    return steps


def curve_point(motion: HeldMotion, kind: str, rest: Rest, step: Step) -> CurvePoint:
    """What there is to say of a state."""
    found, tally = step.found, rest.tally(step.found)
    force, moment = motion.end_wrench(found.snapshot.position, found.reaction)
    stress, rest_stress = (
        conjugate / strained_volume(motion, kind, amount) for conjugate, amount in (
            (step.conjugate, step.amount), (rest.conjugate, 0.0)))
    return CurvePoint(
        step.amount, stress, float(found.snapshot.energy['total']), found.verdict,
        found.residual, *tally, rest_stress,
        _middle_strain(motion.scene, motion.axis, found.snapshot), force, tension_range(found),
        moment, step.breaks, found.snapshot)


def strained_volume(motion: HeldMotion, kind: str, strain: float) -> float:
    """
    Derivative of the energy by the strain [J] over the stress [Pa]: a volume [m^3].

    Of the woven slab between its ends. Of all faces: three times that of the connectors of the
    slab, of which six fill the place of a body in the endless fabric, as far as it is compressed
    or inflated: the work of a pressure. Places of a radial weave widen from level to
    level. So the bulk modulus at small strains is that of the endless fabric, however small the
    slab.
    """
    scene = motion.scene
    if kind in (HYDROSTATIC, INFLATION):
        place = _place_volumes(scene)
        volume = float(place[scene.connectors.bodies].sum()) / 12.0 or float(place[0]) / 6.0
        return 3.0 * (1.0 + (strain if kind == INFLATION else -strain)) ** 2 * volume
    return motion.length * cross_section(scene, motion.axis)


def cross_section(scene: Scene, axis: int) -> float:
    """Woven area [m^2] across an axis: the volume of the bodies over the length that they fill."""
    pitch = float(scene.geometry.pitch)
    if scene.weave.kind == 'radial':
        # Across the rows: a plane through the axis of the cylinder.
        place = np.full(1, 2.0 * pitch**3 * scene.body_count) if axis == 0 else (
            _place_volumes(scene))
        return float(place.sum()) / ((float(np.ptp(scene.weave.grid[:, axis])) + 1.0) * pitch)
    length = float(np.ptp(scene.position[:, axis])) + pitch
    return scene.body_count * 2.0 * pitch**3 / length


def _place_volumes(scene: Scene) -> np.ndarray:
    """Volumes [m^3] of the places of bodies, (n,): wider on the outer levels of a radial weave."""
    pitch = float(scene.geometry.pitch)
    place = np.full(scene.body_count, 2.0 * pitch**3)
    if scene.weave.kind == 'radial':
        radius = check_radius(scene.parameters, scene.geometry)
        place[:len(scene.weave.grid)] *= 1.0 + scene.weave.grid[:, 2] * pitch / radius
    return place


def _middle_strain(
    scene: Scene, axis: int, snapshot: Snapshot
) -> tuple[float, float, float]:
    """Normal strains of the middle third along `axis`, fitted to what its bodies moved."""
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
