# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Elimination order of bodies that keeps the factors of a fabric's matrices small.

Nested dissection (George 1973, SIAM J. Numer. Anal. 10, 345): connectors join grid points that
differ by at most one along each axis, so the bodies of one grid plane separate those on its two
sides. The separator is eliminated after both sides, which are dissected in turn.
"""

import numpy as np

_LEAF = 6  # bodies


def dissection_parts(grid: np.ndarray, leaf: int = _LEAF) -> list[np.ndarray]:
    """
    Return parts of body numbers, for grid points (n, 3), in order of elimination.

    Parts of up to `leaf` bodies are not divided further.
    """
    parts: list[np.ndarray] = []
    # In reverse order: the separator, then both sides.
    waiting = [np.arange(len(grid))]
    while waiting:
        bodies = waiting.pop()
        here = grid[bodies]
        extent = np.ptp(here, axis=0) if len(bodies) else np.zeros(3, int)
        axis = int(np.argmax(extent))
        if len(bodies) <= leaf or extent[axis] < 2:
            parts.append(bodies)
            continue
        along = here[:, axis]
        middle = int(np.median(along))
        middle = min(max(middle, int(along.min()) + 1), int(along.max()) - 1)
        parts.append(bodies[along == middle])
        waiting += [bodies[along < middle], bodies[along > middle]]
    return parts[::-1]


def dissection_order(grid: np.ndarray) -> np.ndarray:
    """Return the body numbers, for grid points (n, 3), in order of elimination."""
    return np.concatenate([np.zeros(0, np.int64), *dissection_parts(grid)])
