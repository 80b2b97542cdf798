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
"""How much memory this process may still take."""

import os
from pathlib import Path

# Processes that share what is simulated here (ranks of MPI), each of which holds a part.
_processes = 1
# A limit beyond this means that there is none.
_UNLIMITED = 2**60


def share_among(processes: int) -> int:
    """From now on what is simulated here is shared by so many; returns how many it was."""
    global _processes
    before, _processes = _processes, processes
    return before


def processes_sharing() -> int:
    """Count the processes that share what is simulated here."""
    return _processes


def available_memory(root: Path = Path('/')) -> int:
    """
    Return the bytes that are left: on the machine, and in the control group of a container.

    `root` is where the system's files are.
    """
    found = [_of_machine(root), _of_group(root)]
    return min(amount for amount in found if amount is not None)


def _of_machine(root: Path) -> int:
    for line in _read(root / 'proc/meminfo').splitlines():
        name, _, rest = line.partition(':')
        if name == 'MemAvailable':
            return int(rest.split()[0]) * 1024
    return int(os.sysconf('SC_PAGE_SIZE') * os.sysconf('SC_PHYS_PAGES'))


def _of_group(root: Path) -> int | None:
    """What a control group (version 2, else 1) leaves; its file cache can be given up."""
    base = root / 'sys/fs/cgroup'
    for limit_file, usage_file, statistics, cache in (
        (base / 'memory.max', base / 'memory.current', base / 'memory.stat', 'inactive_file'),
        (base / 'memory/memory.limit_in_bytes', base / 'memory/memory.usage_in_bytes',
         base / 'memory/memory.stat', 'total_inactive_file'),
    ):
        limit, usage = _number(_read(limit_file)), _number(_read(usage_file))
        if limit is None or usage is None or limit >= _UNLIMITED:
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
