# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The replay node: a player in its own thread, and its translation to the ROS graph."""

from collections.abc import Callable, Mapping
from concurrent.futures import Future
import gc
from importlib import import_module
import os
import threading
import time
from typing import Any

from icofabric_sim.bag.folder import absolute_path
from icofabric_sim.messages import topics as outputs
from icofabric_sim.messages.schedule import NANOSECONDS, seconds
from icofabric_sim.messages.topics import Topic
from icofabric_sim.ros.answers import Answers
from icofabric_sim.ros.live_sink import LiveSink, message_class
from icofabric_sim.ros.parameter_service import GuardedParameterService
from icofabric_sim.ros.process import Presence, Server
from icofabric_sim.ros.replay_continuation import ReplayContinuation
from icofabric_sim.ros.robustness.clock_watch import ClockWatch
from icofabric_sim.ros.robustness.late_answers import AnsweringNode
from icofabric_sim.ros.ros_parameters import is_foreign, restore_type
from icofabric_sim.ros.start import StopSignals
from icofabric_sim.running.replay.player import Player, ReplayStatus
from icofabric_sim.running.replay.replay_parameters import (
    begin_of,
    judge_option,
    judge_seek,
    OPTIONS,
    ReplayParameterError,
)
from icofabric_sim.running.replay.report import ReplayReport
from icofabric_sim.running.replay.source import ReplaySource
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.exceptions import InvalidTopicNameException
from rclpy.parameter import Parameter
from rclpy.validate_topic_name import validate_topic_name
from std_srvs.srv import SetBool, Trigger

# Time that the end may wait for a bag that is slow to read, and for pending answers [s].
_STOP_WAIT_S, _LAST_ANSWERS_S = 0.5, 2.0


class ReplayNode(AnsweringNode):
    """Node that translates between the ROS graph and a player, which has its own thread."""

    _player: Player | None = None

    def __init__(self, options: Mapping[str, Any], source: ReplaySource) -> None:
        """
        Play `source` with the validated `options`; raise ValueError if they do not fit the bag.
        """
        begin = begin_of(options, source.start, source.end)
        super().__init__('icofabric', start_parameter_services=False)
        self.source = source
        self._declare(options)
        self._leave_out_unknown()
        topics = {topic.name: topic for topic in source.topics.values()}
        topics[outputs.DIAGNOSTICS.name] = outputs.DIAGNOSTICS
        if options['publish_clock']:
            topics[outputs.CLOCK.name] = outputs.CLOCK
        self._live = LiveSink(self, topics.values())
        self._report = ReplayReport(self.get_fully_qualified_name(), source)
        self._player = self.player = Player(
            source,
            self._live,
            begin=begin,
            rate=options['rate'],
            loop=options['loop'],
            stay=options['stay'],
            paused=options['start_paused'],
            publish_clock=options['publish_clock'],
            clock_rate=options['clock_rate'],
            report=self._diagnose,
        )
        self._clock_watch = ClockWatch(self) if options['publish_clock'] else None
        self.answers = Answers(self)
        self._parameter_service = GuardedParameterService(self, self.answers)
        self.continuation: ReplayContinuation | None = None
        self.hands_over = False  # to the simulation once that is ready
        # Other callbacks run while a request waits for its answer.
        group = ReentrantCallbackGroup()
        self.create_service(SetBool, '~/pause', self._pause, callback_group=group)
        self.create_service(Trigger, '~/reset', self._reset, callback_group=group)
        self.create_service(Trigger, '~/step', self._step, callback_group=group)
        self.create_service(Trigger, '~/continue', self._continue, callback_group=group)
        seek = _seek_class()
        if seek is not None:
            self.create_service(seek, '~/seek', self._seek, callback_group=group)
        self._thread = threading.Thread(target=self._play, name='replay', daemon=True)

    def start(self) -> None:
        """Start to play."""
        self._thread.start()

    def is_over(self) -> bool:
        """Return whether the replay has ended or hands over to a simulation."""
        return self.hands_over or not self._thread.is_alive()

    def close(self) -> None:
        """Stop playing and close the bag; a second call has no effect."""
        self.player.stop()
        if self.continuation is not None:
            self.continuation.is_cancelled = True
        if self._thread.is_alive():
            self._thread.join(_STOP_WAIT_S)
        self.answers.end('the replay has ended')
        self._live.close()
        if not self._thread.is_alive():
            self.source.close()

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Validate a change before rclpy applies it; both set_parameters services call it."""
        if self._player is None:
            return super().set_parameters_atomically(parameter_list)
        try:
            changes = {
                parameter.name: self._judge(parameter)
                for parameter in parameter_list if not is_foreign(parameter.name)}
        except ReplayParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        result = super().set_parameters_atomically([
            Parameter(parameter.name, value=changes[parameter.name])
            if parameter.name in changes else parameter for parameter in parameter_list])
        if result.successful:
            for name, value in changes.items():
                self._apply(name, value)
        return result

    def _judge(self, parameter: Parameter) -> Any:
        name = parameter.name
        value = parameter.value
        if name in OPTIONS:
            value = restore_type(value, OPTIONS[name].default)
        value = judge_option(name, value)
        if not OPTIONS[name].live:
            raise ReplayParameterError(
                f'{name} cannot be changed while the node runs; restart the node to change it')
        if name == 'seek':
            judge_seek(value, self.source.start, self.source.end)
        return value

    def _apply(self, name: str, value: Any) -> None:
        player = self.player
        if name == 'rate':
            player.set_rate(value)
        elif name == 'seek':
            player.seek(judge_seek(value, self.source.start, self.source.end))
        else:
            setattr(player, name, value)

    def _declare(self, options: Mapping[str, Any]) -> None:
        for name, option in OPTIONS.items():
            descriptor = ParameterDescriptor(
                name=name, description=option.description, read_only=not option.live)
            if option.minimum is not None and option.maximum is not None:
                descriptor.floating_point_range = [FloatingPointRange(
                    from_value=option.minimum, to_value=option.maximum, step=0.0)]
            self.declare_parameter(name, options[name], descriptor, ignore_override=True)

    def _leave_out_unknown(self) -> None:
        for name, topic in list(self.source.topics.items()):
            reason = _publishing_error(topic)
            if reason:
                self.source.leave_out(name)
                self.get_logger().warning(f'{name} is not played: {reason}')

    def _diagnose(self, status: ReplayStatus) -> bytes:
        notes = {'messages not taken in time': str(self._live.not_taken)}
        if self.continuation is not None:
            notes['simulated again up to [s]'] = f'{seconds(self.continuation.reached):.9f}'
        warning = '' if self._clock_watch is None else self._clock_watch.note
        return self._report.message(status, notes, warning)

    def _play(self) -> None:
        try:
            self.player.run()
        except Exception as error:  # the node must report the error
            self.player.failure = f'the replay has ended: {error!r}'
            self.get_logger().fatal(self.player.failure)
        self.answers.hand_over(lambda: None)  # wakes the executor to notice the end

    async def _pause(
        self, request: SetBool.Request, response: SetBool.Response
    ) -> SetBool.Response:
        word = 'paused' if request.data else 'running'
        return await self._answer(
            lambda: self.player.set_paused(request.data), response, word)

    async def _reset(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        return await self._answer(self.player.reset, response, 'reset to the start')

    async def _step(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        return await self._answer(self.player.step, response, 'stepped to the next poses')

    async def _seek(self, request: Any, response: Any) -> Any:
        time = request.time.sec * NANOSECONDS + request.time.nanosec
        try:
            await self.answers.of(lambda: self.player.seek(time))
            response.success = True
        except Exception as error:  # the node continues after any error
            self.get_logger().error(str(error))  # the response has no field for a reason
            response.success = False
        return response

    async def _continue(
        self, request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        """Simulate the run again up to the present recorded time, and continue from there."""
        if self.continuation is not None:
            response.success, response.message = False, 'the simulation is already being built'
            return response
        path = str(self.get_parameter('record.path').value)
        if path and os.path.lexists(absolute_path(path)):
            response.success = False
            response.message = (
                f'record.path: {path} exists and is never overwritten; restart with another path')
            return response
        was_paused = self.player.paused
        self.continuation = continuation = ReplayContinuation(
            self.source.path, self.source.fabric, was_paused)
        try:
            time = await self.answers.of(lambda: self.player.set_paused(True))
            await self.answers.of(lambda: continuation.build(time))
        except Exception as error:  # noqa: BLE001 - the client gets the reason
            self.continuation = None
            if not was_paused:
                self.player.set_paused(False)
            response.success, response.message = False, f'this run cannot be continued: {error}'
        else:
            self.hands_over = response.success = True
            response.message = f'continues as a simulation, t = {seconds(time):.9f} s'
        return response

    async def _answer(
        self, begin: 'Callable[[], Future[int]]', response: Any, word: str
    ) -> Any:
        try:
            time = await self.answers.of(begin)
        except Exception as error:  # noqa: BLE001 - the client gets the reason
            response.success, response.message = False, str(error)
        else:
            response.success, response.message = True, f'{word}, t = {seconds(time):.9f} s'
        return response


def _publishing_error(topic: Topic) -> str:
    """Return why a recorded topic cannot be published; '' if it can."""
    try:
        validate_topic_name(topic.name)
        message_class(topic.type)
    except InvalidTopicNameException as error:
        return f'not a topic name: {error}'
    except (ImportError, AttributeError, ValueError):
        return f'its type {topic.type} is not installed'
    return ''


def _seek_class() -> Any:
    """Return the standard service type for seeking, or None if it is not installed."""
    try:
        return import_module('rosbag2_interfaces.srv').Seek
    except ImportError:
        return None


def run_replay(node: ReplayNode, options: Mapping[str, Any], signals: StopSignals) -> int:
    """
    Run a replay, and the simulation that may continue it, to the end; return the exit status.
    """
    _log_bag_contents(node)
    server = Server(node)
    gc.freeze()  # a garbage collection over imported objects would block the node
    node.start()
    try:
        server.serve(lambda: signals.received or node.is_over())
    finally:
        node.close()
    # Pending requests get an answer: no result will come.
    deadline = time.monotonic() + _LAST_ANSWERS_S
    server.serve(lambda: not node.answers or time.monotonic() > deadline)
    ends = signals.received or not node.hands_over or node.continuation is None
    status = 1 if node.player.failure else 0
    if ends:
        signals.ignore(status)
    # Without this node the participant would leave the graph, and the subscribers would need
    # seconds to discover the next one.
    presence = None if ends else Presence()
    node.destroy_node()
    gc.freeze()  # the end of the process runs one more garbage collection
    if presence is None or node.continuation is None:
        return status
    return node.continuation.run(options, node.player.rate, signals, presence)


def _log_bag_contents(node: ReplayNode) -> None:
    source, logger = node.source, node.get_logger()
    logger.info(
        f'playing {source.path}: {len(source.topics)} topics of {source.fabric}, '
        f't = {seconds(source.start):.9g} s to {seconds(source.end):.9g} s')
    if source.lacks:
        logger.warning(source.lacks)
    others = [name for name in source.fabrics if name != source.fabric]
    if others:
        logger.warning(
            f'this bag also holds {", ".join(others)}; the parameter fabric selects the fabric '
            'to play')
    elif source.left_out:
        logger.info(
            f'not played, because not topics of {source.fabric}: {", ".join(source.left_out)}; '
            '`ros2 bag play` plays all topics')
