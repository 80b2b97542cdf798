# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Overhead of a sweep: time per run, and fraction of the cores that runs use.

    .venv/bin/python -m icofabric_validation.benchmarks.sweep_overhead --runs 2000 --seconds 0.5 \
        --workers 2

Runs of one scene that differ in a stiffness, each of about the requested time on one core, in a
separate store. The worker records the time of a run: building and compiling the scene (kernels are
on disk), and steps to the end. The remaining time is overhead: Dask, the store, the table.
"""

import argparse
import json
import os
from pathlib import Path
import tempfile
import time

import icofabric_sim as ico
from icofabric_sim.sweeps.sweep import Executor, Study
import numpy as np

SCENE = {
    'weave.size': [3, 3, 3], 'weave.connector_angle': 0.3, 'gravity': [0.0, 0.0, -9.81],
    'groups.wall': 'x_min', 'groups.tip': 'x_max', 'supports.wall.group': 'wall',
    'loads.tip.group': 'tip', 'loads.tip.share': 'total', 'duration': 0.05}


def scene_of(seconds: float) -> ico.Scene:
    """Return a scene whose run takes about `seconds` [s] on one core, by its step."""
    step = 1e-6
    scene = ico.Scene.from_parameters({**SCENE, 'solver.step': step, 'solver.threads': 1})
    ico.compile_scene(scene).advance_to(0.01)
    began = time.process_time()
    ico.compile_scene(scene).advance_to(scene.parameters['duration'])
    return scene.with_changes({'solver.step': step * (time.process_time() - began) / seconds})


def own_times(store: Path, keys: list[str]) -> np.ndarray:
    """Return the times of the runs themselves [s]."""
    return np.array([
        json.loads((store / key / 'result.json').read_text('utf-8'))['seconds'] for key in keys])


def main() -> None:
    """Measure, and print figures."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--runs', type=int, default=2000)
    parser.add_argument('--seconds', type=float, default=0.5, help='time of a run [s]')
    parser.add_argument('--workers', type=int, default=len(os.sched_getaffinity(0)))
    arguments = parser.parse_args()
    scene = scene_of(arguments.seconds)
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        study = Study(
            scene, {'connector.stiffness': f'500..600/{arguments.runs}'}, keep='energies',
            store=folder)
        planned = time.perf_counter()
        outcomes, times = [], []
        for outcome in study.outcomes(Executor(arguments.workers, '')):
            outcomes.append(outcome)
            times.append(time.perf_counter())
        ended = time.perf_counter()
        table = study.table(outcomes)
        assert len(table) == arguments.runs and not table.failed, table.failed
        own = own_times(study.store.path, [outcome.key for outcome in outcomes])
        again = time.perf_counter()
        assert all(one.reused for one in study.outcomes(Executor(arguments.workers, '')))
        reread = time.perf_counter() - again
    workers = arguments.workers or 1
    # The first run loads kernels, and the others wait for it.
    steady = (workers * (times[-1] - times[0]) - own[1:].sum()) / (len(own) - 1)
    print(f'{arguments.runs:,} runs of {np.median(own):.3f} s (median) on {workers} workers')
    print(f'plan and keys: {1e3 * (planned - began) / arguments.runs:.2f} ms a run')
    print(f'start, first run included: {times[0] - planned:.1f} s')
    print(f'overhead per run on its core, from the first to the last: {1e3 * steady:.2f} ms')
    print(f'fraction of the cores that runs use: {own.sum() / (workers * (ended - began)):.1%} of '
          f'all, {own[1:].sum() / (workers * (times[-1] - times[0])):.1%} after the first run')
    print(f'taken from the store again: {1e3 * reread / arguments.runs:.2f} ms a run')


if __name__ == '__main__':
    main()
