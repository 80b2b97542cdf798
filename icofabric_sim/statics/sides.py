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
Which of two stiffnesses counts where a connector is at its natural length.

With k_e other than k_c the tension has a kink there, and small motions meet k_e where they
lengthen a connector and k_c where they shorten it: there is no single tangent. Two branches are
named: 'pull' (k_e in all connectors at their kink) and 'push' (k_c). The energy of every mixture
of pulling and pushing connectors lies between those of 'soft' (the smaller of the two in each) and
'stiff' (the larger), and so does its k-th frequency (Courant and Fischer; Horn and Johnson 2013,
Matrix Analysis, 4.3). Where all connectors pull more stiffly than they push these are the two.
"""

import math

from icofabric_sim import checks
import numpy as np

PULL, PUSH = 'pull', 'push'
BRANCHES = (PULL, PUSH)
SOFT, STIFF = 'soft', 'stiff'
# No stiffness and no tension at the kink: what is left is all that has a single tangent.
WITHOUT = 'without'
# By the side on which each connector is; what rounding alone has put there is 'stiff'. For
# searches: a model of the energy that is too stiff never promises too much.
ACTUAL = 'actual'

# Change of the weave's angle [rad] that moves a connector by as much as counts as its kink. Ten
# times what must not change any result without being reported as at a kink.
_ANGLE = 1e-8
# Rounding of a length, in parts of it and of the positions that it is the difference of.
_ROUNDING = 32.0 * np.finfo(float).eps


def check_branch(branch: str | None) -> None:
    """Refuse what is not a branch."""
    if branch is not None:
        checks.choice('branch', branch, BRANCHES)


def lever_of(angle: float) -> float:
    """
    How much of its length L a connector gains for each radian of its woven angle, at least 1.

    From eq 53: dL/dtheta = L tan(theta + pi/4).
    """
    return max(1.0, math.tan(angle + 0.25 * math.pi))


def rounding_of(length: np.ndarray, place: np.ndarray) -> np.ndarray:
    """
    How far lengths (c,) [m] may be off, whose ends are as far as `place` (c,) from the origin.
    """
    return np.asarray(_ROUNDING * (length + place))


def kink_width(length: np.ndarray, place: np.ndarray, lever: float) -> np.ndarray:
    """How near to its natural length [m] a connector is at its kink, (c,)."""
    return np.asarray(np.maximum(_ANGLE * lever * length, rounding_of(length, place)))


def slopes_on(
    side: str, extension: np.ndarray, compression: np.ndarray, stretch: np.ndarray,
    at_kink: np.ndarray, rounded: np.ndarray
) -> np.ndarray:
    """
    Slopes of the tension [N/m], (c,): at the kink those of `side`.

    `stretch`: length less natural length [m]; `at_kink`: which are at their kink; `rounded`: of
    them those whose side is rounding.
    """
    slope = np.where(stretch > 0.0, extension, compression)
    if side == ACTUAL:
        return np.where(rounded, np.maximum(extension, compression), slope)
    chosen = {
        PULL: extension, PUSH: compression, SOFT: np.minimum(extension, compression),
        STIFF: np.maximum(extension, compression), WITHOUT: np.zeros(1)}[side]
    return np.where(at_kink, chosen, slope)
