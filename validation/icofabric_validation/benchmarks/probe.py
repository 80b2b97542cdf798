# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Measurements that need a fresh process: first calls, and peaks of memory.

`run` starts this module in a separate process, which prints its results as JSON.
"""

from collections.abc import Callable, Sequence
import json
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time
from typing import Any

Size = tuple[int, int, int]
_WARM_UP_SIZE: Size = (5, 5, 5)
# Simulated time [s] of a recorded run, and rate [Hz] of its messages: four of each kind.
_RECORDED, _RATE = 0.003, 1000.0
_STEPS = 5


def run(kind: str, size: Size, *, cache: Path | None = None) -> dict[str, float]:
    """
    Return results of a fresh interpreter; `cache` is another folder of its kernel cache.

    Raises RuntimeError with the last output if the process fails.
    """
    environment = dict(os.environ)
    if cache is not None:
        environment['NUMBA_CACHE_DIR'] = str(cache)
    done = subprocess.run(
        [sys.executable, '-W', 'ignore', '-m', 'icofabric_validation.benchmarks.probe', kind,
         *map(str, size)], env=environment, capture_output=True, text=True)
    if done.returncode != 0:
        raise RuntimeError((done.stderr.strip().splitlines() or ['no words'])[-1])
    figures: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return figures


def resident(key: str) -> int:
    """
    Return the resident memory [bytes] of this process: now ('VmRSS'), or the peak ('VmHWM').

    The peak of getrusage would include that of the parent process.
    """
    for line in Path('/proc/self/status').read_text(encoding='ascii').splitlines():
        if line.startswith(key + ':'):
            return int(line.split()[1]) * 1024
    raise OSError(f'/proc/self/status has no {key}')


def forget_peak() -> None:
    """Reset the peak to the current resident memory, if the system supports this."""
    try:
        Path('/proc/self/clear_refs').write_text('5', encoding='ascii')
    except OSError:
        pass


def measure(kind: str, size: Size) -> dict[str, float]:
    """Return results of this process, which has done nothing else before."""
    marks = [time.perf_counter()]
    # The time of `import` for a user.
    import icofabric_sim as ico
    assert ico.Scene is not None and ico.compile_scene is not None
    marks.append(time.perf_counter())
    if kind == 'compile':
        scene = _scene(size)
        marks.append(time.perf_counter())
        simulation = ico.compile_scene(scene)
        marks.append(time.perf_counter())
        simulation.warm_up()
        simulation.advance_steps(1)
        marks.append(time.perf_counter())
        scene = _scene(size)
        marks.append(time.perf_counter())
        ico.compile_scene(scene)
        marks.append(time.perf_counter())
        names = ('import', 'build_first', 'compile_first', 'step_first', 'build', 'compile')
        return dict(zip(names, (late - early for early, late in zip(marks, marks[1:]))))
    work: Callable[[Size], Any] = {'memory': _step, 'record': _record}[kind]
    # Load kernels and libraries before the memory of the scene is measured.
    work(_WARM_UP_SIZE)
    before = resident('VmRSS')
    forget_peak()
    result = work(size)
    peak = resident('VmHWM') - before
    moved = abs(result.snapshot().position - result.scene.position).max()
    assert moved > 0.0, 'nothing has moved'
    return {'peak': float(peak)}


def _scene(size: Size, **changes: Any) -> Any:
    from icofabric_sim.scene.scene import Scene
    from icofabric_validation.benchmarks.scenes import scene_parameters
    return Scene.from_parameters({**scene_parameters(size), **changes})


def _step(size: Size) -> Any:
    from icofabric_sim.simulation.simulation import compile_scene
    simulation = compile_scene(_scene(size))
    simulation.advance_steps(_STEPS)
    return simulation


def _record(size: Size) -> Any:
    """Record poses and connectors at full speed, as `icofabric run` without a companion."""
    from icofabric_sim.running.recording import BagSink
    from icofabric_sim.running.runner import Runner
    from icofabric_sim.simulation.simulation import compile_scene
    simulation = compile_scene(_scene(
        size, duration=_RECORDED, real_time_factor=0.0, publish_rate=_RATE, marker_rate=_RATE))
    with tempfile.TemporaryDirectory(prefix='icofabric_benchmark_') as folder:
        bag = BagSink(Path(folder) / 'bag', simulation, storage='mcap', live=False)
        runner = Runner(simulation, [bag])
        runner.run(until_finished=True)
        bag.close()
        if runner.failure or bag.error is not None:
            raise RuntimeError(runner.failure or str(bag.error))
    return simulation


def main(words: Sequence[str]) -> None:
    """Measure and print."""
    kind, x, y, z = words
    print(json.dumps(measure(kind, (int(x), int(y), int(z)))))


if __name__ == '__main__':
    main(sys.argv[1:])
