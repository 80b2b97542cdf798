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
"""The Lanczos iteration (lanczos.py) of a configuration at rest, with all that acts in it."""

from icofabric_sim.kernels.flows import place_all
from icofabric_sim.kernels.records import SecondDerivatives, Supports
from icofabric_sim.simulation.model.lanczos import find_largest, Lanczos, start_vector
from icofabric_sim.statics.fabric import Configuration
import numpy as np

# Relative accuracy of the largest squared frequency; a step is content with 1e-4.
_ACCURACY = 1e-9
_MOST = 3_000  # products
_LOOKS = 16  # products between two tests of convergence


def begin(here: Configuration, most: int, *, seed: int = 1) -> tuple[Lanczos, np.ndarray]:
    """
    The iteration of a configuration, for at most so many steps, and the vector it begins with.

    Contacts, anchors, loads and what pre-stress does count. The vector is 0 where all is held.
    """
    fabric = here.fabric
    layout, model = fabric.layout, here.tangent
    supports, free = None, fabric.free
    if not free.all() or fabric.root.ndim > 1:
        # Bodies that are driven are held too.
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
    Largest squared frequency [1/s^2], by what also chooses steps (stability.py).

    The step choice counts the stiffer side of connectors with two stiffnesses, and bounds of what
    contacts, anchors, fields and ways around shells add: it is never below this.
    """
    run, start = begin(here, min(_MOST, 6 * here.fabric.scene.body_count))
    if not start.any():
        return 0.0
    return max(0.0, find_largest(run, np.inf, _ACCURACY, _LOOKS).value)
