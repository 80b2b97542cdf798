# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The node from the outside: a process of its own, and a client that reads its topics as bytes."""
import os

# Read when the message classes are imported, here and in the processes started from here.
os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'

import atexit
from collections import defaultdict
from contextlib import contextmanager
import fcntl
from importlib import import_module, util
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
import threading
import time

from icofabric_sim import messages
from icofabric_sim.messages.topics import TOPICS
from icofabric_sim.parameters.text import dump_parameters, flatten_parameters
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed on this machine')

import rclpy  # noqa: E402 - after the environment that it reads
from rclpy.duration import Duration  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
SCENES = ROOT / 'config'
# Generous: a first start compiles kernels, and the machine may do other things.
PATIENCE = 120.0  # s
LAST_WORDS = 5.0  # s

DECODERS = {
    'geometry_msgs/msg/PoseArray': messages.decode_pose_array,
    'visualization_msgs/msg/Marker': messages.decode_marker_points,
    'std_msgs/msg/Float64MultiArray': messages.decode_float64_multi_array,
    'std_msgs/msg/String': messages.decode_string,
    'rosgraph_msgs/msg/Clock': messages.decode_clock,
    'diagnostic_msgs/msg/DiagnosticArray': messages.decode_diagnostic_array,
}
TYPES = {topic.name.replace('~', '/icofabric'): topic.type for topic in TOPICS}


def _own_domains():
    """First of four domains that no process on this machine uses, and the lock that keeps them."""
    # Ports of a domain begin at 7400 + 250 times its number.
    used = {
        (int(line.split()[1].rpartition(':')[2], 16) - 7400) // 250
        for line in Path('/proc/net/udp').read_text().splitlines()[1:]}
    # Of a process that has just begun no port is seen yet, so another one is asked by a lock.
    begin = os.getpid() % _BLOCKS
    for block in (*range(begin, _BLOCKS), *range(begin)):
        first = block * _DOMAINS_EACH
        if not used.isdisjoint(range(first, first + _DOMAINS_EACH)):
            continue
        name = Path(tempfile.gettempdir(), f'icofabric_test_domains_{first}.lock')
        try:
            lock = name.open('w')
        except PermissionError:  # of another user
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
            continue
        return first, lock
    raise RuntimeError(
        'no ROS domains are free on this machine: too many test runs, or nodes of others')


_DOMAINS_EACH = 4
_BLOCKS = 101 // _DOMAINS_EACH  # of the domains whose ports Linux does not hand out by itself
_DOMAIN, _LOCK = _own_domains()
# What closes at the end of the process; it would be taken for a file that was forgotten.
atexit.register(_LOCK.close)


def domain(offset=0):
    """Domain of this test process, so that runs side by side do not meet."""
    assert 0 <= offset < _DOMAINS_EACH
    return _DOMAIN + offset


def next_line(process, limit=PATIENCE):
    """Next line that a process prints; fails where none comes."""
    lines = []
    reader = threading.Thread(target=lambda: lines.append(process.stdout.readline()), daemon=True)
    reader.start()
    reader.join(limit)
    if not lines:
        pytest.fail(f'{process.args} printed nothing within {limit} s')
    return lines[0]


def load_example(name):
    """Module of an example."""
    specification = util.spec_from_file_location(
        name, ROOT / 'examples' / f'{name}.py')
    module = util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def write_scene(path, sections):
    """Parameter file of nested sections."""
    path.write_text(dump_parameters(flatten_parameters(sections)))
    return path


def type_of(topic):
    """Type of a topic of a fabric, in whatever namespace."""
    return TYPES.get(topic) or TYPES['/icofabric' + topic.partition('/icofabric')[2]]


def ros_class(type_name):
    package, kind, name = type_name.split('/')
    return getattr(import_module(f'{package}.{kind}'), name)


def wait_for(condition, what, *, node=None, limit=PATIENCE):
    """
    First true value of `condition`; fails with `what`, and the node's log, when none comes.

    `what` may be a function that tells it then.
    """
    told = what if callable(what) else lambda: what
    deadline = time.monotonic() + limit
    while True:
        value = condition()
        if value:
            return value
        if node is not None and node.process.poll() is not None:
            # What it sent last may still be on its way.
            end = min(deadline, time.monotonic() + LAST_WORDS)
            while time.monotonic() < end:
                value = condition()
                if value:
                    return value
                time.sleep(0.005)
            pytest.fail(f'the node ended while waiting for {told()}:\n{node.log()}')
        if time.monotonic() > deadline:
            pytest.fail(f'no {told()} within {limit} s\n{node.log() if node else ""}')
        time.sleep(0.005)


class NodeProcess:
    """`fabric_node` in a process of its own; its log goes to a file."""

    MODULE = 'icofabric_sim.ros.fabric_node'
    READY = 'ready: '  # stands in its log once it runs

    def __init__(
        self, log_path, *arguments, parameters=None, scene=None, offset=0, launcher=(), own=()
    ):
        """
        Start with `parameters` (name: value) over the file `scene`, and more command line.

        By a `launcher` with its arguments; those in `own` are the node's, not of ROS.
        """
        command = [*launcher, sys.executable, '-m', self.MODULE, *own, '--ros-args']
        if scene is not None:
            command += ['--params-file', str(scene)]
        for name, value in (parameters or {}).items():
            command += ['-p', f'{name}:={value}']
        self.log_path = Path(log_path)
        with self.log_path.open('w') as log:
            # The environment is passed on: the ROS wheels keep their library path in it.
            self.process = subprocess.Popen(
                [*command, *arguments], stdout=log, stderr=subprocess.STDOUT, cwd=ROOT,
                env={**os.environ, 'ROS_DOMAIN_ID': str(domain(offset)),
                     'PYTHONFAULTHANDLER': '1'},
                # A test run in the background would hand on that SIGINT is ignored.
                preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler))

    def log(self):
        return self.log_path.read_text(errors='replace')

    def lines(self, word):
        """Lines of the log that hold `word`."""
        return [line for line in self.log().splitlines() if word in line]

    def send(self, number):
        self.process.send_signal(number)

    def wait(self, limit=PATIENCE):
        """Exit status."""
        return self.process.wait(limit)

    def stop(self, number=signal.SIGINT):
        """Ask the node to end, and return its exit status; no traceback may be in its log."""
        if self.process.poll() is None:
            self.send(number)
        try:
            status = self.wait(60)
        except subprocess.TimeoutExpired:
            # With where each of its threads stands.
            self.send(signal.SIGABRT)
            self.process.wait()
            pytest.fail(f'the node did not end:\n{self.log()}')
        assert 'Traceback' not in self.log(), self.log()
        if status < 0:
            pytest.fail(f'the node was ended by signal {-status}:\n{self.log()}')
        return status

    def __enter__(self):
        return self

    def __exit__(self, kind, error, traceback):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()


class Client:
    """
    Subscriptions that keep what arrives, publishers and service calls; spins in the background.
    """

    def __init__(self, node=None, *, offset=0):
        """Join the graph of `node`, whose log is shown when something does not come."""
        self.process, self._fault = node, None
        if node is not None:
            # Participants that announce themselves to one that is there find each other at once;
            # otherwise seconds may pass until the next announcement.
            self.wait_for(lambda: node.lines(node.READY), 'a node that runs')
        self.context = rclpy.Context()
        self.context.init(domain_id=domain(offset))
        self.node = rclpy.create_node(
            'test_client', context=self.context, enable_rosout=False)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.received = defaultdict(list)
        self._clients, self._publishers, self._subscriptions = {}, {}, {}
        self._lock = threading.RLock()
        self._ending = False
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self):
        try:
            while not self._ending:
                self.executor.spin_once(timeout_sec=0.05)
        except Exception as error:  # noqa: BLE001 - whoever waits for a message raises it
            self._fault = error

    def close(self):
        self._ending = True
        self._thread.join()
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()

    def __enter__(self):
        return self

    def __exit__(self, kind, error, traceback):
        self.close()

    def wait_for(self, condition, what, limit=PATIENCE):
        def looked_at():
            if self._fault is not None:
                raise AssertionError('this client can hear no more') from self._fault
            return condition()

        return wait_for(looked_at, what, node=self.process, limit=limit)

    @contextmanager
    def another_node(self, name, **options):
        """Spin a second node in this client's context until the block ends."""
        node = rclpy.create_node(name, context=self.context, **options)
        self.executor.add_node(node)
        try:
            yield node
        finally:
            self.executor.remove_node(node)
            # By the thread that spins: a node destroyed while that thread waits on it ends the
            # spinning (InvalidHandle).
            destroyed = self.executor.create_task(node.destroy_node)
            self.wait_for(destroyed.done, f'the end of {name}')

    # Topics.

    def listen(self, topic, *, latched=False, depth=1000):
        """Start to keep the messages of `topic`, decoded; returns the list that grows."""
        topic = topic.replace('~', '/icofabric')
        decode, kept = DECODERS[type_of(topic)], self.received[topic]
        if topic not in self._subscriptions:
            durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
            quality = QoSProfile(
                depth=depth, reliability=ReliabilityPolicy.RELIABLE, durability=durability)
            self._subscriptions[topic] = self.node.create_subscription(
                ros_class(type_of(topic)), topic, lambda data: kept.append(decode(data)), quality,
                raw=True)
        return kept

    def next(self, topic, condition=lambda message: True, **options):
        """First message of `topic` from now on that fulfils `condition`."""
        kept = self.listen(topic, **options)
        start = len(kept)

        def found():
            return next(([item] for item in kept[start:] if condition(item)), None)

        def what():
            came = len(kept) - start
            return f'message on {topic}; {came} others came' + (
                f', the last of them {kept[-1]}' if came else '')

        return self.wait_for(found, what)[0]

    @property
    def clock(self):
        """Latest simulated time [ns]."""
        kept = self.listen('/clock')
        return self.wait_for(lambda: kept[-1:], '/clock')[0]

    def wait_until(self, nanoseconds):
        self.wait_for(lambda: self.clock >= nanoseconds, f'simulated time {nanoseconds} ns')

    def publisher(self, topic, type_name='geometry_msgs/msg/WrenchStamped'):
        """Publisher that the node is connected to."""
        topic = topic.replace('~', '/icofabric')
        if topic not in self._publishers:
            self._publishers[topic] = self.node.create_publisher(ros_class(type_name), topic, 1000)
        publisher = self._publishers[topic]
        self.wait_for(publisher.get_subscription_count, f'subscriber of {topic}')
        return publisher

    def push(self, topic, force=(0.0, 0.0, 0.0), torque=(0.0, 0.0, 0.0), *, frame='', stamp=0):
        """Publish a wrench as objects, as any user would."""
        message = ros_class('geometry_msgs/msg/WrenchStamped')()
        message.header.frame_id = frame
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        vectors = ((message.wrench.force, force), (message.wrench.torque, torque))
        for vector, values in vectors:
            vector.x, vector.y, vector.z = (float(value) for value in values)
        self.publisher(topic).publish(message)

    # Services.

    def begin(self, service, type_name, **fields):
        """Future of a service call."""
        service = service.replace('~', '/icofabric')
        kind = ros_class(type_name)
        if service not in self._clients:
            self._clients[service] = self.node.create_client(kind, service)
        client = self._clients[service]
        self.wait_for(client.service_is_ready, f'service {service}')
        return client.call_async(kind.Request(**fields))

    def call(self, service, type_name='std_srvs/srv/Trigger', **fields):
        """Response of a service."""
        future = self.begin(service, type_name, **fields)
        self.wait_for(future.done, f'answer of {service}')
        return future.result()

    def pause(self, paused=True):
        """Pause or go on; the simulated time [ns] at which that was."""
        response = self.call('~/pause', 'std_srvs/srv/SetBool', data=paused)
        assert response.success, response.message
        word, _, time = response.message.removesuffix(' s').partition(', t = ')
        assert word == ('paused' if paused else 'running')
        return round(float(time) * 1e9)

    def settle(self):
        """Wait until what was sent before has reached the simulation."""
        # Topics and services have ways of their own: a request may overtake a message.
        for topic, publisher in self._publishers.items():
            if not publisher.wait_for_all_acked(Duration(seconds=PATIENCE)):
                pytest.fail(f'the node did not get what was sent on {topic} in {PATIENCE} s')
        for _ in range(2):  # messages that arrive first are handled first
            self.get('step_count')

    def set_each(self, **values):
        """Results of `set_parameters`; dots in names are written as `__`."""
        return self.set_messages([parameter(name, value) for name, value in values.items()])

    def set_messages(self, wanted, *, atomically=False):
        """Results of a parameter service for a list of rcl_interfaces/Parameter."""
        if atomically:
            return self.call('~/set_parameters_atomically',
                             'rcl_interfaces/srv/SetParametersAtomically',
                             parameters=wanted).result
        return self.call('~/set_parameters', 'rcl_interfaces/srv/SetParameters',
                         parameters=wanted).results

    def set(self, *, atomically=False, **values):
        """Set parameters, which must be accepted."""
        wanted = [parameter(name, value) for name, value in values.items()]
        results = self.set_messages(wanted, atomically=atomically)
        for result in [results] if atomically else results:
            assert result.successful, result.reason

    def get(self, *names):
        """Values of parameters, as a node would hold them."""
        values = self.call('~/get_parameters', 'rcl_interfaces/srv/GetParameters',
                           names=list(names)).values
        return [rclpy.parameter.parameter_value_to_python(value) for value in values]

    def health(self, condition=lambda status: True):
        """Next status of the node on /diagnostics that fulfils `condition`."""
        return self.next('/diagnostics', lambda message: condition(message[1][0]))[1][0]


def reasons(status):
    """Return the full reasons of a status; its `message` may be cut, and a start has none."""
    return status.values.get('reasons', 'none')


def parameter(name, value):
    """A rcl_interfaces/Parameter; dots in the name may be written as `__`."""
    return Parameter(name.replace('__', '.'), value=value).to_parameter_msg()
