# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Constants of anchors."""

from icofabric_sim.kernels.runtime.record import Record
import numpy as np


class Anchors(Record):
    """Connectors from bodies to points of the world."""

    first: int  # paths of drives, whose numbers come before
    start: np.ndarray  # (a,) [s] start of the present interval of each point's path
    cubic: np.ndarray  # (a, 4, 3) [m], and by powers of [s], world frame
    arm: np.ndarray  # (a, 3) [m] from the centre to the end of the body, body axes
    extension: np.ndarray  # (a,) k_e [N/m]
    compression: np.ndarray  # (a,) k_c [N/m]
    natural_length: np.ndarray  # (a,) D [m]
