# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Cost of a slider that sets a parameter 50 times a second in a node at full speed.

    .venv/bin/python -m icofabric_validation.robustness.parameter_slider [--seconds 6] [--rounds 3]

Rounds with and without the slider alternate. The speed is simulated time over wall time, and over
the processor time of the thread of the run, which is the cost if cores are free. Lines of the log
are counted. The exit status is 1 if a limit is exceeded.
"""

import os

# Read when the message classes are imported, here and in the processes started from here.
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'

import argparse  # noqa: E402, I100 - after the environment that rclpy reads
from contextlib import suppress  # noqa: E402
from pathlib import Path  # noqa: E402
import statistics  # noqa: E402
import sys  # noqa: E402
import tempfile  # noqa: E402
import time  # noqa: E402
from typing import Any  # noqa: E402

from icofabric_sim.parameters.example_scenes import find_scene  # noqa: E402
from icofabric_sim.parameters.file import load_parameter_file  # noqa: E402
from icofabric_validation.benchmarks.machine import describe_machine  # noqa: E402
from icofabric_validation.robustness.soak_graph import (  # noqa: E402
    FabricProcess,
    free_domain,
    Graph,
    Watch,
    watched_node,
)
from icofabric_validation.robustness.soak_judge import Table  # noqa: E402
from icofabric_validation.source_tree import ROOT  # noqa: E402

SCENE = 'hanging_slab'
RATE_HZ = 50.0
# Limits: loss of speed, and lines of the log per second.
MAX_COST_RATIO, MAX_LINES_PER_S = 0.05, 1.2
# Parameter, and function from the number of a change to the value. Values are so close that the
# motion hardly changes.
SLIDERS: dict[str, Any] = {
    'connector__stiffness': lambda k: 1990.0 + 1e-3 * (k % 50),
    'gravity': lambda k: [0.0, 1e-6 * (k % 50), -9.81],
    'connector__damping': lambda k: 1e-4 * (1.0 + 1e-4 * (k % 50)),
    'loads__tip__force': lambda k: [0.0, 1e-7 * (k % 50), 0.0],
    'solver__tolerance': lambda k: 1e-6 * (1.0 + 1e-4 * (k % 50)),
}


def measure(
    graph: Graph, watch: Watch, thread: str, seconds: float, slider: str | None
) -> tuple[float, float, float, int, float, float]:
    """
    Measure with or without a slider for `seconds` [s].

    Returns simulated time over wall time and over processor time, lines of the log per second,
    number of changes, longest answer [s], and processor time of the thread of the run [s].
    """
    process = watch.process
    lines, first, began, used = process.log().count('\n'), watch.now, time.monotonic(), cpu_times(
        process)[thread]
    count, longest = 0, 0.0
    while (passed := time.monotonic() - began) < seconds:
        if slider is None:
            time.sleep(0.02)
            continue
        results, took = graph.set(**{slider: SLIDERS[slider](count)})
        assert all(result.successful for result in results), results
        count, longest = count + 1, max(longest, took)
        time.sleep(max(0.0, count / RATE_HZ - (time.monotonic() - began)))
    simulated, used = (watch.now - first) * 1e-9, max(cpu_times(process)[thread] - used, 1e-9)
    return (
        simulated / passed, simulated / used, (process.log().count('\n') - lines) / passed, count,
        longest, used)


def cpu_times(process: FabricProcess) -> dict[str, float]:
    """Return the processor time [s] of each thread."""
    times = {}
    for task in Path(f'/proc/{process.process.pid}/task').iterdir():
        with suppress(FileNotFoundError, ProcessLookupError):  # a thread that has just ended
            times[task.name] = int((task / 'schedstat').read_text().split()[0]) * 1e-9
    return times


def find_run(process: FabricProcess) -> str:
    """Return the thread of the run: the busiest thread of an idle node."""
    before = cpu_times(process)
    time.sleep(1.0)
    after = cpu_times(process)
    return max(after, key=lambda thread: after[thread] - before.get(thread, 0.0))


def main() -> int:
    """Measure the sliders; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--seconds', type=float, default=6.0)
    parser.add_argument('--rounds', type=int, default=3)
    parser.add_argument(
        '--csv', type=Path, default=ROOT / 'runs' / 'soak' / 'parameter_slider.csv')
    parser.add_argument('--no-wall-limits', action='store_true', help='print wall times only')
    arguments = parser.parse_args()
    print(f'{describe_machine()}, load {os.getloadavg()[0]:.1f}', flush=True)
    table = Table(wall_limits=not arguments.no_wall_limits)
    folder, domain = Path(tempfile.mkdtemp(prefix='icofabric_slider_')), free_domain()
    scene = {**load_parameter_file(find_scene(SCENE)), 'connector.damping': 1e-4}
    with watched_node(folder, scene, domain, real_time_factor=0.0) as (process, graph, watch):
        thread = find_run(process)
        for slider in SLIDERS:
            table.begin(slider.replace('__', '.'), f'{arguments.rounds} rounds')
            for _ in range(2):
                # The first changes may have to load kernels.
                graph.set(**{slider: SLIDERS[slider](49)})
            rounds = [
                (measure(graph, watch, thread, arguments.seconds, None),
                 measure(graph, watch, thread, arguments.seconds, slider))
                for _ in range(arguments.rounds)]
            for name, place in (('by wall time', 0), ('by its thread', 1)):
                cost = statistics.median(1.0 - on[place] / off[place] for off, on in rounds)
                table.add(
                    f'cost {name}', f'{cost:.1%}', f'{MAX_COST_RATIO:.0%}',
                    cost < MAX_COST_RATIO, wall=True)
            each = statistics.median(
                (1.0 - on[1] / off[1]) * on[5] / max(on[3], 1) for off, on in rounds)
            table.add('time of its thread for a change', f'{each * 1e3:.1f} ms')
            lines = max(on[2] for _, on in rounds)
            table.add('lines a second', f'{lines:.2f}', f'{MAX_LINES_PER_S:g}',
                      lines <= MAX_LINES_PER_S)
            changes = sum(on[3] for _, on in rounds) / (arguments.rounds * arguments.seconds)
            table.add('changes a second', f'{changes:.1f}')
            table.add('longest answer', f'{max(on[4] for _, on in rounds):.3f} s')
        process.stop()
    table.write(arguments.csv)
    return 0 if table.is_good else 1


if __name__ == '__main__':
    sys.exit(main())
