# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Second simulation of a recorded run from its scene, inputs, changes and resets.

The bag contains everything that affected the motion, in order and before any state that it changed
(runner.py). So it suffices to process its messages one after the other. Pauses, steps, output
rates and the real-time factor do not affect the motion and are ignored.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
import time as wall
from typing import Any

from icofabric_sim.bag import BagError
from icofabric_sim.bag.recorded_run import RecordedEvent, RecordedRun
from icofabric_sim.bag.storage import FILE_INDEX
from icofabric_sim.messages import decode_string, decode_uint8_multi_array, topics
from icofabric_sim.messages.input_topics import decode_input, input_type, INPUT_TYPES
from icofabric_sim.messages.schedule import nanoseconds_not_before, seconds
from icofabric_sim.messages.topics import Topic
from icofabric_sim.parameters.changes import rebuilds
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.running.run_events import do_event, is_jump, replace_simulation
from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint
from icofabric_sim.simulation.errors import SimulationError
from icofabric_sim.simulation.inputs.input_types import require_target
from icofabric_sim.simulation.simulation import compile_scene, Simulation

# Effect of an input on a simulation.
Act = Callable[[Simulation], object]
# Wall time between two calls of `on_time` [s].
_REPORT_INTERVAL_S = 0.1


class NotRepeatable(BagError):
    """Error for a complete bag without the data for simulating its run again, at least here."""


class Departure(Exception):
    """Divergence from the bag: only one of the two runs failed, or a message does not fit."""

    def __init__(self, nanoseconds: int, text: str, topic: str = '') -> None:
        """Store the time, the `text` that describes the divergence, and its `topic`, if any."""
        super().__init__(text)
        self.nanoseconds, self.topic = nanoseconds, topic

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy by the arguments."""
        return type(self), (self.nanoseconds, *self.args), vars(self)


class Resimulation:
    """Second simulation of one recorded run; `simulation` is at the time read so far."""

    def __init__(
        self,
        run: RecordedRun,
        *,
        threads: int = 0,
        start: int | None = None,
        on_time: Callable[[int], None] = lambda time: None,
        on_input: Callable[[Act], None] = lambda act: None,
        on_jump: Callable[[bool], None] = lambda goes_on: None,
        on_message: Callable[[str, int, bytes], None] = lambda name, time, data: None,
    ) -> None:
        """
        Start at the start of the bag, or at its last checkpoint not after `start` [ns].

        `threads` other than 0 replaces the scene's number. `on_time` receives the time [ns] from
        time to time. `on_input` receives each input before it acts. `on_message` receives every
        message before it is repeated. `on_jump` is called with True after states were set, or a
        re-weave that keeps the motion; with False after the first build, the start checkpoint, a
        reset or another re-weave.
        """
        self.run, self.parameters = run, Parameters({}, frozenset())
        self.counts: Counter[str] = Counter()
        self.failure = ''
        self._threads, self._on_time = threads, on_time
        self._on_input, self._on_jump, self._on_message = on_input, on_jump, on_message
        self.present: Simulation | None = None  # None: not needed so far
        # Parameters from which the scene is built when something happens.
        self._first: Parameters | None = None
        self.start = run.start  # [ns]
        # Whether the second simulation starts at a checkpoint, not at the start of the bag.
        self._skip_to_checkpoint = self.begins_later = False
        if start is not None:
            times = [time for time in run.times_of(topics.CHECKPOINT.name) if time <= start]
            if times:
                self.start = times[-1]
                self._skip_to_checkpoint = self.begins_later = True
        self._chunk = 1_000_000
        self._failure_told = True

    @property
    def simulation(self) -> Simulation:
        """Return the simulation, built on first use."""
        if self.present is None:
            if FILE_INDEX in self.run.custom:
                raise NotRepeatable(
                    f'{self.run.path} is file {self.run.custom[FILE_INDEX]} of a split bag, '
                    'and the run starts before it: only the folder with all its files, or a time '
                    'after a checkpoint in this file, can be simulated again')
            if self._first is None:
                raise NotRepeatable(
                    f'{self.run.path} does not begin with its scene ({self.run.node}/weave); only '
                    'runs that this simulator recorded can be simulated again')
            self.present = self._build(self._first)
            self._on_jump(False)
        return self.present

    def outputs(self, stop: int | None = None) -> Iterator[tuple[Topic, int, bytes]]:
        """
        Repeat the run before `stop` [ns]; yield its outputs at their times.

        Raises Departure where that is not possible.
        """
        compared = {topic.name: topic for topic in (
            *(topic for topic in topics.PERIODIC if topic.compared), topics.CHECKPOINT,
            topics.BODIES)}
        # The published bodies stand before the checkpoint of a bag that starts during a run.
        early: list[tuple[Topic, int, bytes]] = []
        for name, time, data in self.run.messages(start=self.start, stop=stop):
            if self._skip_to_checkpoint:
                if name != topics.CHECKPOINT.name:
                    continue
                self._skip_to_checkpoint = False
            self._on_message(name, time, data)
            topic = compared.get(name)
            if name == topics.WEAVE.name:
                self._take_weave(time, self.run.decoded(decode_string, data))
            elif name == topics.EVENTS.name:
                self._take_event(self.run.event(time, data))
            elif topic is topics.BODIES and self.present is None:
                early.append((topic, time, data))
            elif topic is topics.CHECKPOINT and self.present is None:
                self._begin_at(self.run.decoded(decode_uint8_multi_array, data))
            elif topic is not None:
                for message in (*early, (topic, time, data)):
                    self.reach(message[1])
                    yield message
                early.clear()
            elif name != topics.DIAGNOSTICS.name:
                self._take_input(name, time, data)
        yield from early

    def reach(self, time: int) -> None:
        """Advance to `time` [ns], unless the run has failed."""
        self._require_recorded_failure()
        simulation = self.simulation
        # In pieces, which give identical bits, so that the time is reported from time to time.
        while not self.failure and simulation.time < seconds(time):
            now, began = nanoseconds_not_before(simulation.time), wall.perf_counter()
            piece = seconds(min(now + self._chunk, time))
            self._guarded(partial(simulation.advance_to, piece))
            passed = wall.perf_counter() - began
            if passed < 0.5 * _REPORT_INTERVAL_S:
                self._chunk *= 2
            elif passed > _REPORT_INTERVAL_S:
                self._chunk = max(self._chunk // 2, 1)
            self._on_time(nanoseconds_not_before(simulation.time))
        self._require_recorded_failure()

    def _require_recorded_failure(self) -> None:
        """Raise Departure if the simulation has failed and the bag has no failure."""
        if not self._failure_told:
            raise Departure(
                nanoseconds_not_before(self.simulation.time),
                f'the simulation fails ({self.failure}), the recorded run continued')

    def _guarded(self, call: Callable[[], object]) -> None:
        """Record a failure of the simulation, which the bag must contain next."""
        try:
            call()
        except SimulationError as error:
            self.failure, self._failure_told = str(error), False

    def _build(self, parameters: Parameters) -> Simulation:
        if self._threads:
            parameters = parameters.with_changes({'solver.threads': self._threads})
        scene = self.run.build(parameters)
        try:
            return compile_scene(scene)
        except ValueError as error:
            raise NotRepeatable(
                f'{self.run.path} contains a scene that this version cannot compile: {error}'
            ) from error

    def _begin_at(self, data: bytes) -> None:
        try:
            checkpoint = Checkpoint.from_bytes(data)
            self._first = self.run.parameters_of(checkpoint.header['scene'])
            simulation = self._build(self._first)
            simulation.restore(checkpoint)
        except BagError:
            raise
        except (ValueError, KeyError) as error:
            raise NotRepeatable(
                f'{self.run.path} starts with a checkpoint that cannot be restored: {error}'
            ) from error
        self.present, self.parameters = simulation, self._first
        self.counts['begun at a checkpoint'] += 1
        self._on_jump(False)

    def _take_weave(self, time: int, text: str) -> None:
        parameters = self.run.parameters_of(text)
        if self._first is None:
            self._first = parameters
        elif rebuilds(self.parameters, parameters):
            self._reweave(time, parameters)
        self.parameters = parameters

    def _reweave(self, time: int, parameters: Parameters) -> None:
        self.reach(time)
        changed = self._build(parameters)
        try:
            restarts = replace_simulation(
                self.simulation, changed, time, self.parameters, parameters)
        except (ValueError, SimulationError) as error:
            raise Departure(time, f'the recorded change fails: {error}') from error
        self.present, self.failure = changed, ''
        self.counts['re-weaves'] += 1
        self._on_jump(not restarts)

    def _take_event(self, event: RecordedEvent) -> None:
        if is_jump(event.name, event.facts):
            return  # the bag ends
        if event.name == 'reset':
            self.reach(event.nanoseconds)
            self.failure = ''
            self._guarded(lambda: self._do(event))
            self.counts['resets'] += 1
            self._on_jump(False)
        elif event.name == 'failed':
            self._fail(event)
        elif event.name in ('state_set', 'equilibrium'):
            self._set_state(event)
        elif event.name in ('pause', 'step', 'advance'):
            self.counts[f'{event.name}s'] += 1

    def _do(self, event: RecordedEvent) -> None:
        do_event(self.simulation, event.nanoseconds, event.name, event.facts)

    def _set_state(self, event: RecordedEvent) -> None:
        self.reach(event.nanoseconds)
        try:
            self._do(event)
        except (IndexError, KeyError, TypeError, ValueError, SimulationError) as error:
            raise Departure(
                event.nanoseconds, f'recorded body states cannot be set: {error}') from error
        self.counts['states set'] += 1
        self._on_jump(True)

    def _fail(self, event: RecordedEvent) -> None:
        """Fail as the recorded run did."""
        if not self.failure:
            try:
                self._guarded(lambda: self._do(event))
            except (KeyError, TypeError, ValueError) as error:
                raise Departure(
                    event.nanoseconds, f'the recorded failure has no target: {error!r}'
                ) from error
        reason = event.facts.get('reason')
        if self.failure != reason:
            raise Departure(
                event.nanoseconds,
                f'the recorded run fails ({reason}), the simulation ' + (
                    f'fails differently ({self.failure})' if self.failure else 'continues'))
        self._failure_told = True
        self.counts['failures'] += 1

    def _take_input(self, name: str, time: int, data: bytes) -> None:
        type_name = self.run.topics[self.run.node + name.removeprefix('~')].type_name
        if type_name not in INPUT_TYPES:
            return
        if type_name != input_type(name):
            raise NotRepeatable(
                f'{self.run.path} contains inputs on {self.run.node}{name[1:]} ({type_name}), '
                'which this version cannot repeat')
        target, value, _, _ = self.run.decoded(partial(decode_input, name), data)

        def act(simulation: Simulation) -> None:
            require_target(simulation.scene, target)
            simulation.inputs.put(simulation.time, target, type(value).checked(*value))
            simulation.advance_to(simulation.time)

        self.reach(time)
        self._on_input(act)
        try:
            self._guarded(lambda: act(self.simulation))
        except ValueError as error:
            raise Departure(
                time, f'a recorded {type(value).__name__.lower()} cannot act: {error}') from error
        self.counts['inputs'] += 1


def resimulate_to(
    run: RecordedRun, nanoseconds: int, *, on_time: Callable[[int], None] = lambda time: None
) -> Simulation:
    """
    Return the simulation of a recorded run at a time [ns], bit-identical, ready to continue.

    It is computed from the last checkpoint before, or from the start. Raises ValueError (mostly
    BagError) if that is impossible, and KeyboardInterrupt or exceptions of `on_time`, which can
    cancel.
    """
    again = Resimulation(run, start=nanoseconds, on_time=on_time)
    try:
        for _ in again.outputs(stop=nanoseconds + 1):
            pass
        again.reach(nanoseconds)
    except Departure as error:
        raise BagError(
            f'{run.path} cannot be simulated again to t = {seconds(nanoseconds):.9g} s: at t = '
            f'{seconds(error.nanoseconds):.9g} s {error}') from error
    if again.failure:
        raise BagError(
            f'the run in {run.path} had failed by t = {seconds(nanoseconds):.9g} s: '
            f'{again.failure}')
    return again.simulation
