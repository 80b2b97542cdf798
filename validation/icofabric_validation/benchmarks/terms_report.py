# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Tables and CSV file of `terms`."""

from pathlib import Path

from icofabric_sim.commands.report import write_csv
from icofabric_validation.benchmarks.machine import machine_lines
from icofabric_validation.benchmarks.report import table
from icofabric_validation.benchmarks.step_speed import STEP
from icofabric_validation.benchmarks.terms import ADAPTIVE, BARE, KERNEL, LEANEST, Terms, UNWATCHED


def lines(result: Terms) -> list[str]:
    """Return tables for a terminal."""
    bare = result.row(BARE)
    assert bare is not None and bare.held is not None
    costs = [['one thing more', 'ns per body and step, median (range)', 'over its bare scene',
              'bytes of its arrays']]
    for row in result.rows:
        base = result.row(row.over) or bare
        assert base.held is not None
        more = '-' if row.held is None else f'{row.held - base.held:,}'
        ratio = result.ratio(row)
        assert ratio is not None
        costs.append([row.label, row.per_body().text(), ratio.text(), more])
    answer = [
        f'Cost of each term: leapfrog (below {ADAPTIVE!r}: that method), {STEP:g} s, '
        f'{bare.body_count:,} bodies; {result.rounds} rounds',
        *machine_lines((), threads='one thread but for the team'),
        '', *table(costs), '',
        f'All arrays of the bare scene: {bare.held:,} bytes, '
        f'{bare.held / bare.body_count:.0f} for each body; none belongs to a term that is absent:',
        *_wrapped([f'{name} {size:,}' for name, size in result.bare_arrays.items()])]
    if result.instructions:
        counts = [['instructions in the loop', 'bare scene', 'springs-only kernel',
                   'one kick a step', 'difference']]
        for entry in result.instructions:
            difference = entry.difference()
            counts.append([
                entry.kernel, *('-' if value is None else str(value) for value in (
                    entry.package, entry.springs_only, entry.leanest)),
                '-' if difference is None else f'{100.0 * difference:+.1f} %'])
        answer += ['', *table(counts)]
    unwatched = result.row(UNWATCHED)
    for label in (KERNEL, LEANEST):
        other = result.ratio(unwatched, label) if unwatched is not None else None
        if other is not None:
            answer += [f'bare scene without health checks over {label}: {other.text()}']
    return answer + ([''] + result.remarks if result.remarks else [])


def write(result: Terms, folder: Path) -> list[Path]:
    """Write the results into `folder`; return their paths."""
    return [
        write_csv(
            folder / 'terms.csv',
            ('term', 'bodies', 'ns_per_body_step', 'low', 'high', 'over_bare', 'low', 'high',
             'bytes_held', 'rounds'), (
                [row.label, row.body_count, *(f'{value:.4g}' for value in row.per_body()),
                 *(f'{value:.4g}' for value in result.ratio(row) or ()),
                 '' if row.held is None else row.held, result.rounds]
                for row in result.rows)),
        write_csv(
            folder / 'instructions.csv',
            ('kernel', 'bare_scene', 'springs_only', 'one_kick_a_step'), result.instructions)]


def _wrapped(words: list[str]) -> list[str]:
    answer = ['']
    for word in words:
        if len(answer[-1]) + len(word) > 94:
            answer.append('')
        answer[-1] += ('  ' if answer[-1] else '') + word
    return answer
