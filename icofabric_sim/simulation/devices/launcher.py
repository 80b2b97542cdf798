# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Processes of an MPI launcher: the leading process, the serving ones, and errors of start."""

from collections.abc import Callable
import os
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from icofabric_sim.simulation.devices.ranks import Ranks

# What launchers tell the processes that they start: how many they are, and which this is.
_LAUNCHERS = (
    ('PMI_SIZE', 'PMI_RANK'), ('OMPI_COMM_WORLD_SIZE', 'OMPI_COMM_WORLD_RANK'))


def require_alone() -> None:
    """
    Raise ValueError in the first of several processes of a launcher; the others exit.

    This guards programs that a single process is to execute.
    """
    for size_name, rank_name in _LAUNCHERS:
        size = os.environ.get(size_name, '')
        if size.isdigit() and int(size) > 1:
            if os.environ.get(rank_name, '0') != '0':
                sys.exit(2)
            raise ValueError(
                f'an MPI launcher has started {size} processes, which would all do the same run: '
                'give --ranks to share its steps among them, or start one process')


def launched_ranks() -> 'Ranks':
    """Return the ranks of the launcher; raise ValueError without MPI."""
    # A program that is alone needs none of it.
    from icofabric_sim.simulation.devices.ranks import RankError, Ranks

    try:
        return Ranks()
    except RankError as error:
        raise ValueError(str(error)) from error


def lead_or_serve(name: str, ranks: 'Ranks', lead: Callable[[], int]) -> int:
    """
    Call `lead` in the first process of the program `name`; the others serve this process.

    Returns the exit status of `lead` in each process.
    """
    from icofabric_sim.simulation.errors import RankError

    try:
        with ranks:
            if ranks.leads:
                ranks.exit_status = lead()
    except RankError as error:
        print(f'{name}: on rank {ranks.rank}: {error}', file=sys.stderr)
        return 1
    return ranks.exit_status
