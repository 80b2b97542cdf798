# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Summary of a recorded run as text."""

from dataclasses import dataclass
from datetime import datetime, UTC
import json
import math
from pathlib import Path

from icofabric_sim.bag import BagTopic
from icofabric_sim.bag.event_text import digest_events, event_rows, EventDigest
from icofabric_sim.bag.recorded_run import PoseFrame, RecordedInput, RecordedRun
from icofabric_sim.bag.storage import CONTINUED, FILE_INDEX
from icofabric_sim.messages.schedule import seconds
from icofabric_sim.messages.topics import CHECKPOINT
from icofabric_sim.scene.scene import Scene
from icofabric_sim.scene.summary import (
    amplification_text,
    as_lines,
    evaluations_text,
    Row,
    size_text,
    vector,
)
import numpy as np

# Largest number of listed inputs; a joystick sends thousands.
_MAX_LISTED_INPUTS = 12
# Later times [ns] are wall times, in a bag recorded by another tool.
_MAX_SIMULATED_NS = 10**18


def span_text(start: int, end: int) -> str:
    """Return the interval [ns] of a bag as text, relative to its start for wall times."""
    if start <= _MAX_SIMULATED_NS:
        return f'{seconds(start):.6g} s to {seconds(end):.6g} s of simulated time'
    began = datetime.fromtimestamp(seconds(start), UTC)
    return f'{seconds(end - start):.6g} s from {began:%F %T} UTC'


@dataclass(frozen=True)
class BagSummary:
    """Summary of a recorded run, without reading every pose."""

    path: Path
    node: str
    size: int  # [bytes]
    topics: dict[str, BagTopic]
    start: int  # [ns]
    end: int
    custom: dict[str, str]
    scene: Scene | None
    inputs: tuple[RecordedInput, ...]
    events: EventDigest
    checkpoints: tuple[int, ...]  # times [ns] of checkpoints inside the bag
    first: PoseFrame | None
    last: PoseFrame | None
    breaks: np.ndarray | None  # (m, 2) connector and time [s]; None: not recorded

    @property
    def overlap_text(self) -> str:
        """Sentence on excessive overlap of shells, or ''."""
        return _unless_none(self.custom.get('proximity', ''))

    @property
    def failure(self) -> str:
        """Return why the run stopped early, or ''."""
        return _unless_none(self.custom.get('failure', ''))

    @property
    def finished(self) -> bool:
        """Return whether the recorder closed the bag, which adds `failure` to the custom data."""
        return 'failure' in self.custom

    @property
    def largest_displacement(self) -> tuple[float, int]:
        """
        Return the largest distance [m] of a body between first and last pose, and its number.

        The number is -1 if there is nothing to compare.
        """
        if (
            self.first is None
            or self.last is None
            or self.first.position.shape != self.last.position.shape
        ):
            return 0.0, -1
        distance = np.linalg.norm(self.last.position - self.first.position, axis=1)
        row = int(np.argmax(distance))
        chosen = None if self.scene is None else self.scene.published_bodies
        return float(distance[row]), row if chosen is None else int(chosen[row])

    def rows(self) -> list[Row]:
        """Return label and text of all lines."""
        rows = [
            ('bag', f'{self.path} ({self.size / 1e6:.3g} MB)'),
            ('span', span_text(self.start, self.end)),
        ]
        if FILE_INDEX in self.custom:
            rows.append((
                'file', f'number {self.custom[FILE_INDEX]} of a split bag, from 0; earlier files '
                        'contain '
                'the inputs and events before it'))
        rows += self._topic_rows()
        if self.scene is not None:
            weave, scene = self.scene.weave, self.scene
            size = ' x '.join(str(count) for count in weave.size)
            rows.append((
                'scene', f'{weave.kind} weave, variant {weave.variant}, {size}: '
                + size_text(scene)))
        rows += self._origin()
        rows += self._input_rows()
        if f'{self.node}/events' in self.topics:
            rows += event_rows(self.events)
        if self.checkpoints:
            rows.append(('checkpoints', self._checkpoint_text()))
        if 'messages_dropped' in self.custom:
            rows.append(('dropped',f'{self.custom["messages_dropped"]} messages: the disk was '
                         'too slow; inputs are complete'))
        for label, frame in (('first poses', self.first), ('last poses', self.last)):
            if frame is not None:
                low, high = frame.position.min(axis=0), frame.position.max(axis=0)
                rows.append((
                    label, f't = {frame.time:.6g} s: centres from {vector(low, "m")} to '
                    f'{vector(high, "m")}'))
        distance, body = self.largest_displacement
        if body >= 0:
            rows.append((
                'moved', f'largest displacement between first and last poses: {distance:.4g} m '
                f'(body {body})'))
        rows += self._broken()
        rows.append(('overlap', self.overlap_text or ('none' if self.finished else 'not known')))
        if _unless_none(self.custom.get('obstruction', '')):
            rows.append(('', self.custom['obstruction']))
        rows.append(('end', self.failure or self._ending()))
        return rows

    def lines(self) -> list[str]:
        """Return the lines as text."""
        return as_lines(self.rows())

    def _topic_rows(self) -> list[Row]:
        span = seconds(self.end - self.start)
        rows: list[Row] = []
        for name in sorted(self.topics):
            topic = self.topics[name]
            text = f'{name}: {topic.message_count:,} message'
            text += '' if topic.message_count == 1 else 's'
            if span > 0.0 and topic.message_count > 2:
                text += f', {(topic.message_count - 1) / span:.4g} Hz'
            rows.append(('' if rows else 'topics', f'{text} ({topic.type_name})'))
        return rows

    def _broken(self) -> list[Row]:
        """Describe broken connectors and anchors, if any can break."""
        can = self.scene is not None and self.scene.can_break
        if self.breaks is None or not (can or len(self.breaks)):
            return []
        if not len(self.breaks):
            return [('broken', 'none')]
        (first, begin), (_, end) = self.breaks[0], self.breaks[-1]
        anchors = sum(1 for number, _ in self.breaks if number < 0)
        counts = (len(self.breaks) - anchors, 'connectors'), (anchors, 'anchors')
        what = ' and '.join(f'{count:,} {word}' for count, word in counts if count)
        one = f'connector {first:.0f}' if first >= 0 else f'anchor {-1 - first:.0f}'
        return [('broken', f'{what}, from t = {begin:.6g} s ({one}) to t = {end:.6g} s')]

    def _origin(self) -> list[Row]:
        custom = self.custom
        if not custom:
            return [('recorded by', 'unknown: the bag contains no data of this simulator')]
        rows = [('recorded by', f'icofabric_sim {custom.get("version", "?")}')]
        if 'animation' in custom:
            rows.append(('animation', f'{custom["animation"]}; not simulated'))
        if 'method' in custom:
            reason = f': {custom["method_reason"]}' if 'method_reason' in custom else ''
            rows.append((
                'method', f'{custom["method"]}, first step {custom.get("step", "?")} s{reason}'))
        rows += self._accuracy()
        if 'processor' in custom:
            rows.append((
                'machine', f'{custom["processor"]}, Python {custom.get("python", "?")}'
                f'{_versions(custom.get("libraries", ""))}{_threads(custom)}'))
        return rows

    def _accuracy(self) -> list[Row]:
        """Return the accuracy reached; bags of killed runs and of older versions lack it."""
        rows: list[Row] = []
        if 'tolerance' in self.custom:
            text = f'solver.tolerance is {self.number("tolerance"):g} per second'
            estimate, rate = self.number('error_estimate'), self.number('error_rate')
            lack = 'not estimated' if 'error_estimate' in self.custom else 'not measured'
            rows.append(('accuracy', f'{lack}; {text}' if math.isnan(estimate) else (
                f'error estimate {estimate:.2g} in total, {rate:.2g} per second at the end '
                f'(position over a, or rad); {text}')))
            lacks = self.custom.get('error_estimate_lacks', 'nothing')
            if lacks != 'nothing' and not math.isnan(estimate):
                rows.append(('', f'not included: {lacks}'))
        if 'growth' in self.custom:
            at_least = self.custom.get('growth_is_at_least') == 'true'
            until = self.number('meaningful_until')
            meaning = 'to the end' if until == math.inf else f'until t = {until:.4g} s'
            rows.append((
                'growth', 'a small disturbance grew '
                f'{amplification_text(self.number("growth"), at_least)}; '
                + ('the effect on errors is not known, because they were not estimated'
                   if math.isnan(until) else f'the trajectory is meaningful {meaning}')))
        if 'evaluation_count' in self.custom:
            rows.append(('evaluations', evaluations_text(
                self.number('evaluation_count'), self.number('estimation_count'),
                self.number('shown_count'),
                is_estimated=not math.isnan(self.number('error_estimate')))))
        if 'balance_worst' in self.custom:
            rows.append((
                'balance', f'largest energy error {self.number("balance_worst"):.1e} of the '
                'largest energy stored, exchanged or supplied'))
        return rows

    def number(self, name: str) -> float:
        """Return a number of the custom data, or NaN if it is missing."""
        try:
            return float(self.custom.get(name, ''))
        except ValueError:
            return math.nan

    def _input_rows(self) -> list[Row]:
        if not self.inputs:
            return [('inputs', 'none received')]
        rows = [('inputs', f'{len(self.inputs):,} received')]
        for entry in self.inputs[:_MAX_LISTED_INPUTS]:
            what = 'cleared' if entry.is_zero else (
                f'force {vector(entry.force, "N")}, torque {vector(entry.torque, "N m")}')
            frame = f' ({entry.frame_id})' if entry.frame_id else ''
            rows.append(('', f't = {entry.time:.9g} s  {entry.topic}{frame}: {what}'))
        if len(self.inputs) > _MAX_LISTED_INPUTS:
            rows.append(('', f'... and {len(self.inputs) - _MAX_LISTED_INPUTS:,} more'))
        return rows

    def _checkpoint_text(self) -> str:
        said = [f't = {seconds(time):.9g} s' for time in self.checkpoints[:_MAX_LISTED_INPUTS]]
        more = len(self.checkpoints) - len(said)
        return ', '.join(said) + (f' and {more:,} more' if more else '') + ' (in the bag)'

    def _ending(self) -> str:
        if 'recording_stopped' in self.custom:
            return f'the recording stopped before the run did: {self.custom["recording_stopped"]}'
        if CONTINUED in self.custom:
            return f'closed properly; the run continues in {self.custom[CONTINUED]}'
        if self.custom and not self.finished and 'animation' not in self.custom:
            return 'the recorder was killed: this is the recovered part of the run'
        if self.custom.get('interrupted') == 'true':
            return 'interrupted by the user; closed properly'
        return 'closed properly'


def summarise_bag(path: str | Path) -> BagSummary:
    """Summarise a bag folder or file; raise BagError if it is unreadable."""
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
            node=run.node,
            size=sum(file.stat().st_size for file in files if file.is_file()),
            topics=dict(run.topics),
            start=run.start,
            end=run.end,
            custom=run.custom,
            scene=scene,
            inputs=tuple(run.inputs()),
            events=digest_events(run.events()),
            checkpoints=tuple(run.times_of(CHECKPOINT.name)),
            first=first,
            last=last,
            breaks=next((breaks for _, breaks in reversed(run.breaks())), None),
        )


def _threads(custom: dict[str, str]) -> str:
    count = custom.get('threads', '')
    return f', {count} thread{"" if count == "1" else "s"}' if count else ''


def _unless_none(text: str) -> str:
    return '' if text == 'none' else text


def _versions(libraries: str) -> str:
    try:
        return ''.join(f', {name} {version}' for name, version in json.loads(libraries).items())
    except (ValueError, AttributeError):
        return ''
