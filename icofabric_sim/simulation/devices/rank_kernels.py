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
"""
What a rank does in the course of a step: pushes while poses travel, and the poses themselves.

The flows are those of kernels/flows.py. These few lines stand here and not in the room of the
kernels because the cache is stamped by that room as a whole: a change here compiles nothing else.
"""

from icofabric_sim.kernels.flows import drift, place_links, push
from icofabric_sim.kernels.records import Loads, Model, State, Work
from icofabric_sim.kernels.runtime.compiled import compiled
from icofabric_sim.kernels.runtime.lanes import LANES, load, store
from icofabric_sim.kernels.runtime.team import TILE
import numpy as np

# Numbers of a pose: position and quaternion.
POSE = 7


@compiled
def drift_and_push(
    model: Model, loads: Loads | None, state: State, work: Work, now: float, whole: float,
    after: float, kick: float, again: float, keep: bool, drifts: np.ndarray, drifted: int,
    pushes: np.ndarray, ahead: np.ndarray
) -> None:
    """
    Drift the blocks of `drifts` from the place `drifted` on, and push those of `pushes`.

    As `steps` of kernels/integrators/splitting.py does: before each tile of pushes as many blocks
    have drifted as `ahead` says, and at the end all.
    """
    count = pushes.shape[0]
    for tile in range(ahead.shape[0]):
        goal: int = np.int64(ahead[tile])  # type: ignore[assignment]
        drift(model, loads, state, work, now, whole, drifts, drifted, goal)
        drifted = max(drifted, goal)
        push(
            model, loads, state, work, None, 0.0, after, kick, again, keep, pushes, TILE * tile,
            min(TILE * tile + TILE, count))
    drift(model, loads, state, work, now, whole, drifts, drifted, drifts.shape[0])


@compiled
def take_poses(state: State, slots: np.ndarray, poses: np.ndarray) -> None:
    """Copy positions and orientations of the blocks that begin at `slots` to (7, m LANES)."""
    for i in range(slots.shape[0]):
        s: int = np.int64(slots[i])  # type: ignore[assignment]
        for k in range(3):
            store(poses, k, LANES * i, load(state.position, k, s))
        for k in range(4):
            store(poses, 3 + k, LANES * i, load(state.orientation, k, s))


@compiled
def put_poses(
    model: Model, state: State, work: Work, slots: np.ndarray, poses: np.ndarray
) -> None:
    """Copy them back, and place the attachment points of these blocks."""
    for i in range(slots.shape[0]):
        s: int = np.int64(slots[i])  # type: ignore[assignment]
        for k in range(3):
            store(state.position, k, s, load(poses, k, LANES * i))
        for k in range(4):
            store(state.orientation, k, s, load(poses, 3 + k, LANES * i))
        place_links(model.links, state, work, s)
