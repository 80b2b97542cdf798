# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Tables and CSV file of `contact`."""

from pathlib import Path

from icofabric_sim.commands.report import write_csv
from icofabric_validation.benchmarks.contact import (
    APART,
    COLLIDE,
    Contact,
    DISTANCE,
    FORCE,
    LIBRARY,
    STORED_AXIS,
)
from icofabric_validation.benchmarks.machine import machine_lines
from icofabric_validation.benchmarks.report import table

# Pairs of a test of the package and the closest test of the library.
COMPARED = ((STORED_AXIS, COLLIDE), (APART, COLLIDE), (APART, DISTANCE), (FORCE, DISTANCE))


def lines(result: Contact) -> list[str]:
    """Return tables for a terminal."""
    times = [['pairs, and how many touch', 'what is found', 'ns for each pair, median (range)']]
    ratios = [['the library over ours', '', 'median (range)']]
    for family, share in result.touching.items():
        label = f'{family}: {100.0 * share:.0f} %'
        for row in result.rows:
            if row.family == family:
                times.append([label, row.what, row.per_pair().text()])
                label = ''
        label = family
        for ours, theirs in COMPARED:
            ratio = result.ratio(family, ours, theirs)
            if ratio is not None:
                ratios.append([label, f'{theirs} / {ours}', ratio.text()])
                label = ''
    answer = [
        f'Contact of pairs of shells: {result.pair_count:,} of each kind; {result.rounds} rounds',
        *machine_lines((LIBRARY,), threads='processor time of one thread'), '', *table(times)]
    if result.missing:
        return [*answer, '', result.missing]
    return [
        *answer, '', *table(ratios), '',
        f'{LIBRARY} is called from Python, pair by pair; far pairs show what a call costs.',
        f'{result.missed} of {result.compared:,} pairs touch by {LIBRARY} only.']


def write(result: Contact, folder: Path) -> list[Path]:
    """Write the results into `folder`; return their paths."""
    return [write_csv(
        folder / 'contact.csv',
        ('pairs', 'touching', 'what', 'ns_per_pair', 'low', 'high', 'rounds'), (
            [row.family, f'{result.touching[row.family]:.4g}', row.what,
             *(f'{value:.4g}' for value in row.per_pair()), result.rounds]
            for row in result.rows))]
