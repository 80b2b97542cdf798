# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The record of the term."""

from icofabric_sim.kernels.runtime.record import Record


class Platens(Record):
    """Paths of planes among those of `Drives`."""

    first: int  # number of the first path of a plane; all later paths are of planes
    count: int
