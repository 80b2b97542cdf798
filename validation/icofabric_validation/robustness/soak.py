# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Long runs of the node over Fast DDS under load, judged by the limits of docs/reliability.md.

    .venv/bin/python -m icofabric_validation.robustness.soak [--part all] [--minutes 30]

Parts: soak, verify60, kills, latency, slow-subscriber, dying-subscribers, all.

Each part has a `fabric_node` in a separate process, driven from this one. The table of results and
limits is written as CSV (--csv). The exit status is 1 if a limit is exceeded.
"""

import os

# Read when the message classes are imported, here and in the processes started from here.
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'

import argparse  # noqa: E402 - after the environment that rclpy reads
from collections.abc import Callable, Iterator  # noqa: E402
from contextlib import contextmanager  # noqa: E402
from functools import partial  # noqa: E402
from pathlib import Path  # noqa: E402
import random  # noqa: E402
import shutil  # noqa: E402
import signal  # noqa: E402
import statistics  # noqa: E402
import subprocess  # noqa: E402
import sys  # noqa: E402
import tempfile  # noqa: E402
import time  # noqa: E402
from typing import NamedTuple  # noqa: E402

from icofabric_sim.commands.report import write_csv  # noqa: E402
from icofabric_sim.messages import ERROR  # noqa: E402
from icofabric_validation.benchmarks.machine import describe_machine  # noqa: E402
from icofabric_validation.robustness.soak_drive import Driver, SCENE  # noqa: E402
from icofabric_validation.robustness.soak_graph import (  # noqa: E402
    environment,
    FabricProcess,
    free_domain,
    Graph,
    NODE,
    NodeError,
    Watch,
    watched_node,
)
from icofabric_validation.robustness.soak_judge import (  # noqa: E402
    check_bag,
    clock_faults,
    clock_moments,
    measure_real_time_factor,
    slope,
    Table,
)
from icofabric_validation.source_tree import ROOT  # noqa: E402

LISTENER = 'icofabric_validation.benchmarks.listener'
CLOCK_RATE = 100.0
POSES = f'{NODE}/poses', 'geometry_msgs/msg/PoseArray'
MARKERS = f'{NODE}/connectors', 'visualization_msgs/msg/Marker'
# Limits of memory growth: rate [MB in 10 minutes], and total [MB] of a long and a short run.
# Random actions load kernels of 1 to 2 MB at first use, which dominates in a short run.
MAX_MEMORY_RATE_MB, MAX_MEMORY_GROWTH_MB, MAX_SHORT_MEMORY_GROWTH_MB = 5.0, 8.0, 25.0
MAX_DRIFT_RATIO = 0.01  # of the real-time factor, between the halves of a run
MAX_START_S, MAX_STOP_S = 1.5, 1.0
MAX_GAP_S = 1.0  # between messages for healthy subscribers
_MIN_FACTOR_RATIO = 0.95  # real-time factor with a stopped subscriber over that with a running one
TEN_MINUTES_S = 600.0


class Setting(NamedTuple):
    """The common arguments of all parts."""

    folder: Path
    domain: int
    arguments: argparse.Namespace
    table: Table


def soak(setting: Setting) -> None:
    """Run random valid and invalid actions of a client for `--minutes`."""
    arguments, table = setting.arguments, setting.table
    table.begin('soak', f'{arguments.minutes:g} minutes at random, seed {arguments.seed}')
    bag = setting.folder / 'bag'
    with watched_node(
        setting.folder, SCENE, setting.domain, record__path=bag
    ) as (process, graph, watch):
        heard = [0]
        for topic in (POSES, MARKERS):
            graph.listen(topic, lambda data: heard.__setitem__(0, heard[0] + 1))
        driver = Driver(graph, watch, random.Random(arguments.seed))
        if arguments.minutes > 1.0:
            driver.fill_queues()
        end = time.monotonic() + 60.0 * arguments.minutes
        driver.drive(lambda: time.monotonic() > end)
        dropped = driver.finish()
        status, took = process.stop()
    _judge_actions(table, driver, watch)
    _judge_end(table, process, status, took)
    _judge_memory(table, watch, setting.arguments.csv.with_suffix('.memory.csv'))
    _judge_clock(table, watch)
    acted = _judge_bags(table, bag, arguments.threads)
    rest = driver.sent - driver.displaced - acted - dropped
    table.add('wrenches sent', f'{driver.sent:,}')
    table.add('  in bursts, displaced in the queue',
              f'{driver.burst_count:,}, {driver.displaced:,}')
    table.add('  acted, dropped', f'{acted:,}, {dropped:,}')
    table.add('  unaccounted for', f'{rest:,}', '0', rest == 0)


def verify60(setting: Setting) -> None:
    """Record a driven run in one bag, and verify it with one and two threads."""
    arguments, table = setting.arguments, setting.table
    table.begin('verify60', f'{arguments.seconds:g} s of simulated time, seed {arguments.seed}')
    bag = setting.folder / 'bag'
    with watched_node(
        setting.folder, SCENE, setting.domain, record__path=bag, solver__threads=2
    ) as (process, graph, watch):
        driver = Driver(graph, watch, random.Random(arguments.seed))
        end = round(arguments.seconds * 1e9)
        driver.drive(lambda: watch.now > end, frozenset(
            {'push', 'push_ahead', 'reweave', 'retune', 'pause_and_step', 'save'}))
        driver.settle()
        status, took = process.stop()
    _judge_actions(table, driver, watch)
    _judge_end(table, process, status, took)
    for threads in (1, 2):
        check = check_bag(bag, CLOCK_RATE, threads=threads)
        table.add(f'verify --threads {threads}', check.verdict[:26], 'identical', check.is_good)
        table.details([*check.clock, *([] if check.is_good else [check.verdict])])
    table.add('simulated time in the bag', f'{(check.end - check.begin) / 1e9:.2f} s', '',
              check.end - check.begin >= end)
    for name, least in (('re-weaves', 1), ('~/checkpoint', 1), ('~/poses', 60)):
        count = sum(value for key, value in check.counts.items() if key.startswith(name))
        table.add(f'  {name} in it', f'{count:,}', f'at least {least}', count >= least)
    table.add('  wrenches in it', f'{check.inputs:,}', 'at least 20', check.inputs >= 20)


def kills(setting: Setting) -> None:
    """Run kill_recovery.py."""
    table = setting.table
    table.begin('kills', 'kill -9 of recordings, see kill_recovery.py')
    command = [sys.executable, '-m', 'icofabric_validation.robustness.kill_recovery', '--kills',
               str(setting.arguments.kills), '--seed', str(setting.arguments.seed)]
    done = subprocess.run(
        command, text=True, stdout=subprocess.PIPE, env=environment(setting.domain))
    print(done.stdout)
    last = done.stdout.splitlines()[-1]
    table.add('lost wall time', last.split(';')[0].removeprefix('lost at most '), '', None)
    table.add('recordings saved whole', last.split('; ')[-1].split(' good')[0], 'all',
              done.returncode == 0, wall=True)


def _note_time(times: list[float], data: bytes) -> None:
    times.append(time.monotonic())


def latency(setting: Setting) -> None:
    """Measure start, end, parameter access during a large re-weave, and services."""
    table, count = setting.table, setting.arguments.starts
    table.begin('latency', f'{count} starts and ends')
    starts: list[float] = []
    ends: dict[signal.Signals, list[float]] = {signal.SIGINT: [], signal.SIGTERM: []}
    with Graph(setting.domain) as graph:
        for number in range(count + 1):
            first: list[float] = []
            poses = graph.listen(POSES, partial(_note_time, first))
            folder = setting.folder / f'start_{number}'
            with FabricProcess(
                folder, SCENE, setting.domain, record__path=folder / 'bag'
            ) as process:
                process.wait_for(first.copy, 'poses', pause=0.001)
                time.sleep(0.5)
                graph.forget(poses)
                signals = list(ends)
                status, took = process.stop(signals[number % 2])
            if number:  # the first fills caches
                starts.append(first[0] - process.started)
            ends[signals[number % 2]].append(took)
            if status or not (folder / 'bag' / 'metadata.yaml').is_file():
                table.add(f'start {number}', f'exit status {status}', '0, bag closed', False)
            if 'Traceback' in process.log():
                table.add(f'start {number}', 'traceback', 'none', False)
    table.add('start to first poses, median', _text(statistics.median(starts)),
              f'{MAX_START_S:g} s', statistics.median(starts) <= MAX_START_S, wall=True)
    table.add('start to first poses, worst', _text(max(starts)))
    for number, times in ends.items():
        table.add(f'{number.name} to exit, worst', _text(max(times)), f'{MAX_STOP_S:g} s',
                  max(times) <= MAX_STOP_S, wall=True)
    _large_reweave(setting)
    _services(setting)


def _large_reweave(setting: Setting) -> None:
    """Re-weave a large fabric while parameters are read and set, and stop during another one."""
    table, size = setting.table, list(setting.arguments.large)
    scene = {
        'weave': {'size': [5, 5, 5]}, 'connector': {'stiffness': 1.0},
        'contact': {'mode': 'never'},
        'initial_random': {'velocity_sigma': 0.05, 'spin_sigma': 2.0, 'seed': 1},
        'solver': {'method': 'leapfrog', 'step': 0.005}, 'publish_rate': 10.0,
        'marker_rate': 1.0, 'real_time_factor': 0.2}
    with watched_node(setting.folder / 'large', scene, setting.domain) as (
            process, graph, watch):
        gets: list[float] = []
        sets: list[float] = []
        builds, gaps = [], []
        for _ in range(2):
            first, began = len(watch.events), time.monotonic()
            tick = len(watch.ticks)
            graph.set(weave__size=size)
            # Sequential round trips until the fabric is built.
            while not any(event['event'] == 'reweave' for event in watch.events[first:]):
                gets.append(graph.get('weave.size', 'publish_rate'))
                sets.append(graph.set(input_horizon=1.0 + len(sets) * 1e-3)[1])
                time.sleep(0.01)
                if time.monotonic() - began > 300.0:
                    raise NodeError(f'no re-weave within 300 s:\n{process.log()[-3000:]}')
            builds.append(time.monotonic() - began)
            walls = [wall for wall, _ in watch.ticks[tick:]]
            gaps.append(max(b - a for a, b in zip(walls, walls[1:])))
            first = len(watch.events)
            graph.set(weave__size=[5, 5, 5])
            watch.next_event('reweave', first)
        graph.set(weave__size=size)
        time.sleep(0.3 * min(builds))
        status, took = process.stop()
    table.add('re-weave of the large fabric', ', '.join(map(_text, builds)))
    table.add('  get_parameters meanwhile, median, worst', _median_and_worst(gets))
    table.add('  set_parameters meanwhile, median, worst', _median_and_worst(sets))
    table.add('  longest time between two ticks', _text(max(gaps)))
    table.add('  SIGINT meanwhile to exit', _text(took), f'{MAX_STOP_S:g} s', took <= MAX_STOP_S,
              wall=True)
    table.add('  exit status', str(status), '0', status == 0)


def _services(setting: Setting) -> None:
    table, folder = setting.table, setting.folder / 'services'
    with FabricProcess(
        folder, SCENE, setting.domain, record__path=folder / 'bag'
    ) as process, Graph(setting.domain) as graph:
        process.wait_until_ready()
        times: dict[str, list[float]] = {}
        for _ in range(20):
            for service, fields in (
                ('get_parameters', None), ('pause', {'data': True}), ('step', {}),
                ('pause', {'data': False}), ('reset', {}), ('save_checkpoint', {}),
                ('restore_checkpoint', {}), ('record', {'data': True}),
            ):
                if fields is None:
                    took = graph.get('weave.size')
                else:
                    kind = 'SetBool' if fields else 'Trigger'
                    answer, took = graph.call(service, kind, **fields)
                    if not answer.success:
                        table.add(f'~/{service}', answer.message[:26], '', False)
                times.setdefault(service, []).append(took)
        process.stop()
    for service, found in times.items():
        table.add(f'~/{service} to its answer, median, worst', _median_and_worst(found))


def slow_subscriber(setting: Setting) -> None:
    """Measure the real-time factor with a reliable subscriber that is stopped by SIGSTOP."""
    table, watched = setting.table, setting.arguments.watched
    table.begin('slow-subscriber', f'10,206 bodies, {watched:g} s each, target real-time factor '
                f'{setting.arguments.factor:g}')
    scene = {
        'weave': {'size': [27, 27, 28]}, 'connector': {'stiffness': 20.0},
        'contact': {'mode': 'never'},
        'initial_random': {'velocity_sigma': 0.05, 'spin_sigma': 2.0, 'seed': 1},
        'solver': {'method': 'leapfrog', 'step': 1e-3, 'threads': 1},
        'real_time_factor': setting.arguments.factor}
    with watched_node(setting.folder, scene, setting.domain) as (process, _, watch):
        alone = _factor(watch, watched)
        with _subscriber(setting.domain) as listener:
            heard = _factor(watch, watched)
            listener.send_signal(signal.SIGSTOP)
            before = int(watch.figures['messages not taken in time'])
            stopped = _factor(watch, watched)
            again = _factor(watch, watched)
            displaced = int(watch.figures['messages not taken in time']) - before
        status, took = process.stop()
    table.add('real-time factor without a subscriber', f'{alone:.3f}')
    table.add('  with a running subscriber', f'{heard:.3f}')
    least = _MIN_FACTOR_RATIO * heard
    table.add('  with the same subscriber stopped', f'{stopped:.3f}, then {again:.3f}',
              f'at least {least:.3f} on average',
              stopped + again >= 2.0 * least, wall=True)
    table.add('  messages counted as not taken', f'{displaced:,}', 'some', displaced > 0)
    _judge_end(table, process, status, took)


def dying_subscribers(setting: Setting) -> None:
    """Kill reliable subscribers one after another, and measure gaps for a healthy one."""
    table, arguments = setting.table, setting.arguments
    table.begin('dying-subscribers', f'1,014 bodies, {arguments.kills} subscribers')
    scene = {
        'weave': {'size': [13, 13, 12]}, 'contact': {'mode': 'never'},
        'initial_random': {'velocity_sigma': 0.001},
        'solver': {'method': 'leapfrog', 'step': 4e-4}, 'real_time_factor': 0.5}
    with watched_node(setting.folder, scene, setting.domain) as (process, _, watch):
        _factor(watch, 1.0)
        first = len(watch.ticks)
        for _ in range(arguments.kills):
            with _subscriber(setting.domain):
                time.sleep(1.0)
        time.sleep(3.0)
        walls = [wall for wall, _ in watch.ticks[first:]]
        gaps = sorted(late - early for early, late in zip(walls, walls[1:]))
        status, took = process.stop()
    table.add('longest time between two ticks for the healthy one', _text(gaps[-1]),
              f'{MAX_GAP_S:g} s', gaps[-1] <= MAX_GAP_S, wall=True)
    table.add('  of 1,000 the longest', _text(gaps[-1 - len(gaps) // 1000]))
    _judge_end(table, process, status, took)


@contextmanager
def _subscriber(domain: int) -> Iterator['subprocess.Popen[str]']:
    """Run a subscriber of poses and markers in another process, and kill it at the end."""
    with subprocess.Popen(
        [sys.executable, '-m', LISTENER, *POSES, *MARKERS],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment(domain),
    ) as listener:
        try:
            assert listener.stdin is not None and listener.stdout is not None
            print('listen', file=listener.stdin, flush=True)
            listener.stdout.readline()
            yield listener
        finally:
            listener.kill()


def _factor(watch: Watch, duration: float) -> float:
    """Return simulated over wall time in an interval of `duration` [s], after a pause."""
    time.sleep(2.0)
    first = watch.ticks[-1]
    time.sleep(duration)
    last = watch.ticks[-1]
    return (last[1] - first[1]) / 1e9 / (last[0] - first[0])


def _judge_actions(table: Table, driver: Driver, watch: Watch) -> None:
    actions = sum(count for name, count in driver.done.items() if ',' not in name)
    table.add('done', f'{actions:,} actions')
    table.details([', '.join(f'{name} {count}' for name, count in sorted(driver.done.items()))])
    table.add('unexpectedly refused or accepted', str(len(driver.problems)), '0',
              not driver.problems)
    table.details(driver.problems)
    errors = sorted({status.message for _, status in watch.reports if status.level == ERROR})
    table.add('reports of ERROR', str(len(errors)))
    table.details(errors)


def _judge_end(table: Table, process: FabricProcess, status: int, took: float) -> None:
    table.add('exit status', str(status), '0', status == 0)
    table.add('SIGINT to exit', _text(took), f'{MAX_STOP_S:g} s', took <= MAX_STOP_S, wall=True)
    log = process.log()
    table.add('tracebacks', str(log.count('Traceback')), '0', 'Traceback' not in log)
    table.add('lines in the log', f'{len(log.splitlines()):,}')


def _judge_memory(table: Table, watch: Watch, path: Path) -> None:
    resource_uses = watch.resource_uses
    times = [use.wall for use in resource_uses]
    memory = [use.memory for use in resource_uses]
    rise = slope(times, memory)
    half = 0.5 * (times[-1] - times[0])
    floor = MAX_MEMORY_GROWTH_MB if half > 0.5 * TEN_MINUTES_S else MAX_SHORT_MEMORY_GROWTH_MB
    table.add('memory at start, middle, end',
              ' '.join(f'{memory[place]:.0f}' for place in (0, len(memory) // 2, -1)) + ' MB')
    table.add('  rise over the second half', f'{TEN_MINUTES_S * rise:+.1f} MB in 10 min',
              f'{MAX_MEMORY_RATE_MB:g}, or {floor:g} in total',
              TEN_MINUTES_S * rise <= MAX_MEMORY_RATE_MB or rise * half <= floor)
    # Numbers of threads and files vary with bags and re-weaves.
    for name, values in (('threads', [use.threads for use in resource_uses]),
                         ('open files', [use.files for use in resource_uses])):
        quarter = max(len(values) // 4, 1)
        early, late = (statistics.median(part) for part in
                       (values[quarter:2 * quarter] or values, values[-quarter:]))
        table.add(f'{name}, median early and late', f'{early:g}, {late:g}', '+4',
                  late <= early + 4)
    write_csv(path, ('wall [s]', 'memory [MB]', 'threads', 'files'), (
        [f'{use.wall - times[0]:.1f}', f'{use.memory:.1f}', *use[2:]] for use in resource_uses))


def _judge_clock(table: Table, watch: Watch) -> None:
    moments = clock_moments(
        ((event['event'], event['time'], event) for event in watch.events), watch.ticks[0][1])
    faults = clock_faults([stamp for _, stamp in watch.ticks], moments, CLOCK_RATE)
    table.add('ticks of /clock received', f'{len(watch.ticks):,}')
    table.add('  missing, doubled or off the grid', str(len(faults)), '0', not faults)
    table.details(faults)
    speed = measure_real_time_factor(watch.ticks, moments, CLOCK_RATE)
    table.add('real-time factor, both halves', f'{speed.first:.4f}, {speed.second:.4f}',
              f'drift {MAX_DRIFT_RATIO:g}', abs(speed.drift) <= MAX_DRIFT_RATIO, wall=True)
    table.add('longest time between two ticks', _text(speed.longest))


def _judge_bags(table: Table, bag: Path, threads: int) -> int:
    """Check the bags, and return the number of wrenches that acted."""
    paths = sorted(path for path in bag.parent.glob('bag*') if not path.name.endswith('points'))
    open_ones = [path for path in paths if not (path / 'metadata.yaml').is_file()]
    checks = [check_bag(path, CLOCK_RATE, threads=threads) for path in paths]
    table.add('bags, not closed', f'{len(paths)}, {len(open_ones)}', '0 not closed',
              bool(paths) and not open_ones)
    bad = [check for check in checks if check.verdict != 'identical']
    span = sum(check.end - check.begin for check in checks) / 1e9
    table.add('  verify identical', f'{len(checks) - len(bad)}, {span:.0f} s in total', 'all',
              not bad)
    table.details([f'{check.path.name}: {check.verdict}' for check in bad])
    faults = [f'{check.path.name}: {fault}' for check in checks for fault in check.clock]
    table.add('  ticks missing, doubled or off the grid', str(len(faults)), '0', not faults)
    table.details(faults)
    return sum(check.inputs for check in checks)


def _text(seconds: float) -> str:
    return f'{seconds:.2f} s' if seconds >= 0.1 else f'{1e3 * seconds:.1f} ms'


def _median_and_worst(times: list[float]) -> str:
    return f'{_text(statistics.median(times))}, {_text(max(times))} of {len(times)}'


PARTS: dict[str, Callable[[Setting], None]] = {
    'soak': soak, 'verify60': verify60, 'kills': kills, 'latency': latency,
    'slow-subscriber': slow_subscriber, 'dying-subscribers': dying_subscribers}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--part', choices=[*PARTS, 'all'], default='soak')
    parser.add_argument('--minutes', type=float, default=30.0, help='wall time of soak')
    parser.add_argument('--seconds', type=float, default=60.0, help='simulated, of verify60')
    parser.add_argument('--kills', type=int, default=20)
    parser.add_argument('--starts', type=int, default=10, help='of latency')
    parser.add_argument(
        '--large', type=int, nargs=3, default=[58, 58, 60], metavar='N',
        help='weave.size of the large fabric of latency')
    parser.add_argument('--watched', type=float, default=15.0, help='of slow-subscriber [s]')
    parser.add_argument(
        '--factor', type=float, default=1.0, help='real_time_factor of slow-subscriber')
    parser.add_argument('--threads', type=int, default=0, help='to verify with')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--domain', type=int, help='ROS_DOMAIN_ID (default: an unused one)')
    parser.add_argument('--csv', type=Path, default=ROOT / 'runs' / 'soak' / 'soak.csv')
    parser.add_argument('--keep', type=Path, help='folder for logs and bags, which are then kept')
    parser.add_argument(
        '--no-wall-limits', action='store_true',
        help='print wall times without limits, on a machine with other work')
    arguments = parser.parse_args()
    # As with Ctrl-C, no node remains.
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(130))
    signal.signal(signal.SIGINT, signal.default_int_handler)
    print(f'{describe_machine()}, load {os.getloadavg()[0]:.1f}', flush=True)
    table = Table(wall_limits=not arguments.no_wall_limits)
    folder = arguments.keep or Path(tempfile.mkdtemp(prefix='icofabric_soak_'))
    try:
        for name in PARTS if arguments.part == 'all' else [arguments.part]:
            domain = free_domain() if arguments.domain is None else arguments.domain
            PARTS[name](Setting(folder / name, domain, arguments, table))
    except NodeError as error:
        table.add('the node', 'failed', '', False)
        print(error, file=sys.stderr)
    finally:
        table.write(arguments.csv)
    print(f'load {os.getloadavg()[0]:.1f}; written to {arguments.csv}')
    if table.is_good and not arguments.keep:
        shutil.rmtree(folder)
    else:
        print(f'logs and bags are kept in {folder}')
    return 0 if table.is_good else 1


if __name__ == '__main__':
    sys.exit(main())
