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
Connectors that lie around shells: how their lengths change in second order.

Over given edges the length is F(q, y) of the poses q and the places y along the last edges, where
a connector leaves its shells; the places are where it is least. So its derivatives by the poses
alone are L' = F_q and L'' = F_qq - F_qy F_yy^-1 F_yq (implicit functions). Where a place is beside
an attachment point's own face, and a connector straight, there is none to give way.
"""

from typing import NamedTuple

from icofabric_sim.geometry.rotations import cosines_from_quaternions
from icofabric_sim.kernels.records import Connectors, Wrapping
from icofabric_sim.kernels.wrap.forces import find_ways
import numpy as np


class Wrapped(NamedTuple):
    """Connectors around shells in one configuration."""

    of: np.ndarray  # (w,) their numbers
    ends: np.ndarray  # (w, 2, 3) [m] where they leave the shells of both bodies, world frame
    # (w, 12, 12) second derivatives of their lengths by displacements [m] and rotation vectors
    # [rad] of the first body and of the second
    second: np.ndarray

    def end_wrenches(self, position: np.ndarray) -> np.ndarray:
        """First derivatives by the motions of both bodies, at `position` (w, 2, 3): (2, w, 6)."""
        reach = self.ends[:, 1] - self.ends[:, 0]
        direction = reach / np.linalg.norm(reach, axis=1, keepdims=True)
        arms = self.ends - position
        return np.stack([
            sign * np.hstack([direction, np.cross(arms[:, end], direction)])
            for end, sign in ((0, -1.0), (1, 1.0))])


def find_wrapped(
    wrapping: Wrapping, connectors: Connectors, bodies: np.ndarray, entering: np.ndarray,
    position: np.ndarray, orientation: np.ndarray
) -> Wrapped:
    """
    Of the connectors by number that are `entering` shells, those that find a way around them.

    `bodies` (c, 2) of all connectors; `position` (n, 3), quaternions x y z w (n, 4).
    """
    ways, places = np.zeros((len(entering), 2), np.int64), np.zeros((len(entering), 2))
    find_ways(
        wrapping, connectors, np.ascontiguousarray(position.T),
        np.ascontiguousarray(orientation.T), entering, ways, places)
    around = (ways >= 0).any(axis=1)
    of, ways, places = entering[around], ways[around], places[around]
    edges = np.stack([connectors.first_edge[of], connectors.second_edge[of]], axis=1)
    joined = bodies[of]
    axes = cosines_from_quaternions(orientation[joined.ravel()]).reshape(*joined.shape, 3, 3)
    arms, along, bend = _leaving(wrapping, edges, ways, places)
    # From body axes, which are rows, to the world.
    arms, along = (np.einsum('weik,wei->wek', axes, part) for part in (arms, along))
    ends = position[joined] + arms
    return Wrapped(of, ends, second_derivatives(ends, arms, along, bend))


def _leaving(
    wrapping: Wrapping, edges: np.ndarray, ways: np.ndarray, places: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Of each end (w, 2): its arm [m] and edge direction, (w, 2, 3), body axes, and bend [1/m].

    The bend is the second derivative of the length on the shell by the place; directions and bend
    are 0 at ends that no edge bounds.
    """
    rows = wrapping.ways[edges, np.maximum(ways, 0)]
    there = ways >= 0
    along = np.where(there[..., None], rows[..., 3:6], 0.0)
    arms = np.where(
        there[..., None], rows[..., :3] + places[..., None] * rows[..., 3:6],
        wrapping.points[edges])
    wound = np.sqrt((places - rows[..., 6])**2 + rows[..., 7]**2)
    with np.errstate(divide='ignore', invalid='ignore'):
        bend = np.where(there, rows[..., 7]**2 / wound**3, 0.0)
    return arms, along, bend


def second_derivatives(
    ends: np.ndarray, arms: np.ndarray, along: np.ndarray, bend: np.ndarray
) -> np.ndarray:
    """
    Second derivatives (w, 12, 12) of lengths; points, arms and edges as in `_leaving`, world.

    With n the direction and l the length of the free part, P = 1 - n n^T, s the arms and t the
    edges' directions: F_qq is that of a straight connector, (J^T P J) / l beside the turns of the
    arms, and F_y of an end is the rate on the shell plus or minus n . t.
    """
    reach = ends[:, 1] - ends[:, 0]
    free = np.sqrt((reach * reach).sum(axis=1))[:, None, None]
    n = reach / free[:, :, 0]
    across = (np.eye(3) - n[:, :, None] * n[:, None, :]) / free
    count = len(ends)
    moves = np.zeros((count, 3, 12), ends.dtype)
    second = np.zeros((count, 12, 12), ends.dtype)
    mixed, give = np.zeros((count, 2, 12), ends.dtype), np.zeros((count, 2, 2), ends.dtype)
    for end, sign in ((0, -1.0), (1, 1.0)):
        own, s, t = slice(6 * end, 6 * end + 3), arms[:, end], along[:, end]
        turn = slice(6 * end + 3, 6 * end + 6)
        moves[:, :, own] = sign * np.eye(3)
        moves[:, :, turn] = sign * _turned(s)
        product = n[:, :, None] * s[:, None, :]
        second[:, turn, turn] = sign * (
            0.5 * (product + np.swapaxes(product, 1, 2))
            - (n * s).sum(axis=1)[:, None, None] * np.eye(3))
        mixed[:, end, turn] = sign * np.cross(t, n)
    second += np.einsum('wki,wkl,wlj->wij', moves, across, moves)
    shifts = along * np.array([-1.0, 1.0])[:, None]
    mixed += np.einsum('wek,wkl,wlj->wej', shifts, across, moves)
    give += np.einsum('wek,wkl,wfl->wef', shifts, across, shifts)
    for end in range(2):
        # An end without an edge has nothing to give.
        give[:, end, end] += np.where((along[:, end] != 0.0).any(axis=1), bend[:, end], 1.0)
    return np.asarray(second - np.einsum(
        'wei,wej->wij', mixed, np.linalg.solve(give, mixed)))


def _turned(arms: np.ndarray) -> np.ndarray:
    """Matrices (w, 3, 3) that take small rotation vectors to what they move arms (w, 3) by."""
    turned = np.zeros((len(arms), 3, 3), arms.dtype)
    turned[:, 0, 1], turned[:, 0, 2] = arms[:, 2], -arms[:, 1]
    turned[:, 1, 0], turned[:, 1, 2] = -arms[:, 2], arms[:, 0]
    turned[:, 2, 0], turned[:, 2, 1] = arms[:, 1], -arms[:, 0]
    return turned
