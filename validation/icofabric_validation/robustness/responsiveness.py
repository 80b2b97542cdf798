# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Longest silences of a node that is started, pushed, re-woven and stopped at random times.

    .venv/bin/python -m icofabric_validation.robustness.responsiveness [--stops 50] [--minutes 10]

Each start is a `fabric_node` of `dropped_slab` in a separate process, the first one with an empty
kernel cache. This process drives the node until SIGINT, sometimes before the node is ready. The
table has the longest silence of the clock and of the diagnostics, the longest answer of services,
and the longest time from SIGINT to the end. The exit status is 1 if a limit is exceeded.
"""

import os

# Read when the message classes are imported, here and in the processes started from here.
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'

import argparse  # noqa: E402, I100 - after the environment that rclpy reads
from collections.abc import Callable  # noqa: E402
from pathlib import Path  # noqa: E402
import random  # noqa: E402
import signal  # noqa: E402
import sys  # noqa: E402
import tempfile  # noqa: E402
import time  # noqa: E402
from typing import Any  # noqa: E402

from icofabric_sim.messages import decode_clock, decode_diagnostic_array  # noqa: E402
from icofabric_sim.parameters.example_scenes import find_scene  # noqa: E402
from icofabric_sim.parameters.file import load_parameter_file  # noqa: E402
from icofabric_validation.benchmarks.machine import describe_machine  # noqa: E402
from icofabric_validation.robustness.soak_drive import wrench  # noqa: E402
from icofabric_validation.robustness.soak_graph import (  # noqa: E402
    CLOCK,
    DIAGNOSTICS,
    FabricProcess,
    free_domain,
    Graph,
    NODE,
    NodeError,
)
from icofabric_validation.robustness.soak_judge import Table  # noqa: E402
from icofabric_validation.source_tree import ROOT  # noqa: E402

SCENE = 'dropped_slab'
# Limits of silences of the clock and diagnostics (one per second), of answers, and of the end.
MAX_CLOCK_GAP_S, MAX_REPORT_GAP_S, MAX_ANSWER_S, MAX_END_S = 0.7, 1.6, 0.5, 1.0
MAX_FORCE_N = 1.2  # about the weight of the slab
# Fraction of starts that are stopped before they are ready.
EARLY_STOP_RATIO = 0.2
# Duration of the first start, which compiles kernels.
FIRST_START_S = 150.0
# Re-weaves with the same kernels and with others.
CHANGES: tuple[dict[str, Any], ...] = (
    {'connector__stiffness': 1500.0},
    {'weave__size': [5, 4, 2]},
    {'gravity': [0.0, 0.0, -3.0]},
    {'solver__tolerance': 1e-4},
    {'shell__density': 900.0},
    {'connector__damping': 1e-3},
    {'contact__friction': 0.3},
    {'drag__linear': 1e-3},
)


class Longest:
    """The longest of several times [s], with the action at that time."""

    def __init__(self) -> None:
        self.seconds, self.what, self.count = 0.0, '', 0

    def note(self, seconds: float, what: str) -> None:
        self.count += 1
        if seconds > self.seconds:
            self.seconds, self.what = seconds, what

    def add_to(self, table: Table, name: str, limit: float) -> None:
        table.add(
            f'{name}, of {self.count:,}', f'{self.seconds:.2f} s', f'{limit:g} s',
            self.seconds <= limit, wall=True)
        if self.what:
            table.details([self.what])


class Silence:
    """The longest times between two messages of a periodic topic."""

    def __init__(self, longest: Longest, doing: Callable[[], str]) -> None:
        self._longest, self._doing, self.last = longest, doing, 0.0

    def heard(self) -> None:
        now = time.monotonic()
        if self.last:
            self._longest.note(now - self.last, self._doing())
        self.last = now


class Trial:
    """All starts, and their results."""

    def __init__(self, folder: Path, domain: int, seed: int) -> None:
        self._folder, self._domain, self._random = folder, domain, random.Random(seed)
        self._scene = load_parameter_file(find_scene(SCENE))
        self.clock, self.reports, self.answers, self.ends, self.early_ends = (
            Longest() for _ in range(5))
        self.first_poses, self.tracebacks, self.statuses = Longest(), 0, set[int]()
        self.compiling = 0  # number of reports of compiling

    def run(self, number: int, seconds: float) -> None:
        """Run one start for `seconds` [s]."""
        chance = self._random
        early = number > 0 and chance.random() < EARLY_STOP_RATIO
        with FabricProcess(
            self._folder / str(number), self._scene, self._domain
        ) as process, Graph(self._domain) as graph:
            doing = [f'start {number}']
            if early:
                time.sleep(chance.uniform(0.1, 1.5))
            else:
                self._live(graph, process, doing, time.monotonic() + seconds)
            status, took = process.stop()
            (self.early_ends if early else self.ends).note(took, doing[-1])
            self.statuses.add(status)
            self.tracebacks += 'Traceback' in process.log()

    def _live(
        self, graph: Graph, process: FabricProcess, doing: list[str], end: float
    ) -> None:
        chance, compiling_text = self._random, ['']

        def what() -> str:
            return f'{doing[-1]}; {compiling_text[0]}'

        clock, reports = Silence(self.clock, what), Silence(self.reports, what)

        def hear_tick(data: bytes) -> None:
            decode_clock(data)
            clock.heard()

        def hear_report(data: bytes) -> None:
            status = decode_diagnostic_array(data)[1][0]
            compiling = dict(status.values)['compiling']
            self.compiling += compiling != 'no'
            compiling_text[0] = f'compiling: {compiling}'
            reports.heard()

        process.wait_until_ready()
        ready = time.monotonic()
        graph.listen(CLOCK, hear_tick, depth=5000)
        graph.listen(DIAGNOSTICS, hear_report)
        process.wait_for(lambda: clock.last, 'a tick of the clock')
        self.first_poses.note(clock.last - ready, doing[-1])
        while time.monotonic() < end:
            action = chance.choice(('push', 'push', 'pause', 'change', 'get', 'wait', 'reset'))
            self._do(action, graph, doing)
            time.sleep(chance.uniform(0.0, 0.5))

    def _do(self, action: str, graph: Graph, doing: list[str]) -> None:
        chance = self._random
        doing.append(f'{doing[0]}, {action}')
        if action == 'push':
            force = [chance.gauss(0.0, 1.0) for _ in range(3)]
            size = chance.uniform(0.0, MAX_FORCE_N) / sum(part**2 for part in force)**0.5
            graph.publish(f'{NODE}/loads/push', wrench('', tuple(size * part for part in force)))
        elif action == 'pause':
            for paused in (True, False):
                self.answers.note(graph.call('pause', 'SetBool', data=paused)[1], doing[-1])
        elif action == 'reset':
            self.answers.note(graph.call('reset')[1], doing[-1])
        elif action == 'change':
            change = chance.choice(CHANGES)
            doing[-1] += f' {change}'
            # Not measured: changes with a new build may take up to a second.
            graph.set(**change)
        elif action == 'get':
            self.answers.note(graph.get('connector.stiffness'), doing[-1])
        else:
            time.sleep(chance.uniform(0.0, 1.0))

    def __str__(self) -> str:
        longest = (self.clock, self.reports, self.answers, self.ends, self.early_ends)
        return 'clock {:.2f}, reports {:.2f}, answers {:.2f}, SIGINT {:.2f} and {:.2f} s'.format(
            *(one.seconds for one in longest))

    def judge(self, table: Table) -> None:
        """Add the results to the table."""
        table.add('reports of compiling', f'{self.compiling:,}')
        self.clock.add_to(table, 'longest silence of the clock', MAX_CLOCK_GAP_S)
        self.reports.add_to(table, 'longest silence of the diagnostics', MAX_REPORT_GAP_S)
        self.answers.add_to(table, 'longest answer of a service', MAX_ANSWER_S)
        self.ends.add_to(table, 'longest time from SIGINT to the end, running', MAX_END_S)
        self.early_ends.add_to(table, 'longest time from SIGINT to the end, not ready', MAX_END_S)
        table.add('tracebacks', str(self.tracebacks), '0', not self.tracebacks)
        table.add(
            'exit statuses', ', '.join(map(str, sorted(self.statuses))), '0, 130',
            self.statuses <= {0, 130})


def main() -> int:
    """Start and stop nodes; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--stops', type=int, default=50)
    parser.add_argument('--minutes', type=float, default=10.0, help='wall time of all starts')
    parser.add_argument(
        '--first', type=float, default=FIRST_START_S, help='of the first start [s]')
    parser.add_argument('--cache', type=Path, help='folder of compiled kernels (default: empty)')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--csv', type=Path, default=ROOT / 'runs' / 'soak' / 'responsiveness.csv')
    parser.add_argument('--no-wall-limits', action='store_true', help='print wall times only')
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(130))
    signal.signal(signal.SIGINT, signal.default_int_handler)
    folder = Path(tempfile.mkdtemp(prefix='icofabric_still_'))
    os.environ['NUMBA_CACHE_DIR'] = str(arguments.cache or folder / 'cache')
    print(f'{describe_machine()}, load {os.getloadavg()[0]:.1f}; logs in {folder}', flush=True)
    table = Table(wall_limits=not arguments.no_wall_limits)
    table.begin('rotate_down still', f'{arguments.stops} stops, seed {arguments.seed}')
    trial = Trial(folder, free_domain(), arguments.seed)
    each = max(60.0 * arguments.minutes - arguments.first, 0.0) / max(arguments.stops - 1, 1)
    try:
        for number in range(arguments.stops):
            trial.run(number, arguments.first if number == 0 else each)
            print(f'  start {number}: so far {trial}', flush=True)
    except NodeError as error:
        table.add('the node', 'in trouble', '', False)
        print(error, file=sys.stderr)
    except (KeyboardInterrupt, SystemExit):
        # What was seen so far is worth a table.
        table.add('ended from outside', f'{number} of {arguments.stops} stops')
    trial.judge(table)
    table.write(arguments.csv)
    print(f'load {os.getloadavg()[0]:.1f}; written to {arguments.csv}')
    return 0 if table.is_good else 1


if __name__ == '__main__':
    sys.exit(main())
