# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Memory that this process may still allocate."""

import os
from pathlib import Path

# Number of processes (MPI ranks) that share one simulation, each with a part of the bodies.
_processes = 1
# Control groups report a number above this [bytes] if they have no limit.
_UNLIMITED_BYTES = 2**60


def share_among(processes: int) -> int:
    """Set the number of processes that share the simulation; return the previous number."""
    global _processes
    before, _processes = _processes, processes
    return before


def processes_sharing() -> int:
    """Return the number of processes that share the simulation."""
    return _processes


def available_memory(root: Path = Path('/')) -> int:
    """
    Return the free memory in bytes: of the machine or of the container's control group, if less.

    `root` is the folder of the system's files.
    """
    found = [_free_on_machine(root), _free_in_group(root)]
    return min(amount for amount in found if amount is not None)


def _free_on_machine(root: Path) -> int:
    for line in _read(root / 'proc/meminfo').splitlines():
        name, _, rest = line.partition(':')
        if name == 'MemAvailable':
            return int(rest.split()[0]) * 1024
    return int(os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES'))


def _free_in_group(root: Path) -> int | None:
    """Return the free bytes of the control group, version 2 or 1; file cache counts as free."""
    base = root / 'sys/fs/cgroup'
    for limit_file, usage_file, statistics, cache in (
        (base / 'memory.max', base / 'memory.current', base / 'memory.stat', 'inactive_file'),
        (base / 'memory/memory.limit_in_bytes', base / 'memory/memory.usage_in_bytes',
         base / 'memory/memory.stat', 'total_inactive_file'),
    ):
        limit, usage = _number(_read(limit_file)), _number(_read(usage_file))
        if limit is None or usage is None or limit >= _UNLIMITED_BYTES:
            continue
        fields = (line.split() for line in _read(statistics).splitlines())
        reclaimable = {field[0]: int(field[1]) for field in fields if len(field) == 2}
        return max(limit - usage + reclaimable.get(cache, 0), 0)
    return None


def _number(text: str) -> int | None:
    text = text.strip()
    return int(text) if text.isdigit() else None


def _read(path: Path) -> str:
    try:
        return path.read_text()
    except OSError:
        return ''
