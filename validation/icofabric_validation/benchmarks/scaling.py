# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""How time, memory and waiting grow with the number of bodies, and what threads gain."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
import statistics
import tempfile
from typing import NamedTuple

from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.simulation import compile_scene, Simulation
from icofabric_validation.benchmarks import probe
from icofabric_validation.benchmarks.scenes import scene_parameters
from icofabric_validation.benchmarks.step_speed import STEP
from icofabric_validation.benchmarks.timing import in_rounds, Spread, STEPS_BLOCK, timed
import numpy as np

Size = tuple[int, int, int]
# 63, 1,014, 4,631, 10,206, 49,726 and 100,920 bodies.
SIZES: tuple[Size, ...] = (
    (5, 5, 5), (12, 13, 13), (21, 21, 21), (27, 27, 28), (46, 46, 47), (58, 58, 60))
LARGEST = 101_000
# What others are compared with: about 10,000 bodies.
UNIT: Size = (27, 27, 28)
# A timed run takes steps of so many bodies in all, at least so many; and steps before it, which
# bring the arrays back into the cache as far as they fit, and wake the threads.
_BODY_STEPS, _FEWEST, _WARM_UP = 2_000_000, 10, 2
# Health checks measure what steps err by, which takes as long as some dozen steps: from step 128
# on, and ever less often. Where that many are timed these begin after so many.
_FIRST_MEASUREMENT, _BEFORE = 128, 1_250
# Waiting is measured in so many processes as there are rounds up to here, in one above.
_QUICK = 12_000


class SizeResult(NamedTuple):
    """Figures of one number of bodies; lists hold one for each round."""

    size: Size
    body_count: int
    connector_count: int
    threads: int  # that `solver.threads: 0` takes
    one: list[float]  # time of a plain step [s], one thread
    all: list[float]  # the same, as many threads as pay
    waits: list[dict[str, float]]  # [s], see probe.measure
    memory: float  # peak resident [bytes] above the interpreter's own
    recording: float  # the same while a bag is recorded

    def per_body(self, times: list[float]) -> Spread:
        """Time for each body and step [ns]."""
        return Spread.of([value * 1e9 / self.body_count for value in times])

    def gain(self) -> Spread:
        """What threads gain, round by round."""
        return Spread.of([alone / shared for alone, shared in zip(self.one, self.all)])

    def wait(self, name: str) -> float:
        """Median [s] over the processes."""
        return statistics.median(wait[name] for wait in self.waits)


class Scaling(NamedTuple):
    """All sizes, from few bodies to many."""

    rows: list[SizeResult]
    first_ever: dict[str, float]  # [s] with no kernels on disk; empty: not measured
    rounds: int

    def relative(self, row: SizeResult, *, threads: bool) -> Spread | None:
        """Time for each body and step over that of UNIT, round by round."""
        unit = next((other for other in self.rows if other.size == UNIT), None)
        if unit is None:
            return None
        own, its = (row.all, unit.all) if threads else (row.one, unit.one)
        return Spread.of([
            mine / row.body_count / (theirs / unit.body_count) for mine, theirs in zip(own, its)])


def sizes_up_to(largest: int) -> list[Size]:
    """
    Those of SIZES with at most `largest` bodies; and a cube of `largest` where that is above.
    """
    chosen = [size for size in SIZES if -(-size[0] * size[1] * size[2] // 2) <= largest]
    if largest > LARGEST:
        # Every second grid position has a body.
        side = round((2.0 * largest)**(1.0 / 3.0))
        chosen.append((side, side, side))
    return chosen


def measure(
    *, rounds: int = 5, largest: int = LARGEST, sizes: Sequence[Size] | None = None,
    first_ever: bool = True, say: Callable[[str], None] = lambda text: None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Scaling:
    """
    Time plain steps of all sizes in rounds; then waiting and memory, in processes of their own.
    """
    chosen = list(sizes_up_to(largest) if sizes is None else sizes)
    rows, tasks, simulations = [], [], []
    for size in chosen:
        pair = []
        for threads in (1, 0):
            say(f'{size[0]} x {size[1]} x {size[2]}, {"one thread" if threads else "threads"}')
            pair.append(_compile(size, threads))
        # The same for any number of threads.
        if _count(pair[0]) >= _FIRST_MEASUREMENT:
            pair[0].advance_steps(_BEFORE)
        start = pair[0].checkpoint()
        tasks += [partial(_block, simulation, start) for simulation in pair]
        simulations += pair
        scene = pair[0].scene
        rows.append(SizeResult(
            size, scene.body_count, scene.connector_count, pair[1].status.thread_count, [], [], [],
            0.0, 0.0))
    say(f'{rounds} rounds of {len(tasks)} runs')
    total = rounds * len(tasks)
    times = in_rounds(tasks, rounds, lambda done: progress(done, total))
    for simulation in simulations:
        _check(simulation)
    # Gives their memory back before others need it.
    del tasks, simulations, pair, simulation, start
    rows = [row._replace(one=times[2 * k], all=times[2 * k + 1]) for k, row in enumerate(rows)]
    waits = _waits(rows, rounds, say)
    finished = []
    for row, wait in zip(rows, waits):
        say(f'{row.body_count:,} bodies: memory')
        memory = probe.run('memory', row.size)['peak']
        say(f'{row.body_count:,} bodies: memory while recording')
        recording = probe.run('record', row.size)['peak']
        finished.append(row._replace(waits=wait, memory=memory, recording=recording))
    never = {}
    if first_ever:
        say('no kernels on disk')
        with tempfile.TemporaryDirectory(prefix='icofabric_benchmark_') as folder:
            never = probe.run('compile', chosen[0], cache=Path(folder))
    return Scaling(finished, never, rounds)


def _waits(
    rows: list[SizeResult], rounds: int, say: Callable[[str], None]
) -> list[list[dict[str, float]]]:
    """Waiting times of fresh processes, the sizes interleaved."""
    # The kernels must be on disk, also those of a path that this process has not needed.
    probe.run('compile', rows[0].size)
    waits: list[list[dict[str, float]]] = [[] for _ in rows]
    for turn in range(rounds):
        for row, figures in zip(rows, waits):
            if turn == 0 or row.body_count <= _QUICK:
                say(f'{row.body_count:,} bodies: build and compile, process {turn + 1}')
                figures.append(probe.run('compile', row.size))
    return waits


def _compile(size: Size, threads: int) -> Simulation:
    solver = {'method': 'leapfrog', 'step': STEP, 'threads': threads}
    simulation = compile_scene(Scene.from_parameters(scene_parameters(size, solver)))
    simulation.warm_up()
    return simulation


def _block(simulation: Simulation, start: Checkpoint) -> float:
    """Time of a step [s], from the same start each time."""
    count = _count(simulation)

    def prepare() -> None:
        simulation.restore(start)
        simulation.advance_steps(_WARM_UP)

    return timed(prepare, lambda: simulation.advance_steps(count), block=STEPS_BLOCK) / count


def _count(simulation: Simulation) -> int:
    """Steps that are timed."""
    return max(_FEWEST, _BODY_STEPS // simulation.scene.body_count)


def _check(simulation: Simulation) -> None:
    """The motion must be one: finite, its energy in balance, away from the start."""
    now = simulation.snapshot()
    moved = np.abs(now.position - simulation.scene.position).max()
    if not (np.isfinite(now.position).all() and moved > 0.0
            and simulation.balance.worst < simulation.balance.limit):
        raise RuntimeError(f'{simulation.scene.body_count} bodies do not move as they should')
