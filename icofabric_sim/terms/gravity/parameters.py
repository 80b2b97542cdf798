# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the term: name, default, unit, description, range."""

PARAMETERS = (
    ('gravity', [0.0, 0.0, 0.0], 'm/s^2',
     'acceleration of gravity, world axes'),
)
