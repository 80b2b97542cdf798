# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels that accept or refuse the steps of an adaptive method, and make states within them."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from icofabric_sim.kernels.integrators.bodies import bodies_of
from icofabric_sim.kernels.integrators.embedded import (
    adaptive_pair,
    dense_state,
    dense_sum,
    prepare_dense,
)
from icofabric_sim.kernels.integrators.tableau import Pair
from icofabric_sim.kernels.records import Loads, Model, State, Team, Work
from icofabric_sim.simulation.stepping.scene_kernel import SceneKernel
from icofabric_sim.terms.contacts.record import Watch


class EmbeddedKernels(NamedTuple):
    """
    Kernels of an adaptive method.

    Each is called with the records of a scene, then with the arguments of the function of this
    name in kernels/integrators/embedded.py.
    """

    take: Callable[..., tuple[int, int, int]]
    prepare: Callable[..., None]
    state: Callable[..., None]
    sum: Callable[..., Any]
    # Slots of the slopes that states within a step need, those of `prepare` not included.
    slopes: tuple[int, ...]
    prepare_count: int = 0  # evaluations of the forces in `prepare`
    # True if `state` depends on the terms of a model, and on loads that are not drives.
    reads_terms: bool = True
    pair: Pair | None = None  # None: an implicit method


def kernels_of(pair: Pair) -> EmbeddedKernels:
    """Return the kernels of an explicit embedded `pair`."""
    return EmbeddedKernels(
        take=SceneKernel(adaptive_pair, pair), prepare=partial(_prepare, pair),
        state=partial(dense_state, pair), sum=partial(dense_sum, pair), slopes=pair.kept_slots,
        prepare_count=len(pair.dense_slots), reads_terms=False, pair=pair)


def _prepare(
    pair: Pair, model: Model, loads: Loads, state: State, work: Work, team: Team,
    watch: Watch | None, time: float, h: float
) -> None:
    """Compute the slopes of states within a step of `h` [s], which begins at `time` [s]."""
    prepare_dense(bodies_of(model, loads, state, state, work, team, watch), pair, time, h)
