# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Bag of a run: its topics, their names, and the description of the run."""

from collections import Counter
from collections.abc import Callable
import functools
from importlib import metadata
import json
import os
from pathlib import Path
import platform
import time
from typing import TYPE_CHECKING

from icofabric_sim.bag.folder import BagError, next_free_path
from icofabric_sim.messages import decode_string
from icofabric_sim.messages.schedule import nanoseconds_not_before
from icofabric_sim.messages.topics import (
    CHECKPOINT,
    EVENTS,
    full_name,
    Recorded,
    Topic,
    TOPICS,
    WEAVE,
)
from icofabric_sim.parameters.named_files import append_files
from icofabric_sim.parameters.text import dump_parameters
from icofabric_sim.parameters.validation import Parameters
from icofabric_sim.running.run_records import Status
from icofabric_sim.simulation.reports.divergence import Growth
from icofabric_sim.simulation.simulation import Simulation

if TYPE_CHECKING:
    from icofabric_sim.bag import BagRecorder, RecorderStatistics

_LIBRARIES = ('numpy', 'scipy', 'numba', 'llvmlite', 'rosbags')
# Messages without which a run cannot be repeated are never dropped.
_ESSENTIAL = (CHECKPOINT, EVENTS, WEAVE)
# Names in the custom data: whether the run was paused when the bag was opened; the number of
# messages of each topic passed to the bag, once it is closed; the numbers dropped because of a
# slow disk.
PAUSED, GIVEN, DROPPED = 'paused', 'messages_given', 'dropped_by_topic'
# Time for which a live run waits for its disk when a bag is opened or closed [s]; after that the
# run continues and the disk may follow.
_DISK_WAIT_S = 0.5
# Wall time between two warnings that messages are dropped [s].
_WARNING_INTERVAL_S = 10.0


def describe_run(
    simulation: Simulation, parameters: Parameters | None = None, *, paused: bool = False
) -> dict[str, str]:
    """
    Return the custom data that a bag needs, besides messages, to reproduce its run.

    `parameters` are those in force: output rates and real-time factor may have changed since the
    scene was built. `paused` is the state when the bag is opened.
    """
    in_force = simulation.scene.parameters if parameters is None else parameters
    from icofabric_sim.kernels.runtime.target import host_processor, kernel_target
    from icofabric_sim.version import __version__

    return {
        'scene': append_files(dump_parameters(in_force.complete()), simulation.scene.files),
        'version': __version__,
        'method': simulation.status.method_name,
        'method_reason': simulation.status.method_reason,
        'tolerance': repr(in_force['solver.tolerance']),
        'threads': str(simulation.status.thread_count),
        'step': repr(simulation.status.step),
        PAUSED: json.dumps(paused),
        'processor': host_processor(),
        'kernels': kernel_target(),
        'libraries': library_versions(),
        'python': platform.python_version(),
    }


@functools.cache
def library_versions() -> str:
    """Return the versions of the libraries that affect the results, and of the writer, as JSON."""
    return json.dumps({name: metadata.version(name) for name in _LIBRARIES})


def summarise_run(status: Status) -> dict[str, str]:
    """Return the custom data on the run, written when its bag is closed."""
    said = {
        'proximity': status.proximity or 'none',
        'failure': status.failure or 'none',
        'wrenches_dropped': str(status.dropped),
        'breaks': str(status.breaks),
        'obstruction': status.obstruction or 'none',
        'balance_worst': repr(status.balance_worst),
        'evaluation_count': str(status.evaluations),
        'estimation_count': str(status.estimations),
        'shown_count': str(status.shown),
    }
    if status.errors is not None:
        said['error_rate'], said['error_estimate'] = map(repr, status.errors)
        said['error_estimate_lacks'] = status.errors_lack or 'nothing'
    return said


def summarise_growth(growth: Growth) -> dict[str, str]:
    """Return the custom data on error growth in the run."""
    return {
        'growth': repr(growth.largest),
        'growth_is_at_least': 'true' if growth.at_least else 'false',
        'growth_ended': growth.ended or 'none',
        'meaningful_until': repr(growth.meaningful_until),
    }


class BagSink:
    """
    Sink of the runner that writes bags, one after the other as recording is switched off and on.

    Called from the thread of the simulation. A disk error ends the bag and is passed once to
    `on_error`; the run continues. Recording can be switched on again.
    """

    is_bag = True

    def __init__(
        self,
        path: str | Path,
        simulation: Simulation,
        *,
        live: bool,
        storage: str | None = None,
        parameters: Parameters | None = None,
        name: str = '/icofabric',
        on_error: Callable[[BagError], None] | None = None,
        on_warning: Callable[[str], None] | None = None,
    ) -> None:
        """
        Open the bag; raise BagError (a ValueError) naming `record.path` on failure.

        Without a path nothing is recorded until `switch`. `parameters` are those in force, if they
        differ from the scene's. A given path and storage hold for all bags; other settings come
        from `record.*`.

        A `live` run drops and counts messages if the disk is too slow, and reports them to
        `on_warning`; otherwise the run waits for the disk.
        """
        parameters = parameters or simulation.scene.parameters
        self._path = '' if str(path) == parameters['record.path'] else str(path)
        self._storage = '' if storage in (None, parameters['record.storage']) else storage
        self.name = name
        self._live, self._on_error, self._on_warning = live, on_error, on_warning
        self.recorder: 'BagRecorder | None' = None  # of the present bag, otherwise of the last one
        self.is_recording = False
        self._closing: 'list[BagRecorder]' = []  # whose disk has not finished yet
        self._measured = False  # whether measured forces are recorded
        self._earlier = 0  # messages that earlier bags dropped or lost
        self._warned = -_WARNING_INTERVAL_S
        # Messages of the present bag by topic, and whether the dropped numbers are already
        # recorded.
        self._given: Counter[str] = Counter()
        self._left_out: Counter[str] = Counter()
        self._says_left_out = True
        if str(path):
            self._open(
                Path(path), simulation, parameters, patience=None,
                paused=bool(parameters['start_paused']))

    @property
    def path(self) -> Path | None:
        """Return the folder of the present or last bag, None if there was none."""
        return None if self.recorder is None else self.recorder.path

    @property
    def error(self) -> BagError | None:
        """Return why the present or last bag ended early."""
        return None if self.recorder is None else self.recorder.error

    @property
    def statistics(self) -> 'RecorderStatistics':
        """Return the message counts of the present or last bag."""
        if self.recorder is None:
            from icofabric_sim.bag.handover import RecorderStatistics
            return RecorderStatistics(0, 0, 0, 0, 0, 0, 0.0)
        return self.recorder.statistics

    @property
    def dropped(self) -> int:
        """Return the number of messages missing in all bags together."""
        if self.recorder is None:
            return self._earlier
        statistics = self.recorder.statistics
        return self._earlier + statistics.dropped + statistics.lost

    def resolve(self, name: str) -> str:
        """Return the full name of a private (~/) or absolute topic name."""
        return full_name(name, self.name)

    def wants(self, topic: Topic) -> bool:
        """Return whether the topic is recorded."""
        asked = self._measured if topic.recorded is Recorded.IF_MEASURED else (
            topic.recorded is not Recorded.NEVER)
        return asked and self._active_recorder() is not None

    def send(self, topic: Topic, nanoseconds: int, data: bytes) -> None:
        """Record an output; scenes, events and checkpoints are never dropped."""
        recorder = self._active_recorder()
        if recorder is None:
            return
        self._add(recorder, topic)
        if topic is WEAVE:
            # For the later files of a split bag.
            recorder.set_heading('scene', decode_string(data))
        name = self.resolve(topic.name)
        if not self._says_left_out and recorder.has_room(len(data)):
            # Before the messages after the gap, so that a killed bag has it too.
            recorder.set_custom(DROPPED, json.dumps(self._left_out))
            self._says_left_out = True
        if recorder.write(name, nanoseconds, data, essential=topic in _ESSENTIAL):
            self._given[name] += 1
            return
        if recorder.error is None:
            self._left_out[name] += 1
            self._says_left_out = False
        self._warn(recorder)

    def send_input(self, topic: str, type_name: str, nanoseconds: int, data: bytes) -> None:
        """Record an input at the time it acts; inputs are never dropped."""
        recorder = self._active_recorder()
        if recorder is not None:
            topic = self.resolve(topic)
            recorder.add_topic(topic, type_name, latched=False, depth=100)
            if recorder.write(topic, nanoseconds, data, essential=True):
                self._given[topic] += 1

    def switch(
        self, on: bool, simulation: Simulation, parameters: Parameters, status: Status
    ) -> str:
        """
        Open the next bag (PATH, PATH_1, ...) after closing the present one, or only close it.

        Returns a sentence on the result; raises BagError with reason and remedy if a bag cannot be
        opened. The bag starts with the description of the run; the caller sends scene and state.
        """
        base = self._path or str(parameters['record.path'])
        if on and not base:
            raise BagError(
                'record.path is empty: there is no folder to record to; set it first (ros2 param '
                f'set {self.name} record.path runs/mine), or start with -p record.path:=runs/mine')
        closed = self._close_present(summarise_run(status)) if self.is_recording else ''
        if not on:
            return closed or 'recording was not active'
        self._open(
            Path(base), simulation, parameters, patience=_DISK_WAIT_S, paused=status.paused,
            status=status)
        said = f'recording to {self.path}'
        if self.recorder is not None and not self.recorder.survives_kill:
            said += ', complete only after it is closed (mcap survives a kill)'
        return f'{said}; {closed}' if closed else said

    def time_jumped_back(
        self, simulation: Simulation, parameters: Parameters, ended: Status
    ) -> None:
        """
        Close this bag with the summary of the run that `ended`, and open the next: PATH_1, ...

        If that fails, the run continues without recording, as after any disk error.
        """
        if not self.is_recording:
            return
        self._close_present(summarise_run(ended))
        base = self._path or str(parameters['record.path'])
        try:
            if not base:
                raise BagError('record.path is empty: the bag ends at the time jump')
            self._open(
                Path(base), simulation, parameters, patience=_DISK_WAIT_S, paused=ended.paused)
        except BagError as error:
            if self._on_error is not None:
                self._on_error(error)

    def close(self, *, summary: dict[str, str] | None = None) -> None:
        """Write the queue and close the bag, with a `summary` in its custom data."""
        if self.is_recording:
            self._close_present(summary or {}, patience=None)
        for recorder in self._closing:
            recorder.close()
        self._closing.clear()

    def _active_recorder(self) -> 'BagRecorder | None':
        """Return the recorder while it accepts messages."""
        recorder = self.recorder
        return recorder if self.is_recording and recorder and recorder.error is None else None

    def _open(
        self, base: Path, simulation: Simulation, parameters: Parameters, *,
        patience: float | None, paused: bool, status: Status | None = None,
    ) -> None:
        """Open the first bag as `base`, later ones as siblings; the run is `paused` or not."""
        # Imported here, not at the start of a node that does not record.
        from icofabric_sim.bag.recorder import BagRecorder

        start = nanoseconds_not_before(simulation.time) if status is None else status.time
        path = base if patience is None else next_free_path(base)
        while True:
            try:
                recorder = BagRecorder(
                    path,
                    storage=self._storage or str(parameters['record.storage']),
                    compression=str(parameters['record.compression']),
                    split_size=int(parameters['record.split_size']),
                    split_duration=float(parameters['record.split_duration']),
                    overflow='drop' if self._live else 'wait',
                    custom=describe_run(simulation, parameters, paused=paused),
                    custom_topic=self.resolve('~/recording'),
                    start=start,
                    patience=patience if self._live else None,
                    on_error=self._on_error,
                )
                break
            except BagError:
                # The name may have been taken meanwhile.
                if patience is None or not os.path.lexists(path):
                    raise
                path = next_free_path(base)
        if self.recorder is not None:
            self._earlier = self.dropped
        self._given, self._left_out, self._says_left_out = Counter(), Counter(), True
        self.recorder, self.is_recording = recorder, True
        self._measured = bool(parameters['record.measured'])
        for topic in TOPICS:
            if topic.recorded is Recorded.ALWAYS:
                self._add(recorder, topic)

    def _add(self, recorder: 'BagRecorder', topic: Topic) -> None:
        recorder.add_topic(
            self.resolve(topic.name), topic.type, latched=topic.latched, depth=topic.depth)

    def _close_present(
        self, summary: dict[str, str], *, patience: float | None = _DISK_WAIT_S
    ) -> str:
        """
        Close the bag and return a sentence; a live run waits at most `patience` for the disk.
        """
        recorder = self.recorder
        assert recorder is not None
        self.is_recording = False
        for key, value in summary.items():
            recorder.set_custom(key, value)
        statistics = recorder.statistics
        if statistics.dropped:
            recorder.set_custom('messages_dropped', str(statistics.dropped))
        if not self._says_left_out:
            recorder.set_custom(DROPPED, json.dumps(self._left_out))
        recorder.set_custom(GIVEN, json.dumps(self._given))
        finished = recorder.close(patience if self._live else None)
        self._closing = [item for item in self._closing if not item.close(0.0)]
        if not finished:
            self._closing.append(recorder)
            return f'{recorder.path} is still being written: the disk is slow'
        if recorder.error is not None:
            return str(recorder.error)
        return f'{recorder.path} is closed'

    def _warn(self, recorder: 'BagRecorder') -> None:
        """Warn from time to time that messages are dropped."""
        if (
            recorder.error is not None or self._on_warning is None
            or time.monotonic() - self._warned < _WARNING_INTERVAL_S
        ):
            return
        self._warned = time.monotonic()
        statistics = recorder.statistics
        self._on_warning(
            f'the disk of {recorder.path} is too slow: {statistics.dropped} messages are missing '
            f'in the bag so far, which lags by {statistics.lag:.2g} s; the simulation continues '
            'and inputs are recorded')
