# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays of a compiled scene."""

from collections.abc import Iterator
from typing import Any

from icofabric_sim.simulation.simulation import Simulation
import numpy as np


def arrays_of(simulation: Simulation) -> dict[str, int]:
    """Return the bytes of every array of a compiled scene, without the scene itself, by name."""
    found: dict[str, int] = {}
    seen = {id(simulation.scene)}
    for name, array in _walk('', simulation, seen):
        found[name] = array.nbytes
    return found


def _walk(name: str, value: Any, seen: set[int]) -> Iterator[tuple[str, np.ndarray]]:
    # Kernels hold nothing of a simulation.
    if id(value) in seen or isinstance(value, type) or hasattr(value, 'py_func'):
        return
    seen.add(id(value))
    if isinstance(value, np.ndarray):
        yield name, value
        return
    parts: list[tuple[str, Any]] = []
    if hasattr(value, '_fields'):
        parts = list(zip(value._fields, value))
    elif isinstance(value, (list, tuple)):
        parts = [(str(k), part) for k, part in enumerate(value)]
    elif isinstance(value, dict):
        parts = [(str(key), part) for key, part in value.items()]
    elif type(value).__module__.startswith('icofabric_sim'):
        slots = getattr(type(value), '__slots__', ())
        parts = [*getattr(value, '__dict__', {}).items(), *(
            (key, getattr(value, key)) for key in slots if hasattr(value, key))]
    for key, part in parts:
        yield from _walk(f'{name}.{key}'.replace('._', '.').lstrip('.'), part, seen)
