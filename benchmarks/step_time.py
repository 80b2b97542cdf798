# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Time for each body and step, and for building and compiling: 63, 4,631 and 100,920 bodies.

python benchmarks/step_time.py [--rounds 5]

One thread. The rounds of the sizes are interleaved; medians and ranges are printed. The state at
the end is checked: finite, moved, and its energy within 1 % of that at the start.
"""

import argparse
import statistics
import time

import icofabric_sim as ico
from machine import describe_machine
import numpy as np

# The fabric of the S1 and S3 scenes: L = w, random velocities and spins.
FABRIC = {
    'shell': {'edge_length': 0.02, 'thickness': 0.002, 'density': 1200.0},
    'connector': {'stiffness': 500.0},
    'initial_random': {'velocity_sigma': 0.05, 'spin_sigma': 2.0, 'seed': 1},
    'contact': {'mode': 'never'},
}
SIZES = {(5, 5, 5): 20_000, (21, 21, 21): 250, (58, 58, 60): 10}  # steps in a round


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--rounds', type=int, default=5)
    rounds = parser.parse_args().rounds
    print(describe_machine())
    simulations, setup = {}, {}
    for size in SIZES:
        started = time.perf_counter()
        scene = ico.Scene.from_parameters({**FABRIC, 'weave': {'size': list(size)}})
        built = time.perf_counter()
        simulation = ico.compile_scene(scene)
        compiled = time.perf_counter()
        simulation.warm_up()
        setup[size] = (built - started, compiled - built, time.perf_counter() - compiled)
        simulations[size] = simulation
    starts = {size: simulation.snapshot() for size, simulation in simulations.items()}
    figures: dict[tuple[int, ...], list[float]] = {size: [] for size in SIZES}
    for _ in range(rounds):
        for size, steps in SIZES.items():
            simulation = simulations[size]
            started = time.perf_counter()
            simulation.advance_steps(steps)
            passed = time.perf_counter() - started
            figures[size].append(passed / steps / simulation.scene.body_count * 1e9)
    print(f'{"bodies":>8} {"connectors":>10} {"build s":>8} {"compile s":>9} {"first call s":>12} '
          f'{"ns/body-step":>13} {"range":>15} {"ns/connector":>13}')
    for size, simulation in simulations.items():
        end, start, scene = simulation.snapshot(), starts[size], simulation.scene
        drift = abs(end.energy['total'] / start.energy['total'] - 1.0)
        assert np.isfinite(end.position).all() and drift < 0.01, drift
        assert np.abs(end.position - start.position).max() > 0.0
        median = statistics.median(figures[size])
        spread = f'{min(figures[size]):.0f}-{max(figures[size]):.0f}'
        per_connector = median * scene.body_count / scene.connector_count
        print(f'{scene.body_count:8,} {scene.connector_count:10,} '
              + ' '.join(f'{value:{width}.3f}' for value, width in zip(setup[size], (8, 9, 12)))
              + f' {median:13.1f} {spread:>15} {per_connector:13.1f}')


if __name__ == '__main__':
    main()
