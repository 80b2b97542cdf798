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
"""A run, or a replay, in this process: what a page sees of it, and what it can do to it."""

from collections.abc import Callable
from concurrent.futures import Future
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
    """Hands messages to a Sight: of a run, or of a replay."""

    is_bag = False

    def __init__(self, sight: Sight, *, is_run: bool = False) -> None:
        """Feed `sight`; `is_run`: of a run, which has topics for pages."""
        self._sight = sight
        self._names = {
            (VIEWS.get(topic, topic) if is_run else topic).name for topic in TOPICS}

    def wants(self, topic: Topic) -> bool:
        """Whether a page shows the topic."""
        return topic.name in self._names

    def send(self, topic: Topic, nanoseconds: int, data: bytes) -> None:
        """Take a message; what is malformed is said and left out."""
        # Those of a record are described as they were recorded.
        known = _BY_NAME.get(topic.name)
        if known is None:
            return
        try:
            self._sight.feed(known, data)
        except ValueError as error:
            _LOGGER.warning('%s cannot be shown: %s', topic.name, error)

    def send_input(self, topic: str, type_name: str, nanoseconds: int, data: bytes) -> None:
        """Inputs are not shown."""

    def time_jumped_back(
        self, simulation: Simulation, parameters: Parameters, ended: Status
    ) -> None:
        """Curves begin anew by themselves."""


def _then(future: 'Future[Any]', words: Any) -> 'Future[str]':
    """A future of the words for the result of another."""
    answer: Future[str] = Future()

    def done(found: 'Future[Any]') -> None:
        error = found.exception()
        if error is None:
            answer.set_result(words(found.result()))
        else:
            answer.set_exception(error)

    future.add_done_callback(done)
    return answer


def _at(word: str) -> Any:
    return lambda time: f'{word}, t = {seconds(time):.9g} s'


class RunHands:
    """Does it to a runner."""

    is_replay = False

    def __init__(self, runner: Runner) -> None:
        """Act on `runner`, from any thread."""
        self._runner = runner

    def pull(self, body: int, point: tuple[float, float, float] | None) -> None:
        """Send what a node would get on `~/pull`."""
        message = PointStampedBytes(body_frame(body))
        message.point[:] = math.nan if point is None else point
        self._runner.inputs.receive(PULL, message.stamped(0))

    def command(self, name: str, on: bool | None = None) -> 'Future[str]':
        """Do what the service of that name does."""
        runner = self._runner
        if name == 'pause':
            return _then(runner.set_paused(bool(on)), _at('paused' if on else 'running'))
        if name == 'record':
            return _then(runner.set_recording(bool(on)), str)
        calls: dict[str, tuple[Callable[[], Future[Any]], str]] = {
            'step': (runner.take_steps, 'solver steps taken'),
            'advance': (runner.advance, 'advanced'),
            'reset': (runner.reset, 'back at the initial state'),
            'clear_loads': (runner.clear_loads, 'no load acts')}
        if name not in calls:
            raise ValueError(f'{name} is not a service of a run')
        call, word = calls[name]
        asked: Future[Any] = call()
        return _then(asked, _at(word))

    def change(self, name: str, value: Any) -> 'Future[str]':
        """Set a parameter; ValueError, or the future, says why not."""
        runner = self._runner
        wanted = (runner.changes.wanted or runner.parameters).with_changes(with_kind(name, value))
        built: Future[str] = Future()
        answer: Future[str] = Future()

        def taken(done: 'Future[Any]') -> None:
            error = done.exception()
            if error is not None and not built.done():
                built.set_exception(error)

        runner.change(wanted, Scene.from_parameters(wanted), built).add_done_callback(taken)

        def in_force(done: 'Future[str]') -> None:
            error = done.exception()
            reason = str(error) if error is not None else done.result()
            if reason:
                answer.set_exception(ValueError(reason))
            else:
                answer.set_result('')

        built.add_done_callback(in_force)
        return answer


class ReplayHands:
    """Does it to a player."""

    is_replay = True

    def __init__(self, player: Player) -> None:
        """Act on `player`, from any thread."""
        self._player = player
        # Once a simulation is ready to go on from the record: with its parameters.
        self.going_on: tuple[Simulation, Parameters] | None = None
        self._builds = threading.Lock()

    def pull(self, body: int, point: tuple[float, float, float] | None) -> None:
        """What was recorded cannot be pulled at."""

    def command(self, name: str, on: bool | None = None) -> 'Future[str]':
        """Do what the service of that name does."""
        player = self._player
        if name == 'pause':
            return _then(player.set_paused(bool(on)), _at('paused' if on else 'running'))
        if name == 'reset':
            return _then(player.reset(), _at('back at the start'))
        if name == 'step':
            return _then(player.step(), _at('one frame on'))
        if name == 'continue':
            return self._go_on()
        raise ValueError(
            f'{name} needs a node: play the bag with replay_node, and see it with viewer_node')

    def _go_on(self) -> 'Future[str]':
        """Simulate from the present recorded moment on; the answer comes when that is ready."""
        answer: Future[str] = Future()
        if not self._builds.acquire(blocking=False):
            raise ValueError('the simulation is being built already')
        player, was_paused = self._player, self._player.paused

        def build() -> None:
            from icofabric_sim.running.replay.going_on import simulate_from
            try:
                time = player.set_paused(True).result()
                simulation, parameters = simulate_from(
                    player.source.path, player.source.fabric, time)
            except Exception as error:  # noqa: BLE001 - the page shows it
                self._builds.release()
                if not was_paused:
                    player.set_paused(False)
                answer.set_exception(ValueError(f'this run cannot go on: {error}'))
            else:
                answer.set_result(f'goes on as a simulation, t = {seconds(time):.9g} s')
                # Where it was recorded to, and how long it was to last, is over.
                self.going_on = simulation, parameters.with_changes({
                    'record.path': '', 'duration': 0.0, 'real_time_factor': player.rate,
                    'start_paused': was_paused})

        threading.Thread(target=build, name='rebuilding', daemon=True).start()
        return answer

    def change(self, name: str, value: Any) -> 'Future[str]':
        """Set rate, loop or the time to go to."""
        player, value = self._player, judge_option(name, value)
        if name == 'seek':
            time = player.judge_time(round(value * NANOSECONDS))
            return _then(player.seek(time), _at('there'))
        if name == 'rate':
            return _then(player.set_rate(value), lambda _: '')
        if name != 'loop':
            raise ValueError(f'{name} is fixed at the start')
        player.loop = value
        done: Future[str] = Future()
        done.set_result('')
        return done
