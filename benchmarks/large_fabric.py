# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
A million icosahedra: time to build, compile and step, and the peak of memory.

python benchmarks/large_fabric.py [--size 126]
"""

import argparse
import resource
import time

import icofabric_sim as ico
from machine import describe_machine


def peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--size', type=int, default=126, help='grid positions along each side')
    size = parser.parse_args().size
    print(describe_machine())
    small = ico.compile_scene(ico.Scene.from_parameters({'initial_random.spin_sigma': 1.0}))
    small.advance_steps(70)
    before = peak()
    marks = [time.perf_counter()]
    scene = ico.Scene.from_parameters(
        {'weave.size': [size] * 3, 'initial_random.spin_sigma': 1.0})
    marks.append(time.perf_counter())
    simulation = ico.compile_scene(scene)
    marks.append(time.perf_counter())
    simulation.advance_steps(5)
    marks.append(time.perf_counter())
    snapshot = simulation.snapshot()
    assert abs(snapshot.position - scene.position).max() > 0.0
    build, compiled, steps = (late - early for early, late in zip(marks, marks[1:]))
    count = scene.body_count
    print(f'{count:,} bodies, {scene.connector_count:,} connectors: build {build:.2f} s, compile '
          f'{compiled:.2f} s, {steps / 5 / count * 1e9:.0f} ns for each body and step')
    print(f'peak memory above the interpreter with a small scene: {(peak() - before) / 2**20:.0f} '
          f'MiB, {(peak() - before) / count:.0f} bytes for each body')


if __name__ == '__main__':
    main()
