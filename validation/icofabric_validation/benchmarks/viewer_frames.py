# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Frames sent by the viewer, frames drawn by a browser, and their cost for the simulation.

    .venv/bin/python -m icofabric_validation.benchmarks.viewer_frames
    .venv/bin/python -m icofabric_validation.benchmarks.viewer_frames --part cost --sizes 63 1000
    .venv/bin/python -m icofabric_validation.benchmarks.viewer_frames --part drawn

`frames`: a page in a separate process with shells that move 60 times a second and connectors that
move 10 times. A client reads the data without drawing, which is the upper limit of a browser.
`drawn`: the same page in Chromium without a window, which draws on the processor: drawn frames,
frames with new poses, and processor time of the browser per frame. A frame of 10,000 shells takes
seconds: `--seconds 40`.
`cost`: processor time per simulated second of a node at full speed, without and with a viewer_node
and a client, alternating. Processor time depends little on other load, but a core is slower while
another core works. The node therefore also runs with an independent program that uses as much
processor time as the viewer.
"""

import argparse
from contextlib import contextmanager
import os
from pathlib import Path
import signal
import statistics
import subprocess
import sys
import tempfile
import time

from icofabric_validation.source_tree import ROOT

sys.path.insert(0, str(ROOT / 'test'))
from browser import Browser, find_browser  # noqa: E402 - beside the tests
from page_client import PageClient  # noqa: E402 - beside the tests

# Number of shells, and grid positions of an orthogonal weave.
SIZES = {63: (5, 5, 5), 1000: (13, 13, 12), 10000: (28, 28, 26)}
PORT = 18400
MOVES, LINES = 60.0, 10.0  # [Hz]
# A program with the load of a viewer of 63 to 1,000 shells, 0.4 of a core.
COMPUTES = """import time
while True:
    end = time.perf_counter() + 0.004
    while time.perf_counter() < end:
        pass
    time.sleep(0.006)
"""
# Script that returns drawn frames, frames with moved shells, and seconds.
DRAWN = """new Promise(done => {
    let mesh = null;
    window.__viserMutable.nodeRefFromName['/shells'].traverse(
        item => { if (item.isInstancedMesh2) mesh = item; });
    const info = window.__viserTestpoints.rendererInfo.render;
    const place = () => mesh.getPositionAt(0).z, first = info.frame, begun = performance.now();
    let last = place(), seen = first, moved = 0;
    const look = () => {
        if (info.frame !== seen && place() !== last) { moved += 1; last = place(); }
        seen = info.frame;
        const passed = (performance.now() - begun) / 1000;
        if (passed < SECONDS) requestAnimationFrame(look);
        else done([info.frame - first, moved, passed]);
    };
    requestAnimationFrame(look);
})"""


def processor_time(process):
    """Return the processor time [s] of a process."""
    fields = Path(f'/proc/{process.pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def processor_time_of_session(leader):
    """Return the processor time [s] of a process and its children."""
    total = 0
    for path in Path('/proc').glob('[0-9]*/stat'):
        try:
            fields = path.read_text().rpartition(')')[2].split()
        except OSError:  # ended meanwhile
            continue
        if int(fields[3]) == leader.pid:
            total += int(fields[11]) + int(fields[12])
    return total / os.sysconf('SC_CLK_TCK')


def parameters_of(count):
    return {
        'weave': {'size': list(SIZES[count]), 'connector_angle': 0.25},
        'contact': {'mode': 'never'}, 'gravity': [0.0, 0.0, -9.81], 'real_time_factor': 0.0,
        'groups': {'top': 'z_max'},
        'supports': {'top': {'group': 'top', 'fix': 'all'}}}


def serve(count):
    """Show moving shells until the process is stopped."""
    import icofabric_sim as ico
    from icofabric_sim.messages import PoseArrayBytes, topics
    from icofabric_sim.viewer.page import Page
    from icofabric_sim.viewer.sight import Sight
    scene = ico.Scene.from_parameters(parameters_of(count))
    sight = Sight()
    sight.feed(topics.WEAVE, topics.Outputs(scene).weave(scene.parameters))
    poses = PoseArrayBytes('world', scene.body_count)
    poses.values[:, :3], poses.values[:, 3:] = scene.position, (0.0, 0.0, 0.0, 1.0)
    ends = scene.position[scene.connectors.bodies] + scene.connectors.points_body
    page = Page(sight, None, port=PORT, rate=MOVES)
    print(f'{page.server.get_port()} {scene.body_count} {scene.connector_count}', flush=True)
    begun, lines = time.monotonic(), 0.0
    due = begun
    while True:
        now, due = time.monotonic(), due + 1.0 / MOVES
        # Unchanged data is not sent again.
        poses.values[:, 2] += 1e-6
        poses.values[:, 3] += 1e-6
        sight.feed(topics.POSES, poses.stamped(round(1e9 * (now - begun))))
        if now - lines > 1.0 / LINES:
            lines, ends = now, ends + 1e-6
            sight.lines[2] = ends
            sight.line_number += 1
        time.sleep(max(due - time.monotonic(), 0.0))


@contextmanager
def served(count):
    """Start a page of `count` shells; return process, port, shells, connectors."""
    process = subprocess.Popen(
        [sys.executable, '-m', 'icofabric_validation.benchmarks.viewer_frames', '--serve',
         str(count)], stdout=subprocess.PIPE, text=True)
    try:
        yield process, *map(int, process.stdout.readline().split())
    finally:
        process.kill()
        process.wait()


def machine():
    return f'load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores'


def measure_frames(count, seconds, rounds):
    found = []
    with served(count) as (process, port, shells, connectors):
        for _ in range(rounds):
            with PageClient(port) as page:
                page.wait_for(lambda: page.shells() is not None, 'no shells')
                time.sleep(0.5)
                begun, spent = time.monotonic(), processor_time(process)
                frames, size = page.frames, page.bytes
                time.sleep(seconds)
                passed = time.monotonic() - begun
                found.append((
                    (page.frames - frames) / passed, (page.bytes - size) / passed / 1e6,
                    1e3 * (processor_time(process) - spent) / max(page.frames - frames, 1)))
    rate, mega, each = map(statistics.median, zip(*found))
    print(
        f'{shells:6,d} shells, {connectors:6,d} connectors: {rate:5.1f} frames/s sent, '
        f'{mega:6.2f} MB/s, {each:5.1f} ms of processor a frame; {machine()}', flush=True)


def measure_drawn(count, seconds, rounds, size):
    wide, high = map(int, size.split('x'))
    found = []
    with (served(count) as (_, port, shells, connectors),
          Browser(width=wide, height=high) as browser):
        browser.open(f'http://localhost:{port}/')
        browser.wait_for(
            'window.__viserTestpoints?.rendererInfo.render.frame > 4', 'nothing is drawn')
        for _ in range(rounds):
            spent = processor_time_of_session(browser.process)
            drawn, moved, passed = browser.ask(DRAWN.replace('SECONDS', str(seconds)))
            each = (processor_time_of_session(browser.process) - spent) / max(drawn, 1)
            found.append((drawn / passed, moved / passed, 1e3 * each))
    drawn, moved, each = map(statistics.median, zip(*found))
    print(
        f'{shells:6,d} shells, {connectors:6,d} connectors: {drawn:5.1f} frames/s drawn at '
        f'{size}, {moved:5.1f} with new poses, {each:5.1f} ms of processor a frame; {machine()}',
        flush=True)


def start(module, ready, *words):
    process = subprocess.Popen(
        [sys.executable, '-m', f'icofabric_sim.ros.{module}', '--ros-args', *words],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler))
    for line in process.stderr:
        if ready in line:
            return process
    raise SystemExit(f'{module} has ended: {process.wait()}')


def stop(process):
    process.send_signal(signal.SIGINT)
    process.wait(60.0)


class Meter:
    """A subscriber of the clock of a node."""

    def __init__(self, process):
        import rclpy
        from rosgraph_msgs.msg import Clock
        self._spin, self._process, self._time = rclpy.spin_once, process, 0.0
        self._node = rclpy.create_node('meter')
        self._node.create_subscription(Clock, '/clock', self._hear, 10)

    def _hear(self, message):
        self._time = message.clock.sec + 1e-9 * message.clock.nanosec

    def cost(self, seconds):
        """Return the processor time of the node per simulated second."""
        self._wait(1.0)
        time_before, spent = self._time, processor_time(self._process)
        self._wait(seconds)
        if not self._time > time_before:
            raise SystemExit(f'no simulated time has passed in {seconds:g} s: add --seconds')
        return (processor_time(self._process) - spent) / (self._time - time_before)

    def _wait(self, seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._spin(self._node, timeout_sec=0.05)


def measure_cost(count, seconds, rounds):
    from icofabric_sim.parameters.text import dump_parameters, flatten_parameters
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / 'scene.yaml'
        scene.write_text(dump_parameters(flatten_parameters(parameters_of(count))))
        node = start('fabric_node', 'ready: ', '--params-file', str(scene))
        meter, alone, beside, watched = Meter(node), [], [], []
        try:
            for _ in range(rounds):
                alone.append(meter.cost(seconds))
                with subprocess.Popen([sys.executable, '-c', COMPUTES]) as other:
                    beside.append(meter.cost(seconds))
                    other.kill()
                viewer = start('viewer_node', ' is shown at ', '-p', f'port:={PORT}')
                with PageClient(PORT) as page:
                    page.wait_for(lambda: page.shells() is not None, 'no shells')
                    watched.append(meter.cost(seconds))
                stop(viewer)
        finally:
            stop(node)
    first, other, second = (statistics.median(each) for each in (alone, beside, watched))
    print(
        f'{count:6,d} shells: {first:.4g} s of processor for a simulated second alone, '
        f'{other:.4g} beside a program that computes, {second:.4g} watched: '
        f'{100.0 * (1.0 - first / second):.1f} % of the pace alone lost, '
        f'{100.0 * (1.0 - other / second):.1f} % of that beside; load '
        f'{os.getloadavg()[0]:.1f} on {os.cpu_count()} cores', flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--part', choices=('frames', 'drawn', 'cost', 'all'), default='all')
    parser.add_argument('--seconds', type=float, default=5.0, help='of each measurement')
    parser.add_argument('--rounds', type=int, default=3)
    parser.add_argument('--sizes', type=int, nargs='+', choices=SIZES, default=list(SIZES))
    parser.add_argument('--window', default='1280x800', help='of the browser (%(default)s)')
    parser.add_argument('--serve', type=int, choices=SIZES, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        serve(arguments.serve)
    if arguments.part in ('frames', 'all'):
        for count in arguments.sizes:
            measure_frames(count, arguments.seconds, arguments.rounds)
    if arguments.part in ('drawn', 'all') and not find_browser():
        print('no Chromium: frames drawn by a browser are not measured', flush=True)
    elif arguments.part in ('drawn', 'all'):
        for count in arguments.sizes:
            measure_drawn(count, arguments.seconds, arguments.rounds, arguments.window)
    if arguments.part in ('cost', 'all'):
        import rclpy
        rclpy.init()
        for count in arguments.sizes:
            measure_cost(count, arguments.seconds, arguments.rounds)


if __name__ == '__main__':
    main()
