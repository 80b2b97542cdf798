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
"""A node as a process: its start, its signals, its log, and a spin that no request can end."""

from collections.abc import Callable, Iterable
import logging
import os
import re
import time

from icofabric_sim.ros.shared_memory import SharedMemory
from icofabric_sim.ros.start import arguments_of_its_own, INTERRUPTED, StopSignals
from icofabric_sim.running.complaints import Complaints, shortened
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.logging import get_logger, LoggingSeverity
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

__all__ = [
    'arguments_of_its_own',
    'INTERRUPTED',
    'log_to_ros',
    'plain_reason',
    'Presence',
    'Server',
    'spin',
    'start_ros',
    'StopSignals',
]

# How long a signal, or the end of the run, may wait to be seen [s].
_SPIN_WAIT = 0.1
# Where rcl reports an error from: of no use to a user.
_RCL_PLACE = re.compile(r', at /[^,]*\.c:[0-9]+')
# Asked for before the first node, which reads the request.
_shared_memory: SharedMemory | None = None


def start_ros(arguments: list[str], notices: Iterable[str] = ()) -> None:
    """
    Begin with ROS and its log, which gets the `notices` as warnings.

    A command line that ROS does not take is a ValueError.
    """
    global _shared_memory
    _shared_memory = SharedMemory()
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        raise ValueError(f'command line: {plain_reason(error)}') from error
    log_to_ros()
    for notice in notices:
        logging.getLogger('icofabric_sim').warning('%s', notice)


class Presence:
    """
    This process in the graph before its node is there: others are found while modules are loaded.

    By a node that tools do not list, since its name begins with an underscore.
    """

    def __init__(self) -> None:
        """Join the graph; `start_ros` was called."""
        self.begun = time.monotonic()
        self._node = Node(
            f'_icofabric_{os.getpid()}', use_global_arguments=False, enable_rosout=False,
            start_parameter_services=False,
            parameter_overrides=[Parameter('start_type_description_service', value=False)])

    def end(self) -> None:
        """Leave it to the node; the participant in the graph is the same."""
        self._node.destroy_node()


def plain_reason(error: BaseException) -> str:
    """What an error of rcl says to a user."""
    if type(error).__name__ == 'UnknownROSArgsError':
        return f'unknown ROS arguments: {error}'
    return shortened(' '.join(_RCL_PLACE.sub('', str(error)).split()))


class RosLogHandler(logging.Handler):
    """Lines of the ROS-free part go to a node's log, with their place in the source."""

    def __init__(self, logger: RcutilsLogger) -> None:
        """Hand on to `logger`."""
        super().__init__()
        self._logger = logger

    def emit(self, record: logging.LogRecord) -> None:
        # Below the methods of the logger, which look for that place by themselves: the first call
        # of one goes through the files of all modules, a tenth of a node's start.
        severity = LoggingSeverity.INFO
        if record.levelno >= logging.ERROR:
            severity = LoggingSeverity.ERROR
        elif record.levelno >= logging.WARNING:
            severity = LoggingSeverity.WARN
        if self._logger.is_enabled_for(severity):
            rclpy_implementation.rclpy_logging_rcutils_log(
                severity, self._logger.name, record.getMessage(), record.funcName or '',
                record.pathname, record.lineno)


def log_to_ros(logger: RcutilsLogger | None = None) -> None:
    """Send the log of the ROS-free part to ROS, under the name of a node once there is one."""
    log = logging.getLogger('icofabric_sim')
    for handler in [item for item in log.handlers if isinstance(item, RosLogHandler)]:
        log.removeHandler(handler)
    log.addHandler(RosLogHandler(logger or get_logger('icofabric')))
    log.setLevel(logging.INFO)
    log.propagate = False


class Server:
    """Serves the graph for one node; what a client sends cannot end it."""

    def __init__(self, node: Node) -> None:
        """Make ready to serve `node`."""
        if _shared_memory is not None:
            _shared_memory.close()
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(node)
        self._complaints = Complaints(node.get_logger().error)

    def serve(self, is_over: Callable[[], bool]) -> None:
        """Go on until the context ends or `is_over`."""
        while rclpy.ok() and not is_over():
            try:
                self._executor.spin_once(timeout_sec=_SPIN_WAIT)
            except (KeyboardInterrupt, ExternalShutdownException):
                return
            except Exception as error:  # noqa: BLE001 - e.g. a text that is not UTF-8
                if rclpy.ok():
                    self._complaints.add(
                        type(error).__name__, f'a request could not be handled: {error!r}')


def spin(node: Node, is_over: Callable[[], bool]) -> None:
    """Serve the graph for `node` until the context ends or `is_over`."""
    Server(node).serve(is_over)
