# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Whether a node ever stands still: started cold, pushed, re-woven, stopped at random moments.

    .venv/bin/python -m icofabric_validation.robustness.standing_still [--stops 50] [--minutes 10]

Each start is a `fabric_node` of `dropped_slab` in a process of its own, the first one with an
empty cache of compiled kernels; it is driven from this process until SIGINT ends it, some of them
before it is ready. The table has the longest silence of the clock and of the diagnostics, the
longest answer of services, and the longest SIGINT. Exit status 1 where a limit is not kept.
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
    Trouble,
)
from icofabric_validation.robustness.soak_judge import Table  # noqa: E402
from icofabric_validation.source_tree import ROOT  # noqa: E402

SCENE = 'dropped_slab'
# What is wanted [s]: of the clock, of diagnostics once a second, of an answer, of the end.
CLOCK_GAP, REPORT_GAP, ANSWER, END = 0.7, 1.6, 0.5, 1.0
LARGEST_PUSH = 1.2  # [N], about the weight of the slab
# Of the starts, those that are stopped before they are ready.
EARLY = 0.2
# The first start compiles, and is given so long [s].
FIRST = 150.0
# Re-weaves: with the same kernels, and with others.
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
    """The longest of some times [s], and what was going on."""

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
    """The longest times between two messages of a topic, which a live node repeats."""

    def __init__(self, longest: Longest, doing: Callable[[], str]) -> None:
        self._longest, self._doing, self.last = longest, doing, 0.0

    def heard(self) -> None:
        now = time.monotonic()
        if self.last:
            self._longest.note(now - self.last, self._doing())
        self.last = now


class Trial:
    """All starts, and what was seen of them."""

    def __init__(self, folder: Path, domain: int, seed: int) -> None:
        self._folder, self._domain, self._random = folder, domain, random.Random(seed)
        self._scene = load_parameter_file(find_scene(SCENE))
        self.clock, self.reports, self.answers, self.ends, self.early_ends = (
            Longest() for _ in range(5))
        self.first_poses, self.tracebacks, self.statuses = Longest(), 0, set[int]()
        self.compiling = 0  # reports that said so

    def run(self, number: int, seconds: float) -> None:
        """One start, of so many seconds."""
        chance = self._random
        early = number > 0 and chance.random() < EARLY
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
        chance, said = self._random, ['']

        def what() -> str:
            return f'{doing[-1]}; {said[0]}'

        clock, reports = Silence(self.clock, what), Silence(self.reports, what)

        def hear_tick(data: bytes) -> None:
            decode_clock(data)
            clock.heard()

        def hear_report(data: bytes) -> None:
            status = decode_diagnostic_array(data)[1][0]
            compiling = dict(status.values)['compiling']
            self.compiling += compiling != 'no'
            said[0] = f'compiling: {compiling}'
            reports.heard()

        process.wait_until_ready()
        ready = time.monotonic()
        graph.listen(CLOCK, hear_tick, depth=5000)
        graph.listen(DIAGNOSTICS, hear_report)
        process.wait_for(lambda: clock.last, 'a tick of the clock')
        self.first_poses.note(clock.last - ready, doing[-1])
        while time.monotonic() < end:
            deed = chance.choice(('push', 'push', 'pause', 'change', 'get', 'wait', 'reset'))
            self._do(deed, graph, doing)
            time.sleep(chance.uniform(0.0, 0.5))

    def _do(self, deed: str, graph: Graph, doing: list[str]) -> None:
        chance = self._random
        doing.append(f'{doing[0]}, {deed}')
        if deed == 'push':
            force = [chance.gauss(0.0, 1.0) for _ in range(3)]
            size = chance.uniform(0.0, LARGEST_PUSH) / sum(part**2 for part in force)**0.5
            graph.publish(f'{NODE}/loads/push', wrench('', tuple(size * part for part in force)))
        elif deed == 'pause':
            for paused in (True, False):
                self.answers.note(graph.call('pause', 'SetBool', data=paused)[1], doing[-1])
        elif deed == 'reset':
            self.answers.note(graph.call('reset')[1], doing[-1])
        elif deed == 'change':
            change = chance.choice(CHANGES)
            doing[-1] += f' {change}'
            # It is answered within a second where it has to be built first, by design.
            graph.set(**change)
        elif deed == 'get':
            self.answers.note(graph.get('connector.stiffness'), doing[-1])
        else:
            time.sleep(chance.uniform(0.0, 1.0))

    def __str__(self) -> str:
        longest = (self.clock, self.reports, self.answers, self.ends, self.early_ends)
        return 'clock {:.2f}, reports {:.2f}, answers {:.2f}, SIGINT {:.2f} and {:.2f} s'.format(
            *(one.seconds for one in longest))

    def judge(self, table: Table) -> None:
        """Write what was seen into the table."""
        table.add('reports that said "compiling"', f'{self.compiling:,}')
        self.clock.add_to(table, 'longest silence of the clock', CLOCK_GAP)
        self.reports.add_to(table, 'longest silence of the diagnostics', REPORT_GAP)
        self.answers.add_to(table, 'longest answer of a service', ANSWER)
        self.ends.add_to(table, 'longest SIGINT while it runs', END)
        self.early_ends.add_to(table, 'longest SIGINT before it is ready', END)
        table.add('tracebacks', str(self.tracebacks), '0', not self.tracebacks)
        table.add(
            'exit statuses', ', '.join(map(str, sorted(self.statuses))), '0, 130',
            self.statuses <= {0, 130})


def main() -> int:
    """Start and stop; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--stops', type=int, default=50)
    parser.add_argument('--minutes', type=float, default=10.0, help='wall time of all')
    parser.add_argument('--first', type=float, default=FIRST, help='of the first start [s]')
    parser.add_argument('--cache', type=Path, help='folder of compiled kernels (default: empty)')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--csv', type=Path, default=ROOT / 'runs' / 'soak' / 'standing_still.csv')
    parser.add_argument('--no-wall-limits', action='store_true', help='judge no wall times')
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
    except Trouble as error:
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
