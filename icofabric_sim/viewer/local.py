# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""A run, or a replay, in this process: the data for a page and the actions of a page."""

from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
import logging
import math
import threading
from typing import Any

from icofabric_sim.messages import PointStampedBytes
from icofabric_sim.messages.frames import body_frame
from icofabric_sim.messages.input_topics import PULL
from icofabric_sim.messages.schedule import NANOSECONDS, seconds
from icofabric_sim.messages.topics import Topic, VIEWS
from icofabric_sim.parameters.table import with_kind
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.running.parameter_change import ParameterChange
from icofabric_sim.running.replay.player import Player
from icofabric_sim.running.replay.replay_parameters import judge_option
from icofabric_sim.running.run_records import Status
from icofabric_sim.running.runner import Runner
from icofabric_sim.scene.scene import Scene
from icofabric_sim.simulation.simulation import Simulation
from icofabric_sim.viewer.sight import Sight, TOPICS

_LOGGER = logging.getLogger('icofabric_sim')
_BY_NAME = {topic.name: topic for topic in TOPICS} | {
    view.name: topic for topic, view in VIEWS.items()}


class SightSink:
    """Sink that passes messages of a run, or of a replay, to a Sight."""

    is_bag = False

    def __init__(self, sight: Sight, *, is_run: bool = False) -> None:
        """Pass to `sight`; `is_run`: from a run, which publishes topics for pages."""
        self._sight = sight
        self._names = {
            (VIEWS.get(topic, topic) if is_run else topic).name for topic in TOPICS}

    def wants(self, topic: Topic) -> bool:
        """Return whether a page shows the topic."""
        return topic.name in self._names

    def send(self, topic: Topic, nanoseconds: int, data: bytes) -> None:
        """Accept a message; log and skip a malformed one."""
        # Recorded topics have their recorded descriptions.
        known = _BY_NAME.get(topic.name)
        if known is None:
            return
        try:
            self._sight.feed(known, data)
        except ValueError as error:
            _LOGGER.warning('%s cannot be shown: %s', topic.name, error)

    def send_input(self, topic: str, type_name: str, nanoseconds: int, data: bytes) -> None:
        """Ignore inputs: a page does not show them."""

    def time_jumped_back(
        self, simulation: Simulation, parameters: Parameters, ended: Status
    ) -> None:
        """Do nothing: the curves restart when time jumps."""


def _with_text(future: 'Future[Any]', words: Any) -> 'Future[str]':
    """Return a future of the text for the result of another future."""
    answer: Future[str] = Future()

    def done(found: 'Future[Any]') -> None:
        error = found.exception()
        if error is None:
            answer.set_result(words(found.result()))
        else:
            answer.set_exception(error)

    future.add_done_callback(done)
    return answer


def _timed(word: str) -> Any:
    return lambda time: f'{word}, t = {seconds(time):.9g} s'


class RunActions:
    """Control of a runner."""

    is_replay = False

    def __init__(self, runner: Runner) -> None:
        """Control `runner` from any thread."""
        self._runner = runner

    def pull(self, body: int, point: tuple[float, float, float] | None) -> None:
        """Send the message that a node would receive on `~/pull`."""
        message = PointStampedBytes(body_frame(body))
        message.point[:] = math.nan if point is None else point
        self._runner.inputs.receive(PULL, message.stamped(0))

    def command(self, name: str, on: bool | None = None) -> 'Future[str]':
        """Perform the action of the service of that name."""
        runner = self._runner
        calls: dict[str, tuple[Callable[[], Future[Any]], Any]] = {
            'pause': (partial(runner.set_paused, bool(on)), _timed('paused' if on else 'running')),
            'record': (partial(runner.set_recording, bool(on)), str),
            'step': (runner.take_steps, _timed('solver steps taken')),
            'advance': (runner.advance, _timed('advanced')),
            'reset': (runner.reset, _timed('reset to the initial state')),
            'clear_loads': (runner.clear_loads, _timed('all wrenches cleared'))}
        if name not in calls:
            raise ValueError(f'{name} is not a service of a run')
        call, words = calls[name]
        return _with_text(call(), words)

    def change(self, name: str, value: Any) -> 'Future[str]':
        """Set a parameter; the reason of a rejection is in the ValueError or in the future."""
        runner = self._runner
        before = runner.changes.wanted or runner.parameters
        wanted = before.with_changes(with_kind(name, value))
        change = ParameterChange(before, wanted, Scene.from_parameters(wanted))
        built = change.outcome
        answer: Future[str] = Future()

        def taken(done: 'Future[Any]') -> None:
            error = done.exception()
            if error is not None and not built.done():
                built.set_exception(error)

        runner.apply_change(change).add_done_callback(taken)

        def in_force(done: 'Future[str]') -> None:
            error = done.exception()
            reason = str(error) if error is not None else done.result()
            if reason:
                answer.set_exception(ValueError(reason))
            else:
                answer.set_result('')

        built.add_done_callback(in_force)
        return answer


class ReplayActions:
    """Control of a replay player."""

    is_replay = True

    def __init__(self, player: Player) -> None:
        """Control `player` from any thread."""
        self._player = player
        # Parameters of the simulation that is ready to continue the replay.
        self.continued_run: tuple[Simulation, Parameters] | None = None
        self._builds = threading.Lock()

    def pull(self, body: int, point: tuple[float, float, float] | None) -> None:
        """Do nothing: a recorded run cannot be dragged."""

    def command(self, name: str, on: bool | None = None) -> 'Future[str]':
        """Perform the action of the service of that name."""
        player = self._player
        if name == 'continue':
            return self._continue_run()
        calls: dict[str, tuple[Callable[[], Future[Any]], Any]] = {
            'pause': (partial(player.set_paused, bool(on)), _timed('paused' if on else 'running')),
            'reset': (player.reset, _timed('reset to the start')),
            'step': (player.step, _timed('stepped by one frame'))}
        if name not in calls:
            raise ValueError(
                f'{name} needs a node: play the bag with replay_node and open viewer_node')
        call, words = calls[name]
        return _with_text(call(), words)

    def _continue_run(self) -> 'Future[str]':
        """
        Rebuild the run up to the present recorded time; the future completes when it is ready.
        """
        answer: Future[str] = Future()
        if not self._builds.acquire(blocking=False):
            raise ValueError('the simulation is already being built')
        player, was_paused = self._player, self._player.paused

        def build() -> None:
            from icofabric_sim.running.replay.continuation import simulate_from
            try:
                time = player.set_paused(True).result()
                simulation, parameters = simulate_from(
                    player.source.path, player.source.fabric, time)
            except Exception as error:  # noqa: BLE001 - the page shows it
                self._builds.release()
                if not was_paused:
                    player.set_paused(False)
                answer.set_exception(ValueError(f'this run cannot be continued: {error}'))
            else:
                answer.set_result(f'continues as a simulation, t = {seconds(time):.9g} s')
                # The recorded path and duration do not apply to the new simulation.
                self.continued_run = simulation, parameters.with_changes({
                    'record.path': '', 'duration': 0.0, 'real_time_factor': player.rate,
                    'start_paused': was_paused})

        threading.Thread(target=build, name='rebuilding', daemon=True).start()
        return answer

    def change(self, name: str, value: Any) -> 'Future[str]':
        """Set the rate, the loop flag, or the time to seek."""
        player, value = self._player, judge_option(name, value)
        if name == 'seek':
            time = player.judge_time(round(value * NANOSECONDS))
            return _with_text(player.seek(time), _timed('there'))
        if name == 'rate':
            return _with_text(player.set_rate(value), lambda _: '')
        if name != 'loop':
            raise ValueError(f'{name} is fixed at the start')
        player.loop = value
        done: Future[str] = Future()
        done.set_result('')
        return done
