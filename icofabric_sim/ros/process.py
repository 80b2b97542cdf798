# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A node's process: ROS start, log, and an executor that survives errors in callbacks."""

from collections.abc import Callable, Iterable
import logging
import os
import re
import time

from icofabric_sim.ros.robustness.shared_memory import SharedMemory
from icofabric_sim.ros.start import INTERRUPTED, non_ros_arguments, StopSignals
from icofabric_sim.running.rate_limited_log import RateLimitedLog, shortened
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.logging import get_logger, LoggingSeverity
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

__all__ = [
    'non_ros_arguments',
    'INTERRUPTED',
    'log_to_ros',
    'plain_reason',
    'Presence',
    'Server',
    'spin',
    'start_ros',
    'StopSignals',
]

# Longest delay before a signal, or the end of the run, is noticed [s].
_SPIN_WAIT_S = 0.1
# Source location in an error of rcl: of no use to a user.
_RCL_SOURCE_LOCATION = re.compile(r', at /[^,]*\.c:[0-9]+')
# Requested before the first node, which reads the profile.
_shared_memory: SharedMemory | None = None


def start_ros(arguments: list[str], notices: Iterable[str] = ()) -> None:
    """
    Start ROS and its log, and log the `notices` as warnings.

    Raises ValueError for a command line that ROS rejects.
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
    Node that joins the graph early, so that discovery runs while modules are imported.

    Its name begins with an underscore, so tools do not list it.
    """

    def __init__(self) -> None:
        """Join the graph; `start_ros` must have been called."""
        self.begun = time.monotonic()
        self._node = Node(
            f'_icofabric_{os.getpid()}', use_global_arguments=False, enable_rosout=False,
            start_parameter_services=False,
            parameter_overrides=[Parameter('start_type_description_service', value=False)])

    def end(self) -> None:
        """Leave the graph to the main node; both share one participant."""
        self._node.destroy_node()


def plain_reason(error: BaseException) -> str:
    """Return an error of rcl in words for a user."""
    if type(error).__name__ == 'UnknownROSArgsError':
        return f'unknown ROS arguments: {error}'
    return shortened(' '.join(_RCL_SOURCE_LOCATION.sub('', str(error)).split()))


class RosLogHandler(logging.Handler):
    """
    Handler that forwards the log of ROS-free code to a node's log, with its place in the source.
    """

    def __init__(self, logger: RcutilsLogger) -> None:
        """Forward to `logger`."""
        super().__init__()
        self._logger = logger

    def emit(self, record: logging.LogRecord) -> None:
        # Bypass the methods of the logger, which search for that place: the first call of one
        # reads the files of all modules, a tenth of a node's start.
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
    """Send the log of ROS-free code to ROS, under the name of a node once there is one."""
    log = logging.getLogger('icofabric_sim')
    for handler in [item for item in log.handlers if isinstance(item, RosLogHandler)]:
        log.removeHandler(handler)
    log.addHandler(RosLogHandler(logger or get_logger('icofabric')))
    log.setLevel(logging.INFO)
    log.propagate = False


class Server:
    """Executor of one node that continues after errors in callbacks."""

    def __init__(self, node: Node) -> None:
        """Prepare to serve `node`."""
        if _shared_memory is not None:
            _shared_memory.close()
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(node)
        self._errors = RateLimitedLog(node.get_logger().error)

    def serve(self, is_over: Callable[[], bool]) -> None:
        """Serve until the context ends or `is_over` returns True."""
        while rclpy.ok() and not is_over():
            try:
                self._executor.spin_once(timeout_sec=_SPIN_WAIT_S)
            except (KeyboardInterrupt, ExternalShutdownException):
                return
            except Exception as error:  # noqa: BLE001 - e.g. a text that is not UTF-8
                if rclpy.ok():
                    self._errors.log(
                        type(error).__name__, f'a callback failed: {error!r}')


def spin(node: Node, is_over: Callable[[], bool]) -> None:
    """Serve the graph for `node` until the context ends or `is_over` returns True."""
    Server(node).serve(is_over)
