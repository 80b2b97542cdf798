# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Tables, CSV file and picture of `scaling`."""

from pathlib import Path

from icofabric_sim.commands.report import write_csv
from icofabric_sim.libraries import require_library
from icofabric_validation.benchmarks.machine import machine_lines
from icofabric_validation.benchmarks.report import table
from icofabric_validation.benchmarks.scaling import Scaling, UNIT
from icofabric_validation.benchmarks.step_speed import STEP
from icofabric_validation.benchmarks.timing import Spread


def lines(result: Scaling) -> list[str]:
    """Return tables for a terminal."""
    speed = [['bodies', 'connectors', 'ns per body and step, one thread', 'threads',
              'ns with these', 'gain of threads', 'over 10,000 bodies', 'the same with threads']]
    for row in result.rows:
        speed.append([
            f'{row.body_count:,}', f'{row.connector_count:,}', row.per_body(row.one).text(),
            str(row.threads), row.per_body(row.all).text(), row.gain().text(),
            *(_text(result.relative(row, threads=threads)) for threads in (False, True))])
    waits = [['bodies', 'build', 'compile_scene', 'first in a process', 'peak memory',
              'for each body', 'while recording', 'for each body']]
    for row in result.rows:
        waits.append([
            f'{row.body_count:,}', _seconds(row.wait('build')), _seconds(row.wait('compile')),
            _seconds(row.wait('compile_first')),
            *(f'{peak:,.{digits}f} {unit}' for value in (row.memory, row.recording)
              for peak, digits, unit in (
                  (value / 2**20, 1, 'MiB'), (value / row.body_count, 0, 'B')))])
    answer = [
        f'Scaling, the fabric of S1 and S3 in other sizes; {result.rounds} rounds',
        *machine_lines((), threads='threads as stated'), '',
        f'Plain steps: leapfrog, {STEP:g} s, median (range); threads: as many as pay',
        *table(speed), '',
        'Waiting with kernels on disk, and peak resident memory above that of the interpreter',
        'which has run a small scene: build, compile and five steps; build, compile and a bag of',
        'four messages of each kind', *table(waits)]
    if result.first_ever:
        wait = result.first_ever
        answer += [
            '', f'The first ever run, no kernels on disk: import {_seconds(wait["import"])}, '
            f'compile_scene {_seconds(wait["compile_first"])}, first step '
            f'{_seconds(wait["step_first"])}; again {_seconds(wait["compile"])}']
    return answer


def write(result: Scaling, folder: Path) -> list[Path]:
    """Write results and picture into `folder`; return their paths."""
    path = write_csv(folder / 'scaling.csv', (
        'bodies', 'connectors', 'ns_per_body_step_one_thread', 'low', 'high', 'threads',
        'ns_per_body_step_threads', 'low', 'high', 'gain', 'low', 'high', 'build_s',
        'compile_s', 'compile_first_s', 'peak_bytes', 'peak_bytes_recording', 'rounds'), (
            [row.body_count, row.connector_count, *_numbers(row.per_body(row.one)),
             row.threads, *_numbers(row.per_body(row.all)), *_numbers(row.gain()),
             *(f'{row.wait(name):.4g}' for name in ('build', 'compile', 'compile_first')),
             f'{row.memory:.0f}', f'{row.recording:.0f}', result.rounds]
            for row in result.rows))
    picture = folder / 'scaling.png'
    draw(result, picture)
    return [path, picture]


def draw(result: Scaling, path: Path) -> None:
    """Draw the time per body and step over the number of bodies."""
    require_library('matplotlib', 'a picture')
    from matplotlib.figure import Figure
    figure = Figure(figsize=(8.0, 5.0), layout='constrained')
    axes = figure.add_subplot()
    counts = [row.body_count for row in result.rows]
    for label, times in (('one thread', [row.one for row in result.rows]),
                         ('as many as pay', [row.all for row in result.rows])):
        spreads = [row.per_body(values) for row, values in zip(result.rows, times)]
        below = [spread.median - spread.low for spread in spreads]
        above = [spread.high - spread.median for spread in spreads]
        axes.errorbar(counts, [spread.median for spread in spreads], yerr=(below, above),
                      marker='o', markersize=4, capsize=3, label=label)
    axes.set(xscale='log', xlabel='bodies', ylabel='ns for each body and step')
    axes.set_ylim(bottom=0.0)
    unit = UNIT[0] * UNIT[1] * UNIT[2] // 2
    axes.axvline(unit, color='0.8', linewidth=1, zorder=0)
    axes.grid(alpha=0.3)
    axes.legend(fontsize='small')
    figure.savefig(path, dpi=150)


def _text(spread: Spread | None) -> str:
    return '-' if spread is None else spread.text()


def _numbers(spread: Spread) -> list[str]:
    return [f'{value:.4g}' for value in spread]


def _seconds(value: float) -> str:
    return f'{value:.2f} s' if value >= 1.0 else f'{value * 1e3:.3g} ms'
