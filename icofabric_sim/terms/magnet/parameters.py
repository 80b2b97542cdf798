# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the term: name, default, unit, description, range."""

PARAMETERS = (
    ('field.magnetic', [0.0, 0.0, 0.0], 'T',
     'uniform magnetic field, world axes'),
)
