# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The viewer node: it receives topics as bytes, and calls services and publishes `~/pull`."""

from collections.abc import Callable
from concurrent.futures import Future
import math
import threading
import time
from typing import Any

from icofabric_sim.messages import PointStampedBytes
from icofabric_sim.messages.frames import body_frame
from icofabric_sim.messages.topics import Topic, VIEWS
from icofabric_sim.parameters.table import with_kind
from icofabric_sim.ros.live_sink import message_class, quality
from icofabric_sim.ros.process import Server, StopSignals
from icofabric_sim.viewer.local import SightSink
from icofabric_sim.viewer.page import Page, require_viser
from icofabric_sim.viewer.sight import Sight, TOPICS
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.exceptions import InvalidParameterTypeException, InvalidTopicNameException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.validate_full_topic_name import validate_full_topic_name
from std_srvs.srv import SetBool, Trigger

VIEWER = 'icofabric_viewer'  # name of the node
DEFAULTS: dict[str, Any] = {
    'fabric': '/icofabric', 'host': '127.0.0.1', 'port': 8080, 'rate': 60.0, 'read_only': False}
_FLAG_SERVICES = ('pause', 'record')
_TRIGGER_SERVICES = ('step', 'advance', 'reset', 'clear_loads', 'continue')
# Time to search for a fabric or a replay, to find out which of the two it is [s].
_SEARCH_S = 3.0
_CHECK_INTERVAL_S = 1.0
# A change of parameters is answered within seconds; the node may have ended meanwhile [s].
_ANSWER_WAIT_S = 30.0
# Answer if the parameter service is missing.
_MISSING_SERVICE = '{0} of {1} is not available: is the node running in this ROS domain?'


class NodeActions:
    """Control of a fabric node by its services; a page calls the methods from any thread."""

    def __init__(self, node: Node, fabric: str) -> None:
        """Create the clients of `node` for the node named `fabric`."""
        self.is_replay, self._fabric = False, fabric
        self._clients = {
            name: node.create_client(
                SetBool if name in _FLAG_SERVICES else Trigger, f'{fabric}/{name}')
            for name in (*_FLAG_SERVICES, *_TRIGGER_SERVICES)}
        self._parameters = node.create_client(
            SetParametersAtomically, f'{fabric}/set_parameters_atomically')
        self._pulls = node.create_publisher(
            message_class(PointStampedBytes.TYPE), f'{fabric}/pull', QoSProfile(depth=10))

    def finds_replay(self) -> bool | None:
        """
        Return whether a replay answers, or None if no node answers.

        Service names are no evidence: they are in the graph as soon as a client exists.
        """
        if self._clients['advance'].service_is_ready():
            return False
        return True if self._clients['continue'].service_is_ready() else None

    def pull(self, body: int, point: tuple[float, float, float] | None) -> None:
        """Publish on `~/pull`."""
        message = PointStampedBytes(body_frame(body))
        message.point[:] = math.nan if point is None else point
        self._pulls.publish(message.stamped(0))

    def command(self, name: str, on: bool | None = None) -> 'Future[str]':
        """Call the service of that name."""
        request = SetBool.Request(data=bool(on)) if name in _FLAG_SERVICES else Trigger.Request()
        return self._call(self._clients[name], f'~/{name}', request, lambda answer: (
            answer.success, answer.message))

    def change(self, name: str, value: Any) -> 'Future[str]':
        """Set a parameter, through the service that validates a request as one change."""
        request = SetParametersAtomically.Request(parameters=[
            Parameter(each, value=given).to_parameter_msg()
            for each, given in with_kind(name, value).items()])
        return self._call(self._parameters, 'the parameter service', request, lambda answer: (
            answer.result.successful, answer.result.reason))

    def _call(
        self, client: Any, what: str, request: Any, read: Callable[[Any], tuple[bool, str]]
    ) -> 'Future[str]':
        if not client.service_is_ready():
            raise ValueError(_MISSING_SERVICE.format(what, self._fabric))
        answer: Future[str] = Future()

        def done(found: Any) -> None:
            if found.cancelled():
                answer.set_exception(TimeoutError(
                    f'{what} of {self._fabric} has not answered for {_ANSWER_WAIT_S:g} s'))
                return
            try:
                good, words = read(found.result())
            except Exception as error:  # the page shows the error
                answer.set_exception(error)
                return
            if good:
                answer.set_result(words)
            else:
                answer.set_exception(ValueError(words))

        pending = client.call_async(request)
        pending.add_done_callback(done)
        # `~/advance` may take any time.
        if client is self._parameters:
            timer = threading.Timer(_ANSWER_WAIT_S, pending.cancel)
            timer.daemon = True
            pending.add_done_callback(lambda found: timer.cancel())
            timer.start()
        return answer


class ViewerNode(Node):
    """Node that receives from one fabric, or its replay, and serves a page."""

    def __init__(self) -> None:
        """Read the parameters; raise ValueError with the name of an invalid one."""
        require_viser()
        super().__init__(VIEWER)
        options = {}
        for name, default in DEFAULTS.items():
            try:
                options[name] = self.declare_parameter(name, default).value
            except InvalidParameterTypeException as error:
                raise ValueError(
                    f'{name} must be of the type of {default!r}: {error}') from error
        if not 0 <= options['port'] < 65536:
            raise ValueError(f'port must lie in 0 to 65535, got {options["port"]}')
        if not 0.0 < options['rate'] <= 240.0:
            raise ValueError(f'rate must lie above 0 and up to 240 Hz, got {options["rate"]!r}')
        self._options, self.fabric = options, '/' + options['fabric'].strip('/')
        try:
            validate_full_topic_name(self.fabric)
        except InvalidTopicNameException:
            raise ValueError(
                'fabric must be the full name of a node, such as /icofabric, got '
                f'{options["fabric"]!r}') from None
        self.sight = Sight(self.fabric)
        self._sink = SightSink(self.sight)
        self._heard: dict[str, tuple[str, Subscription]] = {}
        self._listen_to_all()
        self.actions = NodeActions(self, self.fabric)
        self.page: Page | None = None

    def serve(self) -> None:
        """Open the page; reopen it when a replay has become a simulation or the reverse."""
        self._listen_to_all()
        is_replay = self.is_replay()
        if self.page is not None and is_replay in (None, self.actions.is_replay):
            return
        port, token = self._options['port'], ''
        if self.page is not None:
            port, token = self.page.port, self.page.token
            self.page.close()
        self.actions.is_replay = bool(is_replay)
        self.page = Page(
            self.sight, None if self._options['read_only'] else self.actions,
            host=self._options['host'], port=port, rate=self._options['rate'], token=token)
        what = f'a replay of {self.fabric}' if self.actions.is_replay else self.fabric
        self.get_logger().info(f'{what} is shown at {self.page.address}')

    def close(self) -> None:
        """Close the page."""
        if self.page is not None:
            self.page.close()

    def is_replay(self) -> bool | None:
        """Return whether the node is a replay, or None if it is not found."""
        return self.actions.finds_replay()

    def _listen_to_all(self) -> None:
        """Subscribe to the viewer topics of a run if they exist, otherwise to all its topics."""
        for topic in TOPICS:
            view = VIEWS.get(topic, topic).name.replace('~', self.fabric, 1)
            name = topic.name.replace('~', self.fabric, 1)
            wanted = view if self.count_publishers(view) else name
            heard, subscription = self._heard.get(topic.name, ('', None))
            if heard == wanted:
                continue
            self._heard[topic.name] = wanted, self._listen(topic, wanted)
            if subscription is not None:
                self.destroy_subscription(subscription)

    def _listen(self, topic: Topic, name: str) -> Subscription:
        def receive(data: Any) -> None:
            self._sink.send(topic, 0, bytes(data))

        return self.create_subscription(
            message_class(topic.type), name, receive, quality(topic), raw=True)


class _StopOrTimeout:
    """Predicate that is true after a signal or after `duration` [s]."""

    def __init__(self, signals: StopSignals, duration: float) -> None:
        self._signals, self._until = signals, time.monotonic() + duration

    def __call__(self) -> bool:
        return self._signals.received or time.monotonic() > self._until


def run_viewer(node: ViewerNode, signals: StopSignals) -> int:
    """Serve until stopped; return the exit status."""
    server, searching = Server(node), _StopOrTimeout(signals, _SEARCH_S)
    server.serve(lambda: node.is_replay() is not None or searching())
    try:
        while not signals.received:
            node.serve()
            server.serve(_StopOrTimeout(signals, _CHECK_INTERVAL_S))
    finally:
        node.close()
    return 0
