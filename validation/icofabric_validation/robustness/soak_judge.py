# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of soak.py without ROS: clock, memory, bags; and the table of results."""

from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from icofabric_sim.bag import BagError
from icofabric_sim.bag.recorded_run import RecordedEvent, RecordedRun
from icofabric_sim.commands.report import write_csv
from icofabric_sim.messages.schedule import Schedule
from icofabric_sim.running.replay.verify import verify_run
import numpy as np

NANOSECONDS = 1e9


class Moments(NamedTuple):
    """Simulated times [ns] at which the clock may publish off its grid."""

    shown: set[int]  # published states, which are repeated while the simulation is paused
    stepped: set[int]  # ends of steps, which publish the clock only at their end
    jumped: set[int]  # targets of time jumps


def clock_moments(events: Iterable[tuple[str, float, dict[str, Any]]], begin: int) -> Moments:
    """Collect moments from events (name, time [s], facts) of a run that starts at `begin` [ns]."""
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
    """Return sentences on ticks that are off the grid, missing or doubled."""
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


class RealTimeFactor(NamedTuple):
    """Simulated over wall time in both halves of a run, without disturbed intervals."""

    first: float  # half of the run
    second: float
    longest: float  # wall time between two ticks [s]

    @property
    def drift(self) -> float:
        """Increase of the factor from the first to the second half."""
        return self.second - self.first


def measure_real_time_factor(
    ticks: Sequence[tuple[float, int]], moments: Moments, rate: float
) -> RealTimeFactor:
    """Measure the factor from ticks (wall time [s], stamp [ns]) that are adjacent on the grid."""
    schedule = Schedule(rate)
    spans = [
        (wall, later - wall, (after - stamp) / NANOSECONDS)
        for (wall, stamp), (later, after) in zip(ticks, ticks[1:])
        if schedule.after(stamp) == after and not {stamp, after} & moments.shown]
    if len(spans) < 4:
        return RealTimeFactor(0.0, 0.0, 0.0)
    table = np.array(spans)
    half = table[:, 0] < 0.5 * (table[0, 0] + table[-1, 0])
    first, second = (part[:, 2].sum() / max(part[:, 1].sum(), 1e-9)
                     for part in (table[half], table[~half]))
    return RealTimeFactor(first, second, float(table[:, 1].max()))


def slope(times: Sequence[float], values: Sequence[float]) -> float:
    """Return the slope [1/s] over the second half, by least squares."""
    half = np.array(times) > 0.5 * (times[0] + times[-1])
    if half.sum() < 3:
        return 0.0
    return float(np.polyfit(np.array(times)[half], np.array(values)[half], 1)[0])


class BagCheck(NamedTuple):
    """The contents of a bag, and the results of its checks."""

    path: Path
    begin: int  # [ns]
    end: int
    inputs: int
    counts: dict[str, int]  # of repeated and compared messages
    verdict: str
    clock: list[str]  # faults of the clock

    @property
    def is_good(self) -> bool:
        """True if the bag verifies as identical and has every tick of the clock."""
        return self.verdict == 'identical' and not self.clock


def check_bag(path: Path, rate: float, *, threads: int = 0) -> BagCheck:
    """Read a bag, check its clock and verify the run."""
    try:
        with RecordedRun(path) as run:
            stamps = [
                time for name, time, _ in run.messages() if name == '/clock']
            moments = clock_moments(_facts(run.events()), run.start)
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
    """One result; `good` is None without a limit."""

    part: str
    name: str
    value: str
    limit: str
    good: bool | None


class Table:
    """Results that are printed immediately and written as CSV."""

    def __init__(self, *, wall_limits: bool = True) -> None:
        """Create a table; without `wall_limits` wall times have no limits."""
        self.part = ''
        self.rows: list[Row] = []
        self._wall_limits = wall_limits

    def begin(self, part: str, text: str) -> None:
        """Start a part."""
        self.part = part
        print(f'{part}: {text}', flush=True)

    def add(
        self, name: str, value: str, limit: str = '', good: bool | None = None, *,
        wall: bool = False,
    ) -> None:
        """Add a result with its limit; `wall` marks limits of wall time."""
        if wall and not self._wall_limits:
            good = None
        self.rows.append(Row(self.part, name, value, limit, good))
        word = {None: '', True: 'good', False: 'BAD'}[good]
        print(f'  {name:44s}  {value:>26s}  {limit:>22s}  {word}'.rstrip(), flush=True)

    def details(self, lines: Collection[str]) -> None:
        """Print the first lines of details of a result."""
        for line in list(lines)[:5]:
            print(f'      {line}')

    @property
    def is_good(self) -> bool:
        """True if at least one result has a limit and no limit is exceeded."""
        judged = [row.good for row in self.rows if row.good is not None]
        return bool(judged) and all(judged)

    def write(self, path: Path) -> None:
        """Write the results as CSV."""
        words = {None: '', True: 'yes', False: 'no'}
        write_csv(path, Row._fields, ([*row[:-1], words[row.good]] for row in self.rows))
