# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Counts of machine instructions in the loops of a compiled function."""

from collections.abc import Callable
import re
from typing import Any

import numba

_LABEL = re.compile(r'(\.L[\w.$]+):')
_INSTRUCTION = re.compile(r'\s+[a-z]')
_SYMBOL = re.compile(r'^([^\s.#][^\s:]*):', re.MULTILINE)
_LENGTH = re.compile(r'\d+')
_JUMP = re.compile(r'\s+j[a-z]+\s+(\.L[\w.$]+)')


def recompiled(function: Callable[..., Any]) -> Any:
    """Recompile a function without the disk cache, which keeps no listing."""
    plain = getattr(function, 'py_func', function)
    return numba.njit(nogil=True, error_model='numpy')(plain)


def loop_instructions(function: Callable[..., Any], *arguments: Any) -> int | None:
    """
    Count the instructions in the loops of `function`, called with `arguments`.

    Called functions are inlined. None if the listing is not understood, or nothing is compiled.
    """
    kernel = recompiled(function)
    kernel(*arguments)
    if not hasattr(kernel, 'inspect_asm'):
        return None
    return count_in_loops(next(iter(kernel.inspect_asm().values())))


def functions_in_loops(listing: str) -> dict[str, int]:
    """
    Return the instructions in the loops of each function of a listing, by name.

    Specialisations of a function have one name, and their instructions are added up. Entrances
    for Python and C are left out.
    """
    found: dict[str, int] = {}
    _, *parts = _SYMBOL.split(listing)
    for symbol, body in zip(parts[::2], parts[1::2]):
        if not symbol.startswith(('_ZN7cpython', 'cfunc.')):
            name = _plain_name(symbol)
            found[name] = found.get(name, 0) + (count_in_loops(f'{symbol}:{body}') or 0)
    return {name: count for name, count in found.items() if count}


def _plain_name(symbol: str) -> str:
    """Return the last part of the qualified name in a symbol that Numba has mangled."""
    rest, name = symbol.removeprefix('_ZN'), symbol
    while (length := _LENGTH.match(rest)) is not None:
        end = length.end() + int(length[0])
        name, rest = rest[length.end():end], rest[end:]
    return name


def count_in_loops(listing: str) -> int | None:
    """
    Count the instructions between the first and the last line of each loop of the first function.

    A loop is the range of a jump backwards; overlapping loops count as one.
    """
    instructions, places, loops = 0, {}, []
    started = False
    for line in listing.splitlines():
        # Not every function has .cfi_startproc.
        if _SYMBOL.match(line):
            if instructions:
                break
            started = True
        label = _LABEL.match(line)
        if not started:
            continue
        if label is not None:
            places[label[1]] = instructions
        elif _INSTRUCTION.match(line) and not line.lstrip().startswith('.'):
            instructions += 1
            jump = _JUMP.match(line)
            if jump is not None and jump[1] in places:
                loops.append((places[jump[1]], instructions))
    total, end = 0, 0
    for first, last in sorted(loops):
        total += max(last - max(first, end), 0)
        end = max(end, last)
    return total or None
