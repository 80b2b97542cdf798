# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The barrier of threads that share a step, also where there are fewer cores than threads."""
from concurrent.futures import ThreadPoolExecutor

from icofabric_sim.kernels.records import Sweep, Team
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.team import (
    end_parts,
    flag_count,
    take_part,
    tell_all,
    wait_for_all,
)
import numpy as np
import pytest

SIZE = 5
NO_SWEEP = Sweep(
    np.zeros(0, np.uint32), np.zeros(0, np.uint32), np.zeros(0, np.int32), 0)


@compiled
def march(team: Team, steps: np.ndarray, rounds: int, work: int, late: np.ndarray) -> float:
    """Count rounds; in each the first thread is the last to come, after `work` sums."""
    total = 0.0
    for number in range(rounds):
        if team.member == 0:
            for k in range(work):
                total += 1.0 / (k + 1.0 + number)
        steps[8 * team.member] = number + 1
        wait_for_all(team)
        for member in range(team.size):
            # Nobody is behind, and nobody is two rounds ahead.
            if steps[8 * member] < number + 1 or steps[8 * member] > number + 2:
                late[team.member] += 1
        # One after the other, with nothing in between.
        for told in range(3):
            if tell_all(team, 7 * number + told + team.member) != 7 * number + told:
                late[team.member] += 1
    return total


# Those that wait have a core each, look on, and sleep: 1e6 sums take a millisecond.
@pytest.mark.parametrize('rounds, work', [(20_000, 0), (500, 20_000), (20, 3_000_000)])
def test_nobody_goes_on_before_all_are_there(rounds, work):
    flags = np.zeros(flag_count(SIZE), np.int64)
    steps, late = np.zeros(8 * SIZE, np.int64), np.zeros(SIZE, np.int64)
    teams = [Team(member, SIZE, flags, NO_SWEEP, None) for member in range(SIZE)]
    march(Team(0, 1, flags, NO_SWEEP, None), steps, 1, 0, late)  # compiled by one thread
    with ThreadPoolExecutor(SIZE) as pool:
        list(pool.map(lambda team: march(team, steps, rounds, work, late), teams))
    assert (steps[::8] == rounds).all() and not late.any()
    # All that came have left, and none sleeps.
    assert flags[0] == 0 and flags[24] == 0 and flags[8] == 4 * rounds


@compiled
def share(team: Team, parts: int, rounds: int, slow: int, taken: np.ndarray) -> float:
    """Count how often each part is taken; the first thread takes `slow` sums for each."""
    total = 0.0
    for _ in range(rounds):
        part = take_part(team.flags, team.member, team.size, parts, -1)
        while part >= 0:
            taken[team.member, part] += 1
            if team.member == 0:
                for k in range(slow):
                    total += 1.0 / (k + 1.0)
            part = take_part(team.flags, team.member, team.size, parts, part)
        wait_for_all(team)
        end_parts(team)
        wait_for_all(team)
    return total


@pytest.mark.parametrize('size', [1, 2, 3, SIZE])
@pytest.mark.parametrize('parts, slow', [(0, 0), (1, 0), (2, 0), (97, 0), (97, 10_000)])
def test_each_part_of_the_work_is_taken_once(size, parts, slow):
    flags, rounds = np.zeros(flag_count(size), np.int64), 200
    taken = np.zeros((size, parts), np.int64)
    teams = [Team(member, size, flags, NO_SWEEP, None) for member in range(size)]
    share(Team(0, 1, flags, NO_SWEEP, None), 1, 0, 0, taken)  # compiled by one thread
    with ThreadPoolExecutor(size) as pool:
        list(pool.map(lambda team: share(team, parts, rounds, slow, taken), teams))
    assert (taken.sum(axis=0) == rounds).all()
    if slow and size > 1:
        # Others help who is slow, from behind.
        own = taken[1:, :parts // size].sum(axis=0)
        assert own[-1] > 0 and own[0] <= own[-1]
