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
The start of a node's process: its signals and its command line.

Imports next to nothing, so that a signal is heard from the start.
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
# Said by a node once its topics are there; others wait for it (node_watch.py).
READY = 'ready: '
# The ports of a domain begin at 7400 + 250 times its number.
_LARGEST_DOMAIN = 232
# Packages of ROS beside those of messages.
_ROS = ('ament_index_python', 'rclpy', 'rpyutils', 'simulation_interfaces', 'std_srvs')
_STOPPING = (signal.SIGINT, signal.SIGTERM)
# What follows the end of the bag, or is tried before the end by force, takes at most so long [s].
_REST = 5.0
_STOPPING_NUMBERS = {int(number) for number in _STOPPING}


class StopSignals:
    """
    SIGINT and SIGTERM end the node in order, once.

    rclpy's own handlers end the context under a node that still has things to say, and a second
    Ctrl-C (a launch sends one after the user's) would end the process with its bag still open.
    """

    def __init__(self, *, ends_process: bool = False) -> None:
        """
        Take the signals over, ignored ones too: a shell has its background jobs ignore SIGINT.

        `ends_process`: the process ends with the node, also by force.
        """
        self.received = False
        self._ends_at_once, self._ends_process = True, ends_process
        self._limit: _EndLimit | None = None
        for number in _STOPPING:
            signal.signal(number, self._receive)

    def only_note(self, limit: float = 20.0) -> None:
        """
        From now on a signal is only noted in `received`: there is something to end in order.

        That may take so long [s], see `_EndLimit`.
        """
        self._ends_at_once = False
        self._limit = _EndLimit(limit)

    @contextmanager
    def taking_its_time(self) -> Iterator[None]:
        """What is ended here takes as long as it takes (a bag is closed); the rest is short."""
        if self._limit is None:
            yield
            return
        self._limit.is_lifted = True
        try:
            yield
        finally:
            self._limit.begin(_REST)
            self._limit.is_lifted = False

    def save_before_force(self, save: Callable[[], None]) -> None:
        """Have `save` tried, in another thread, before the process is ended by force."""
        if self._limit is not None:
            self._limit.save = save

    def ignore(self, status: int | None = None) -> None:
        """
        From now on a signal does nothing: the process ends anyway, with its own exit status.

        With a `status`, all that is left is up to the middleware; where that takes too long, the
        process ends with it.
        """
        for number in _STOPPING:
            signal.signal(number, signal.SIG_IGN)
        if status is None:
            return
        if self._limit is None and self._ends_process:
            # It failed before there was anything to end in order.
            self._limit = _EndLimit(_REST)
        if self._limit is not None:
            self._limit.status = status
            self._limit.begin(_REST)

    def _receive(self, number: int, frame: FrameType | None) -> None:
        self.received = True
        if self._ends_at_once:
            # An exception would not do: in the middle of an import or a compilation it ends up as
            # an error of any kind, or is ignored in a finaliser.
            os._exit(INTERRUPTED)


class _EndLimit:
    """
    Ends the process by force where its end takes too long, and says where its threads stand.

    A call of the middleware can stand still, e.g. over what a subscriber that was killed has held.
    A thread of its own hears of a signal where the main thread cannot.
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
        """The end may take so long [s] from now on."""
        self._deadline = time.monotonic() + min(seconds, self._seconds)

    def _watch(self) -> None:
        heard = False
        while self.is_lifted or time.monotonic() < self._deadline:
            if select.select([self._awake], [], [], 0.5)[0]:
                stopping = not _STOPPING_NUMBERS.isdisjoint(os.read(self._awake, 64))
                if stopping and not heard:
                    heard = True
                    # What is over meanwhile has set a limit of its own.
                    if self._deadline == float('inf'):
                        self.begin(self._seconds)
        print('the end took too long: ended by force; its threads stood at',
              file=sys.stderr, flush=True)
        faulthandler.dump_traceback()
        # Whatever holds the others may hold this up too.
        saving = threading.Thread(target=self.save, name='save', daemon=True)
        saving.start()
        saving.join(_REST)
        os._exit(self.status)


def end_process(status: int) -> NoReturn:
    """
    End a process whose work is done and whose files are closed, without the destructors of C++.

    Threads of the middleware and of the compiler's libraries outlive what these take away: while
    kernels are compiled an end can be a segmentation fault, with all work done.
    """
    rclpy = sys.modules.get('rclpy')
    if rclpy is not None:
        # Others in the graph hear of the end, and shared memory is given back.
        gc.collect()
        rclpy.utilities.get_default_context().destroy()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # its reader may have ended
            stream.flush()
    os._exit(status)


@contextmanager
def importing() -> Iterator[None]:
    """
    Import without garbage collection: all of it stays, and that took a tenth of the start.

    It is left out of later collections too, which would hold up a running node. Where a package of
    ROS is missing, that is said in one line, and the process ends with status 2.
    """
    gc.disable()
    try:
        yield
    except ModuleNotFoundError as error:
        missing = (error.name or '').partition('.')[0]
        if missing in _ROS or missing.endswith('_msgs'):
            said = (
                f'nodes need ROS 2, and its package {missing} is not installed: source a ROS 2 '
                f'Jazzy installation, or have its wheels: {install_command("rclpy")}')
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
    """Refuse a ROS_DOMAIN_ID whose ports do not exist; else the middleware fails at length."""
    text = os.environ.get('ROS_DOMAIN_ID', '')
    if text.strip().isdecimal() and int(text) > _LARGEST_DOMAIN:
        raise ValueError(
            f'ROS_DOMAIN_ID is {text[:20]}, and a domain is a number from 0 to {_LARGEST_DOMAIN}; '
            'set another one')


def arguments_of_its_own(arguments: list[str]) -> list[str]:
    """Arguments outside of `--ros-args ... --`, without renamings in the old form."""
    own, for_ros = [], False
    for argument in arguments:
        if argument == '--ros-args':
            for_ros = True
        elif for_ros and argument == '--':
            for_ros = False
        elif not for_ros and ':=' not in argument:
            own.append(argument)
    return own
