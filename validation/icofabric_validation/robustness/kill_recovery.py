# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Recovery by `icofabric recover` of recordings that are killed (kill -9) at random times.

    .venv/bin/python -m icofabric_validation.robustness.kill_recovery [--kills 20] [--seed 1] \
        [--longest 6] [--limit 1]

Each recording is a separate process that simulates in real time, with wrenches, parameter changes,
pauses and checkpoints at random times. The lost wall time, which must be less than the limit, and
the result of `icofabric verify` are printed. The exit status is 1 if a recording fails.
"""

import argparse
import contextlib
import os
from pathlib import Path
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from typing import Any, NamedTuple

import icofabric_sim as ico
from icofabric_sim.bag import BagError, BagReader, recover_bag
from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.messages import WrenchStampedBytes
from icofabric_sim.messages.topics import CLOCK
from icofabric_sim.running.recording import BagSink
from icofabric_sim.running.replay.verify import verify_run
from icofabric_sim.running.runner import Runner
from icofabric_sim.simulation.simulation import compile_scene
from icofabric_validation.source_tree import ROOT
import numpy as np

SLAB = ROOT / 'config' / 'hanging_slab.yaml'
TINY: dict[str, Any] = {
    'weave.size': [2, 2, 2], 'groups.tip': 'ids 1',
    'loads.tip.group': 'tip'}
# Scene, and parameters of the recording.
VARIANTS: tuple[tuple[str, dict[str, Any]], ...] = (
    ('tiny', {}),
    ('slab', {}),
    ('tiny', {'record.split_duration': 0.4}),
    ('slab', {'record.compression': 'zstd'}),
    ('slab', {'record.split_size': 200_000, 'record.compression': 'zstd'}),
)
_MAX_STAMPS = 1_000_000


class StampSink:
    """A sink that writes wall and simulated times of /clock to a file."""

    is_bag = False

    def __init__(self, path: Path) -> None:
        self._stamps = np.memmap(path, np.int64, 'w+', shape=(_MAX_STAMPS, 2))
        self._count = 0

    def wants(self, topic: Any) -> bool:
        return topic is CLOCK

    def send(self, topic: Any, nanoseconds: int, data: bytes) -> None:
        self._stamps[self._count] = time.monotonic_ns(), nanoseconds
        self._count += 1

    def send_input(self, *message: Any) -> None:
        pass

    def time_jumped_back(self, *jump: Any) -> None:
        pass


def read_stamps(path: Path) -> np.ndarray:
    """Return the wall and simulated times [ns] that a killed process has written."""
    stamps = np.memmap(path, np.int64, 'r', shape=(_MAX_STAMPS, 2))
    return np.array(stamps[:np.count_nonzero(stamps[:, 0])])


def drive(runner: Runner, folder: Path, generator: random.Random) -> None:
    """Send random inputs and requests to a run until the process is killed."""
    number = 0
    while True:
        time.sleep(generator.uniform(0.01, 0.06))
        force = [generator.gauss(0.0, 0.02) for _ in range(3)]
        topic, frame = generator.choice([
            ('~/wrench', 'icosahedron_0'), ('~/loads/tip', '')])
        message = WrenchStampedBytes(frame)
        message.force[:] = force
        runner.inputs.receive(topic, message.stamped(0))
        chance = generator.random()
        if chance < 0.02:
            runner.change(runner.parameters.with_changes({
                'connector.stiffness': generator.choice([300.0, 500.0, 700.0])}))
        elif chance < 0.03:
            runner.change(runner.parameters.with_changes({
                'weave.variant': generator.choice([0, 1])}))
        elif chance < 0.05:
            number += 1
            runner.save_checkpoint(folder / f'checkpoint_{number}')
        elif chance < 0.07:
            runner.set_paused(True)
            time.sleep(generator.uniform(0.0, 0.1))
            runner.set_paused(False)


def record(folder: Path, variant: int, seed: int) -> None:
    """Simulate and record until killed."""
    name, recording = VARIANTS[variant]
    parameters = ico.Scene.from_parameters(TINY).parameters if name == 'tiny' else (
        ico.load_scene(SLAB).parameters)
    scene = ico.Scene.from_parameters(parameters.with_changes({
        **recording, 'contact.mode': 'never', 'real_time_factor': 1.0, 'clock_rate': 200.0,
        'duration': 0.0}))
    simulation = compile_scene(scene)
    simulation.warm_up()
    bag = BagSink(
        folder / 'bag', simulation, live=True,
        on_error=lambda error: print(error, file=sys.stderr, flush=True))
    runner = Runner(simulation, [bag, StampSink(folder / 'stamps')])
    threading.Thread(
        target=drive, args=(runner, folder, random.Random(seed)), daemon=True).start()
    print('ready', flush=True)
    runner.run()


class Outcome(NamedTuple):
    """The recovered part of one recording."""

    recorded: float  # simulated time reached [s]
    messages: int
    lost: float  # wall time from the last recovered message to the last sent one [s]
    verdict: str


def kill(folder: Path, variant: int, seed: int, life: float) -> Outcome:
    """Record for `life` [s], kill, recover, verify."""
    with subprocess.Popen(
        [sys.executable, '-m', 'icofabric_validation.robustness.kill_recovery', '--record',
         str(folder), str(variant), str(seed)],
        stdout=subprocess.PIPE, text=True,
    ) as child:
        try:
            assert child.stdout is not None
            if child.stdout.readline() != 'ready\n':
                raise RuntimeError('the recording process did not start')
            time.sleep(life)
        finally:
            child.kill()
    assert child.returncode == -signal.SIGKILL
    return judge(folder)


def judge(folder: Path) -> Outcome:
    """Recover a recording, and compare with the times that were sent."""
    walls, times = read_stamps(folder / 'stamps').T
    if not len(times):
        return Outcome(0.0, 0, 0.0, 'killed before it began')
    try:
        report = recover_bag(folder / 'bag', folder / 'whole')
    except BagError as error:
        print(error, file=sys.stderr)
        return Outcome(times[-1] / 1e9, 0, (walls[-1] - walls[0]) / 1e9, 'nothing saved')
    with BagReader(folder / 'whole') as bag:
        saved = [moment for _, moment, _ in bag.messages(['/clock'])]
    last = int(np.searchsorted(times, saved[-1], 'right')) - 1 if saved else 0
    lost = (walls[-1] - walls[max(0, last)]) / 1e9
    with RecordedRun(folder / 'whole') as run:
        verdict = verify_run(run).lines()[-1].split(':')[0]
    return Outcome(times[-1] / 1e9, report.message_count, lost, verdict)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--kills', type=int, default=20)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--longest', type=float, default=6.0, help='longest life [s]')
    parser.add_argument('--limit', type=float, default=1.0, help='largest loss [s]')
    parser.add_argument('--record', nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.record:
        folder, variant, seed = arguments.record
        with contextlib.suppress(KeyboardInterrupt):
            record(Path(folder), int(variant), int(seed))
        return 0
    generator = random.Random(arguments.seed)
    bad, losses = 0, []
    print('kill  life [s]  scene  recording                   simulated [s]  messages  '
          'lost wall time [s]  verify')
    for number in range(arguments.kills):
        variant = number % len(VARIANTS)
        name, recording = VARIANTS[variant]
        life = generator.uniform(0.05, arguments.longest)
        with tempfile.TemporaryDirectory(prefix='kill-') as folder:
            outcome = kill(Path(folder), variant, generator.randrange(2**32), life)
        how = ', '.join(f'{key.split("_")[-1].split(".")[-1]} {value}'
                        for key, value in recording.items()) or 'one file'
        print(f'{number + 1:4d}  {life:8.2f}  {name}   {how:26s}  {outcome.recorded:13.3f}  '
              f'{outcome.messages:8d}  {outcome.lost:18.3f}  {outcome.verdict}', flush=True)
        losses.append(outcome.lost)
        good = outcome.verdict in ('identical', 'consistent') or outcome.messages == 0
        bad += not (good and outcome.lost < arguments.limit)
    print(f'lost at most {max(losses):.3f} s, on average {np.mean(losses):.3f} s; limit '
          f'{arguments.limit:g} s; {arguments.kills - bad} of {arguments.kills} good '
          f'({os.cpu_count()} processors, load {os.getloadavg()[0]:.1f})')
    return 1 if bad else 0


if __name__ == '__main__':
    sys.exit(main())
