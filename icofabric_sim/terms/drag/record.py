# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The record of the term."""

from icofabric_sim.kernels.runtime.record import Record


class Drag(Record):
    """Drag on every body."""

    linear: float  # gamma [N s/m]
    angular: float  # gamma' [N m s/rad]
