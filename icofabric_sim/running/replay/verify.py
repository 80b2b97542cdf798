# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Verification of a bag: its scene and inputs are simulated again and all outputs compared.

On the same processor type and with the same versions every output must be bit-identical. Otherwise
round-off differs, so poses must agree within the tolerance, amplified by the error growth of this
motion, as long as the amplified error is meaningful. No output may be missing, and no additional
one may exist.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
import json
from pathlib import Path
from typing import NamedTuple

from icofabric_sim.bag.recorded_run import RecordedRun
from icofabric_sim.checks import counted
from icofabric_sim.messages.schedule import seconds
from icofabric_sim.messages.topics import full_name
from icofabric_sim.running.replay.comparison import CloseComparison, ExactComparison
from icofabric_sim.running.replay.completeness import Completeness, Gap
from icofabric_sim.running.replay.resimulation import (
    Departure,
    NotRepeatable,
    resimulate_to,
    Resimulation,
)
from icofabric_sim.scene.summary import as_lines, Row
from icofabric_sim.version import __version__

__all__ = ['Difference', 'Resimulation', 'resimulate_to', 'Verification', 'verify_run']

# Libraries that affect the results, besides the version.
_LIBRARIES = ('numpy', 'scipy', 'numba', 'llvmlite')


class Difference(NamedTuple):
    """First output that differs from the second simulation."""

    nanoseconds: int
    step: int  # solver steps repeated until then
    topic: str  # '': the runs diverged
    text: str  # body, quantity, both values

    def __str__(self) -> str:
        """Return a sentence."""
        topic = f', {self.topic}' if self.topic else ''
        return f't = {seconds(self.nanoseconds):.9f} s (step {self.step:,}){topic}: {self.text}'


@dataclass(frozen=True)
class Verification:
    """Result of the verification of one fabric in a bag."""

    path: Path
    node: str
    recorded_by: str
    elsewhere: tuple[str, ...]  # differences of version and machine; empty: bits were compared
    start: int  # [ns]
    end: int
    body_count: int
    compared: Counter[str]  # messages by topic
    left_out: Counter[str]  # outputs that could not be compared
    repeated: Counter[str]  # inputs, re-weaves, ...
    difference: Difference | None
    gaps: tuple[Gap, ...]  # recorded outputs that are missing
    dropped: Counter[str]  # outputs dropped because of a slow disk, as recorded in the bag
    note: str

    @property
    def verdict(self) -> str:
        """Return the verdict: identical, consistent, incomplete, or differs."""
        if self.difference is not None:
            return 'differs'
        if self.gaps:
            return 'incomplete'
        return 'consistent' if self.elsewhere else 'identical'

    @property
    def is_good(self) -> bool:
        """Return whether nothing differs or is missing."""
        return self.difference is None and not self.gaps

    def lines(self) -> list[str]:
        """Return the report as text; the verdict is the first word of the last line."""
        return [*as_lines(self.rows()), self.conclusion()]

    def rows(self) -> list[Row]:
        """Return label and text of the compared messages."""
        rows: list[Row] = [
            ('bag', str(self.path)),
            ('fabric', f'{self.node}, {counted(self.body_count, "body")}'),
            ('recorded by', self.recorded_by),
            ('compared', 'bit by bit: same version, processor type and libraries'
             if not self.elsewhere else
             'within tolerance and growth, because ' + '; '.join(self.elsewhere)),
            ('repeated', ', '.join(_counted(self.repeated)) or 'no inputs, no changes'),
        ]
        if self.left_out:
            rows.append(('not compared', ', '.join(_counted(self.left_out))))
        if self.dropped:
            rows.append(('not recorded', ', '.join(
                f'{count:,} of {name}' for name, count in self.dropped.items())
                + ': the disk was too slow, according to the bag'))
        rows += [('missing' if number == 0 else '', str(gap))
                 for number, gap in enumerate(self.gaps)]
        if self.note:
            rows.append(('note', self.note))
        return rows

    def conclusion(self) -> str:
        """Return the verdict with the span and the numbers."""
        count = sum(self.compared.values())
        span = f't = {seconds(self.start):.9g} s to {seconds(self.end):.9g} s'
        kinds = ', '.join(_counted(self.compared))
        last = f'{self.verdict}: {count:,} outputs from {span} ({kinds})'
        if self.difference is not None:
            last = f'{self.verdict} at {self.difference}'
        elif self.gaps:
            missing = sum(gap.messages for gap in self.gaps)
            what = 'message is' if missing == 1 else 'messages are'
            last = (f'{self.verdict}: {missing:,} recorded {what} missing; the {count:,} outputs '
                    f'from {span} present ({kinds}) are '
                    f'{"consistent" if self.elsewhere else "identical"}')
        return last


def verify_run(
    run: RecordedRun,
    *,
    threads: int = 0,
    start: int | None = None,
    stop: int | None = None,
    on_time: Callable[[int], None] = lambda time: None,
) -> Verification:
    """
    Simulate a recorded run again and compare, up to the first difference.

    `start` selects the last checkpoint not after that time [ns]; `stop` [ns] is the last time
    compared. `threads` replaces the scene's number. `on_time` receives the time [ns] from time to
    time. Raises NotRepeatable if the run cannot be simulated again.
    """
    elsewhere = foreign_parts(run)
    compared: Counter[str] = Counter()
    left_out: Counter[str] = Counter()
    kind = CloseComparison if elsewhere else ExactComparison
    comparison = kind(run, lambda: again.simulation)
    record = Completeness(run, lambda: again.present, exact=not elsewhere)
    again = Resimulation(
        run, threads=threads, start=start, on_time=on_time, on_input=comparison.acted,
        on_jump=comparison.jumped, on_message=record.take)
    found: Difference | None = None
    gaps: list[Gap] = []
    end = again.start
    try:
        if again.begins_later:
            record.begin_at(again.start)
        for topic, time, data in again.outputs(None if stop is None else stop + 1):
            text = comparison.difference(topic, time, data)
            if text:
                found = Difference(
                    time, again.simulation.status.step_count, full_name(topic.name, run.node),
                    text)
                break
            counts = left_out if text is None else compared
            counts[topic.name] += 1
            end = time
        body_count = again.simulation.scene.body_count
        if found is None:
            gaps = record.end(stop, whole=start is None and stop is None)
    except Departure as departure:
        found = Difference(
            departure.nanoseconds, again.simulation.status.step_count, departure.topic,
            str(departure))
        body_count = again.simulation.scene.body_count
    if found is None and not compared:
        raise NotRepeatable(
            f'{run.path} contains nothing of {run.node} to compare between t = '
            f'{seconds(again.start):.9g} s and {seconds(run.end if stop is None else stop):.9g} s')
    return Verification(
        run.path, run.node, _recorded_by(run), elsewhere, again.start, end, body_count, compared,
        left_out, again.counts, found, tuple(gaps), Counter(record.dropped),
        _note(comparison, again))


def foreign_parts(run: RecordedRun) -> tuple[str, ...]:
    """
    Return the differences of version and machine between recording and verification.

    Raises NotRepeatable for bags of other tools, which lack the times at which inputs acted.
    """
    if 'version' not in run.custom:
        raise NotRepeatable(
            f'{run.path} was not recorded by this simulator, so it lacks the times at which '
            'inputs acted; record with the parameter record.path, or with ~/record')
    from icofabric_sim.kernels.runtime.target import host_processor, kernel_target
    here = {
        'version': __version__, 'processor': host_processor(),
        **{name: metadata.version(name) for name in _LIBRARIES}}
    custom = run.custom
    if 'kernels' in custom:
        here['kernels'] = kernel_target()
    try:
        there = dict(json.loads(custom.get('libraries', '{}')))
    except (TypeError, ValueError):
        there = {}
    there.update(
        {name: custom[name] for name in ('version', 'processor', 'kernels') if name in custom})
    return tuple(
        f'{name} was {there.get(name, "not noted")} and is {here[name]} here'
        for name in here if there.get(name) != here[name])


def _recorded_by(run: RecordedRun) -> str:
    custom = run.custom
    text = f'icofabric_sim {custom["version"]}, {custom.get("processor", "unknown processor")}'
    return f'{text}, {custom["method"]}' if 'method' in custom else text


def _note(comparison: ExactComparison | CloseComparison, again: Resimulation) -> str:
    notes = []
    if again.failure:
        notes.append(
            'the recorded run failed at its end, and so does the second simulation: '
            f'{again.failure}')
    if isinstance(comparison, CloseComparison):
        notes.append(
            f'largest difference {comparison.largest:.2g} (position over half edge a, or rad), '
            f'allowed {comparison.bound_there:.2g}')
        if comparison.meaningless_since is not None:
            notes.append(
                f'from t = {seconds(comparison.meaningless_since):.6g} s on, small differences '
                'have grown so much that poses are meaningless')
    return '; '.join(notes)


def _counted(counts: Counter[str]) -> list[str]:
    """Return each kind with its count as text."""
    return [
        name if name.startswith('begun') else
        f'{count:,} {(name.removeprefix("~/").removeprefix("/") if count != 1 else _one(name))}'
        for name, count in counts.items()]


def _one(name: str) -> str:
    return name.removeprefix('~/').removeprefix('/').removesuffix('s')
