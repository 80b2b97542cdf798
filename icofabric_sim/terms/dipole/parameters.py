# SPDX-FileCopyrightText: 2026 The icofabric_sim authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the term: name, default, unit, description, range."""

PARAMETERS = (
    ('charge.dipole', [0.0, 0.0, 0.0], 'C m',
     'electric dipole moment of each shell, body axes'),
)
