# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Growth of initial displacements, from a unit of round-off up, compared with that of the motion.

Each scene runs with companions of smaller and smaller initial displacements in one direction, and
with one that is shifted, which has the same motion with other round-off. If only the motion causes
growth, distance over displacement is equal for all displacements, down to the growth of round-off:
a unit in the last place in each step. After Chung and Pollard 2016, "Predictable behavior during
contact simulation: a comparison of selected physics engines", Computer Animation and Virtual
Worlds 27, 262.
"""

from collections.abc import Iterator, Sequence
import logging
import math
from typing import Any, Final, NamedTuple

from icofabric_sim.scene.initial import InitialState
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.errors import SimulationError
from icofabric_sim.simulation.model.snapshot import Snapshot
from icofabric_sim.simulation.reports.divergence import distance_between
from icofabric_sim.simulation.simulation import compile_scene, Simulation
import numpy as np

_LOGGER = logging.getLogger('icofabric_sim')
_WOVEN: Final[dict[str, Any]] = {
    'weave.size': [3, 3, 3], 'contact.mode': 'never', 'solver.threads': 1,
    'solver.energy_limit': 1.0, 'initial_random.seed': 1}
_MOVING: Final[dict[str, Any]] = {
    **_WOVEN, 'initial_random.velocity_sigma': 0.5, 'initial_random.spin_sigma': 60.0}
# Shells without connectors that fall onto a floor and collide.
_DROPPED: Final[dict[str, Any]] = {
    **_WOVEN, 'weave.connected': False, 'contact.mode': 'auto', 'contact.stiffness': 2e5,
    'gravity': [0.0, 0.0, -9.81], 'planes.floor.normal': [0.0, 0.0, 1.0],
    'planes.floor.offset': -0.03, 'initial_random.velocity_sigma': 0.2,
    'initial_random.spin_sigma': 10.0}


class Case(NamedTuple):
    """A scene with its duration and methods."""

    parameters: dict[str, Any]
    duration: float  # [s]
    methods: dict[str, float]  # method: given step [s]; 0: adaptive steps
    # Initial displacement over a. As woven, all connectors have exactly the length at which their
    # stiffness changes, so that the last bit decides between the two stiffnesses.
    offset: float = 0.0


CASES: Final[dict[str, Case]] = {
    'free': Case(_MOVING, 0.4, {'leapfrog': 1e-4, 'srkn4': 2e-4, 'srkn6': 2e-4, 'dop8': 0.0}),
    'hanging': Case(
        {**_WOVEN, 'gravity': [0.0, 0.0, -9.81], 'groups.wall': 'x_min',
         'supports.wall.group': 'wall'}, 0.8, {'leapfrog': 1e-4, 'srkn6': 2e-4}),
    'kinked': Case(
        {**_MOVING, 'connector.stiffness_extension': 600.0,
         'connector.stiffness_compression': 300.0}, 0.2, {'leapfrog': 1e-4, 'srkn4': 2e-4}, 1e-3),
    'dropped': Case(_DROPPED, 0.16, {'leapfrog': 1e-5, 'dop8': 0.0}),
}
DISPLACEMENTS: Final = (1e-6, 1e-9, 1e-12, 1e-15)  # over a
_SAMPLE_COUNT = 8
# Largest distance over a of the companion with the largest displacement, which measures growth.
# Growth is not linear beyond it.
_MAX_LINEAR_DISTANCE_RATIO = 0.03
# Largest ratio of two growths: the largest displacement is not quite linear, contacts start later.
_MAX_GROWTH_RATIO = 3.0
# Shift of a companion over a.
_SHIFT: Final = (1.3, -0.7, 0.9)
_EPS = float(np.finfo(float).eps)
_SEED = 11


class Row(NamedTuple):
    """Distances of the companions of a run at one time."""

    scene: str
    method: str
    time: float  # [s]
    steps: int
    growth_6: float  # distance over displacement, of 1e-6 a; then 1e-9, 1e-12, 1e-15 a
    growth_9: float
    growth_12: float
    growth_15: float
    rounding: float  # distance of the shifted companion, shifted back, over a
    allowed: float  # bound of the growth of round-off and of errors of adaptive steps, over a
    fault: str  # growth that the motion does not explain; '': none


HEAD: Final = (f'{"scene":9}{"method":9}{"t [s]":>7}{"steps":>8}{"1e-6 a":>9}{"1e-9 a":>9}'
               f'{"1e-12 a":>9}{"1e-15 a":>9}{"shifted":>9}{"allowed":>9}')


def row_line(row: Row) -> str:
    """Return a row of the table."""
    figures = ''.join(f'{value:9.2g}' for value in (*row[4:8], row.rounding, row.allowed))
    return (f'{row.scene:9}{row.method:9}{row.time:7.3g}{row.steps:8d}{figures}  '
            f'{row.fault}').rstrip()


def measure_predictability(
    scenes: Sequence[str] = tuple(CASES), methods: Sequence[str] | None = None, *,
    samples: int = _SAMPLE_COUNT, duration_ratio: float = 1.0
) -> Iterator[Row]:
    """Run scenes with their methods, each for a fraction `duration_ratio` of its duration."""
    for name in scenes:
        case = CASES[name]
        for method, step in case.methods.items():
            if methods is None or method in methods:
                yield from _follow(name, case, method, step, samples, duration_ratio)


def _follow(
    name: str, case: Case, method: str, step: float, samples: int, duration_ratio: float
) -> Iterator[Row]:
    scene = Scene.from_parameters({
        **case.parameters, 'solver.method': method, 'solver.step': step,
        'solver.tolerance': 1e-9})
    a = scene.geometry.half_edge
    shift = a * np.array(_SHIFT)
    moved = {
        f'planes.{plane}.offset': scene.parameters[f'planes.{plane}.offset'] + float(
            np.dot(scene.parameters[f'planes.{plane}.normal'], shift))
        for plane in scene.parameters.names('planes')}
    direction = _direction(scene)
    offset = case.offset * a * _direction(scene)[::-1]
    starts = [(scene, offset), *(
        (scene, offset + distance * a * direction) for distance in DISPLACEMENTS)]
    starts.append((scene.with_changes(moved) if moved else scene, offset + shift))
    level = _LOGGER.level
    _LOGGER.setLevel(logging.ERROR)
    try:
        run, *companions, shifted = [_start_run(one, way) for one, way in starts]
        first = [distance_between(run.snapshot(), one.snapshot(), a) for one in companions]
        largest = 1.0
        for number in range(1, samples + 1):
            time = duration_ratio * case.duration * number / samples
            for simulation in (run, *companions, shifted):
                simulation.advance_to(time)
            seen = run.snapshot()
            # Round-off decides the start of displacements below round-off.
            growth = [distance_between(seen, one.snapshot(), a) / distance
                      for one, distance in zip(companions, first)]
            rounding = _shifted_distance(seen, shifted.snapshot(), shift, a)
            largest = max(largest, growth[0])
            farthest = max(float(np.abs(shifted.snapshot().position).max()) / a, 1.0)
            allowed = _EPS * farthest * run.status.step_count * largest
            if step == 0.0:
                # Steps may differ, and both runs have errors, which grow differently.
                allowed += (
                    _MAX_GROWTH_RATIO * 2.0 * scene.parameters['solver.tolerance'] * time
                    * largest)
            yield Row(
                name, method, time, run.status.step_count, growth[0], growth[1], growth[2],
                growth[3], rounding, allowed, _fault(growth, first, largest, rounding, allowed))
            if growth[0] * first[0] > _MAX_LINEAR_DISTANCE_RATIO:
                return
    except SimulationError as error:
        nan = math.nan
        yield Row(
            name, method, nan, run.status.step_count, nan, nan, nan, nan, nan, nan, str(error))
    finally:
        _LOGGER.setLevel(level)


def _direction(scene: Scene) -> np.ndarray:
    """Return random displacements of all bodies (n, 3), the largest of length 1."""
    direction = np.random.RandomState(_SEED).standard_normal((scene.body_count, 3))
    if scene.supports is not None:
        direction[scene.supports.translation] = 0.0
    return direction / np.linalg.norm(direction, axis=1).max()


def _start_run(scene: Scene, way: np.ndarray) -> Simulation:
    simulation = compile_scene(scene)
    start: InitialState = scene.initial
    simulation.set_state(
        position=start.position + way, orientation=start.orientation,
        linear_velocity=start.linear_velocity, angular_velocity=start.angular_velocity)
    return simulation


def _shifted_distance(seen: Snapshot, shifted: Snapshot, shift: np.ndarray, a: float) -> float:
    """Return the distance or angle between a run and a shifted one, without the shift, over a."""
    way = np.linalg.norm(shifted.position - shift - seen.position, axis=1).max() / a
    turned = seen.orientation - shifted.orientation
    return max(float(way), 2.0 * float(np.linalg.norm(turned, axis=1).max()))


def _fault(
    growth: list[float], first: list[float], largest: float, rounding: float, allowed: float
) -> str:
    """Return the growth that the motion does not explain, or an empty string."""
    if growth[0] * first[0] > _MAX_LINEAR_DISTANCE_RATIO:
        return ''
    if not rounding <= allowed:
        return f'round-off adds {rounding:.2g} a'
    for one, distance, wanted in zip(growth[1:], first[1:], DISPLACEMENTS[1:]):
        if not one * distance <= _MAX_GROWTH_RATIO * largest * distance + allowed:
            return f'a displacement of {wanted:g} a grows {one:.2g} times'
    return ''
