# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The level of x86-64 that kernels are compiled for."""

import json
import subprocess
import sys

from icofabric_sim.kernels.runtime import target
import pytest

ALL = dict.fromkeys(target.LEVELS['x86-64-v4'], True)
UP_TO_3 = {name: not name.startswith('avx512') for name in ALL}


@pytest.mark.parametrize('has, level', [
    (ALL, 'x86-64-v4'),
    ({**ALL, 'avx512vnni': True, 'sha': True}, 'x86-64-v4'),
    # Every feature of a level is needed, as a program loader demands.
    ({**ALL, 'avx512cd': False}, 'x86-64-v3'),
    (UP_TO_3, 'x86-64-v3'),
])
def test_the_highest_level_that_a_processor_has(has, level):
    chosen = target.choose(has, {}, numba_was_first=False)
    assert chosen.level == level and not chosen.why
    said = chosen.features.split(',')
    assert [f'+{name}' for name in target.LEVELS[level]] == said[:-1]
    assert ('+avx512f' in said) == (level == 'x86-64-v4')


@pytest.mark.parametrize('has, environment, first, why', [
    ({**UP_TO_3, 'avx2': False}, {}, False, 'no level'),
    ({}, {}, False, 'no level'),
    (ALL, {'NUMBA_CPU_NAME': 'znver3'}, False, 'NUMBA_CPU_NAME is set'),
    (ALL, {'NUMBA_CPU_FEATURES': '+avx'}, False, 'NUMBA_CPU_FEATURES is set'),
    (ALL, {'ICOFABRIC_NATIVE': '1'}, False, 'ICOFABRIC_NATIVE is set'),
    (ALL, {}, True, 'Numba was imported before'),
])
def test_another_target_is_left_as_it_is_and_the_reason_is_known(has, environment, first, why):
    chosen = target.choose(has, environment, numba_was_first=first)
    assert (chosen.level, chosen.features) == ('', '') and why in chosen.why


def test_native_zero_is_no_wish():
    assert target.choose(ALL, {'ICOFABRIC_NATIVE': '0'}, numba_was_first=False).level


def test_child_processes_inherit_nothing_and_code_is_made_for_the_level():
    """Numba reads its settings anew when one changes: the target stays."""
    code = (
        'import json, os\n'
        'before = dict(os.environ)\n'
        'from icofabric_sim.kernels.runtime import target\n'
        'from icofabric_sim.kernels.runtime.compiled import compiled\n'
        'from numba.core.registry import cpu_target\n'
        'changed = dict(os.environ) != before\n'
        'os.environ["NUMBA_WARNINGS"] = "0"\n'
        'compiled(lambda x: 2.0 * x)(1.0)\n'
        'magic = cpu_target.target_context.codegen().magic_tuple()\n'
        'print(json.dumps([changed, target.target().level, magic[1], target.kernel_target()]))')
    ran = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=True, timeout=120)
    changed, level, compiled_for, said = json.loads(ran.stdout)
    assert not changed and said == compiled_for
    assert not level or level == compiled_for
