# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
One fabric on several MPI ranks: time per step, halo, memory and bit identity by number of ranks.

    .venv/bin/python -m icofabric_validation.benchmarks.mpi_scaling --size 41 --steps 192 \
        --ranks 1 2
    .venv/bin/python -m icofabric_validation.benchmarks.mpi_scaling --size 41 --steps 192 \
        --ranks 1 2 --weak
    .venv/bin/python -m icofabric_validation.benchmarks.mpi_scaling --size 273 --steps 8 --warm 8 \
        --step 4e-4
    .venv/bin/python -m icofabric_validation.benchmarks.mpi_scaling --size 41 --scene damped \
        --method dop8 --steps 32
    .venv/bin/python -m icofabric_validation.benchmarks.mpi_scaling --size 31 --scene pressed \
        --step 2e-6 --steps 256
    .venv/bin/python -m icofabric_validation.benchmarks.mpi_scaling --size 585 --ranks 100 --build
    .venv/bin/python -m icofabric_validation.benchmarks.mpi_scaling --model

Strong scaling: a slab of size^3 grid positions on more and more ranks. Weak scaling: as many
layers for each rank. The first steps are not counted. Errors are measured only for adaptive steps
(`--step 0`). The slab is free, or its connectors are `damped`, or the faces of its shells are
`pressed` on each other, with friction. At health checks each rank sums over its bodies and saves
their state (`check`), and the first rank waits for all sums. With contacts, and when errors are
measured, the first rank gathers the state, checks it and returns it, while the others wait
(`gather`). Both are fractions of the time of the first rank. Memory of the first rank is its peak
until the end of the steps, and after output of the state. `--build` runs no steps: it builds the
data of the first rank for many ranks, a slab at rest, and the windows of the first, a middle and
the last rank, one by one; it prints times and memory. `--model` prints times for more ranks,
modelled with measured terms; it runs no steps.
"""

import argparse
import hashlib
import json
from pathlib import Path
import resource
import subprocess
import sys
import time
from typing import Any

import icofabric_sim as ico
from icofabric_sim.kernels.figures import group_size
from icofabric_sim.kernels.runtime.lanes import LANES
from icofabric_sim.scene.available_memory import share_among
from icofabric_sim.simulation.devices import (
    leader,
    pair_leader,
    pair_steps,
    part_steps,
    sharing,
)
from icofabric_sim.simulation.devices.division import divide
from icofabric_sim.simulation.devices.slot_rows import SlotRows
from icofabric_sim.simulation.devices.unpacked import Unpacked
from icofabric_sim.simulation.devices.window import bytes_of, slots_of, window_of
from icofabric_sim.simulation.model.packing import pack_scene
from icofabric_sim.simulation.stepping.thread_team import teams_of
import numpy as np

MPIEXEC = Path(sys.executable).parent / 'mpiexec'
# Terms of the model: seconds per body and evaluation, per body at a health check on its rank, and
# per group of blocks whose sums the first rank adds up; seconds per message and bytes per second
# between two processes of one machine; evaluations between health checks, messages of the first
# rank to and from each other rank in that interval, and bytes of halo per body of a border layer.
EVALUATION, CHECK, GROUP, LATENCY, BANDWIDTH, EVERY, TALK, POSE = (
    20e-9, 100e-9, 20e-9, 5e-6, 5e9, 64, 4, 56)


class Clock:
    """Accumulated times of some functions."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def of(self, owner: Any, name: str) -> None:
        """Time all later calls of a function of a module or class."""
        function = getattr(owner, name)

        def timed(*arguments: Any, **words: Any) -> Any:
            began = time.perf_counter()
            try:
                return function(*arguments, **words)
            finally:
                self.seconds += time.perf_counter() - began

        setattr(owner, name, timed)


SCENES: dict[str, dict[str, Any]] = {
    'free': {'contact.mode': 'never'},
    'damped': {'contact.mode': 'never', 'connector.damping': 0.02},
    # At the smallest angle, with natural lengths a thirtieth shorter: faces are in contact at
    # once.
    'pressed': {
        'weave.connector_angle': -0.3648, 'connector.natural_length': 0.0243,
        'contact.friction': 0.3, 'contact.stiffness': 2e4},
}


def scene_of(arguments: argparse.Namespace, layers: int) -> ico.Scene:
    """Return a slab in free motion."""
    return ico.Scene.from_parameters({
        'weave.size': [arguments.size, arguments.size, layers], **SCENES[arguments.scene],
        'initial_random': {'velocity_sigma': 0.02, 'spin_sigma': 1.0, 'seed': 1},
        'solver': {'method': arguments.method, 'step': arguments.step, 'threads': 1}})


def take_part(arguments: argparse.Namespace) -> None:
    """Run one rank, and print its results as one line of JSON."""
    steps = arguments.steps
    before = peak()
    found: dict[str, object] = {}
    with ico.Ranks() as ranks, teams_of(1):
        if ranks.leads:
            scene = scene_of(arguments, arguments.take_part)
            simulation = ico.compile_scene(scene, ranks=ranks)
            simulation.advance_steps(arguments.warm)
            if arguments.step:
                simulation._driver.errors.probe.checks_left = 10**9
            gathering, checking = Clock(), Clock()
            for owner in (leader.SharedSteps, pair_leader.SharedPair):
                gathering.of(owner, '_gather')
                gathering.of(owner, '_scatter')
            gathering.of(sharing.Sharing, 'gather_figures')
            for part in (part_steps.PartSteps, pair_steps.PairPart):
                checking.of(part, 'examine')
            checking.of(sharing.Sharing, 'save_parts')
            checking.of(sharing, 'judge')
            for name in ('place_all', 'examine', 'save'):
                for module in (leader, pair_leader):
                    checking.of(module, name)
            began = time.perf_counter()
            simulation.advance_steps(steps)
            found['seconds'] = (time.perf_counter() - began) / steps
            found['gather'] = gathering.seconds / steps
            found['check'] = checking.seconds / steps
            found['steps_memory'] = peak() - before
            digest = hashlib.sha256(simulation.snapshot().position.tobytes())
            holder: Any = simulation._driver.trajectory.executor
            found.update(
                bodies=scene.body_count, digest=digest.hexdigest()[:12],
                halos=[tuple(halo) for halo in getattr(holder, 'halos', [])])
    found.update(rank=ranks.rank, memory=peak() - before)
    print(json.dumps(found), flush=True)


def peak() -> int:
    """Return the peak memory of this process [B]."""
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def measure(arguments: argparse.Namespace, count: int, layers: int) -> list[dict[str, Any]]:
    """Start `count` ranks, and return their results by rank."""
    words = [
        f'--{name}={getattr(arguments, name)}'
        for name in ('size', 'steps', 'warm', 'step', 'method', 'scene')]
    done = subprocess.run(
        [MPIEXEC, '-n', str(count), sys.executable, '-m',
         'icofabric_validation.benchmarks.mpi_scaling', f'--take-part={layers}', *words],
        check=True, stdout=subprocess.PIPE, text=True)
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith('{')]
    return sorted(lines, key=lambda found: int(found['rank']))


def report(arguments: argparse.Namespace) -> None:
    """Print a row for each number of ranks."""
    print(f'{"ranks":>5} {"bodies":>10} {"ms/step":>9} {"ns/body":>8} {"gather":>7} '
          f'{"check":>6} {"speed":>6} {"halo kB":>8} {"least":>8} '
          f'{"B/body, first":>14} {"shown":>7} {"others":>7}  bits')
    first = 0.0
    for count in arguments.ranks:
        layers = arguments.size * count if arguments.weak else arguments.size
        ranks = measure(arguments, count, layers)
        lead = ranks[0]
        each, bodies = lead['seconds'], lead['bodies']
        speed = bodies / each
        first = first or speed
        halo, least = (
            max(halo[kind] for halo in lead['halos'] or [(0, 0)]) for kind in (0, 1))
        others = max((rank['memory'] for rank in ranks[1:]), default=0)
        print(f'{count:5} {bodies:10,} {1e3 * each:9.3f} {1e9 / speed:8.2f} '
              f'{lead["gather"] / each:7.1%} {lead["check"] / each:6.1%} {speed / first:6.2f} '
              f'{halo / 1e3:8.1f} {least / 1e3:8.1f} {lead["steps_memory"] / bodies:14.0f} '
              f'{lead["memory"] / bodies:7.0f} {others * count / bodies:7.0f}  {lead["digest"]}')


def build(arguments: argparse.Namespace) -> None:
    """Build the data of the first rank for many ranks, and windows of some ranks, one by one."""
    (count,), bodies = arguments.ranks, 1
    share_among(count)

    def make() -> ico.Scene:
        return ico.Scene.from_parameters({
            'weave.size': [size] * 3, **SCENES[arguments.scene], 'gravity': [0.0, 0.0, -9.81],
            'solver': {'method': arguments.method}})

    # Earlier imports and compilation are not counted.
    size = 5
    pack_scene(make())
    size, (before, _), began = arguments.size, memory(), time.perf_counter()

    def note(what: str) -> None:
        now, most = memory()
        print(f'{what:40} {time.perf_counter() - began:8.1f} s {(now - before) / bodies:8.1f} '
              f'B a body, at most {(most - before) / bodies:8.1f}', flush=True)

    scene = make()
    bodies = scene.body_count
    print(f'{bodies:,} bodies, {scene.connector_count:,} connectors, {count} ranks')
    note('scene')
    packed = pack_scene(scene)
    layout, model = packed.layout, packed.model
    note('slots, blocks and connectors of them')
    parts = divide(layout, model.links, count)
    note('parts of all ranks')
    unpacked = Unpacked(layout, scene.initial)
    note('bodies by their slots')
    for rank in sorted({0, count // 2, count - 1}):
        part = parts[rank]
        slots = slots_of(model, layout, part)
        window = window_of(model, layout, part, slots, np.zeros(0, np.int64))
        rows = SlotRows(layout.blocks.slot[part.first:part.last])
        own = int(np.unpackbits(layout.blocks.alive[part.first:part.last]).sum())
        for _ in unpacked.rows(rows.index):
            pass
        need = bytes_of(window.slot_count, kinked=False)
        note(f'rank {rank}: window and start of {own:,}')
        print(f'{"":40} it needs {need / own:.0f} B for each local body, '
              f'{8 * len(part.halo) / own:.3f} of which it receives')


def memory() -> tuple[int, int]:
    """Return current and peak memory of this process [B]."""
    fields = dict(
        line.split(':', 1) for line in Path('/proc/self/status').read_text().splitlines())
    now, most = (1024 * int(fields[name].split()[0]) for name in ('VmRSS', 'VmHWM'))
    return now, most


def model() -> None:
    """Print modelled times of an evaluation for cubes of layers."""
    print(f'{"bodies":>14} {"ranks":>6} {"ms":>10} {"speed":>7} {"efficiency":>10}   of it in % '
          'own bodies, health checks, halo')
    for bodies in (10**6, 10**7, 10**8, 10**9):
        alone = bodies * (EVALUATION + CHECK / EVERY)
        for ranks in (2, 4, 16, 64, 256, 1000):
            own = bodies * EVALUATION / ranks
            groups = bodies / (LANES * group_size(bodies // LANES))
            # Work of each rank, and work of the first rank for all.
            checks = (
                bodies * CHECK / ranks + groups * GROUP + ranks * TALK * LATENCY) / EVERY
            # A layer of a cube on each side, sent while inner bodies are computed.
            layer = (2.0 * bodies) ** (2.0 / 3.0) / 2.0
            travel = 2.0 * (LATENCY + POSE * layer / BANDWIDTH)
            halo = max(travel - own, 0.0) + 2.0 * LATENCY
            total = own + checks + halo
            print(f'{bodies:14,} {ranks:6} {1e3 * total:10.3f} {alone / total:7.2f} '
                  f'{alone / total / ranks:10.1%}   {own / total:4.0%} {checks / total:4.0%} '
                  f'{halo / total:4.0%}')


def main() -> None:
    """Measure or model."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--size', type=int, default=41, help='grid positions along x and y')
    parser.add_argument('--steps', type=int, default=192)
    parser.add_argument('--warm', type=int, default=64, help='steps that are not counted')
    parser.add_argument('--step', type=float, default=1e-4, help='solver.step [s]; 0: adaptive')
    parser.add_argument('--ranks', type=int, nargs='+', default=[1, 2])
    parser.add_argument('--method', default='leapfrog', choices=sorted(ico.METHODS))
    parser.add_argument('--scene', default='free', choices=SCENES)
    parser.add_argument('--weak', action='store_true', help='as many layers for each rank')
    parser.add_argument(
        '--build', action='store_true', help='build the data of the first rank; run no steps')
    parser.add_argument('--model', action='store_true', help='print the model; run no steps')
    parser.add_argument('--take-part', type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.model:
        model()
    elif arguments.build:
        build(arguments)
    elif arguments.take_part:
        take_part(arguments)
    else:
        report(arguments)


if __name__ == '__main__':
    main()
