# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Check that a bag contains exactly the outputs that its run sent.

The outputs of a run follow from its rates, pauses and events, all of which are recorded
(broadcast.py sends by the same rules). A closed bag also has the number of messages of each topic
passed to it, and the number dropped because of a slow disk.
"""

from collections import Counter
from collections.abc import Callable, Iterator
import json
import math
from typing import NamedTuple

from icofabric_sim.bag import STOPPED
from icofabric_sim.bag.recorded_run import RecordedEvent, RecordedRun
from icofabric_sim.bag.storage import FILE_INDEX
from icofabric_sim.messages import (
    decode_float64_multi_array,
    decode_marker_points,
    decode_string,
    MarkerAction,
    topics,
)
from icofabric_sim.messages.markers import list_numbers
from icofabric_sim.messages.schedule import Schedule, seconds
from icofabric_sim.messages.topics import full_name, Recorded, Topic
from icofabric_sim.running.broadcast import schedules
from icofabric_sim.running.recording import DROPPED, GIVEN, PAUSED
from icofabric_sim.running.replay.resimulation import Departure
from icofabric_sim.running.run_events import is_jump, runs_after, Shown, shown_after, shows_instead
from icofabric_sim.simulation.simulation import Simulation
from icofabric_sim.version import __version__

# Topics that depend on wall time or on the writing.
_BESIDE = ('~/recording', topics.DIAGNOSTICS.name)


class Gap(NamedTuple):
    """Missing messages of one topic."""

    topic: str  # full name
    messages: int
    nanoseconds: int | None  # of the first; None: only the number is known

    def __str__(self) -> str:
        """Return a sentence."""
        what = f'{self.messages:,} message{"" if self.messages == 1 else "s"} of {self.topic}'
        if self.nanoseconds is None:
            return f'{what} (more were passed to the bag than it contains)'
        first = '' if self.messages == 1 else 'the first '
        return f'{what} ({first}at t = {seconds(self.nanoseconds):.9f} s)'


class Completeness:
    """Check of a bag, message by message, beside the simulation that repeats its run."""

    def __init__(
        self, run: RecordedRun, simulation: Callable[[], Simulation | None], *, exact: bool
    ) -> None:
        """
        Follow `run`; `simulation` returns the present simulation, or None before the first.

        `exact`: the simulation is bit-identical to the recorded one, so that breakages occur at
        the same times.
        """
        self._run, self._simulation, self._exact = run, simulation, exact
        custom = run.custom
        self.dropped, self._given = (_counts(custom.get(name, '')) for name in (DROPPED, GIVEN))
        # A full disk ends a bag early, and a killed recorder writes no end.
        self._is_whole = GIVEN in custom and STOPPED not in custom
        # Required to know the due outputs, whose rules may differ in other versions. A later file
        # of a split bag lacks the pauses before it.
        self._says_pauses = (
            PAUSED in custom and FILE_INDEX not in custom and custom.get('version') == __version__)
        self._is_running = custom.get(PAUSED) == 'false'
        # With several fabrics any may have published the time, and all publish their frames there.
        self._left_out = (topics.CLOCK, topics.TF) if len(run.nodes) > 1 else ()
        is_measured = 'scene' in custom and run.parameters_of(custom['scene'])['record.measured']
        left_out = {Recorded.NEVER} if is_measured else {Recorded.NEVER, Recorded.IF_MEASURED}
        self._sent = {
            topic.name: topic for topic in topics.PERIODIC if topic.recorded not in left_out}
        self._counted: Counter[str] = Counter()
        self._missing: Counter[Topic] = Counter()
        self._first: dict[Topic, int] = {}
        self._schedules: dict[Topic, Schedule] = {}
        self._now: int | None = None
        self._has_begun = False
        # Messages still expected of the present state, and the connector lists received.
        self._owed: set[Topic] = set()
        self._has_come = False
        self._lists: set[int] = set()
        self._clears = self._may_clear = False
        # Breakages sent, None while unknown; whether the present state should send them, and
        # whether it certainly does.
        self._breaks_told: int | None = None
        self._tells_breaks = self._anew = False
        self._is_over = self._has_failed = False

    def begin_at(self, time: int) -> None:
        """Skip to the first checkpoint with stamp `time` [ns], but follow earlier events."""
        for name, when, data in self._run.messages(
                stop=time, names=(topics.EVENTS.name, topics.WEAVE.name)):
            if name == topics.WEAVE.name:
                self._take_weave(data)
            else:
                self._follow(self._run.event(when, data))
        if self._has_begun:
            # Outputs due before are not in the bag.
            self._owed.clear()
            self._clears = self._anew = False
            self._now = time - 1
        for name, when, data in self._run.messages(start=time, stop=time + 1):
            if name == topics.CHECKPOINT.name:
                break
            self.take(name, when, data)
        self._missing.clear()
        self._first.clear()

    def take(self, name: str, time: int, data: bytes) -> None:
        """
        Register a message before it is repeated; raise Departure for one that was never sent.
        """
        self._counted[name] += 1
        if not self._says_pauses or name in _BESIDE:
            return
        event = self._run.event(time, data) if name == topics.EVENTS.name else None
        self._go_on(
            time, failed=event is not None and event.name == 'failed',
            instead=event is not None and shows_instead(event.name))
        if event is not None:
            self._follow(event)
        elif name == topics.WEAVE.name:
            self._take_weave(data)
        elif name in self._sent:
            self._take_output(self._sent[name], time, data)

    def end(self, stop: int | None, *, whole: bool) -> list[Gap]:
        """
        Return the missing messages up to the end of the bag, or up to `stop` [ns].

        `whole`: the bag was followed from start to end. Raises Departure if it contains more
        messages than were passed to it.
        """
        if self._says_pauses and self._now is not None and (
                stop is not None and stop < self._run.end):
            self._go_on(stop + 1)
        given = self._own_given() if self._is_whole and whole else {}
        if self._says_pauses and any(
                self._counted[self._own(name)] < count for name, count in given.items()):
            # The last state shown may be incomplete; then its time is known.
            self._settle()
        gaps = []
        for name in sorted({*given, *(
                full_name(topic.name, self._run.node) for topic in self._missing)}):
            own = self._own(name)
            topic = self._sent.get(own)
            more = self._counted[own] - given.get(name, self._counted[own])
            if more > 0:
                raise Departure(
                    self._run.end, f'{more:,} more than the {given[name]:,} messages that the bag '
                    'received', name)
            count, first = 0, None
            if topic is not None:
                count = max(self._missing[topic] - self.dropped.get(name, 0), 0)
                first = self._first[topic] if count else None
            if max(count, -more) > 0:
                gaps.append(Gap(name, max(count, -more), first))
        return gaps

    def _own_given(self) -> dict[str, int]:
        """Return the number of messages of each topic passed to the bag, without other fabrics."""
        own, others = f'{self._run.node}/', [
            f'{node}/' for node in self._run.nodes if node != self._run.node]
        return {name: count for name, count in self._given.items()
                if name.startswith(own) or not name.startswith(tuple(others))}

    def _take_weave(self, data: bytes) -> None:
        """Set the rates in force; the first scene of a bag is followed by its state."""
        parameters = self._run.parameters_of(self._run.decoded(decode_string, data))
        self._schedules = {
            topic: schedule for topic, schedule in schedules(
                parameters, topics.PERIODIC).items()
            if topic.name in self._sent and topic not in self._left_out}
        if not self._has_begun:
            self._has_begun = self._may_clear = True
            self._show(anew=True)
        elif self._anew and topics.POSES in self._owed:
            # After a reset or a re-weave, with the present rates.
            self._show(anew=True)

    def _follow(self, event: RecordedEvent) -> None:
        """Expect the messages that a run sends after an event."""
        self._is_running = runs_after(event.name, running=self._is_running)
        shown = shown_after(event.name, running=self._is_running)
        if shown is Shown.NOTHING or is_jump(event.name, event.facts):
            return  # after a jump they are in the next bag
        if not self._has_come:
            # Time waited for the kernels of the due outputs; the event is shown instead.
            self._owed.clear()
        self._settle()
        self._has_failed = event.name == 'failed'
        if shown is Shown.ANEW:
            self._clears = self._may_clear = True
        self._show(anew=shown is Shown.ANEW)

    def _show(self, *, anew: bool = False) -> None:
        """Expect the present state on all topics."""
        self._anew, self._has_come = anew, False
        self._owed = {*self._schedules, topics.BROKEN}

    def _go_on(self, time: int, *, failed: bool = False, instead: bool = False) -> None:
        """
        Advance to `time` [ns]: earlier outputs are complete, outputs due then are expected.

        A run that `failed` on the way sends none of them; `instead` means that the event replaces
        the due outputs.
        """
        if self._now is None:
            self._now = time
        if failed and time == self._now:
            self._owed.clear()
        if time <= self._now:
            return
        self._settle()
        if self._is_over:
            raise Departure(
                self._now, 'a message that the run did not send',
                full_name(topics.BROKEN.name, self._run.node))
        before, self._now, self._may_clear = self._now, time, False
        self._has_come = False
        if not self._is_running:
            return
        for topic, schedule in self._schedules.items():
            for due in _between(schedule, before, time):
                if topic is not topics.BROKEN:
                    self._miss(topic, due, len(self._all_lists(due)) if (
                        topic is topics.CONNECTORS) else 1)
            if schedule.is_due(time) and not instead:
                self._owed.add(topic)

    def _settle(self) -> None:
        """Register expected messages of the present state that are missing."""
        now = self._now
        if now is None:
            return
        shows_poses = topics.POSES not in self._owed
        if self._has_failed and not shows_poses and not self._is_finite():
            # None of them is sent.
            self._owed.clear()
        self._has_failed = False
        for topic in self._owed - {topics.BROKEN, topics.CONNECTORS}:
            self._miss(topic, now, 1)
        if topics.CONNECTORS in self._owed:
            lost = len(self._all_lists(now) - self._lists) + self._clears
            if lost:
                self._miss(topics.CONNECTORS, now, lost)
        simulation = self._simulation()
        if topics.BROKEN in self._owed and not self._tells_breaks:
            if self._anew:
                self._miss(topics.BROKEN, now, 1)
            elif simulation is not None and shows_poses and self._exact:
                # It is sent with the state.
                if self._breaks_told not in (None, simulation.status.broken_count):
                    self._miss(topics.BROKEN, now, 1)
                self._breaks_told = simulation.status.broken_count
        self._owed.clear()
        self._lists.clear()
        self._clears = self._tells_breaks = self._anew = False

    def _take_output(self, topic: Topic, time: int, data: bytes) -> None:
        if topic in self._left_out:
            return
        if topic is topics.BROKEN:
            count = len(self._run.decoded(decode_float64_multi_array, data).values)
            if not self._tells_breaks and (self._anew or count != self._breaks_told):
                # Outputs that are not due are reported when the run ends.
                self._has_come = self._tells_breaks = True
                self._is_over = topic not in self._owed
                self._breaks_told = count
                return
            raise Departure(
                time, 'a message that was not sent: no connector has broken since the last one',
                full_name(topic.name, self._run.node))
        if topic is topics.CONNECTORS:
            marker = self._run.decoded(decode_marker_points, data)
            if marker.action == MarkerAction.DELETEALL:
                if self._may_clear:
                    self._clears = self._may_clear = False
                    return
            elif topic in self._owed and marker.marker_id not in self._lists and (
                    marker.marker_id in self._all_lists(time)):
                self._has_come = True
                self._lists.add(marker.marker_id)
                return
        elif topic in self._owed:
            self._has_come = True
            self._owed.remove(topic)
            return
        raise Departure(
            time, 'a duplicate, or a message that the run did not send',
            full_name(topic.name, self._run.node))

    def _is_finite(self) -> bool:
        """Return whether the state in which the simulation failed is finite."""
        simulation = self._simulation()
        return simulation is None or math.isfinite(simulation.snapshot().position.sum())

    def _miss(self, topic: Topic, time: int, count: int) -> None:
        self._missing[topic] += count
        self._first.setdefault(topic, time)

    def _all_lists(self, time: int) -> set[int]:
        """Return the ids of the connector lists of a state."""
        simulation = self._simulation()
        return list_numbers(
            self._run.scene_at(time) if simulation is None else simulation.scene)

    def _own(self, name: str) -> str:
        node = self._run.node
        return f'~{name.removeprefix(node)}' if name.startswith(f'{node}/') else name


def _between(schedule: Schedule, before: int, time: int) -> Iterator[int]:
    """Yield the times [ns] of outputs after `before` and before `time`."""
    due = schedule.after(before)
    while due < time:
        yield due
        due = schedule.after(due)


def _counts(text: str) -> dict[str, int]:
    """Return counts by topic from the text in a bag; empty for other texts."""
    try:
        found = json.loads(text or '{}')
        return {str(name): int(count) for name, count in found.items()}
    except (ValueError, AttributeError, TypeError):
        return {}
