# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Real-time factors of the example scenes under random pushes: wanted and reached.

    .venv/bin/python -m icofabric_validation.robustness.random_pushes [SCENE ...] [--pushes 30] \
        [--tolerance 1e-4]

Each push is a steady force of a random size, up to the weight of the slab, and direction, for a
tenth of a second, shared out over the bodies of a load channel, or of the whole fabric where the
scene has none. Poses are read 60 times a second of simulated time, as a node does. Factors are by
processor time of one thread, so that what else runs on the machine counts little. The table is
written as CSV (--csv).
"""

import argparse
from collections.abc import Sequence
import csv
from pathlib import Path
import random
import statistics
import sys
import time
from typing import NamedTuple

import icofabric_sim as ico
from icofabric_sim.messages.topics import Outputs
from icofabric_sim.parameters.example_scenes import example_scenes
from icofabric_sim.running.diagnostics import remedies
from icofabric_sim.running.run_records import errors_of, figures, Status
from icofabric_sim.running.step_limit_reason import StepLimit
from icofabric_validation.benchmarks.machine import describe_machine
from icofabric_validation.source_tree import ROOT

STANDARD_GRAVITY = 9.81  # [m/s^2]: a scene without gravity has a weight too
PUSH = 0.1  # [s]
RATE = 60.0  # [Hz] of poses
CHANNEL = 'pushes'
# Of one scene: a slower one is given up, with what it has reached [s of processor time].
PATIENCE = 90.0


class Row(NamedTuple):
    """One scene."""

    scene: str
    bodies: int
    push: float  # the largest [N]
    pushes: int  # that were done
    wanted: float
    median: float  # of the factors reached in each push
    worst: float
    fastest: str  # what limited the step in the worst one
    helps: str
    end: str  # why it ended before; '': it did not


def push_at_random(name: str, pushes: int, seed: int, tolerance: float | None = None) -> Row:
    """Push one scene, with another `tolerance` [1/s] than its own where one is given."""
    chance = random.Random(seed)
    scene = ico.load_scene(name).with_changes({'solver.threads': 1})
    if tolerance is not None:
        scene = scene.with_changes({'solver.tolerance': tolerance})
    if scene.loads:
        channel = next(iter(scene.loads))
    else:
        channel = CHANNEL
        scene = scene.with_changes({f'loads.{CHANNEL}': {'group': 'all', 'share': 'total'}})
    weight = scene.body_count * scene.shell.mass * STANDARD_GRAVITY
    shares = 1.0 if scene.loads[channel].total else float(len(scene.loads[channel].bodies))
    simulation, outputs = ico.compile_scene(scene), Outputs(scene)
    simulation.warm_up()
    # All kernels are there before the first push, those of the first contact too.
    kernels = simulation.prepare_contacts()
    if kernels is not None:
        kernels.wait()
    limit, factors, worst, end, largest = StepLimit(), [], '', '', 0.0
    helps, spent, begin = '', 0.0, simulation.time
    for number in range(pushes):
        direction = [chance.gauss(0.0, 1.0) for _ in range(3)]
        size = chance.uniform(0.0, weight)
        largest = max(largest, size)
        length = sum(part**2 for part in direction) ** 0.5 * shares
        began = time.process_time()
        try:
            simulation.apply_wrench(channel, [size / length * part for part in direction])
            for k in range(1, round(PUSH * RATE) + 1):
                simulation.advance_to(begin + number * PUSH + k / RATE)
                outputs.poses(simulation.snapshot(), k)
        except ico.SimulationError as error:
            end = str(error)
            break
        took = time.process_time() - began
        spent += took
        factors.append(PUSH / took)
        if factors[-1] == min(factors):
            worst = limit.describe(simulation, round(simulation.time * 1e9))
            helps = remedies(_status(simulation, worst))
        if spent > PATIENCE:
            end = f'given up after {PATIENCE:g} s of processor time'
            break
    wanted = scene.parameters['real_time_factor']
    factors = factors or [0.0]
    return Row(
        name, scene.body_count, largest, len(factors), wanted, statistics.median(factors),
        min(factors), worst, helps if min(factors) < wanted else '', end)


def _status(simulation: ico.Simulation, limited_by: str) -> Status:
    return Status(
        time=0, paused=False, finished=False, failure='', factor=0.0, target_factor=1.0,
        dropped=0, errors=errors_of(simulation), limited_by=limited_by, **figures(simulation))


def main(arguments: Sequence[str] | None = None) -> int:
    """Push the scenes; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('scenes', nargs='*', metavar='SCENE', help='default: all example scenes')
    parser.add_argument('--pushes', type=int, default=30)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--tolerance', type=float, help="[1/s] (default: the scene's)")
    parser.add_argument('--csv', type=Path, default=ROOT / 'runs' / 'random_pushes.csv')
    options = parser.parse_args(arguments)
    print(describe_machine(), flush=True)
    options.csv.parent.mkdir(parents=True, exist_ok=True)
    with options.csv.open('w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file)
        writer.writerow(Row._fields)
        for name in options.scenes or example_scenes():
            row = push_at_random(name, options.pushes, options.seed, options.tolerance)
            writer.writerow(row)
            file.flush()
            print(
                f'| `{row.scene}` | {row.bodies} | {row.push:.2g} N | {row.wanted:g} | '
                f'{row.median:.2g} | {row.worst:.2g} | {row.pushes} | {row.helps} |', flush=True)
            print(f'    {row.fastest}', *([f'ended: {row.end}'] if row.end else []), flush=True)
    print(f'written to {options.csv}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
