# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""For soak.py: what is judged, without ROS: ticks of the clock, memory, bags; and the table."""

from collections.abc import Collection, Iterable, Sequence
import csv
from pathlib import Path
from typing import Any, NamedTuple

from icofabric_sim.bag import BagError
from icofabric_sim.bag.recorded_run import RecordedEvent, RecordedRun
from icofabric_sim.messages.schedule import Schedule
from icofabric_sim.running.replay.verify import verify_run
import numpy as np

NANOSECONDS = 1e9


class Moments(NamedTuple):
    """Simulated times [ns] at which the clock may do more than tick."""

    shown: set[int]  # the state is shown, and repeated while time stands still
    stepped: set[int]  # reached by steps, which tick at their end only
    jumped: set[int]  # time has jumped there


def moments_of(events: Iterable[tuple[str, float, dict[str, Any]]], begin: int) -> Moments:
    """From the events (name, time [s], facts) of a run that begins at `begin` [ns]."""
    shown, stepped, jumped = {begin}, set(), {begin}
    for name, time, facts in events:
        at = round(time * NANOSECONDS)
        shown.add(at)
        if name == 'step':
            stepped.add(at)
        if name == 'reset' and facts.get('time_reset'):
            jumped.add(0)
        if name == 'checkpoint_restored':
            jumped.add(round(facts['of'] * NANOSECONDS))
    return Moments(shown | jumped, stepped, jumped)


def clock_faults(stamps: Sequence[int], moments: Moments, rate: float) -> list[str]:
    """Ticks that are off the grid, missing, or there twice, in words."""
    schedule, faults = Schedule(rate), []
    previous: int | None = None
    for stamp in stamps:
        if not schedule.is_due(stamp) and stamp not in moments.shown:
            faults.append(f'{stamp} ns is off the grid of {rate:g} Hz')
        if previous is None or stamp in moments.jumped:
            pass
        elif stamp == previous and stamp not in moments.shown:
            faults.append(f'{stamp} ns came twice')
        elif stamp < previous:
            faults.append(f'{stamp} ns came after {previous} ns')
        elif schedule.after(previous) < stamp and stamp not in moments.stepped:
            faults.append(f'nothing between {previous} ns and {stamp} ns')
        previous = stamp
    return faults


class Pace(NamedTuple):
    """Simulated over wall time while time ran undisturbed."""

    first: float  # half
    second: float
    longest: float  # wall time between two ticks [s]

    @property
    def drift(self) -> float:
        """How much faster it has become."""
        return self.second - self.first


def pace_of(ticks: Sequence[tuple[float, int]], moments: Moments, rate: float) -> Pace:
    """From ticks (wall time [s], stamp [ns]) that follow each other on the grid."""
    schedule, spans = Schedule(rate), []
    for (wall, stamp), (later, after) in zip(ticks, ticks[1:]):
        if schedule.after(stamp) == after and not {stamp, after} & moments.shown:
            spans.append((wall, later - wall, (after - stamp) / NANOSECONDS))
    if len(spans) < 4:
        return Pace(0.0, 0.0, 0.0)
    table = np.array(spans)
    half = table[:, 0] < 0.5 * (table[0, 0] + table[-1, 0])
    first, second = (part[:, 2].sum() / max(part[:, 1].sum(), 1e-9)
                     for part in (table[half], table[~half]))
    return Pace(first, second, float(table[:, 1].max()))


def slope(times: Sequence[float], values: Sequence[float]) -> float:
    """Rise for each second over the second half, by least squares."""
    half = np.array(times) > 0.5 * (times[0] + times[-1])
    if half.sum() < 3:
        return 0.0
    return float(np.polyfit(np.array(times)[half], np.array(values)[half], 1)[0])


class BagCheck(NamedTuple):
    """What is in a bag, and whether it is right."""

    path: Path
    begin: int  # [ns]
    end: int
    inputs: int
    counts: dict[str, int]  # of what was done again and compared
    verdict: str
    clock: list[str]  # its faults

    @property
    def is_good(self) -> bool:
        """Whether it verifies, with every tick of the clock."""
        return self.verdict == 'identical' and not self.clock


def check_bag(path: Path, rate: float, *, threads: int = 0) -> BagCheck:
    """Read a bag, look at its clock and simulate it again."""
    try:
        with RecordedRun(path) as run:
            stamps = [
                time for name, time, _ in run.messages() if name == '/clock']
            moments = moments_of(_facts(run.events()), run.start)
            faults = clock_faults(stamps, moments, rate)
            inputs = len(run.inputs())
            done = verify_run(run, threads=threads)
            verdict = done.verdict if done.is_good else done.lines()[-1]
            return BagCheck(
                path, run.start, run.end, inputs, {**done.repeated, **done.compared}, verdict,
                faults)
    except (BagError, ValueError) as error:
        return BagCheck(path, 0, 0, 0, {}, f'{type(error).__name__}: {error}', [])


def _facts(events: Iterable[RecordedEvent]) -> Iterable[tuple[str, float, dict[str, Any]]]:
    for event in events:
        yield event.name, event.time, dict(event.facts)


class Row(NamedTuple):
    """A figure; `good` is None where nothing is judged by it."""

    part: str
    name: str
    value: str
    limit: str
    good: bool | None


class Table:
    """Figures, printed as they come, then written as CSV."""

    def __init__(self, *, wall_limits: bool = True) -> None:
        """Without `wall_limits` figures in wall time are shown and not judged."""
        self.part = ''
        self.rows: list[Row] = []
        self._wall_limits = wall_limits

    def begin(self, part: str, text: str) -> None:
        """Head a part."""
        self.part = part
        print(f'{part}: {text}', flush=True)

    def add(
        self, name: str, value: str, limit: str = '', good: bool | None = None, *,
        wall: bool = False,
    ) -> None:
        """A figure with its limit; `wall` where that is one on wall time."""
        if wall and not self._wall_limits:
            good = None
        self.rows.append(Row(self.part, name, value, limit, good))
        word = {None: '', True: 'good', False: 'BAD'}[good]
        print(f'  {name:44s}  {value:>26s}  {limit:>22s}  {word}'.rstrip(), flush=True)

    def details(self, lines: Collection[str]) -> None:
        """What is behind a figure, the first few."""
        for line in list(lines)[:5]:
            print(f'      {line}')

    @property
    def is_good(self) -> bool:
        """Whether something was judged and nothing is bad."""
        judged = [row.good for row in self.rows if row.good is not None]
        return bool(judged) and all(judged)

    def write(self, path: Path) -> None:
        """As CSV."""
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open('w', newline='', encoding='utf-8') as file:
            writer = csv.writer(file)
            writer.writerow(Row._fields)
            for row in self.rows:
                word = {None: '', True: 'yes', False: 'no'}[row.good]
                writer.writerow([*row[:-1], word])
