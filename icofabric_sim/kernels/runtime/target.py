# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
The processor that kernels are compiled for: a level of x86-64, equal on all machines of a level.

Compiled kernels are therefore portable: a cache from one machine serves the others of its level.
The level is chosen before Numba is imported. Numba keeps its own target, with a separate cache, in
three cases: Numba was imported earlier, NUMBA_CPU_NAME or NUMBA_CPU_FEATURES is set, or
ICOFABRIC_NATIVE=1. Child processes do not inherit the choice.
"""

from functools import cache
import os
import sys
from typing import NamedTuple

_V3 = (
    '64bit', 'cmov', 'cx16', 'fxsr', 'mmx', 'popcnt', 'sahf', 'sse', 'sse2', 'sse3', 'ssse3',
    'sse4.1', 'sse4.2', 'crc32', 'xsave', 'avx', 'avx2', 'bmi', 'bmi2', 'f16c', 'fma', 'lzcnt',
    'movbe')
_V4 = (*_V3, 'avx512f', 'avx512bw', 'avx512cd', 'avx512dq', 'avx512vl')
# Features of each level, by LLVM's names, the higher level first: x86-64 psABI, table 3.1.
LEVELS = {'x86-64-v4': _V4, 'x86-64-v3': _V3}
# LLVM would use half of each register of x86-64-v4, as suits Intel's first such processors.
_WHOLE_REGISTERS = '-prefer-256-bit'
_NATIVE = 'ICOFABRIC_NATIVE'
# This module is imported before all other modules of the kernels.
_NUMBA_WAS_FIRST = 'numba' in sys.modules


class Target(NamedTuple):
    """Target processor of the kernels."""

    level: str  # of x86-64; '': Numba's own target
    features: str  # as LLVM writes them
    why: str  # it is no level; '' where it is one


def choose(
    has: dict[str, bool], environment: dict[str, str], *, numba_was_first: bool
) -> Target:
    """Choose the target for a processor that `has` features by LLVM's names."""
    own = [name for name in ('NUMBA_CPU_NAME', 'NUMBA_CPU_FEATURES') if environment.get(name)]
    if own:
        return Target('', '', f'{own[0]} is set')
    if environment.get(_NATIVE, '0') not in ('', '0'):
        return Target('', '', f'{_NATIVE} is set')
    if numba_was_first:
        return Target('', '', 'Numba was imported before icofabric_sim')
    for level, features in LEVELS.items():
        if all(has.get(name) for name in features):
            said = ','.join(f'+{name}' for name in features)
            return Target(level, f'{said},{_WHOLE_REGISTERS}', '')
    return Target('', '', 'this processor has no level of x86-64 from 3 on')


def settings_of(level: str) -> dict[str, str]:
    """Return the environment in which a process compiles for a level, also on a higher one."""
    chosen = choose(dict.fromkeys(LEVELS[level], True), {}, numba_was_first=False)
    return {'NUMBA_CPU_NAME': level, 'NUMBA_CPU_FEATURES': chosen.features}


def host_levels() -> list[str]:
    """Return the levels whose kernels the processor at hand can run, the highest first."""
    has = host_features()
    return [level for level, names in LEVELS.items() if all(has.get(name) for name in names)]


@cache
def target() -> Target:
    """Return the target of this process."""
    return choose(host_features(), dict(os.environ), numba_was_first=_NUMBA_WAS_FIRST)


def host_features() -> dict[str, bool]:
    """Return the features of the processor at hand, by LLVM's names; empty if LLVM has none."""
    from llvmlite import binding
    try:
        return dict(binding.get_host_cpu_features())
    except RuntimeError:
        # LLVM does not know this kind of machine.
        return {}


def host_processor() -> str:
    """Return the name of the processor at hand, as LLVM calls it."""
    from llvmlite import binding
    return str(binding.get_host_cpu_name())


def kernel_target() -> str:
    """Return the name of the target of the kernels: a level, or a processor."""
    return target().level or os.environ.get('NUMBA_CPU_NAME') or host_processor()
