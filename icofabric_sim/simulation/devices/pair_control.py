# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Step control of the embedded pair, for steps that are computed elsewhere.

The code of a single process (`adaptive_pair` and `fixed_pair` of kernels/integrators/embedded.py)
selects, accepts and rejects steps. It runs in Python, and its calls for all bodies are functions
of the ranks or device with the bodies. So there is one step control.
"""

from collections.abc import Callable
from types import FunctionType
from typing import Any

from icofabric_sim.kernels.integrators import embedded
from icofabric_sim.kernels.integrators.tableau import Pair

# Status, steps done and steps since the last health check, by the pieces that take them.
Steps = Callable[[dict[str, Any]], tuple[int, int, int]]


def with_pieces(steps: Any, pieces: dict[str, Any]) -> Callable[..., Any]:
    """Return a kernel as a Python function that calls `pieces` by the names in its code."""
    plain = getattr(steps, 'py_func', steps)
    return FunctionType(
        plain.__code__, {**plain.__globals__, **pieces}, plain.__name__, plain.__defaults__)


def adaptive_steps(pair: Pair, *arguments: Any) -> Steps:
    """Return steps as `adaptive_pair` takes them, as a function of the pieces."""
    return lambda pieces: with_pieces(embedded.adaptive_pair, pieces)(pair, *arguments)


def fixed_steps(pair: Pair, *arguments: Any) -> Steps:
    """Return steps as `fixed_pair` takes them, as a function of the pieces."""
    return lambda pieces: with_pieces(embedded.fixed_pair, pieces)(pair, *arguments)


def idle_pieces() -> dict[str, Any]:
    """Return functions without effect for bodies elsewhere, by name."""
    return {
        'own_blocks': lambda team, count: (0, count),
        'rows_of': lambda orientation: orientation, 'some': lambda trail: trail,
        **dict.fromkeys((
            'losses_of', 'wait_for_all', 'ways_of', 'save', 'accept_stretches', 'keep_work',
            'add_flow', 'repeat_stretches', 'forget_ways'), nothing)}


def nothing(*_: Any) -> None:
    """Do nothing: an unused function."""
