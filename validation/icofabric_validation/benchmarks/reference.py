# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The reference motion of a benchmark scene, by an independent formulation and method.

Direction cosines (eqs 16-20, 18 numbers per body) instead of quaternions; the modified midpoint
rule of Gragg extrapolated to order 16 (Gragg 1965, SIAM J. Numer. Anal. 2, 384; Bulirsch and Stoer
1966, Numer. Math. 8, 1) instead of splittings; separate loops and forces.
"""

from typing import NamedTuple

from icofabric_validation.benchmarks.scenes import Motion, motion_error, PlainScene
import numba
import numpy as np

# Steps of the midpoint rule in each column of the extrapolation.
COLUMNS = np.array([2, 4, 6, 8, 10, 12, 14, 16])
# Product of the step and the bound on the frequencies.
COURANT = 2.5


class Reference(NamedTuple):
    """The final motion and its uncertainty."""

    motion: Motion
    duration: float  # [s]
    uncertainty: float  # `motion_error` between these steps and steps of two thirds
    growth: float  # of a small displacement from the start to the end, the largest of a few
    crossings: int = 0  # of connectors with two stiffnesses through their natural length


class Springs(NamedTuple):
    """The connectors and properties of the bodies."""

    first: np.ndarray
    second: np.ndarray
    first_axis: np.ndarray
    second_axis: np.ndarray
    first_arm: np.ndarray  # signed distance from the centre [m]
    second_arm: np.ndarray
    stiffness: np.ndarray  # (c,) [N/m]
    damping: float  # [N s/m]
    natural_length: float
    mass: float
    inertia: float


@numba.njit(error_model='numpy')
def _rates(springs, y, dy):  # type: ignore[no-untyped-def]
    # y (n, 18): position, velocity, body axes as rows, spin in world components.
    count = y.shape[0]
    for b in range(count):
        for k in range(3):
            dy[b, k] = y[b, 3 + k]
            dy[b, 3 + k] = 0.0
            dy[b, 15 + k] = 0.0
        ox, oy, oz = y[b, 15], y[b, 16], y[b, 17]
        for i in range(3):
            ex, ey, ez = y[b, 6 + 3 * i], y[b, 7 + 3 * i], y[b, 8 + 3 * i]
            dy[b, 6 + 3 * i] = oy * ez - oz * ey
            dy[b, 7 + 3 * i] = oz * ex - ox * ez
            dy[b, 8 + 3 * i] = ox * ey - oy * ex
    arm_i = np.empty(3)
    arm_j = np.empty(3)
    pull = np.empty(3)
    for c in range(springs.first.shape[0]):
        i, j = springs.first[c], springs.second[c]
        square = along = 0.0
        for k in range(3):
            arm_i[k] = springs.first_arm[c] * y[i, 6 + 3 * springs.first_axis[c] + k]
            arm_j[k] = springs.second_arm[c] * y[j, 6 + 3 * springs.second_axis[c] + k]
            pull[k] = y[j, k] + arm_j[k] - y[i, k] - arm_i[k]
            square += pull[k] * pull[k]
        tension = springs.stiffness[c] * (1.0 - springs.natural_length / np.sqrt(square))
        if springs.damping > 0.0:
            for k in range(3):
                m, n = (k + 1) % 3, (k + 2) % 3
                speed = y[j, 3 + k] + y[j, 15 + m] * arm_j[n] - y[j, 15 + n] * arm_j[m] - (
                    y[i, 3 + k] + y[i, 15 + m] * arm_i[n] - y[i, 15 + n] * arm_i[m])
                along += pull[k] * speed
            tension += springs.damping * along / square
        for k in range(3):
            pull[k] *= tension
            dy[i, 3 + k] += pull[k] / springs.mass
            dy[j, 3 + k] -= pull[k] / springs.mass
        for k in range(3):
            m, n = (k + 1) % 3, (k + 2) % 3
            dy[i, 15 + k] += (arm_i[m] * pull[n] - arm_i[n] * pull[m]) / springs.inertia
            dy[j, 15 + k] -= (arm_j[m] * pull[n] - arm_j[n] * pull[m]) / springs.inertia


@numba.njit(error_model='numpy')
def extrapolate(springs, start, duration, count, columns):  # type: ignore[no-untyped-def]
    """
    Take `count` steps from the state `start` (n, 18); return the final state.

    All columns hold increments, and their sum is compensated, so that round-off is that of the
    forces.
    """
    shape, y = start.shape, start.copy().ravel()
    size = y.shape[0]
    lost, rate, total = np.zeros(size), np.empty(size), np.empty(size)
    at_start, before, now = np.empty(size), np.empty(size), np.empty(size)
    table = np.empty((columns.shape[0], size))
    step = duration / count
    # Loops over elements compile four times faster than array expressions.
    for _ in range(count):
        _rates(springs, y.reshape(shape), at_start.reshape(shape))
        for j in range(columns.shape[0]):
            h = step / columns[j]
            for i in range(size):
                before[i] = 0.0
                now[i] = h * at_start[i]
            for _ in range(1, columns[j]):
                for i in range(size):
                    total[i] = y[i] + now[i]
                _rates(springs, total.reshape(shape), rate.reshape(shape))
                for i in range(size):
                    following = before[i] + 2.0 * h * rate[i]
                    before[i] = now[i]
                    now[i] = following
            for i in range(size):
                table[j, i] = now[i]
            for k in range(j - 1, -1, -1):
                factor = (columns[j] / columns[k]) ** 2 - 1.0
                for i in range(size):
                    table[k, i] = table[k + 1, i] + (table[k + 1, i] - table[k, i]) / factor
        for i in range(size):
            change = table[0, i] - lost[i]
            total[i] = y[i] + change
            lost[i] = (total[i] - y[i]) - change
            y[i] = total[i]
    return y.reshape(shape)


def springs_of(scene: PlainScene) -> Springs:
    """Return the connectors of a scene, all with the stiffness in extension."""
    axis = (scene.edges // 2 + 2) % 3
    arm = scene.half_width * (1.0 - 2.0 * (scene.edges % 2))
    first, second, first_axis, second_axis, first_arm, second_arm = (
        np.ascontiguousarray(column) for column in (*scene.bodies.T, *axis.T, *arm.T))
    return Springs(
        first, second, first_axis, second_axis, first_arm, second_arm,
        np.full(len(first), scene.stiffness), scene.damping,
        scene.natural_length, scene.mass, scene.inertia)


def start_of(scene: PlainScene) -> np.ndarray:
    """Return the initial state (n, 18)."""
    count = scene.body_count
    return np.hstack(
        [scene.position, scene.velocity, scene.axes.reshape(count, 9), scene.spin])


def motion_of(state: np.ndarray) -> Motion:
    """Return positions and axes of all bodies in a state (n, 18)."""
    return Motion(state[:, :3].copy(), state[:, 6:15].reshape(-1, 3, 3).copy())


def reference_motion(
    scene: PlainScene, duration: float, *, growth_samples: int = 4, displacement: float = 1e-7
) -> Reference:
    """
    Return the reference motion of `scene` at `duration` [s].

    The growth is that of random displacements of all bodies, of at most `displacement` (over a,
    and in rad).
    """
    springs, start = springs_of(scene), start_of(scene)
    count = int(np.ceil(duration * scene.frequency_bound / COURANT))
    end = extrapolate(springs, start, duration, count, COLUMNS)
    finer = extrapolate(springs, start, duration, (3 * count + 1) // 2, COLUMNS)
    uncertainty = motion_error(motion_of(end), motion_of(finer), scene.half_edge)
    growth = 0.0
    generator = np.random.RandomState(7)
    for _ in range(growth_samples):
        moved = displaced(start, generator, displacement, scene.half_edge)
        before = motion_error(motion_of(moved), motion_of(start), scene.half_edge)
        moved = extrapolate(springs, moved, duration, count, COLUMNS)
        after = motion_error(motion_of(moved), motion_of(end), scene.half_edge)
        growth = max(growth, after / before)
    return Reference(motion_of(finer), duration, uncertainty, growth)


def displaced(
    start: np.ndarray, generator: np.random.RandomState, size: float, half_edge: float
) -> np.ndarray:
    """Return a state (n, 18) with random displacements and rotations of all bodies."""
    from scipy.spatial.transform import Rotation
    count = len(start)
    vectors = generator.uniform(-1.0, 1.0, (2, count, 3)) * size / np.sqrt(3.0)
    moved = start.copy()
    moved[:, :3] += half_edge * vectors[0]
    turn = Rotation.from_rotvec(vectors[1]).as_matrix()
    axes = start[:, 6:15].reshape(count, 3, 3)
    moved[:, 6:15] = (axes @ np.swapaxes(turn, 1, 2)).reshape(count, 9)
    return moved
