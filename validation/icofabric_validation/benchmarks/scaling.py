# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Growth of time, memory and waiting with the number of bodies, and gain of threads."""

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
from icofabric_validation.benchmarks.timing import in_rounds, Spread, STEPS_BLOCK_S, timed
import numpy as np

Size = tuple[int, int, int]
# 63, 1,014, 4,631, 10,206, 49,726 and 100,920 bodies.
SIZES: tuple[Size, ...] = (
    (5, 5, 5), (12, 13, 13), (21, 21, 21), (27, 27, 28), (46, 46, 47), (58, 58, 60))
MAX_BODIES = 101_000
# Size for comparison, about 10,000 bodies.
UNIT: Size = (27, 27, 28)
# Bodies times steps of a timed run, smallest number of steps, and steps before, which fill the
# cache and start the threads.
_BODY_STEPS, _MIN_STEPS, _WARM_UP = 2_000_000, 10, 2
# Health checks measure errors of steps from step 128 on, less and less often; a measurement takes
# as long as some dozen steps. Longer timed runs start after the second number of steps.
_FIRST_MEASUREMENT, _BEFORE = 128, 1_250
# Largest number of bodies for which waiting is measured in one process per round, else in one.
_MAX_REPEATED_BODIES = 12_000


class SizeResult(NamedTuple):
    """Results of one number of bodies; lists have one value for each round."""

    size: Size
    body_count: int
    connector_count: int
    threads: int  # number that `solver.threads: 0` selects
    one: list[float]  # time of a plain step [s], one thread
    all: list[float]  # the same with the selected number of threads
    waits: list[dict[str, float]]  # [s], see probe.measure
    memory: float  # peak resident [bytes] above the interpreter's own
    recording: float  # the same while a bag is recorded

    def per_body(self, times: list[float]) -> Spread:
        """Return the time per body and step [ns]."""
        return Spread.of([value * 1e9 / self.body_count for value in times])

    def gain(self) -> Spread:
        """Speed-up by threads, round by round."""
        return Spread.of([alone / shared for alone, shared in zip(self.one, self.all)])

    def wait(self, name: str) -> float:
        """Return the median [s] over the processes."""
        return statistics.median(wait[name] for wait in self.waits)


class Scaling(NamedTuple):
    """All sizes, from few bodies to many."""

    rows: list[SizeResult]
    first_ever: dict[str, float]  # [s] with no kernels on disk; empty: not measured
    rounds: int

    def relative(self, row: SizeResult, *, threads: bool) -> Spread | None:
        """Return the time per body and step over that of UNIT, round by round."""
        unit = next((other for other in self.rows if other.size == UNIT), None)
        if unit is None:
            return None
        own, its = (row.all, unit.all) if threads else (row.one, unit.one)
        return Spread.of([
            mine / row.body_count / (theirs / unit.body_count) for mine, theirs in zip(own, its)])


def sizes_up_to(largest: int) -> list[Size]:
    """Return SIZES with at most `largest` bodies, and a cube of `largest` above them."""
    chosen = [size for size in SIZES if -(-size[0] * size[1] * size[2] // 2) <= largest]
    if largest > MAX_BODIES:
        # Every second grid position has a body.
        side = round((2.0 * largest)**(1.0 / 3.0))
        chosen.append((side, side, side))
    return chosen


def measure(
    *, rounds: int = 5, largest: int = MAX_BODIES, sizes: Sequence[Size] | None = None,
    first_ever: bool = True, say: Callable[[str], None] = lambda text: None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Scaling:
    """Time plain steps of all sizes in rounds; then waiting and memory, in fresh processes."""
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
    times = in_rounds(tasks, rounds, progress)
    for simulation in simulations:
        _check(simulation)
    # Release memory before the next measurements.
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
    """Return waiting times of fresh processes, with interleaved sizes."""
    # All kernels must be on disk, also those that this process has not used.
    probe.run('compile', rows[0].size)
    waits: list[list[dict[str, float]]] = [[] for _ in rows]
    for turn in range(rounds):
        for row, figures in zip(rows, waits):
            if turn == 0 or row.body_count <= _MAX_REPEATED_BODIES:
                say(f'{row.body_count:,} bodies: build and compile, process {turn + 1}')
                figures.append(probe.run('compile', row.size))
    return waits


def _compile(size: Size, threads: int) -> Simulation:
    solver = {'method': 'leapfrog', 'step': STEP, 'threads': threads}
    simulation = compile_scene(Scene.from_parameters(scene_parameters(size, solver)))
    simulation.warm_up()
    return simulation


def _block(simulation: Simulation, start: Checkpoint) -> float:
    """Return the time of a step [s], from the same start each time."""
    count = _count(simulation)

    def prepare() -> None:
        simulation.restore(start)
        simulation.advance_steps(_WARM_UP)

    return timed(prepare, lambda: simulation.advance_steps(count), block=STEPS_BLOCK_S) / count


def _count(simulation: Simulation) -> int:
    """Return the number of timed steps."""
    return max(_MIN_STEPS, _BODY_STEPS // simulation.scene.body_count)


def _check(simulation: Simulation) -> None:
    """Raise RuntimeError unless the motion is finite and balanced, and has left the start."""
    now = simulation.snapshot()
    moved = np.abs(now.position - simulation.scene.position).max()
    if not (np.isfinite(now.position).all() and moved > 0.0
            and simulation.balance.worst < simulation.balance.limit):
        raise RuntimeError(f'{simulation.scene.body_count} bodies do not move as they should')
