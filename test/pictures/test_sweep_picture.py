# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""What a figure of a study shows by itself: no column that holds rounding alone."""

from icofabric_sim.pictures.sweep_picture import _telling
import numpy as np


class Table(dict):
    """As much of a table as is looked at."""

    units = {'stiff': 'Pa', 'noise': 'Pa', 'small': 'N', 'word': '', 'count': ''}

    @property
    def kept(self):
        return list(self)


def test_rounding_of_columns_of_the_same_unit_is_left_out():
    table = Table({
        'stiff': np.array([7e4, 6e4, np.nan]), 'noise': np.array([1e-12, -3e-12, 0.0]),
        'small': np.array([1e-12, 2e-12, 3e-12]), 'word': np.array(['a', 'b', 'c']),
        'count': np.array([3, 3, 3])})
    assert _telling(table) == ['stiff', 'small']
