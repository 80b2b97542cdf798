# Copyright 2026 The icofabric_sim authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Verbs that several processes of MPI do together: who leads, who serves, and who should not."""

from collections.abc import Callable
import os
import sys
from typing import TYPE_CHECKING

from icofabric_sim.terminal import InputError

if TYPE_CHECKING:
    from icofabric_sim.simulation.devices.ranks import Ranks

# What launchers tell the processes that they start: how many they are, and which this is.
_LAUNCHERS = (
    ('PMI_SIZE', 'PMI_RANK'), ('OMPI_COMM_WORLD_SIZE', 'OMPI_COMM_WORLD_RANK'))


def require_alone() -> None:
    """Refuse to do in each of several processes what one is to do; the first says so."""
    for size_name, rank_name in _LAUNCHERS:
        size = os.environ.get(size_name, '')
        if size.isdigit() and int(size) > 1:
            if os.environ.get(rank_name, '0') != '0':
                sys.exit(2)
            raise InputError(
                f'an MPI launcher has started {size} processes, which would all do the same run: '
                'give --ranks to share its steps among them, or start one process')


def lead_or_serve(lead: Callable[['Ranks'], int]) -> int:
    """Do `lead` in the first process; the others serve it. Returns the exit status of each."""
    from icofabric_sim.simulation.devices.ranks import RankError, Ranks
    try:
        ranks = Ranks()
    except RankError as error:
        raise InputError(str(error)) from error
    status = 0
    try:
        with ranks:
            if ranks.leads:
                status = lead(ranks)
    except RankError as error:
        print(f'icofabric run: on rank {ranks.rank}: {error}', file=sys.stderr)
        return 1
    return status
