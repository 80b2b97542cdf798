# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""
Choice between two stiffnesses (sides) of a connector at its natural length.

If k_e differs from k_c, the tension has a kink there. Small motions are resisted by k_e if they
lengthen the connector and by k_c if they shorten it, so there is no single tangent. Two branches
have names: 'pull' (k_e in all connectors at their kink) and 'push' (k_c). The energy of every
mixture of connectors in extension and compression lies between those of 'soft' (the smaller
stiffness in each) and 'stiff' (the larger), and so does its k-th frequency (Courant and Fischer;
Horn and Johnson 2013, Matrix Analysis, 4.3). If k_e > k_c in all connectors, 'stiff' is 'pull' and
'soft' is 'push'.
"""

import math

from icofabric_sim import checks
import numpy as np

PULL, PUSH = 'pull', 'push'
BRANCHES = (PULL, PUSH)
SOFT, STIFF = 'soft', 'stiff'
# No stiffness and no tension at the kink: leaves all terms with a single tangent.
WITHOUT = 'without'
# The actual side of each connector; 'stiff' within round-off of the kink. For searches, because a
# model that is too stiff never overestimates the decrease of the energy.
ACTUAL = 'actual'

# Change of the connector angle that defines the width of a kink: ten times the largest change that
# must not affect any result without a report of connectors at their kink.
_KINK_ANGLE_RAD = 1e-8
# Round-off of a length, as a ratio to the length and to the positions of its ends.
_ROUNDING_RATIO = 32.0 * np.finfo(float).eps


def check_branch(branch: str | None) -> None:
    """Raise ValueError unless `branch` names a branch; None passes."""
    if branch is not None:
        checks.choice('branch', branch, BRANCHES)


def lever_of(angle: float) -> float:
    """
    Return the relative change of a connector's length per radian of its angle, at least 1.

    From eq 53: dL/dtheta = L tan(theta + pi/4).
    """
    return max(1.0, math.tan(angle + 0.25 * math.pi))


def rounding_of(length: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return the round-off [m] of lengths (c,) with ends at distance `place` (c,) from 0."""
    return np.asarray(_ROUNDING_RATIO * (length + place))


def kink_width(length: np.ndarray, place: np.ndarray, lever: float) -> np.ndarray:
    """Return the deviation [m] from the natural length within which a kink applies, (c,)."""
    return np.asarray(np.maximum(_KINK_ANGLE_RAD * lever * length, rounding_of(length, place)))


def slopes_on(
    side: str, extension: np.ndarray, compression: np.ndarray, stretch: np.ndarray,
    at_kink: np.ndarray, rounded: np.ndarray
) -> np.ndarray:
    """
    Return tangent stiffnesses [N/m], (c,), with those of `side` at kinks.

    `stretch` is length less natural length [m], `at_kink` the mask of connectors at their kink,
    and `rounded` the mask of those whose side is within round-off.
    """
    slope = np.where(stretch > 0.0, extension, compression)
    if side == ACTUAL:
        return np.where(rounded, np.maximum(extension, compression), slope)
    chosen = {
        PULL: extension, PUSH: compression, SOFT: np.minimum(extension, compression),
        STIFF: np.maximum(extension, compression), WITHOUT: np.zeros(1)}[side]
    return np.where(at_kink, chosen, slope)
