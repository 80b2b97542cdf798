# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Start of a node's process: signals and command line.

This module imports little, so that signals are handled from the start.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import faulthandler
import gc
import os
import select
import signal
import sys
import threading
import time
from types import FrameType
from typing import NoReturn

from icofabric_sim.libraries import install_command

FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130  # exit statuses
# Printed by a node once its topics exist; other processes wait for it (robustness/node_watch.py).
READY = 'ready: '
# The ports of a domain begin at 7400 + 250 times its number.
_MAX_DOMAIN_ID = 232
# ROS packages other than message packages.
_ROS_PACKAGES = ('ament_index_python', 'rclpy', 'rpyutils', 'simulation_interfaces', 'std_srvs')
_STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM)
# Time for the work after the bag is closed, and for the attempt to save before a forced end [s].
_FINAL_WORK_S = 5.0
_STOP_SIGNAL_NUMBERS = {int(number) for number in _STOP_SIGNALS}


class StopSignals:
    """
    Handlers of SIGINT and SIGTERM for one orderly end of the node.

    rclpy's handlers shut down the context while the node still has to publish. `ros2 launch` sends
    a second SIGINT after the user's Ctrl-C, which would end the process before its bag is closed.
    """

    def __init__(self, *, ends_process: bool = False) -> None:
        """
        Install the handlers, also for ignored signals: a shell lets background jobs ignore SIGINT.

        `ends_process`: the process ends with the node, and may be ended by force.
        """
        self.received = False
        self._ends_at_once, self._ends_process = True, ends_process
        self._limit: _ShutdownWatchdog | None = None
        for number in _STOP_SIGNALS:
            signal.signal(number, self._receive)

    def record_only(self, limit: float = 20.0) -> None:
        """
        Only record signals in `received` from now on, because an orderly end is needed.

        That end may take `limit` [s], see `_ShutdownWatchdog`.
        """
        self._ends_at_once = False
        self._limit = _ShutdownWatchdog(limit)

    @contextmanager
    def without_limit(self) -> Iterator[None]:
        """Lift the time limit while a bag is being closed; then limit the rest of the end."""
        if self._limit is None:
            yield
            return
        self._limit.is_lifted = True
        try:
            yield
        finally:
            self._limit.begin(_FINAL_WORK_S)
            self._limit.is_lifted = False

    def save_before_force(self, save: Callable[[], None]) -> None:
        """Call `save` in another thread before the process is ended by force."""
        if self._limit is not None:
            self._limit.save = save

    def ignore(self, status: int | None = None) -> None:
        """
        Ignore signals from now on: the process ends with its own exit status.

        Give a `status` once only the middleware remains to shut down. If the shutdown takes too
        long, the process is ended with this status.
        """
        for number in _STOP_SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        if status is None:
            return
        if self._limit is None and self._ends_process:
            # It failed before there was anything to close.
            self._limit = _ShutdownWatchdog(_FINAL_WORK_S)
        if self._limit is not None:
            self._limit.status = status
            self._limit.begin(_FINAL_WORK_S)

    def _receive(self, number: int, frame: FrameType | None) -> None:
        self.received = True
        if self._ends_at_once:
            # An exception is no alternative: during an import or a compilation it becomes an
            # unrelated error, or is ignored in a finaliser.
            os._exit(INTERRUPTED)


class _ShutdownWatchdog:
    """
    Watchdog that ends the process by force after a time limit and prints its thread stacks.

    A call of the middleware can block, e.g. because of data that a killed subscriber had locked. A
    separate thread receives a signal even if the main thread is blocked.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds, self._deadline = seconds, float('inf')
        self.is_lifted, self.status = False, FAILED
        self.save: Callable[[], None] = lambda: None
        self._awake, wakeup = os.pipe()
        os.set_blocking(wakeup, False)
        signal.set_wakeup_fd(wakeup, warn_on_full_buffer=False)
        threading.Thread(target=self._watch, name='end', daemon=True).start()

    def begin(self, seconds: float) -> None:
        """Limit the end to `seconds` [s] from now on."""
        self._deadline = time.monotonic() + min(seconds, self._seconds)

    def _watch(self) -> None:
        heard = False
        while self.is_lifted or time.monotonic() < self._deadline:
            if select.select([self._awake], [], [], 0.5)[0]:
                stopping = not _STOP_SIGNAL_NUMBERS.isdisjoint(os.read(self._awake, 64))
                if stopping and not heard:
                    heard = True
                    # A phase that has ended meanwhile has set its own limit.
                    if self._deadline == float('inf'):
                        self.begin(self._seconds)
        print('shutdown took too long: process ended by force; stacks of its threads:',
              file=sys.stderr, flush=True)
        faulthandler.dump_traceback()
        # Saving may block for the same reason as the other threads.
        saving = threading.Thread(target=self.save, name='save', daemon=True)
        saving.start()
        saving.join(_FINAL_WORK_S)
        os._exit(self.status)


def end_process(status: int) -> NoReturn:
    """
    End a process whose files are closed, without running C++ destructors.

    At a normal exit destructors delete objects that threads of the middleware and the compiler
    still use, which can crash the process after all work is done.
    """
    rclpy = sys.modules.get('rclpy')
    if rclpy is not None:
        # Announces the end to the graph, and releases shared memory.
        gc.collect()
        rclpy.utilities.get_default_context().destroy()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # its reader may have ended
            stream.flush()
    os._exit(status)


@contextmanager
def import_without_gc() -> Iterator[None]:
    """
    Import without garbage collection, which slows imports down.

    Imported objects are also excluded from later collections, which would delay a running node. If
    a package is missing, print one line and end the process with status 2.
    """
    gc.disable()
    try:
        yield
    except ModuleNotFoundError as error:
        missing = (error.name or '').partition('.')[0]
        if missing in _ROS_PACKAGES or missing.endswith('_msgs'):
            said = (
                f'nodes need ROS 2, but the package {missing} is not installed: source a ROS 2 '
                f'Jazzy installation, or install its wheels: {install_command("rclpy")}')
        elif missing != 'icofabric_sim':
            said = f'{missing} is not installed: {install_command(missing)}'
        else:
            raise
        print(said, file=sys.stderr)
        raise SystemExit(BAD_INPUT) from None
    finally:
        gc.freeze()
        gc.enable()


def check_domain() -> None:
    """Reject a ROS_DOMAIN_ID without valid ports; the error of the middleware is unclear."""
    text = os.environ.get('ROS_DOMAIN_ID', '')
    if text.strip().isdecimal() and int(text) > _MAX_DOMAIN_ID:
        raise ValueError(
            f'ROS_DOMAIN_ID is {text[:20]}, but must be a number from 0 to {_MAX_DOMAIN_ID}; '
            'set it to one of these')


def non_ros_arguments(arguments: list[str]) -> list[str]:
    """
    Return the arguments outside of `--ros-args ... --`, except remapping rules `name:=value`.
    """
    own, for_ros = [], False
    for argument in arguments:
        if argument == '--ros-args':
            for_ros = True
        elif for_ros and argument == '--':
            for_ros = False
        elif not for_ros and ':=' not in argument:
            own.append(argument)
    return own
