# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Target and reached real-time factors of the example scenes under random wrenches.

    .venv/bin/python -m icofabric_validation.robustness.random_wrenches [SCENE ...] [--pushes 30] \
        [--tolerance 1e-4]

Each push is a steady force of random direction and size, up to the weight of the slab, for a tenth
of a second. It is distributed over the bodies of a load channel, or of the whole fabric if the
scene has none. Poses are read 60 times in a second of simulated time, as a node does. Factors are
for processor time of one thread, so that other programs have little effect. The table is written
as CSV (--csv).
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

STANDARD_GRAVITY = 9.81  # [m/s^2]; also for scenes without gravity
PUSH_DURATION_S = 0.1
POSE_RATE_HZ = 60.0
CHANNEL = 'pushes'
# Limit of the processor time [s] of one scene; a slower scene is stopped.
MAX_PROCESSOR_TIME_S = 90.0


class Row(NamedTuple):
    """The results of one scene."""

    scene: str
    bodies: int
    push: float  # largest force [N]
    pushes: int  # number of completed pushes
    target: float  # real-time factor
    median: float  # of the factors reached in each push
    worst: float
    limit: str  # cause of the step length in the worst push
    remedy: str
    end: str  # reason of an early end; '': none


def push_at_random(name: str, pushes: int, seed: int, tolerance: float | None = None) -> Row:
    """Push one scene, optionally with another `tolerance` [1/s]."""
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
    shares = 1.0 if scene.loads[channel].is_divided else float(len(scene.loads[channel].bodies))
    simulation, outputs = ico.compile_scene(scene), Outputs(scene)
    simulation.warm_up()
    # Load all kernels, with those of contacts, before the first push.
    kernels = simulation.prepare_contacts()
    if kernels is not None:
        kernels.wait()
    step_limit, factors, worst, end, largest = StepLimit(), [], '', '', 0.0
    remedy, spent, begin = '', 0.0, simulation.time
    for number in range(pushes):
        direction = [chance.gauss(0.0, 1.0) for _ in range(3)]
        size = chance.uniform(0.0, weight)
        largest = max(largest, size)
        length = sum(part**2 for part in direction) ** 0.5 * shares
        began = time.process_time()
        try:
            simulation.apply_wrench(channel, [size / length * part for part in direction])
            for k in range(1, round(PUSH_DURATION_S * POSE_RATE_HZ) + 1):
                simulation.advance_to(begin + number * PUSH_DURATION_S + k / POSE_RATE_HZ)
                outputs.poses(simulation.snapshot(), k)
        except ico.SimulationError as error:
            end = str(error)
            break
        took = time.process_time() - began
        spent += took
        factors.append(PUSH_DURATION_S / took)
        if factors[-1] == min(factors):
            worst = step_limit.describe(simulation, round(simulation.time * 1e9))
            remedy = remedies(_status(simulation, worst))
        if spent > MAX_PROCESSOR_TIME_S:
            end = f'stopped after {MAX_PROCESSOR_TIME_S:g} s of processor time'
            break
    target = scene.parameters['real_time_factor']
    factors = factors or [0.0]
    return Row(
        name, scene.body_count, largest, len(factors), target, statistics.median(factors),
        min(factors), worst, remedy if min(factors) < target else '', end)


def _status(simulation: ico.Simulation, limited_by: str) -> Status:
    return Status(
        time=0, paused=False, finished=False, failure='', factor=0.0, target_factor=1.0,
        dropped=0, errors=errors_of(simulation), limited_by=limited_by, **figures(simulation))


def main(arguments: Sequence[str] | None = None) -> int:
    """Push the scenes; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('scenes', nargs='*', metavar='SCENE', help='default: all example scenes')
    parser.add_argument('--pushes', type=int, default=30)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--tolerance', type=float, help="[1/s] (default: the scene's)")
    parser.add_argument('--csv', type=Path, default=ROOT / 'runs' / 'random_wrenches.csv')
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
                f'| `{row.scene}` | {row.bodies} | {row.push:.2g} N | {row.target:g} | '
                f'{row.median:.2g} | {row.worst:.2g} | {row.pushes} | {row.remedy} |', flush=True)
            print(f'    {row.limit}', *([f'ended: {row.end}'] if row.end else []), flush=True)
    print(f'written to {options.csv}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
