# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Lanczos iteration (lanczos.py) of the Hessian of a configuration at rest."""

from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.records import SecondDerivatives, Supports
from icofabric_sim.simulation.model.lanczos import find_largest, Lanczos, start_vector
from icofabric_sim.statics.fabric import Configuration
import numpy as np

# Relative accuracy of the largest squared frequency; the choice of steps needs only 1e-4.
_ACCURACY = 1e-9
_MAX_PRODUCTS = 3_000
_PRODUCTS_PER_TEST = 16  # between two tests of convergence


def begin(here: Configuration, most: int, *, seed: int = 1) -> tuple[Lanczos, np.ndarray]:
    """
    Return the iteration of a configuration, for at most `most` steps, and its start vector.

    The Hessian includes contacts, anchors, loads and pre-stress. The vector is 0 if everything is
    held.
    """
    fabric = here.fabric
    layout, model = fabric.layout, here.tangent
    supports, free = None, fabric.free
    if not free.all() or fabric.root.ndim > 1:
        # Driven bodies are held too.
        inverse = np.where(free, fabric.root**-2.0, 0.0)
        supports = Supports(layout.spread(inverse[:, :3]), layout.spread(inverse[:, 3:4]))
    work = layout.room(model.links)
    place_all(model, here.state, work, 0, len(layout.blocks.slot))
    start = start_vector(layout, supports, seed)
    scale = layout.spread(np.where(free, 1.0 / fabric.root, 0.0))
    run = Lanczos(
        model._replace(supports=supports), here.state, work, start, most,
        own=_own_blocks(here, scale), pairs=_pair_blocks(here, scale), coulomb=model.coulomb)
    return run, start


def _own_blocks(here: Configuration, scale: np.ndarray) -> SecondDerivatives | None:
    if not here.own_blocks:
        return None
    slots, values = (np.concatenate(parts) for parts in zip(*here.own_blocks))
    weights = scale[:, slots].T
    return SecondDerivatives(slots, values * weights[:, :, None] * weights[:, None, :])


def _pair_blocks(here: Configuration, scale: np.ndarray) -> SecondDerivatives | None:
    bodies, values = here.pair_blocks
    if not len(bodies):
        return None
    slots = here.fabric.layout.slot[bodies]
    weights = np.moveaxis(scale[:, slots], 0, 2).reshape(-1, 12)
    return SecondDerivatives(slots, values * weights[:, :, None] * weights[:, None, :])


def largest_square(here: Configuration) -> float:
    """
    Return the largest squared frequency [1/s^2], by the iteration that chooses steps.

    The choice of steps (stability.py) uses the stiffer side of connectors with two stiffnesses and
    upper bounds for contacts, anchors, fields and wrapped connectors, so its value is never lower.
    """
    run, start = begin(here, min(_MAX_PRODUCTS, 6 * here.fabric.scene.body_count))
    if not start.any():
        return 0.0
    return max(0.0, find_largest(run, np.inf, _ACCURACY, _PRODUCTS_PER_TEST).value)
