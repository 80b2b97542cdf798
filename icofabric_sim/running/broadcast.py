# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Outputs of a run: messages that are due and requested, built once and sent to every sink."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import nullcontext
import json
import time as wall
from typing import Any, Protocol, runtime_checkable, TYPE_CHECKING

from icofabric_sim.kernels.runtime.kernel_guard import no_compiling
from icofabric_sim.messages import StringBytes, topics, UInt8MultiArrayBytes
from icofabric_sim.messages.schedule import Schedule, seconds
from icofabric_sim.messages.topics import Outputs, Topic
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.process.compile_notice import KernelsMissing
from icofabric_sim.running.load_cell_kernels import LoadCellKernels
from icofabric_sim.running.run_records import Status
from icofabric_sim.running.views import Views
from icofabric_sim.simulation.errors import SimulationError
from icofabric_sim.simulation.simulation import Simulation
import numpy as np

if TYPE_CHECKING:
    from icofabric_sim.simulation.checkpoints.checkpoint import Checkpoint

# Wall time between two reports on /diagnostics [s].
_REPORT_INTERVAL = 1.0


def schedules(
    parameters: Parameters, periodic: Iterable[Topic]
) -> dict[Topic, Schedule]:
    """Return the schedules of the outputs of a run; breakages are sent only when they happen."""
    return {
        topic: Schedule(parameters[topic.rate])
        for topic in periodic
        if not topic.requires or parameters[topic.requires]}


class Sink(Protocol):
    """Receiver of messages: live publishers, or a bag."""

    def wants(self, topic: Topic) -> bool:
        """Return whether a message on `topic` would be used now."""

    def send(self, topic: Topic, nanoseconds: int, data: bytes) -> None:
        """Accept a message of simulated time `nanoseconds`."""

    def send_input(self, topic: str, type_name: str, nanoseconds: int, data: bytes) -> None:
        """Accept an input at the time it acts."""

    @property
    def is_bag(self) -> bool:
        """
        Return whether the sink needs no repeats for late subscribers, e.g. a bag.
        """

    def time_jumped_back(
        self, simulation: Simulation, parameters: Parameters, ended: Status
    ) -> None:
        """
        Handle a jump of simulated time to 0, or to a checkpoint; a bag ends here.

        `simulation` continues from there with the `parameters` in force; `ended` is the status
        before the jump.
        """


@runtime_checkable
class Recorder(Sink, Protocol):
    """Sink that stores messages and can be started and stopped."""

    def switch(
        self, on: bool, simulation: Simulation, parameters: Parameters, status: Status
    ) -> str:
        """
        Start or stop recording; return a sentence on the result.

        `parameters` are those in force, `status` is the present status of the run.
        """


class Broadcast:
    """Topics of one run; messages are built only if a sink accepts them."""

    def __init__(
        self, sinks: list[Sink], simulation: Simulation, report: Callable[[], bytes] | None = None
    ) -> None:
        """Send to `sinks`; `report` formats /diagnostics."""
        self.sinks = sinks
        self._report = report
        self._last_report = 0.0
        self._views = Views()
        # Topics of the present time still to be sent to each sink, see `settle`.
        self._owed: dict[int, tuple[Sink, set[Topic]]] = {}
        self.set_scene(simulation)

    def set_scene(self, simulation: Simulation, outputs: Outputs | None = None) -> None:
        """Switch to another scene; use its message layouts `outputs` if they exist already."""
        # First, because it fails for a scene without valid layouts.
        self._outputs = outputs or Outputs(simulation.scene)
        self.simulation = simulation
        # Topics with a rate, those of the scene last.
        self._periodic = (*topics.PERIODIC, *topics.wrench_topics(simulation.scene))
        self._owed.clear()
        # Pending until the measuring kernels are loaded and used.
        self._cells: LoadCellKernels | None = None
        self._can_break = simulation.scene.can_break
        self._breaks_told: int | None = None
        self.set_rates(simulation.scene.parameters)

    def set_rates(self, parameters: Parameters) -> None:
        """Set new rates."""
        self._parameters = parameters
        self._schedules = {
            topic: schedule for topic, schedule in schedules(
                parameters, self._periodic).items()
            if topic is not topics.BROKEN or self._can_break}

    def next_times(self, now: int) -> list[int]:
        """Return the times [ns] after `now` at which requested outputs are due."""
        return [
            schedule.after(now)
            for topic, schedule in self._schedules.items()
            if self._receivers(topic)
        ]

    def start(
        self, now: int, *, cleared: bool = False, whole: bool = True,
        only: Sequence[Sink] | None = None,
    ) -> None:
        """
        Send the scene and its present state to all sinks, or only to `only`.

        `cleared` removes the markers of an earlier scene. `whole`: the run starts now, so that the
        scene defines the state, and a bag needs no checkpoint.
        """
        self.describe_scene(now, only)
        if not whole:
            self.checkpoint(now, only)
        if cleared:
            for topic in (topics.CONNECTORS, topics.ICOSAHEDRA):
                receivers = self._receivers(topic, only)
                if receivers:
                    self._send(topic, now, [self._outputs.cleared(now, topic)], receivers)
        self._breaks_told = None
        self.emit(now, only=only)

    def describe_scene(self, now: int, only: Sequence[Sink] | None = None) -> None:
        """
        Send the parameters of the scene, and then those in force if they differ.

        Only the former reproduce a run: even the duration affects the choice of the method.
        """
        built = self.simulation.scene.parameters
        self._describe(now, built, only)
        bodies, receivers = self._outputs.bodies(), self._receivers(topics.BODIES, only)
        if bodies is not None and receivers:
            self._send(topics.BODIES, now, [bodies], receivers)
        if dict(built) != dict(self._parameters):
            self._describe(now, self._parameters, only)

    def describe(self, now: int) -> None:
        """Send the parameters in force."""
        self._describe(now, self._parameters, None)

    def event(self, now: int, event: str, **facts: Any) -> None:
        """Send an event of the run other than an input, with its data."""
        receivers = self._receivers(topics.EVENTS)
        if receivers:
            text = json.dumps(
                {'event': event, 'time': seconds(now), **facts}, default=_plain)
            self._send(topics.EVENTS, now, [StringBytes(text).to_bytes()], receivers)

    def checkpoint(
        self, now: int, only: Sequence[Sink] | None = None, *, taken: 'Checkpoint | None' = None
    ) -> None:
        """
        Record a new checkpoint, or the given one `taken` now; it is too large to be published.
        """
        receivers = [
            sink for sink in self._receivers(topics.CHECKPOINT, only) if sink.is_bag]
        if receivers:
            checkpoint = taken or self.simulation.checkpoint()
            data = UInt8MultiArrayBytes(checkpoint.to_bytes()).to_bytes()
            self._send(topics.CHECKPOINT, now, [data], receivers)

    def recorders(self) -> list[Recorder]:
        """Return the sinks that can be started and stopped."""
        return [sink for sink in self.sinks if isinstance(sink, Recorder)]

    def time_jumped(self, ended: Status) -> None:
        """Restart the sinks after a jump of simulated time; `ended` is the status before."""
        for sink in self.sinks:
            sink.time_jumped_back(self.simulation, self._parameters, ended)

    def due(self, now: int) -> None:
        """Send outputs that are due exactly `now`, and pending updates to viewer pages."""
        self.owe(now)
        self.settle(now)
        self._show(now, self._views.due(), None)

    def emit(
        self, now: int, chosen: Sequence[Topic] | None = None, *,
        only: Sequence[Sink] | None = None
    ) -> None:
        """
        Send each sink its `chosen` messages of the present time, or defer all of them.

        They are deferred while kernels of one of them are being prepared; simulated time waits.
        """
        self._owe(
            self._periodic if chosen is None else chosen, self.sinks if only is None else only)
        self.settle(now)
        if chosen is None:
            self._show(now, topics.VIEWS.items(), only)

    def repeat(self, now: int) -> None:
        """
        Repeat the present state to live sinks, or only the clock to sinks with deferred outputs.
        """
        live = [sink for sink in self.sinks if not sink.is_bag]
        shown = [sink for sink in live if id(sink) not in self._owed]
        wanted = {
            topic: self._receivers(topic, live if topic is topics.CLOCK else shown)
            for topic in self._periodic if not topic.latched}
        measured = self._measure([
            topic for topic, receivers in wanted.items() if receivers and topic.loads_kernels], now
        ) or {}
        for topic, receivers in wanted.items():
            if receivers and (not topic.loads_kernels or topic in measured):
                self._send(topic, now, measured.get(topic) or self._build(topic, now), receivers)
        self._show(now, topics.VIEWS.items(), None)

    def owe(self, now: int) -> None:
        """Register the outputs due exactly `now` for all sinks."""
        self._owe([topic for topic, due in self._schedules.items() if due.is_due(now)], self.sinks)

    def _owe(self, chosen: Sequence[Topic], sinks: Sequence[Sink]) -> None:
        if topics.BROKEN in chosen and not self._is_news_of_breaks():
            chosen = [topic for topic in chosen if topic is not topics.BROKEN]
        for sink in sinks:
            wanted = [topic for topic in chosen if self._receivers(topic, [sink])]
            if wanted:
                _, owed = self._owed.setdefault(id(sink), (sink, set()))
                owed.update(wanted)

    @property
    def owes(self) -> bool:
        """Return whether outputs of the present time are deferred, so that time must wait."""
        return bool(self._owed)

    def waits_for(self) -> float:
        """Return how long [s] kernels of measured forces have been in preparation, 0 if none."""
        cells = self._cells
        return 0.0 if cells is None or cells.are_ready else cells.seconds

    def settle(self, now: int) -> None:
        """Send deferred outputs, the clock first, to each sink whose outputs are all ready."""
        if not self._owed:
            return
        owed = list(self._owed.values())
        try:
            # Operations that may fail or wait come before the first message.
            if any(wanted - {topics.CLOCK} for _, wanted in owed):
                self.simulation.snapshot()
            measured = self._measure([
                topic for topic in self._periodic
                if topic.loads_kernels and any(topic in wanted for _, wanted in owed)], now)
        except SimulationError:
            self._owed.clear()
            raise
        if measured is None:
            measured, owed = {}, [
                item for item in owed if not any(topic.loads_kernels for topic in item[1])]
        for sink, _ in owed:
            del self._owed[id(sink)]
        for topic in self._periodic:
            receivers = [sink for sink, wanted in owed if topic in wanted and sink.wants(topic)]
            if receivers:
                self._send(topic, now, measured.get(topic) or self._build(topic, now), receivers)

    def _show(
        self, now: int, chosen: Iterable[tuple[Topic, Topic]], only: Sequence[Sink] | None
    ) -> None:
        """Send the present state to viewer pages: pairs of a topic and its view topic."""
        for topic, view in chosen:
            receivers = self._receivers(view, only)
            if receivers:
                began, before = wall.monotonic(), wall.thread_time()
                self._send(view, now, self._build(topic, now), receivers)
                self._views.sent(topic, began, wall.thread_time() - before)

    def _measure(self, chosen: list[Topic], now: int) -> dict[Topic, list[bytes]] | None:
        """
        Build the measured outputs of the present state, or return None if kernels are missing.

        For a live run a thread prepares the kernels; remaining ones are compiled here.
        """
        cells = self._cells
        if not chosen:
            return {}
        if cells is not None and not cells.are_ready:
            return None
        try:
            with no_compiling() if cells is None and self._report is not None else nullcontext():
                measured = {topic: list(self._build(topic, now)) for topic in chosen}
        except KernelsMissing:
            self._cells = LoadCellKernels(self.simulation)
            return self._measure(chosen, now)
        self._cells = None
        return measured

    def _is_news_of_breaks(self) -> bool:
        """Return whether connectors have broken since the last breakage message."""
        told, self._breaks_told = self._breaks_told, self.simulation.status.broken_count
        return told != self._breaks_told

    @property
    def reports_to_any(self) -> bool:
        """Return whether a sink accepts /diagnostics."""
        return bool(self._receivers(topics.DIAGNOSTICS))

    def is_measured(self) -> bool:
        """Return whether a sink accepts reactions or contacts; thread-safe."""
        return any(self._receivers(topic) for topic in self._periodic if topic.loads_kernels)

    def report(self, now: int, *, at_once: bool = False) -> None:
        """
        Send /diagnostics once per second of wall time.

        The report is built even without receivers, because its values are reused if the run
        blocks.
        """
        if self._report is None or not (
            at_once or wall.monotonic() - self._last_report >= _REPORT_INTERVAL
        ):
            return
        self._last_report = wall.monotonic()
        report = self._report()
        receivers = self._receivers(topics.DIAGNOSTICS)
        if receivers:
            self._send(topics.DIAGNOSTICS, now, [report], receivers)

    def input(self, topic: str, type_name: str, now: int, data: bytes) -> None:
        """Forward an input at the time it acts."""
        for sink in self.sinks:
            sink.send_input(topic, type_name, now, data)

    def _build(self, topic: Topic, now: int) -> Iterable[bytes]:
        assert topic.build is not None
        return topic.build(self._outputs, self.simulation, now)

    def _describe(
        self, now: int, parameters: Parameters, only: Sequence[Sink] | None
    ) -> None:
        receivers = self._receivers(topics.WEAVE, only)
        if receivers:
            self._send(topics.WEAVE, now, [self._outputs.weave(parameters)], receivers)

    def _receivers(self, topic: Topic, only: Sequence[Sink] | None = None) -> list[Sink]:
        if topic.requires and topic not in self._schedules:
            return []
        return [sink for sink in (self.sinks if only is None else only) if sink.wants(topic)]

    def _send(
        self, topic: Topic, now: int, messages: Iterable[bytes], receivers: list[Sink]
    ) -> None:
        for data in messages:
            for sink in receivers:
                sink.send(topic, now, data)
            del data  # the next message may be equally large


def _plain(value: Any) -> Any:
    """Replace numbers that JSON lacks."""
    return np.asarray(value).tolist()
