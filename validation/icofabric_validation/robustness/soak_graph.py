# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A `fabric_node` in a separate process, and a client of its graph, for soak.py."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib import import_module
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import threading
import time
from typing import Any, NamedTuple

from icofabric_sim.messages import decode_clock, decode_diagnostic_array, decode_string
from icofabric_sim.parameters.text import dump_parameters, flatten_parameters
from icofabric_sim.process.closing import Closing
from icofabric_sim.ros.live_sink import message_class
from icofabric_validation.source_tree import ROOT
import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy

NODE = '/icofabric'
# Time limit of an answer; a first start compiles kernels.
MAX_WAIT_S = 300.0
CLOCK, EVENTS = ('/clock', 'rosgraph_msgs/msg/Clock'), (f'{NODE}/events', 'std_msgs/msg/String')
DIAGNOSTICS = '/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray'
WRENCH = 'geometry_msgs/msg/WrenchStamped'
_SERVICES = {
    'Trigger': ('std_srvs.srv', 'Trigger'),
    'SetBool': ('std_srvs.srv', 'SetBool'),
    'get': ('rcl_interfaces.srv', 'GetParameters'),
    'set': ('rcl_interfaces.srv', 'SetParameters'),
    'set_atomically': ('rcl_interfaces.srv', 'SetParametersAtomically'),
}
_KB = 1024
# First port of the middleware, ports per domain, and number of domains below the ephemeral ports
# of Linux.
_FIRST_PORT, _PORTS, _DOMAINS = 7400, 250, 102


class NodeError(RuntimeError):
    """The node has ended or does not answer."""


class ResourceUse(NamedTuple):
    """Resources of a process at one time."""

    wall: float  # [s]
    memory: float  # resident [MB]
    threads: int
    files: int  # open


class FabricProcess(Closing):
    """A node whose output goes to a file."""

    def __init__(
        self, folder: Path, scene: dict[str, Any], domain: int, **parameters: Any
    ) -> None:
        """Start with the sections of `scene`, and parameters with `__` instead of dots."""
        folder.mkdir(parents=True, exist_ok=True)
        self.log_path = folder / 'log'
        path = folder / 'scene.yaml'
        path.write_text(dump_parameters(flatten_parameters(scene)))
        command = [sys.executable, '-m', 'icofabric_sim.ros.fabric_node', '--ros-args',
                   '--params-file', str(path)]
        for name, value in parameters.items():
            command += ['-p', f'{name.replace("__", ".")}:={value}']
        with self.log_path.open('w') as log:
            self.started = time.monotonic()
            self.process = subprocess.Popen(
                command, stdout=log, stderr=subprocess.STDOUT, cwd=ROOT,
                env=environment(domain),
                # A background process would pass on that SIGINT is ignored.
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler))

    def log(self) -> str:
        return self.log_path.read_text(errors='replace')

    def wait_until_ready(self) -> None:
        self.wait_for(lambda: 'ready: ' in self.log(), 'running node')

    def wait_for(
        self, condition: Callable[[], Any], what: str, limit: float = MAX_WAIT_S,
        pause: float = 0.005,
    ) -> Any:
        """Return the first true value of `condition`."""
        deadline = time.monotonic() + limit
        while not (value := condition()):
            if self.process.poll() is not None:
                raise NodeError(f'the node ended while waiting for {what}:\n{self.log()[-3000:]}')
            if time.monotonic() > deadline:
                raise NodeError(f'no {what} within {limit:g} s:\n{self.log()[-3000:]}')
            time.sleep(pause)
        return value

    def resources(self) -> ResourceUse | None:
        """Return the current resources, or None after the end."""
        folder = Path('/proc') / str(self.process.pid)
        with suppress(OSError, KeyError):
            lines = (folder / 'status').read_text(encoding='utf-8').splitlines()
            status = dict(line.split(':', 1) for line in lines)
            return ResourceUse(
                time.monotonic(), int(status['VmRSS'].split()[0]) / _KB, int(status['Threads']),
                len(list((folder / 'fd').iterdir())))
        return None

    def stop(self, number: int = signal.SIGINT) -> tuple[int, float]:
        """Send a signal; return the exit status and the wall time until the end [s]."""
        began = time.monotonic()
        self.process.send_signal(number)
        try:
            status = self.process.wait(60.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            status = -signal.SIGKILL
        return status, time.monotonic() - began

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()


class Graph(Closing):
    """A client in the graph of the node, with raw messages, parameters and services."""

    def __init__(self, domain: int) -> None:
        """Join the domain; a separate thread handles messages."""
        self._context = rclpy.Context()
        self._context.init(domain_id=domain)
        self.node = rclpy.create_node('soak', context=self._context, enable_rosout=False)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._clients: dict[str, Any] = {}
        self._publishers: dict[str, Any] = {}
        self._ending = False
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def listen(
        self, topic: tuple[str, str], take: Callable[[bytes], Any], *, depth: int = 100
    ) -> Any:
        """Subscribe to a topic (name, type) as bytes; return the subscription."""
        name, type_name = topic
        quality = QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)
        return self.node.create_subscription(
            message_class(type_name), name, take, quality, raw=True)

    def forget(self, subscription: Any) -> None:
        """End a subscription."""
        # In the spinning thread, which ends if a subscription is destroyed while it waits.
        self._executor.create_task(self.node.destroy_subscription, subscription)

    def publish(self, topic: str, data: bytes, type_name: str = WRENCH) -> None:
        """Publish raw bytes after the node has subscribed."""
        if topic not in self._publishers:
            publisher = self.node.create_publisher(message_class(type_name), topic, 1000)
            wait_for(publisher.get_subscription_count, f'a subscriber of {topic}')
            self._publishers[topic] = publisher
        self._publishers[topic].publish(data)

    def settle(self, topic: str) -> None:
        """Wait until the node has acknowledged all messages of a topic."""
        if not self._publishers[topic].wait_for_all_acked(Duration(seconds=MAX_WAIT_S)):
            raise NodeError(f'messages on {topic} are not acknowledged within {MAX_WAIT_S:g} s')

    def call(self, service: str, kind: str = 'Trigger', **fields: Any) -> tuple[Any, float]:
        """Call a service of the node; return the response and the time [s]."""
        name = f'{NODE}/{service}'
        if name not in self._clients:
            module, word = _SERVICES[kind]
            client = self.node.create_client(_service(module, word), name)
            wait_for(client.service_is_ready, f'the service {name}')
            self._clients[name] = client
        client = self._clients[name]
        began = time.perf_counter()
        done = threading.Event()
        future = client.call_async(client.srv_type.Request(**fields))
        future.add_done_callback(lambda _: done.set())
        if not done.wait(MAX_WAIT_S):
            raise NodeError(f'no answer of {name} within {MAX_WAIT_S:g} s')
        return future.result(), time.perf_counter() - began

    def set(self, *, atomically: bool = True, **values: Any) -> tuple[list[Any], float]:
        """Set parameters with `__` instead of dots; return the results and the time [s]."""
        messages = [Parameter(name.replace('__', '.'), value=value).to_parameter_msg()
                  for name, value in values.items()]
        if atomically:
            answer, took = self.call(
                'set_parameters_atomically', 'set_atomically', parameters=messages)
            return [answer.result], took
        answer, took = self.call('set_parameters', 'set', parameters=messages)
        return list(answer.results), took

    def get(self, *names: str) -> float:
        """Get parameters, and return the time [s]."""
        return self.call('get_parameters', 'get', names=list(names))[1]

    def close(self) -> None:
        self._ending = True
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()

    def _spin(self) -> None:
        while not self._ending:
            with suppress(ExternalShutdownException):
                self._executor.spin_once(timeout_sec=0.05)


class Watch:
    """Recorded clock, events, diagnostics and resources of a node."""

    def __init__(self, graph: Graph, process: FabricProcess) -> None:
        """Start to record."""
        self.process = process
        self.ticks: list[tuple[float, int]] = []  # wall time [s], stamp [ns]
        self.events: list[dict[str, Any]] = []
        self.reports: list[tuple[float, Any]] = []
        self.resource_uses: list[ResourceUse] = []
        self._ending = threading.Event()
        graph.listen(CLOCK, self._take_clock, depth=5000)
        graph.listen(EVENTS, self._take_event, depth=1000)
        graph.listen(DIAGNOSTICS, self._take_report)
        self._thread = threading.Thread(target=self._poll_resources, daemon=True)
        self._thread.start()
        process.wait_for(lambda: self.ticks and self.reports, 'a tick of the clock')

    @property
    def now(self) -> int:
        """Latest simulated time [ns]."""
        return self.ticks[-1][1]

    @property
    def figures(self) -> dict[str, str]:
        """Latest values of the diagnostics."""
        return dict(self.reports[-1][1].values)

    def next_reports(self, count: int = 1) -> list[Any]:
        """Return the next `count` reports."""
        first = len(self.reports)
        self.process.wait_for(lambda: len(self.reports) >= first + count, 'diagnostics')
        return [report for _, report in self.reports[first:first + count]]

    def next_event(self, name: str, first: int) -> dict[str, Any]:
        """Return the first event with a name after the first `first` events."""
        def found() -> Any:
            return next(
                ([event] for event in self.events[first:] if event['event'] == name), None)

        return self.process.wait_for(found, f'event {name}')[0]

    def end(self) -> None:
        self._ending.set()
        self._thread.join()

    def _take_clock(self, data: bytes) -> None:
        self.ticks.append((time.monotonic(), decode_clock(data)))

    def _take_event(self, data: bytes) -> None:
        self.events.append(json.loads(decode_string(data)))

    def _take_report(self, data: bytes) -> None:
        self.reports.append((time.monotonic(), decode_diagnostic_array(data)[1][0]))

    def _poll_resources(self) -> None:
        while not self._ending.wait(0.5):
            resources = self.process.resources()
            if resources is not None:
                self.resource_uses.append(resources)


@contextmanager
def watched_node(
    folder: Path, scene: dict[str, Any], domain: int, **parameters: Any
) -> Iterator[tuple[FabricProcess, Graph, Watch]]:
    """Start a node, see `FabricProcess`, and record its messages while the block runs."""
    with FabricProcess(folder, scene, domain, **parameters) as process, Graph(domain) as graph:
        process.wait_until_ready()
        watch = Watch(graph, process)
        yield process, graph, watch
        watch.end()


def free_domain() -> int:
    """Return a ROS_DOMAIN_ID that no process on this machine uses."""
    used = set()
    for name in ('udp', 'udp6'):
        with suppress(OSError):
            for line in Path('/proc/net', name).read_text(encoding='utf-8').splitlines()[1:]:
                used.add((int(line.split()[1].rpartition(':')[2], 16) - _FIRST_PORT) // _PORTS)
    first = os.getpid() % _DOMAINS
    return next(
        number for number in (*range(first, _DOMAINS), *range(first)) if number not in used)


def environment(domain: int) -> dict[str, str]:
    """Return the environment of this process with a ROS_DOMAIN_ID."""
    return {**os.environ, 'ROS_DOMAIN_ID': str(domain)}


def wait_for(condition: Callable[[], Any], what: str, limit: float = MAX_WAIT_S) -> None:
    """Wait until `condition` is true."""
    deadline = time.monotonic() + limit
    while not condition():
        if time.monotonic() > deadline:
            raise NodeError(f'no {what} within {limit:g} s')
        time.sleep(0.002)


def _service(module: str, word: str) -> Any:
    return getattr(import_module(module), word)
