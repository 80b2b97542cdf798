# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Cost of surface tractions and tabulated laws over plain springs: alternating steps in one process.

Processor times of steps of `leapfrog`, with health checks and error estimates, over those of the
bare scene in the same round: median, minimum and maximum.

    .venv/bin/python -m icofabric_validation.benchmarks.tractions_and_tables
"""

import argparse
import logging
import statistics
import time
from typing import Any

from icofabric_validation.benchmarks.machine import describe_machine
from icofabric_validation.benchmarks.terms import compile_term, law_table, Term

BARE = 'springs alone'
_WARM_UP, _STEPS = 256, 320


def terms() -> list[Term]:
    """Return all surface tractions on the outside of a slab, and two sizes of tables."""
    air = {'group': 'all', 'faces': 'exterior', 'pressure': 1.0}
    pulse = {'profile': 'half_sine', 'duration': 1e3}
    kinds: dict[str, dict[str, Any]] = {
        'follower': {},
        'fixed direction': {'direction': 'fixed'},
        'fixed, without friction': {'direction': 'fixed', 'frictionless': True},
    }
    result = [Term(BARE, {})]
    for name, kind in kinds.items():
        result.append(Term(f'pressure, {name}', {'tractions': {'air': {**air, **kind}}}))
        result.append(Term(
            f'pressure, {name}, with a time profile',
            {'tractions': {'air': {**air, **kind, **pulse}}}))
    for rows in (5, 100):
        result.append(Term(
            f'connector law, table of {rows} rows', {'connector': {'law': law_table(rows)}}))
    return result


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--rounds', type=int, default=9)
    parser.add_argument('--size', type=int, nargs=3, default=(8, 8, 8))
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)
    runs = {term.label: compile_term(tuple(arguments.size), term) for term in terms()}
    times: dict[str, list[float]] = {label: [] for label in runs}
    for simulation in runs.values():
        simulation.advance_steps(_WARM_UP)
    for _ in range(arguments.rounds):
        for label, simulation in runs.items():
            began = time.process_time()
            simulation.advance_steps(_STEPS)
            times[label].append((time.process_time() - began) / _STEPS)
    print(describe_machine())
    print(f'{runs[BARE].scene.body_count} bodies, springs alone: '
          f'{min(times[BARE]) * 1e6:.2f} us a step at the least')
    for label, values in times.items():
        ratios = [one / two for one, two in zip(values, times[BARE])]
        print(f'{label:45} {statistics.median(ratios):5.2f} '
              f'({min(ratios):.2f} to {max(ratios):.2f}) times springs alone')


if __name__ == '__main__':
    main()
