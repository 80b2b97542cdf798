# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The record of the term."""

from icofabric_sim.kernels.runtime.record import Record
import numpy as np


class Ties(Record):
    """Custom connectors: a row for each end, in the order of the blocks of the bodies there."""

    start: np.ndarray  # (b + 1,) int32: rows start[b] to start[b + 1] are of block b
    number: np.ndarray  # (r,) int32, the custom connector of each row
    present: np.ndarray  # (r,) uint8, 0: broken
    lane: np.ndarray  # (r,) uint8, the bit of the body's lane
    own: np.ndarray  # (r,) int32, slot of the body
    other: np.ndarray  # (r,) int32, slot of the body at the other end
    point: np.ndarray  # (r, 3) [m] attachment point from the centre, body axes
    far: np.ndarray  # (r, 3) [m] attachment point of the other body
    extension: np.ndarray  # (r,) k_e [N/m]
    compression: np.ndarray  # (r,) k_c [N/m]
    natural_length: np.ndarray  # (r,) D [m]
    damping: np.ndarray | None  # (r,) c [N s/m]; None: none is damped
