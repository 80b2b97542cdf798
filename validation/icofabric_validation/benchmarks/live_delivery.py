# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Cost of subscribers for the node, and bitwise checks of received messages.

A `fabric_node` runs in a separate process, and a raw subscriber in another one. The received
messages are compared with those of a simulation in this process.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, ExitStack
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any, NamedTuple
import zlib

import icofabric_sim as ico
from icofabric_sim.messages.schedule import Schedule, seconds
from icofabric_sim.messages.topics import CONNECTORS, Outputs, POSES, Topic
from icofabric_sim.parameters.text import dump_parameters, flatten_parameters

_TICK = os.sysconf('SC_CLK_TCK')


class Case(NamedTuple):
    """A fabric and the rates of its messages."""

    size: tuple[int, int, int]
    step: float  # [s]
    stiffness: float  # [N/m]
    publish_rate: float  # [Hz] of poses
    marker_rate: float  # [Hz] of connectors

    @property
    def parameters(self) -> dict[str, Any]:
        """Return the scene of the node, which runs until it is stopped."""
        return {
            'weave': {'size': list(self.size)},
            'connector': {'stiffness': self.stiffness},
            'initial_random': {'velocity_sigma': 0.05, 'spin_sigma': 2.0, 'seed': 1},
            'contact': {'mode': 'never'},
            # One thread, because two threads wait for each other under other load.
            'solver': {'method': 'leapfrog', 'step': self.step, 'threads': 1},
            'publish_rate': self.publish_rate,
            'marker_rate': self.marker_rate,
        }


# 10,206 and 100,920 bodies, soft enough for real time on one core.
CASES = (
    Case((27, 27, 28), 1e-3, 20.0, 60.0, 10.0),
    Case((58, 58, 60), 5e-3, 1.0, 10.0, 1.0),
)
# Duration of each measurement.
_WATCHED_S = 10.0


class Watched(NamedTuple):
    """Times of a node in an interval."""

    wall: float  # [s]
    cpu: float  # [s] of all its threads
    simulated: float  # [s]

    def text(self) -> str:
        """Return both rates as text."""
        return (f'{self.cpu / self.wall:.2f} CPU seconds per second at '
                f'{self.simulated / self.wall:.2f} times real time')


class Result(NamedTuple):
    """The results of a case."""

    bodies: int
    alone: Watched
    heard: Watched
    received: dict[str, int]  # messages by topic
    expected: dict[str, int]
    wrong: int  # messages whose bytes differ from those of the simulation here
    rate: float  # [MB] for each second of simulated time

    @property
    def cost(self) -> float:
        """CPU time of the node per simulated second that the subscriber causes."""
        alone, heard = (watched.cpu / watched.simulated for watched in (self.alone, self.heard))
        return heard - alone


class _Listener:
    """The subscriber of listener.py."""

    def __init__(self, topics: Sequence[Topic]) -> None:
        self._names = [topic.name.replace('~', '/icofabric') for topic in topics]
        words = [word for name, topic in zip(self._names, topics) for word in (name, topic.type)]
        self._process = subprocess.Popen(
            [sys.executable, '-m', 'icofabric_validation.benchmarks.listener', *words],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def ask(self, word: str) -> Any:
        assert self._process.stdin is not None and self._process.stdout is not None
        print(word, file=self._process.stdin, flush=True)
        return json.loads(self._process.stdout.readline())

    def end(self) -> list[list[list[int]]]:
        """Return received messages by topic: stamp, marker, size, checksum."""
        received = self.ask('end')
        self._process.wait(60)
        return [received[name] for name in self._names]

    def kill(self) -> None:
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()


def measure(case: Case) -> Result:
    """Measure the node with a subscriber of the clock only, then with one of all topics."""
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix='icofabric_benchmark_'))
        scene = Path(folder) / 'scene.yaml'
        scene.write_text(dump_parameters(flatten_parameters(case.parameters)))
        node = stack.enter_context(_node(scene, Path(folder) / 'log'))
        listener = _Listener((POSES, CONNECTORS))
        stack.callback(listener.kill)
        alone = _watch(node, listener, _WATCHED_S)
        listener.ask('listen')
        heard = _watch(node, listener, _WATCHED_S)
        node.send_signal(signal.SIGINT)
        node.wait(60)
        poses, markers = listener.end()
    return _judge(case, alone, heard, poses, markers)


def _judge(
    case: Case, alone: Watched, heard: Watched, poses: list[list[int]], markers: list[list[int]]
) -> Result:
    """Simulate up to the last message, and compare all messages that may be complete."""
    scene = ico.Scene.from_parameters(case.parameters)
    simulation, outputs = ico.compile_scene(scene), Outputs(scene)
    schedules = Schedule(case.publish_rate), Schedule(case.marker_rate)
    # The first and last output of a subscriber may be incomplete.
    now, last = markers[0][0], min(poses[-1][0], markers[-1][0] - 1)
    kept = [{(stamp, number): (size, checksum) for stamp, number, size, checksum in messages}
            for messages in (poses, markers)]
    received, expected, wrong = [0, 0], [0, 0], 0
    while (now := min(schedule.after(now) for schedule in schedules)) <= last:
        simulation.advance_to(seconds(now))
        snapshot = simulation.snapshot()
        for kind, schedule in enumerate(schedules):
            if schedule.is_due(now):
                messages = outputs.connectors(snapshot, now) if kind else [
                    outputs.poses(snapshot, now)]
                for number, data in enumerate(messages):
                    expected[kind] += 1
                    found = kept[kind].get((now, number))
                    received[kind] += found is not None
                    wrong += found is not None and not _is_same(data, *found)
    names = 'poses', 'connectors'
    size = sum(item[2] for item in poses + markers)
    return Result(
        scene.body_count, alone, heard, dict(zip(names, received)), dict(zip(names, expected)),
        wrong, size / 1e6 / seconds(poses[-1][0] - poses[0][0]))


def _is_same(data: bytes, size: int, checksum: int) -> bool:
    """Return True if a message equals `data`; the middleware may pad the last four bytes."""
    return 0 <= size - len(data) < 4 and zlib.crc32(data.ljust(size, b'\0')) == checksum


def report(case: Case, result: Result) -> list[str]:
    """Return lines for a terminal."""
    counts = ' and '.join(
        f'{result.received[name]} of {result.expected[name]} messages of {name}'
        for name in result.expected)
    return [
        f'{result.bodies:,} bodies, leapfrog, step {case.step:g} s: poses at '
        f'{case.publish_rate:g} Hz, connectors at {case.marker_rate:g} Hz',
        f'  node without a listener: {result.alone.text()}',
        f'  node with a listener:    {result.heard.text()}',
        f'  the listener costs the node {result.cost:.2f} CPU seconds for each simulated second',
        f'  it received {counts}, {result.rate:.0f} MB for each simulated second',
        f'  {result.wrong} of them differ from those of a simulation in another process']


@contextmanager
def _node(scene: Path, log: Path) -> Iterator[subprocess.Popen[bytes]]:
    with log.open('w') as file:
        node = subprocess.Popen(
            [sys.executable, '-m', 'icofabric_sim.ros.fabric_node', '--ros-args', '--params-file',
             str(scene)], stdout=file, stderr=subprocess.STDOUT)
    try:
        while 'ready: ' not in log.read_text(errors='replace'):
            if node.poll() is not None:
                raise RuntimeError(f'the node ended:\n{log.read_text(errors="replace")}')
            time.sleep(0.05)
        yield node
    finally:
        if node.poll() is None:
            node.kill()
            node.wait()


def _watch(node: 'subprocess.Popen[bytes]', listener: _Listener, wanted: float) -> Watched:
    listener.ask('clock')  # wait for the subscriber
    time.sleep(1.0)  # let earlier work end

    def look() -> Watched:
        return Watched(
            time.monotonic(), _cpu_seconds(node.pid), seconds(listener.ask('clock')))

    before = look()
    time.sleep(wanted)
    return Watched(*(late - early for early, late in zip(before, look())))


def _cpu_seconds(process: int) -> float:
    """Return the CPU time [s] of all threads, in user and kernel mode."""
    fields = Path(f'/proc/{process}/stat').read_text(encoding='utf-8').rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / _TICK
