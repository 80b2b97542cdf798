# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
A node as a process: its start, its signals, its log, and a spin that no request can end.
"""

from collections.abc import Callable
import logging
import os
import re
import signal
from types import FrameType

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

# How long a signal, or the end of the run, may wait to be seen [s].
_SPIN_WAIT = 0.1
INTERRUPTED = 130  # exit status
_STOPPING = (signal.SIGINT, signal.SIGTERM)
# Where rcl reports an error from: of no use to a user.
_RCL_PLACE = re.compile(r', at /[^,]*\.c:[0-9]+')


class StopSignals:
    """
    SIGINT and SIGTERM end the node in order, once.

    rclpy's own handlers end the context under a node that still has things to say, and a second
    Ctrl-C (a launch sends one after the user's) would end the process with its bag still open.
    """

    def __init__(self) -> None:
        """
        Take the signals over; one that was ignored at the start of the process stays ignored.
        """
        self.received = False
        self._ends_at_once = True
        for number in _STOPPING:
            if signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, self._receive)

    def only_note(self) -> None:
        """
        From now on a signal is only noted in `received`: there is something to end in order.
        """
        self._ends_at_once = False

    def ignore(self) -> None:
        """
        From now on a signal does nothing: the process ends anyway, with its own exit status.
        """
        for number in _STOPPING:
            signal.signal(number, signal.SIG_IGN)

    def _receive(self, number: int, frame: FrameType | None) -> None:
        self.received = True
        if self._ends_at_once:
            # An exception would not do: in the middle of a compilation it ends up as an error of
            # any kind, or is ignored in a finaliser.
            os._exit(INTERRUPTED)


def start_ros(arguments: list[str]) -> None:
    """
    Begin with ROS; a command line that it does not take is a ValueError.
    """
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        raise ValueError(f'command line: {plain_reason(error)}') from error


def plain_reason(error: BaseException) -> str:
    """
    What an error of rcl says to a user.
    """
    if type(error).__name__ == 'UnknownROSArgsError':
        return f'unknown ROS arguments: {error}'
    return ' '.join(_RCL_PLACE.sub('', str(error)).split())


class RosLogHandler(logging.Handler):
    """
    Lines of the ROS-free part go to the node's log.
    """

    def emit(self, record: logging.LogRecord) -> None:
        # A line for each severity: rclpy holds every call site to the first one it sees there.
        logger, text = get_logger('icofabric'), record.getMessage()
        if record.levelno >= logging.ERROR:
            logger.error(text)
        elif record.levelno >= logging.WARNING:
            logger.warning(text)
        else:
            logger.info(text)


def log_to_ros() -> None:
    """
    Send the log of the ROS-free part to ROS.
    """
    log = logging.getLogger('icofabric_sim')
    log.addHandler(RosLogHandler())
    log.setLevel(logging.INFO)
    log.propagate = False


def spin(node: Node, is_over: Callable[[], bool]) -> None:
    """
    Serve the graph until the context ends or `is_over`; what a client sends cannot end it.
    """
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while rclpy.ok() and not is_over():
        try:
            executor.spin_once(timeout_sec=_SPIN_WAIT)
        except (KeyboardInterrupt, ExternalShutdownException):
            return
        except Exception as error:  # noqa: BLE001 - e.g. a text that is not UTF-8
            if rclpy.ok():
                node.get_logger().error(f'a request could not be handled: {error!r}')
