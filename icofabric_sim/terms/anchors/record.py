# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Constants of anchors."""

from icofabric_sim.kernels.runtime.record import Record
import numpy as np


class Waves(Record):
    """Sine motions of the points of anchors."""

    amplitude: np.ndarray  # (a, 3) [m], world frame
    rate: np.ndarray  # (a,) [rad/s]
    phase: np.ndarray  # (a,) [rad]


class Anchors(Record):
    """Connectors from bodies to points of the world."""

    first: int  # paths of drives, whose numbers come before
    start: np.ndarray  # (a,) [s] start of the present interval of each point's path
    cubic: np.ndarray  # (a, 4, 3) [m], and by powers of [s], world frame
    arm: np.ndarray  # (a, 3) [m] from the centre to the end of the body, body axes
    extension: np.ndarray  # (a,) k_e [N/m]
    compression: np.ndarray  # (a,) k_c [N/m]
    natural_length: np.ndarray  # (a,) D [m]
    waves: Waves | None  # None: no point has a sine motion
    damping: np.ndarray | None  # (a,) c [N s/m]; None: no anchor is damped
