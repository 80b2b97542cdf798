# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""For soak.py: a `fabric_node` in a process of its own, and the graph as seen from another one."""

from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import threading
import time
from typing import Any, NamedTuple, Self

from icofabric_sim.messages import decode_clock, decode_diagnostic_array, decode_string
from icofabric_sim.parameters.text import dump_parameters, flatten_parameters
from icofabric_sim.ros.live_sink import message_class
from icofabric_validation.source_tree import ROOT
import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy

NODE = '/icofabric'
# A first start compiles kernels, and the machine may do other things [s].
PATIENCE = 300.0
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
# Where the middleware's ports begin, how many a domain has, and domains below the ports that
# Linux hands out.
_FIRST_PORT, _PORTS, _DOMAINS = 7400, 250, 102


class Trouble(RuntimeError):
    """The node is gone, or does not answer."""


class Use(NamedTuple):
    """What a process uses at one moment."""

    wall: float  # [s]
    memory: float  # resident [MB]
    threads: int
    files: int  # open


class FabricProcess:
    """The node; all that it says goes to a file."""

    def __init__(
        self, folder: Path, scene: dict[str, Any], domain: int, **parameters: Any
    ) -> None:
        """Start with the sections of `scene`, and parameters whose dots are written as `__`."""
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
                # What runs in the background would hand on that SIGINT is ignored.
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler))

    def log(self) -> str:
        return self.log_path.read_text(errors='replace')

    def wait_until_ready(self) -> None:
        self.wait_for(lambda: 'ready: ' in self.log(), 'a node that runs')

    def wait_for(
        self, condition: Callable[[], Any], what: str, limit: float = PATIENCE,
        pause: float = 0.005,
    ) -> Any:
        """First true value of `condition`."""
        deadline = time.monotonic() + limit
        while not (value := condition()):
            if self.process.poll() is not None:
                raise Trouble(f'the node ended while waiting for {what}:\n{self.log()[-3000:]}')
            if time.monotonic() > deadline:
                raise Trouble(f'no {what} within {limit:g} s:\n{self.log()[-3000:]}')
            time.sleep(pause)
        return value

    def use(self) -> Use | None:
        """What it uses now; None once it has ended."""
        folder = Path('/proc') / str(self.process.pid)
        with suppress(OSError, KeyError):
            lines = (folder / 'status').read_text(encoding='utf-8').splitlines()
            said = dict(line.split(':', 1) for line in lines)
            return Use(
                time.monotonic(), int(said['VmRSS'].split()[0]) / _KB, int(said['Threads']),
                len(list((folder / 'fd').iterdir())))
        return None

    def stop(self, number: int = signal.SIGINT) -> tuple[int, float]:
        """Exit status after a signal, and the wall time until then [s]."""
        began = time.monotonic()
        self.process.send_signal(number)
        try:
            status = self.process.wait(60.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            status = -signal.SIGKILL
        return status, time.monotonic() - began

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: Any) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()


class Graph:
    """This process in the graph of the node: raw messages, parameters and services."""

    def __init__(self, domain: int) -> None:
        """Join; what arrives is handled in a thread of its own."""
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
        """Subscribe to a topic (name, type) as bytes; returns the subscription."""
        name, type_name = topic
        quality = QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)
        return self.node.create_subscription(
            message_class(type_name), name, take, quality, raw=True)

    def forget(self, subscription: Any) -> None:
        """End a subscription."""
        # By the thread that spins: one destroyed while that thread waits on it ends the spinning.
        self._executor.create_task(self.node.destroy_subscription, subscription)

    def publish(self, topic: str, data: bytes, type_name: str = WRENCH) -> None:
        """Send bytes as they are, once the node listens."""
        if topic not in self._publishers:
            publisher = self.node.create_publisher(message_class(type_name), topic, 1000)
            wait_for(publisher.get_subscription_count, f'a subscriber of {topic}')
            self._publishers[topic] = publisher
        self._publishers[topic].publish(data)

    def settle(self, topic: str) -> None:
        """Wait until the node has acknowledged what was sent to a topic."""
        if not self._publishers[topic].wait_for_all_acked(Duration(seconds=PATIENCE)):
            raise Trouble(f'messages on {topic} are not acknowledged within {PATIENCE:g} s')

    def call(self, service: str, kind: str = 'Trigger', **fields: Any) -> tuple[Any, float]:
        """Response of a service of the node, and the time it took [s]."""
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
        if not done.wait(PATIENCE):
            raise Trouble(f'no answer of {name} within {PATIENCE:g} s')
        return future.result(), time.perf_counter() - began

    def set(self, *, atomically: bool = True, **values: Any) -> tuple[list[Any], float]:
        """
        Results of setting parameters, whose dots are written as `__`, and the time it took [s].
        """
        wanted = [Parameter(name.replace('__', '.'), value=value).to_parameter_msg()
                  for name, value in values.items()]
        if atomically:
            answer, took = self.call(
                'set_parameters_atomically', 'set_atomically', parameters=wanted)
            return [answer.result], took
        answer, took = self.call('set_parameters', 'set', parameters=wanted)
        return list(answer.results), took

    def get(self, *names: str) -> float:
        """Time that it took to get parameters [s]."""
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

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: Any) -> None:
        self.close()


class Watch:
    """What the node says: every tick of its clock, its events and diagnostics, what it uses."""

    def __init__(self, graph: Graph, process: FabricProcess) -> None:
        """Listen from now on."""
        self.process = process
        self.ticks: list[tuple[float, int]] = []  # wall time [s], stamp [ns]
        self.events: list[dict[str, Any]] = []
        self.reports: list[tuple[float, Any]] = []
        self.uses: list[Use] = []
        self._ending = threading.Event()
        graph.listen(CLOCK, self._take_clock, depth=5000)
        graph.listen(EVENTS, self._take_event, depth=1000)
        graph.listen(DIAGNOSTICS, self._take_report)
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()
        process.wait_for(lambda: self.ticks and self.reports, 'a tick of the clock')

    @property
    def now(self) -> int:
        """Latest simulated time [ns]."""
        return self.ticks[-1][1]

    @property
    def figures(self) -> dict[str, str]:
        """Latest figures of the diagnostics."""
        return dict(self.reports[-1][1].values)

    def next_reports(self, count: int = 1) -> list[Any]:
        """The next so many reports."""
        first = len(self.reports)
        self.process.wait_for(lambda: len(self.reports) >= first + count, 'diagnostics')
        return [report for _, report in self.reports[first:first + count]]

    def next_event(self, name: str, first: int) -> dict[str, Any]:
        """The first event of that name after the first `first` ones."""
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

    def _look(self) -> None:
        while not self._ending.wait(0.5):
            use = self.process.use()
            if use is not None:
                self.uses.append(use)


def free_domain() -> int:
    """ROS_DOMAIN_ID that no process on this machine uses: another fabric would be heard too."""
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


def wait_for(condition: Callable[[], Any], what: str, limit: float = PATIENCE) -> None:
    """Wait until `condition` is true."""
    deadline = time.monotonic() + limit
    while not condition():
        if time.monotonic() > deadline:
            raise Trouble(f'no {what} within {limit:g} s')
        time.sleep(0.002)


def _service(module: str, word: str) -> Any:
    return getattr(import_module(module), word)
