# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""
Answers that went nowhere, sent again: a client asks before its way back is known.

Requests and answers are two topics. Under load a request can arrive before this process has found
the reader of its answers; the middleware waits 0.1 s for it, rclpy says in a warning that the
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

# What rclpy says then; the middleware has sent nothing.
_UNSENT = 'failed to send response'
# It is tried again after so long [s], so many times.
_AGAIN, _TRIES = 0.1, 50
# Requests that a service holds until they are taken, as those of parameters do. The 10 of rclpy
# lost all but 10 to 17 of a burst of 160.
_QUEUE = 1000


class _Unsent:
    """Hears of answers that were not sent, by the warnings of this process."""

    def __init__(self) -> None:
        self._threads: set[int] = set()
        self._show = warnings.showwarning
        # Not only the first one from each line.
        warnings.filterwarnings('always', _UNSENT, RuntimeWarning)
        warnings.showwarning = self._hear

    def during(self, send: Callable[[], None]) -> bool:
        """Whether `send` has sent nothing."""
        thread = threading.get_ident()
        self._threads.discard(thread)
        send()
        return thread in self._threads

    def _hear(
        self, message: Warning | str, category: type[Warning], *where: Any, **more: Any
    ) -> None:
        if str(message).startswith(_UNSENT):
            self._threads.add(threading.get_ident())
        else:
            self._show(message, category, *where, **more)


_unsent: _Unsent | None = None


class LateAnswers:
    """Sends what a service of a node could not send until its client can be reached."""

    def __init__(self, node: Node) -> None:
        """For the services of `node`; of its executor's thread."""
        global _unsent
        _unsent = _unsent or _Unsent()
        self._heard = _unsent
        self._node = node
        self._waiting: deque[tuple[Callable[[], None], int]] = deque()
        self._timer: Any = None

    def watch(self, service: Any) -> None:
        """Have the answers of a `service` sent again where they were not."""
        send = service.send_response

        def send_response(response: Any, header: Any) -> None:
            self._send(lambda: send(response, header), _TRIES)

        service.send_response = send_response

    def _send(self, send: Callable[[], None], tries: int) -> None:
        if not self._heard.during(send):
            return
        if not tries:
            self._node.get_logger().warning(
                f'a client could not be reached for {_TRIES * _AGAIN:g} s and more: it gets no '
                'answer')
            return
        self._waiting.append((send, tries - 1))
        if self._timer is None:
            self._timer = self._node.create_timer(
                _AGAIN, self._send_waiting, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _send_waiting(self) -> None:
        self._node.destroy_timer(self._timer)
        self._timer = None
        for _ in range(len(self._waiting)):
            self._send(*self._waiting.popleft())


class AnsweringNode(Node):
    """A node all of whose services do so, and hold a burst of requests."""

    _late: LateAnswers | None = None

    def create_service(self, *arguments: Any, **words: Any) -> Any:
        """As rclpy does, with room for `_QUEUE` requests and answers."""
        words.setdefault('qos_profile', QoSProfile(depth=_QUEUE))
        service = super().create_service(*arguments, **words)
        if self._late is None:
            self._late = LateAnswers(self)
        self._late.watch(service)
        return service
