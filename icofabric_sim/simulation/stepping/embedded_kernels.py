# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What accepts or refuses the steps of an adaptive method, and makes states within them."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from icofabric_sim.kernels.integrators import dop853
from icofabric_sim.kernels.integrators.embedded import (
    adaptive_pair,
    dense_state,
    dense_sum,
    Pair,
    prepare_dense,
)


class EmbeddedKernels(NamedTuple):
    """
    Each is called as its namesake of kernels/integrators/embedded.py, after the pair.

    `slopes`: numbers of those that states within a step need, but for what
    `prepare` makes.
    """

    take: Callable[..., tuple[int, int, int]]
    prepare: Callable[..., None]
    state: Callable[..., None]
    sum: Callable[..., Any]
    slopes: tuple[int, ...]
    prepare_count: int = 0  # evaluations of the forces in `prepare`
    # Whether `state` depends on the terms of a model, and on loads that are not drives.
    reads_terms: bool = True


def kernels_of(pair: Pair) -> EmbeddedKernels:
    """Return what takes the steps of an explicit pair of the stages of DOP853."""
    return EmbeddedKernels(
        partial(adaptive_pair, pair), partial(prepare_dense, pair), partial(dense_state, pair),
        partial(dense_sum, pair), tuple(
            k for k in range(len(dop853.STAGES) + 1)
            if any(len(row) > k and row[k] for row in (*dop853.DENSE_STAGES, *dop853.DENSE))),
        len(pair.dense_stages), reads_terms=False)
