# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Error against time of implicit steps and of `dop8` with overdamped connectors.

All runs have the same motion and alternate. The reference is `dop8` at 1e-10. An example scene,
such as one with contacts, may replace the plain fabric.

    .venv/bin/python -m icofabric_validation.benchmarks.implicit_steps [--damping 380 3800] \
        [--tolerance 1e-4 1e-6]
        [--scene squeezed_slab]
"""

import argparse
import time
from typing import Any

import icofabric_sim as ico
from icofabric_validation.benchmarks.scenes import FABRIC
import numpy as np

METHODS = ('dop8', 'sdirk4')


def plain(size: int) -> ico.Scene:
    """Return a fabric without contacts in random motion."""
    return ico.Scene.from_parameters({
        **FABRIC, 'weave': {**FABRIC['weave'], 'size': [size, size, size]},
        'connector': {'stiffness': 500.0}})


def run(scene: ico.Scene, damping: float, method: str, tolerance: float, duration: float) -> tuple[
        ico.Simulation, float]:
    """Return a run to `duration` [s], and the processor time [s] of its steps."""
    simulation = ico.compile_scene(scene.with_changes({
        'connector.damping': damping, 'solver.method': method, 'solver.tolerance': tolerance,
        'solver.threads': 1}))
    simulation.warm_up()
    began = time.process_time()
    simulation.advance_to(duration)
    return simulation, time.process_time() - began


def main() -> None:
    """Print a row for each damping, tolerance and method."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('--size', type=int, default=5, help='shells along each axis of the grid')
    parser.add_argument('--scene', help='an example scene instead of the plain fabric')
    parser.add_argument('--damping', type=float, nargs='+', default=[38.0, 380.0, 3800.0],
                        help='of each connector [N s/m]; critical damping is about 4')
    parser.add_argument('--tolerance', type=float, nargs='+', default=[1e-2, 1e-4, 1e-6, 1e-8])
    parser.add_argument('--duration', type=float, default=0.02, help='[s]')
    parser.add_argument('--rounds', type=int, default=3)
    chosen = parser.parse_args()
    scene = ico.load_scene(chosen.scene) if chosen.scene else plain(chosen.size)
    for method in METHODS:
        run(scene, chosen.damping[0], method, 1e-2, 1e-4)
    for damping in chosen.damping:
        exact, _ = run(scene, damping, 'dop8', 1e-10, chosen.duration)
        places, edge = exact.snapshot().position, exact.scene.geometry.half_edge
        for tolerance in chosen.tolerance:
            rows: dict[str, list[Any]] = {}
            for _ in range(chosen.rounds):
                for method in METHODS:
                    simulation, seconds = run(
                        scene, damping, method, tolerance, chosen.duration)
                    error = float(np.abs(simulation.snapshot().position - places).max()) / edge
                    rows.setdefault(method, []).append(
                        (seconds, simulation.status.step_count, error))
            times = {
                method: np.median([row[0] for row in found]) for method, found in rows.items()}
            for method, found in rows.items():
                print(f'{damping:8g} N s/m {tolerance:8g} {method:7} {times[method]:8.3f} s '
                      f'{found[0][1]:7,} steps, error {found[0][2]:.1e} a', flush=True)
            print(f'{"":33}ratio {times["dop8"] / times["sdirk4"]:.2f}', flush=True)


if __name__ == '__main__':
    main()
