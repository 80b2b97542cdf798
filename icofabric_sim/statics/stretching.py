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
"""Stress against strain of a slab between two held ends, one of which is moved step by step."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

from icofabric_sim import checks
from icofabric_sim.scene.scene import require_scene, Scene
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.statics.equilibrium import Equilibrium, solve_equilibrium
from icofabric_sim.statics.fabric import StaticFabric
import numpy as np

# Which way the end moves, beside the axis between the ends.
PULL, PUSH, SHEAR = 'pull', 'push', 'shear'
KINDS = (PULL, PUSH, SHEAR)
_SECTIONS = ('groups.', 'supports.', 'drives.', 'loads.', 'tractions.', 'anchors.', 'initial')
# Names of our own in the scene; those of the user are left out.
_FIXED, _MOVED = 'fixed_end', 'moved_end'


class CurvePoint(NamedTuple):
    """One state of the slab."""

    strain: float  # displacement of the end over the distance of the ends
    stress: float  # [Pa] force on the end along its displacement, over the woven cross section
    energy: float  # [J]
    verdict: str
    residual: float
    obstructed: int  # connectors that lead through a shell of their own
    beyond: int  # connectors beyond the length at which they break
    broken: int  # connectors that have broken so far
    touching: int  # pairs of shells that push each other
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
    snapshot: Snapshot

    def row(self) -> list[float | str]:
        """All but the snapshot as plain values, in the order of `CURVE_COLUMNS`."""
        return [*self[:-4], *self.middle_strain, *self.end_force, *self.tension_range]


# Names of columns of a table of curves, with units.
CURVE_COLUMNS = (
    'strain', 'stress_pa', 'energy_j', 'verdict', 'residual', 'obstructed', 'beyond_break_length',
    'broken', 'touching_pairs', 'at_kink', 'past_kink', 'rest_stress_pa', 'middle_strain_xx',
    'middle_strain_yy', 'middle_strain_zz', 'end_force_x_n', 'end_force_y_n', 'end_force_z_n',
    'least_tension_n', 'largest_tension_n')


def measure_curve(
    scene: Scene, kind: str, strains: Sequence[float], *, axis: int = 0,
    progress: Callable[[int], None] | None = None
) -> list[CurvePoint]:
    """
    Equilibria of a slab whose end is displaced by `strains`, rising from above 0.

    The bodies at either end along the world's `axis` are held as they are woven, one end displaced
    along the axis (pull, push) or across it (shear); all others are free. Loads, supports, drives
    and groups of the scene are left out. Each search begins where the last one ended. Of the
    connectors beyond their break lengths the one that is farthest beyond breaks for good, and the
    search goes on, until none is (the quasi-static order of de Arcangelis, Redner and Herrmann
    1985, J. Phys. Lett. 46, L585). Ends early where no equilibrium is found.

    Each point says how many connectors are past their kink: where none is, a change of 1e-9 in
    angle or stiffness changes `stress - rest_stress` by less than 1e-6 of itself. What happens
    across is in `middle_strain`.
    """
    return list(curve_points(scene, kind, strains, axis=axis, progress=progress))


def curve_points(
    scene: Scene, kind: str, strains: Sequence[float], *, axis: int = 0,
    progress: Callable[[int], None] | None = None
) -> Iterator[CurvePoint]:
    """The same, each as soon as it is found."""
    require_scene(scene)
    checks.choice('kind', kind, KINDS)
    steps: list[float] = checks.array('strains', strains, ('n',)).tolist()
    if not steps or not steps[0] > 0.0 or sorted(set(steps)) != steps:
        raise ValueError(f'strains must rise from above 0, got {checks.shown(steps)}')
    if kind == PUSH and steps[-1] >= 1.0:
        raise ValueError(f'strains of a push must be below 1, got {steps[-1]:g}')
    axis = checks.count('axis', axis, 0, 2)
    if progress is not None:
        checks.function('progress', progress)
    base = _between_ends(scene, axis)
    ends = [base.groups[name] for name in (_FIXED, _MOVED)]
    along = base.position[:, axis]
    length = float(along[ends[1]].mean() - along[ends[0]].mean())
    if not length > 0.0 or len(set(ends[0]) & set(ends[1])):
        raise ValueError(
            f'the fabric has no two ends along the axis {"xyz"[axis]}: weave.size must be at '
            'least 3 there')
    area = cross_section(base, axis)
    direction = np.zeros(3)
    direction[(axis + 1) % 3 if kind == SHEAR else axis] = -1.0 if kind == PUSH else 1.0
    points: list[CurvePoint] = []
    last: Equilibrium | None = None
    rest = _Rest(solve_equilibrium(base), base)
    for number, strain in enumerate(steps):
        here = Scene.from_parameters(base.parameters.with_changes({
            f'initial.{_MOVED}.group': _MOVED,
            f'initial.{_MOVED}.displacement': (strain * length * direction).tolist()}))
        start = None if last is None else _spread(last.snapshot, points, strain)
        last = solve_equilibrium(here, start=start)
        while last.converged and (worst := _worst_beyond(here, last.snapshot)) is not None:
            since = last.snapshot.break_time.copy()
            since[worst] = 0.0
            last = solve_equilibrium(here, start=replace(last.snapshot, broken_since=since))
        held = last.reaction[ends[1], :3].sum(axis=0)
        x, y, z = held.tolist()
        point = CurvePoint(
            strain, float(held @ direction) / area, float(last.snapshot.energy['total']),
            last.verdict, last.residual, int(np.count_nonzero(last.snapshot.obstructed)),
            int(np.count_nonzero(_excess(here, last.snapshot) >= 0.0)),
            int(np.count_nonzero(~last.snapshot.intact)),
            0 if last.touching is None else len(last.touching.pairs),
            len(last.at_kink), rest.past_kink(last.snapshot),
            float(rest.reaction[ends[1], :3].sum(axis=0) @ direction) / area,
            _middle_strain(base, axis, last.snapshot), (x, y, z),
            (float(last.tension.min(initial=np.inf)), float(last.tension.max(initial=-np.inf))),
            last.snapshot)
        points.append(point)
        yield point
        if progress is not None:
            progress(number + 1)
        if not last.converged:
            return


class _Rest:
    """The slab before it is strained."""

    def __init__(self, found: Equilibrium, scene: Scene) -> None:
        """Note on which sides of their kinks the connectors are."""
        fabric = StaticFabric(scene)
        self._kinked, self._rest = fabric.laws.kinked, fabric.laws.natural_length
        self._longer = found.snapshot.connector_length > self._rest
        self._at_kink = found.at_kink
        self.reaction = np.where(found.converged, found.reaction, np.nan)

    def past_kink(self, now: Snapshot) -> int:
        """How many connectors were at their kink, or are on another side of it."""
        past = self._kinked & now.intact & (self._longer != (now.connector_length > self._rest))
        past[self._at_kink] = True
        return int(np.count_nonzero(past))


def cross_section(scene: Scene, axis: int) -> float:
    """Woven area [m^2] across an axis: the volume of the bodies over the length that they fill."""
    pitch = float(scene.geometry.pitch)
    length = float(np.ptp(scene.position[:, axis])) + pitch
    return scene.body_count * 2.0 * pitch**3 / length


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


def _between_ends(scene: Scene, axis: int) -> Scene:
    """The same fabric with its two ends held."""
    kept = {
        name: value for name, value in scene.parameters.items()
        if not name.startswith((*_SECTIONS, 'gravity', 'charge', 'field', 'connector_groups'))
        and value != ''}
    letter = 'xyz'[axis]
    return Scene.from_parameters({
        **kept, f'groups.{_FIXED}': f'{letter}_min', f'groups.{_MOVED}': f'{letter}_max',
        f'supports.{_FIXED}.group': _FIXED, f'supports.{_MOVED}.group': _MOVED})


def _spread(last: Snapshot, points: list[CurvePoint], strain: float) -> Snapshot:
    """Where to begin: on from the last two states, as far as the strain grows."""
    if len(points) < 2:
        return last
    before = points[-2].snapshot
    ratio = (strain - points[-1].strain) / (points[-1].strain - points[-2].strain)
    moved = last.position - before.position
    return replace(last, position=last.position + min(ratio, 1.0) * moved)


def _excess(scene: Scene, snapshot: Snapshot) -> np.ndarray:
    """How far the unbroken connectors are beyond their break lengths, over those, (c,)."""
    limits = scene.connectors.limits
    if limits is None:
        return np.full(snapshot.connector_count, -1.0)
    length = snapshot.connector_length
    longer = np.where(np.isfinite(limits.longest), length / limits.longest - 1.0, -1.0)
    shorter = np.where(limits.shortest > 0.0, 1.0 - length / np.where(
        limits.shortest > 0.0, limits.shortest, 1.0), -1.0)
    return np.where(snapshot.intact, np.maximum(longer, shorter), -1.0)


def _worst_beyond(scene: Scene, snapshot: Snapshot) -> int | None:
    excess = _excess(scene, snapshot)
    worst = int(np.argmax(excess)) if len(excess) else 0
    return worst if len(excess) and excess[worst] >= 0.0 else None
