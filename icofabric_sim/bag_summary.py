# Copyright 2026 The icofabric_sim authors
# Licensed under the Apache License, Version 2.0; see LICENSE.
"""
Reading a recorded run back: its scene, poses over time, markers and inputs, and a summary of it all.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import json
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

from icofabric_sim.bag import BagError, BagReader, BagTopic
from icofabric_sim.messages import (
    decode_marker_points,
    decode_pose_array,
    decode_string,
    decode_wrench_stamped,
    MarkerPoints,
    PoseArrayBytes,
    StringBytes,
    WrenchStampedBytes,
)
from icofabric_sim.parameter_sections import ParameterSet
from icofabric_sim.parameters import make_parameters
from icofabric_sim.scene import Scene
from icofabric_sim.scene_summary import as_lines, Row, vector
from icofabric_sim.schedule import seconds
import numpy as np

# Inputs listed in the text of a summary; a joystick sends thousands.
_LARGEST_LIST = 12


class PoseFrame(NamedTuple):
    """
    Poses at one recorded time.
    """

    nanoseconds: int
    position: np.ndarray  # (n, 3) [m]
    orientation: np.ndarray  # (n, 4) x y z w

    @property
    def time(self) -> float:
        """
        Simulated time [s].
        """
        return seconds(self.nanoseconds)


class RecordedInput(NamedTuple):
    """
    A wrench at the time it acted.
    """

    nanoseconds: int
    topic: str
    frame_id: str
    force: np.ndarray  # (3,) [N]
    torque: np.ndarray  # (3,) [N m]

    @property
    def time(self) -> float:
        """
        Simulated time [s] at which it acted.
        """
        return seconds(self.nanoseconds)

    @property
    def is_zero(self) -> bool:
        """
        Whether it clears its channel.
        """
        return not (self.force.any() or self.torque.any())


class RecordedRun:
    """
    A bag of one fabric, open from the construction to `close`.
    """

    def __init__(self, path: str | Path) -> None:
        """
        Open a bag folder or file; BagError says what is wrong with it.
        """
        self._reader = BagReader(path)
        self.path = self._reader.path
        self.topics: dict[str, BagTopic] = self._reader.topics
        self.custom = self._reader.custom
        names = [
            name
            for name, topic in self.topics.items()
            if name.endswith('/poses') and topic.type_name == PoseArrayBytes.TYPE
        ]
        # Of several fabrics in one bag the first is read.
        self.node = min(names)[: -len('/poses')] if names else ''
        self._scenes: dict[int, Scene] = {}

    @property
    def start(self) -> int:
        """
        Time of the first message [ns].
        """
        return self._reader.start_time

    @property
    def end(self) -> int:
        """
        Time of the last message [ns].
        """
        return self._reader.end_time

    def pose_times(self) -> np.ndarray:
        """
        Times [ns] of all recorded poses, ascending.
        """
        self._require_poses()
        times = (time for _, time, _ in self._reader.messages([f'{self.node}/poses']))
        return np.unique(np.fromiter(times, dtype=np.int64))

    def poses(self, times: Sequence[int] | np.ndarray | None = None) -> Iterator[PoseFrame]:
        """
        Yield the poses of the given recorded times [ns], all by default, in order of time.
        """
        self._require_poses()
        wanted = None if times is None else {int(time) for time in times}
        previous = -1
        for _, time, data in self._reader.messages([f'{self.node}/poses']):
            if time == previous or (wanted is not None and time not in wanted):
                continue
            previous = time
            values = np.array(decode_pose_array(data).values)
            yield PoseFrame(time, values[:, :3], values[:, 3:])

    def markers(self, time: int) -> list[MarkerPoints]:
        """
        Connector lists as they are shown at `time` [ns].
        """
        shown: dict[int, MarkerPoints] = {}
        for _, _, data in self._reader.messages([f'{self.node}/connectors'], stop=time + 1):
            marker = decode_marker_points(data)
            if marker.action == 3:  # DELETEALL
                shown.clear()
            elif marker.action == 2:  # DELETE
                shown.pop(marker.marker_id, None)
            else:
                shown[marker.marker_id] = marker
        return [shown[number] for number in sorted(shown)]

    def inputs(self) -> list[RecordedInput]:
        """
        All wrenches received, in the order in which they acted.
        """
        names = [
            name
            for name, topic in self.topics.items()
            if topic.type_name == WrenchStampedBytes.TYPE
        ]
        result = []
        for name, time, data in self._reader.messages(names):
            wrench = decode_wrench_stamped(data)
            result.append(
                RecordedInput(
                    time, name, wrench.frame_id, np.array(wrench.first), np.array(wrench.second)
                )
            )
        return result

    def scene_texts(self) -> list[tuple[int, str]]:
        """
        Times [ns] from which the scenes hold, and their parameter files; mostly one.
        """
        name = f'{self.node}/weave'
        texts = []
        if name in self.topics and self.topics[name].type_name == StringBytes.TYPE:
            texts = [(time, decode_string(data)) for _, time, data in self._reader.messages([name])]
        if not texts and self.custom.get('scene'):
            texts = [(self.start, self.custom['scene'])]
        return texts

    def scene_at(self, time: int) -> Scene:
        """
        Scene in force at `time` [ns]; BagError where the bag does not say.
        """
        texts = self.scene_texts()
        if not texts:
            raise BagError(
                f'{self.path} does not hold its scene ({self.node or ""}/weave); only runs that this simulator '
                'recorded can be read as fabrics'
            )
        before = [number for number, (start, _) in enumerate(texts) if start <= time]
        number = before[-1] if before else 0
        if number not in self._scenes:
            parameters = ParameterSet('/icofabric')
            parameters.add_file(texts[number][1].encode(), f'scene in {self.path}')
            self._scenes[number] = Scene.from_parameters(make_parameters(parameters.parameters()))
        return self._scenes[number]

    def close(self) -> None:
        """
        Let go of the files.
        """
        self._reader.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def _require_poses(self) -> None:
        if f'{self.node}/poses' not in self.topics:
            raise BagError(
                f'{self.path} holds no poses (a geometry_msgs/PoseArray on .../poses); its topics: '
                f'{", ".join(sorted(self.topics)) or "none"}'
            )


@dataclass(frozen=True)
class BagSummary:
    """
    What there is to say of a recorded run without looking at every pose.
    """

    path: Path
    size: int  # [bytes]
    topics: dict[str, BagTopic]
    start: int  # [ns]
    end: int
    custom: dict[str, str]
    scene: Scene | None
    inputs: tuple[RecordedInput, ...]
    first: PoseFrame | None
    last: PoseFrame | None

    @property
    def proximity(self) -> str:
        """
        Sentence on shells that came too close; '': none did.
        """
        return _unless_none(self.custom.get('proximity', ''))

    @property
    def failure(self) -> str:
        """
        Why the run stopped early; '': it did not.
        """
        return _unless_none(self.custom.get('failure', ''))

    @property
    def finished(self) -> bool:
        """
        Whether the recorder came to its end: a bag that was recovered lacks the last word.
        """
        return 'failure' in self.custom

    @property
    def largest_displacement(self) -> tuple[float, int]:
        """
        Largest distance [m] of a body between first and last pose, and its number; (0, -1) without poses.
        """
        if (
            self.first is None
            or self.last is None
            or self.first.position.shape != self.last.position.shape
        ):
            return 0.0, -1
        distance = np.linalg.norm(self.last.position - self.first.position, axis=1)
        body = int(np.argmax(distance))
        return float(distance[body]), body

    def rows(self) -> list[Row]:
        """
        Label and text of everything.
        """
        span = seconds(self.end - self.start)
        rows = [
            ('bag', f'{self.path} ({self.size / 1e6:.3g} MB)'),
            ('span', f'{seconds(self.start):.6g} s to {seconds(self.end):.6g} s of simulated time'),
        ]
        for name in sorted(self.topics):
            topic = self.topics[name]
            rate = f', {(topic.message_count - 1) / span:.4g} Hz' if span > 0.0 else ''
            rate = '' if topic.message_count < 3 else rate
            count = f'{topic.message_count:,} message{"s" if topic.message_count != 1 else ""}'
            rows.append(('topics' if rows[-1][0] == 'span' else '', f'{name}: {count}{rate} ({topic.type_name})'))  # fmt: skip
        if self.scene is not None:
            weave = self.scene.weave
            rows.append(
                (
                    'scene',
                    f'{weave.kind} weave, variant {weave.variant}, {" x ".join(map(str, weave.size))}: '
                    f'{self.scene.body_count:,} bodies, {self.scene.connector_count:,} connectors',
                )
            )
        rows += self._origin()
        rows += self._input_rows()
        for label, frame in (('first poses', self.first), ('last poses', self.last)):
            if frame is not None:
                low, high = frame.position.min(axis=0), frame.position.max(axis=0)
                rows.append(
                    (
                        label,
                        f't = {frame.time:.6g} s: centres from {vector(low, "m")} to {vector(high, "m")}',
                    )
                )
        distance, body = self.largest_displacement
        if body >= 0:
            rows.append(('moved', f'by up to {distance:.4g} m between them (body {body})'))
        rows.append(('overlap', self.proximity or ('none' if self.finished else 'not known')))
        rows.append(('end', self.failure or _ending(self.custom, self.finished)))
        return rows

    def lines(self) -> list[str]:
        """
        Text of everything, one line each.
        """
        return as_lines(self.rows())

    def _origin(self) -> list[Row]:
        custom = self.custom
        if not custom:
            return [('recorded by', 'unknown: the bag holds nothing of this simulator')]
        rows = [('recorded by', f'icofabric_sim {custom.get("version", "?")}')]
        if 'method' in custom:
            rows.append(('method', f'{custom["method"]}, first step {custom.get("step", "?")} s'))
        if 'processor' in custom:
            libraries = json.loads(custom.get('libraries', '{}'))
            versions = ', '.join(f'{name} {version}' for name, version in libraries.items())
            rows.append(('machine', f'{custom["processor"]}, Python {custom.get("python", "?")}, {versions}'))  # fmt: skip
        return rows

    def _input_rows(self) -> list[Row]:
        if not self.inputs:
            return [('inputs', 'none received')]
        rows = [('inputs', f'{len(self.inputs):,} received')]
        for entry in self.inputs[:_LARGEST_LIST]:
            what = 'cleared' if entry.is_zero else (
                f'force {vector(entry.force, "N")}, torque {vector(entry.torque, "N m")}'
            )  # fmt: skip
            frame = f' ({entry.frame_id})' if entry.frame_id else ''
            rows.append(('', f't = {entry.time:.9g} s  {entry.topic}{frame}: {what}'))
        if len(self.inputs) > _LARGEST_LIST:
            rows.append(('', f'... and {len(self.inputs) - _LARGEST_LIST:,} more'))
        return rows


def summarise_bag(path: str | Path) -> BagSummary:
    """
    Summarise a bag folder or file; BagError says what is wrong with it.
    """
    with RecordedRun(path) as run:
        first = last = None
        if f'{run.node}/poses' in run.topics:
            times = run.pose_times()
            if len(times):
                frames = list(run.poses([times[0], times[-1]]))
                first, last = frames[0], frames[-1]
        scene = run.scene_at(run.start) if run.scene_texts() else None
        files = run.path.rglob('*') if run.path.is_dir() else [run.path]
        return BagSummary(
            path=run.path,
            size=sum(file.stat().st_size for file in files if file.is_file()),
            topics=dict(run.topics),
            start=run.start,
            end=run.end,
            custom=run.custom,
            scene=scene,
            inputs=tuple(run.inputs()),
            first=first,
            last=last,
        )


def active_inputs(inputs: Sequence[RecordedInput], time: int) -> list[RecordedInput]:
    """
    The wrench that holds on each channel at `time` [ns], hold times not counted; zero ones left out.
    """
    latest: dict[tuple[str, str], RecordedInput] = {}
    for entry in inputs:
        if entry.nanoseconds <= time:
            # Wrenches on single bodies share a topic and are told apart by their frame.
            latest[entry.topic, entry.frame_id] = entry
    return [entry for entry in latest.values() if not entry.is_zero]


def _unless_none(text: str) -> str:
    return '' if text == 'none' else text


def _ending(custom: dict[str, str], finished: bool) -> str:
    if not custom:
        return 'closed properly'
    if not finished:
        return 'the recorder was killed: this is what was saved of the run'
    if custom.get('interrupted') == 'true':
        return 'interrupted by the user; closed properly'
    return 'closed properly'
