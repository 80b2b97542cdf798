# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Comparison of the rotation formulations: quaternions and direction cosines.

Both take the same steps, so that they differ only by round-off, which the motion amplifies. A
third run with quaternions and a disturbed start measures the amplification.
"""

from collections.abc import Callable
import math
from typing import NamedTuple

from icofabric_sim.messages.schedule import NANOSECONDS, seconds
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.simulation import compile_scene, Simulation
from icofabric_sim.simulation.stepping.methods import facts_of
import numpy as np

# Disturbance of the third run, relative to a and in rad: far above round-off, far below 1.
DISTURBANCE = 2.0**-36
# Above this difference the growth is not linear, and the third run is no longer a measure.
MAX_DISTURBED = 1e-2
# Units in the last place by which one force evaluation may round a coordinate: each body sums the
# forces of up to 12 connectors.
ROUNDINGS_PER_EVALUATION = 16.0
# Force evaluations between two comparisons: some of the fastest periods.
_EVALUATIONS_PER_COMPARISON = 64
_MAX_COMPARISONS = 4000


class Comparison(NamedTuple):
    """Differences of the two formulations at one time."""

    time: float  # [s]
    steps: int
    position: float  # largest difference of centres, over a
    angle: float  # largest angle between two orientations [rad]
    growth: float  # of the disturbance since the start
    bound: float  # largest difference explained by round-off in both

    @property
    def agrees(self) -> bool:
        """Return whether round-off explains the differences."""
        return max(self.position, self.angle) <= self.bound


class CrossCheck(NamedTuple):
    """Comparisons, and the reason why they ended early, '' if they did not."""

    rows: list[Comparison]
    ended: str

    @property
    def agrees(self) -> bool:
        """Return whether there were comparisons, all explained by round-off."""
        return bool(self.rows) and all(row.agrees for row in self.rows)


def cross_check(
        scene: Scene, duration: float, *,
        progress: Callable[[float], None] = lambda time: None) -> CrossCheck:
    """
    Integrate `scene` for `duration` [s] in both formulations and compare.

    The bound of the difference is r sqrt(2 n) g:

    - r: round-off of a force evaluation, ROUNDINGS_PER_EVALUATION units in the last place. A unit
      is eps X / a for positions as large as X, and eps for orientations.
    - n: force evaluations of each of the two runs so far. Independent errors add up as sqrt(2 n)
      (Higham and Mary 2019, SIAM J. Sci. Comput. 41, A2815).
    - g: largest growth of the disturbance of the third run so far.
    """
    quaternions = compile_scene(scene, rotation='quaternion')
    cosines = compile_scene(scene, rotation='direction_cosines')
    disturbed = compile_scene(scene, rotation='quaternion')
    _disturb(disturbed)
    half_edge = scene.geometry.half_edge
    rounding = ROUNDINGS_PER_EVALUATION * np.finfo(float).eps
    end = round(duration * NANOSECONDS)
    stages = facts_of(quaternions.status.method_name).stages
    between = max(_EVALUATIONS_PER_COMPARISON // stages, 1) * quaternions.status.step
    count = min(math.ceil(duration / between), _MAX_COMPARISONS)
    rows: list[Comparison] = []
    growth = size = 0.0
    for number in range(1, count + 1):
        time = seconds(round(number * end / count))
        for simulation in (quaternions, cosines, disturbed):
            simulation.advance_to(time)
            progress(time)
        steps = {run.status.step_count for run in (quaternions, cosines, disturbed)}
        if len(steps) > 1:
            return CrossCheck(rows, f'from about t = {time:.6g} s on, round-off affected the '
                              'step sizes, which then differ')
        position, angle = _differences(quaternions, cosines, half_edge)
        apart = max(_differences(quaternions, disturbed, half_edge))
        growth = max(growth, apart / DISTURBANCE)
        if not apart <= MAX_DISTURBED:
            return CrossCheck(rows, f'at t = {time:.6g} s a disturbance of {DISTURBANCE:.1e} has '
                              f'grown to {apart:.1e}: from there on the motion is unpredictable '
                              'in this precision, and no two computations agree')
        size = max(size, float(np.abs(quaternions.snapshot().position).max()) / half_edge, 1.0)
        evaluations = stages * quaternions.status.step_count
        bound = math.sqrt(2.0 * evaluations) * rounding * size * max(growth, 1.0)
        rows.append(Comparison(
            time, quaternions.status.step_count, position, angle, growth, bound))
    return CrossCheck(rows, '')


def _disturb(simulation: Simulation) -> None:
    """Displace and rotate every body at random, each by about DISTURBANCE."""
    snapshot = simulation.snapshot()
    generator = np.random.RandomState(2)
    shape = snapshot.position.shape
    displacement = generator.standard_normal(shape) * (
        DISTURBANCE * simulation.scene.geometry.half_edge)
    half = 0.5 * DISTURBANCE * generator.standard_normal(shape)
    x, y, z, w = snapshot.orientation.T
    u, v, t = half.T
    # First order in the disturbance, whose square is below round-off.
    orientation = snapshot.orientation + np.stack([
        u * w + v * z - t * y, v * w + t * x - u * z, t * w + u * y - v * x,
        -u * x - v * y - t * z], axis=1)
    simulation.set_state(position=snapshot.position + displacement, orientation=orientation)


def _differences(first: Simulation, second: Simulation, half_edge: float) -> tuple[float, float]:
    """Return the largest distance of centres over a, and the largest relative angle [rad]."""
    one, two = first.snapshot(), second.snapshot()
    distance = float(np.linalg.norm(one.position - two.position, axis=1).max()) / half_edge
    p, q = one.orientation, two.orientation
    # By the chord: an arc cosine would lose half of the digits.
    chord = np.minimum(np.linalg.norm(p - q, axis=1), np.linalg.norm(p + q, axis=1))
    return distance, float((4.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))).max())
