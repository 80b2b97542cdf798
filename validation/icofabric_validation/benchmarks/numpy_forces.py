# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Forces of springs in vectorised NumPy, compared with a leapfrog step of the package.

A slab of 4,631 bodies and 25,200 connectors, one thread, processor time, alternating in every
round. The forces of both are compared first.

    .venv/bin/python -m icofabric_validation.benchmarks.numpy_forces [--rounds 9]
"""

import argparse
import statistics
import time

import icofabric_sim as ico
from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_validation.benchmarks.machine import describe_machine
from icofabric_validation.benchmarks.scenes import FABRIC, SIZES
import numpy as np

STEP, STEPS = 1e-4, 200


class Springs:
    """Connectors as arrays, component by component, with one evaluation of their forces."""

    def __init__(self, scene: ico.Scene) -> None:
        """Copy the connectors of `scene`."""
        self.first, self.second = np.array(scene.connectors.bodies).T.copy()
        self.ends = np.concatenate((self.first, self.second))
        self.points = np.array(scene.connectors.points_body).transpose(1, 2, 0).copy()  # (2, 3, c)
        self.stiffness = scene.parameters['connector.stiffness']
        self.natural = np.broadcast_to(scene.connectors.laws.natural_length, self.first.shape)
        self.count = scene.body_count

    def act(self, position: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return forces and torques (3, n) at `position` (3, n) and `axes` (3, 3, n)."""
        arms = [self._turn(self.points[0], axes.take(self.first, axis=2)),
                self._turn(self.points[1], axes.take(self.second, axis=2))]
        along = position.take(self.second, axis=1) - position.take(self.first, axis=1)
        along += arms[1]
        along -= arms[0]
        length = np.sqrt(along[0] * along[0] + along[1] * along[1] + along[2] * along[2])
        along *= self.stiffness * (1.0 - self.natural / length)
        torques = np.concatenate((_cross(arms[0], along), _cross(along, arms[1])), axis=1)
        return self._sum(np.concatenate((along, -along), axis=1)), self._sum(torques)

    def _turn(self, points: np.ndarray, axes: np.ndarray) -> np.ndarray:
        return points[0] * axes[0] + points[1] * axes[1] + points[2] * axes[2]

    def _sum(self, parts: np.ndarray) -> np.ndarray:
        return np.stack([np.bincount(self.ends, part, self.count) for part in parts])


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.stack((
        a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]))


def main() -> None:
    """Compare, then print one line."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--rounds', type=int, default=9)
    given = parser.parse_args()
    print(describe_machine())
    scene = ico.Scene.from_parameters({
        **FABRIC, 'weave': {**FABRIC['weave'], 'size': list(SIZES['S3'])},
        'solver': {'method': 'leapfrog', 'step': STEP, 'threads': 1}})
    simulation = ico.compile_scene(scene)
    simulation.advance_to(STEP * STEPS)
    springs = Springs(scene)
    snapshot = simulation.snapshot()
    position = snapshot.position.T.copy()
    axes = cosines_from_quaternions(snapshot.orientation).transpose(1, 2, 0).copy()
    force, torque = springs.act(position, axes)
    # Newton's third law, and the torques of a free fabric about one point.
    lever = _cross(position, force)
    assert np.abs(force.sum(axis=1)).max() < 1e-9 * np.abs(force).sum()
    assert np.abs((torque + lever).sum(axis=1)).max() < 1e-9 * np.abs(lever).sum()
    assert np.abs(force).max() > 0.0
    ratios = []
    for _ in range(given.rounds):
        began = time.process_time()
        for _ in range(20):
            springs.act(position, axes)
        forces = (time.process_time() - began) / 20
        began = time.process_time()
        simulation.advance_to(simulation.time + STEP * STEPS)
        step = (time.process_time() - began) / STEPS
        ratios.append(forces / step)
    print(f'{scene.body_count:,} bodies: forces in NumPy {forces * 1e3:.2f} ms, '
          f'a step of ours {step * 1e3:.3f} ms; '
          f'{statistics.median(ratios):.1f} times ({min(ratios):.1f}-{max(ratios):.1f})')


if __name__ == '__main__':
    main()
