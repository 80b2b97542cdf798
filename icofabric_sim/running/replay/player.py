# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Playback of a recorded run in real time: pause, seek, loop and single frames; without ROS."""

from collections.abc import Callable, Iterator
from concurrent.futures import Future
import logging
from queue import Empty, SimpleQueue
import threading
import time as wall
from typing import Any, NamedTuple, Protocol

from icofabric_sim.bag import BagError
from icofabric_sim.messages import ClockBytes, MarkerAction, MarkerBytes, MarkerType, topics
from icofabric_sim.messages.schedule import NANOSECONDS, Schedule
from icofabric_sim.messages.topics import Topic
from icofabric_sim.running.real_time_factor import RealTimeFactor
from icofabric_sim.running.replay.source import describe_time, Frame, ReplaySource

_LOGGER = logging.getLogger('icofabric_sim')
# Wall time between repeated messages while the replay is paused or very slow [s].
_IDLE_REFRESH = 0.5
# Wall time after which the recorded time advances even without messages [s].
_RESPONSE = 0.02
# Wall time for which the end is shown before a loop restarts [s].
_END_SHOWN = 0.1
_REPORT_INTERVAL = 1.0


class ReplaySink(Protocol):
    """Receiver of messages."""

    def wants(self, topic: Topic) -> bool:
        """Return whether a message on `topic` would be used now."""

    def send(self, topic: Topic, nanoseconds: int, data: bytes) -> None:
        """Accept a message of recorded time `nanoseconds`."""


class ReplayStatus(NamedTuple):
    """Status of a replay for diagnostics."""

    time: int  # [ns] of recorded time
    start: int
    end: int
    paused: bool
    at_end: bool
    failure: str  # '': none
    rate: float  # recent ratio of recorded to wall time
    target_rate: float
    loops: int  # number of restarts
    sent: int  # messages with a subscriber
    recorded_report: bytes | None  # the last /diagnostics of the recorded run


class Player:
    """Player of one source; all methods except `run` are thread-safe."""

    def __init__(
        self,
        source: ReplaySource,
        sink: ReplaySink,
        *,
        begin: int | None = None,
        rate: float = 1.0,
        loop: bool = False,
        stay: bool = False,
        paused: bool = False,
        publish_clock: bool = True,
        clock_rate: float = 100.0,
        report: Callable[[ReplayStatus], bytes] | None = None,
    ) -> None:
        """
        Start at the recorded time `begin` [ns], by default at the first message.

        At the end `loop` restarts from there, `stay` pauses, otherwise `run` returns. Rate 0 is as
        fast as possible. `report` formats /diagnostics.
        """
        self.source = source
        self.begin = source.start if begin is None else begin
        self.now = self.begin
        self.rate, self.loop, self.stay = rate, loop, stay
        self.paused = paused
        self.at_end = False
        self.failure = ''
        self._sink = sink
        self._report = report
        self._clock = ClockBytes() if publish_clock else None
        self._ticks = Schedule(clock_rate)
        self._real_time = RealTimeFactor(rate)
        self._commands: SimpleQueue[tuple[Callable[[], Any], Future[Any]]] = SimpleQueue()
        self._wake = threading.Event()
        self._stopping = self._ended = False
        self._frames: Iterator[Frame] = iter(())
        self._next: Frame | None = None
        self._current: dict[Topic, Frame] = {}
        self._recorded_report: bytes | None = None
        self._loops = self._sent = 0
        self._last_shown = self._last_report = self._end_reached = 0.0

    # Thread-safe methods.

    def set_paused(self, paused: bool) -> 'Future[int]':
        """Pause or resume; the result is the recorded time [ns] of the change."""

        def act() -> int:
            self.paused = paused
            self._real_time.restart(self.now)
            return self.now

        return self._post(act)

    def seek(self, time: int) -> 'Future[int]':
        """
        Go to a recorded time [ns] and show the state; raise ValueError outside the recorded span.
        """
        return self._post(lambda: self._jump(self.judge_time(time)))

    def reset(self) -> 'Future[int]':
        """Go to the start of the replay."""
        return self._post(lambda: self._jump(self.begin))

    def step(self) -> 'Future[int]':
        """Show the next recorded poses while paused; the result is their time [ns]."""
        return self._post(self._step)

    def set_rate(self, rate: float) -> 'Future[None]':
        """Set another rate."""

        def act() -> None:
            self.rate = rate
            self._real_time.set_target(rate, self.now)

        return self._post(act)

    def judge_time(self, time: int) -> int:
        """Return `time` [ns] if it is in the recorded run."""
        source = self.source
        if not source.start <= time <= source.end:
            raise ValueError(
                f'{describe_time(time)} is not in {source.path}, which spans '
                f'{describe_time(source.start)} to {describe_time(source.end)}')
        return time

    def stop(self) -> None:
        """End `run` soon."""
        self._stopping = True
        self._wake.set()

    def status(self) -> ReplayStatus:
        """Return the present status; each value is read separately."""
        return ReplayStatus(
            self.now, self.source.start, self.source.end, self.paused, self.at_end, self.failure,
            self._real_time.measure(self.now), self.rate, self._loops, self._sent,
            self._recorded_report)

    def _post(self, command: Callable[[], Any]) -> 'Future[Any]':
        future: Future[Any] = Future()
        self._commands.put((command, future))
        self._wake.set()
        if self._ended:
            self._give_up_commands()
        return future

    # Methods for the thread of `run`.

    def run(self) -> None:
        """
        Play until stopped, or to the end unless the replay loops or stays there.

        A damaged bag also ends it, with the reason in `failure`.
        """
        try:
            self._jump(self.begin, cleared=False)
            while self._turn():
                pass
        except BagError as error:
            self.failure = str(error)
            _LOGGER.error('the replay has ended at %s: %s', describe_time(self.now), error)
        finally:
            self._ended = True
            self._give_up_commands()
        self._tell(at_once=True)

    def _turn(self) -> bool:
        """Perform the next action; return False after the last one."""
        # Cleared before the requests are read, so that later ones are not missed.
        self._wake.clear()
        if self._stopping:
            return False
        self._run_commands()
        self._tell()
        if self.paused:
            self._stand_still()
        elif self.at_end:
            return self._turn_at_end()
        else:
            self._play_on()
        return True

    def _play_on(self) -> None:
        target = self._next_target()
        delay = self._real_time.wait_time(target)
        if delay > 0.0:
            self._repeat()
            self._wake.wait(min(delay, _IDLE_REFRESH))  # any request wakes it
        else:
            self._go_to(target)

    def _turn_at_end(self) -> bool:
        shown = wall.monotonic() - self._end_reached
        if not self.loop:
            if not self.stay:
                return False
            self._stand_still()
        elif shown < _END_SHOWN:
            self._wake.wait(_END_SHOWN - shown)
        else:
            self._loops += 1
            self._jump(self.begin)
        return True

    def _next_target(self) -> int:
        times = [self.source.end if self._next is None else self._next.time]
        if self._clock is not None and self._sink.wants(topics.CLOCK):
            times.append(self._ticks.after(self.now))
        if self.rate > 0.0:
            times.append(self.now + max(1, int(self.rate * _RESPONSE * NANOSECONDS)))
        return max(min(times), self.now)

    def _go_to(self, target: int) -> None:
        self.now = target
        if self._ticks.is_due(target) or target >= self.source.end:
            self._tick()
        while self._next is not None and self._next.time <= target:
            self._show(self._next)
            self._next = next(self._frames, None)
        if self._next is None and target >= self.source.end:
            self.at_end = True
            self._end_reached = wall.monotonic()

    def _step(self) -> int:
        if not self.paused:
            raise RuntimeError(
                'steps are taken only while paused: call ~/pause with data: true first')
        found = False
        while self._next is not None and not found:
            frame, self._next = self._next, next(self._frames, None)
            self.now = max(self.now, frame.time)
            self._show(frame)
            found = not self.source.has_poses or any(
                topic.name == topics.POSES.name for topic, _ in frame.messages)
        self._tick()
        self._real_time.restart(self.now)
        if not found:
            raise RuntimeError(
                f'no poses after {describe_time(self.now)}; call ~/reset, or set the parameter '
                'seek, to go back')
        return self.now

    def _jump(self, time: int, *, cleared: bool = True) -> int:
        """Show the state at `time`; `cleared` removes the earlier markers."""
        state = self.source.state_at(time)
        self._frames = self.source.frames(time + 1)
        self._next = next(self._frames, None)
        self.now, self.at_end = time, False
        self._current.clear()
        self._tick()
        if cleared:
            self._clear_markers()
        self._show(state)
        self._real_time.restart(time)
        return time

    def _clear_markers(self) -> None:
        marker = MarkerBytes('', '', 0, MarkerType.LINE_LIST)
        for topic in self.source.topics.values():
            if topic.type == MarkerBytes.TYPE:
                self._send(topic, marker.stamped(self.now, action=MarkerAction.DELETEALL))

    def _show(self, frame: Frame) -> None:
        self._last_shown = wall.monotonic()
        begun: set[Topic] = set()
        for topic, data in frame.messages:
            if topic == topics.DIAGNOSTICS:
                self._recorded_report = data
                continue
            if self.source.lasts(topic):
                if topic not in begun:
                    begun.add(topic)
                    self._current[topic] = Frame(frame.time, [])
                self._current[topic].messages.append((topic, data))
            self._send(topic, data)

    def _send(self, topic: Topic, data: bytes) -> None:
        if self._sink.wants(topic):
            self._sink.send(topic, self.now, data)
            self._sent += 1

    def _tick(self) -> None:
        if self._clock is not None and self._sink.wants(topics.CLOCK):
            self._sink.send(topics.CLOCK, self.now, self._clock.stamped(self.now))

    def _stand_still(self) -> None:
        """Wait for a moment."""
        self._repeat()
        self._wake.wait(_IDLE_REFRESH)

    def _repeat(self) -> None:
        """Repeat a state that has not changed for long, for later subscribers."""
        if wall.monotonic() - self._last_shown < _IDLE_REFRESH:
            return
        self._last_shown = wall.monotonic()
        self._tick()
        for topic, frame in self._current.items():
            if not topic.latched:  # latched messages stay available to late subscribers
                for _, data in frame.messages:
                    self._send(topic, data)

    def _tell(self, *, at_once: bool = False) -> None:
        if self._report is None or not (
            at_once or wall.monotonic() - self._last_report >= _REPORT_INTERVAL
        ):
            return
        self._last_report = wall.monotonic()
        if self._sink.wants(topics.DIAGNOSTICS):
            self._sink.send(topics.DIAGNOSTICS, self.now, self._report(self.status()))

    def _run_commands(self) -> None:
        # Only the present requests: endless requests must not stop time.
        for _ in range(self._commands.qsize()):
            command, future = self._commands.get_nowait()
            try:
                future.set_result(command())
            except BagError as error:
                future.set_exception(error)
                raise
            except Exception as error:  # passed on in the answer
                future.set_exception(error)

    def _give_up_commands(self) -> None:
        while True:
            try:
                _, future = self._commands.get_nowait()
            except Empty:
                return
            future.set_exception(RuntimeError('the replay has ended'))
