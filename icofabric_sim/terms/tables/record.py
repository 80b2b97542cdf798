# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""The record of the law."""

from icofabric_sim.kernels.runtime.record import Record
import numpy as np


class Tables(Record):
    """Tensions by table, see law.py."""

    number: np.ndarray  # (12, s) of a connector's table, -1 without a table
    # (8 m,) for each interval least length, anchor [m], f [N], d, c, b, energy [J], 0
    rows: np.ndarray
    # (8 t,) for each table the start of its bins [m], bins per metre, the last bin, the number of
    # the first among those of all tables, its first and its last row; two numbers are unused
    heads: np.ndarray
    # (2 k,) for each bin the bound in it [m] (inf: none, -1: to be searched), and the row of the
    # interval below the bound
    bins: np.ndarray
    is_alike: bool  # all connectors follow one table
    # (3 s,) int32, for connectors of a block that follow one table: index in `rows` of the lower
    # of two adjacent intervals that contain all lanes' lengths; -1: not known
    near: np.ndarray
    beyond: np.ndarray  # (1,) 1 once a length was outside its table
