# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Resending of service answers that were not delivered: a client may ask before it is discovered.

Requests and answers are two topics. Under load a request can arrive before this process has
discovered the reader of its answers. The middleware waits 0.1 s for it, rclpy warns that the
client will not receive a response, and the client waits for ever.
"""

from collections import deque
from collections.abc import Callable
import threading
from typing import Any
import warnings

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile

# Start of rclpy's warning in this case; the middleware has sent nothing.
_UNSENT = 'failed to send response'
# Interval between attempts [s], and their largest number.
_RETRY_S, _MAX_TRIES = 0.1, 50
# Requests that a service holds until they are taken, as parameter services do. The default of 10
# in rclpy lost all but 10 to 17 of a burst of 160 requests.
_QUEUE_DEPTH = 1000


class _Unsent:
    """Detector of unsent answers, by the warnings of this process."""

    def __init__(self) -> None:
        self._threads: set[int] = set()
        self._show = warnings.showwarning
        # Show every warning, not only the first one of each line.
        warnings.filterwarnings('always', _UNSENT, RuntimeWarning)
        warnings.showwarning = self._record_warning

    def during(self, send: Callable[[], None]) -> bool:
        """Call `send` and return whether it failed to send."""
        thread = threading.get_ident()
        self._threads.discard(thread)
        send()
        return thread in self._threads

    def _record_warning(
        self, message: Warning | str, category: type[Warning], *where: Any, **more: Any
    ) -> None:
        if str(message).startswith(_UNSENT):
            self._threads.add(threading.get_ident())
        else:
            self._show(message, category, *where, **more)


_unsent: _Unsent | None = None


class LateAnswers:
    """Queue that resends answers of a node's services until their clients can be reached."""

    def __init__(self, node: Node) -> None:
        """Resend for the services of `node`; use from its executor's thread."""
        global _unsent
        _unsent = _unsent or _Unsent()
        self._detector = _unsent
        self._node = node
        self._waiting: deque[tuple[Callable[[], None], int]] = deque()
        self._timer: Any = None

    def watch(self, service: Any) -> None:
        """Resend answers of `service` that fail to be sent."""
        send = service.send_response

        def send_response(response: Any, header: Any) -> None:
            self._send(lambda: send(response, header), _MAX_TRIES)

        service.send_response = send_response

    def _send(self, send: Callable[[], None], tries: int) -> None:
        if not self._detector.during(send):
            return
        if not tries:
            self._node.get_logger().warning(
                f'a client could not be reached within {_MAX_TRIES * _RETRY_S:g} s: it gets no '
                'answer')
            return
        self._waiting.append((send, tries - 1))
        if self._timer is None:
            self._timer = self._node.create_timer(
                _RETRY_S, self._send_waiting, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _send_waiting(self) -> None:
        self._node.destroy_timer(self._timer)
        self._timer = None
        for _ in range(len(self._waiting)):
            self._send(*self._waiting.popleft())


class AnsweringNode(Node):
    """Node whose services resend undelivered answers and hold a burst of requests."""

    _late: LateAnswers | None = None

    def create_service(self, *arguments: Any, **words: Any) -> Any:
        """Create a service like rclpy, with a queue of `_QUEUE_DEPTH` requests and answers."""
        words.setdefault('qos_profile', QoSProfile(depth=_QUEUE_DEPTH))
        service = super().create_service(*arguments, **words)
        if self._late is None:
            self._late = LateAnswers(self)
        self._late.watch(service)
        return service
